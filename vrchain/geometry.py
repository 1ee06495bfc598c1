"""Frames and angles.

World: x east, y north, z up, metres. Yaw: radians, anticlockwise from +x.
Bearing: radians, anticlockwise from a robot's heading, in [-pi, pi).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray


@dataclass(frozen=True)
class Pose:
    """Where an upright robot stands in the world: metres and radians."""

    x_m: float
    y_m: float
    yaw_rad: float = 0.0

    @property
    def xy_m(self) -> NDArray[np.float64]:
        """Position, (2,) float."""
        return np.array([self.x_m, self.y_m])

    def bearing_to_rad(self, point_xy_m: ArrayLike) -> float:
        """Bearing of a world point seen from this pose."""
        dx_m, dy_m = np.asarray(point_xy_m, dtype=float)[:2] - self.xy_m
        return float(wrap_angle_rad(np.arctan2(dy_m, dx_m) - self.yaw_rad))

    def distance_to_m(self, point_xy_m: ArrayLike) -> float:
        """Distance to a world point on the ground plane."""
        return float(np.hypot(*(np.asarray(point_xy_m, dtype=float)[:2] - self.xy_m)))


def relative(a: Pose, b: Pose) -> Pose:
    """Where B is in A's frame, both given in one frame."""
    c, s = np.cos(a.yaw_rad), np.sin(a.yaw_rad)
    x_m, y_m = b.xy_m - a.xy_m
    turn_rad = wrap_angle_rad(b.yaw_rad - a.yaw_rad)
    return Pose(float(c * x_m + s * y_m), float(c * y_m - s * x_m), float(turn_rad))


def placed(a: Pose, b: Pose) -> Pose:
    """Where B is in the frame that A is given in, B being given in A's."""
    c, s = np.cos(a.yaw_rad), np.sin(a.yaw_rad)
    x_m, y_m = a.x_m + c * b.x_m - s * b.y_m, a.y_m + s * b.x_m + c * b.y_m
    return Pose(float(x_m), float(y_m), float(wrap_angle_rad(a.yaw_rad + b.yaw_rad)))


def wrap_angle_rad(angle_rad: ArrayLike) -> NDArray[np.float64]:
    """Angles brought into [-pi, pi); same shape as given."""
    turned = (np.asarray(angle_rad, dtype=float) + np.pi) % (2 * np.pi)
    return turned % (2 * np.pi) - np.pi  # again: just below 0 rounds to a full turn


def rotation_z(yaw_rad: float) -> NDArray[np.float64]:
    """Rotation about the vertical, (3, 3) float."""
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def circular_mean_rad(angles_rad: ArrayLike) -> float:
    """Mean direction of angles, (n,) float, n > 0."""
    angles = np.asarray(angles_rad, dtype=float)
    return float(np.arctan2(np.sin(angles).mean(), np.cos(angles).mean()))

"""The average landmark vector: the difference of two means of directions points home.

Lambrinos, Moeller, Labhart, Pfeifer and Wehner, "A mobile robot employing insect strategies for
navigation", Robotics and Autonomous Systems 30, 2000; the landmarks are matched SIFT keypoints
here. Both views are brought into one frame by a compass, or by the median change of their bearings.
"""

import numpy as np
from numpy.typing import NDArray

from vrchain.geometry import wrap_angle_rad
from vrchain.homing.views import HomeVector, Views, at_home

_MOST_SWING_RAD = 1.0  # matches whose bearing changed more, the turn aside, are mistakes
_LOWEST_SLOPE = -0.5  # what is seen lower is no landmark
_ARRIVED_RAD = 0.002  # the median change of bearing up to which the robot is home


def landmark_vector(views: Views, heading_rad: float | None = None) -> HomeVector | None:
    """One step; None where nothing is matched, or the two means are the same."""
    heading = views.heading_rad if heading_rad is None else heading_rad
    now, then = views.matched
    if heading is None or len(now) == 0:
        return None
    swing = np.abs(views.swing_rad(heading))
    fair = (now.slope >= _LOWEST_SLOPE) & (then.slope >= _LOWEST_SLOPE)
    fair &= swing <= _MOST_SWING_RAD
    if fair.sum() < 2:
        return None
    a, b = _directions(now.bearing_rad[fair]), _directions(then.bearing_rad[fair] + heading)
    home = a.mean(axis=0) - b.mean(axis=0)
    length, remoteness = float(np.hypot(*home)), float(np.median(swing))
    if length == 0:  # as at home itself
        return at_home(len(a), remoteness) if remoteness <= _ARRIVED_RAD else None
    across = np.array([-home[1], home[0]]) / length
    std_rad = float(np.sqrt(((a - b) @ across).var() / len(a))) / length
    direction = float(wrap_angle_rad(np.arctan2(home[1], home[0])))
    return HomeVector(direction, std_rad, len(a), remoteness <= _ARRIVED_RAD, remoteness)


def _directions(bearing_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit vectors, (n, 2)."""
    return np.stack([np.cos(bearing_rad), np.sin(bearing_rad)], axis=1)

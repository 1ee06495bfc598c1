"""A ring of landmarks around home, all 8 m from it: what is seen of it from anywhere, and so the
way home, is known exactly."""

import numpy as np
from numpy.typing import NDArray
from sights import descriptors, directions

from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.homing import Snapshot
from vrchain.homing.views import HORIZON_COLUMNS
from vrchain.landmarks.extraction.sift import Features
from vrchain.seeding import generator

HOME = Pose(0.0, 0.0, 0.7)
RADIUS_M = 8.0
N = 240


def ring_snapshot(pose: Pose) -> Snapshot:
    """The keypoints of 240 landmarks evenly around, every third on the ground, and the horizon."""
    angle = 2 * np.pi * np.arange(N) / N
    height_m = generator(0, "ring").uniform(0.0, 3.0, N) * (np.arange(N) % 3 > 0)
    points = np.stack([RADIUS_M * np.cos(angle), RADIUS_M * np.sin(angle), height_m], axis=1)
    bearing, slope = directions(pose, points)
    size = 0.3 / np.hypot(*(points[:, :2] - pose.xy_m).T)
    return Snapshot(Features(bearing, slope, size, descriptors(N, "ring")), _horizon(pose))


def _horizon(pose: Pose) -> NDArray[np.float64]:
    """Grey values of a wall along the ring, seen along each column's bearing."""
    columns = (np.arange(HORIZON_COLUMNS) + 0.5) * 2 * np.pi / HORIZON_COLUMNS - np.pi
    course = columns + pose.yaw_rad
    along = pose.xy_m @ np.stack([np.cos(course), np.sin(course)])
    range_m = -along + np.sqrt(along**2 + RADIUS_M**2 - pose.xy_m @ pose.xy_m)
    wall = np.arctan2(pose.y_m + range_m * np.sin(course), pose.x_m + range_m * np.cos(course))
    waves = generator(0, "wall").normal(size=(2, 12))
    k = np.arange(1, 13)
    return np.asarray(
        128 + 20 * (np.cos(np.outer(wall, k)) @ waves[0] + np.sin(np.outer(wall, k)) @ waves[1])
    )


def heading_rad(pose: Pose) -> float:
    """Home's heading against the robot's, as a compass tells it."""
    return float(wrap_angle_rad(HOME.yaw_rad - pose.yaw_rad))

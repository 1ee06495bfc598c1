"""Homing in scale space: what looks larger from home than from here lies on home's side.

Churchill and Vardy, "Homing in scale space", IROS 2008, and "An orientation invariant visual homing
algorithm", Journal of Intelligent and Robotic Systems 71, 2013: matched SIFT keypoints whose scale
grew or shrank tell which half of the horizon to go to. Directions are the robot's own, so that a
compass serves only to see which matches are mistakes.
"""

import numpy as np

from vrchain.geometry import wrap_angle_rad
from vrchain.homing.views import HomeVector, Views, at_home

_LEAST_CHANGE = 0.03  # of the logarithm of a keypoint's size; what changed less tells nothing
_MOST_SWING_RAD = 0.15  # matches whose bearing changed more, the turn aside, are mistakes
_ARRIVED_RAD = 0.002  # the median change of bearing up to which the robot is home


def scale_space(views: Views, heading_rad: float | None = None) -> HomeVector | None:
    """One step; None when no keypoint changed its size, and none that it is home."""
    heading = views.heading_rad if heading_rad is None else heading_rad
    now, then = views.matched
    if heading is None or len(now) == 0:
        return None
    swing = np.abs(views.swing_rad(heading))
    change = np.log(then.size_rad / now.size_rad)
    telling = (np.abs(change) >= _LEAST_CHANGE) & (swing <= _MOST_SWING_RAD)
    bearing = now.bearing_rad[telling] + np.where(change[telling] > 0, 0.0, np.pi)
    votes = np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
    total, remoteness = votes.sum(axis=0), float(np.median(swing))
    if not total.any():  # as at home itself, where nothing changed
        return at_home(len(now), remoteness) if remoteness <= _ARRIVED_RAD else None
    accord = np.clip(np.hypot(*votes.mean(axis=0)), 1e-9, 1.0)
    std_rad = float(np.sqrt(-2 * np.log(accord) / len(votes)))
    direction = float(wrap_angle_rad(np.arctan2(total[1], total[0])))
    return HomeVector(direction, std_rad, len(votes), remoteness <= _ARRIVED_RAD, remoteness)

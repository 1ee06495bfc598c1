"""Homing in scale space: what looks larger from home than from here lies on home's side.

Churchill and Vardy, "Homing in scale space", IROS 2008, and "An orientation invariant visual homing
algorithm", Journal of Intelligent and Robotic Systems 71, 2013: matched SIFT keypoints whose scale
grew or shrank tell which half of the horizon to go to. Directions are the robot's own, so that a
compass serves only to see which matches are mistakes.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vrchain.geometry import wrap_angle_rad
from vrchain.homing.views import HomeVector, Views


@dataclass(frozen=True)
class ScaleSpace:
    """least_change: of the logarithm of a keypoint's size; what changed less tells nothing.

    most_swing_rad: matches whose bearing changed more, the turn aside, are mistakes. apart: those
    that grew and those that shrank are averaged apart, and count the same. arrived_rad: the median
    change of bearing up to which the robot is home.
    """

    least_change: float = 0.03
    most_swing_rad: float = 0.15
    apart: bool = False
    arrived_rad: float = 0.002

    def __call__(self, views: Views, heading_rad: float | None = None) -> HomeVector | None:
        """One step; None when no keypoint changed its size."""
        heading = views.heading_rad if heading_rad is None else heading_rad
        if heading is None or len(views.matched[0]) == 0:
            return None
        now, then = views.matched
        swing = np.abs(views.swing_rad(heading))
        change = np.log(then.size_rad / now.size_rad)
        telling = (np.abs(change) >= self.least_change) & (swing <= self.most_swing_rad)
        larger = change[telling] > 0  # from home
        bearing = now.bearing_rad[telling] + np.where(larger, 0.0, np.pi)
        votes = np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
        if self.apart:
            total = _unit(votes[larger].sum(axis=0)) + _unit(votes[~larger].sum(axis=0))
        else:
            total = votes.sum(axis=0)
        if not total.any():
            return None
        accord = np.clip(np.hypot(*votes.mean(axis=0)), 1e-9, 1.0)
        std_rad = float(np.sqrt(-2 * np.log(accord) / len(votes)))
        remoteness = float(np.median(swing))
        direction = float(wrap_angle_rad(np.arctan2(total[1], total[0])))
        return HomeVector(
            direction, std_rad, len(votes), remoteness <= self.arrived_rad, remoteness
        )


def _unit(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Its direction, (2,); none stays none."""
    return np.asarray(vector / max(float(np.hypot(*vector)), 1e-9))

"""The average landmark vector: the difference of two means of directions points home.

Lambrinos, Moeller, Labhart, Pfeifer and Wehner, "A mobile robot employing insect strategies for
navigation", Robotics and Autonomous Systems 30, 2000; the landmarks are SIFT keypoints here. Both
views are brought into one frame by a compass, or by the median change of matched bearings.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vrchain.geometry import wrap_angle_rad
from vrchain.homing.views import HomeVector, Views


@dataclass(frozen=True)
class LandmarkVector:
    """common: only keypoints that are matched count, else, as published, all of both views.

    most_swing_rad: matches whose bearing changed more, the turn aside, are mistakes. lowest_slope:
    what is seen lower is no landmark. arrived_rad: the median change of bearing up to which the
    robot is home.
    """

    common: bool = True
    most_swing_rad: float = 1.0
    lowest_slope: float = -0.5
    arrived_rad: float = 0.002

    def __call__(self, views: Views, heading_rad: float | None = None) -> HomeVector | None:
        """One step; None where nothing is matched, or the two means are the same."""
        heading = views.heading_rad if heading_rad is None else heading_rad
        if heading is None or len(views.matched[0]) == 0:
            return None
        swing = np.abs(views.swing_rad(heading))
        now, then = views.current.features, views.home.features
        if self.common:
            now, then = views.matched
            fair = (now.slope >= self.lowest_slope) & (then.slope >= self.lowest_slope)
            fair &= swing <= self.most_swing_rad
            now, then = now.take(fair), then.take(fair)
        else:
            now = now.take(now.slope >= self.lowest_slope)
            then = then.take(then.slope >= self.lowest_slope)
        if min(len(now), len(then)) < 2:
            return None
        a, b = _directions(now.bearing_rad), _directions(then.bearing_rad + heading)
        home = a.mean(axis=0) - b.mean(axis=0)
        length = float(np.hypot(*home))
        if length == 0:
            return None
        across = np.array([-home[1], home[0]]) / length
        if self.common:
            variance = ((a - b) @ across).var() / len(a)
        else:
            variance = (a @ across).var() / len(a) + (b @ across).var() / len(b)
        direction = float(wrap_angle_rad(np.arctan2(home[1], home[0])))
        remoteness = float(np.median(swing))
        std_rad, arrived = float(np.sqrt(variance)) / length, remoteness <= self.arrived_rad
        return HomeVector(direction, std_rad, min(len(a), len(b)), arrived, remoteness)


def _directions(bearing_rad: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit vectors, (n, 2)."""
    return np.stack([np.cos(bearing_rad), np.sin(bearing_rad)], axis=1)

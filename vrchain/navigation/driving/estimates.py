"""Where a landmark or the goal is believed to be, in the frame of odometry, and how surely.

A sight is what one look tells of a thing: its bearing and a rough range. Sights are weighed by
their covariances (a Kalman filter without motion); odometry's drift makes an estimate less sure
with the way driven.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vrchain.geometry import Pose

Array = NDArray[np.float64]

_BEARING_STD_RAD = 0.04  # of a sight, the robot's own heading and the thing's extent included
_ASIDE = 0.58  # of half its width, as if any point were as likely
RANGE_STD = 0.25  # of the range that the network tells, as a share
_DRIFT_M2_PER_M = 0.03  # of variance, a metre driven: 1 m after 30 m


@dataclass(frozen=True, eq=False)
class Estimate:
    """xy_m: (2,); covariance: (2, 2), square metres."""

    xy_m: Array
    covariance: Array

    def bearing_rad(self, here: Pose) -> float:
        """Where it lies from the robot's heading."""
        return here.bearing_to_rad(self.xy_m)

    def range_m(self, here: Pose) -> float:
        """How far away it is."""
        return here.distance_to_m(self.xy_m)

    def seen_from(self, here: Pose) -> tuple[float, float]:
        """Both: radians and metres."""
        return self.bearing_rad(here), self.range_m(here)

    @property
    def std_m(self) -> float:
        """How far off it may be, in the direction in which least is known."""
        return float(np.sqrt(np.linalg.eigvalsh(self.covariance)[-1]))

    def std_along_m(self, here: Pose) -> float:
        """How much farther or nearer it may be."""
        away = self.xy_m - here.xy_m
        along = away / max(float(np.hypot(*away)), 1e-9)
        return float(np.sqrt(along @ self.covariance @ along))

    def after(self, way_m: float, m2_per_m: float = _DRIFT_M2_PER_M) -> "Estimate":
        """The estimate after driving so far, its variance so much larger for each metre."""
        return self.unsure(float(np.sqrt(m2_per_m * way_m)))

    def unsure(self, std_m: float) -> "Estimate":
        """The estimate, so much less sure in every direction."""
        return Estimate(self.xy_m, self.covariance + std_m**2 * np.eye(2))

    def with_sight(self, sight: "Estimate") -> "Estimate":
        """Both estimates taken together."""
        gain = self.covariance @ np.linalg.inv(self.covariance + sight.covariance)
        xy_m = self.xy_m + gain @ (sight.xy_m - self.xy_m)
        return Estimate(xy_m, (np.eye(2) - gain) @ self.covariance)

    def astray(self, sight: "Estimate") -> float:
        """By how many standard deviations a sight lies elsewhere."""
        off = sight.xy_m - self.xy_m
        return float(np.sqrt(off @ np.linalg.solve(self.covariance + sight.covariance, off)))


def sighted(
    here: Pose, bearing_rad: float, range_m: float, half_width_rad: float = 0.0,
    range_std: float = RANGE_STD,
) -> Estimate:  # fmt: skip
    """Where a thing is by one sight of it; of a wide one, its nearest point may be aside."""
    course = here.yaw_rad + bearing_rad
    along = np.array([np.cos(course), np.sin(course)])
    across = np.array([-along[1], along[0]])
    aside_rad = float(np.hypot(_BEARING_STD_RAD, _ASIDE * half_width_rad))
    stds = range_std * range_m + 0.3, aside_rad * range_m + 0.2
    covariance = stds[0] ** 2 * np.outer(along, along) + stds[1] ** 2 * np.outer(across, across)
    return Estimate(here.xy_m + range_m * along, covariance)

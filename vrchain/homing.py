"""Visual homing to a place: from the current panorama and a stored one, which way to drive.

A pure function of features; no map, no coordinates, no compass.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vrchain.geometry import wrap_angle_rad
from vrchain.landmarks.epipolar import estimate
from vrchain.landmarks.sift import Features, mutual_matches


@dataclass(frozen=True)
class HomeVector:
    """bearing_rad: where home lies. std_rad: how sure. arrived: home is where the robot stands."""

    bearing_rad: float
    std_rad: float
    n_matches: int
    arrived: bool


def home_vector(current: Features, home: Features, arrived_rad: float = 0.03) -> HomeVector | None:
    """One homing step to the place of a stored panorama; None when the two share too little.

    Direction by the epipolar geometry of matched bearings. Arrived when, the turn between the two
    headings aside, the matched bearings differ by less than ``arrived_rad`` (median).
    """
    i, j = mutual_matches(current.descriptors, home.descriptors)
    now, then = current.take(i), home.take(j)
    turn = wrap_angle_rad(now.bearing_rad - then.bearing_rad)
    if len(turn) >= 8:
        rest = wrap_angle_rad(turn - _mode_rad(turn))
        if np.median(np.abs(rest)) < arrived_rad:
            return HomeVector(0.0, 0.0, len(turn), True)
    geometry = estimate(now.bearing_rad, now.slope, then.bearing_rad, then.slope)
    if geometry is None:
        return None
    n_matches = int(geometry.inliers.sum())
    return HomeVector(geometry.direction_rad, geometry.direction_std_rad, n_matches, False)


def _mode_rad(angles: NDArray[np.float64], bin_rad: float = np.radians(2.0)) -> float:
    """The commonest of some angles."""
    counts = np.bincount(((angles + np.pi) / bin_rad).astype(int))
    peak = (counts.argmax() + 0.5) * bin_rad - np.pi
    near = np.abs(wrap_angle_rad(angles - peak)) < bin_rad
    return float(peak + np.median(wrap_angle_rad(angles[near] - peak)))

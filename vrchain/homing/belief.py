"""What matched keypoints make believe of the way home: a chance for every direction.

Poses that two matches determine, and a grid of all, are weighed roughly; the likeliest are led to
their peaks, upright and tilted. Peaks with their evidence, and the grid, which also holds what
sizes alone say, are one distribution. Its mean error, wherever home is said to lie, is known. That
all matches are wrong, and nothing follows, is as likely as evidence of 0 says.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vrchain.geometry import wrap_angle_rad
from vrchain.landmarks.matching.tilted import Likelihood, Peaks

Array = NDArray[np.float64]

_DIRECTIONS = 720
_BEARING_RAD = (np.arange(_DIRECTIONS) + 0.5) * (2 * np.pi / _DIRECTIONS) - np.pi
_LED = 40  # poses led to their peaks
_NEAR_RAD = 0.06  # of the best direction: those that it is the mean of
_SAME_RAD = 0.02  # peaks that are one
_ALONE = 0.99  # share of a peak beside which no other counts
_ANY_RAD = np.pi / np.sqrt(3)  # root mean square of an error that may be any
_BY_GRID_RAD = 0.25  # what a direction is off besides that the grid knows, and no peak
_SURE = 50.0  # evidence beyond which no number differs


@dataclass(frozen=True, eq=False)
class Belief:
    """chance: (720,) of directions from -pi on. peaks: the likeliest first; share (k,) of each.

    nothing: chance that all matches are wrong; the others are for that they are not.
    """

    chance: Array
    peaks: Peaks
    share: Array
    nothing: float

    def best(self) -> tuple[float, float, float]:
        """The direction of least mean error, the root mean square of its error, and the mean.

        The mean is for that not all matches are wrong.
        """
        direction, std_rad, mean_rad = self._best()
        known = std_rad**2 + (1 - self.share.sum()) * _BY_GRID_RAD**2
        square = (1 - self.nothing) * known + self.nothing * _ANY_RAD**2
        return float(wrap_angle_rad(direction)), float(np.sqrt(square)), mean_rad

    def _best(self) -> tuple[float, float, float]:
        if self.share[0] > _ALONE:
            std_rad = float(self.peaks.std_rad[0])
            return float(self.peaks.poses[0, 0]), std_rad, std_rad
        apart = np.abs(wrap_angle_rad(_BEARING_RAD - _BEARING_RAD[0]))
        mean = np.fft.irfft(np.fft.rfft(self.chance) * np.fft.rfft(apart), n=_DIRECTIONS)
        k = int(mean.argmin())
        off = wrap_angle_rad(_BEARING_RAD - _BEARING_RAD[k])
        near = np.abs(off) < _NEAR_RAD
        within = float(self.chance[near].sum())
        direction = _BEARING_RAD[k] + float(self.chance[near] @ off[near]) / max(within, 1e-12)
        off = wrap_angle_rad(_BEARING_RAD - direction)
        return float(direction), float(np.sqrt(self.chance @ off**2)), float(mean[k])


def likeliest(likelihood: Likelihood, starts: Array) -> Peaks:
    """The peaks uphill of (k, 2) directions, upright and tilted, the likeliest first."""
    poses = np.zeros((len(starts), 6))
    poses[:, :2] = starts
    near = likelihood.peaks(poses, tilted=False, exact=True)
    upright = likelihood.peaks(poses, tilted=False)
    tilted = likelihood.peaks(upright.poses, tilted=True)
    found = (vars(peaks).values() for peaks in (near, upright, tilted))
    every = Peaks(*(np.concatenate(parts) for parts in zip(*found, strict=True)))
    return every.take(np.argsort(-every.log_evidence, kind="stable"))


def believe(likelihood: Likelihood, bearings_slopes: tuple[Array, Array, Array, Array]) -> Belief:
    """The belief by a likelihood and the bearings and slopes of its matches, two or more."""
    starts, cells = likelihood.starts(bearings_slopes, _LED)
    cells = cells + 2 * np.log(2 * np.pi / len(cells))
    return of_peaks(likeliest(likelihood, starts), cells)


def of_peaks(peaks: Peaks, cells: Array | None = None) -> Belief:
    """The belief by peaks, the likeliest first, and log-odds of cells (directions, headings)."""
    peaks, chance = _single(peaks), np.zeros(_DIRECTIONS)
    top = float(peaks.log_evidence[0])
    if cells is not None:
        top = max(top, float(cells.max()))
        by_grid = np.exp(cells - top).sum(axis=1)
        grid = np.arange(len(by_grid)) * (2 * np.pi / len(by_grid))
        chance += np.interp(_BEARING_RAD, grid, by_grid, period=2 * np.pi)
        chance *= len(by_grid) / _DIRECTIONS
    weights = np.exp(peaks.log_evidence - top)
    for direction, std_rad, weight in zip(peaks.poses[:, 0], peaks.std_rad, weights, strict=True):
        off = wrap_angle_rad(_BEARING_RAD - direction) / max(std_rad, 2 * np.pi / _DIRECTIONS)
        bump = np.exp(-(off**2) / 2)
        chance += weight * bump / bump.sum()
    total = float(chance.sum())
    nothing = 1 / (1 + np.exp(min(top + np.log(total), _SURE)))
    return Belief(chance / total, peaks, weights / total, float(nothing))


def _single(peaks: Peaks) -> Peaks:
    """Each peak once."""
    left, kept = np.arange(len(peaks.poses)), []
    while len(left):
        kept.append(left[0])
        off = wrap_angle_rad(peaks.poses[left, :2] - peaks.poses[left[0], :2])
        left = left[np.abs(off).max(axis=1) > _SAME_RAD]
    return peaks.take(np.array(kept))

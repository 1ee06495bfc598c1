"""Warping the horizon: the move that turns one ring of grey values into the other.

Franz, Schoelkopf, Mallot and Buelthoff, "Where did I take that snapshot? Scene-based homing by
image matching", Biological Cybernetics 79, 1998. All things are taken to stand equally far from
home: for every direction and length of a move there, the current ring is warped into what would be
seen then and compared with home's ring, at every turn unless a compass says which.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vrchain.homing.views import HORIZON_COLUMNS, HomeVector, Views

Array = NDArray[np.float64]

_N = HORIZON_COLUMNS
_COLUMN_RAD = 2 * np.pi / _N
_FINER = 4  # turns tried a column
_NEAREST = 0.03  # the shortest move tried
_BLANK = 1.0  # grey values: rings that differ less from their mean show nothing


@dataclass(frozen=True)
class Warping:
    """farthest: the longest move tried, in distances of what is around; lengths: how many, in even
    proportion.

    smooth_rad: standard deviation of the blur before. arrived_change: one minus the correlation of
    the rings, the turn aside, up to which the robot is home.
    """

    farthest: float = 0.25
    lengths: int = 4
    smooth_rad: float = 0.03
    arrived_change: float = 0.003

    def __call__(self, views: Views, heading_rad: float | None = None) -> HomeVector | None:
        """One step; None where a ring is missing or blank."""
        now, then = (self._ring(v.horizon) for v in (views.current, views.home))
        if now is None or then is None:
            return None
        lengths = np.geomspace(_NEAREST, self.farthest, self.lengths)
        match = _correlation(_warped(now, lengths), then, heading_rad).max(axis=1)
        change = float(1 - _correlation(now[None], then, heading_rad)[0])
        bearing = (np.arange(_N) + 0.5) * _COLUMN_RAD - np.pi
        independent = np.pi / max(self.smooth_rad, _COLUMN_RAD)
        doubt = (match.max() - match) / max(1 - float(match.max()), 1e-9)
        weight = np.exp(-independent * doubt)
        accord = np.abs(weight @ np.exp(1j * bearing)) / weight.sum()
        std_rad = float(np.sqrt(-2 * np.log(np.clip(accord, 1e-9, 1.0))))
        direction = float(bearing[match.argmax()])
        return HomeVector(direction, std_rad, _N, change <= self.arrived_change, change)

    def _ring(self, horizon: Array | None) -> Array | None:
        """A horizon blurred, without its mean, (180,); None if there is none or it is blank."""
        if horizon is None or horizon.std() < _BLANK:
            return None
        waves = np.arange(_N // 2 + 1)
        spectrum = np.fft.rfft(horizon - horizon.mean())
        return np.fft.irfft(spectrum * np.exp(-((waves * self.smooth_rad) ** 2) / 2), n=_N)


def _warped(ring: Array, lengths: Array) -> Array:
    """The ring after a move along each column's bearing: (180 bearings, lengths, 180) float."""
    away = np.arange(_N) * _COLUMN_RAD  # of a thing seen from home, from the direction of the move
    seen = np.arctan2(np.sin(away), np.cos(away) + lengths[:, None]) / _COLUMN_RAD
    course, column = np.arange(_N)[:, None, None], np.arange(_N)
    place = course + seen[np.arange(len(lengths))[:, None], (column - course) % _N]
    low = np.floor(place).astype(int)
    share = place - low
    return (1 - share) * ring[low % _N] + share * ring[(low + 1) % _N]


def _correlation(rings: Array, then: Array, heading_rad: float | None) -> Array:
    """Of rings (..., 180) with home's, at the best turn or at the compass's: (...) float."""
    rings = rings - rings.mean(axis=-1, keepdims=True)
    scale = np.maximum(np.linalg.norm(rings, axis=-1) * np.linalg.norm(then), 1e-9)
    spectrum = np.fft.rfft(then)
    if heading_rad is None:
        every = np.fft.irfft(np.fft.rfft(rings) * np.conj(spectrum), n=_FINER * _N)
        return np.asarray(_FINER * every.max(axis=-1) / scale)
    waves = np.arange(_N // 2 + 1)
    turned = np.fft.irfft(spectrum * np.exp(-1j * waves * heading_rad), n=_N)
    return np.asarray(rings @ turned / scale)

"""Spots: single cells of landmarks, each with a learned descriptor, matched between panoramas.

The network learns to tell every spot of a landmark from all others, whichever way it is looked at,
so that spots match where keypoints no longer do. Large landmarks give a sample of their cells.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vrchain.landmarks.extraction.proposer import Proposals
from vrchain.landmarks.extraction.raster import directions_of
from vrchain.landmarks.matching.epipolar import PlanarGeometry
from vrchain.landmarks.matching.guided import matched_under, mutual
from vrchain.panorama import CameraRig

Array = NDArray[np.float64]
Matched = tuple[NDArray[np.int64], NDArray[np.int64]]
"""Spots of A and of B, those of one place being the same."""

EACH = 100  # of a proposal, at most
ONE = 127.0  # in descriptors of unit length

_MOST = 2200  # of a panorama, when all are matched with all
_TOLERANCE_RAD = 0.012  # a cell is as wide
_LEAST_ALIKE = 0.3  # cosine
_NONE = np.empty(0, dtype=np.int64)


@dataclass(frozen=True, eq=False)
class Spots:
    """Spots of one panorama, (n,) each, in the order of their proposals' cells.

    owner: the proposal; bearing_rad, slope: robot's frame; descriptors: (n, d) int8, of length
    ``ONE``.
    """

    owner: NDArray[np.int64]
    bearing_rad: Array
    slope: Array
    descriptors: NDArray[np.int8]

    def __len__(self) -> int:
        return len(self.owner)

    def take(self, index: ArrayLike) -> "Spots":
        """The spots at ``index`` (integers or a mask)."""
        i = np.asarray(index)
        return Spots(self.owner[i], self.bearing_rad[i], self.slope[i], self.descriptors[i])

    @property
    def unit(self) -> NDArray[np.float32]:
        """Descriptors (n, d) of unit length, so short that products are exact in float32."""
        return np.asarray(np.round(self.descriptors * (1024 / ONE)) / 1024, dtype=np.float32)

    @property
    def directions(self) -> Array:
        """(n, 2): bearing_rad and slope."""
        return np.column_stack([self.bearing_rad, self.slope])


NO_SPOTS = Spots(_NONE, np.empty(0), np.empty(0), np.empty((0, 1), dtype=np.int8))


def described(proposals: Proposals) -> NDArray[np.int64]:
    """Which of the proposals' cells are spots: places in ``proposals.cell``."""
    owner = proposals.owner
    every = -(-np.bincount(owner, minlength=len(proposals)) // EACH)
    return np.flatnonzero(ranks(owner) % np.maximum(every, 1)[owner] == 0)


def ranks(owner: NDArray[np.int64]) -> NDArray[np.int64]:
    """How many of the same owner come before each: (n,)."""
    order = np.argsort(owner, kind="stable")
    rank = np.empty(len(owner), dtype=np.int64)
    rank[order] = np.arange(len(owner)) - np.searchsorted(owner[order], owner[order])
    return rank


def spots_of(proposals: Proposals, rig: CameraRig, descriptors: NDArray[np.int8]) -> Spots:
    """The spots of proposals; descriptors: (n, d) of those ``described``."""
    place = described(proposals)
    bearing_rad, slope = directions_of(proposals.cell[place], rig)
    return Spots(proposals.owner[place], bearing_rad, slope, descriptors)


def descriptors_of(proposals: Proposals, local: NDArray[np.float32]) -> NDArray[np.int8]:
    """Descriptors of the spots, by what the network says of all cells: (d, rows, columns)."""
    cells = proposals.cell[described(proposals)]
    found = local.reshape(len(local), -1)[:, cells].T.astype(float)
    length = np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-9)
    return np.asarray(np.round(found / length * ONE), dtype=np.int8)


def matched(a: Spots, b: Spots) -> Matched:
    """Spots that are each other's most alike."""
    own_a, own_b = (np.arange(0, len(s), max(1, -(-len(s) // _MOST))) for s in (a, b))
    if min(len(own_a), len(own_b)) == 0:
        return _NONE, _NONE
    alike = a.take(own_a).unit @ b.take(own_b).unit.T
    row, column = mutual(alike)
    return own_a[row], own_b[column]


def matched_within(
    a: Spots, b: Spots, pairs: NDArray[np.int64], geometry: PlanarGeometry
) -> list[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float32]]]:
    """Of each pair of proposals, (n, 2), the spots that match where the relative pose lets them.

    And how alike they are: the cosine.
    """
    owned_a, owned_b = (
        by_owner(s.owner, int(k) + 1) for s, k in zip((a, b), pairs.max(axis=0), strict=True)
    )
    wide_a, wide_b = a.unit, b.unit
    return matched_under(
        geometry, a.directions, b.directions, [(owned_a[i], owned_b[j]) for i, j in pairs],
        lambda ia, ib: wide_a[ia] @ wide_b[ib].T, _LEAST_ALIKE, _TOLERANCE_RAD,
    )  # fmt: skip


def by_owner(owner: NDArray[np.int64], n: int) -> list[NDArray[np.int64]]:
    """The places of each of n owners; -1: nobody's."""
    ends = np.cumsum(np.bincount(owner + 1, minlength=n + 1))
    return np.split(np.argsort(owner, kind="stable"), ends)[1:]

"""Spots. A spot is a local feature: one cell of a proposal with a descriptor of its own.

The network learns to tell every spot of a landmark from all others, whichever way it is looked at,
so that spots match where keypoints no longer do. Large landmarks give a sample of their cells.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vrchain.landmarks.extraction.proposer import Proposals
from vrchain.landmarks.extraction.raster import directions_of
from vrchain.landmarks.extraction.sift import Directions
from vrchain.panorama import CameraRig

EACH = 100  # of a proposal, at most
ONE = 127.0  # in descriptors of unit length


@dataclass(frozen=True, eq=False)
class Spots(Directions):
    """Spots of one panorama, in the order of their proposals' cells.

    owner: (n,) the proposal; descriptors: (n, d) int8, of length ``ONE``.
    """

    owner: NDArray[np.int64]
    descriptors: NDArray[np.int8]

    @property
    def unit(self) -> NDArray[np.float32]:
        """Descriptors (n, d) of unit length, so short that products are exact in float32."""
        return np.asarray(np.round(self.descriptors * (1024 / ONE)) / 1024, dtype=np.float32)


NO_SPOTS = Spots(np.empty(0), np.empty(0), np.empty(0, np.int64), np.empty((0, 1), np.int8))


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
    return Spots(bearing_rad, slope, proposals.owner[place], descriptors)


def descriptors_of(proposals: Proposals, local: NDArray[np.float32]) -> NDArray[np.int8]:
    """Descriptors of the spots, by what the network says of all cells: (d, rows, columns)."""
    cells = proposals.cell[described(proposals)]
    found = local.reshape(len(local), -1)[:, cells].T.astype(float)
    length = np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-9)
    return np.asarray(np.round(found / length * ONE), dtype=np.int8)

"""A landmark that is known by a few pictures, and how much something looks like it."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vrchain.landmarks.extraction.proposer import Proposals
from vrchain.landmarks.extraction.raster import directions_of
from vrchain.landmarks.extraction.record import LandmarkRecord
from vrchain.landmarks.extraction.spots import Spots
from vrchain.landmarks.matching.calibration import Calibration
from vrchain.landmarks.retrieval.template import LOWEST_SLOPE

Array = NDArray[np.float64]

_MIDDLE_SLOPE = 0.1  # what a picture shows reaches to its middle, give or take this
_APPEARANCE, _SPOTS = 0.75, 18.2  # of a proposal's worth
_TYPICAL_M = 15.0
_HEIGHT, _HEIGHT_M = 0.35, 0.5  # by how much heights above the camera may differ: share, metres


@dataclass(frozen=True, eq=False)
class Query:
    """A landmark by pictures.

    embedding: (k, d) what it looks like in each picture; spots: (m, d) unit descriptors of its
    spots, and height_m: (m,) how high above the camera each is; pictures: those that show it.
    """

    embedding: NDArray[np.float32]
    spots: NDArray[np.float32]
    height_m: Array
    pictures: tuple[LandmarkRecord, ...]

    def appearance(self, embedding: NDArray[np.float32], calibration: Calibration) -> Array:
        """Log-likelihood ratio of being it, by appearance, for proposals (n, d): (n,)."""
        if len(self.embedding) == 0 or len(embedding) == 0:
            return np.full(len(embedding), -np.inf)
        return calibration.appearance((embedding @ self.embedding.T).max(axis=1))

    def alike(self, proposals: Proposals, spots: Spots) -> Array:
        """How alike the spots of each proposal are to those of its that are about as high: (n,).

        The mean of the cosines, 0 for a proposal without spots.
        """
        n = len(proposals)
        if len(spots) == 0 or len(self.spots) == 0:
            return np.zeros(n)
        cosine = spots.unit @ self.spots.T
        high_m = (spots.slope * proposals.range_m[spots.owner])[:, None].astype(np.float32)
        height_m = self.height_m.astype(np.float32)
        most_m = np.maximum(np.abs(high_m), np.abs(height_m))
        most_m *= _HEIGHT  # in place: there may be a million
        most_m += _HEIGHT_M
        cosine *= np.abs(high_m - height_m) < most_m
        total = np.bincount(spots.owner, cosine.max(axis=1), n)
        return np.asarray(total / np.maximum(np.bincount(spots.owner, minlength=n), 1))

    def also(self, sights: Sequence[tuple[LandmarkRecord, int]]) -> "Query":
        """The same, known by some proposals of panoramas too; the pictures stay."""
        more = _of(sights)
        return Query(
            np.concatenate([self.embedding, more.embedding]),
            np.concatenate([self.spots, more.spots]),
            np.concatenate([self.height_m, more.height_m]),
            self.pictures,
        )


def worth_of(appearance: Array, alike: Array) -> Array:
    """By which proposals are chosen for a closer look, by appearance and how alike spots are."""
    return _APPEARANCE * appearance + _SPOTS * alike


def depth(range_m: ArrayLike) -> Array:
    """Ranges as they speak for a sight: the log of each over a typical one."""
    return np.asarray(np.log(np.clip(range_m, 1.0, 100.0) / _TYPICAL_M))


def query_of(pictures: Sequence[LandmarkRecord]) -> Query:
    """What pictures show in their middle. Pictures in which nothing is proposed there are left."""
    return _of([(p, k) for p in pictures if (k := subject(p)) is not None])


def _of(sights: Sequence[tuple[LandmarkRecord, int]]) -> Query:
    """What is known of a landmark by proposals that show it, each of its record."""
    none = np.empty((0, 0), dtype=np.float32)
    if not sights:
        return Query(none, none, np.empty(0), ())
    own = [(p, k, p.spots.take(p.spots.owner == k)) for p, k in sights]
    return Query(
        np.stack([p.proposals.embedding[k] for p, k, _ in own]),
        np.concatenate([spots.unit for *_, spots in own]),
        np.concatenate([spots.slope * p.proposals.range_m[k] for p, k, spots in own]),
        tuple(p for p, *_ in own),
    )


def subject(picture: LandmarkRecord) -> int | None:
    """The proposal that a picture is framed on: of those in its middle, that of the most cells.

    What lies low is left out: a lawn before a house may be larger than the house.
    """
    p = picture.proposals
    right, left, low, high = p.box.T
    middle = (right <= 0) & (left >= 0) & (low <= _MIDDLE_SLOPE) & (high >= -_MIDDLE_SLOPE)
    _, slope = directions_of(p.cell, picture.rig)
    upright = p.owner[slope >= LOWEST_SLOPE]
    cells = np.bincount(upright, minlength=len(p)) * middle
    return int(cells.argmax()) if cells.any() else None

"""Who sees this? One landmark looked up in many stored panoramas, without matching them all.

One matrix product tells how alike each stored proposal looks to the pictures of the landmark. Only
the few most alike are looked at more closely.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vrchain.landmarks.record import LandmarkRecord

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Gallery:
    """Landmark records side by side; they can be made again from a ledger alone.

    embedding: (n, d) of all their proposals; first: (records + 1,) where each record's begin.
    """

    records: tuple[LandmarkRecord, ...]
    embedding: NDArray[np.float32]
    first: NDArray[np.int64]

    def alike(self, embedding: NDArray[np.float32]) -> Array:
        """Cosine of each stored proposal and its most like one of (k, d): (n,)."""
        if len(self.embedding) == 0 or len(embedding) == 0:
            return np.full(len(self.embedding), -1.0)
        return np.asarray((self.embedding @ embedding.T).max(axis=1), dtype=float)


def gallery(records: Sequence[LandmarkRecord]) -> Gallery:
    """A gallery of records, in their order."""
    counts = [len(r.proposals) for r in records]
    dimensions = records[0].proposals.embedding.shape[1] if records else 0
    none = np.empty((0, dimensions), dtype=np.float32)
    stacked = np.concatenate([none, *(r.proposals.embedding for r in records)])
    return Gallery(tuple(records), stacked, np.cumsum([0, *counts]))


def subject(picture: LandmarkRecord) -> int | None:
    """The proposal that a picture shows, as one points out a thing: the largest in its middle."""
    right, left, low, high = picture.proposals.box.T
    middle = np.flatnonzero((right <= 0) & (left >= 0) & (low <= 0.1) & (high >= -0.1))
    if len(middle) == 0:
        return None
    area = ((left - right) * (high - low))[middle]
    return int(middle[area.argmax()])

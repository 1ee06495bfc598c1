"""Matches under a known relative pose: of what two regions hold, the most alike that may be one.

A match needs no ratio test then: few others may be the same point.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from vrchain.landmarks.epipolar import PlanarGeometry, may_meet

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def matched_under(
    geometry: PlanarGeometry,
    directions_a: Array,
    directions_b: Array,
    inside: Sequence[tuple[Index, Index]],
    alike: Callable[[Index, Index], NDArray[np.float32]],
    least: float,
    tolerance_rad: float,
) -> list[tuple[Index, Index, NDArray[np.float32]]]:
    """Of each pair of regions, the places that are each other's most alike, and how alike.

    directions_a, directions_b: (n, 2), (m, 2) bearing_rad and slope of all places. inside: those
    of each region. alike: (k, l) of some places; matches are more alike than ``least``.
    """
    seen_a, seen_b = geometry.from_a(directions_a), geometry.from_b(directions_b)
    found = []
    for ia, ib in inside:
        if min(len(ia), len(ib)) == 0:
            found.append((ia[:0], ib[:0], np.empty(0, dtype=np.float32)))
            continue
        score = alike(ia, ib)
        score[~may_meet(seen_a[ia], seen_b[ib], tolerance_rad)] = -np.inf
        row, column = mutual(score)
        good = score[row, column] > least
        row, column = row[good], column[good]
        found.append((ia[row], ib[column], score[row, column]))
    return found


def mutual(score: NDArray[np.float32]) -> tuple[Index, Index]:
    """Rows and columns, each once, that are each other's largest."""
    best = score.argmax(axis=1)
    row = np.flatnonzero(score[np.arange(len(score)), best] == score.max(axis=0)[best])
    _, first = np.unique(best[row], return_index=True)  # of rows alike, the first
    row = row[np.sort(first)]
    return row, best[row]

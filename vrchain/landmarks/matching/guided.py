"""Matches under a known relative pose: of what two regions hold, the most alike that may be one.

A match needs no ratio test then: few others may be the same point.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from vrchain.landmarks.matching.epipolar import PlanarGeometry, may_meet, sampson_terms

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Alike = NDArray[np.float32]

_WIDER = 1.01  # a first look at distances is rounded otherwise


def matched_under(
    geometry: PlanarGeometry,
    directions_a: Array,
    directions_b: Array,
    inside: Sequence[tuple[Index, Index]],
    alike: Callable[[Index, Index], Alike],
    least: float,
    tolerance_rad: float,
) -> list[tuple[Index, Index, Alike]]:
    """Of each pair of regions, the places that are each other's most alike, and how alike.

    directions_a, directions_b: (n, 2), (m, 2) bearing_rad and slope of all places. inside: those
    of each region. alike: (k, l) of some places; matches are more alike than ``least``.
    """
    nothing = np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64), np.empty(0, np.float32)
    if not any(len(ia) and len(ib) for ia, ib in inside):
        return [nothing] * len(inside)
    # all regions are numbered through, and what may match in any is looked at together
    own_a, own_b = (np.concatenate(regions) for regions in zip(*inside, strict=True))
    starts = np.cumsum([[0, 0], *((len(ia), len(ib)) for ia, ib in inside)], axis=0)
    seen_a, seen_b = geometry.from_a(directions_a), geometry.from_b(directions_b)
    lines_a, lines_b = sampson_terms(seen_a, seen_b)
    wider = (_WIDER * tolerance_rad) ** 2
    rows, columns, scores = [], [], []
    for (ia, ib), (start_a, start_b) in zip(inside, starts, strict=False):
        if min(len(ia), len(ib)) == 0:
            continue
        score = alike(ia, ib)
        of_a, of_b = lines_a[ia], lines_b[ib]
        residual, square = of_a[:, :2] @ of_b[:, :2].T, of_a[:, 2:] @ of_b[:, 2:].T
        row, column = np.nonzero((score > least) & (residual**2 < wider * square))
        rows.append(row + start_a)
        columns.append(column + start_b)
        scores.append(score[row, column])
    row, column, score = (np.concatenate(parts) for parts in (rows, columns, scores))
    met = may_meet(seen_a[own_a[row]], seen_b[own_b[column]], tolerance_rad)
    row, column, score = row[met], column[met], score[met]
    own = _mutual(row, column, score)
    row, column, score = row[own], column[own], score[own]
    ends = np.searchsorted(row, starts[1:-1, 0])
    return list(zip(*(np.split(x, ends) for x in (own_a[row], own_b[column], score)), strict=True))


def _mutual(row: Index, column: Index, score: Alike) -> Index:
    """Which scores are the largest of their row and of their column; of those alike, the first.

    In the order of their rows.
    """
    of_row, of_column = (np.full(k.max(initial=-1) + 1, -np.inf, np.float32) for k in (row, column))
    np.maximum.at(of_row, row, score)
    np.maximum.at(of_column, column, score)
    best = np.flatnonzero(score == of_row[row])
    best = best[np.unique(row[best], return_index=True)[1]]
    best = best[score[best] == of_column[column[best]]]
    return np.sort(best[np.unique(column[best], return_index=True)[1]])


def mutual(score: Alike) -> tuple[Index, Index]:
    """Rows and columns, each once, that are each other's largest."""
    best = score.argmax(axis=1)
    row = np.flatnonzero(score[np.arange(len(score)), best] == score.max(axis=0)[best])
    _, first = np.unique(best[row], return_index=True)  # of rows alike, the first
    row = row[np.sort(first)]
    return row, best[row]

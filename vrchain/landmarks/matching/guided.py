"""Matches of keypoints and of spots; under a known relative pose, those inside two regions.

A match needs no ratio test then: few others may be the same point.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from vrchain.landmarks.extraction.sift import Features
from vrchain.landmarks.extraction.spots import Spots
from vrchain.landmarks.matching.epipolar import PlanarGeometry, of_right_size, one_point

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Alike = NDArray[np.float32]
Matched = tuple[Index, Index]
"""Keypoints, or spots, of A and of B, those of one place being the same."""

NO_MATCH = np.empty(0, dtype=np.int64), np.empty(0, dtype=np.int64)

_KEYPOINT_RAD, _DESCRIPTORS = 0.005, 300.0  # off the relative pose; between descriptors, at most
_SPOT_RAD, _COSINE = 0.012, 0.3  # a cell is as wide; between descriptors, at least
_MOST_KEYPOINTS = 1500  # of a panorama, when all are matched under a pose
_MOST_SPOTS = 2200  # of a panorama, when all are matched with all


def keypoints_within(
    a: Features, b: Features, inside: Sequence[Matched], geometry: PlanarGeometry
) -> list[Matched]:
    """Of each pair of regions the keypoints that match; ``inside``: those in each region."""
    wide_a, wide_b = (f.descriptors.astype(np.float32) for f in (a, b))
    square_a, square_b = ((wide**2).sum(axis=1) for wide in (wide_a, wide_b))

    def alike(ia: Index, ib: Index) -> Alike:
        product = wide_a[ia] @ wide_b[ib].T
        return np.asarray(2 * product - square_a[ia][:, None] - square_b[ib])

    found = matched_under(
        geometry, a.directions, b.directions, inside, alike, -(_DESCRIPTORS**2), _KEYPOINT_RAD
    )
    return [(ia, ib) for ia, ib, _ in found]


def keypoints_under(a: Features, b: Features, geometry: PlanarGeometry) -> Matched:
    """Of the largest keypoints those that match under a pose, wherever they are."""
    largest = [np.sort(np.argsort(-f.size_rad, kind="stable")[:_MOST_KEYPOINTS]) for f in (a, b)]
    ((ia, ib),) = keypoints_within(a, b, [(largest[0], largest[1])], geometry)
    larger = np.log(b.size_rad[ib] / a.size_rad[ia])
    pose = [geometry.direction_rad], [geometry.heading_rad]
    good = of_right_size(*pose, a.directions[ia], b.directions[ib], larger)[0]
    return ia[good], ib[good]


def spots_within(
    a: Spots, b: Spots, pairs: Index, geometry: PlanarGeometry
) -> list[tuple[Index, Index, Alike]]:
    """Of each pair of proposals, (n, 2), the spots that match, and how alike: the cosine."""
    owned_a, owned_b = (
        by_owner(s.owner, int(k) + 1) for s, k in zip((a, b), pairs.max(axis=0), strict=True)
    )
    inside = [(owned_a[i], owned_b[j]) for i, j in pairs]
    unit_a, unit_b = a.unit, b.unit
    return matched_under(
        geometry, a.directions, b.directions, inside,
        lambda ia, ib: unit_a[ia] @ unit_b[ib].T, _COSINE, _SPOT_RAD,
    )  # fmt: skip


def spots_anywhere(a: Spots, b: Spots) -> Matched:
    """Spots that are each other's most alike, wherever they are."""
    own_a, own_b = (np.arange(0, len(s), max(1, -(-len(s) // _MOST_SPOTS))) for s in (a, b))
    if min(len(own_a), len(own_b)) == 0:
        return NO_MATCH
    row, column = mutual(a.take(own_a).unit @ b.take(own_b).unit.T)
    return own_a[row], own_b[column]


def by_owner(owner: Index, n: int) -> list[Index]:
    """The places of each of n owners; -1: nobody's."""
    ends = np.cumsum(np.bincount(owner + 1, minlength=n + 1))
    return np.split(np.argsort(owner, kind="stable"), ends)[1:]


def matched_under(
    geometry: PlanarGeometry,
    directions_a: Array,
    directions_b: Array,
    inside: Sequence[Matched],
    alike: Callable[[Index, Index], Alike],
    least: float,
    tolerance_rad: float,
) -> list[tuple[Index, Index, Alike]]:
    """Of each pair of regions, the places that are each other's most alike, and how alike.

    directions_a, directions_b: (n, 2), (m, 2) bearing_rad and slope of all places. inside: those
    of each region. alike: (k, l) of some places; matches are more alike than ``least``.
    """
    if not any(len(ia) and len(ib) for ia, ib in inside):
        return [(*NO_MATCH, np.empty(0, np.float32))] * len(inside)
    # all regions are numbered through, and what may match in any is looked at together
    own_a, own_b = (np.concatenate(regions) for regions in zip(*inside, strict=True))
    starts = np.cumsum([[0, 0], *((len(ia), len(ib)) for ia, ib in inside)], axis=0)
    away_a = directions_a[:, 0] - geometry.direction_rad
    away_b = directions_b[:, 0] - geometry.direction_rad + geometry.heading_rad
    seen_a, seen_b = _seen(away_a, directions_a[:, 1]), _seen(away_b, directions_b[:, 1])
    rows, columns, scores = [], [], []
    for (ia, ib), (start_a, start_b) in zip(inside, starts, strict=False):
        if min(len(ia), len(ib)) == 0:
            continue
        score = alike(ia, ib)
        row, column = np.divmod(np.flatnonzero(score > least), len(ib))
        rows.append(row + start_a)
        columns.append(column + start_b)
        scores.append(score[row, column])
    row, column, score = (np.concatenate(parts) for parts in (rows, columns, scores))
    (sin_a, cos_a, t_a), (sin_b, cos_b, t_b) = seen_a[own_a[row]].T, seen_b[own_b[column]].T
    met = one_point(sin_a, cos_a, t_a, sin_b, cos_b, t_b, tolerance_rad)
    row, column, score = row[met], column[met], score[met]
    own = _mutual(row, column, score)
    row, column, score = row[own], column[own], score[own]
    ends = np.searchsorted(row, starts[1:-1, 0])
    return list(zip(*(np.split(x, ends) for x in (own_a[row], own_b[column], score)), strict=True))


def _seen(from_baseline_rad: Array, slope: Array) -> NDArray[np.float32]:
    """Sine, cosine and slope of directions (n,) that are counted from the baseline: (n, 3)."""
    found = [np.sin(from_baseline_rad), np.cos(from_baseline_rad), slope]
    return np.stack(found, axis=1).astype(np.float32)


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


def mutual(score: Alike) -> Matched:
    """Rows and columns, each once, that are each other's largest."""
    best = score.argmax(axis=1)
    row = np.flatnonzero(score[np.arange(len(score)), best] == score.max(axis=0)[best])
    _, first = np.unique(best[row], return_index=True)  # of rows alike, the first
    row = row[np.sort(first)]
    return row, best[row]

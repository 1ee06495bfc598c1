"""Single spots of landmarks, the same from two places: which cells show them, and how to learn it.

The contrastive loss of van den Oord et al. (2018) over the cells of the other panorama, as Wang et
al. (2020) use it between places whose relative pose is known.
"""

from dataclasses import dataclass
from itertools import permutations

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray
from torch import Tensor

from vrchain.geometry import wrap_angle_rad
from vrchain.landmarks.extraction.raster import cell_bearings_rad, cell_slopes
from vrchain.landmarks.training.examples import Examples
from vrchain.panorama import CameraRig

_EACH = 256  # spots of a pair of panoramas
_OTHERS = 1500  # cells of the other panorama that they are told apart from
_PAIRS = 4  # pairs of panoramas of a group
_LEAST = 20  # spots in a pair from which it counts
_SAME_M, _SAME_SHARE = 0.2, 0.025  # how far apart in space, also as a share of the range
_NEAR_M, _NEAR_SHARE = 0.6, 0.03  # what is this near is neither the same nor another
_TEMPERATURE = 0.04


@dataclass(frozen=True, eq=False)
class SpotPairs:
    """Spots seen in two panoramas, ``first`` and ``second`` of a group.

    at_first: (n,) flat cells. at_second: (n + m,) flat cells, those of the spots and others after
    them. near: (n, n + m) bool, which of them lie so near the spot that they may look like it.
    """

    first: int
    second: int
    at_first: Tensor
    at_second: Tensor
    near: Tensor


def spots_of(
    examples: Examples, members: NDArray[np.int64], draws: np.random.Generator, mirrored: bool
) -> list[SpotPairs]:
    """Spots in some pairs of panoramas of a group, or of their mirror images."""
    ordered = list(permutations(range(len(members)), 2))
    chosen = draws.choice(len(ordered), min(_PAIRS, len(ordered)), replace=False)
    found = []
    for i, j in (ordered[k] for k in chosen):
        spots = _common(examples, i, j, members, draws, mirrored)
        if len(spots.at_first) >= _LEAST:
            found.append(spots)
    return found


def spot_loss(local: Tensor, spots: list[SpotPairs]) -> Tensor:
    """Each spot should be most like itself in the other one: local is (n, d, rows, columns)."""
    parts = []
    for pair in spots:
        alike = _alike(local, pair) / _TEMPERATURE
        parts.append(F.cross_entropy(alike, torch.arange(len(alike))))
    return torch.stack(parts).mean() if parts else local.sum() * 0.0


def spots_right(local: Tensor, spots: list[SpotPairs]) -> tuple[int, int]:
    """Of how many spots the most alike cell is the right one, and of how many in all."""
    right = [(_alike(local, p).argmax(dim=1) == torch.arange(len(p.at_first))).sum() for p in spots]
    return int(sum(right)), sum(len(p.at_first) for p in spots)


def _alike(local: Tensor, pair: SpotPairs) -> Tensor:
    a, b = (
        F.normalize(local[panorama].flatten(1)[:, cells].T, dim=1)
        for panorama, cells in ((pair.first, pair.at_first), (pair.second, pair.at_second))
    )
    return (a @ b.T).masked_fill(pair.near, -1.0)


def _common(
    examples: Examples,
    i: int,
    j: int,
    members: NDArray[np.int64],
    draws: np.random.Generator,
    mirrored: bool,
) -> SpotPairs:
    own_a, own_b = (examples.cells[members[k]].ravel() for k in (i, j))
    shown_a, shown_b = np.flatnonzero(own_a >= 0), np.flatnonzero(own_b >= 0)
    at_a = draws.permutation(shown_a)[: 4 * _EACH]
    points = points_m(examples, int(members[i]), at_a)
    at_b, range_m = cells_of(examples, int(members[j]), points)
    inside = at_b >= 0
    at_a, at_b, points, range_m = at_a[inside], at_b[inside], points[inside], range_m[inside]
    astray = np.linalg.norm(points_m(examples, int(members[j]), at_b) - points, axis=1)
    same = own_a[at_a] == own_b[at_b]
    same &= astray < np.maximum(_SAME_M, _SAME_SHARE * range_m)
    at_a, at_b, points, range_m = (x[same][:_EACH] for x in (at_a, at_b, points, range_m))
    at_b = np.concatenate([at_b, draws.permutation(shown_b)[:_OTHERS]])
    apart = np.linalg.norm(
        points[:, None] - points_m(examples, int(members[j]), at_b)[None], axis=2
    )
    near = apart < np.maximum(_NEAR_M, _NEAR_SHARE * range_m)[:, None]
    near[np.arange(len(at_a)), np.arange(len(at_a))] = False
    if mirrored:
        columns = examples.cells.shape[2]
        at_a, at_b = (x - 2 * (x % columns) + columns - 1 for x in (at_a, at_b))
    return SpotPairs(i, j, *(torch.from_numpy(x) for x in (at_a, at_b, near)))


def points_m(examples: Examples, index: int, cell: NDArray[np.int64]) -> NDArray[np.float64]:
    """What cells (n,) of panorama ``index`` show, in the world: (n, 3)."""
    rig, columns = CameraRig(), examples.cells.shape[2]
    x_m, y_m, yaw_rad = examples.poses[index]
    range_m = examples.range_m[index].ravel()[cell].astype(float)
    azimuth = cell_bearings_rad(rig)[cell % columns] + yaw_rad
    height_m = rig.camera_height_m + cell_slopes()[cell // columns] * range_m
    return np.stack(
        [x_m + range_m * np.cos(azimuth), y_m + range_m * np.sin(azimuth), height_m], axis=1
    )


def cells_of(
    examples: Examples, index: int, points: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """The flat cells (n,) of panorama ``index`` towards points (n, 3), -1 outside; ranges (n,)."""
    rig, (rows, columns) = CameraRig(), examples.cells.shape[1:]
    x_m, y_m, yaw_rad = examples.poses[index]
    away = points[:, :2] - (x_m, y_m)
    range_m = np.maximum(np.hypot(*away.T), 1e-6)
    bearing_rad = wrap_angle_rad(np.arctan2(away[:, 1], away[:, 0]) - yaw_rad)
    column = np.floor((rig.span_rad / 2 - bearing_rad) * columns / rig.span_rad).astype(int)
    slopes = cell_slopes()
    slope = (points[:, 2] - rig.camera_height_m) / range_m
    row = np.round((slopes[0] - slope) / (slopes[0] - slopes[1])).astype(int)
    inside = (row >= 0) & (row < rows)
    return np.where(inside, row * columns + column % columns, -1), range_m

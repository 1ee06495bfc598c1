"""Where a robot can drive in a scene, and how far it is from place to place.

Ways lead over a grid of free points, from each to 32 others around it, if every cell that the
straight step touches is free. On open ground they are at most 1.4 % longer than straight ones.
"""

from collections.abc import Sequence
from functools import cached_property
from itertools import product
from math import gcd

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from scipy.ndimage import label
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

from vrchain.world.model import Scene
from vrchain.world.truth import GroundTruth

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

SPACING_M, _CLEARANCE_M = 0.5, 0.5
_FLOOR_M = (-0.25, 0.05)  # what lies at such a height carries a robot
_REACH = 3  # cells that a step goes at most, along either axis
_STEPS = [(y, x) for y, x in product(range(-_REACH, _REACH + 1), repeat=2) if gcd(y, x) == 1]


class FreeSpace:
    """points_m: (n, 2), where a robot fits; region: (n,), a number for those that ways join.

    With ``truth``, only where something carries it, if anything does anywhere.
    """

    def __init__(self, scene: Scene, truth: GroundTruth | None = None) -> None:
        half = np.array(scene.extent_m) / 2 - SPACING_M / 2
        x, y = (np.arange(-h, h + 1e-9, SPACING_M) for h in half)
        points = np.stack(np.meshgrid(x, y), axis=-1)
        free = scene.is_free(points.reshape(-1, 2), _CLEARANCE_M).reshape(len(y), len(x))
        if truth is not None and (carried := _is_carried(truth, points[free])).any():
            free[free] = carried
        self.points_m: Array = points[free]
        self._free = free
        # A step touches the cells on its way, so what ways join has sides in common.
        self.region: NDArray[np.int32] = label(free)[0][free]

    @cached_property
    def _graph(self) -> csr_array:
        return _steps_m(self._free)

    def room(self, scene: Scene, goals: Sequence[int], within_m: float) -> tuple[int, list[int]]:
        """The largest region that comes so near to one of some objects, and those that it does.

        -1 and none if no region does; the largest of all, and none, without objects.
        """
        near = {i: {*self.region[self.around(scene.objects[i].footprint, within_m)]} for i in goals}
        regions, sizes = np.unique(self.region, return_counts=True)
        some = np.isin(regions, list(set[int]().union(*near.values()))) if goals else sizes > 0
        if not some.any():
            return -1, []
        region = int(regions[some][sizes[some].argmax()])
        return region, [i for i in goals if region in near[i]]

    def is_in(self, region: int, xy_m: ArrayLike) -> NDArray[np.bool_]:
        """Whether places, (n, 2), are beside a point of a region and no nearer to others': (n,)."""
        away_m, nearest = self._tree.query(xy_m)
        return np.asarray((self.region[nearest] == region) & (away_m <= SPACING_M))

    @cached_property
    def _tree(self) -> KDTree:
        return KDTree(self.points_m)

    def from_m(self, xy_m: Array) -> Array:
        """How far every point is from the one nearest to ``xy_m``: (n,), inf: not reachable."""
        return np.asarray(dijkstra(self._graph, indices=self.nearest(xy_m)))

    def nearest(self, xy_m: Array) -> int:
        """The point nearest to ``xy_m``."""
        return int(np.hypot(*(self.points_m - xy_m).T).argmin())

    def through_m(self, before_m: Array, zone: Ints) -> Array:
        """How far every point is by way of one of a zone's: (n,).

        before_m: how far the points of the zone are, both (z,).
        """
        can = np.isfinite(before_m)
        # one more node, from which the zone's points are as far as they are
        steps, n = self._graph, len(self.points_m)
        graph = csr_array(
            (
                np.append(steps.data, before_m[can]),
                np.append(steps.indices, zone[can].astype(steps.indices.dtype)),
                np.append(steps.indptr, steps.indptr[-1] + can.sum().astype(steps.indptr.dtype)),
            ),
            shape=(n + 1, n + 1),
        )
        return np.asarray(dijkstra(graph, indices=n)[:n])

    def around(self, footprint: shapely.Geometry, within_m: float) -> Ints:
        """The points within some distance of a footprint."""
        x0, y0, x1, y1 = footprint.bounds
        x, y = self.points_m.T
        near = (x > x0 - within_m) & (x < x1 + within_m)
        chosen = np.flatnonzero(near & (y > y0 - within_m) & (y < y1 + within_m))
        away = shapely.distance(footprint, shapely.points(self.points_m[chosen]))
        return chosen[away <= within_m]


def _is_carried(truth: GroundTruth, xy_m: Array) -> NDArray[np.bool_]:
    """Whether something lies under places, (n, 2), as high as a robot drives: (n,)."""
    lowest_m, highest_m = _FLOOR_M
    _, depth_m = truth.cast(np.insert(xy_m, 2, highest_m, axis=1), (0.0, 0.0, -1.0))
    return np.asarray(depth_m <= highest_m - lowest_m)


def _steps_m(free: NDArray[np.bool_]) -> csr_array:
    """The lengths of the steps between free cells of a grid, (rows, columns), both ways: (n, n)."""
    rows, columns = free.shape
    # 32 bits, as dijkstra would else copy all ends each time
    number = np.where(free, np.cumsum(free, dtype=np.int32).reshape(free.shape) - 1, -1)
    wide = np.pad(number, _REACH, constant_values=-1)
    ends, lengths_m = [], []
    for dy, dx in _STEPS:
        crossed = [wide[_REACH + y :, _REACH + x :][:rows, :columns] for y, x in _crossed(dy, dx)]
        can = np.min(crossed, axis=0) >= 0
        there = wide[_REACH + dy :, _REACH + dx :][:rows, :columns]
        ends.append(np.stack([number[can], there[can]]))
        lengths_m.append(np.full(can.sum(), SPACING_M * np.hypot(dy, dx)))
    n = int(free.sum())
    return csr_array((np.concatenate(lengths_m), np.concatenate(ends, axis=1)), shape=(n, n))


def _crossed(dy: int, dx: int) -> list[tuple[int, int]]:
    """The cells that a step touches, its ends and, at a corner, both beside it included."""
    within = product(*(range(min(0, d), max(0, d) + 1) for d in (dy, dx)))
    return [(y, x) for y, x in within if 2 * abs(y * dx - x * dy) <= abs(dy) + abs(dx)]

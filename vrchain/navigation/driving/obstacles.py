"""Collision-free paths: round what the range ring has met, as odometry remembers it.

A short memory of one robot's own, in the frame of its odometry: no map is given to it, and what it
met long ago is forgotten, since odometry drifts. What it has not seen is taken for free, so that a
path is found out by driving it (the freespace assumption of Koenig and Smirnov, 1996).
"""

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import cKDTree

from vrchain.geometry import Pose
from vrchain.navigation.driving.estimates import Array
from vrchain.navigation.settings import GaveUp
from vrchain.robot import UNSEEN_M, beams_rad

REACH_M = 7.9  # readings of the range ring from here on are of nothing
_CELL_M = 0.2  # of the memory
_STEP_CELLS = 2  # between nodes of a path
_HALF_CELLS = 1500  # the memory reaches 300 m each way from where it begins
_CLEARED_M = 3.0  # within which a beam that goes on shows that there is nothing
_BLOCKED_M, _HELD_M = 0.7, 6.0  # so far ahead, and for so much way, though beams may pass there
_KEPT_M = 80.0  # of way driven since it was met
_RADIUS_M = 0.47  # nothing is nearer to a path than this
_ROOM_M = 0.9  # and paths keep this distance where that costs little
_NOOK_M, _SQUEEZE_M = 2.0, 0.25  # so near to the robot, less room will do
_MARGIN_M = 18.0  # how far a path may lead around
_NEAR_M = 2.5  # a path is cut short with less room so near
_TIGHT = 2.0  # how many times longer a path without room counts


class ObstacleMap:
    """What was met, and paths around it; positions in the odometry's frame."""

    def __init__(self) -> None:
        self.driven_m = 0.0
        # How far the robot had driven when something was met in each cell.
        self._met = np.full((2 * _HALF_CELLS,) * 2, -np.inf, dtype=np.float32)
        self._last: Pose | None = None
        self._begin_xy_m = np.zeros(2)
        self._blocks: list[tuple[float, Array]] = []

    def note(self, here: Pose, range_ring_m: ArrayLike) -> None:
        """Take in a reading of the range ring, (n_beams,), all around."""
        ring = np.asarray(range_ring_m, dtype=float)
        if self._last is None:
            self._begin_xy_m = here.xy_m
        else:
            self.driven_m += self._last.distance_to_m(here.xy_m)
        self._last = here
        angle = here.yaw_rad + beams_rad(len(ring))
        rays = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        steps = np.arange(0.0, _CLEARED_M, _CELL_M)
        free = steps[None, :] < ring[:, None] - 2 * _CELL_M
        through = here.xy_m + rays[:, None, :] * steps[None, :, None]
        self._met[self._cells(through[free])] = -np.inf
        hit = (ring < REACH_M) & (ring != UNSEEN_M)
        self._met[self._cells(here.xy_m + rays[hit] * ring[hit, None])] = self.driven_m
        self._blocks = [b for b in self._blocks if self.driven_m - b[0] < _HELD_M]
        for since_m, points in self._blocks:
            self._met[self._cells(points)] = since_m

    def block(self, here: Pose, course_rad: float) -> None:
        """No headway in this direction: something is there, though the range ring may see past it.

        Such as between two posts: it is free again after some more driving, if it is seen so.
        """
        course = np.array([np.cos(course_rad), np.sin(course_rad)])
        across = np.array([-course[1], course[0]]) * np.linspace(-0.5, 0.5, 7)[:, None]
        points = here.xy_m + _BLOCKED_M * course + across
        self._blocks.append((self.driven_m, points))
        self._met[self._cells(points)] = self.driven_m

    def course_rad(self, here: Pose, target_xy_m: Array, within_m: float) -> float | None:
        """In which direction, in the odometry's frame, to drive to get that near.

        None: it stands as near as it can get.
        """
        path = self.path_m(here, target_xy_m, within_m)
        if len(path) < 2:
            return None
        x_m, y_m = self._ahead(here, path) - here.xy_m
        return float(np.arctan2(y_m, x_m))

    def _ahead(self, here: Pose, path: Array) -> Array:
        """The farthest point of a path to which it can be cut short."""
        farthest = path[1]
        for point in path[2:]:
            onward = point - here.xy_m
            away_m = float(np.hypot(*onward))
            half_m = _SQUEEZE_M if away_m <= _NEAR_M else _RADIUS_M
            across = np.array([-onward[1], onward[0]]) / max(away_m, _CELL_M) * half_m
            steps = np.linspace(0.0, 1.0, int(away_m / _CELL_M) + 2)[:, None, None]
            strip = here.xy_m + steps * onward + np.array([[-1.0], [0.0], [1.0]]) * across
            if (self._met[self._cells(strip.reshape(-1, 2))] > self.driven_m - _KEPT_M).any():
                break
            farthest = point
        return farthest

    def path_m(self, here: Pose, target_xy_m: Array, within_m: float) -> Array:
        """The points of a path, (n, 2), to within some distance of a target, or as near as may be.

        They are ``_STEP_CELLS`` cells apart; the first is where the robot is.
        """
        target = np.asarray(target_xy_m, dtype=float)
        nodes_m, length, before = self._search(here, target[None])
        away_m = np.hypot(*(nodes_m - target).T)
        can = np.isfinite(length)
        nearest_m = float(away_m[can].min())
        near = np.flatnonzero(can & (away_m <= max(within_m, nearest_m + _CELL_M)))
        node = int(near[(length[near] + away_m[near]).argmin()])
        nodes = []
        while node >= 0:
            nodes.append(node)
            node = int(before[node])
        return nodes_m[nodes[::-1]]

    def lengths_m(self, here: Pose, places_xy_m: Array) -> Array:
        """How long the paths to some places (n, 2) are, inf where none is known to be possible."""
        nodes_m, length, _ = self._search(here, places_xy_m)
        away_m, nearest = cKDTree(nodes_m).query(places_xy_m)
        return np.where(away_m < 2 * _STEP_CELLS * _CELL_M, length[nearest], np.inf)

    def _search(self, here: Pose, places_xy_m: Array) -> tuple[Array, Array, NDArray[np.int64]]:
        """Free places (n, 2) around here and others, the path to each (n,), and the one before.

        GaveUp where the robot has left its memory behind.
        """
        if self._last is None:
            self._begin_xy_m = here.xy_m
        reach_m = _HALF_CELLS * _CELL_M
        if np.abs(here.xy_m - self._begin_xy_m).max() >= reach_m:
            raise GaveUp(f"more than {reach_m:g} m from where it began: it remembers no farther")
        low = np.minimum(here.xy_m, places_xy_m.min(axis=0)) - _MARGIN_M
        high = np.maximum(here.xy_m, places_xy_m.max(axis=0)) + _MARGIN_M
        corner, end = (self._cell(p, 2 * _HALF_CELLS) for p in (low, high))
        met = self._met[corner[1] : end[1], corner[0] : end[0]] > self.driven_m - _KEPT_M
        room_m = cv2.distanceTransform((~met).astype(np.uint8), cv2.DIST_L2, 5) * _CELL_M
        room_m = room_m[::_STEP_CELLS, ::_STEP_CELLS]
        rows, columns = room_m.shape
        spacing = _CELL_M * _STEP_CELLS
        origin = self._begin_xy_m + (corner - _HALF_CELLS + 0.5) * _CELL_M
        start = np.round((here.xy_m - origin) / spacing).astype(int)
        start = np.clip(start, 0, (columns - 1, rows - 1))
        y, x = np.mgrid[:rows, :columns]
        free = room_m >= _RADIUS_M
        beside = np.hypot(x - start[0], y - start[1])
        # where it stands it can stand, and out of a nook it can get
        free |= (beside <= 1.5) | ((beside * spacing <= _NOOK_M) & (room_m >= _SQUEEZE_M))
        number = np.where(free, np.cumsum(free).reshape(free.shape) - 1, -1)
        dear = np.where(room_m < _ROOM_M, _TIGHT, 1.0)
        length, before = dijkstra(
            _grid_graph(number, dear, spacing), directed=False,
            indices=number[start[1], start[0]], return_predecessors=True,
        )  # fmt: skip
        return np.stack([x[free], y[free]], axis=1) * spacing + origin, length, before

    def _cells(self, points_m: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        x, y = self._cell(points_m, 2 * _HALF_CELLS - 1).T
        return y, x

    def _cell(self, points_m: Array, last: int) -> NDArray[np.int64]:
        cell = np.floor((points_m - self._begin_xy_m) / _CELL_M) + _HALF_CELLS
        return np.clip(cell, 0, last).astype(np.int64)


def _grid_graph(number: NDArray[np.int64], dear: Array, spacing_m: float) -> csr_array:
    """Neighbours in a grid, straight and across, and the cost of going from one to the other.

    number: (rows, columns) of each node, -1 for none; dear: how much more a metre counts there.
    """
    rows, columns = number.shape
    ends, costs = [], []
    for dy, dx in ((0, 1), (1, 0), (1, 1), (1, -1)):
        a = (slice(0, rows - dy), slice(max(0, -dx), columns - max(0, dx)))
        b = (slice(dy, rows), slice(max(0, dx), columns + min(0, dx)))
        both = (number[a] >= 0) & (number[b] >= 0)
        ends.append(np.stack([number[a][both], number[b][both]]))
        costs.append((spacing_m * np.hypot(dx, dy) * (dear[a] + dear[b]) / 2)[both])
    u, v = np.concatenate(ends, axis=1)
    n = int(number.max()) + 1
    return csr_array((np.concatenate(costs), (u, v)), shape=(n, n))

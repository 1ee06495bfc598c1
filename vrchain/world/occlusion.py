"""What share of the light from a direction gets to a place among the things of a scene.

Things are kept as slabs on a grid of the map: in every cell, from the lowest to the highest of the
surfaces there. Light is swept down through them, layer by layer, on a plane that slides along the
rays (half-angle slicing: Kniss et al., IEEE TVCG 9(2), 2003), for all places at once.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vrchain.world.model import SceneObject, Surface

# Leaves let some light through: how much a metre of them takes away (1/m, Beer and Lambert).
_LEAVES_PER_M = {"tree": 0.55, "bush": 1.2, "hedge": 3.0}
_KINDS = tuple(_LEAVES_PER_M)
_SOLID_PER_M = 400.0
_LEAST_M = 0.05  # a thin lid stops light too
MARGIN_M = 8.0  # of ground around the map
_HIGHEST_M = 100.0  # what is higher throws no shadow
_LONG_M = 128.0  # longer triangles are halved, so that what of them lies off the grid is left out
_BATCH = 1 << 18  # points at a time,
_FACES = 1 << 17  # of so many faces
_ROW = 4096  # OpenCV's pictures have to be narrower than 32768
# On wider maps most cells of a layer are empty. (Not on others: sums in another order would change
# the last bits of scenes that are published.)
_WIDE_M2 = 1e5
_FEW = 0.1  # of a layer's cells


@dataclass(frozen=True, eq=False)
class Obstacles:
    """Slabs that stop light, all or some of it, on a grid whose row 0 lies south, column 0 west.

    cell: (k,) row * width + column of each slab, leaves before what is solid; bottom_m, top_m: (k,)
    float32; per_m: (k,) float32, how much a metre takes away, in 1/m.
    """

    low_m: NDArray[np.float64]  # (x, y) of the grid's corner
    shape: tuple[int, int]
    cell_m: float
    cell: NDArray[np.int32]
    bottom_m: NDArray[np.float32]
    top_m: NDArray[np.float32]
    per_m: NDArray[np.float32]

    def arriving(
        self, direction: NDArray[np.float64], points_m: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Shares in 0..1 of the light from a direction that get to points and to the ground.

        direction: (3,) unit vector towards the light, above the horizon; points_m: (n, 3).
        Returns (n,) and (h, w) float32, the latter a value a cell.
        """
        slide = direction[:2] / direction[2]
        height_m = float(self.top_m.max(initial=0.0))
        # A layer is so thin that light slides less than a cell: a pole's shadow has no gaps.
        layer_m = 0.75 * self.cell_m / max(float(np.hypot(*slide)), 0.6)
        n = max(1, int(np.ceil(height_m / layer_m)))
        # Rays are told apart by where they meet the ground, which may be off the grid.
        h, w = self.shape
        reach = slide * height_m / self.cell_m
        left, below = np.ceil(np.maximum(reach, 0)).astype(int) + 1
        right, above = np.ceil(np.maximum(-reach, 0)).astype(int) + 1
        light = np.ones((h + below + above, w + left + right), dtype=np.float32)
        ground = (points_m[:, :2] - points_m[:, 2:] * slide - self.low_m) / self.cell_m
        place = (ground + np.array([left - 0.5, below - 0.5])).astype(np.float32)
        layer = np.clip(points_m[:, 2] / layer_m, 0, n).astype(np.int64)
        order = np.argsort(layer, kind="stable")
        starts = np.searchsorted(layer[order], np.arange(n + 2))
        shares = np.ones(len(points_m), dtype=np.float32)
        highest_first = np.argsort(-self.top_m, kind="stable")
        depths = -self.top_m[highest_first]
        few = _FEW * h * w if h * w * self.cell_m**2 > _WIDE_M2 else 0.0
        cell_row, cell_column = np.divmod(self.cell, w)
        cell_at = cell_row * light.shape[1] + cell_column
        lost = np.zeros(light.size, dtype=np.float32)
        for k in range(n - 1, -1, -1):
            here = order[starts[k] : starts[k + 1]]
            shares[here] = _sampled(light, place[here])
            low_m, high_m = k * layer_m, (k + 1) * layer_m
            met = highest_first[: np.searchsorted(depths, np.float32(-low_m))]
            met = np.sort(met[self.bottom_m[met] < high_m])
            if not len(met):
                continue
            inside_m = np.minimum(self.top_m[met], high_m) - np.maximum(self.bottom_m[met], low_m)
            taken = np.exp(inside_m * self.per_m[met] / np.float32(-direction[2]))
            shift = (left, below) - slide * (low_m + high_m) / 2 / self.cell_m
            column, row = np.floor(shift).astype(int)
            part = shift - (column, row)
            if len(met) < few:
                _dim(light, lost, cell_at[met] + (row * light.shape[1] + column), taken, part)
                continue
            through = np.ones(self.shape, dtype=np.float32)
            through.reshape(-1)[self.cell[met]] = taken
            light[row : row + h + 1, column : column + w + 1] *= _shifted(through, *part)
        return shares, light[below : below + h, left : left + w].copy()

    def coarser(self) -> "Obstacles":
        """The same on cells twice as wide."""
        h, w = (-(-n // 2) for n in self.shape)
        row, column = np.divmod(self.cell, self.shape[1])
        cell, found = row // 2 * w + column // 2, []
        for per_m in np.unique(self.per_m):  # leaves take less, so come first
            own = self.per_m == per_m
            bottom = np.full(h * w, np.inf, dtype=np.float32)
            top = np.full_like(bottom, -np.inf)
            np.minimum.at(bottom, cell[own], self.bottom_m[own])
            np.maximum.at(top, cell[own], self.top_m[own])
            found.append(_slabs(bottom, top, per_m))
        return _joined(self.low_m, (h, w), 2 * self.cell_m, found)


def _dim(
    light: NDArray[np.float32],
    lost: NDArray[np.float32],
    at: NDArray[np.int64],
    taken: NDArray[np.float32],
    part: NDArray[np.float64],
) -> None:
    """Multiply light by what gets through a few cells of a layer, as by ``_shifted`` in all.

    at: where in the flat light; lost: as large, of zeros, as it is left; part: (x, y) of a cell.
    """
    weights = 1 - _shifted(np.zeros((1, 1), dtype=np.float32), *part)
    steps = [(i * light.shape[1] + j, weights[i, j]) for i in (0, 1) for j in (0, 1)]
    lost[at] = 1 - taken
    reached = np.concatenate([at + step for step, _ in steps])  # some twice, by the same
    light.reshape(-1)[reached] *= 1 - sum(weight * lost[reached - step] for step, weight in steps)
    lost[at] = 0


def _shifted(grid: NDArray[np.float32], x: float, y: float) -> NDArray[np.float32]:
    """A grid moved by parts of a cell, 0..1, among ones: one row and one column larger."""
    h, w = grid.shape
    matrix = np.array([[1.0, 0.0, x], [0.0, 1.0, y]])
    size = (w + 1, h + 1)
    moved = cv2.warpAffine(grid, matrix, size, borderMode=cv2.BORDER_CONSTANT, borderValue=1.0)
    return np.asarray(moved, dtype=np.float32)


def _sampled(grid: NDArray[np.float32], place: NDArray[np.float32]) -> NDArray[np.float32]:
    """Values at places (n, 2) of (column, row), running evenly between cells: (n,)."""
    n = len(place)
    padded = np.zeros((-(-n // _ROW) * _ROW, 2), dtype=np.float32)
    padded[:n] = place
    if not n:
        return padded[:, 0]
    x, y = (np.ascontiguousarray(padded[:, i].reshape(-1, _ROW)) for i in (0, 1))
    values = cv2.remap(
        grid, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=1.0
    )
    return np.asarray(values, dtype=np.float32).ravel()[:n]


def obstacles(
    objects: Iterable[SceneObject], extent_m: tuple[float, float], cell_m: float
) -> Obstacles:
    """Standing things on a grid of cells ``cell_m`` wide over the map and a little more."""
    half = np.array(extent_m) / 2 + MARGIN_M
    h, w = round(2 * half[1] / cell_m), round(2 * half[0] / cell_m)
    things = [(_KINDS.index(o.kind) if o.kind in _KINDS else len(_KINDS), o) for o in objects]
    per_m = np.array([*_LEAVES_PER_M.values(), _SOLID_PER_M], dtype=np.float32)
    found = []
    for kind in sorted({kind for kind, _ in things}):
        bottom = np.full(h * w, np.inf, dtype=np.float32)
        top = np.full_like(bottom, -np.inf)
        for some in _batches([s for k, o in things if k == kind for s in o.surfaces]):
            triangles = _near(np.concatenate([s.vertices_m[s.faces] for s in some]), half)
            for points in _strewn(triangles, 0.8 * cell_m):
                column, row = np.moveaxis(
                    np.floor((points[..., :2] + half) / cell_m).astype(np.int64), -1, 0
                )
                cell = np.clip(row, 0, h - 1) * w + np.clip(column, 0, w - 1)
                np.minimum.at(bottom, cell.ravel(), points[..., 2].ravel())
                np.maximum.at(top, cell.ravel(), points[..., 2].ravel())
        bottom[bottom >= _HIGHEST_M] = np.inf
        np.minimum(top, np.float32(_HIGHEST_M), out=top)
        found.append(_slabs(bottom, top, per_m[kind]))
    slabs = _joined(-half, (h, w), cell_m, found)
    least_m = slabs.top_m - np.float32(_LEAST_M)
    return replace(slabs, bottom_m=np.minimum(slabs.bottom_m, least_m))


def _slabs(
    bottom: NDArray[np.float32], top: NDArray[np.float32], per_m: np.float32
) -> tuple[NDArray, ...]:
    """Of all cells those in which something of a kind stands: from where to where, (h * w,)."""
    filled = np.flatnonzero(np.isfinite(bottom))
    same = np.full(len(filled), per_m, dtype=np.float32)
    return filled.astype(np.int32), bottom[filled], top[filled], same


def _joined(
    low_m: NDArray[np.float64],
    shape: tuple[int, int],
    cell_m: float,
    slabs: Iterable[tuple[NDArray, ...]],
) -> Obstacles:
    """The slabs of all kinds, on one grid."""
    none = [np.empty(0, dtype=dtype) for dtype in (np.int32, *[np.float32] * 3)]
    columns = zip(none, *slabs, strict=True)
    return Obstacles(low_m, shape, cell_m, *(np.concatenate(column) for column in columns))


def _batches(surfaces: Iterable[Surface]) -> Iterator[list[Surface]]:
    """Surfaces, some at a time: all their triangles at once would fill the memory."""
    some, n = list[Surface](), 0
    for surface in surfaces:
        some.append(surface)
        n += len(surface.faces)
        if n >= _FACES:
            yield some
            some, n = [], 0
    if some:
        yield some


def is_over(triangles: NDArray[np.floating], half: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Which triangles (m, 3, 3) may lie over the ground within ``half`` (x, y) of the origin."""
    low, high = triangles[..., :2].min(axis=1), triangles[..., :2].max(axis=1)
    return np.asarray(((low <= half) & (high >= -half)).all(axis=1))


def _near(triangles: NDArray[np.float32], half: NDArray[np.float64]) -> NDArray[np.float32]:
    """Triangles (m, 3, 3), without what lies off the grid."""
    near = [triangles[:0]]
    while len(triangles):
        triangles = triangles[is_over(triangles, half)]
        side = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
        is_long = side.max(axis=1, initial=0) > _LONG_M
        near.append(triangles[~is_long])
        turn = (side[is_long].argmax(axis=1)[:, None] + np.arange(3)) % 3
        a, b, c = np.moveaxis(np.take_along_axis(triangles[is_long], turn[..., None], axis=1), 1, 0)
        middle = (a + b) / 2
        halves = [np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)]
        triangles = np.concatenate(halves)
    return np.concatenate(near)


def _strewn(triangles: NDArray[np.floating], step_m: float) -> Iterator[NDArray[np.float32]]:
    """Points on triangles (m, 3, 3), so dense that they skip no square of ``step_m``.

    Yields (k, t, 3) points, k on each of t alike triangles, in batches.
    """
    side = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
    turn = (side.argmax(axis=1)[:, None] + np.arange(3)) % 3  # the longest side comes first
    corners = np.take_along_axis(triangles, turn[..., None], axis=1).astype(np.float32)
    a, along, across = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    longest = np.maximum(side.max(axis=1), 1e-6)
    height = np.maximum(np.linalg.norm(np.cross(along, across), axis=1) / longest, 1e-6)
    steps = np.ceil(np.column_stack([longest, height]) / step_m).astype(np.int64)
    steps = np.where(steps > 4, -(-steps // 4) * 4, steps)  # a little denser, in fewer batches
    batch = steps[:, 0] * (steps[:, 1].max(initial=0) + 1) + steps[:, 1]
    order = np.argsort(batch, kind="stable")
    for of in np.split(order, np.flatnonzero(np.diff(batch[order])) + 1):
        if not len(of):
            continue
        n, m = steps[of[0]] + 1
        u, v = np.meshgrid(np.linspace(0, 1, n, dtype=np.float32), np.linspace(0, 1, m))
        share = np.stack([u * (1 - v), v], axis=-1).reshape(-1, 2, 1, 1).astype(np.float32)
        for some in np.array_split(of, -(-len(of) * len(share) // _BATCH)):
            yield a[some] + share[:, 0] * along[some] + share[:, 1] * across[some]

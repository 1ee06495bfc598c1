"""Long walls, fences and hedges in runs, each a thing of its own: a house's walls are one model."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely
from numpy.typing import NDArray

from vrchain.world.model import SceneObject, Surface, size_of

Matrix = NDArray[np.float64]

RUN_M = 8.0  # at most, along either axis of its model
_KINDS = ("fence", "wall", "hedge")
_SKIN_M = 0.05  # around a run, where what it stops a robot with may lie
_FLAT_M = 1e-6  # what reaches no farther beyond a plane is not cut


def is_long(thing: SceneObject) -> bool:
    """Whether it is such a thing, too long to tell a place."""
    return thing.kind in _KINDS and thing.width_m > RUN_M


def runs_of(thing: SceneObject, surfaces: Sequence[Surface], matrix: Matrix) -> list[SceneObject]:
    """A placed thing, cut at upright planes into pieces of at most 8 m each way, named in order.

    surfaces: its own, in the frame of its model; matrix: (4, 4), from there to the world. What
    stands in a robot's way is as before.
    """
    points = np.concatenate([s.vertices_m[s.faces.ravel()] for s in surfaces])[:, :2].astype(float)
    low, size_m = points.min(axis=0), np.ptp(points, axis=0)
    n = np.maximum(np.ceil(size_m / RUN_M - 1e-6), 1)
    step_m = np.maximum(size_m / n, _FLAT_M)
    cells: dict[tuple[int, int], list[Surface]] = {}
    for surface in surfaces:
        corners = np.hstack([surface.vertices_m, surface.uv, surface.shade_rgb]).astype(float)
        soup = corners[surface.faces]
        for axis in (0, 1):
            for k in range(1, int(n[axis])):
                soup = _cut(soup, axis, low[axis] + k * step_m[axis])
        cell = (soup[:, :, :2].mean(axis=1) - low) // step_m
        cell = np.clip(cell, 0, n - 1).astype(int)
        for x, y in np.unique(cell, axis=0).tolist():
            own = soup[(cell == (x, y)).all(axis=1)]
            cells.setdefault((x, y), []).append(_surface(own, surface.texture))
    found = []
    for k, (_, pieces) in enumerate(sorted(cells.items())):
        size = size_of(np.concatenate([s.vertices_m for s in pieces]))
        name, model = (f"{whole}::run_{k}" for whole in (thing.name, thing.model))
        placed = tuple(_placed(s, matrix) for s in pieces)
        found.append(replace(thing, name=name, model=model, size_m=size, surfaces=placed))
    return _with_outlines(found, thing.footprint)


def _with_outlines(runs: list[SceneObject], footprint: shapely.Geometry) -> list[SceneObject]:
    """Each with what of the whole's footprint lies where it is; the first with what is left."""
    shares = []
    for run in runs:
        around = shapely.MultiPoint(np.concatenate([s.vertices_m[:, :2] for s in run.surfaces]))
        here = around.convex_hull.buffer(_SKIN_M)
        shares.append(footprint & here)
        footprint = footprint - here
    shares[0] = shares[0] | footprint
    return [replace(run, outline=share) for run, share in zip(runs, shares, strict=True)]


def _cut(soup: NDArray[np.float64], axis: int, at_m: float) -> NDArray[np.float64]:
    """Triangles (n, 3, d), whose first numbers are places: those that reach over a plane, cut."""
    off = soup[:, :, axis] - at_m
    over = (off.min(axis=1) < -_FLAT_M) & (off.max(axis=1) > _FLAT_M)
    above = off[over] > 0
    # the corner that is alone on its side comes first
    lone = (above == (above.sum(axis=1) == 1)[:, None]).argmax(axis=1)
    turned = (lone[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(soup[over], turned[..., None], axis=1).transpose(1, 0, 2)

    def crossing(end: NDArray[np.float64]) -> NDArray[np.float64]:
        share = (at_m - a[:, axis]) / (end[:, axis] - a[:, axis])
        return np.asarray(a + share[:, None] * (end - a))

    p, q = crossing(b), crossing(c)
    pieces = [np.stack(corners, axis=1) for corners in ((a, p, q), (p, b, c), (p, c, q))]
    return np.concatenate([soup[~over], *pieces])


def _surface(soup: NDArray[np.float64], texture: NDArray[np.uint8]) -> Surface:
    flat = soup.reshape(-1, soup.shape[2]).astype(np.float32)
    faces = np.arange(len(flat), dtype=np.int32).reshape(-1, 3)
    return Surface(flat[:, :3], faces, flat[:, 3:5], flat[:, 5:], texture)


def _placed(surface: Surface, matrix: Matrix) -> Surface:
    points = surface.vertices_m.astype(float) @ matrix[:3, :3].T + matrix[:3, 3]
    return replace(surface, vertices_m=points.astype(np.float32))

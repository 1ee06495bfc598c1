"""Sun and sky baked into shades, with soft shadows and the dimness of nooks (ambient occlusion).

Vertices carry the light of standing things, whose large faces are cut finer for it; a light map
carries the light of the flat ground.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from vrchain.world.atlas import Joined, join
from vrchain.world.model import LightMap, SceneObject, Surface
from vrchain.world.occlusion import MARGIN_M, Obstacles, is_over, obstacles
from vrchain.world.spec import LightSpec

_BATCH = 1 << 17  # triangles at a time
_SUN_CELL_M, _SKY_CELL_M = 0.25, 0.5
_SUN_RADIUS_RAD, _SUN_RAYS = np.radians(1.2), 3  # wider than the true sun: shadows are softer
_SKY = ((20.0, 8, 0.57), (52.0, 6, 0.39), (90.0, 1, 0.04))  # elevation, directions, solid angle
_BOUNCE = 0.42  # of the sky's light, what gets even to where no sky is seen
_ROOFED = 0.1  # of the sky's light, more than which gets to places in the open
_LEAF_FACING = 0.7
_FINE_M, _FINE_M2 = 2.2, 0.7  # faces with a longer edge and more area are cut
_MOST_FACES = 2_000_000  # from which on none is cut
_UNCUT = ("tree", "bush")  # fine as they are

# Colours of sun and sky by the time of day, as factors on what they fall on.
_COLOURS = {
    "noon": ((1.27, 1.2, 1.06), (1.06, 1.09, 1.14)),
    "evening": ((2.1, 1.12, 0.5), (0.98, 0.94, 1.03)),
    "overcast": ((0.94, 0.96, 0.98), (0.94, 0.97, 1.0)),
}


@dataclass(frozen=True, eq=False)
class Light:
    """A sun far away and an even sky. direction: (3,) unit vector towards the sun.

    least: the brightness of faces that the sky's light does not reach, for a world that has one.
    """

    time: str
    direction: NDArray[np.float64]
    ambient: float
    sun_rgb: NDArray[np.float64]
    sky_rgb: NDArray[np.float64]
    least: float = 0.0

    @property
    def veiled(self) -> bool:
        """Whether clouds spread the sun's light: then it throws no shadow."""
        return self.time == "overcast"

    def on(self, normals: NDArray[np.float64]) -> NDArray[np.float32]:
        """Colour, (n, 3) in 0..1, of the light on faces in the open with unit normals (n, 3)."""
        return self.towards(np.clip(normals @ self.direction, 0, 1), normals[:, 2], 1.0, 1.0)

    def towards(
        self, facing: ArrayLike, up: ArrayLike, sun: ArrayLike, sky: ArrayLike
    ) -> NDArray[np.float32]:
        """Colour, (..., 3) in 0..1, of the light on faces.

        facing, up: the cosines that their normals make with the sun and with the zenith; sun, sky:
        what shares of them get there; a number or (n,) each.
        """
        open_ = np.asarray(sky) if self.veiled else np.asarray(sun)
        from_sun = (1 - self.ambient) * np.asarray(facing) * open_
        from_sky = self.ambient * (0.92 + 0.08 * np.asarray(up))
        from_sky = from_sky * (_BOUNCE + (1 - _BOUNCE) * np.asarray(sky))
        colour = from_sun[..., None] * self.sun_rgb + from_sky[..., None] * self.sky_rgb
        if self.least:
            roofed = np.clip(2 - np.asarray(sky) / _ROOFED, 0, 1)
            colour = np.maximum(colour, self.least * roofed[..., None])
        return np.clip(colour, 0, 1).astype(np.float32)


def sunlight(spec: LightSpec) -> Light:
    """The light of a spec."""
    sun_rgb, sky_rgb = (np.array(colour) for colour in _COLOURS[spec.time])
    towards = _direction(np.radians(spec.sun_azimuth_deg), np.radians(spec.sun_elevation_deg))
    return Light(spec.time, towards, spec.ambient, sun_rgb, sky_rgb)


def _direction(azimuth_rad: float, elevation_rad: float) -> NDArray[np.float64]:
    level = np.cos(elevation_rad)
    return np.array(
        [level * np.cos(azimuth_rad), level * np.sin(azimuth_rad), np.sin(elevation_rad)]
    )


def lit(obj: SceneObject, light: Light) -> SceneObject:
    """The object alone in the open. Faces that share vertices shade smoothly."""

    def shaded(surface: Surface) -> Surface:
        falling = light.on(vertex_normals(surface.vertices_m, surface.faces))
        return replace(surface, shade=surface.shade_rgb * falling)

    return replace(obj, surfaces=tuple(shaded(s) for s in obj.surfaces))


def bake(
    objects: Iterable[SceneObject], light: Light, extent_m: tuple[float, float]
) -> tuple[list[SceneObject], LightMap]:
    """Standing things in the light and in each other's shadows, and the light on the ground.

    Their large faces come back cut finer, the same whatever the light.
    """
    things = list(objects)
    blockers = obstacles(things, extent_m, _SUN_CELL_M)
    half = np.array(extent_m) / 2 + MARGIN_M
    surfaces = [s for thing in things for s in thing.surfaces]
    uncut = [thing.kind in _UNCUT for thing in things for _ in thing.surfaces]
    mesh, normals = _cut(join(surfaces), uncut, half)
    # A leaf is lit from whichever side light comes: what stands before it counts alone.
    leaf = np.array([s.cut_out for s in surfaces], dtype=bool)[mesh.owner]
    normals[leaf] = 0.0
    sun, sun_on_ground = _sun(blockers, light, mesh.vertices_m, normals)
    blockers = blockers.coarser()
    sky, sky_on_ground = _sky(blockers, mesh.vertices_m, normals)
    facing = np.where(leaf, _LEAF_FACING, np.clip(normals @ light.direction, 0, 1))
    shade = mesh.shade * light.towards(facing, normals[:, 2], sun, sky)
    parts = iter(_parted(replace(mesh, shade=shade), surfaces))
    baked = [replace(t, surfaces=tuple(next(parts) for _ in t.surfaces)) for t in things]
    size = sun_on_ground.shape[::-1]
    wide_sky = np.asarray(cv2.resize(sky_on_ground, size, interpolation=cv2.INTER_LINEAR))
    # a row at a time: on a wide map all at once would fill the memory
    rows = zip(sun_on_ground[::-1], wide_sky[::-1], strict=True)
    ground = [light.towards(light.direction[2], 1.0, *row) for row in rows]
    image = np.stack([np.round(255 * row).astype(np.uint8) for row in ground])
    return baked, LightMap(image, -half, half)


def _sun(
    things: Obstacles, light: Light, points: NDArray[np.float32], normals: NDArray[np.float64]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Shares of the sun's disc that points (n, 3) see, (n,), and the ground's cells, (h, w)."""
    if light.veiled:
        return np.ones(len(points), np.float32), np.ones(things.shape, np.float32)
    x, y, z = light.direction
    azimuth, elevation = np.arctan2(y, x), np.arcsin(z)
    start = _before(points, normals, _SUN_CELL_M)
    total, ground = np.zeros(len(points), np.float32), np.zeros(things.shape, np.float32)
    for turn in 2 * np.pi * (np.arange(_SUN_RAYS) + 0.5) / _SUN_RAYS:
        towards = _direction(
            azimuth + _SUN_RADIUS_RAD * np.cos(turn) / np.cos(elevation),
            elevation + _SUN_RADIUS_RAD * np.sin(turn),
        )
        share, on_ground = things.arriving(towards, start)
        total += share
        ground += on_ground
    return total / np.float32(_SUN_RAYS), ground / np.float32(_SUN_RAYS)


def _sky(
    things: Obstacles, points: NDArray[np.float32], normals: NDArray[np.float64]
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Shares of the light of the sky before them that get to points, (n,), and to the ground."""
    start = _before(points, normals, _SKY_CELL_M)
    is_leaf = ~normals.any(axis=1)
    total, most = np.zeros(len(points)), np.zeros(len(points))
    ground, ground_most = np.zeros(things.shape), 0.0
    for elevation_deg, n, weight in _SKY:
        for k in range(n):
            towards = _direction(2 * np.pi * (k + 0.5) / n, np.radians(elevation_deg))
            share, on_ground = things.arriving(towards, start)
            facing = weight / n * np.where(is_leaf, 1.0, np.maximum(normals @ towards, 0.05))
            total += facing * share
            most += facing
            ground += weight / n * towards[2] * on_ground
            ground_most += weight / n * towards[2]
    return (total / most).astype(np.float32), (ground / ground_most).astype(np.float32)


def _before(
    points: NDArray[np.float32], normals: NDArray[np.float64], cell_m: float
) -> NDArray[np.float32]:
    """Points so far before their faces that these do not shade them."""
    moved = points + 1.4 * cell_m * normals
    return np.maximum(moved, (-np.inf, -np.inf, 0.02)).astype(np.float32)


def _cut(
    mesh: Joined, uncut: Sequence[bool], half: NDArray[np.float64]
) -> tuple[Joined, NDArray[np.float64]]:
    """The mesh with large triangles halved across their longest edges until none is large.

    uncut: which surfaces stay as they are. half: (x, y), what lies farther from the origin is not
    cut. Nor is any more once there are ``_MOST_FACES``. Returns the unit normals, (n, 3), as well.
    """
    n, owner = len(mesh.owner), mesh.owner
    normals = vertex_normals(mesh.vertices_m, mesh.faces)
    columns = [np.asarray(c, dtype=float) for c in (mesh.vertices_m, mesh.uv, mesh.shade, normals)]
    faces = mesh.faces.astype(np.int64)
    fresh = np.flatnonzero(~np.array(uncut, dtype=bool)[mesh.owner[faces[:, 0]]])
    while len(fresh) and len(faces) < _MOST_FACES:
        batches = np.split(fresh, range(_BATCH, len(fresh), _BATCH))
        found = [_large(columns[0][faces[some]], half) for some in batches]
        large = np.concatenate([some[k] for some, (k, _) in zip(batches, found, strict=True)])
        turn = (np.concatenate([longest for _, longest in found])[:, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(faces[large], turn, axis=1).T
        edges, edge = np.unique(np.sort([a, b], axis=0), axis=1, return_inverse=True)
        middle = edge.ravel() + len(owner)
        owner = np.append(owner, owner[edges[0]])
        for i, column in enumerate(columns):
            columns[i] = np.concatenate([column, column[edges].mean(axis=0)])
        faces[large] = np.column_stack([a, middle, c])
        fresh = np.concatenate([large, len(faces) + np.arange(len(large))])
        faces = np.concatenate([faces, np.column_stack([middle, b, c])])
    normals = columns.pop()
    normals[n:] /= np.maximum(np.linalg.norm(normals[n:], axis=1, keepdims=True), 1e-12)
    vertices, uv, shade = (column.astype(np.float32) for column in columns)
    return Joined(vertices, faces.astype(np.int32), uv, shade, mesh.texture, owner), normals


def _large(
    points: NDArray[np.float64], half: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Which triangles (m, 3, 3) are to be halved, and the longest side of each of those."""
    side = np.roll(points, -1, axis=1) - points
    length = np.linalg.norm(side, axis=2)
    area = np.linalg.norm(np.cross(side[:, 0], side[:, 1]), axis=1) / 2
    is_large = is_over(points, half) & (length.max(axis=1) > _FINE_M) & (area > _FINE_M2)
    return np.flatnonzero(is_large), length[is_large].argmax(axis=1)


def _parted(mesh: Joined, surfaces: Sequence[Surface]) -> Iterator[Surface]:
    """The surfaces of a mesh, with the textures of those that it was joined of."""
    order = np.argsort(mesh.owner, kind="stable")
    place = np.argsort(order, kind="stable")
    starts = np.searchsorted(mesh.owner[order], np.arange(len(surfaces) + 1))
    faces_owner = mesh.owner[mesh.faces[:, 0]]
    faces = place[mesh.faces[np.argsort(faces_owner, kind="stable")]]
    faces_starts = np.searchsorted(np.sort(faces_owner), np.arange(len(surfaces) + 1))
    for k, surface in enumerate(surfaces):
        here = order[starts[k] : starts[k + 1]]
        own = (faces[faces_starts[k] : faces_starts[k + 1]] - starts[k]).astype(np.int32)
        yield Surface(mesh.vertices_m[here], own, mesh.uv[here], mesh.shade[here], surface.texture)


def vertex_normals(
    vertices_m: NDArray[np.float32], faces: NDArray[np.integer]
) -> NDArray[np.float64]:
    """Unit normals of vertices, (n, 3): the mean of their faces' by area."""
    total = np.zeros((len(vertices_m), 3))
    for some in np.split(faces, range(_BATCH, len(faces), _BATCH)):
        a, b, c = np.moveaxis(vertices_m[some].astype(float), 1, 0)
        normal = np.cross(b - a, c - a)
        for axis in range(3):
            np.add.at(total[:, axis], some.ravel(), np.repeat(normal[:, axis], 3))
    return total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12)

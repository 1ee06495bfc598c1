"""The ground, cut into polygons that do not overlap: grass, road, pavement, marking, driveway."""

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
import shapely
from numpy.random import Generator
from numpy.typing import NDArray

from vrchain.geometry import Pose
from vrchain.world import seasons, textures
from vrchain.world.model import SceneObject, Surface, place
from vrchain.world.shapes import Image
from vrchain.world.suburb.layout import Layout
from vrchain.world.suburb.streets import BEYOND_M, KERB_M, TURNING_M, Street, Streets

Piece = tuple[str, str, shapely.Geometry, Image, float]  # name, kind, region, texture, tile in m


def build_ground(
    layout: Layout, extent_m: tuple[float, float], season: str, rng: Generator
) -> Iterator[SceneObject]:
    """Ground objects, on z = 0; none is solid or a landmark."""
    streets, homes = layout.streets, layout.homesteads
    everything = around(extent_m)
    marking = shapely.union_all(list(_markings(streets))).intersection(streets.road)
    outside = everything.difference(streets.corridor)
    pavement = streets.corridor.difference(streets.road.buffer(KERB_M))
    yards = {k: [p.yard for p in layout.premises if p.kind == k] for k in ("barn", "shop")}
    drives = shapely.union_all([*(h.driveway for h in homes), *yards["barn"]])
    drives = drives.intersection(outside)
    courts = shapely.union_all(yards["shop"]).intersection(outside).difference(drives)
    paths = shapely.union_all([h.path for h in homes]).intersection(outside)
    paths = paths.difference(shapely.union_all([drives, courts]))
    paved = shapely.union_all([drives, courts, paths])
    lawns = _lawns(layout, outside.difference(paved))
    rest = outside.difference(shapely.union_all([*lawns, paved]))

    def grass(hue: float, value: float, contrast: float = 0.1) -> Image:
        colour = textures.hsv(hue + rng.uniform(-4, 4), rng.uniform(0.42, 0.55), value)
        return textures.ground(rng, seasons.grass(colour, season), contrast, 4)

    def slabs(hue: float, saturation: float, value: float, *px: int) -> Image:
        return textures.paving(rng, textures.hsv(hue, saturation, value), *px)

    mineral = partial(textures.ground, rng)
    asphalt = mineral(textures.random_hsv(rng, 220, 0.04, (0.36, 0.46)), 0.075, 2)
    pieces = [
        ("road", "road", streets.road.difference(marking), asphalt, 7.0),
        ("marking", "marking", marking, mineral((232, 230, 222), 0.06, 3, 128), 3.0),
        ("kerb", "kerb", streets.kerb, mineral((178, 175, 168), 0.09, 3, 128), 2.0),
        ("pavement", "pavement", pavement, slabs(35, 0.08, 0.68, 32), 8.0),
        ("driveways", "driveway", drives, mineral((176, 170, 160), 0.08, 4, 256), 4.0),
        ("paths", "path", paths, slabs(25, 0.22, 0.7, 24, 256), 4.0),
        ("forecourts", "path", courts, slabs(28, 0.14, 0.6, 40), 5.0),
        ("lawn_1", "grass", lawns[0], grass(84, 0.56), 7.0),
        ("lawn_2", "grass", lawns[1], grass(92, 0.5), 6.0),
        ("lawn_3", "grass", lawns[2], grass(76, 0.6), 8.0),
        ("grass", "grass", rest, grass(80, 0.52, 0.12), 9.0),
    ]
    return lay(pieces, everything)


def around(extent_m: tuple[float, float]) -> shapely.Polygon:
    """All ground of a map of that size, which goes on beyond it."""
    half = np.array(extent_m) / 2 + BEYOND_M
    return shapely.box(*-half, *half)


def lay(pieces: Sequence[Piece], everything: shapely.Geometry) -> Iterator[SceneObject]:
    """Ground objects of pieces that do not overlap, cut to ``everything``."""
    for name, kind, region, texture, tile_m in pieces:
        ground = region.intersection(everything)
        if ground.is_empty:
            continue
        surface = _flat(ground, texture, tile_m)
        yield place(name, kind, name, [surface], Pose(0.0, 0.0), landmark=False, solid=False)


def _lawns(layout: Layout, open_ground: shapely.Geometry) -> list[shapely.Geometry]:
    """The lots' grass in three groups, so that neighbours' lawns differ."""
    groups: list[list[shapely.Geometry]] = [[], [], []]
    taken = shapely.Polygon()
    for i, lot in enumerate(layout.lots):
        groups[i % 3].append(lot.polygon.intersection(open_ground).difference(taken))
        taken = taken.union(lot.polygon)
    return [shapely.union_all(group) for group in groups]


def _flat(region: shapely.Geometry, texture: Image, tile_m: float) -> Surface:
    """A region in full light: what falls on it is the light map's part."""
    corners = _triangles(region)
    xy = corners.reshape(-1, 2)
    return Surface(
        np.column_stack([xy, np.zeros(len(xy))]).astype(np.float32),
        np.arange(len(xy), dtype=np.int32).reshape(-1, 3),
        (xy / tile_m).astype(np.float32),
        np.ones(len(xy), dtype=np.float32),
        texture,
    )


def _triangles(region: shapely.Geometry) -> NDArray[np.float64]:
    """A region cut into triangles, anticlockwise: (n, 3, 2)."""
    polygons = [p for p in shapely.get_parts(region) if p.geom_type == "Polygon" and p.area > 1e-6]
    cut = shapely.get_parts(
        shapely.constrained_delaunay_triangles(np.array(polygons, dtype=object))
    )
    if not len(cut):
        return np.empty((0, 3, 2))
    corners = shapely.get_coordinates(cut).reshape(-1, 4, 2)[:, :3]
    a, b = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    area = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    corners = np.where(area[:, None, None] < 0, corners[:, ::-1], corners)
    return corners[np.abs(area) > 1e-9]


def _markings(streets: Streets) -> Iterator[shapely.Geometry]:
    """Centre dashes, zebra crossings and stop lines at junctions."""
    half = streets.width_m / 2
    for street in streets.lines:
        crossings, clear = np.array(streets.met_m(street)), streets.half_m + 4.5
        last = street.line.length - (streets.half_m + TURNING_M if street.head else 3.0)
        for along in np.arange(1.0, last, 5.0):
            if (np.abs(along + 1.2 - crossings) > clear + 1.2).all():
                yield _strip(street, along, along + 2.4, 0.0, 0.07)
        for c, sign in streets.arms(street):
            near = c + sign * (streets.half_m + 0.5)
            far = near + sign * 2.4
            for aside in np.arange(-half + 0.5, half - 0.3, 0.95):
                yield _strip(street, min(near, far), max(near, far), float(aside), 0.22)
            stop = far + sign * 0.6
            # Traffic keeps right: before a junction the line lies across the right-hand lane.
            yield _strip(street, stop - 0.15, stop + 0.15, sign * half / 2, half / 2 - 0.25)


def _strip(
    street: Street, start_m: float, end_m: float, aside_m: float, half_m: float
) -> shapely.Polygon:
    places = (start_m, -1), (end_m, -1), (end_m, 1), (start_m, 1)
    return shapely.Polygon([street.at(m, aside_m + k * half_m).xy_m for m, k in places])

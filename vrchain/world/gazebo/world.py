"""A Gazebo world as a ``Scene``: every placed model one object, lit as our own suburbs are."""

import warnings
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely
from numpy.typing import NDArray

from vrchain import seeding
from vrchain.errors import SpecError, UnsupportedWarning
from vrchain.paths import scene_file
from vrchain.world import backdrop, light
from vrchain.world.backdrop import outdoors
from vrchain.world.gazebo import ground
from vrchain.world.gazebo.designs import Design, Designs, unique
from vrchain.world.gazebo.files import is_file, model_folders
from vrchain.world.gazebo.limits import FARTHEST_M, MAP_M, MOST_M2, MOST_MODELS, MOST_TRIANGLES
from vrchain.world.gazebo.materials import Materials
from vrchain.world.gazebo.meshes import moved
from vrchain.world.gazebo.notes import Notes
from vrchain.world.gazebo.sdf import Placed, World, flat, read_world
from vrchain.world.gazebo.xml import Element
from vrchain.world.model import LightMap, Scene, SceneObject, Surface, ground_polygon
from vrchain.world.spec import LightSpec, parse_spec

SUFFIXES = (".world", ".sdf")

_Matrix = NDArray[np.float64]
_Thing = tuple[Placed, Design]
_BEYOND_M = 20.0  # of ground around what stands on it
_RIM_M = 2.0  # of map around what stands on it
_THIN_M = 0.25  # thinner faces take as much time
_SUN_ELEVATION_DEG = (10.0, 85.0)


def load_world(path: str | Path) -> Scene:
    """The scene of a ``.world`` or ``.sdf`` file, whose models lie in ``model_folders``.

    What is not supported is told by one UnsupportedWarning. Raises SpecError, with the file and
    the line or element, on anything amiss.
    """
    path = scene_file(path)
    if not is_file(path):
        what = "is a folder" if path.is_dir() else "is not there"
        raise SpecError(f"{path} {what}: give a world file ({' or '.join(SUFFIXES)})")
    notes = Notes()
    folders = model_folders(path)
    world = read_world(path, folders, notes)
    things = [thing for placed in world.models for thing in flat(placed, np.eye(4))]
    designs = Designs(Materials(folders, notes), notes, ground.visual_of(things))
    placed = [(t, design) for t in things if (design := designs.of(t.model)) is not None]
    if not placed:
        why = f": not supported: {notes}" if notes else ""
        raise SpecError(f"{path}: nothing in this world can be drawn{why}")
    _check_count(path, placed)
    if world.ours is not None:
        scene = _own_scene(world.name, placed, world.ours, notes)
    else:
        scene = _scene(path, world, placed, designs, notes)
    if notes:
        warnings.warn(f"{path}: not supported or simplified: {notes}", UnsupportedWarning, 3)
    return scene


def _check_count(path: Path, placed: Sequence[_Thing]) -> None:
    triangles = sum(len(s.faces) for _, design in placed for s in design.surfaces)
    if len(placed) > MOST_MODELS or triangles > MOST_TRIANGLES:
        raise SpecError(
            f"{path}: expected at most {MOST_MODELS} models and {MOST_TRIANGLES} triangles, got "
            f"{len(placed)} and {triangles}"
        )


def _light(sun: _Matrix | None) -> LightSpec:
    """The sun where the world has it, within what ``LightSpec`` allows."""
    if sun is None:
        return LightSpec()
    towards = -sun
    azimuth_deg = float(np.degrees(np.arctan2(towards[1], towards[0])) % 360)
    elevation_deg = float(np.degrees(np.arcsin(np.clip(towards[2], -1, 1))))
    return LightSpec(
        sun_azimuth_deg=azimuth_deg,
        sun_elevation_deg=float(np.clip(elevation_deg, *_SUN_ELEVATION_DEG)),
    )


def _scene(
    path: Path, world: World, placed: Sequence[_Thing], designs: Designs, notes: Notes
) -> Scene:
    """The ground, then what lies, then what stands, each in the world's order, and their light."""
    names = _names(placed)
    floor, floor_m = _floor(placed)
    objects: dict[int, SceneObject] = {}
    bounds = []
    for i, (thing, design) in enumerate(placed):
        if design.surfaces:
            objects[i] = _object(names[i], thing, design)
            if not design.wide:
                bounds.append(objects[i].bounds_m[:, :2])
    low, high = _bounds(bounds, placed)
    half = np.minimum(np.ceil(2 * (np.abs([low, high]).max(axis=0) + _RIM_M)), MAP_M) / 2
    _check_map(path, bounds, half, (low, high))
    if np.abs([low, high]).max() > MAP_M / 2 - _RIM_M:
        notes.add(f"parts beyond the map of {MAP_M:g} x {MAP_M:g} m, where no robot drives")
    corners = np.minimum(low, -half) - _BEYOND_M, np.maximum(high, half) + _BEYOND_M
    grounds = {
        i: designs.ground(names[i], design, thing.matrix, corners if i == floor else None)
        for i, (thing, design) in enumerate(placed)
        if design.ground
    }
    others = [*objects.values(), *(g for i, g in grounds.items() if i != floor)]
    lying = [o for o in others if (o.bounds_m[:, 2] == floor_m).all()]
    standing = [o for o in others if (o.bounds_m[:, 2] != floor_m).any()]
    extent_m = (float(2 * half[0]), float(2 * half[1]))
    _check_area(path, standing, float(np.hypot(*extent_m)))
    spec = _light(world.sun)
    lit = light.sunlight(spec)
    baked, ground_light = _baked(standing, lit, extent_m, floor_m)
    return Scene(
        world.name,
        extent_m,
        (*(g for i, g in grounds.items() if i == floor), *lying, *baked),
        backdrop.build_sky(lit, seeding.generator(0, "sky")),
        backdrop.haze_rgb(lit),
        spec,
        ground_light,
    )


def _floor(placed: Sequence[_Thing]) -> tuple[int | None, float]:
    """Which placed model holds the ground, if any does, and the height that it lies at."""
    pieces = [
        (ground.depth(thing.matrix @ piece.matrix), i)
        for i, (thing, design) in enumerate(placed)
        for piece in design.ground
    ]
    if not pieces:
        return None, 0.0
    (_, floor_m), floor = min(pieces)
    return floor, floor_m


def _check_map(
    path: Path, bounds: Sequence[_Matrix], half: NDArray[np.float64], corners: tuple[_Matrix, ...]
) -> None:
    """Raise SpecError if all things lie off the map."""
    if bounds and not any((b[0] < half).all() and (b[1] > -half).all() for b in bounds):
        (west, south), (east, north) = corners
        raise SpecError(
            f"{path}: expected things within {MAP_M / 2:g} m of the origin, which the map is "
            f"centred on, got x in {west:.5g}..{east:.5g} and y in {south:.5g}..{north:.5g} m: "
            "take their middle off their <pose>s"
        )


def _check_area(path: Path, standing: Sequence[SceneObject], reach_m: float) -> None:
    """Raise SpecError if light would take too long to fall on all faces, as far as they reach."""
    total_m2 = 0.0
    for surface in (s for thing in standing for s in thing.surfaces):
        a, b, c = np.moveaxis(surface.vertices_m[surface.faces].astype(float), 1, 0)
        side_m = np.linalg.norm([b - a, c - b, a - c], axis=2).max(axis=0)
        height_m = np.linalg.norm(np.cross(b - a, c - a), axis=1) / np.maximum(side_m, 1e-9)
        sides = np.minimum([side_m, height_m], reach_m) + _THIN_M
        total_m2 += float(sides.prod(axis=0).sum()) / 2
    if total_m2 > MOST_M2:
        raise SpecError(
            f"{path}: expected faces of at most {MOST_M2:.0e} m² in all on the map, got about "
            f"{total_m2:.1e}: leave large models out, or take a <plane> for the ground"
        )


def _baked(
    standing: Sequence[SceneObject], lit: light.Light, extent_m: tuple[float, float], floor_m: float
) -> tuple[list[SceneObject], LightMap]:
    """What stands, and the light on a ground that lies at a height."""
    if not floor_m:
        return light.bake(standing, lit, extent_m)
    lowered = [_raised(thing, -floor_m) for thing in standing]
    baked, ground_light = light.bake(lowered, lit, extent_m)
    return [_raised(thing, floor_m) for thing in baked], replace(ground_light, height_m=floor_m)


def _raised(thing: SceneObject, by_m: float) -> SceneObject:
    shift = np.array([0, 0, by_m], dtype=np.float32)
    surfaces = tuple(replace(s, vertices_m=s.vertices_m + shift) for s in thing.surfaces)
    return replace(thing, surfaces=surfaces)


def _own_scene(name: str, placed: Sequence[_Thing], ours: Element, notes: Notes) -> Scene:
    """A suburb of ours that was written as a world, in the light and season that it is of."""

    def number(key: str, kind: type[float] = float) -> float:
        try:
            return kind(ours.attributes[key])
        except (KeyError, ValueError):
            raise ours.error(f"expected a number for {key!r}") from None

    document = {
        "name": name,
        "seed": number("seed", int),
        "season": ours.attributes.get("season", ""),
        "extent_m": [number("extent_x_m"), number("extent_y_m")],
        "light": {
            "time": ours.attributes.get("time", ""),
            **{key: number(key) for key in ("sun_azimuth_deg", "sun_elevation_deg", "ambient")},
        },
        "houses": {"count": 0}, "shops": {"count": 0}, "barns": {"count": 0},
        "trees": {"count": 0}, "vehicles": {"count": 0},
    }  # fmt: skip
    try:
        spec = parse_spec(document)
    except SpecError as error:
        raise ours.error(str(error)) from None
    for thing, design in placed:
        if design.ground:
            notes.add("planes of ground in a suburb of ours, which has its own", thing.name)
    objects = [
        _object(name, thing, design)
        for name, (thing, design) in zip(_names(placed), placed, strict=True)
        if design.surfaces
    ]
    standing = [o for o in objects if o.bounds_m[:, 2].any()]
    lying = [o for o in objects if not o.bounds_m[:, 2].any()]
    return outdoors(spec, standing, lying)


def _names(placed: Sequence[_Thing]) -> list[str]:
    taken: dict[str, int] = {}
    return [unique(thing.name, taken) for thing, _ in placed]


def _bounds(bounds: Sequence[_Matrix], placed: Sequence[_Thing]) -> tuple[_Matrix, _Matrix]:
    """Lowest and highest (x, y) of all things but the ground; of the ground where it is alone."""
    if bounds:
        return np.min(bounds, axis=(0, 1)), np.max(bounds, axis=(0, 1))
    pieces = [(thing.matrix @ g.matrix, g) for thing, design in placed for g in design.ground]
    centres = np.array([matrix[:2, 3] for matrix, _ in pieces])
    halves = np.minimum([g.size_m for _, g in pieces], MAP_M) / 2
    return (centres - halves).min(axis=0), (centres + halves).max(axis=0)


def _object(name: str, thing: Placed, design: Design) -> SceneObject:
    d = design
    surfaces = tuple(_placed(s, thing.matrix) for s in d.surfaces)
    outline = _outline(d, thing.matrix) if d.solid and d.pieces else None
    placed = SceneObject(name, d.kind, d.name, d.landmark, d.solid, d.size_m, surfaces, outline)
    if not np.abs(placed.bounds_m).max() < FARTHEST_M:
        raise thing.element.error(
            f"the model {name[:80]!r} lies more than {FARTHEST_M / 1000:g} km away: mend its <pose>"
        )
    return placed


def _outline(design: Design, matrix: _Matrix) -> shapely.Geometry:
    """The ground polygons of a design's visuals: what they stand around is free."""
    return shapely.union_all(
        [
            ground_polygon(np.concatenate([moved(p, matrix).vertices_m[p.faces] for p in piece]))
            for piece in design.pieces
        ]
    )


def _placed(surface: Surface, matrix: _Matrix) -> Surface:
    points = surface.vertices_m.astype(float) @ matrix[:3, :3].T + matrix[:3, 3]
    return replace(surface, vertices_m=points.astype(np.float32))

"""A Gazebo world as a ``Scene``: every placed model one object, lit as our own suburbs are."""

import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from vrchain import seeding
from vrchain.errors import SpecError, UnsupportedWarning
from vrchain.paths import scene_file
from vrchain.world import backdrop, light
from vrchain.world.backdrop import outdoors
from vrchain.world.gazebo import cache, ground
from vrchain.world.gazebo.designs import MOST_TRIANGLES, Design, Designs, unique
from vrchain.world.gazebo.files import VARIABLES, Folders, Notes, is_file, model_folders
from vrchain.world.gazebo.frames import FARTHEST_M, Matrix, Placed
from vrchain.world.gazebo.materials import Materials
from vrchain.world.gazebo.obstacles import Outlines
from vrchain.world.gazebo.sdf import MOST_MODELS, World, read_world
from vrchain.world.gazebo.xml import Element
from vrchain.world.model import LightMap, Scene, SceneObject, Surface
from vrchain.world.runs import is_long, runs_of
from vrchain.world.spec import LightSpec, parse_spec

SUFFIXES = (".world", ".sdf")

MAP_M = 600.0  # widest map, as for scenes of our own
MOST_M2 = 4e6  # of faces on the map, which light falls on: five times both sides of a whole map
_BEYOND_M = 20.0  # of ground around what stands on it
_RIM_M = 2.0  # of map around what stands on it
_LEVEL_M = 1.0  # about what robots drive on, where the feet of landmarks are
_THIN_M = 0.25  # thinner faces take as much time
_SUN_ELEVATION_DEG = (10.0, 85.0)


class _Thing(NamedTuple):
    """A model that is drawn, under a name of its own."""

    name: str
    placed: Placed
    design: Design

    def object(self, outlines: Outlines) -> SceneObject:
        """What of it is no ground, in the world."""
        thing, pieces, matrix = self.design.prototype, self.design.pieces, self.placed.matrix
        surfaces = tuple(_moved(s, matrix) for s in thing.surfaces)
        outline = outlines.of(pieces, matrix) if thing.solid and pieces else None
        return replace(thing, name=self.name, surfaces=surfaces, outline=outline)

    def runs(self, placed: SceneObject) -> list[SceneObject]:
        """What it is in the world: one object, or the runs of a long wall."""
        if not is_long(self.design.prototype):
            return [placed]
        return runs_of(placed, self.design.prototype.surfaces, self.placed.matrix)

    @property
    def foot_m(self) -> float:
        """How high its lowest point is, in the world."""
        vertices = [s.vertices_m for s in self.design.prototype.surfaces]
        matrix = self.placed.matrix
        return float(min((v @ matrix[2, :3]).min() for v in vertices) + matrix[2, 3])

    @property
    def is_far(self) -> bool:
        """Whether it lies farther away than any map reaches."""
        surfaces, away = self.design.prototype.surfaces, self.placed.matrix[:3, 3]
        reach_m = np.abs(self.design.prototype.bounds_m).max() if surfaces else 0.0
        return bool(np.abs(away).max() + reach_m > FARTHEST_M)


def _moved(surface: Surface, matrix: Matrix) -> Surface:
    points = surface.vertices_m.astype(float) @ matrix[:3, :3].T + matrix[:3, 3]
    return replace(surface, vertices_m=points.astype(np.float32))


def load_world(path: str | Path, *, strict: bool = False) -> Scene:
    """The scene of a ``.world`` or ``.sdf`` file, whose models lie in ``model_folders``.

    What is not supported, and every file that is missing, is told by one UnsupportedWarning;
    strict: missing files are an error. Raises SpecError, with the file and the line or element, on
    anything else amiss.
    """
    path = scene_file(path)
    if not is_file(path):
        what = "is a folder" if path.is_dir() else "is not there"
        raise SpecError(f"{path} {what}: give a world file ({' or '.join(SUFFIXES)})")
    folders = model_folders(path)
    loaded: _Loaded = cache.kept(
        [str(path.absolute()), *map(str, folders.models)], lambda: _load(path, folders, strict)
    )
    if strict and loaded.lost:
        raise SpecError(f"{path}: {loaded.lost}")
    if loaded.told:
        warnings.warn(f"{path}: {loaded.told}", UnsupportedWarning, 3)
    return loaded.scene


class _Loaded(NamedTuple):
    """A scene, what is told of its world, and of the files that are missing."""

    scene: Scene
    told: str
    lost: str


def _load(path: Path, folders: Folders, strict: bool) -> _Loaded:
    notes = Notes()
    world = read_world(path, folders, notes)
    models = [placed for model in world.models for placed in model.flat(np.eye(4))]
    designs = Designs(Materials(folders, notes), notes, ground.visual_of(models))
    count = Counter(placed.name for placed in models)
    taken = {name: 1 for name, n in count.items() if n == 1}  # which keep theirs
    things = []
    for placed in models:
        if (design := designs.of(placed.model)) is not None:
            if design.hilly:
                placed = replace(placed, matrix=np.eye(4))
            name = placed.name if count[placed.name] == 1 else unique(placed.name, taken)
            thing = _Thing(name, placed, design)
            if thing.is_far:
                notes.add(f"models more than {FARTHEST_M / 1000:g} km away, left out", thing.name)
            else:
                things.append(thing)
    if notes.lost:
        hint = f"; looked for in {folders}: name more folders in {VARIABLES[0]} or {VARIABLES[1]}"
        if strict:
            raise SpecError(f"{path}: {notes.lost}{hint}")
    else:
        hint = ""
    if not things:
        why = f": not supported: {notes}{hint}" if notes else ""
        raise SpecError(f"{path}: nothing in this world can be drawn{why}")
    triangles = sum(len(s.faces) for thing in things for s in thing.design.prototype.surfaces)
    if len(things) > MOST_MODELS or triangles > MOST_TRIANGLES:
        raise SpecError(
            f"{path}: expected at most {MOST_MODELS} models and {MOST_TRIANGLES} triangles, got "
            f"{len(things)} and {triangles}"
        )
    if world.ours is not None:
        scene = _own_scene(world.name, things, world.ours, notes)
    else:
        scene = _scene(path, world, _levelled(things, notes), designs, notes)
    told = f"not supported or simplified: {notes}{hint}" if notes else ""
    return _Loaded(scene, told, f"{notes.lost}{hint}")


def _levelled(things: Sequence[_Thing], notes: Notes) -> Sequence[_Thing]:
    """All lowered by the height on which most landmarks stand, where a heightmap is their ground.

    Robots drive at 0; in Gazebo they fall onto it.
    """
    feet_m = np.array([t.foot_m for t in things if t.design.prototype.landmark])
    level_m = round(float(np.median(feet_m)), 2) if len(feet_m) else 0.0
    hilly = any(thing.design.hilly for thing in things)
    together = 2 * (np.abs(feet_m - level_m) < _LEVEL_M).sum() > len(feet_m)
    if abs(level_m) < _LEVEL_M or not (hilly and together):
        return things
    notes.add(f"landmarks that stand at {level_m:g} m, where a heightmap is: all is lowered")
    lower = np.eye(4)
    lower[2, 3] = -level_m
    moved = [replace(thing.placed, matrix=lower @ thing.placed.matrix) for thing in things]
    return [thing._replace(placed=placed) for thing, placed in zip(things, moved, strict=True)]


def _scene(
    path: Path, world: World, things: Sequence[_Thing], designs: Designs, notes: Notes
) -> Scene:
    """The ground, then what lies, then what stands, each in the world's order, and their light."""
    pieces = [
        (ground.depth(matrix), k, matrix, piece.size_m)
        for k, thing in enumerate(things)
        for piece in thing.design.ground
        for matrix in [thing.placed.matrix @ piece.matrix]
    ]
    # The lowest piece is the floor of the world, all over.
    (_, floor_m), floor = min((piece[:2] for piece in pieces), default=((False, 0.0), None))
    shown = [thing for thing in things if thing.design.prototype.surfaces]
    outlines = Outlines()
    objects = [thing.object(outlines) for thing in shown]
    bounds = [o.bounds_m[:, :2] for o, t in zip(objects, shown, strict=True) if not t.design.wide]
    objects = [run for o, thing in zip(objects, shown, strict=True) for run in thing.runs(o)]
    boxes = bounds or [
        matrix[:2, 3] + np.outer((-0.5, 0.5), np.minimum(size_m, MAP_M))
        for _, _, matrix, size_m in pieces
    ]
    boxes = boxes or [o.bounds_m[:, :2] for o in objects]  # wide planes that are no ground
    low, high = np.min(boxes, axis=(0, 1)), np.max(boxes, axis=(0, 1))
    half = np.minimum(np.ceil(2 * (np.abs([low, high]).max(axis=0) + _RIM_M)), MAP_M) / 2
    if bounds and not any((b[0] < half).all() and (b[1] > -half).all() for b in bounds):
        raise SpecError(
            f"{path}: expected things within {MAP_M / 2:g} m of the origin, which the map is "
            f"centred on, got x in {low[0]:.5g}..{high[0]:.5g} and y in {low[1]:.5g}.."
            f"{high[1]:.5g} m: take their middle off their <pose>s"
        )
    if np.abs([low, high]).max() > MAP_M / 2 - _RIM_M:
        notes.add(f"parts beyond the map of {MAP_M:g} x {MAP_M:g} m, where no robot drives")
    corners = np.minimum(low, -half) - _BEYOND_M, np.maximum(high, half) + _BEYOND_M
    floors: list[SceneObject] = []
    for k, (name, placed, design) in enumerate(things):
        if design.ground:
            whole = corners if k == floor else None
            lawn = designs.ground(name, design, placed.matrix, whole)
            (floors if k == floor else objects).append(lawn)
    lying = [o for o in objects if (o.bounds_m[:, 2] == floor_m).all()]
    standing = [o for o in objects if (o.bounds_m[:, 2] != floor_m).any()]
    extent_m = (float(2 * half[0]), float(2 * half[1]))
    _check_area(path, standing, float(np.hypot(*extent_m)))
    spec = _light(world.sun)
    lit = replace(light.sunlight(spec), least=world.ambient)
    baked, ground_light = _baked(standing, lit, extent_m, floor_m)
    return Scene(
        world.name,
        extent_m,
        (*floors, *lying, *baked),
        backdrop.build_sky(lit, seeding.generator(0, "sky"), extent_m),
        backdrop.haze_rgb(lit),
        spec,
        ground_light,
    )


def _light(sun: Matrix | None) -> LightSpec:
    """The sun where the world has it, within what ``LightSpec`` allows."""
    if sun is None:
        return LightSpec()
    x, y, z = -sun
    elevation_deg = np.degrees(np.arcsin(np.clip(z, -1, 1)))
    return LightSpec(
        sun_azimuth_deg=float(np.degrees(np.arctan2(y, x)) % 360),
        sun_elevation_deg=float(np.clip(elevation_deg, *_SUN_ELEVATION_DEG)),
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


def _own_scene(name: str, things: Sequence[_Thing], ours: Element, notes: Notes) -> Scene:
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
    for thing in things:
        if thing.design.ground:
            notes.add("planes of ground in a suburb of ours, which has its own", thing.placed.name)
    outlines = Outlines()
    objects = [thing.object(outlines) for thing in things if thing.design.prototype.surfaces]
    standing = [o for o in objects if o.bounds_m[:, 2].any()]
    lying = [o for o in objects if not o.bounds_m[:, 2].any()]
    return outdoors(spec, standing, lying)

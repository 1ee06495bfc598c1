"""A Gazebo world as a ``Scene``: every placed model one object, lit as our own suburbs are."""

import hashlib
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vrchain import seeding
from vrchain.errors import SpecError, UnsupportedWarning
from vrchain.scene import backdrop, light
from vrchain.scene.gazebo import kinds, primitives
from vrchain.scene.gazebo.files import is_file, model_folders
from vrchain.scene.gazebo.limits import MAP_M, MODEL_SIZE_M, MOST_MODELS, MOST_TRIANGLES
from vrchain.scene.gazebo.materials import Look, Materials
from vrchain.scene.gazebo.meshes import Meshes, Part, moved
from vrchain.scene.gazebo.notes import Notes
from vrchain.scene.gazebo.sdf import Model, Visual, all_visuals, flat, read_world
from vrchain.scene.gazebo.sheets import apart
from vrchain.scene.gazebo.xml import Element
from vrchain.scene.model import Scene, SceneObject, Surface
from vrchain.scene.outdoors import outdoors
from vrchain.scene.spec import LightSpec, parse_spec

SUFFIXES = (".world", ".sdf")

_Matrix = NDArray[np.float64]
_BEYOND_M = 20.0  # of ground around what stands on it
_RIM_M = 2.0  # of map around what stands on it
_GROUND_M = 40.0  # a level plane that is wider is the ground, which goes on
_RUN_M = 8.0  # a longer fence, wall or hedge is no landmark
_NO_LANDMARK = ("ground", "robot", "person")
_RUNS = ("fence", "wall", "hedge")
_LEAST_LANDMARK_M = 0.25  # lower things do not stand
_TILE_EPSILON = 1e-4
_UNDRAWN = ("heightmap", "image", "polyline")
_SUN_ELEVATION_DEG = (10.0, 85.0)


@dataclass(frozen=True, eq=False)
class _Ground:
    """A plane that goes on as far as the world. matrix: (4, 4) to its model's frame."""

    matrix: _Matrix
    size_m: NDArray[np.float64]
    look: Look


@dataclass(frozen=True, eq=False)
class _Design:
    """A model ready to be placed: surfaces in its own frame, and ground if it has some."""

    name: str
    surfaces: tuple[Surface, ...]
    ground: tuple[_Ground, ...]
    size_m: tuple[float, float, float]
    kind: str
    landmark: bool
    solid: bool


def load_world(path: str | Path) -> Scene:
    """The scene of a ``.world`` or ``.sdf`` file, whose models lie in ``model_folders``.

    What is not supported is told by one UnsupportedWarning. Raises SpecError, with the file and
    the line or element, on anything amiss.
    """
    path = Path(path)
    if not is_file(path):
        what = "is a folder" if path.is_dir() else "is not there"
        raise SpecError(f"{path} {what}: give a world file ({' or '.join(SUFFIXES)})")
    notes = Notes()
    folders = model_folders(path)
    world = read_world(path, folders, notes)
    designs = _Designs(Materials(folders, notes), notes)
    placed = [
        (name, design, matrix)
        for model_placed in world.models
        for name, model, matrix in flat(model_placed, np.eye(4))
        if (design := designs.of(model)) is not None
    ]
    if not placed:
        why = f", not supported: {notes}" if notes else ""
        raise SpecError(f"{path}: nothing in this world can be drawn{why}")
    _check_count(path, placed)
    if world.ours is not None:
        return _own_scene(world.name, placed, world.ours)
    scene = _scene(world.name, placed, designs, _light(world.sun), notes)
    if notes:
        warnings.warn(f"{path}: not supported or simplified: {notes}", UnsupportedWarning, 3)
    return scene


def _check_count(path: Path, placed: Sequence[tuple[str, _Design, _Matrix]]) -> None:
    triangles = sum(len(s.faces) for _, design, _ in placed for s in design.surfaces)
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
    name: str,
    placed: Sequence[tuple[str, _Design, _Matrix]],
    designs: "_Designs",
    spec: LightSpec,
    notes: Notes,
) -> Scene:
    """The ground, then what lies, then what stands, each in the world's order, and their light."""
    taken: dict[str, int] = {}
    names = [_unique(name, taken) for name, _, _ in placed]
    objects = {
        i: _object(names[i], design, matrix)
        for i, (_, design, matrix) in enumerate(placed)
        if design.surfaces
    }
    for i, thing in objects.items():
        if not np.isfinite(thing.bounds_m).all() or np.abs(thing.bounds_m).max() > 1e5:
            raise SpecError(f"the model {names[i]!r} lies more than 100 km away: mend its <pose>")
    low, high = _bounds(list(objects.values()), placed)
    reach = np.abs([low, high]).max(axis=0) + _RIM_M
    if 2 * reach.max() > MAP_M:
        notes.add(f"parts beyond the map of {MAP_M:g} x {MAP_M:g} m, where no robot drives")
    width_m, depth_m = (float(v) for v in np.minimum(np.ceil(2 * reach), MAP_M))
    flat_ground = [
        designs.ground(names[i], design, matrix, low - _BEYOND_M, high + _BEYOND_M)
        for i, (_, design, matrix) in enumerate(placed)
        if design.ground
    ]
    standing = [o for o in objects.values() if o.bounds_m[:, 2].any()]
    lying = [o for o in objects.values() if not o.bounds_m[:, 2].any()]
    lit = light.sunlight(spec)
    baked, ground_light = light.bake(standing, lit, (width_m, depth_m))
    return Scene(
        name,
        (width_m, depth_m),
        (*flat_ground, *lying, *baked),
        backdrop.build_sky(lit, seeding.generator(0, "sky")),
        backdrop.haze_rgb(lit),
        spec,
        ground_light,
    )


def _own_scene(name: str, placed: Sequence[tuple[str, _Design, _Matrix]], ours: Element) -> Scene:
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
    objects = [_object(name, design, matrix) for name, design, matrix in placed]
    standing = [o for o in objects if o.bounds_m[:, 2].any()]
    lying = [o for o in objects if not o.bounds_m[:, 2].any()]
    return outdoors(spec, standing, lying)


def _bounds(
    objects: Sequence[SceneObject], placed: Sequence[tuple[str, _Design, _Matrix]]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Lowest and highest (x, y) of all things but the ground; of the ground where it is alone."""
    if objects:
        bounds = np.array([o.bounds_m[:, :2] for o in objects])
        return bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)
    centres = np.array([(m @ g.matrix)[:2, 3] for _, d, m in placed for g in d.ground])
    halves = np.array([g.size_m for _, d, _ in placed for g in d.ground]) / 2
    halves = np.minimum(halves, MAP_M / 2)
    return (centres - halves).min(axis=0), (centres + halves).max(axis=0)


def _unique(name: str, taken: dict[str, int]) -> str:
    """The name, or with a number if another has it."""
    fresh = name
    while fresh in taken:
        taken[name] += 1
        fresh = f"{name}_{taken[name]}"
    taken[fresh] = 1
    return fresh


def _object(name: str, design: _Design, matrix: _Matrix) -> SceneObject:
    surfaces = tuple(_placed(s, matrix) for s in design.surfaces)
    d = design
    return SceneObject(name, d.kind, d.name, d.landmark, d.solid, d.size_m, surfaces)


def _placed(surface: Surface, matrix: _Matrix) -> Surface:
    points = surface.vertices_m.astype(float) @ matrix[:3, :3].T + matrix[:3, 3]
    return replace(surface, vertices_m=points.astype(np.float32))


class _Designs:
    """Models made into surfaces, each once; equal ones get one name, so that they are twins."""

    def __init__(self, materials: Materials, notes: Notes) -> None:
        self._materials, self._notes = materials, notes
        self._meshes = Meshes(materials, notes)
        self._made: dict[int, tuple[Model, _Design | None]] = {}
        self._names: dict[str, str] = {}
        self._taken: dict[str, int] = {}

    def of(self, model: Model) -> _Design | None:
        """A model's design; None if nothing of it is drawn."""
        if id(model) not in self._made:
            self._made[id(model)] = (model, self._make(model))
        return self._made[id(model)][1]

    def ground(
        self,
        name: str,
        design: _Design,
        matrix: _Matrix,
        low: NDArray[np.float64],
        high: NDArray[np.float64],
    ) -> SceneObject:
        """The ground of a design, from corner to corner of the world, (2,) each."""
        corners = np.array([(x, y, 0, 1) for x in (low[0], high[0]) for y in (low[1], high[1])])
        surfaces: list[Surface] = []
        for piece in design.ground:
            whole = matrix @ piece.matrix
            own = (corners @ np.linalg.inv(whole).T)[:, :2]
            part = primitives.plane(own.min(axis=0), own.max(axis=0), piece.size_m)
            part = moved(replace(part, look=piece.look), whole)
            surfaces.extend(self._surfaces([part]))
        size = np.ptp(np.concatenate([s.vertices_m for s in surfaces]), axis=0)
        x_m, y_m, z_m = (float(v) for v in size)
        return SceneObject(
            f"{name}::ground" if design.surfaces else name,
            "ground", design.name, False, False, (x_m, y_m, z_m), tuple(surfaces),
        )  # fmt: skip

    def _make(self, model: Model) -> _Design | None:
        parts: list[Part] = []
        ground: list[_Ground] = []
        for visual in all_visuals(model, np.eye(4)):
            self._draw(visual, parts, ground)
        if not parts and not ground:
            return None
        surfaces = tuple(self._surfaces(parts if model.ours else apart(parts)))
        size_m = (0.0, 0.0, 0.0)
        if parts:
            points = np.concatenate([p.vertices_m[p.faces.ravel()] for p in parts])
            x_m, y_m, z_m = (float(v) for v in np.ptp(points, axis=0))
            size_m = (x_m, y_m, z_m)
            least, most = MODEL_SIZE_M
            if not least <= max(size_m) <= most:
                raise SpecError(
                    f"{_where(model)}: the model {model.name!r} is {max(size_m):.3g} m large, "
                    f"expected {least:g}..{most:g}: mend its <scale> or its mesh's unit"
                )
        if model.ours is not None:
            told = model.ours.attributes
            return _Design(
                told.get("model", model.design), surfaces, tuple(ground), size_m,
                told.get("kind", "object"), told.get("landmark") == "true",
                told.get("solid") == "true",
            )  # fmt: skip
        kind = kinds.guess(model.design, size_m, _leafy(surfaces)) if parts else "ground"
        if parts and kind == "object":
            kind = kinds.guess(model.name, size_m, _leafy(surfaces))
        return _Design(
            self._name(model, surfaces, ground), surfaces, tuple(ground), size_m, kind,
            self._is_landmark(model, kind, size_m), kind != "ground",
        )  # fmt: skip

    def _is_landmark(self, model: Model, kind: str, size_m: tuple[float, float, float]) -> bool:
        if kind in _RUNS and max(size_m[:2]) > _RUN_M:
            self._notes.add(f"runs longer than {_RUN_M:g} m, which are no landmarks", model.name)
            return False
        return kind not in _NO_LANDMARK and size_m[2] >= _LEAST_LANDMARK_M

    def _name(self, model: Model, surfaces: Sequence[Surface], ground: Sequence[_Ground]) -> str:
        content = hashlib.sha256()
        for s in surfaces:
            for array in (s.vertices_m, s.faces, s.uv, s.texture):
                content.update(str(array.shape).encode())
                content.update(np.ascontiguousarray(array).tobytes())
        for g in ground:
            content.update(f"{g.matrix.tolist()}{g.size_m.tolist()}{g.look}".encode())
        key = content.hexdigest()
        if key not in self._names:
            self._names[key] = _unique(model.design, self._taken)
        return self._names[key]

    def _draw(self, visual: Visual, parts: list[Part], ground: list[_Ground]) -> None:
        """Add what a visual shows, in its model's frame."""
        element = visual.element
        geometry = element.find("geometry")
        shape = geometry.children[0] if geometry is not None and geometry.children else None
        if shape is None or shape.tag == "empty":
            return
        name = element.attributes.get("name", "")
        if shape.tag in _UNDRAWN:
            self._notes.add(f"{shape.tag}s", name)
            return
        transparency = element.number("transparency", 0.0)
        if transparency >= 0.5:
            self._notes.add("visuals more than half transparent", name)
            return
        if transparency > 0:
            self._notes.add("visuals somewhat transparent, drawn opaque", name)
        look, tint = self._materials.look(element)
        if shape.tag == "plane":
            self._plane(shape, visual.matrix, look or Look(tint), parts, ground)
            return
        if shape.tag == "mesh":
            found = self._mesh(shape)
        elif shape.tag in primitives.KINDS:
            found = [primitives.build(shape)]
        else:
            self._notes.add("unknown geometry", shape.tag)
            return
        for part in found:
            own = replace(part.look, colour=_product(part.look.colour, tint))
            parts.append(moved(replace(part, look=look or own), visual.matrix))

    def _mesh(self, shape: Element) -> list[Part]:
        uri = shape.find("uri")
        if uri is None or not uri.text:
            raise shape.error("expected a <uri>")
        file = self._materials.beside(uri.text, shape.file.parent, uri)
        if file is None:
            raise uri.error(f"no mesh {uri.text[:200]!r}: check the name, or the model's folder")
        parts = self._meshes.parts(file, shape)
        submesh = shape.find("submesh")
        if submesh is not None and parts:
            wanted = submesh.words("name")
            parts = [part for part in parts if part.name == wanted]
            if not parts:
                known = ", ".join(sorted({p.name for p in self._meshes.parts(file, shape)}))
                raise submesh.error(f"no submesh {wanted!r} in {file.name}: it has {known[:200]}")
            if submesh.words("center") in ("true", "1"):
                points = np.concatenate([p.vertices_m[p.faces.ravel()] for p in parts])
                middle = np.eye(4)
                middle[:3, 3] = -(points.min(axis=0) + points.max(axis=0)) / 2
                parts = [moved(part, middle) for part in parts]
        scale = shape.find("scale")
        factors = (1.0, 1.0, 1.0) if scale is None else scale.numbers(3)
        if scale is not None and not 1e-9 < np.abs(factors).min() <= np.abs(factors).max() < 1e9:
            raise scale.error(f"expected factors of a sensible size, got {scale.text!r}")
        return [moved(part, np.diag([*factors, 1.0])) for part in parts]

    def _plane(
        self,
        shape: Element,
        matrix: _Matrix,
        look: Look,
        parts: list[Part],
        ground: list[_Ground],
    ) -> None:
        size = shape.find("size")
        size_m = np.array((1.0, 1.0) if size is None else size.numbers(2))
        normal = shape.find("normal")
        up = np.array((0.0, 0.0, 1.0) if normal is None else normal.numbers(3))
        if size_m.min() <= 0 or not np.linalg.norm(up) > 1e-9:
            raise shape.error("expected a size and a normal longer than 0")
        turned = matrix @ _towards(up / np.linalg.norm(up))
        if size_m.min() >= _GROUND_M and turned[2, 2] > 1 - 1e-6:
            ground.append(_Ground(turned, size_m, look))
        else:
            part = primitives.plane(-size_m / 2, size_m / 2, size_m)
            parts.append(moved(replace(part, look=look), turned))

    def _surfaces(self, parts: Sequence[Part]) -> Iterator[Surface]:
        """Parts as surfaces, those with one texture joined."""
        groups: dict[int, list[tuple[Part, NDArray[np.uint8]]]] = {}
        for part in parts:
            texture = self._materials.texture(part.look)
            groups.setdefault(id(texture), []).append((_tiled(part), texture))
        for group in groups.values():
            first = np.cumsum([0, *(len(p.vertices_m) for p, _ in group)])
            faces = [p.faces + n for (p, _), n in zip(group, first[:-1], strict=True)]
            vertices = np.concatenate([p.vertices_m for p, _ in group]).astype(np.float32)
            yield Surface(
                vertices,
                np.concatenate(faces).astype(np.int32),
                np.concatenate([p.uv for p, _ in group if p.uv is not None]).astype(np.float32),
                _shade([p for p, _ in group]),
                group[0][1],
            )


def _where(model: Model) -> str:
    """File and line of a model's first visual."""
    element = next(all_visuals(model, np.eye(4))).element
    return f"{element.file}:{element.line}"


def _leafy(surfaces: Sequence[Surface]) -> bool:
    """Whether most of the triangles are cut out."""
    counts = [(len(s.faces), s.cut_out) for s in surfaces]
    return 2 * sum(n for n, cut in counts if cut) > sum(n for n, _ in counts)


def _product(
    a: tuple[float, float, float], b: tuple[float, float, float]
) -> tuple[float, float, float]:
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


def _towards(normal: NDArray[np.float64]) -> _Matrix:
    """The least turn that brings z to a unit normal, (4, 4)."""
    matrix = np.eye(4)
    axis = np.cross((0.0, 0.0, 1.0), normal)
    if not axis.any():
        matrix[:3, :3] = np.diag([1.0, np.sign(normal[2]), np.sign(normal[2])])
        return matrix
    x, y, z = axis
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    matrix[:3, :3] += cross + cross @ cross / (1 + normal[2])
    return matrix


def _shade(parts: Sequence[Part]) -> NDArray[np.float32]:
    """Colours of vertices, (n, 3), white where a mesh has none."""
    shades = [np.ones((len(p.vertices_m), 3)) if p.shade is None else p.shade for p in parts]
    return np.concatenate(shades).clip(0, 1).astype(np.float32)


def _tiled(part: Part) -> Part:
    """A part with its picture's repeats in its texture coordinates.

    Where no face reaches over a picture's edge, each is brought into 0..1, for the atlas.
    """
    if part.uv is None or part.look.picture is None:
        return replace(part, uv=np.full((len(part.vertices_m), 2), 0.5))
    uv = (part.uv - 0.5) * part.look.repeats + 0.5
    corners = uv[part.faces]
    tile = np.floor(corners.min(axis=1) + _TILE_EPSILON)
    if (corners.max(axis=1) - tile).max() > 1 + _TILE_EPSILON:
        return replace(part, uv=uv)
    keys = np.column_stack([part.faces.ravel(), np.repeat(tile, 3, axis=0)])
    corner, faces = np.unique(keys, axis=0, return_inverse=True)
    vertex = corner[:, 0].astype(np.int64)
    inside = np.clip(uv[vertex] - corner[:, 1:], 0, 1)
    return replace(
        part,
        vertices_m=part.vertices_m[vertex],
        faces=faces.reshape(-1, 3),
        uv=inside,
        shade=None if part.shade is None else part.shade[vertex],
    )

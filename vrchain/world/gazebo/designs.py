"""Models made into surfaces: what a visual shows, what kind a model is, which are twins."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vrchain.world.atlas import join_by_texture
from vrchain.world.gazebo import kinds
from vrchain.world.gazebo.files import Notes
from vrchain.world.gazebo.frames import Matrix, Model, Visual
from vrchain.world.gazebo.ground import (
    ELEVATIONS,
    WIDE_M,
    depth,
    is_wide,
    layers_of,
    level_m,
    plane_of,
    terrain,
)
from vrchain.world.gazebo.materials import Look, Materials
from vrchain.world.gazebo.mesh.meshes import Meshes
from vrchain.world.gazebo.outlines import prism, ribbon
from vrchain.world.gazebo.parts import PRIMITIVES, Part, apart, moved, plane, primitive
from vrchain.world.gazebo.scripts import PICTURED, Colour
from vrchain.world.gazebo.xml import Element
from vrchain.world.model import SceneObject, Surface, size_of

MOST_TRIANGLES = 6_000_000  # of a world
MODEL_SIZE_M = (1e-3, 2000.0)
_SHEET_M = 1000.0  # to which other planes are cut: no view shows more
_NO_LANDMARK = ("ground", "robot", "person")
_LEAST_LANDMARK_M = 0.25  # lower things do not stand
_TILE_EPSILON = 1e-4
_ROAD = Look(PICTURED["Road"])
_EARTH = Look((0.45, 0.4, 0.3))  # of hills whose picture is missing: most come with Gazebo


@dataclass(frozen=True, eq=False)
class Ground:
    """The plane that goes on as far as the world. matrix: (4, 4) to its model's frame."""

    matrix: Matrix
    size_m: NDArray[np.float64]
    look: Look


@dataclass(frozen=True, eq=False)
class Design:
    """A model ready to be placed: an object in its own frame, and ground if it has some.

    pieces: what each of its visuals shows, which stands in a robot's way for itself; none of a
    model of ours. wide: it is nothing but ground as wide as a world. hilly: it is nothing but a
    heightmap, which Gazebo places by its <pos> alone.
    """

    prototype: SceneObject
    ground: tuple[Ground, ...]
    pieces: tuple[tuple[Part, ...], ...] = ()
    wide: bool = False
    hilly: bool = False


class Designs:
    """Models made into surfaces, each once; equal ones get one name, so that they are twins."""

    def __init__(self, materials: Materials, notes: Notes, ground: Element | None) -> None:
        """ground: the <visual> that shows it."""
        self._materials, self._notes, self._shows_ground = materials, notes, ground
        self._meshes = Meshes(materials, notes)
        self._made: dict[Model, Design | None] = {}
        self._names: dict[bytes, str] = {}
        self._taken: dict[str, int] = {}
        self._triangles = 0  # of all that is drawn so far

    def of(self, model: Model) -> Design | None:
        """A model's design; None if nothing of it is drawn."""
        if model not in self._made:
            self._made[model] = self._make(model)
        return self._made[model]

    def ground(
        self, name: str, design: Design, matrix: Matrix, corners: tuple[Matrix, Matrix] | None
    ) -> SceneObject:
        """The ground of a design, the lowest of it from corner to corner of the world, (2,) each.

        None: all of it as large as it is.
        """
        placed = [(matrix @ piece.matrix, piece) for piece in design.ground]
        lowest = min(range(len(placed)), key=lambda k: depth(placed[k][0]))
        parts = [
            _level(piece, whole, corners if k == lowest else None)
            for k, (whole, piece) in enumerate(placed)
        ]
        surfaces = self._surfaces(parts)
        size_m = size_of(np.concatenate([s.vertices_m for s in surfaces]))
        name = f"{name}::ground" if design.prototype.surfaces else name
        return SceneObject(name, "ground", design.prototype.model, False, False, size_m, surfaces)

    def _make(self, model: Model) -> Design | None:
        ground: list[Ground] = []
        visuals = list(model.all_visuals(np.eye(4)))
        shown = [self._draw(visual, ground) for visual in visuals]
        pieces = tuple(tuple(piece) for piece in shown if piece)
        parts = [part for piece in pieces for part in piece]
        if not parts and not ground:
            return None
        surfaces = self._surfaces(parts if model.ours else apart(parts))
        size_m = (0.0, 0.0, 0.0)
        if parts:
            size_m = size_of(np.concatenate([p.vertices_m[p.faces.ravel()] for p in parts]))
            least, most = MODEL_SIZE_M
            if not least <= max(size_m) <= most:
                self._notes.add(
                    f"models not of {least:g} to {most:g} m, left out",
                    f"{model.name[:30]} is {max(size_m):.3g} m large",
                )
                return None
        if model.ours is not None:
            told = model.ours.attributes
            kind, design = told.get("kind", "object"), told.get("model", model.design)
            landmark, solid = (told.get(word) == "true" for word in ("landmark", "solid"))
            thing = SceneObject(model.name, kind, design, landmark, solid, size_m, surfaces)
            return Design(thing, tuple(ground))
        cut_out = sum(len(s.faces) for s in surfaces if s.cut_out)
        leafy = 2 * cut_out > sum(len(s.faces) for s in surfaces)
        shapes = [visual.element.find("geometry/heightmap") for visual in visuals]
        hilly = bool(parts) and all(shapes)
        kind = kinds.guess(model.design, size_m, leafy) if parts and not hilly else "ground"
        if parts and kind == "object":
            kind = kinds.guess(model.name, size_m, leafy)
        design = self._name(model, surfaces, ground)
        landmark = kind not in _NO_LANDMARK and size_m[2] >= _LEAST_LANDMARK_M
        thing = SceneObject(model.name, kind, design, landmark, kind != "ground", size_m, surfaces)
        wide = all(is_wide(visual) for visual in visuals)
        wide |= kind == "ground" and min(size_m[:2]) >= WIDE_M
        return Design(thing, tuple(ground), pieces, wide, hilly)

    def _name(self, model: Model, surfaces: Sequence[Surface], ground: Sequence[Ground]) -> str:
        content = hashlib.sha256(b"".join(s.digest for s in surfaces))
        for g in ground:
            content.update(f"{g.matrix.tolist()}{g.size_m.tolist()}{g.look}".encode())
        key = content.digest()
        if key not in self._names:
            self._names[key] = unique(model.design, self._taken)
        return self._names[key]

    def _draw(self, visual: Visual, ground: list[Ground]) -> list[Part]:
        """What a visual shows, in its model's frame; what is ground is added to that."""
        element, matrix = visual.element, visual.matrix
        shape = self._shape(element)
        if shape is None:
            return []
        look, colour = self._materials.look(element)
        if shape.tag == "plane":
            turn, size_m = plane_of(shape)
            matrix = matrix @ turn
            if element is self._shows_ground:
                ground.append(Ground(matrix, size_m, look or _coloured(Look(), colour)))
                return []
            half = np.minimum(size_m, _SHEET_M) / 2
            found = [plane(-half, half, size_m)]
        elif shape.tag == "mesh":
            found = self._mesh(shape)
        elif shape.tag == "polyline":
            found = [prism([line for g in element.all("geometry") for line in g.all("polyline")])]
        elif shape.tag == "road":
            found = [replace(ribbon(shape), look=_ROAD)]
        elif shape.tag == "heightmap":
            found, matrix = self._terrain(shape), np.eye(4)
        else:
            found = [primitive(shape)]
        self._triangles += sum(len(part.faces) for part in found)
        if self._triangles > MOST_TRIANGLES:  # before they fill the memory
            raise element.error(
                f"expected at most {MOST_TRIANGLES} triangles in a world, with this it has "
                f"{self._triangles}: leave models out, or simplify their meshes"
            )
        dressed = [replace(part, look=look or _coloured(part.look, colour)) for part in found]
        if any(part.look.clear for part in dressed):
            self._notes.add("parts of meshes more than half transparent", element.name)
        return [moved(part, matrix) for part in dressed if not part.look.clear]

    def _shape(self, element: Element) -> Element | None:
        """What the <geometry> of a visual holds, if it can be drawn."""
        geometry = element.find("geometry")
        shape = geometry.children[0] if geometry is not None and geometry.children else None
        if shape is None or shape.tag == "empty":
            return None
        name = element.name
        transparency = element.number("transparency", 0.0)
        if shape.tag == "image":
            self._notes.add("images", name)
        elif transparency >= 0.5:
            self._notes.add("visuals more than half transparent", name)
        elif shape.tag not in ("plane", "mesh", "polyline", "road", "heightmap", *PRIMITIVES):
            self._notes.add("unknown geometry", shape.tag)
        else:
            if transparency > 0:
                self._notes.add("visuals somewhat transparent, drawn opaque", name)
            return shape
        return None

    def _mesh(self, shape: Element) -> list[Part]:
        uri = shape.find("uri")
        if uri is None or not uri.text:
            raise shape.error("expected a <uri>")
        file = self._materials.beside(uri.text, shape.file.parent, uri)
        if file is None:
            self._notes.lose("meshes that are missing", uri.text)
            return []
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
        factors = shape.values("scale", (1.0, 1.0, 1.0))
        if scale is not None and not 1e-9 < np.abs(factors).min() <= np.abs(factors).max() < 1e9:
            raise scale.error(f"expected factors of a sensible size, got {scale.text!r}")
        return [moved(part, np.diag([*factors, 1.0])) for part in parts]

    def _terrain(self, shape: Element) -> list[Part]:
        """The triangles of a <heightmap>; none, with a note, where its picture is missing."""
        file, uri = None, shape.find("uri")
        if uri is not None and uri.text:
            file = self._materials.picture(uri.text, uri, [shape.file.parent])
        elevations = file is not None and file.suffix.lower() in ELEVATIONS
        greys = None if file is None or elevations else self._materials.read(file)
        if file is None or greys is None:
            self._notes.add("heightmaps", shape.tag if uri is None else uri.text)
            return []
        self._notes.add("heightmaps, through which robots drive level", file.name)
        layers = []
        for layer, from_m in layers_of(shape):
            diffuse = layer.words("diffuse")
            picture = self._materials.picture(diffuse, layer, [shape.file.parent])
            look = _EARTH if picture is None else Look(picture=picture)
            layers.append((layer.number("size", 1.0), look, from_m))
        return terrain(shape, greys[..., 0], layers or [(1.0, _EARTH, -np.inf)])

    def _surfaces(self, parts: Sequence[Part]) -> tuple[Surface, ...]:
        """Parts as surfaces, those with one texture joined."""
        return tuple(join_by_texture([_surface(p, self._materials.texture(p.look)) for p in parts]))


def _level(piece: Ground, matrix: Matrix, corners: tuple[Matrix, Matrix] | None) -> Part:
    """A piece of ground in the world, out to the corners if there are some."""
    low, high = -piece.size_m / 2, piece.size_m / 2
    if corners is not None:
        (x0, y0), (x1, y1) = corners
        points = np.array([(x, y, 0, 1) for x in (x0, x1) for y in (y0, y1)])
        own = (points @ np.linalg.inv(matrix).T)[:, :2]
        low, high = own.min(axis=0), own.max(axis=0)
    part = moved(replace(plane(low, high, piece.size_m), look=piece.look), matrix)
    if corners is not None:
        part.vertices_m[:, 2] = level_m(matrix)
    return part


def _coloured(look: Look, colour: Colour | None) -> Look:
    """A look in a colour of its visual's: it replaces the look's own, and tints its picture."""
    if colour is None:
        return look
    if look.picture is not None:
        (r, g, b), (x, y, z) = look.colour, colour
        colour = r * x, g * y, b * z
    return replace(look, colour=colour, clear=False)


def _surface(part: Part, texture: NDArray[np.uint8]) -> Surface:
    """A part, with its picture's repeats in its texture coordinates.

    Where no face reaches over a picture's edge, each is brought into 0..1, for the atlas.
    """
    vertex, faces = np.arange(len(part.vertices_m)), part.faces
    uv = np.full((len(vertex), 2), 0.5)
    if part.uv is not None and part.look.picture is not None:
        uv = (part.uv - 0.5) * part.look.repeats + 0.5
        corners = uv[faces]
        tile = np.floor(corners.min(axis=1) + _TILE_EPSILON)
        if not (corners.max(axis=1) - tile).max() > 1 + _TILE_EPSILON:
            keys = np.column_stack([faces.ravel(), np.repeat(tile, 3, axis=0)])
            corner, faces = np.unique(keys, axis=0, return_inverse=True)
            vertex = corner[:, 0].astype(np.int64)
            uv = np.clip(uv[vertex] - corner[:, 1:], 0, 1)
    shade = np.ones((len(part.vertices_m), 3)) if part.shade is None else part.shade.clip(0, 1)
    return Surface(
        part.vertices_m[vertex].astype(np.float32),
        faces.reshape(-1, 3).astype(np.int32),
        uv.astype(np.float32),
        shade[vertex].astype(np.float32),
        texture,
    )


def unique(name: str, taken: dict[str, int]) -> str:
    """The name, or with a number if another has it."""
    fresh = name
    while fresh in taken:
        taken[name] += 1
        fresh = f"{name}_{taken[name]}"
    taken[fresh] = 1
    return fresh

"""Mesh files as triangles: COLLADA by pycollada, OBJ and STL by trimesh, in metres, z up.

Both libraries see only what was checked before: its size, and that XML holds no entities.
"""

import codecs
import io
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrchain.errors import SpecError
from vrchain.world.gazebo.dae import check_collada
from vrchain.world.gazebo.files import read_bytes
from vrchain.world.gazebo.limits import MOST_MESH_BYTES, MOST_MESH_NODES, MOST_MESH_TRIANGLES
from vrchain.world.gazebo.materials import HALF, Look, Materials
from vrchain.world.gazebo.mtl import MaterialFiles
from vrchain.world.gazebo.notes import Notes
from vrchain.world.gazebo.xml import Element, check

_KINDS = (".dae", ".obj", ".stl")
_UPRIGHT: dict[str, NDArray[np.float64]] = {
    "Y_UP": np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]]),
    "X_UP": np.array([[0.0, 0, -1, 0], [0, 1, 0, 0], [1, 0, 0, 0], [0, 0, 0, 1]]),
}


@dataclass(frozen=True, eq=False)
class Part:
    """Triangles that look alike. name: of the submesh that they are of.

    vertices_m: (n, 3) float; faces: (m, 3) int, anticlockwise seen from outside; uv: (n, 2) float,
    v upwards, or None; look: the mesh's own; shade: (n, 3) float, colours of vertices, or None.
    """

    name: str
    vertices_m: NDArray[np.float64]
    faces: NDArray[np.int64]
    uv: NDArray[np.float64] | None
    look: Look
    shade: NDArray[np.float64] | None = None


def moved(part: Part, matrix: NDArray[np.float64]) -> Part:
    """A part by a matrix (4, 4); what that mirrors is turned right side out again."""
    vertices = part.vertices_m @ matrix[:3, :3].T + matrix[:3, 3]
    mirrored = np.linalg.det(matrix[:3, :3]) < 0
    return replace(part, vertices_m=vertices, faces=part.faces[:, ::-1] if mirrored else part.faces)


class Meshes:
    """Mesh files, each read once."""

    def __init__(self, materials: Materials, notes: Notes) -> None:
        self._materials, self._notes = materials, notes
        self._files: dict[Path, list[Part]] = {}

    def parts(self, file: Path, element: Element) -> list[Part]:
        """The parts of a mesh file that an element names; none of other kinds. Raises SpecError."""
        if file not in self._files:
            kind = file.suffix.lower()
            if kind not in _KINDS:
                self._notes.add(f"meshes that are none of {', '.join(_KINDS)}, left out", file.name)
                return []
            data = read_bytes(file, MOST_MESH_BYTES)
            try:
                with np.errstate(all="ignore"):
                    parts = list(self._read(kind, data, file, element))
            except SpecError:
                raise
            except Exception as error:  # the libraries raise almost anything on broken files
                reason = " ".join(f"{type(error).__name__}: {error}".split())[:160]
                raise SpecError(
                    f"{file}: expected a mesh of kind {kind[1:].upper()}, got {reason}"
                ) from None
            _check(parts, file)
            cleaned = [_cleaned(part) for part in parts if len(part.faces)]
            if not any(len(part.faces) for part in cleaned):
                raise SpecError(f"{file}: expected a mesh with faces, got none with an area")
            self._files[file] = [part for part in cleaned if len(part.faces)]
        return self._files[file]

    def _read(self, kind: str, data: bytes, file: Path, element: Element) -> Iterable[Part]:
        if kind == ".dae":
            check(data, file)
            return self._collada(data, file, element)
        if kind == ".obj":
            return self._obj(data, file, element)
        return _stl(data, file)

    def _collada(self, data: bytes, file: Path, element: Element) -> list[Part]:
        import collada

        unit_m, up_axis = check_collada(data, file)
        document = collada.Collada(io.BytesIO(data), ignore=[collada.common.DaeError])
        base = np.diag([unit_m, unit_m, unit_m, 1.0])
        if up_axis in _UPRIGHT:
            base = base @ _UPRIGHT[up_axis]
            self._notes.add("COLLADA meshes that were turned upright", file.name)
        for error in document.errors:
            self._notes.add("broken parts of COLLADA meshes, left out", f"{file.name}: {error}")
        nodes = [] if document.scene is None else document.scene.nodes
        found = list(self._instances(nodes, base, file, element))
        if document.errors and not found:
            raise SpecError(f"{file}: expected a COLLADA mesh, got {document.errors[0]}")
        return found

    def _instances(
        self, nodes: Sequence[Any], base: NDArray[np.float64], file: Path, element: Element
    ) -> Iterator[Part]:
        """The parts that nodes show, by ``base`` to the mesh's frame in metres."""
        import collada

        looks: dict[str, Look] = {}
        budget = _Budget(file)
        for node, matrix, name in _geometry_nodes(nodes, base, budget):
            symbols = {m.symbol: m.target for m in node.materials}
            if isinstance(node, collada.scene.GeometryNode):
                geometry = node.geometry
            else:
                self._notes.add("animated meshes, drawn as they are at rest", file.name)
                geometry, matrix = _at_rest(node.controller, base, matrix)
            for primitive in geometry.primitives:
                if isinstance(primitive, collada.polylist.Polylist):  # polygons, too
                    primitive = primitive.triangleset()
                if not isinstance(primitive, collada.triangleset.TriangleSet):
                    self._notes.add("lines in meshes", file.name)
                    continue
                if primitive.vertex is None or not len(primitive.vertex_index):
                    continue
                budget.triangles(len(primitive.vertex_index))
                _check_numbers(primitive, file)
                material = symbols.get(primitive.material)
                key = "" if material is None else material.id
                if key not in looks:
                    looks[key] = self._collada_look(material, file, element)
                yield moved(_triangles(primitive, name, looks[key]), matrix)

    def _collada_look(self, material: Any, file: Path, element: Element) -> Look:
        import collada

        if material is None or material.effect is None:
            return Look()
        effect = material.effect
        masked = isinstance(effect.transparent, collada.material.Map)
        if isinstance(effect.diffuse, collada.material.Map):
            picture = self._materials.picture(
                effect.diffuse.sampler.surface.image.path, element, [file.parent]
            )
            return Look(picture=picture, solid_above=HALF if masked else None)
        if effect.diffuse is None:
            return Look()
        r, g, b = (float(v) for v in effect.diffuse[:3])
        if not np.isfinite((r, g, b)).all():
            raise SpecError(f"{file}: the colour of the effect {effect.id!r} is no finite number")
        return Look((r, g, b))

    def _obj(self, data: bytes, file: Path, element: Element) -> Iterator[Part]:
        import trimesh
        from trimesh.exchange.obj import load_obj

        data = _plain_lines(data)
        if data.count(b"\nf") > MOST_MESH_TRIANGLES:
            raise SpecError(f"{file}: expected at most {MOST_MESH_TRIANGLES} faces")
        looks = MaterialFiles(self._materials, self._notes, file, element).looks(data)
        # Names of materials only: trimesh would open pictures, we do that ourselves.
        names = "\n".join(f"newmtl {name}" for name in looks).encode()
        stream = trimesh.util.wrap_as_stream(b"mtllib -\n" + data)
        loaded = load_obj(stream, resolver={"-": names}, split_groups=True)
        for name, mesh in loaded.get("geometry", {}).items():
            visual = mesh.get("visual")
            material = getattr(getattr(visual, "material", None), "name", None)
            uv = getattr(visual, "uv", None)
            colours = mesh.get("vertex_colors")
            group = name.removesuffix(f"_{material}") if material else name
            yield Part(
                group,
                np.asarray(mesh["vertices"], dtype=float),
                _fans(np.asarray(mesh["faces"], dtype=np.int64), file),
                None if uv is None else np.asarray(uv, dtype=float)[:, :2],
                looks.get(material or "", Look()),
                None if colours is None else np.asarray(colours, dtype=float)[:, :3],
            )


def _plain_lines(data: bytes) -> bytes:
    """An OBJ as trimesh wants it: no byte order mark, no indents, no tabs, lines by \\n alone."""
    whole = data.removeprefix(codecs.BOM_UTF8).replace(b"\\\r\n", b" ").replace(b"\\\n", b" ")
    return b"\n".join(line.strip().replace(b"\t", b" ") for line in whole.splitlines())


def _fans(faces: NDArray[np.int64], file: Path) -> NDArray[np.int64]:
    """Triangles (k, 3) of faces (m, n), which trimesh leaves whole where all have n corners."""
    m, n = faces.shape
    if m * (n - 2) > MOST_MESH_TRIANGLES:
        raise SpecError(f"{file}: expected at most {MOST_MESH_TRIANGLES} triangles")
    corners = np.array([(0, k, k + 1) for k in range(1, n - 1)], dtype=np.int64)
    return faces[:, corners.reshape(-1, 3)].reshape(-1, 3)


def _stl(data: bytes, file: Path) -> Iterator[Part]:
    import trimesh
    from trimesh.exchange.stl import load_stl

    loaded = load_stl(io.BytesIO(data))
    solids = list(loaded.get("geometry", {"": loaded}).values())
    size = 84 + 50 * int.from_bytes(data[80:84], "little")
    if not solids and len(data) != size:
        raise SpecError(
            f"{file}: expected an STL, as text up to its endsolid or of {size} bytes as its head "
            f"says, got {len(data)} bytes: is it cut off?"
        )
    for solid in solids:
        broken = ~np.isfinite(solid["vertices"][solid["faces"]]).all(axis=(1, 2))
        if broken.any():
            raise SpecError(f"{file}: a corner of face {broken.argmax() + 1} is no finite number")
        mesh = trimesh.Trimesh(solid["vertices"], solid["faces"])  # joins corners
        faces = np.asarray(mesh.faces, dtype=np.int64)
        yield Part("", np.asarray(mesh.vertices, dtype=float), faces, None, Look())


class _Budget:
    """Counts what a COLLADA file unfolds to: nodes may be used again and again."""

    def __init__(self, file: Path) -> None:
        self._file, self._nodes, self._triangles = file, 0, 0

    def node(self) -> None:
        self._nodes += 1
        if self._nodes > MOST_MESH_NODES:
            raise SpecError(f"{self._file}: expected at most {MOST_MESH_NODES} nodes in use")

    def triangles(self, count: int) -> None:
        self._triangles += count
        if self._triangles > MOST_MESH_TRIANGLES:
            raise SpecError(f"{self._file}: expected at most {MOST_MESH_TRIANGLES} triangles")


def _geometry_nodes(
    nodes: Sequence[Any], matrix: NDArray[np.float64], budget: _Budget, name: str = ""
) -> Iterator[tuple[Any, NDArray[np.float64], str]]:
    """What nodes draw: instance, matrix to the file's frame, and the name of the node it is in."""
    import collada

    for node in nodes:
        budget.node()
        if isinstance(node, collada.scene.NodeNode):
            node = node.node
        if isinstance(node, collada.scene.Node):
            below = matrix @ np.asarray(node.matrix, dtype=float)
            yield from _geometry_nodes(node.children, below, budget, node.name or node.id or "")
        elif isinstance(node, (collada.scene.GeometryNode, collada.scene.ControllerNode)):
            yield node, matrix, name


def _at_rest(
    controller: Any, base: NDArray[np.float64], matrix: NDArray[np.float64]
) -> tuple[Any, NDArray[np.float64]]:
    """The geometry that is animated, and its matrix; bones carry a skin, so its node does not."""
    import collada

    if isinstance(controller, collada.controller.Skin):
        return controller.geometry, base @ np.asarray(controller.bind_shape_matrix, dtype=float)
    return controller.source_geometry, matrix


def _check_numbers(primitive: Any, file: Path) -> None:
    """Raise SpecError for what is no number, where pycollada puts 0, and for negative indices."""
    for kind, what in (("VERTEX", "corner"), ("TEXCOORD", "texture coordinate")):
        for *_, source in primitive.sources.get(kind, [])[:1]:
            for array in source.xmlnode.iter():
                if array.tag.endswith("float_array") and "nan" in (array.text or "").lower():
                    raise SpecError(f"{file}: a {what} in {source.id!r} is not a finite number")
    for used in (primitive.vertex_index, primitive.normal_index, *primitive.texcoord_indexset[:1]):
        if used is not None and used.min() < 0:
            named = primitive.sources["VERTEX"][0][4].id
            raise SpecError(f"{file}: a face on {named!r} has an index of {used.min()}, below 0")


def _triangles(primitive: Any, name: str, look: Look) -> Part:
    """A set of triangles; corners alike in place, normal and texture coordinates are shared."""
    place = np.asarray(primitive.vertex_index, dtype=np.int64)
    columns = [place.ravel()]
    normal = None
    if primitive.normal is not None and primitive.normal_index is not None:
        normal = np.asarray(primitive.normal_index, dtype=np.int64)
        columns.append(normal.ravel())
    uv = None
    if len(primitive.texcoordset):
        coordinates = np.asarray(primitive.texcoordset[0], dtype=float)[:, :2]
        at = np.asarray(primitive.texcoord_indexset[0], dtype=np.int64)
        columns.append(at.ravel())
    corners, shared = np.unique(np.stack(columns, axis=1), axis=0, return_inverse=True)
    vertices = np.asarray(primitive.vertex, dtype=float)
    if len(primitive.texcoordset):
        uv = coordinates[corners[:, -1]]
    faces = shared.reshape(-1, 3)
    if normal is not None:  # faces whose corners run against their normals are turned
        a, b, c = np.moveaxis(vertices[place], 1, 0)
        facing = np.asarray(primitive.normal, dtype=float)[normal].sum(axis=1)
        against = np.einsum("ij,ij->i", np.cross(b - a, c - a), facing) < 0
        faces = np.where(against[:, None], faces[:, ::-1], faces)
    return Part(name, vertices[corners[:, 0]], faces, uv, look)


def _cleaned(part: Part) -> Part:
    """Without faces that have no area, or lie on another one and look the same, front or back."""
    _, place = np.unique(part.vertices_m, axis=0, return_inverse=True)
    looks = part.vertices_m[:, :2] * 0 if part.uv is None else part.uv
    _, alike = np.unique(np.column_stack([place.ravel(), looks]), axis=0, return_inverse=True)
    corners = np.sort(place.ravel()[part.faces], axis=1)
    has_area = (np.diff(corners, axis=1) > 0).all(axis=1)
    _, first = np.unique(np.sort(alike.ravel()[part.faces], axis=1), axis=0, return_index=True)
    keep = np.zeros(len(corners), dtype=bool)
    keep[first] = True
    return replace(part, faces=part.faces[keep & has_area])


def _check(parts: list[Part], file: Path) -> None:
    if not sum(len(part.faces) for part in parts):
        raise SpecError(f"{file}: expected a mesh with faces, got none")
    for part in parts:
        if part.faces.min(initial=0) < 0 or part.faces.max(initial=-1) >= len(part.vertices_m):
            raise SpecError(f"{file}: a face of {part.name!r} has a corner that is not there")
        if not np.isfinite(part.vertices_m).all():
            raise SpecError(f"{file}: a corner of {part.name!r} is not a finite number")
        for what, values in (("texture coordinate", part.uv), ("colour", part.shade)):
            if values is not None and not np.isfinite(values).all():
                raise SpecError(f"{file}: a {what} of {part.name!r} is not a finite number")

"""COLLADA files, read by pycollada.

They are looked at before it takes them for something else or fills memory.
"""

import io
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from vrchain.errors import SpecError
from vrchain.world.gazebo.materials import Look
from vrchain.world.gazebo.parts import MOST_MESH_NODES, MOST_MESH_TRIANGLES, MeshFile, Part, moved
from vrchain.world.gazebo.scripts import HALF
from vrchain.world.gazebo.xml import checked

_LUMINANCE = (0.212671, 0.715160, 0.072169)  # of ITU-R BT.709, as the specification has it
_CLEAR_BELOW = 0.5  # of alpha: as for a visual's <transparency>


class Collada(MeshFile):
    """A COLLADA file."""

    def parts(self, data: bytes) -> list[Part]:
        """What it shows, in metres, z up whatever its <up_axis>, as in Gazebo. Raises SpecError."""
        import collada

        data = checked(data, self.file)
        unit_m = check_collada(data, self.file)
        document = collada.Collada(io.BytesIO(data), ignore=[collada.common.DaeError])
        base = np.diag([unit_m, unit_m, unit_m, 1.0])
        for error in document.errors:
            self.notes.add("broken parts of COLLADA meshes, left out", f"{self.file.name}: {error}")
        nodes = [] if document.scene is None else document.scene.nodes
        found = list(self._shown(nodes, base))
        if document.errors and not found:
            raise SpecError(f"{self.file}: expected a COLLADA mesh, got {document.errors[0]}")
        return found

    def _shown(self, nodes: Sequence[Any], base: NDArray[np.float64]) -> Iterator[Part]:
        """The parts that nodes show, by ``base`` to the mesh's frame in metres."""
        import collada

        looks: dict[str, Look] = {}
        triangles = 0
        for used, (node, matrix, name) in enumerate(_unfolded(nodes, base), start=1):
            if used > MOST_MESH_NODES:
                raise SpecError(f"{self.file}: expected at most {MOST_MESH_NODES} nodes in use")
            if isinstance(node, collada.scene.ControllerNode):
                self.notes.add("animated meshes, drawn as they are at rest", self.file.name)
                geometry, matrix = _at_rest(node.controller, base, matrix)
            elif isinstance(node, collada.scene.GeometryNode):
                geometry = node.geometry
            else:
                continue
            materials = {m.symbol: m for m in node.materials}
            for primitive in geometry.primitives:
                if isinstance(primitive, collada.polylist.Polylist):  # polygons, too
                    primitive = primitive.triangleset()
                if not isinstance(primitive, collada.triangleset.TriangleSet):
                    self.notes.add("lines in meshes", self.file.name)
                    continue
                if primitive.vertex is None or not len(primitive.vertex_index):
                    continue
                triangles += len(primitive.vertex_index)
                if triangles > MOST_MESH_TRIANGLES:
                    raise SpecError(
                        f"{self.file}: expected at most {MOST_MESH_TRIANGLES} triangles"
                    )
                bound = materials.get(primitive.material)
                material = None if bound is None else bound.target
                key = "" if material is None else material.id
                if key not in looks:
                    looks[key] = self._look(material)
                uv_set = _uv_set(bound, primitive)
                _check_numbers(primitive, self.file, uv_set)
                yield moved(_triangles(primitive, name, looks[key], uv_set), matrix)

    def _look(self, material: Any) -> Look:
        import collada

        if material is None or material.effect is None or material.effect.diffuse is None:
            return Look()
        effect = material.effect
        clear = _alpha(effect) < _CLEAR_BELOW
        if isinstance(effect.diffuse, collada.material.Map):
            path = effect.diffuse.sampler.surface.image.path
            picture = self.materials.picture(path, self.element, [self.file.parent])
            masked = isinstance(effect.transparent, collada.material.Map)
            return Look(picture=picture, solid_above=HALF if masked else None, clear=clear)
        r, g, b = (float(v) for v in effect.diffuse[:3])
        if not np.isfinite((r, g, b)).all():
            raise SpecError(
                f"{self.file}: the colour of the effect {effect.id!r} is no finite number"
            )
        return Look((r, g, b), clear=clear)


def _alpha(effect: Any) -> float:
    """How opaque an effect of one colour is, in 0..1; 1 where it does not say by which rule."""
    shading = "{*}profile_COMMON/{*}technique/*/"
    transparent = effect.xmlnode.find(f"{shading}{{*}}transparent")
    if transparent is None:
        return 1.0
    share = effect.xmlnode.findtext(f"{shading}{{*}}transparency/{{*}}float") or "1"
    try:
        r, g, b, a = (float(v) for v in (transparent.findtext("{*}color") or "").split())
        amount = float(share)
    except ValueError:
        return 1.0
    luminance = float(np.dot(_LUMINANCE, (r, g, b)))
    shown = {
        "A_ONE": a * amount,
        "A_ZERO": 1 - a * amount,
        "RGB_ZERO": 1 - luminance * amount,
        "RGB_ONE": luminance * amount,
    }
    return shown.get(transparent.get("opaque", ""), 1.0)


def _uv_set(bound: Any, primitive: Any) -> int:
    """Which of a primitive's texture coordinates its bound material's picture is laid by."""
    effect = None if bound is None or bound.target is None else bound.target.effect
    wanted = getattr(effect and effect.diffuse, "texcoord", None)
    sets = [source[3] or "0" for source in primitive.sources.get("TEXCOORD", [])]
    for semantic, input_semantic, number in [] if bound is None else bound.inputs:
        if semantic == wanted and input_semantic == "TEXCOORD" and (number or "0") in sets:
            return sets.index(number or "0")
    return 0


def check_collada(data: bytes, file: Path) -> float:
    """Metres per unit. Raises SpecError.

    data: XML without a DTD.
    """
    root = ElementTree.fromstring(data)
    for geometry in root.iterfind("{*}library_geometries/{*}geometry"):
        where = f"{file}: the geometry {geometry.get('id', '')!r}"
        for mesh in geometry.iterfind("{*}mesh"):
            known = {f"#{source.get('id')}" for source in mesh.iterfind("{*}source")}
            for given in mesh.iterfind("{*}vertices/{*}input"):
                if given.get("source") not in known:
                    raise SpecError(
                        f"{where}: its <vertices> name the source "
                        f"{given.get('source', '')[:60]!r}, which it does not have"
                    )
            for polygons in mesh.iterfind("{*}polylist"):
                _check_counts(polygons, where)
    unit = root.find("{*}asset/{*}unit")
    meter = "1" if unit is None else unit.get("meter", "1")
    try:
        unit_m = float(meter)
    except ValueError:
        unit_m = math.nan
    if not 0 < unit_m < math.inf:
        raise SpecError(f'{file}: <unit meter="{meter[:60]}">: expected metres, more than 0')
    return unit_m


def _check_counts(polygons: ElementTree.Element, where: str) -> None:
    """pycollada makes room for as many corners as <vcount> says, whatever <p> holds."""
    try:
        counts, indices = (
            np.fromstring((polygons.findtext(tag) or "").strip(), dtype=float, sep=" ")
            for tag in ("{*}vcount", "{*}p")
        )
        offsets = [int(given.get("offset", "0")) for given in polygons.iterfind("{*}input")]
    except ValueError:
        raise SpecError(
            f"{where}: expected whole numbers in the <vcount>, <p> and offsets of its <polylist>"
        ) from None
    named = counts.sum() * (1 + max(offsets, default=0))
    if counts.min(initial=0) < 0 or named > len(indices):
        raise SpecError(
            f"{where}: the <vcount> of its <polylist> names {named:.0f} indices, its <p> has "
            f"{len(indices)}"
        )


def _unfolded(
    nodes: Sequence[Any], matrix: NDArray[np.float64], name: str = ""
) -> Iterator[tuple[Any, NDArray[np.float64], str]]:
    """Nodes and what they hold: each, its matrix to the file's frame, and its parent's name."""
    import collada

    for node in nodes:
        yield node, matrix, name
        if isinstance(node, collada.scene.NodeNode):
            node = node.node
        if isinstance(node, collada.scene.Node):
            below = matrix @ np.asarray(node.matrix, dtype=float)
            yield from _unfolded(node.children, below, node.name or node.id or "")


def _at_rest(
    controller: Any, base: NDArray[np.float64], matrix: NDArray[np.float64]
) -> tuple[Any, NDArray[np.float64]]:
    """The geometry that is animated, and its matrix; bones carry a skin, so its node does not."""
    import collada

    if isinstance(controller, collada.controller.Skin):
        return controller.geometry, base @ np.asarray(controller.bind_shape_matrix, dtype=float)
    return controller.source_geometry, matrix


def _check_numbers(primitive: Any, file: Path, uv_set: int) -> None:
    """Raise SpecError for what is no number, where pycollada puts 0, and for negative indices."""
    used_sets = (("VERTEX", "corner", 0), ("TEXCOORD", "texture coordinate", uv_set))
    for kind, what, number in used_sets:
        for *_, source in primitive.sources.get(kind, [])[number : number + 1]:
            for array in source.xmlnode.iter():
                if array.tag.endswith("float_array") and "nan" in (array.text or "").lower():
                    raise SpecError(f"{file}: a {what} in {source.id!r} is not a finite number")
    uv_index = primitive.texcoord_indexset[uv_set : uv_set + 1]
    for used in (primitive.vertex_index, primitive.normal_index, *uv_index):
        if used is not None and used.min() < 0:
            named = primitive.sources["VERTEX"][0][4].id
            raise SpecError(f"{file}: a face on {named!r} has an index of {used.min()}, below 0")


def _triangles(primitive: Any, name: str, look: Look, uv_set: int) -> Part:
    """A set of triangles; corners alike in place, normal and texture coordinates are shared.

    Faces whose corners run against their normals are turned.
    """
    place = np.asarray(primitive.vertex_index, dtype=np.int64)
    vertices = np.asarray(primitive.vertex, dtype=float)
    columns, against = [place], np.zeros(len(place), dtype=bool)
    if primitive.normal is not None and primitive.normal_index is not None:
        normal = np.asarray(primitive.normal_index, dtype=np.int64)
        columns.append(normal)
        a, b, c = np.moveaxis(vertices[place], 1, 0)
        facing = np.asarray(primitive.normal, dtype=float)[normal].sum(axis=1)
        against = np.einsum("ij,ij->i", np.cross(b - a, c - a), facing) < 0
    if len(primitive.texcoordset):
        columns.append(np.asarray(primitive.texcoord_indexset[uv_set], dtype=np.int64))
    keys = np.stack([column.ravel() for column in columns], axis=1)
    corners, shared = np.unique(keys, axis=0, return_inverse=True)
    uv = None
    if len(primitive.texcoordset):
        uv = np.asarray(primitive.texcoordset[uv_set], dtype=float)[:, :2][corners[:, -1]]
    faces = shared.reshape(-1, 3)
    faces[against] = faces[against][:, ::-1]
    return Part(vertices[corners[:, 0]], faces, uv, look, name)

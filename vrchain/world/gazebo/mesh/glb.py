"""GLB files, read by trimesh; as Gazebo does, without a turn: glTF says that y is up.

Sizes are looked at before it makes room for them, and pictures are read by us.
"""

import io
import json
import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrchain.errors import SpecError
from vrchain.world.gazebo.materials import Embedded, Look
from vrchain.world.gazebo.parts import MOST_MESH_NODES, MOST_MESH_TRIANGLES, MeshFile, Part, moved
from vrchain.world.gazebo.scripts import HALF

_MAGIC, _JSON, _BIN = 0x46546C67, 0x4E4F534A, 0x004E4942
_COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}
_MOST_NUMBERS = 16 * MOST_MESH_TRIANGLES


class Glb(MeshFile):
    """A GLB file."""

    def parts(self, data: bytes) -> Iterator[Part]:
        """What it shows, in metres. Raises SpecError, and others on what is broken."""
        from trimesh.exchange.gltf import load_glb

        document, binary = _chunks(data)
        self._check(document)
        looks = [self._look(m, document, binary) for m in document.get("materials", [])]
        if document.get("skins") or document.get("animations"):
            self.notes.add("animated meshes, drawn as they are at rest", self.file.name)
        # Numbers of materials only: trimesh would open pictures, we do that ourselves.
        bare = {k: v for k, v in document.items() if k not in ("images", "textures", "samplers")}
        bare["materials"] = [{"name": str(k)} for k in range(len(looks))]
        loaded = load_glb(io.BytesIO(_glb(bare, binary)))
        named = {node.get("name") for node in document.get("nodes", [])}
        places: dict[str, NDArray[np.float64]] = {loaded["base_frame"]: np.eye(4)}
        triangles = 0
        for edge in loaded["graph"]:  # every node before those below it
            above = edge["frame_from"]
            places[edge["frame_to"]] = place = places[above] @ edge["matrix"]
            mesh = loaded["geometry"].get(edge.get("geometry"))
            if mesh is None:
                continue
            if "faces" not in mesh:
                self.notes.add("lines in meshes", self.file.name)
                continue
            triangles += len(mesh["faces"])
            if triangles > MOST_MESH_TRIANGLES:
                raise SpecError(f"{self.file}: expected at most {MOST_MESH_TRIANGLES} triangles")
            # The primitives of one mesh lie below its node, under names of their own.
            several = edge["frame_to"].startswith(f"{above}_") and edge["frame_to"] not in named
            visual = mesh.get("visual")
            uv = None if visual is None or visual.uv is None else np.asarray(visual.uv, float)
            part = Part(
                np.asarray(mesh["vertices"], dtype=float),
                np.asarray(mesh["faces"], dtype=np.int64),
                uv,
                Look() if visual is None else looks[int(visual.material.name)],
                above if several else edge["frame_to"],
            )
            yield moved(part, place)

    def _check(self, document: Any) -> None:
        """Raise SpecError for more than a mesh needs; trimesh makes room for what is said."""
        nodes = document.get("nodes", [])
        edges = sum(len(node.get("children", [])) for node in nodes)
        if max(len(nodes), edges) > MOST_MESH_NODES:
            raise SpecError(f"{self.file}: expected at most {MOST_MESH_NODES} nodes")
        numbers = 0
        for accessor in document.get("accessors", []):
            count = accessor["count"]
            if not isinstance(count, int) or count < 0:
                raise SpecError(f"{self.file}: expected whole numbers of values, got {count!r}")
            numbers += count * _COLUMNS[accessor["type"]]
        if numbers > _MOST_NUMBERS:
            raise SpecError(f"{self.file}: expected at most {_MOST_NUMBERS} numbers")
        if any("uri" in buffer for buffer in document.get("buffers", [])):
            raise SpecError(f"{self.file}: expected all its data in the file itself")

    def _look(self, material: Any, document: Any, binary: bytes) -> Look:
        """The base colour of a material, and its picture."""
        base = material.get("pbrMetallicRoughness", {})
        r, g, b, _ = (float(v) for v in base.get("baseColorFactor", (1, 1, 1, 1)))
        if not np.isfinite((r, g, b)).all():
            raise SpecError(f"{self.file}: the colour of a material is no finite number")
        solid = {"MASK": int(255 * float(material.get("alphaCutoff", 0.5))) - 1, "BLEND": HALF}
        look = Look((r, g, b), solid_above=solid.get(material.get("alphaMode", "OPAQUE")))
        if "baseColorTexture" not in base:
            return Look(look.colour)
        texture = document["textures"][base["baseColorTexture"]["index"]]
        if "source" not in texture:
            self.notes.add("pictures of other kinds in meshes, left out", self.file.name)
            return Look(look.colour)
        image = document["images"][texture["source"]]
        if "bufferView" not in image:
            picture = self.materials.picture(str(image["uri"]), self.element, [self.file.parent])
            return Look(look.colour, picture, look.solid_above)
        view = document["bufferViews"][image["bufferView"]]
        start = int(view.get("byteOffset", 0))
        held = Embedded(self.file, binary[start : start + int(view["byteLength"])])
        return Look(look.colour, held, look.solid_above)


def _chunks(data: bytes) -> tuple[Any, bytes]:
    """The document of a GLB, and its binary chunk, empty if it has none."""
    magic, version, _, size, kind = struct.unpack_from("<5I", data)
    if (magic, version, kind) != (_MAGIC, 2, _JSON):
        raise ValueError("no head of a GLB of version 2")
    document = json.loads(data[20 : 20 + size])
    if 28 + size > len(data):
        return document, b""
    length, kind = struct.unpack_from("<2I", data, 20 + size)
    return document, data[28 + size : 28 + size + length] if kind == _BIN else b""


def _glb(document: Any, binary: bytes) -> bytes:
    told = json.dumps(document).encode()
    told += b" " * (-len(told) % 4)
    held = binary + bytes(-len(binary) % 4)
    size = 28 + len(told) + len(held)
    head = struct.pack("<5I", _MAGIC, 2, size, len(told), _JSON)
    return head + told + struct.pack("<2I", len(held), _BIN) + held

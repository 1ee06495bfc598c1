"""Mesh files as triangles in metres, z up: COLLADA by pycollada, the others by trimesh.

Both libraries see only what was checked before: its size, and that XML holds no entities.
"""

import io
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from vrchain.errors import SpecError
from vrchain.world.gazebo.files import Notes, read_bytes
from vrchain.world.gazebo.materials import Materials
from vrchain.world.gazebo.mesh.dae import Collada
from vrchain.world.gazebo.mesh.glb import Glb
from vrchain.world.gazebo.mesh.obj import Obj
from vrchain.world.gazebo.parts import MeshFile, Part, cleaned
from vrchain.world.gazebo.xml import Element

MOST_MESH_BYTES = 64 << 20


class Stl(MeshFile):
    """An STL file, text or binary."""

    def parts(self, data: bytes) -> Iterator[Part]:
        """What it shows. Raises SpecError."""
        import trimesh
        from trimesh.exchange.stl import load_stl

        loaded = load_stl(io.BytesIO(data))
        solids = list(loaded.get("geometry", {"": loaded}).values())
        size = 84 + 50 * int.from_bytes(data[80:84], "little")
        if not solids and len(data) != size:
            raise SpecError(
                f"{self.file}: expected an STL, as text up to its endsolid or of {size} bytes as "
                f"its head says, got {len(data)} bytes: is it cut off?"
            )
        for solid in solids:
            broken = ~np.isfinite(solid["vertices"][solid["faces"]]).all(axis=(1, 2))
            if broken.any():
                face = broken.argmax() + 1
                raise SpecError(f"{self.file}: a corner of face {face} is no finite number")
            mesh = trimesh.Trimesh(solid["vertices"], solid["faces"])  # joins corners
            faces = np.asarray(mesh.faces, dtype=np.int64)
            yield Part(np.asarray(mesh.vertices, dtype=float), faces)


_KINDS: dict[str, type[Collada | Obj | Stl | Glb]] = {
    ".dae": Collada, ".obj": Obj, ".stl": Stl, ".glb": Glb
}  # fmt: skip
_LARGEST = 1e6  # of texture coordinates and colours


class Meshes:
    """Mesh files, each read once."""

    def __init__(self, materials: Materials, notes: Notes) -> None:
        self._materials, self._notes = materials, notes
        self._files: dict[Path, list[Part]] = {}

    def parts(self, file: Path, element: Element) -> list[Part]:
        """The parts of a mesh file that an element names; none, with a note, if it is broken."""
        if file not in self._files:
            try:
                self._files[file] = self._read(file, element)
            except SpecError as error:
                self._notes.lose("meshes that cannot be read", str(error))
                self._files[file] = []
        return self._files[file]

    def _read(self, file: Path, element: Element) -> list[Part]:
        kind = file.suffix.lower()
        if kind not in _KINDS:
            self._notes.add(f"meshes that are none of {', '.join(_KINDS)}, left out", file.name)
            return []
        data = read_bytes(file, MOST_MESH_BYTES)
        mesh = _KINDS[kind](file, element, self._materials, self._notes)
        try:
            with np.errstate(all="ignore"):
                parts = list(mesh.parts(data))
        except SpecError:
            raise
        except Exception as error:  # the libraries raise almost anything on broken files
            reason = " ".join(f"{type(error).__name__}: {error}".split())[:160]
            raise SpecError(
                f"{file}: expected a mesh of kind {kind[1:].upper()}, got {reason}"
            ) from None
        _check(parts, file)
        clean = [cleaned(part) for part in parts if len(part.faces)]
        kept = [part for part in clean if len(part.faces)]
        if not kept:
            raise SpecError(f"{file}: expected a mesh with faces, got none with an area")
        return kept


def _check(parts: list[Part], file: Path) -> None:
    if not sum(len(part.faces) for part in parts):
        raise SpecError(f"{file}: expected a mesh with faces, got none")
    for part in parts:
        if part.faces.min(initial=0) < 0 or part.faces.max(initial=-1) >= len(part.vertices_m):
            raise SpecError(f"{file}: a face of {part.name!r} has a corner that is not there")
        if not np.isfinite(part.vertices_m).all():
            raise SpecError(f"{file}: a corner of {part.name!r} is not a finite number")
        for what, values in (("texture coordinate", part.uv), ("colour", part.shade)):
            if values is not None and not (np.abs(values) <= _LARGEST).all():
                raise SpecError(f"{file}: a {what} of {part.name!r} is beyond {_LARGEST:g}")

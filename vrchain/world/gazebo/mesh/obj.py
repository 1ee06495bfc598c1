"""OBJ files and their material files, read by trimesh and by us."""

import codecs
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vrchain.errors import SpecError
from vrchain.world.gazebo.files import read_bytes
from vrchain.world.gazebo.materials import Look
from vrchain.world.gazebo.parts import MOST_MESH_TRIANGLES, MeshFile, Part
from vrchain.world.gazebo.scripts import HALF, MOST_SCRIPT_BYTES, WHITE, Colour, floats

_OPTION = re.compile(
    r"-(?:[ost](?:\s+[-+]?[\d.]+(?:e[-+]?\d+)?){1,3}|mm\s+\S+\s+\S+|[a-z]+\s+\S+)\s+"
)


class Obj(MeshFile):
    """An OBJ file."""

    def parts(self, data: bytes) -> Iterator[Part]:
        """What it shows, a part a group and material. Raises SpecError."""
        import trimesh
        from trimesh.exchange.obj import load_obj

        data = _plain_lines(data)
        if data.count(b"\nf") > MOST_MESH_TRIANGLES:
            raise SpecError(f"{self.file}: expected at most {MOST_MESH_TRIANGLES} faces")
        looks = self._looks(data)
        # Names of materials only: trimesh would open pictures, we do that ourselves.
        names = "\n".join(f"newmtl {name}" for name in looks).encode()
        stream = trimesh.util.wrap_as_stream(b"mtllib -\n" + data)
        loaded = load_obj(stream, resolver={"-": names}, split_groups=True)
        for name, mesh in loaded.get("geometry", {}).items():
            visual = mesh.get("visual")
            material = getattr(getattr(visual, "material", None), "name", None)
            uv = getattr(visual, "uv", None)
            colours = mesh.get("vertex_colors")
            yield Part(
                np.asarray(mesh["vertices"], dtype=float),
                _fans(np.asarray(mesh["faces"], dtype=np.int64), self.file),
                None if uv is None else np.asarray(uv, dtype=float)[:, :2],
                looks.get(material or "", Look()),
                name.removesuffix(f"_{material}") if material else name,
                None if colours is None else np.asarray(colours, dtype=float)[:, :3],
            )

    def _looks(self, data: bytes) -> dict[str, Look]:
        """The look of every material in use, by name; white, with a note, where it is unknown."""
        known: dict[str, Look] = {}
        for line in dict.fromkeys(_after(data, "mtllib")):
            # A line is one name with blanks, or else several names.
            for name in [line] if self._beside(line) else line.split():
                path = self._beside(name)
                if path is None:
                    self.notes.lose("material files that are missing", name)
                else:
                    known |= self._material_file(path)
        used = dict.fromkeys(_after(data, "usemtl"))
        for name in used:
            if name not in known:
                self.notes.add("materials of meshes that are missing, drawn white", name)
        return {name: known.get(name, Look()) for name in used}

    def _beside(self, name: str) -> Path | None:
        return self.materials.beside(name, self.file.parent, self.element)

    def _material_file(self, file: Path) -> dict[str, Look]:
        looks: dict[str, Look] = {}
        name = ""
        text = read_bytes(file, MOST_SCRIPT_BYTES).removeprefix(codecs.BOM_UTF8)
        for number, line in enumerate(text.decode("utf-8", errors="replace").splitlines(), 1):
            word, _, rest = line.strip().replace("\t", " ").partition(" ")
            word, rest = word.lower(), rest.strip()
            if word == "newmtl":
                name = rest
                looks[name] = Look()
            elif name and rest:
                looks[name] = self._with(looks[name], word, rest, f"{file}:{number}")
        return looks

    def _with(self, look: Look, word: str, rest: str, where: str) -> Look:
        """A look with one more line of its material."""
        if word == "kd" and look.picture is None:
            return replace(look, colour=self._colour(rest.split(), where))
        if word == "map_kd":
            bare = rest
            while found := _OPTION.match(bare):
                bare = bare[found.end() :]
            if bare != rest:
                self.notes.add("options of pictures in material files", where)
            picture = self.materials.picture(bare, self.element, [self.file.parent])
            if picture is not None:  # a picture has its colour, whatever Kd says
                return Look(picture=picture, solid_above=look.solid_above)
        if word == "map_d":
            return replace(look, solid_above=HALF)
        return look

    def _colour(self, words: list[str], where: str) -> Colour:
        if words[0] in ("spectral", "xyz"):
            self.notes.add("colours that are not RGB, drawn white", where)
            return WHITE
        if len(words) == 2:
            raise SpecError(f"{where}: expected one or three numbers after Kd, got {words}")
        return floats(words[:3] if len(words) > 2 else words * 3, where)


def _after(data: bytes, word: str) -> Iterator[str]:
    """The rest of every line of an OBJ that starts with a word."""
    for found in re.finditer(rb"^" + word.encode() + rb" +(.+)$", data, re.MULTILINE):
        yield found[1].decode("utf-8", errors="replace")


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

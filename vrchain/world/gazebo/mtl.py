"""The material files of an OBJ."""

import codecs
import re
from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from vrchain.errors import SpecError
from vrchain.world.gazebo.files import read_bytes
from vrchain.world.gazebo.limits import MOST_SCRIPT_BYTES
from vrchain.world.gazebo.materials import HALF, Colour, Look, Materials, floats
from vrchain.world.gazebo.notes import Notes
from vrchain.world.gazebo.xml import Element

_OPTION = re.compile(
    r"-(?:[ost](?:\s+[-+]?[\d.]+(?:e[-+]?\d+)?){1,3}|mm\s+\S+\s+\S+|[a-z]+\s+\S+)\s+"
)


class MaterialFiles:
    """Reads what an OBJ names by mtllib. element: of the world, that names the OBJ."""

    def __init__(self, materials: Materials, notes: Notes, file: Path, element: Element) -> None:
        self._materials, self._notes = materials, notes
        self._file, self._element = file, element

    def looks(self, data: bytes) -> dict[str, Look]:
        """The look of every material that an OBJ uses, by name; white, with a note, if unknown."""
        known: dict[str, Look] = {}
        for path in self._named(_after(data, "mtllib")):
            known |= self._read(path)
        used = dict.fromkeys(_after(data, "usemtl"))
        for name in used:
            if name not in known:
                self._notes.add("materials of meshes that are missing, drawn white", name)
        return {name: known.get(name, Look()) for name in used}

    def _named(self, lines: Iterable[str]) -> Iterator[Path]:
        """The files of mtllib lines: each line is one name with blanks, or else several names."""
        for line in dict.fromkeys(lines):
            for name in [line] if self._found(line) else line.split():
                path = self._found(name)
                if path is None:
                    self._notes.add("material files that are missing", name)
                else:
                    yield path

    def _found(self, name: str) -> Path | None:
        return self._materials.beside(name, self._file.parent, self._element)

    def _read(self, file: Path) -> dict[str, Look]:
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
            bare = _without_options(rest)
            if bare != rest:
                self._notes.add("options of pictures in material files", where)
            picture = self._materials.picture(bare, self._element, [self._file.parent])
            if picture is not None:  # a picture has its colour, whatever Kd says
                return Look(picture=picture, solid_above=look.solid_above)
        if word == "map_d":
            return replace(look, solid_above=HALF)
        return look

    def _colour(self, words: list[str], where: str) -> Colour:
        if words[0] in ("spectral", "xyz"):
            self._notes.add("colours that are not RGB, drawn white", where)
            return Look().colour
        if len(words) == 2:
            raise SpecError(f"{where}: expected one or three numbers after Kd, got {words}")
        return floats(words[:3] if len(words) > 2 else words * 3, where)


def _after(data: bytes, word: str) -> Iterator[str]:
    """The rest of every line of an OBJ that starts with a word."""
    for found in re.finditer(rb"^" + word.encode() + rb" +(.+)$", data, re.MULTILINE):
        yield found[1].decode("utf-8", errors="replace")


def _without_options(words: str) -> str:
    while found := _OPTION.match(words):
        words = words[found.end() :]
    return words

"""Materials: OGRE scripts, Gazebo's stock colours, and the pictures that they name."""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath, PureWindowsPath
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from vrchain.errors import SpecError
from vrchain.world.gazebo.files import Folders, is_elsewhere, is_file, read_bytes
from vrchain.world.gazebo.limits import MOST_SCRIPT_BYTES, MOST_TEXELS
from vrchain.world.gazebo.notes import Notes
from vrchain.world.gazebo.pictures import read_picture
from vrchain.world.gazebo.xml import Element
from vrchain.world.model import OPAQUE

Colour = tuple[float, float, float]
_PLAIN_PX = 8
HALF = OPAQUE - 1  # alpha above which a texel of a blended picture is taken for solid
_BLENDED = (["alpha_blend"], ["src_alpha", "one_minus_src_alpha"])
_WHITE: Colour = (1.0, 1.0, 1.0)
_WORDS = re.compile(r'"[^"]*"|\S+')  # of a script; those in quotes may hold blanks
_NORMAL_MAPS = (
    "normal_map", "shader/normal_map", "pbr/metal/normal_map", "pbr/specular/normal_map"
)  # fmt: skip

# Diffuse colours of the script that comes with Gazebo; what it draws with pictures of its own has
# about their mean colour here.
STOCK: dict[str, Colour] = {
    "Grey": (0.7, 0.7, 0.7), "Gray": (0.7, 0.7, 0.7), "DarkGrey": (0.175, 0.175, 0.175),
    "DarkGray": (0.175, 0.175, 0.175), "White": _WHITE, "FlatBlack": (0.1, 0.1, 0.1),
    "Black": (0.0, 0.0, 0.0), "Red": (1.0, 0.0, 0.0), "RedBright": (0.87, 0.26, 0.07),
    "Green": (0.0, 1.0, 0.0), "Blue": (0.0, 0.0, 1.0), "SkyBlue": (0.13, 0.44, 0.7),
    "Yellow": (1.0, 1.0, 0.0), "ZincYellow": (0.9725, 0.9529, 0.2078),
    "DarkYellow": (0.7, 0.7, 0.0), "Purple": (1.0, 0.0, 1.0), "Turquoise": (0.0, 1.0, 1.0),
    "Orange": (1.0, 0.5088, 0.0468), "Indigo": (0.33, 0.0, 0.5), "Gold": (0.8, 0.649, 0.121),
    "Pioneer2Body": (0.681, 0.001, 0.001), "LightOn": (0.0, 1.0, 0.0),
    "LightOff": (1.0, 0.0, 0.0), "WhiteGlow": _WHITE, "RedGlow": (1.0, 0.0, 0.0),
    "GreenGlow": (0.0, 1.0, 0.0), "BlueGlow": (0.0, 0.0, 1.0), "YellowGlow": (1.0, 1.0, 0.0),
    "PurpleGlow": (1.0, 0.0, 1.0), "TurquoiseGlow": (0.0, 1.0, 1.0),
}  # fmt: skip
PICTURED: dict[str, Colour] = {
    "Wood": (0.61, 0.46, 0.3), "LightWood": (0.8, 0.68, 0.5), "WoodFloor": (0.6, 0.42, 0.26),
    "WoodPallet": (0.66, 0.55, 0.4), "Bricks": (0.6, 0.35, 0.28), "Grass": (0.3, 0.42, 0.16),
    "Road": (0.35, 0.35, 0.35), "Residential": (0.4, 0.4, 0.4), "Tertiary": (0.4, 0.4, 0.4),
    "Primary": (0.35, 0.35, 0.35), "Trunk": (0.35, 0.35, 0.35), "Motorway": (0.35, 0.35, 0.35),
    "Lanes_4": (0.35, 0.35, 0.35), "Lanes_6": (0.35, 0.35, 0.35),
    "Pedestrian": (0.62, 0.6, 0.57), "Footway": (0.62, 0.6, 0.57),
    "PaintedWall": (0.85, 0.83, 0.78), "CeilingTiled": (0.85, 0.85, 0.82),
    "WindowFrame": (0.7, 0.7, 0.7), "PioneerBody": (0.65, 0.1, 0.1),
}  # fmt: skip


@dataclass(frozen=True)
class Look:
    """How a surface is drawn: a colour, times a picture if there is one.

    solid_above: alpha, 0..255, above which a texel is solid; None: all of it is. repeats: how often
    the picture is repeated where texture coordinates run from 0 to 1.
    """

    colour: Colour = _WHITE
    picture: Path | None = None
    solid_above: int | None = None
    repeats: tuple[float, float] = (1.0, 1.0)


class Materials:
    """Looks of visuals, and the textures that they are drawn with, each read once."""

    def __init__(self, folders: Folders, notes: Notes) -> None:
        self._folders, self._notes = folders, notes
        self._scripts: dict[Path, dict[str, _Script]] = {}
        self._textures: dict[Look, NDArray[np.uint8]] = {}
        self._texels = 0

    def look(self, visual: Element) -> tuple[Look | None, Colour | None]:
        """The look that a visual's <material> sets, if it does; and the colour, if it has one."""
        material = visual.find("material")
        if material is None:
            return None, None
        if any(material.find(path) for path in _NORMAL_MAPS):
            self._notes.add("normal maps")
        script = material.find("script")
        if script is not None and script.words("name"):
            return self._scripted(script), None
        albedo = material.words("pbr/metal/albedo_map") or material.words("pbr/specular/albedo_map")
        colour = _glowing(material)
        if albedo:
            picture = self.picture(albedo, visual, [visual.file.parent])
            if picture is not None:
                return Look(colour or _WHITE, picture, HALF), None
        return None, colour

    def picture(self, name: str, element: Element, folders: list[Path]) -> Path | None:
        """The file of a picture by its name or URI, in folders or in textures/ beside them.

        None, with a note, where there is none.
        """
        name = name.strip().replace("\\", "/").removeprefix("file://")
        for spelt in self._spellings(name):
            for folder in folders:
                near = (folder.parent / "materials" / "textures", folder / "materials" / "textures")
                for place in (folder, *(n for n in near if self._folders.hold(n))):
                    found = self._folders.find(spelt, place, element)
                    if found is not None and is_file(found):
                        return found
        self._notes.add("pictures that are missing", name)
        return None

    def _spellings(self, name: str) -> Iterator[str]:
        """A picture's path as it is written, as a URI, and bare where it is of another disk."""
        if is_elsewhere(name):
            return
        for spelt in dict.fromkeys((name, unquote(name))):
            lost = bool(PureWindowsPath(spelt).drive)
            if spelt.startswith("/") and "\0" not in spelt:  # which is refused
                lost = not self._folders.hold(Path(spelt))
            yield PurePosixPath(spelt).name if lost else spelt

    def beside(self, name: str, folder: Path, element: Element) -> Path | None:
        """The file that another in ``folder`` names, or None."""
        found = self._folders.find(name.strip().replace("\\", "/"), folder, element)
        return found if found is not None and is_file(found) else None

    def texture(self, look: Look) -> NDArray[np.uint8]:
        """The texture of a look, (h, w, 3 or 4) uint8, the same array every time."""
        key = replace(look, repeats=(1.0, 1.0))
        if key not in self._textures:
            made = self._made(key)
            self._texels += made.shape[0] * made.shape[1]
            if self._texels > MOST_TEXELS:
                raise SpecError(
                    f"{look.picture}: the world's pictures have more than {MOST_TEXELS:.0e} pixels "
                    "together: shrink some"
                )
            self._textures[key] = made
        return self._textures[key]

    def _made(self, look: Look) -> NDArray[np.uint8]:
        colour = np.clip(look.colour, 0, 1)
        if look.picture is None:
            plain = np.round(255 * colour).astype(np.uint8)
            return np.broadcast_to(plain, (_PLAIN_PX, _PLAIN_PX, 3)).copy()
        rgba = read_picture(look.picture)
        rgb = rgba[..., :3].copy()
        if look.colour != _WHITE:
            rgb = np.round(rgb * colour).astype(np.uint8)
        if look.solid_above is None:
            return rgb
        solid = rgba[..., 3] > look.solid_above
        if solid.all():
            return rgb
        return np.dstack([rgb, np.where(solid, 255, 0).astype(np.uint8)])

    def _scripted(self, script: Element) -> Look:
        """The look of a <script>: its name in the scripts of its <uri>s, or in the model's own."""
        name = script.words("name")
        folders = []
        for uri in script.all("uri"):
            if uri.text and not uri.text.startswith("file://"):
                here = not is_elsewhere(uri.text)
                found = self._folders.find(uri.text, script.file.parent, uri) if here else None
                if found is None:
                    self._notes.add("material folders that are missing", uri.text)
                else:
                    folders.append(found)
        folders.append(script.file.parent / "materials" / "scripts")
        files = list(_script_files(folders))
        found_script = self._named(name, files)
        if found_script is None:
            self._notes.add("materials that are missing, drawn grey", name)
            return Look(STOCK["Grey"])
        return self._look_of(self._whole(name, found_script, files), script, folders)

    def _named(self, name: str, files: list[Path]) -> "_Script | None":
        """A material of these scripts, or else of Gazebo's own."""
        for file in files:
            if file not in self._scripts:
                self._scripts[file] = dict(read_script(file))
            found = self._scripts[file].get(name)
            if found is not None:
                if found.fault:
                    raise SpecError(found.fault)
                return found
        stock = name.removeprefix("Gazebo/")
        if stock in PICTURED:
            self._notes.add("stock materials drawn in one colour", name)
        colour = STOCK.get(stock, PICTURED.get(stock))
        return None if colour is None else _Script(colour=colour)

    def _whole(self, name: str, script: "_Script", files: list[Path]) -> "_Script":
        """A material with what it inherits."""
        seen = {name}
        while script.parent and script.parent not in seen:
            seen.add(script.parent)
            parent = self._named(script.parent, files)
            if parent is None:
                self._notes.add("materials to inherit from that are missing", script.parent)
                parent = _Script()
            script = _over(script, parent)
        return script

    def _look_of(self, script: "_Script", element: Element, folders: list[Path]) -> Look:
        if script.aliased:
            self._notes.add("aliases of textures", script.aliased)
        picture = None
        if script.picture:
            places = [f.parent if is_file(f) else f for f in folders]
            picture = self.picture(script.picture, element, places)
        colour, repeats = script.colour or _WHITE, script.repeats or (1.0, 1.0)
        return Look(colour, picture, script.solid_above, repeats)


@dataclass(frozen=True)
class _Script:
    """What counts here of an OGRE material: its first pass's first picture, colour and alpha.

    What is not set is inherited of the material named ``parent``. aliased: a texture that it sets
    by an alias; fault: what is wrong with it, which matters where it is used.
    """

    picture: str = ""
    colour: Colour | None = None
    solid_above: int | None = None
    repeats: tuple[float, float] | None = None
    parent: str = ""
    aliased: str = ""
    fault: str = ""


def _over(script: _Script, parent: _Script) -> _Script:
    """A material with what it does not set from its parent, whose own parent is next."""
    return _Script(
        script.picture or parent.picture,
        script.colour or parent.colour,
        parent.solid_above if script.solid_above is None else script.solid_above,
        script.repeats or parent.repeats,
        parent.parent,
        script.aliased or parent.aliased,
    )


def _script_files(places: list[Path]) -> Iterator[Path]:
    for place in places:
        if is_file(place):
            yield place
        elif place.is_dir():
            yield from sorted(f for f in place.glob("*.material") if is_file(f))


def read_script(file: Path) -> Iterator[tuple[str, _Script]]:
    """The materials of an OGRE script by name. Programs are skipped, as all that is not known.

    See the manual of OGRE 1, "Material Scripts".
    """
    inside: list[str] = []
    name, script = "", _Script()
    opened = ""
    text = read_bytes(file, MOST_SCRIPT_BYTES).decode("utf-8-sig", errors="replace")
    for line in _statements(text):
        if line == "{":
            inside.append(opened.split(" ", 1)[0] if opened else "")
            if len(inside) > 64:
                raise SpecError(f"{file}: braces lie more than 64 deep")
            opened = ""
        elif line == "}":
            if inside == ["material"]:
                yield name, script
            if inside:
                inside.pop()
        else:
            opened = line
            if not inside and line.startswith("material "):
                name, parent = _names(line[9:])
                script = _Script(parent=parent)
            elif inside[:1] == ["material"]:
                words = [word.strip('"') for word in _WORDS.findall(line)]
                try:
                    script = _with(script, inside[1:], words, f"{file}: the material {name!r}")
                except SpecError as error:
                    script = replace(script, fault=str(error))


def _names(words: str) -> tuple[str, str]:
    """The name of a material and of its parent, as of ``A : B``."""
    split = re.findall(r'"[^"]*"|:|[^\s:"]+', words)
    at = split.index(":") if ":" in split else len(split)
    return " ".join(split[:at]).replace('"', ""), "".join(split[at + 1 : at + 2]).strip('"')


def _statements(text: str) -> Iterator[str]:
    """Lines without comments, and braces each on a line of its own."""
    commented = False
    for line in text.splitlines():
        if commented:
            _, end, line = line.partition("*/")
            commented = not end
        before, begin, after = line.partition("/*")
        if begin:
            commented = "*/" not in after
            line = before + after.partition("*/")[2]
        line = line.partition("//")[0] if "://" not in line else line
        for piece in line.replace("{", "\n{\n").replace("}", "\n}\n").split("\n"):
            if piece.strip():
                yield " ".join(piece.split())


def _with(script: _Script, inside: list[str], words: list[str], where: str) -> _Script:
    """A material with one more statement, which stands in these braces of it."""
    first = words[0]
    if first == "set_texture_alias" and len(words) >= 3:
        return replace(script, aliased=words[2])
    if inside == ["technique", "pass"]:
        if first == "diffuse" and len(words) >= 4 and words[1] != "vertexcolour":
            if script.colour is None:
                return replace(script, colour=floats(words[1:4], where))
        elif first == "alpha_rejection" and len(words) >= 3:
            if words[1] in ("greater", "greater_equal"):
                most = int(floats(words[2:3] * 3, where)[0]) - (words[1] == "greater_equal")
                return replace(script, solid_above=max(0, min(254, most)))
        elif first == "scene_blend" and words[1:] in _BLENDED and script.solid_above is None:
            return replace(script, solid_above=HALF)
    elif inside == ["technique", "pass", "texture_unit"]:
        if first == "texture" and len(words) >= 2 and not script.picture:
            return replace(script, picture=words[1])
        if first == "scale" and len(words) >= 3 and script.repeats is None:
            u, v, _ = floats([*words[1:3], "1"], where)
            if u and v:
                return replace(script, repeats=(1 / u, 1 / v))
    return script


def floats(words: Sequence[str], where: Path | str) -> Colour:
    """Words as three finite numbers. Raises SpecError."""
    try:
        a, b, c = (float(word) for word in words)
    except ValueError:
        a = b = c = math.nan
    if not (math.isfinite(a) and math.isfinite(b) and math.isfinite(c)):
        raise SpecError(f"{where}: expected finite numbers, got {' '.join(words)[:60]!r}")
    return a, b, c


def _glowing(material: Element) -> Colour | None:
    """The <diffuse> of a material and what it gives off besides; None where it has none."""
    diffuse, emissive = material.find("diffuse"), material.find("emissive")
    if diffuse is None or not diffuse.text:
        return None
    own = _colour(diffuse)
    glow = _colour(emissive) if emissive is not None and emissive.text else (0.0, 0.0, 0.0)
    return min(own[0] + glow[0], 1.0), min(own[1] + glow[1], 1.0), min(own[2] + glow[2], 1.0)


def _colour(element: Element) -> Colour:
    """A colour of three or four numbers."""
    values = element.numbers(min(max(len(element.text.split()), 3), 4))
    return values[0], values[1], values[2]

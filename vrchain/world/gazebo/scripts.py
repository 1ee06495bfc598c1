"""Materials of OGRE scripts, and the stock colours of the script that comes with Gazebo."""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from vrchain.errors import SpecError
from vrchain.world.gazebo.files import read_bytes
from vrchain.world.model import OPAQUE

MOST_SCRIPT_BYTES = 4 << 20
Colour = tuple[float, float, float]
HALF = OPAQUE - 1  # alpha above which a texel of a blended picture is taken for solid
WHITE: Colour = (1.0, 1.0, 1.0)
_BLENDED = (["alpha_blend"], ["src_alpha", "one_minus_src_alpha"])
_WORDS = re.compile(r'"[^"]*"|\S+')  # of a script; those in quotes may hold blanks

# Diffuse colours of the script that comes with Gazebo; what it draws with pictures of its own has
# about their mean colour here.
STOCK: dict[str, Colour] = {
    "Grey": (0.7, 0.7, 0.7), "Gray": (0.7, 0.7, 0.7), "DarkGrey": (0.175, 0.175, 0.175),
    "DarkGray": (0.175, 0.175, 0.175), "White": WHITE, "FlatBlack": (0.1, 0.1, 0.1),
    "Black": (0.0, 0.0, 0.0), "Red": (1.0, 0.0, 0.0), "RedBright": (0.87, 0.26, 0.07),
    "Green": (0.0, 1.0, 0.0), "Blue": (0.0, 0.0, 1.0), "SkyBlue": (0.13, 0.44, 0.7),
    "Yellow": (1.0, 1.0, 0.0), "ZincYellow": (0.9725, 0.9529, 0.2078),
    "DarkYellow": (0.7, 0.7, 0.0), "Purple": (1.0, 0.0, 1.0), "Turquoise": (0.0, 1.0, 1.0),
    "Orange": (1.0, 0.5088, 0.0468), "Indigo": (0.33, 0.0, 0.5), "Gold": (0.8, 0.649, 0.121),
    "Pioneer2Body": (0.681, 0.001, 0.001), "LightOn": (0.0, 1.0, 0.0),
    "LightOff": (1.0, 0.0, 0.0), "WhiteGlow": WHITE, "RedGlow": (1.0, 0.0, 0.0),
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
class Script:
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

    def over(self, parent: "Script") -> "Script":
        """With what it does not set from its parent, whose own parent is next."""
        return Script(
            self.picture or parent.picture,
            self.colour or parent.colour,
            parent.solid_above if self.solid_above is None else self.solid_above,
            self.repeats or parent.repeats,
            parent.parent,
            self.aliased or parent.aliased,
        )


def read_script(file: Path) -> Iterator[tuple[str, Script]]:
    """The materials of an OGRE script by name. Programs are skipped, as all that is not known.

    See the manual of OGRE 1, "Material Scripts".
    """
    inside: list[str] = []
    name, script = "", Script()
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
                script = Script(parent=parent)
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


def _with(script: Script, inside: list[str], words: list[str], where: str) -> Script:
    """A material with one more statement, which stands in these braces of it."""
    match inside, words:
        case _, ["set_texture_alias", _, alias, *_]:
            return replace(script, aliased=alias)
        case ["technique", "pass"], ["diffuse", red, green, blue, *_]:
            if red != "vertexcolour" and script.colour is None:
                return replace(script, colour=floats([red, green, blue], where))
        case ["technique", "pass"], [
            "alpha_rejection", ("greater" | "greater_equal") as solid, value, *_
        ]:  # fmt: skip
            most = int(floats([value] * 3, where)[0]) - (solid == "greater_equal")
            return replace(script, solid_above=max(0, min(254, most)))
        case ["technique", "pass"], ["scene_blend", *blend]:
            if blend in _BLENDED and script.solid_above is None:
                return replace(script, solid_above=HALF)
        case ["technique", "pass", "texture_unit"], ["texture", picture, *_]:
            if "normal" not in picture.rpartition("/")[2]:  # what a program bends light by
                return replace(script, picture=script.picture or picture)
        case ["technique", "pass", "texture_unit"], ["scale", wide, high, *_]:
            u, v, _ = floats([wide, high, "1"], where) if script.repeats is None else (0, 0, 0)
            if 1e-6 < abs(u) < 1e6 and 1e-6 < abs(v) < 1e6:
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

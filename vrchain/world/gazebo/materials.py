"""Looks of visuals and meshes: their materials, and the pictures that these name."""

import io
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import TYPE_CHECKING
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from vrchain.errors import SpecError
from vrchain.world.gazebo.files import Folders, Notes, files_in, is_file, read_bytes
from vrchain.world.gazebo.scripts import HALF, PICTURED, STOCK, WHITE, Colour, Script, read_script
from vrchain.world.gazebo.xml import Element

if TYPE_CHECKING:
    from PIL import Image

MOST_IMAGE_BYTES = 64 << 20
MOST_IMAGE_PX = 8192  # a side
TEXTURE_PX = 2048  # to which larger images are shrunk: no view shows more
MOST_TEXELS = 400_000_000  # of all textures of a world together
_PLAIN_PX = 8
_FORMATS = ("PNG", "JPEG", "TGA", "BMP", "GIF", "TIFF", "WEBP", "DDS")
_NORMAL_MAPS = (
    "normal_map", "shader/normal_map", "pbr/metal/normal_map", "pbr/specular/normal_map"
)  # fmt: skip


@dataclass(frozen=True)
class Embedded:
    """A picture within a mesh file."""

    file: Path
    data: bytes

    def __str__(self) -> str:
        return f"{self.file}: a picture in it"


@dataclass(frozen=True)
class Look:
    """How a surface is drawn: a colour, times a picture if there is one.

    solid_above: alpha, 0..255, above which a texel is solid; None: all of it is. repeats: how often
    the picture is repeated where texture coordinates run from 0 to 1. clear: glass, and what is
    invisible; it is not drawn.
    """

    colour: Colour = WHITE
    picture: Path | Embedded | None = None
    solid_above: int | None = None
    repeats: tuple[float, float] = (1.0, 1.0)
    clear: bool = False


class Materials:
    """Looks of visuals, and the textures that they are drawn with, each read once."""

    def __init__(self, folders: Folders, notes: Notes) -> None:
        self._folders, self._notes = folders, notes
        self._scripts: dict[Path, dict[str, Script]] = {}
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
                return Look(colour or WHITE, picture, HALF), None
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
                    if (found := self._file(spelt, place, element)) is not None:
                        return found
        self._notes.lose("pictures that are missing", name)
        return None

    def _spellings(self, name: str) -> Iterator[str]:
        """A picture's path as it is written, as a URI, and bare where it is of another disk."""
        for spelt in dict.fromkeys((name, unquote(name))):
            lost = bool(PureWindowsPath(spelt).drive)
            if spelt.startswith("/") and "\0" not in spelt:  # which is refused
                lost = not self._folders.hold(Path(spelt))
            yield PurePosixPath(spelt).name if lost else spelt

    def beside(self, name: str, folder: Path, element: Element) -> Path | None:
        """The file that another in ``folder`` names, or None."""
        return self._file(name.strip().replace("\\", "/"), folder, element)

    def _file(self, path: str, folder: Path, element: Element) -> Path | None:
        found = self._folders.find(path, folder, element)
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
        rgba = None if look.picture is None else self.read(look.picture)
        if rgba is None:
            plain = np.round(255 * colour).astype(np.uint8)
            return np.broadcast_to(plain, (_PLAIN_PX, _PLAIN_PX, 3)).copy()
        rgb = rgba[..., :3].copy()
        if look.colour != WHITE:
            rgb = np.round(rgb * colour).astype(np.uint8)
        if look.solid_above is None:
            return rgb
        solid = rgba[..., 3] > look.solid_above
        if solid.all():
            return rgb
        return np.dstack([rgb, np.where(solid, 255, 0).astype(np.uint8)])

    def read(self, file: Path | Embedded) -> NDArray[np.uint8] | None:
        """A picture as ``read_picture`` gives it; None, with a note, if it cannot be read."""
        try:
            return read_picture(file)
        except SpecError as error:
            self._notes.lose("pictures that cannot be read", str(error))
            return None

    def _scripted(self, element: Element) -> Look:
        """The look of a <script>: its name in the scripts of its <uri>s, or in the model's own."""
        name = element.words("name")
        folders = self._script_folders(element)
        files = [f for f in _script_files(folders) if self._folders.hold(f)]
        script = self._script(name, files)
        if script is None:
            self._notes.add("materials that are missing, drawn grey", name)
            return Look(STOCK["Grey"])
        seen = {name}
        while script.parent and script.parent not in seen:
            seen.add(script.parent)
            parent = self._script(script.parent, files)
            if parent is None:
                self._notes.add("materials to inherit from that are missing", script.parent)
            script = script.over(parent or Script())
        if script.aliased:
            self._notes.add("aliases of textures", script.aliased)
        picture = None
        if script.picture:
            places = [f.parent if is_file(f) else f for f in folders]
            picture = self.picture(script.picture, element, places)
        colour, repeats = script.colour or WHITE, script.repeats or (1.0, 1.0)
        return Look(colour, picture, script.solid_above, repeats)

    def _script_folders(self, element: Element) -> list[Path]:
        folders = []
        for uri in element.all("uri"):
            if uri.text and not uri.text.startswith("file://"):
                found = self._folders.find(uri.text, element.file.parent, uri)
                if found is None:
                    self._notes.lose("material folders that are missing", uri.text)
                else:
                    folders.append(found)
        return [*folders, element.file.parent / "materials" / "scripts"]

    def _script(self, name: str, files: list[Path]) -> Script | None:
        """A material of these scripts, or else of Gazebo's own."""
        for file in files:
            if file not in self._scripts:
                self._scripts[file] = dict(read_script(file))
            if (found := self._scripts[file].get(name)) is not None:
                if found.fault:
                    raise SpecError(found.fault)
                return found
        stock = name.removeprefix("Gazebo/")
        if stock in PICTURED:
            self._notes.add("stock materials drawn in one colour", name)
        colour = STOCK.get(stock, PICTURED.get(stock))
        return None if colour is None else Script(colour=colour)


def _script_files(places: list[Path]) -> Iterator[Path]:
    for place in places:
        if is_file(place):
            yield place
        else:
            yield from files_in(place, "*.material")


def read_picture(file: Path | Embedded) -> NDArray[np.uint8]:
    """A picture as (h, w, 4) uint8 RGBA, at most ``TEXTURE_PX`` a side. Raises SpecError."""
    from PIL import Image

    data = file.data if isinstance(file, Embedded) else read_bytes(file, MOST_IMAGE_BYTES)
    try:
        with Image.open(io.BytesIO(data), formats=_FORMATS) as image:
            if max(image.size) > MOST_IMAGE_PX or min(image.size) < 1:
                raise SpecError(
                    f"{file}: expected a picture of at most {MOST_IMAGE_PX} pixels a side, "
                    f"got {image.size[0]} x {image.size[1]}"
                )
            drawn = _of_eight_bits(image).convert("RGBA")
    except SpecError:
        raise
    except Exception as error:  # decoders raise almost anything
        reason = " ".join(str(error).replace("<_io.BytesIO object", "<it").split())[:120]
        raise SpecError(
            f"{file}: expected a picture ({', '.join(_FORMATS)}), cannot read this: {reason}"
        ) from None
    scale = TEXTURE_PX / max(drawn.size)
    if scale < 1:
        size = (max(1, round(drawn.width * scale)), max(1, round(drawn.height * scale)))
        drawn = drawn.resize(size, Image.Resampling.BOX)
    return np.asarray(drawn)


def _of_eight_bits(image: "Image.Image") -> "Image.Image":
    """Greys of 16 bits, or from 0 to 1, as those of 8 bits; converted, they would be clipped."""
    from PIL import Image

    if image.mode == "F":
        whole = np.round(255 * np.clip(np.nan_to_num(np.asarray(image)), 0, 1))
    elif image.mode.startswith("I"):
        whole = np.clip(np.asarray(image) // 256, 0, 255)
    else:
        return image
    return Image.fromarray(whole.astype(np.uint8))


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

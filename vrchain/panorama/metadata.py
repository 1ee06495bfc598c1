"""What a picture says of itself: GPano in XMP (part of the sphere, pose), and the EXIF's position.

GPano: Google's "Photo Sphere XMP Metadata".
"""

import io
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from xml.etree import ElementTree

import numpy as np

from vrchain.errors import ImageError
from vrchain.panorama.models import Field

_GPANO = "{http://ns.google.com/photos/1.0/panorama/}"
_GPS = 34853  # the EXIF's directory of positions
_MOST_XMP_BYTES = 1_000_000


@dataclass(frozen=True)
class Metadata:
    """projection: "equirectangular" or another, empty if none is told. field: what is shown.

    heading_deg: of the picture's middle, clockwise from north; pitch_deg, roll_deg: how it was
    held, middle up and right side down; latitude_deg, longitude_deg, altitude_m: where. None: not
    told.
    """

    projection: str = ""
    field: Field | None = None
    heading_deg: float | None = None
    pitch_deg: float | None = None
    roll_deg: float | None = None
    latitude_deg: float | None = None
    longitude_deg: float | None = None
    altitude_m: float | None = None


@contextmanager
def _unlimited() -> Iterator[None]:
    """Pillow reads heads of pictures of any size: no pixel is read here."""
    from PIL import Image

    most, Image.MAX_IMAGE_PIXELS = Image.MAX_IMAGE_PIXELS, None
    try:
        yield
    finally:
        Image.MAX_IMAGE_PIXELS = most


def metadata_of(content: bytes, what: str) -> Metadata:
    """The metadata of a picture's bytes; ImageError, which names ``what``, if they make no sense.

    Of what is no picture nothing is told: that is said where its pixels are read.
    """
    from PIL import Image

    try:
        with _unlimited(), Image.open(io.BytesIO(content)) as image:
            xmp = image.info.get("xmp", b"")
            gps = dict(image.getexif().get_ifd(_GPS))
    except (OSError, ValueError, SyntaxError, TypeError, KeyError):
        return Metadata()
    told = _gpano(xmp if isinstance(xmp, bytes) else str(xmp).encode(), what)
    pose = {
        f"{name.lower()}_deg": _number(told, f"Pose{name}Degrees", what, most)
        for name, most in (("Heading", 360.0), ("Pitch", 90.0), ("Roll", 180.0))
    }
    return Metadata(told.get("ProjectionType", ""), _field(told, what), **pose, **_position(gps))


def _gpano(xmp: bytes, what: str) -> dict[str, str]:
    """GPano's properties, written as attributes or as elements."""
    start, end = xmp.find(b"<rdf:RDF"), xmp.rfind(b"</rdf:RDF>")
    if start < 0 or end < 0 or len(xmp) > _MOST_XMP_BYTES:
        return {}
    try:
        tree = ElementTree.fromstring(xmp[start : end + len(b"</rdf:RDF>")])
    except ElementTree.ParseError as error:
        if _GPANO.strip("{}").encode() not in xmp:
            return {}  # whatever it says, it is nothing of ours
        raise ImageError(f"{what}: its XMP metadata cannot be read ({error})") from error
    found: dict[str, str] = {}
    for element in tree.iter():
        pairs = [*element.attrib.items(), (element.tag, element.text or "")]
        found |= {k[len(_GPANO) :]: v.strip() for k, v in pairs if k.startswith(_GPANO)}
    return found


def _number(told: Mapping[str, str], name: str, what: str, most: float = math.inf) -> float | None:
    if name not in told:
        return None
    try:
        value = float(told[name])
    except ValueError:
        value = math.nan
    if not math.isfinite(value) or abs(value) > most:
        limit = f" from -{most:g} to {most:g}" if math.isfinite(most) else ""
        raise ImageError(f"{what}: expected a number{limit} as GPano:{name}, got {told[name]!r}")
    return value


def _field(told: Mapping[str, str], what: str) -> Field | None:
    """The part of the sphere that the picture shows; None if that is not told."""
    names = [
        "FullPanoWidthPixels", "FullPanoHeightPixels",
        "CroppedAreaImageWidthPixels", "CroppedAreaImageHeightPixels",
        "CroppedAreaLeftPixels", "CroppedAreaTopPixels",
    ]  # fmt: skip
    numbers = [_number(told, name, what) for name in names]
    if any(number is None for number in numbers):
        return None
    width, height, own_width, own_height, left, top = (n or 0.0 for n in numbers)
    if not (0 < own_width <= width and 0 < own_height <= height and left >= 0 and top >= 0) or (
        left + own_width > width or top + own_height > height
    ):
        raise ImageError(
            f"{what}: GPano's part of {own_width:g} x {own_height:g} pixels at {left:g}, {top:g} "
            f"does not lie in the whole of {width:g} x {height:g}: give --model and --field-of-view"
        )
    return Field(
        float(np.pi - 2 * np.pi * left / width),
        float(2 * np.pi * own_width / width),
        float(np.pi / 2 - np.pi * top / height),
        float(np.pi * own_height / height),
    )


def _position(gps: Mapping[int, object]) -> dict[str, float]:
    """Latitude, longitude and altitude; what cannot be read is left out."""
    found = {}
    for name, value, sign in (("latitude_deg", 2, 1), ("longitude_deg", 4, 3)):
        try:
            degrees, minutes, seconds = (float(part) for part in gps[value])  # type: ignore[attr-defined]
            turned = -1 if str(gps[sign]).strip() in ("S", "W") else 1
            found[name] = turned * (degrees + minutes / 60 + seconds / 3600)
        except (KeyError, TypeError, ValueError, ZeroDivisionError):
            return {}
    try:
        below = gps.get(5) in (b"\x01", 1)
        found["altitude_m"] = (-1 if below else 1) * float(gps[6])  # type: ignore[arg-type]
    except (KeyError, TypeError, ValueError, ZeroDivisionError):
        pass
    return found if all(map(math.isfinite, found.values())) else {}

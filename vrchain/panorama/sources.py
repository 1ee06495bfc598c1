"""Pictures of other cameras made into panoramas of ours: one picture or several, one rig."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vrchain.errors import ImageError
from vrchain.geometry import rotation_z
from vrchain.panorama import models
from vrchain.panorama.calibrations import read_cameras
from vrchain.panorama.codec import decode_image, read_content
from vrchain.panorama.metadata import Metadata, metadata_of
from vrchain.panorama.models import FACES, Field, Lens, Mirror
from vrchain.panorama.panorama import Panorama
from vrchain.panorama.resampling import (
    REACH,
    Camera,
    resampled,
    rig_for,
    sharpness,
    shrunk,
    tilted,
)
from vrchain.panorama.rig import CameraRig

MODELS = "equirectangular", "cylinder", "mirror", "fisheye", "cubemap", "views"
_COLUMNS = 256, 4096  # a full turn: nothing is recognised on fewer, and more only take longer


@dataclass(frozen=True)
class Source:
    """How a camera's pictures are to be read; what is None is taken from their metadata.

    model: one of ``MODELS``. field_of_view_deg: the width of a picture, or of a fisheye's circle.
    elevations_deg: of the lowest and the highest row, or of a mirror's ring. heading_deg: of the
    picture's middle, clockwise from north, only kept. pitch_deg, roll_deg: how the camera was
    tilted, middle up and right side down; it is set upright. faces: the order of a cubemap's, by
    the letters of ``models.FACES``. calibration: files of calibrated views; bearings_deg: where
    each view looks, anticlockwise from ahead. columns: of the cylinder, instead of the picture's.
    """

    model: str | None = None
    field_of_view_deg: float | None = None
    elevations_deg: tuple[float, float] | None = None
    heading_deg: float | None = None
    pitch_deg: float | None = None
    roll_deg: float | None = None
    camera_height_m: float = CameraRig.camera_height_m
    mirror: Mirror = Mirror()  # noqa: RUF009
    faces: str | None = None
    calibration: tuple[Path, ...] = ()
    bearings_deg: tuple[float, ...] = ()
    columns: int | None = None

    def __post_init__(self) -> None:
        if self.model not in (None, *MODELS):
            raise ImageError(f"expected a model of {', '.join(MODELS)}, got {self.model!r}")
        limits = {
            "field_of_view_deg": (1.0, 360.0),
            "heading_deg": (-360.0, 360.0),
            "pitch_deg": (-180.0, 180.0),
            "roll_deg": (-180.0, 180.0),
            "columns": (64, 16384),
        }
        for name, (low, high) in limits.items():
            value = getattr(self, name)
            if value is not None and not low <= value <= high:
                raise ImageError(f"{name} must lie in {low:g}..{high:g}, got {value:g}")
        low, high = self.elevations_deg or (-1.0, 1.0)
        if not -90 <= low < high <= 90:
            raise ImageError(
                f"expected elevations from -90 to 90, the lower first, got {low:g} {high:g}"
            )
        ring = self.mirror
        if not 0 <= ring.inner < ring.outer <= 4 or not np.isfinite(ring.centre).all():
            raise ImageError(
                "expected a mirror's inner radius below its outer, shares of the picture's height, "
                f"got {ring.inner:g} and {ring.outer:g}"
            )
        if self.faces is not None and sorted(self.faces) != sorted(FACES):
            raise ImageError(f"expected the letters {FACES} in some order, got {self.faces!r}")

    @property
    def several(self) -> bool:
        """Whether many pictures make one panorama."""
        return self.model in ("cubemap", "views") or bool(self.calibration)


@dataclass(frozen=True, eq=False)
class Imported:
    """A panorama made of pictures. about: what ``panorama.json`` keeps. upsampled: how many pixels
    stand for one of the source, each way, at most."""

    panorama: Panorama
    about: dict[str, Any]
    upsampled: float


def from_equirectangular(
    picture: NDArray[np.uint8],
    camera_height_m: float = CameraRig.camera_height_m,
    reach: float = REACH,
    what: str = "picture",
) -> Panorama:
    """The panorama in an equirectangular picture, (h, 2h, 3) uint8 RGB, taken upright.

    Its middle column looks ahead, its left half to the left. The views have as many pixels a radian
    as the picture, up to 4,096 a turn. reach: the slope (tangent of elevation) up to which they
    look, up and down. ImageError, which names ``what``, for a picture of another shape; SpecError
    for a height or reach out of bounds.
    """
    if picture.dtype != np.uint8 or picture.ndim != 3 or picture.shape[2] != 3:
        raise ImageError(
            f"{what}: expected an (h, 2h, 3) uint8 RGB picture, got {picture.dtype} {picture.shape}"
        )
    height_px, width_px = picture.shape[:2]
    if width_px != 2 * height_px or width_px < _COLUMNS[0]:
        raise ImageError(
            f"{what}: expected an equirectangular picture, twice as wide as it is high and "
            f"{_COLUMNS[0]} pixels wide or more, got {width_px} x {height_px}: "
            "export the full sphere from the camera's program, or say what it shows by "
            "--field-of-view and --elevations"
        )
    if width_px > _COLUMNS[1]:
        size = _COLUMNS[1], _COLUMNS[1] // 2
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
    rig = rig_for(picture.shape[1] / (2 * np.pi), camera_height_m, reach)
    return resampled([Camera(picture, models.equirectangular, closed=True)], rig)


def import_panorama(
    pictures: str | Path | Sequence[Path],
    source: Source = Source(),
    rig: CameraRig | None = None,
) -> Imported:
    """The panorama in another camera's picture or pictures, files.

    rig: of panoramas that this one is to be compared with. ImageError: not what the model says, or
    nobody says what a pixel's place means.
    """
    files = [Path(pictures)] if isinstance(pictures, str | Path) else list(pictures)
    contents = [read_content(file) for file in files]
    images = [decode_image(c, str(f)) for c, f in zip(contents, files, strict=True)]
    told = metadata_of(contents[0], str(files[0]))
    model = model_of(source, told, images[0], str(files[0]))
    pitch_deg, roll_deg = (
        theirs if ours is None else ours
        for ours, theirs in ((source.pitch_deg, told.pitch_deg), (source.roll_deg, told.roll_deg))
    )
    turn = tilted(pitch_deg or 0.0, roll_deg or 0.0)
    cameras = [
        Camera(c.picture, c.model, turn @ c.turn, c.closed)
        for c in _cameras(model, images, files, source, told)
    ]
    panorama, upsampled = _panorama(cameras, source, rig, str(files[0]))
    heading = told.heading_deg if source.heading_deg is None else source.heading_deg
    known = {
        "source": [str(file) for file in files],
        "model": model,
        "heading_deg": heading,
        "pitch_deg": pitch_deg,
        "roll_deg": roll_deg,
        "tilt_corrected": pitch_deg is not None or roll_deg is not None,
        "latitude_deg": told.latitude_deg,
        "longitude_deg": told.longitude_deg,
        "altitude_m": told.altitude_m,
    }
    return Imported(panorama, {k: v for k, v in known.items() if v is not None}, upsampled)


def model_of(source: Source, told: Metadata, image: NDArray[np.uint8], what: str) -> str:
    """What is asked for, or what the picture says; ImageError asks if neither does."""
    if source.calibration and source.model in (None, "views"):
        return "views"
    if source.model:
        return source.model
    if told.projection.startswith(("equirect", "cylind")):
        return MODELS[told.projection.startswith("cylind")]
    height_px, width_px = image.shape[:2]
    if width_px == 2 * height_px:
        raise ImageError(
            f"{what}: twice as wide as high, but its metadata do not tell what it shows: is it a "
            "full sphere? Then say --model equirectangular"
        )
    raise ImageError(
        f"{what}: {width_px} x {height_px} pixels, and its metadata do not tell what they show: "
        f"give --model, one of {', '.join(MODELS)}"
    )


def _cameras(
    model: str,
    images: Sequence[NDArray[np.uint8]],
    files: Sequence[Path],
    source: Source,
    told: Metadata,
) -> list[Camera]:
    """Cameras in the frame of their mount."""
    if model == "views":
        return _ring(images, source)
    image, what = images[0], str(files[0])
    height_px, width_px = image.shape[:2]
    if model == "cubemap":
        return [_cube(images, files, source)]
    if model == "mirror":
        low, high = map(math.radians, source.elevations_deg or (math.nan, math.nan))
        ring = source.mirror
        if source.elevations_deg:
            ring = replace(ring, lowest_rad=low, highest_rad=high)
        return [Camera(image, partial(models.mirror, ring=ring))]
    if model == "fisheye":
        field_rad = math.radians(source.field_of_view_deg or 180.0)
        return [Camera(image, partial(models.fisheye, field_rad=field_rad))]
    shown = told.field if model == "equirectangular" else None
    asked = source.field_of_view_deg is not None or source.elevations_deg is not None
    if model == "equirectangular" and not asked and shown is None:
        if width_px != 2 * height_px:
            from_equirectangular(image, what=what)  # says what is wrong
        shown = Field()
    if asked or shown is None:
        shown = _field_of(image, model, source)
    projection = getattr(models, model)
    return [Camera(image, partial(projection, field=shown), closed=shown.closed)]


def _field_of(image: NDArray[np.uint8], model: str, source: Source) -> Field:
    """By the options; where they say nothing of the rows, pixels are square, the horizon midway."""
    height_px, width_px = image.shape[:2]
    width_rad = math.radians(source.field_of_view_deg or 360.0)
    half = width_rad * height_px / width_px / 2
    low, high = -half, half
    if source.elevations_deg:
        low, high = map(math.radians, source.elevations_deg)
        if model == "cylinder":
            low, high = math.tan(low), math.tan(high)
    return Field(width_rad / 2, width_rad, high, high - low)


_STRIPS = {
    6.0: ("{}",),
    1 / 6: ("{0[0]}", "{0[1]}", "{0[2]}", "{0[3]}", "{0[4]}", "{0[5]}"),
    1.5: ("{0[0]}{0[1]}{0[2]}", "{0[3]}{0[4]}{0[5]}"),
}
_CROSS = (".u..", "lfrb", ".d..")
_STRIP_ORDER = "rludfb"  # right, left, up, down, front, back, as OpenGL and ffmpeg have it


def _cube(images: Sequence[NDArray[np.uint8]], files: Sequence[Path], source: Source) -> Camera:
    """Six square pictures, or one with all faces: a cross, or a strip of one or two rows."""
    if len(images) == 6:
        sides = {image.shape[k] for image in images for k in (0, 1)}
        if len(sides) > 1:
            raise ImageError(f"{files[0]}: expected six square pictures of one size")
        order = source.faces or _named_faces(files) or FACES
        layout: tuple[str, ...] = (order,)
        return Camera(np.concatenate(images, axis=1), partial(models.cubemap, layout=layout))
    image = images[0]
    ratio = image.shape[1] / image.shape[0]
    if len(images) != 1 or not (ratio in _STRIPS or abs(ratio - 4 / 3) < 1e-9):
        raise ImageError(
            f"{files[0]}: expected the six faces of a cubemap as six pictures, a cross of 4 x 3 or "
            f"a strip of 6 x 1, 1 x 6 or 3 x 2, got {len(images)} pictures, "
            f"{image.shape[1]} x {image.shape[0]}"
        )
    layout = _CROSS
    if ratio in _STRIPS:
        layout = tuple(row.format(source.faces or _STRIP_ORDER) for row in _STRIPS[ratio])
    return Camera(image, partial(models.cubemap, layout=layout))


def _named_faces(files: Sequence[Path]) -> str:
    """The faces by their names' last letter or word, front as f; empty if they do not tell."""
    words = [re.split(r"[^a-z]+", file.stem.lower())[-1] for file in files]
    long = {"front": "f", "right": "r", "back": "b", "left": "l", "up": "u", "down": "d",
            "top": "u", "bottom": "d"}  # fmt: skip
    letters = [long.get(word, word) for word in words]
    return "".join(letters) if sorted(letters) == sorted(FACES) else ""


def _ring(images: Sequence[NDArray[np.uint8]], source: Source) -> list[Camera]:
    """Views in equal steps to the left, the first ahead, or as calibrations and bearings say."""
    if source.calibration:
        mounted = read_cameras(source.calibration, source.bearings_deg)
    else:
        if not source.field_of_view_deg or source.field_of_view_deg > 170:
            raise ImageError(
                "views: expected --field-of-view, the width of a picture in degrees up to 170, or "
                "--calibration files"
            )
        bearings = source.bearings_deg or [360 * k / len(images) for k in range(len(images))]
        mounted = [
            (_flat(image, source.field_of_view_deg), rotation_z(math.radians(bearing)))
            for image, bearing in zip(images, bearings, strict=False)
        ]
    if len(mounted) != len(images):
        raise ImageError(
            f"views: expected one picture for each of {len(mounted)} cameras or bearings, "
            f"got {len(images)}"
        )
    return [
        Camera(image, partial(models.pinhole, lens=lens), turn)
        for image, (lens, turn) in zip(images, mounted, strict=True)
    ]


def _flat(image: NDArray[np.uint8], field_of_view_deg: float) -> Lens:
    height_px, width_px = image.shape[:2]
    focal_px = width_px / 2 / math.tan(math.radians(field_of_view_deg) / 2)
    middle = (width_px - 1) / 2, (height_px - 1) / 2
    return Lens((width_px, height_px), (focal_px, focal_px), middle)


def _panorama(
    cameras: list[Camera], source: Source, rig: CameraRig | None, what: str
) -> tuple[Panorama, float]:
    """The panorama, and by how much it has more pixels than its source."""
    sharp = sharpness(cameras)
    if sharp.reach == 0:
        raise ImageError(f"{what}: none of it lies within 54 degrees of the horizon: mend --pitch")
    if rig is None:
        columns = source.columns or min(sharp.across * 2 * np.pi, _COLUMNS[1])
        if source.columns is None and columns < _COLUMNS[0] - 0.5:
            raise ImageError(
                f"{what}: expected {_COLUMNS[0]} pixels or more around, got {columns:.0f}, on "
                "which nothing is recognised: --columns takes it all the same"
            )
        rig = rig_for(columns / (2 * np.pi), source.camera_height_m, max(sharp.reach, 0.1))
    smaller = shrunk(cameras, rig.px_per_rad / sharp.across)
    return resampled(smaller, rig), rig.px_per_rad / min(sharp.across, sharp.along)

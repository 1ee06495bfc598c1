"""How a camera's pictures are to be read, and the cameras that they are of."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vrchain.errors import ImageError
from vrchain.geometry import rotation_z
from vrchain.panorama import models
from vrchain.panorama.calibrations import read_cameras
from vrchain.panorama.metadata import Metadata
from vrchain.panorama.models import FACES, Field, Lens, Mirror
from vrchain.panorama.resampling import Camera
from vrchain.panorama.rig import CameraRig

MODELS = "equirectangular", "cylinder", "mirror", "fisheye", "cubemap", "views"


@dataclass(frozen=True)
class Source:
    """How a camera's pictures are to be read; what is None is taken from their metadata.

    model: one of ``MODELS``. field_of_view_deg: the width of a picture, or of a fisheye's circle.
    elevations_deg: of the lowest and the highest row, or of a mirror's ring. heading_deg: of the
    picture's middle, clockwise from north, only kept. pitch_deg, roll_deg: how the camera was
    tilted, middle up and right side down; it is set upright. faces: the order of a cubemap's, by
    the letters of ``models.FACES``. calibration: files of calibrated views; bearings_deg: where
    each view looks, anticlockwise from ahead. columns: of the cylinder, instead of the picture's.
    camera_height_m: above the ground; a robot's, 1 m, if nothing else tells it.
    """

    model: str | None = None
    field_of_view_deg: float | None = None
    elevations_deg: tuple[float, float] | None = None
    heading_deg: float | None = None
    pitch_deg: float | None = None
    roll_deg: float | None = None
    camera_height_m: float | None = None
    mirror: Mirror | None = None
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
            "columns": (96, 8192),  # a rig has views of 16 to 4,096 pixels
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
        ring = self.mirror or Mirror()
        if (
            not 0 <= ring.inner < ring.outer <= 4
            or not np.isfinite([*ring.centre, ring.offset_deg]).all()
        ):
            raise ImageError(
                "expected a mirror's inner radius below its outer, shares of the picture's height, "
                f"got {ring.inner:g} and {ring.outer:g}"
            )
        if self.faces is not None and sorted(self.faces) != sorted(FACES):
            raise ImageError(f"expected the letters {FACES} in some order, got {self.faces!r}")

        owners = {
            "mirror": "mirror", "faces": "cubemap", "calibration": "views", "bearings_deg": "views",
            "field_of_view_deg": "equirectangular cylinder fisheye views",
            "elevations_deg": "equirectangular cylinder mirror",
        }  # fmt: skip
        for name, owner in owners.items():
            if getattr(self, name) and self.model and self.model not in owner.split():
                told, of = name.removesuffix("_deg"), owner.replace(" ", ", ")
                raise ImageError(
                    f"{told}: is told of the model {of} alone, got the model {self.model}"
                )

    @property
    def height_m(self) -> float:
        """Of the camera: as told, or a robot's."""
        told = self.camera_height_m
        return CameraRig.camera_height_m if told is None else told

    @property
    def several(self) -> bool:
        """Whether many pictures make one panorama."""
        return self.model in ("cubemap", "views") or bool(self.calibration)


def cameras_of(
    model: str,
    images: Sequence[NDArray[np.uint8]],
    files: Sequence[Path],
    source: Source,
    told: Metadata,
) -> list[Camera]:
    """Cameras in the frame of their mount. ImageError: the pictures are not what the model says."""
    if model == "views":
        return _ring(images, source)
    image, what = images[0], str(files[0])
    height_px, width_px = image.shape[:2]
    if model == "cubemap":
        return [_cube(images, files, source)]
    if model == "mirror":
        low, high = map(math.radians, source.elevations_deg or (math.nan, math.nan))
        if source.mirror is None:
            raise ImageError(
                f"{what}: expected the mirror's parameters: give --inner and --outer, its radii as "
                "shares of the picture's height, and --centre"
            )
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
            raise ImageError(
                f"{what}: expected an equirectangular picture, twice as wide as it is high, got "
                f"{width_px} x {height_px}: export the full sphere from the camera's program, or "
                "say what it shows by --field-of-view and --elevations"
            )
        shown = Field()
    if asked or shown is None:
        shown = _field_of(image, model, source, told.field)
    projection = getattr(models, model)
    return [Camera(image, partial(projection, field=shown), closed=shown.closed)]


def _field_of(image: NDArray[np.uint8], model: str, source: Source, told: Field | None) -> Field:
    """By the options, else as the metadata say; else pixels are square, the horizon midway."""
    height_px, width_px = image.shape[:2]
    left_rad, width_rad = (told.left_rad, told.width_rad) if told else (math.pi, 2 * math.pi)
    if source.field_of_view_deg is not None:
        width_rad = math.radians(source.field_of_view_deg)
        left_rad = width_rad / 2
    half = width_rad * height_px / width_px / 2
    low, high = -half, half
    if told and model == "equirectangular":
        low, high = told.top - told.height, told.top
    if source.elevations_deg:
        low, high = map(math.radians, source.elevations_deg)
        if model == "cylinder":
            low, high = math.tan(low), math.tan(high)
    return Field(left_rad, width_rad, high, high - low)


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
    """The faces by the last letter or word of their names, or of a folder's; empty: not told."""
    long = {"front": "f", "right": "r", "back": "b", "left": "l", "up": "u", "down": "d",
            "top": "u", "bottom": "d"}  # fmt: skip
    paths = [file.with_suffix("").parts[::-1] for file in files]
    for names in zip(*paths, strict=False):
        words = [re.split(r"[^a-z]+", name.lower())[-1] for name in names]
        letters = [long.get(word, word) for word in words]
        if sorted(letters) == sorted(FACES):
            return "".join(letters)
    return ""


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
        lens = _flat(images[0], source.field_of_view_deg)
        mounted = [(lens, rotation_z(math.radians(bearing))) for bearing in bearings]
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

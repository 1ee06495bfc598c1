"""Pictures of other cameras made into panoramas of ours: one picture or several, one rig."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vrchain.errors import ImageError
from vrchain.panorama import models
from vrchain.panorama.cameras import MODELS, Source, cameras_of
from vrchain.panorama.codec import decode_image, read_content
from vrchain.panorama.metadata import Metadata, metadata_of
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
from vrchain.panorama.rig import MOST_SIDE_PX, CameraRig

_COLUMNS = 256, 4096  # a full turn: nothing is recognised on fewer, and more only take longer


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
            "export the full sphere from the camera's program"
        )
    if width_px > _COLUMNS[1]:
        size = _COLUMNS[1], _COLUMNS[1] // 2
        picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
    rig = rig_for(picture.shape[1] / (2 * np.pi), camera_height_m, reach)
    return resampled([Camera(picture, models.equirectangular, closed=True)], rig)


def import_panorama(
    pictures: str | Path | Sequence[Path],
    source: Source | None = None,
    rig: CameraRig | None = None,
) -> Imported:
    """The panorama in another camera's picture or pictures, files.

    rig: of panoramas that this one is to be compared with. ImageError: not what the model says, or
    nobody says what a pixel's place means.
    """
    source = source or Source()
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
        for c in cameras_of(model, images, files, source, told)
    ]
    tilt = pitch_deg or roll_deg
    as_it_is = None if model != "views" or rig or tilt else _own_ring(images, source)
    if as_it_is is None:
        panorama, upsampled = _panorama(cameras, source, rig, str(files[0]))
    else:
        panorama, upsampled = as_it_is, 1.0
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
            'full sphere? Then say --model equirectangular, or vr.Source("equirectangular")'
        )
    raise ImageError(
        f"{what}: {width_px} x {height_px} pixels, and its metadata do not tell what they show: "
        f"give --model, or vr.Source(MODEL), one of {', '.join(MODELS)}"
    )


def _own_ring(images: Sequence[NDArray[np.uint8]], source: Source) -> Panorama | None:
    """Views that a rig of ours could have taken are its views, unchanged; None: these are none."""
    n, wide_deg = len(images), source.field_of_view_deg or 0.0
    changed = source.calibration or source.bearings_deg
    alike = len({image.shape for image in images}) == 1
    height_px, width_px = images[0].shape[:2]
    if changed or source.columns or not alike or n < 2 or not 360 <= n * wide_deg <= n * 120:
        return None
    if max(height_px, width_px) > MOST_SIDE_PX:
        return None  # they are made smaller
    rig = CameraRig(n, width_px, height_px, wide_deg, source.height_m)
    return Panorama(rig, np.stack(images))


def _panorama(
    cameras: list[Camera], source: Source, rig: CameraRig | None, what: str
) -> tuple[Panorama, float]:
    """The panorama, and by how much it has more pixels than its source."""
    sharp = sharpness(cameras)
    if sharp.reach == 0:
        raise ImageError(
            f"{what}: none of it, or less than a degree up and down, lies within 54 degrees of the "
            "horizon: mend --pitch or --elevations"
        )
    if min(sharp.across, sharp.along) <= 0:
        raise ImageError(f"{what}: expected several pixels each way, around and up and down")
    if rig is None:
        columns = source.columns or min(sharp.across * 2 * np.pi, _COLUMNS[1])
        if source.columns is None and columns < _COLUMNS[0] - 0.5:
            raise ImageError(
                f"{what}: expected {_COLUMNS[0]} pixels or more around, got {columns:.0f}, on "
                "which nothing is recognised: --columns takes it all the same"
            )
        rig = rig_for(columns / (2 * np.pi), source.height_m, max(sharp.reach, 0.1))
    smaller = shrunk(cameras, rig.px_per_rad / sharp.across)
    return resampled(smaller, rig), rig.px_per_rad / min(sharp.across, sharp.along)

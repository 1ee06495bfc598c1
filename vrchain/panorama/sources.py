"""Pictures of other cameras made into panoramas of ours: which source pixel shows each ray.

A source model is one function, from rays in the robot's frame and the source's size to its pixels;
``resampled`` does what all of them need.
"""

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vrchain.errors import ImageError
from vrchain.panorama.codec import read_image
from vrchain.panorama.panorama import Panorama
from vrchain.panorama.rig import CameraRig

Rays = NDArray[np.float32]
Model = Callable[[Rays, tuple[int, int]], tuple[NDArray[np.floating], NDArray[np.floating]]]
"""Rays (..., 3) and the source's (width, height) to its pixels x, y; centres are whole numbers."""

REACH = 1.4  # slope, up and down: 54 degrees; 1.7 matched no more in rooms, 1.0 a quarter less
_VIEWS, _FIELD_OF_VIEW_DEG = 8, 60.0
_COLUMNS = 256, 4096  # a full turn: nothing is recognised on fewer, and more only take longer


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
    return resampled(picture, equirectangular, rig)


def rig_for(px_per_rad: float, camera_height_m: float, reach: float) -> CameraRig:
    """A ring of views of so many pixels a radian whose cylinder reaches slopes of +-``reach``."""
    half_step_rad = np.pi / _VIEWS
    width_px = round(2 * px_per_rad * np.tan(np.radians(_FIELD_OF_VIEW_DEG) / 2))
    height_px = 2 * int(np.ceil(px_per_rad * reach / np.cos(half_step_rad)))
    return CameraRig(_VIEWS, width_px, height_px, _FIELD_OF_VIEW_DEG, camera_height_m)


def resampled(picture: NDArray[np.uint8], model: Model, rig: CameraRig) -> Panorama:
    """What the rig's cameras would have seen: each ray's pixel by the model, interpolated."""
    height_px, width_px = picture.shape[:2]
    views = np.empty((rig.n_views, rig.height_px, rig.width_px, 3), dtype=np.uint8)
    for view, rays in zip(views, rig.ray_directions(), strict=True):
        x_px, y_px = (p.astype(np.float32) for p in model(rays, (width_px, height_px)))
        view[:] = cv2.remap(picture, x_px, y_px, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    return Panorama(rig, views)


def equirectangular(
    rays: Rays, size_px: tuple[int, int]
) -> tuple[NDArray[np.floating], NDArray[np.floating]]:
    """Azimuth over the width, falling from left to right; elevation over the height."""
    width_px, height_px = size_px
    x, y, z = np.moveaxis(rays, -1, 0)
    right = 0.5 - np.arctan2(y, x) / (2 * np.pi)
    down = 0.5 - np.arctan2(z, np.hypot(x, y)) / np.pi
    return right * width_px - 0.5, down * height_px - 0.5


MODELS: dict[str, Callable[..., Panorama]] = {"equirectangular": from_equirectangular}


def import_panorama(
    picture: str | Path,
    model: str = "equirectangular",
    camera_height_m: float = CameraRig.camera_height_m,
) -> Panorama:
    """The panorama in another camera's picture, a file. ImageError: it is not what ``model`` says.

    model: a name of ``MODELS``. camera_height_m: above the ground; lengths rest on it.
    """
    if model not in MODELS:
        raise ImageError(f"expected a model of {', '.join(MODELS)}, got {model!r}")
    return MODELS[model](read_image(picture), camera_height_m, what=str(picture))

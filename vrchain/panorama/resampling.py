"""Cameras resampled into a rig: how many pixels it needs, and which camera shows each of them."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vrchain.panorama.models import Model
from vrchain.panorama.panorama import Panorama
from vrchain.panorama.rig import CameraRig

REACH = 1.4  # slope, up and down: 54 degrees; 1.7 matched no more in rooms, 1.0 a quarter less
_VIEWS, _FIELD_OF_VIEW_DEG = 8, 60.0
_EDGE_PX = 0.51  # beyond the middle of the outermost pixel, and what rounding adds
_STEP_RAD = 1e-3  # over which pixels a radian are measured
_LOW = 10  # percentile: pixels a radian rise towards a flat picture's edges

Source = tuple[int, NDArray[np.float32], NDArray[np.float32], NDArray[np.uint8]]
"""A camera's number, its pixels x and y of a view's rays, and 1 where it is the one that counts."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A picture, its model, and the rotation (3, 3) from the camera's frame to the robot's.

    closed: its left and right edge meet.
    """

    picture: NDArray[np.uint8]
    model: Model
    turn: NDArray[np.float64] = field(default_factory=lambda: np.eye(3))
    closed: bool = False

    def pixels_of(self, rays: NDArray[np.floating]) -> tuple[NDArray, NDArray, NDArray[np.bool_]]:
        """Of the robot's rays (..., 3): pixels x and y, and whether they are seen."""
        height_px, width_px = self.picture.shape[:2]
        upright = np.array_equal(self.turn, np.eye(3))
        own = rays if upright else rays @ self.turn.astype(rays.dtype)
        x_px, y_px = self.model(own, (width_px, height_px))
        with np.errstate(invalid="ignore"):
            seen = (x_px >= -_EDGE_PX) & (x_px <= width_px - 1 + _EDGE_PX)
            seen &= (y_px >= -_EDGE_PX) & (y_px <= height_px - 1 + _EDGE_PX)
        if not self.closed:
            x_px = x_px.clip(0, width_px - 1)
        return x_px, y_px.clip(0, height_px - 1), seen


def rig_for(px_per_rad: float, camera_height_m: float, reach: float) -> CameraRig:
    """A ring of views of so many pixels a radian whose cylinder reaches slopes of +-``reach``."""
    half_step_rad = np.pi / _VIEWS
    width_px = round(2 * px_per_rad * np.tan(np.radians(_FIELD_OF_VIEW_DEG) / 2))
    height_px = 2 * int(np.ceil(px_per_rad * reach / np.cos(half_step_rad)))
    return CameraRig(_VIEWS, width_px, height_px, _FIELD_OF_VIEW_DEG, camera_height_m)


def resampled(cameras: Sequence[Camera], rig: CameraRig) -> Panorama:
    """What the rig's cameras would have seen: each ray's pixel by the model, interpolated.

    Of several cameras the one whose axis is nearest counts. What none sees is black, and masked.
    """
    return drawn([camera.picture for camera in cameras], sources_of(cameras, rig), rig)


def sources_of(cameras: Sequence[Camera], rig: CameraRig) -> Iterator[list[Source]]:
    """Of each of the rig's views in turn, the cameras that it is drawn of."""
    for rays in rig.ray_directions():
        nearest, owner = np.full(rays.shape[:2], -2.0), np.full(rays.shape[:2], -1)
        found = []
        for number, camera in enumerate(cameras):
            x_px, y_px, own = camera.pixels_of(rays)
            ahead = rays @ camera.turn[:, 0]
            own &= ahead > nearest
            np.copyto(nearest, ahead, where=own)
            owner[own] = number
            pixels = (np.nan_to_num(p).astype(np.float32) for p in (x_px, y_px))
            if own.any():
                found.append((number, *pixels))
        yield [(k, x, y, (owner == k).astype(np.uint8)) for k, x, y in found if (owner == k).any()]


def drawn(
    pictures: Sequence[NDArray[np.uint8]], sources: Iterable[list[Source]], rig: CameraRig
) -> Panorama:
    """The panorama that is drawn of these pictures, one of each camera."""
    shape = rig.n_views, rig.height_px, rig.width_px
    views, seen = np.zeros((*shape, 3), dtype=np.uint8), np.zeros(shape, dtype=bool)
    for view, shown, parts in zip(views, seen, sources, strict=True):
        for camera, x_px, y_px, own in parts:
            found = cv2.remap(
                pictures[camera], x_px, y_px, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP
            )
            cv2.copyTo(found, own, view)
            shown |= own.astype(bool)
    return Panorama(rig, views, None if seen.all() else seen)


def tilted(pitch_deg: float, roll_deg: float) -> NDArray[np.float64]:
    """The rotation (3, 3) from a tilted camera's frame to the upright one."""
    p, r = math.radians(pitch_deg), math.radians(roll_deg)
    up = [[math.cos(p), 0, -math.sin(p)], [0, 1, 0], [math.sin(p), 0, math.cos(p)]]
    over = [[1, 0, 0], [0, math.cos(r), -math.sin(r)], [0, math.sin(r), math.cos(r)]]
    return np.array(up) @ np.array(over)


@dataclass(frozen=True)
class Sharpness:
    """What cameras show: across, along: pixels a radian around the horizon and up and down; reach:
    the largest slope, up or down, that is seen, ``REACH`` at most. Nothing is seen: all 0."""

    across: float
    along: float
    reach: float


def sharpness(cameras: Sequence[Camera]) -> Sharpness:
    """Measured on a grid of rays, in the row nearest to the horizon where most is seen."""
    bearing = (np.arange(720) + 0.5) * np.pi / 360
    slope = np.linspace(-REACH, REACH, 281)
    seen = np.zeros((len(slope), len(bearing)), dtype=bool)
    for camera in cameras:
        seen |= camera.pixels_of(_rays(bearing, slope[:, None]))[2]
    rows = np.flatnonzero(seen.any(axis=1))
    if len(rows) == 0:
        return Sharpness(0.0, 0.0, 0.0)
    often = seen.sum(axis=1)
    best = np.flatnonzero(often > 0.9 * often.max())
    level = float(slope[best[np.abs(slope[best]).argmin()]])
    across: list[float] = []
    along: list[float] = []
    for camera in cameras:
        x_px, y_px, here = camera.pixels_of(_rays(bearing, level))
        for found, turned, raised in ((across, _STEP_RAD, 0.0), (along, 0.0, _STEP_RAD)):
            raised *= 1 + level**2  # slopes are steeper than elevations
            x, y, there = camera.pixels_of(_rays(bearing + turned, level + raised))
            both = here & there
            found += list(np.hypot(x - x_px, y - y_px)[both] / _STEP_RAD)
    thin = np.sqrt(1 + level**2)  # a turn moves a ray less above the horizon
    return Sharpness(
        float(np.percentile(across or [0.0], _LOW)),
        float(np.percentile(along or [0.0], _LOW)) * thin,
        float(np.abs(slope[rows]).max()),
    )


def _rays(bearing: NDArray[np.float64], slope: NDArray[np.float64] | float) -> NDArray[np.float64]:
    x, y, z = np.broadcast_arrays(np.cos(bearing), np.sin(bearing), slope)
    rays = np.stack([x, y, z], axis=-1)
    return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


def shrunk(cameras: Sequence[Camera], scale: float) -> list[Camera]:
    """The cameras with fewer pixels, each way, so that none is passed over.

    Whole ratios stay whole: two circles, or six faces, lie side by side in one picture.
    """
    if scale > 0.99:
        return list(cameras)
    found = []
    for camera in cameras:
        height_px, width_px = camera.picture.shape[:2]
        least = min(width_px, height_px)
        few = max(2, round(least * scale))
        size = round(width_px * few / least), round(height_px * few / least)
        fewer = cv2.resize(camera.picture, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
        found.append(replace(camera, picture=fewer))
    return found

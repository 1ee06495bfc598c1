"""Equirectangular pictures, made of what is known: directions, or a rendered panorama."""

import cv2
import numpy as np
from numpy.typing import NDArray

from vrchain.panorama import Panorama


def sphere_rays(width_px: int) -> NDArray[np.float64]:
    """The unit ray of every pixel of an equirectangular picture, (width_px / 2, width_px, 3)."""
    bearing = np.pi - (np.arange(width_px) + 0.5) * 2 * np.pi / width_px
    height_px = width_px // 2
    elevation = (np.pi / 2 - (np.arange(height_px) + 0.5) * np.pi / height_px)[:, None]
    flat = np.cos(elevation)
    parts = flat * np.cos(bearing), flat * np.sin(bearing), np.sin(elevation)
    return np.stack(np.broadcast_arrays(*parts), axis=-1)


def as_sphere(panorama: Panorama, width_px: int) -> NDArray[np.uint8]:
    """The panorama as an equirectangular picture; black where the rig does not look."""
    rig, rays = panorama.rig, sphere_rays(width_px)
    bearing, slope = np.arctan2(rays[..., 1], rays[..., 0]), rays[..., 2]
    slope = slope / np.hypot(rays[..., 0], rays[..., 1])
    owner = rig.view_of_bearing(bearing)
    x_px, y_px = (p.astype(np.float32) for p in rig.project(owner, bearing, slope))
    picture = np.zeros(rays.shape, dtype=np.uint8)
    for view, pixels in enumerate(panorama.views):
        drawn = cv2.remap(pixels, x_px, y_px, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT)
        picture[owner == view] = drawn[owner == view]
    return picture

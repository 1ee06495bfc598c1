"""What makes a panorama worse than a renderer draws it: each a function of the panorama and draws.

Sizes are for views of about 640 pixels; each camera of the ring is spoilt by itself.
"""

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from vrchain.panorama import Codec, Panorama
from vrchain.panorama.codec import decode_image

Views = NDArray[np.uint8]
Degradation = Callable[[Panorama, np.random.Generator], Panorama]

_BLUR_PX, _NOISE, _JPEG_QUALITY, _GAMMA = 2.0, 20.0, 20, 2.2
_SUN_SLOPE = 0.3
_DISC_RAD, _GLARE_RAD, _VEIL_RAD = 0.03, 0.12, 0.8
_GLARE, _VEIL = 200.0, 90.0  # grey levels that the sun adds where it stands


def unchanged(panorama: Panorama, draws: np.random.Generator) -> Panorama:
    """As it was drawn."""
    return panorama


def blurred(panorama: Panorama, draws: np.random.Generator) -> Panorama:
    """Out of focus: a Gaussian of 2 pixels."""
    return _each(panorama, lambda view: cv2.GaussianBlur(view, (0, 0), _BLUR_PX))


def noisy(panorama: Panorama, draws: np.random.Generator) -> Panorama:
    """Gaussian noise of 20 grey levels in every pixel and colour."""
    noise = draws.standard_normal(panorama.views.shape, dtype=np.float32) * _NOISE
    return replace(panorama, views=_grey_levels(panorama.views + noise))


def exposed(times: float) -> Degradation:
    """So many times as much light: brighter by a gamma of 2.2, what is over white is lost."""

    def expose(panorama: Panorama, draws: np.random.Generator) -> Panorama:
        table = _grey_levels(np.arange(256) * times ** (1 / _GAMMA))
        return replace(panorama, views=table[panorama.views])

    return expose


def sunflare(panorama: Panorama, draws: np.random.Generator) -> Panorama:
    """A low sun in some direction: a white disc, glare around it, and a veil over that side."""
    bearing = draws.uniform(-np.pi, np.pi)
    sun = np.array([np.cos(bearing), np.sin(bearing), _SUN_SLOPE]) / np.hypot(1, _SUN_SLOPE)
    away_rad = np.arccos(np.clip(panorama.rig.ray_directions() @ sun, -1, 1))[..., None]
    light = _GLARE * np.exp(-away_rad / _GLARE_RAD) + _VEIL * np.exp(-((away_rad / _VEIL_RAD) ** 2))
    light[away_rad < _DISC_RAD] = 255.0
    return replace(panorama, views=_grey_levels(panorama.views + light))


def compressed(panorama: Panorama, draws: np.random.Generator) -> Panorama:
    """JPEG of quality 20."""
    codec = Codec("jpeg", _JPEG_QUALITY)
    return _each(panorama, lambda view: decode_image(codec.encode(view), "a view"))


def tilted(panorama: Panorama, tilt_rad: float, axis_rad: float) -> Panorama:
    """What its cameras would see tilted about a horizontal axis, by the right hand's rule."""
    axis = np.array([np.cos(axis_rad), np.sin(axis_rad), 0.0])
    turn = cv2.Rodrigues(axis * tilt_rad)[0]
    rig, views = panorama.rig, np.empty_like(panorama.views)
    seen = None if panorama.seen is None else np.empty_like(panorama.seen)
    for n, (view, rays) in enumerate(zip(views, rig.ray_directions(), strict=True)):
        x, y, z = np.moveaxis(rays @ turn.T, -1, 0)
        bearing, slope = np.arctan2(y, x), z / np.hypot(x, y)
        owner = rig.view_of_bearing(bearing)
        x_px, y_px = (p.astype(np.float32) for p in rig.project(owner, bearing, slope))
        for k in np.unique(owner):
            own = owner == k
            drawn = cv2.remap(
                panorama.views[k], x_px, y_px, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
            )
            view[own] = drawn[own]
            if seen is not None and panorama.seen is not None:
                whole = panorama.seen[k].astype(np.uint8)
                seen[n][own] = cv2.remap(whole, x_px, y_px, cv2.INTER_NEAREST)[own] > 0
    return Panorama(rig, views, seen)


def _each(panorama: Panorama, change: Callable[[Views], object]) -> Panorama:
    views = np.stack([np.asarray(change(view), dtype=np.uint8) for view in panorama.views])
    return replace(panorama, views=views)


def _grey_levels(values: NDArray[np.floating]) -> Views:
    return np.asarray(np.clip(np.round(values), 0, 255), dtype=np.uint8)

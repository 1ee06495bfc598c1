"""What lies beyond the suburb: sky with clouds, and a belt of distant trees."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from vrchain.geometry import Pose
from vrchain.world import seasons, textures
from vrchain.world.light import Light
from vrchain.world.model import SceneObject, Surface, place
from vrchain.world.shapes import Image
from vrchain.world.suburb.streets import BEYOND_M

_RADIUS_M = 400.0
_LOWEST_RAD = np.radians(-6.0)


@dataclass(frozen=True)
class _Weather:
    """Colours of the sky by the time of day.

    cover: how much of the sky clouds take, 0 for fair weather; glow: exponent (larger is narrower)
    and strength of the brightness around the sun; dusk_rgb: of the horizon below the sun.
    """

    zenith_rgb: tuple[int, int, int]
    haze_rgb: tuple[int, int, int]
    cloud_rgb: tuple[int, int, int]
    foot_rgb: tuple[int, int, int]  # of thick clouds, from below
    cover: float
    glow: tuple[float, float]
    dusk_rgb: tuple[int, int, int]


_WEATHERS = {
    "noon": _Weather(
        (92, 148, 215), (205, 219, 231), (252, 252, 252), (235, 236, 238), 0.0, (60, 0.8),
        (205, 219, 231),
    ),
    "evening": _Weather(
        (98, 122, 176), (222, 203, 190), (250, 206, 170), (176, 142, 146), 0.0, (40, 0.75),
        (255, 186, 112),
    ),
    "overcast": _Weather(
        (178, 184, 191), (208, 212, 215), (222, 225, 228), (158, 165, 173), 1.0, (8, 0.12),
        (208, 212, 215),
    ),
}  # fmt: skip


def haze_rgb(light: Light) -> tuple[int, int, int]:
    """The colour of the sky at the horizon."""
    return _WEATHERS[light.time].haze_rgb


def build_sky(light: Light, rng: np.random.Generator) -> Surface:
    """A dome around the origin, seen from inside."""
    n, rings = 48, 14
    turn = np.linspace(0, 2 * np.pi, n + 1)
    level = np.linspace(0, 1, rings)
    tilt = _LOWEST_RAD + (np.pi / 2 - _LOWEST_RAD) * level
    grid_turn, grid_tilt = np.meshgrid(turn, tilt)
    unit = np.stack(
        [
            np.cos(grid_tilt) * np.cos(grid_turn),
            np.cos(grid_tilt) * np.sin(grid_turn),
            np.sin(grid_tilt),
        ],
        -1,
    )
    uv = np.stack(np.meshgrid(turn / (2 * np.pi), level), axis=-1)
    low = (np.arange(rings - 1)[:, None] * (n + 1) + np.arange(n)).ravel()
    high = low + n + 1
    faces = np.concatenate(
        [np.stack([low, high + 1, low + 1], 1), np.stack([low, high, high + 1], 1)]
    )
    points = _RADIUS_M * unit.reshape(-1, 3)
    return Surface(
        points.astype(np.float32),
        faces.astype(np.int32),
        uv.reshape(-1, 2).astype(np.float32),
        np.ones(len(points), dtype=np.float32),
        _sky_picture(light, rng, (320, 1024)),
    )


def _sky_picture(light: Light, rng: np.random.Generator, shape: textures.Shape) -> Image:
    """Azimuth across, elevation up; clouds lie on a flat layer, so they crowd at the horizon."""
    h, w = shape
    turn = (np.arange(w) + 0.5) / w * 2 * np.pi
    tilt = _LOWEST_RAD + (np.pi / 2 - _LOWEST_RAD) * (1 - (np.arange(h) + 0.5) / h)
    up = np.clip(np.sin(tilt), 0, 1)[:, None]
    weather = _WEATHERS[light.time]
    haze, zenith = np.array(weather.haze_rgb, float), np.array(weather.zenith_rgb, float)
    away = np.cos(turn - np.arctan2(light.direction[1], light.direction[0]))
    dusk = np.clip(0.5 + 0.5 * away, 0, 1) ** 2 * np.exp(-up / 0.22)
    image = haze + (zenith - haze) * (up**0.55)[..., None] * np.ones((1, w, 1))
    image += (np.array(weather.dusk_rgb) - image) * dusk[..., None]

    size = 512
    puffs = textures.fractal(rng, (size, size), 90, 6, tile=True)
    reach = 55.0 / (np.sin(np.maximum(tilt, 0)) + 0.12)[:, None]
    x, y = reach * np.cos(turn) % size, reach * np.sin(turn) % size
    cloud = cv2.remap(
        puffs,
        x.astype(np.float32),
        y.astype(np.float32),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_WRAP,
    )
    cover = np.clip((cloud + 0.05 + 2.0 * weather.cover) / 1.2, 0, 1) * np.clip(up / 0.12, 0, 1)
    thick = np.clip((cloud - 0.9 + 1.2 * weather.cover) / 1.2, 0, 1)[..., None]
    top, foot = np.array(weather.cloud_rgb, float), np.array(weather.foot_rgb, float)
    image += (top + (foot - top) * thick - image) * (0.9 * cover**0.8)[..., None]

    unit = np.stack(
        [
            np.cos(tilt)[:, None] * np.cos(turn),
            np.cos(tilt)[:, None] * np.sin(turn),
            np.sin(tilt)[:, None] + 0 * turn,
        ],
        -1,
    )
    narrow, strength = weather.glow
    glow = strength * np.clip(unit @ light.direction, 0, 1) ** narrow
    image += (np.array([255.0, 250.0, 235.0]) - image) * glow[..., None]
    return np.clip(image, 0, 255).astype(np.uint8)


def build_belt(
    extent_m: tuple[float, float], light: Light, season: str, rng: np.random.Generator
) -> SceneObject:
    """Two rings of wood outside the map, the farther one taller and paler; no landmark."""
    surfaces = [
        _ring(extent_m, BEYOND_M - 22.0, (5.0, 10.0), 0.25, light, season, rng),
        _ring(extent_m, BEYOND_M - 2.0, (9.0, 16.0), 0.55, light, season, rng),
    ]
    return place("wood", "backdrop", "wood", surfaces, Pose(0.0, 0.0), landmark=False, solid=False)


def _ring(
    extent_m: tuple[float, float],
    beyond_m: float,
    height_m: tuple[float, float],
    haze: float,
    light: Light,
    season: str,
    rng: np.random.Generator,
) -> Surface:
    n = 360
    turn = np.linspace(0, 2 * np.pi, n + 1)
    half = np.array(extent_m) / 2 + beyond_m
    # A rounded rectangle: |x/a|^6 + |y/b|^6 = 1.
    radius = (np.abs(np.cos(turn) / half[0]) ** 6 + np.abs(np.sin(turn) / half[1]) ** 6) ** (-1 / 6)
    foot = np.stack([radius * np.cos(turn), radius * np.sin(turn)], axis=1)
    foot[-1] = foot[0]
    height = _skyline(rng, n, height_m)
    points = np.concatenate(
        [np.column_stack([foot, np.full(n + 1, -0.2)]), np.column_stack([foot, height])]
    )
    walked = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(foot, axis=0), axis=1))])
    u = walked / walked[-1] * np.round(walked[-1] / 40.0)
    uv = np.column_stack([np.tile(u, 2), np.concatenate([np.zeros(n + 1), height / height_m[1]])])
    i = np.arange(n)
    faces = np.concatenate(
        [np.stack([i, n + 2 + i, i + 1], 1), np.stack([i, n + 1 + i, n + 2 + i], 1)]
    )
    green = textures.hsv(rng.uniform(80, 110), 0.4, 0.42)
    leaf = textures.leaves(
        rng, (96, 512), seasons.leaf(green, season, evergreen=False), 5.0
    ).astype(float)
    leaf *= np.linspace(1.1, 0.55, 96)[:, None, None]
    # The air before it has its own light; the wood's is that of leaves in the open.
    leaf *= light.towards(0.5, 0.5, 1.0, 1.0)
    texture = np.clip(leaf + haze * (haze_rgb(light) - leaf), 0, 255).astype(np.uint8)
    shade = np.ones(len(points), dtype=np.float32)
    return Surface(
        points.astype(np.float32), faces.astype(np.int32), uv.astype(np.float32), shade, texture
    )


def _skyline(
    rng: np.random.Generator, n: int, height_m: tuple[float, float]
) -> NDArray[np.float64]:
    """Tree tops: a closed sum of slow and fast waves, (n + 1,)."""
    low, high = height_m
    t = np.linspace(0, 2 * np.pi, n + 1)
    waves = sum(
        np.sin(k * t + rng.uniform(0, 2 * np.pi)) / k**0.25 for k in (3, 7, 13, 29, 61, 97, 131)
    )
    level = (waves - np.min(waves)) / np.ptp(waves)
    jagged = rng.uniform(-0.12, 0.12, n + 1)
    jagged[-1] = jagged[0]
    return np.asarray(low + (high - low) * np.clip(level + jagged, 0, 1))

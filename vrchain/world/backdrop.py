"""What every world of ours ends with: baked light, a belt of distant trees, and the sky."""

from collections.abc import Iterable
from typing import NamedTuple

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from vrchain import seeding
from vrchain.geometry import Pose
from vrchain.world import light, seasons, textures
from vrchain.world.light import Light
from vrchain.world.model import Scene, SceneObject, Surface, place
from vrchain.world.shapes import Image, grid_faces, sphere
from vrchain.world.spec import SceneSpec
from vrchain.world.suburb.streets import BEYOND_M

_Rgb = tuple[int, int, int]
_RADIUS_M = 400.0  # of the sky, or as much more as the map needs
_LOWEST_RAD = np.radians(-6.0)


class _Weather(NamedTuple):
    """Colours of the sky by the time of day.

    cover: how much of the sky clouds take, 0 for fair weather; glow: exponent (larger is narrower)
    and strength of the brightness around the sun; dusk_rgb: of the horizon below the sun.
    """

    zenith_rgb: _Rgb
    haze_rgb: _Rgb
    cloud_rgb: _Rgb
    foot_rgb: _Rgb  # of thick clouds, from below
    cover: float
    glow: tuple[float, float]
    dusk_rgb: _Rgb


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


def outdoors(
    spec: SceneSpec, standing: Iterable[SceneObject], floor: Iterable[SceneObject]
) -> Scene:
    """Things that stand on a floor, in the spec's light, season and extent."""
    sun = light.sunlight(spec.light)
    objects, ground_light = light.bake(standing, sun, spec.extent_m)
    draws = seeding.generator(spec.seed, "backdrop")
    return Scene(
        spec.name,
        spec.extent_m,
        (*objects, *floor, _tree_belt(spec.extent_m, sun, spec.season, draws)),
        build_sky(sun, seeding.generator(spec.seed, "sky"), spec.extent_m),
        haze_rgb(sun),
        spec.light,
        ground_light,
    )


def haze_rgb(light: Light) -> _Rgb:
    """The colour of the sky at the horizon."""
    return _WEATHERS[light.time].haze_rgb


def build_sky(light: Light, rng: Generator, extent_m: tuple[float, float]) -> Surface:
    """A dome around the origin, and all around a map, seen from inside."""
    n, rings = 48, 14
    turn, level = np.meshgrid(np.linspace(0, 2 * np.pi, n + 1), np.linspace(0, 1, rings))
    radius_m = max(_RADIUS_M, float(np.hypot(*extent_m)) / 2 + BEYOND_M)
    points = radius_m * sphere(turn, _LOWEST_RAD + (np.pi / 2 - _LOWEST_RAD) * level)
    picture = _sky_picture(light, rng, (320, 1024))
    # At the foot a texel is kept off, or the zenith's would shine through: pictures repeat.
    uv = np.stack([turn / (2 * np.pi), np.maximum(level, 1 / len(picture))], axis=-1)
    return _seen_from_inside(points, uv, picture)


def _seen_from_inside(
    points: NDArray[np.float64], uv: NDArray[np.float64], texture: Image
) -> Surface:
    """A surface in full light around the origin of points, (rows, columns, 3), rows upwards."""
    return Surface(
        points.reshape(-1, 3).astype(np.float32),
        grid_faces(*points.shape[:2])[:, [0, 2, 1]].astype(np.int32),
        uv.reshape(-1, 2).astype(np.float32),
        np.ones(points.shape[0] * points.shape[1], dtype=np.float32),
        texture,
    )


def _sky_picture(light: Light, rng: Generator, shape: textures.Shape) -> Image:
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
    x, y = x.astype(np.float32), y.astype(np.float32)
    cloud = cv2.remap(puffs, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
    cover = np.clip((cloud + 0.05 + 2.0 * weather.cover) / 1.2, 0, 1) * np.clip(up / 0.12, 0, 1)
    thick = np.clip((cloud - 0.9 + 1.2 * weather.cover) / 1.2, 0, 1)[..., None]
    top, foot = np.array(weather.cloud_rgb, float), np.array(weather.foot_rgb, float)
    image += (top + (foot - top) * thick - image) * (0.9 * cover**0.8)[..., None]

    narrow, strength = weather.glow
    unit = sphere(turn, tilt[:, None])
    glow = strength * np.clip(unit @ light.direction, 0, 1) ** narrow
    image += (np.array([255.0, 250.0, 235.0]) - image) * glow[..., None]
    return np.clip(image, 0, 255).astype(np.uint8)


def _tree_belt(
    extent_m: tuple[float, float], light: Light, season: str, rng: Generator
) -> SceneObject:
    """Two rings of distant trees outside the map, the farther taller and paler; no landmark."""
    rings = (BEYOND_M - 22.0, (5.0, 10.0), 0.25), (BEYOND_M - 2.0, (9.0, 16.0), 0.55)
    surfaces = []
    for beyond_m, height_m, haze in rings:
        foot, top = _belt_outline(extent_m, beyond_m, height_m, rng)
        walked = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(foot, axis=0), axis=1))])
        u = walked / walked[-1] * np.round(walked[-1] / 40.0)
        low, high = np.full_like(top, -0.2), top
        points = np.stack([np.column_stack([foot, z]) for z in (low, high)])
        uv = np.stack([np.column_stack([u, v]) for v in (np.zeros_like(u), top / height_m[1])])
        surfaces.append(_seen_from_inside(points, uv, _belt_picture(light, season, haze, rng)))
    return place("wood", "backdrop", "wood", surfaces, Pose(0.0, 0.0), landmark=False, solid=False)


def _belt_outline(
    extent_m: tuple[float, float], beyond_m: float, height_m: tuple[float, float], rng: Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where a ring of trees stands, (n + 1, 2), and their tops, (n + 1,): the first comes last."""
    n = 360
    turn = np.linspace(0, 2 * np.pi, n + 1)
    half = np.array(extent_m) / 2 + beyond_m
    # A rounded rectangle: |x/a|^6 + |y/b|^6 = 1.
    radius = (np.abs(np.cos(turn) / half[0]) ** 6 + np.abs(np.sin(turn) / half[1]) ** 6) ** (-1 / 6)
    foot = np.stack([radius * np.cos(turn), radius * np.sin(turn)], axis=1)
    waves = sum(
        np.sin(k * turn + rng.uniform(0, 2 * np.pi)) / k**0.25 for k in (3, 7, 13, 29, 61, 97, 131)
    )
    level = (waves - np.min(waves)) / np.ptp(waves)
    jagged = rng.uniform(-0.12, 0.12, n + 1)
    foot[-1], jagged[-1] = foot[0], jagged[0]
    low, high = height_m
    return foot, np.asarray(low + (high - low) * np.clip(level + jagged, 0, 1))


def _belt_picture(light: Light, season: str, haze: float, rng: Generator) -> Image:
    """Foliage behind ``haze`` (0..1) of air, darker at its foot."""
    green = textures.hsv(rng.uniform(80, 110), 0.4, 0.42)
    colour = seasons.leaf(green, season, evergreen=False)
    leaf = textures.leaves(rng, (96, 512), colour, 5.0).astype(float)
    leaf *= np.linspace(1.1, 0.55, 96)[:, None, None]
    # The air before it has its own light; the trees' is that of leaves in the open.
    leaf *= light.towards(0.5, 0.5, 1.0, 1.0)
    return np.clip(leaf + haze * (haze_rgb(light) - leaf), 0, 255).astype(np.uint8)

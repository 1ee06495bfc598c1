"""The robots' own look: a Pioneer P3-AT with a camera head on a mast and a flag with its name.

Model frame: the front towards +x, the middle at the origin, wheels on z = 0.
"""

import zlib
from collections.abc import Iterable, Mapping
from functools import cache

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from vrchain.geometry import Pose
from vrchain.seeding import generator
from vrchain.world import light, textures
from vrchain.world.drawing import write_within
from vrchain.world.model import Scene, SceneObject, Surface, place
from vrchain.world.shapes import Image, Model, Part, box, join, polygon, tube, wall
from vrchain.world.textures import Colour

FIRST_ID = -2  # robots are no objects of a scene: their ids count down from here (-1 is the sky)
SIZE_M = (0.51, 0.50, 0.28)  # without mast and scanner

_RED, _BLACK = (186.0, 28.0, 26.0), (34.0, 34.0, 37.0)
_AXLE_M, _TYRE_M, _TYRE_WIDTH_M = 0.134, 0.11, 0.09  # from the middle; radius; width
_DECK_M = 0.245  # the top plate's underside
_HEAD_M = (0.95, 1.05)  # the camera head, around the rig's usual height
_FLAG_M = (0.58, 0.74)


def placed(scene: Scene, robots: Mapping[str, Pose]) -> tuple[SceneObject, ...]:
    """Robots at their poses in the order given, each of one surface, lit by the scene's sun."""
    sun = light.sunlight(scene.light)
    return tuple(
        light.lit(place(name, "robot", "pioneer", [build(name)], pose, landmark=False), sun)
        for name, pose in robots.items()
    )


@cache
def build(name: str) -> Surface:
    """The robot of a name, in its own frame. Only the flag differs between robots."""
    rng, model = generator(0, "pioneer"), Model()
    _body(model, rng)
    _wheels(model, rng)
    metal = model.patch(textures.plain(rng, (150, 152, 156)))
    dark = model.patch(textures.plain(rng, _BLACK))
    model.add(tube((0, 0, SIZE_M[2]), (0, 0, _HEAD_M[0]), 0.018), metal)
    flag = box((-0.08, -0.08, _FLAG_M[0]), (0.08, 0.08, _FLAG_M[1]), bottom=True)
    model.add(flag, _lettered(name, colour_of(name)))
    low, high = _HEAD_M
    model.add_drum((0, 0, low), (0, 0, high), 0.055, 16, model.patch(_lenses()), dark)
    model.add(tube((0, 0, low - 0.02), (0, 0, low), 0.02, 0.055, n=16), dark)
    range_ring = (0.16, 0, SIZE_M[2]), (0.16, 0, 0.35)
    model.add_drum(*range_ring, 0.05, 16, model.patch(_scanner()), dark)
    return model.surface()


def colour_of(name: str) -> Colour:
    """The flag's colour (r, g, b) in 0..255; R1, R2, ... are far apart in hue."""
    digits = name[len(name.rstrip("0123456789")) :]
    number = int(digits) if digits else zlib.crc32(name.encode())
    return textures.hsv(137.508 * (number % 997), 0.85, 0.9)  # the golden angle never comes round


def _octagon(half_x: float, half_y: float, cut: float) -> NDArray[np.float64]:
    """A rectangle's outline, (8, 2), with its corners cut off; the first side faces +x."""
    x, y, c = half_x, half_y, cut
    half = np.array([(x, c - y), (x, y - c), (x - c, y), (c - x, y)])
    return np.concatenate([half, -half])


def _ring(outline: NDArray[np.float64], low_m: float, high_m: float) -> list[Part]:
    """The upright sides of an outline, in its order."""
    ends = np.roll(outline, -1, axis=0)
    return [wall(a, b, low_m, high_m) for a, b in zip(outline, ends, strict=True)]


def _level(outline: NDArray[np.float64], height_m: float) -> Part:
    """The outline's inside, facing up."""
    uv = (outline - outline.min(axis=0)) / np.ptp(outline, axis=0)
    return polygon(np.insert(outline, 2, height_m, axis=1), uv)


def _body(model: Model, rng: Generator) -> None:
    red = model.patch(textures.plain(rng, _RED, (32, 32), 0.03))
    black = model.patch(textures.plain(rng, _BLACK, (48, 48), 0.04))
    hull = _octagon(SIZE_M[0] / 2, SIZE_M[1] / 2 - _TYRE_WIDTH_M, 0.07)
    front = model.patch(_front())
    for i, part in enumerate(_ring(hull, 0.07, 0.2)):
        model.add(part, red if i else front, 0.9)
    model.add(_level(hull, 0.2), red)
    sonars = {n: model.patch(_sonars(n)) for n in (2, 4)}
    for i, part in enumerate(_ring(_octagon(0.235, 0.15, 0.08), 0.2, _DECK_M)):  # long sides: 2, 6
        model.add(part, sonars[4 if i in (2, 6) else 2])
    plate = _octagon(SIZE_M[0] / 2, 0.19, 0.1)
    model.add(join(_ring(plate, _DECK_M, SIZE_M[2])), black)
    model.add(_level(plate, SIZE_M[2]), black)
    model.add(_level(_octagon(0.23, 0.23, 0.06), 0.004), black, 0.5)  # hardly any light gets there


def _wheels(model: Model, rng: Generator) -> None:
    tyre = model.patch(textures.plain(rng, (30, 30, 32)))
    hub = model.patch(_hub())
    outer = SIZE_M[1] / 2
    for x in (-_AXLE_M, _AXLE_M):
        for sign in (-1, 1):
            ends = (x, sign * (outer - _TYRE_WIDTH_M), _TYRE_M), (x, sign * outer, _TYRE_M)
            model.add_drum(*ends, _TYRE_M, 16, tyre, hub)


def _canvas(shape: tuple[int, int], rgb: Colour) -> Image:
    return np.full((*shape, 3), rgb, dtype=np.uint8)


def _lettered(name: str, rgb: Colour) -> Image:
    """A plain board with a name as large as fits, white or black, whichever is plainer."""
    image = _canvas((64, 64), rgb)
    ink = (250, 250, 250) if np.dot(rgb, (0.3, 0.59, 0.11)) < 150 else (15, 15, 15)
    write_within(image, name, (0.08, 0.2, 0.92, 0.8), ink, 2.5)
    return image


def _dots(image: Image, centres: Iterable[tuple[int, int]], radius_px: int, rgb: Colour) -> None:
    for centre in centres:
        cv2.circle(image, centre, radius_px, rgb, -1, cv2.LINE_AA)


def _front() -> Image:
    """The nose: a bumper and two lights, by which people tell front from rear."""
    image = _canvas((32, 48), _RED)
    image[22:] = _BLACK
    _dots(image, ((9, 11), (38, 11)), 5, (245, 242, 225))
    return image


def _sonars(n: int) -> Image:
    image = _canvas((12, 16 * n), (24, 24, 26))
    _dots(image, ((16 * i + 8, 6) for i in range(n)), 4, (196, 160, 70))
    return image


def _hub() -> Image:
    image = _canvas((40, 40), (30, 30, 32))
    _dots(image, ((20, 20),), 12, (165, 165, 168))
    holes = np.arange(5) * 2 * np.pi / 5
    centres = ((round(20 + 7 * np.cos(t)), round(20 + 7 * np.sin(t))) for t in holes)
    _dots(image, centres, 2, (60, 60, 62))
    return image


def _lenses() -> Image:
    """The camera head unrolled: eight lenses."""
    image = _canvas((20, 128), (58, 60, 66))
    _dots(image, ((16 * i + 8, 10) for i in range(8)), 5, (14, 16, 24))
    _dots(image, ((16 * i + 7, 8) for i in range(8)), 1, (190, 205, 225))
    return image


def _scanner() -> Image:
    image = _canvas((16, 32), (44, 46, 52))
    image[5:10] = (30, 80, 170)
    return image

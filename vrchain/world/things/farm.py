"""Things of a farm: high walls, a shed, a water tower, straw bales, a trough.

Model frame: the middle at the origin, standing on z = 0; what has a front turns it to -y.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.random import Generator

from vrchain.world import textures
from vrchain.world.buildings import roofs
from vrchain.world.drawing import Share, fill, frame, star, write_within
from vrchain.world.model import Surface
from vrchain.world.shapes import Image, Model, Rect, box, tube, wall
from vrchain.world.textures import Colour, random_hsv

_Surfaces = tuple[Surface, ...]
_PX_PER_M = 36.0
_BONDS = {"stone": (textures.stone, 35.0, 0.15), "brick": (textures.brick, 12.0, 0.5)}
_PAINT = ((6, 0.62, 0.56), (205, 0.5, 0.5), (145, 0.42, 0.4), (44, 0.55, 0.78), (22, 0.55, 0.42))
_ADVERTS = ("FEED", "SEEDS", "MILK", "FLOUR", "CIDER", "HONEY", "WOOL", "CORN", "OATS", "EGGS")
_FARMS = ("HILL FARM", "OAK FARM", "MILL FARM", "ROSE FARM", "HIGH FARM", "LONG ACRE", "ELM FARM")


@dataclass(frozen=True, eq=False)
class WallPlan:
    """One run of a high wall. front, back: (h, w, 3) uint8, what its long sides show."""

    length_m: float
    height_m: float
    front: Image
    back: Image


def wall_plans(
    n: int, length_m: float, height_m: float, material: str, rng: Generator
) -> list[WallPlan]:
    """The runs of one wall of "stone" or "brick", painted as a whole, so that they fit together."""
    bond, hue, saturation = _BONDS[material]
    rgb = textures.hsv(hue + rng.uniform(-8, 8), saturation, rng.uniform(0.55, 0.8))
    width_px = round(length_m * _PX_PER_M)
    shape = (round(height_m * _PX_PER_M), n * width_px)

    def side() -> Image:
        image = bond(rng, shape, rgb, _PX_PER_M).astype(np.float32)
        image *= (1 + 0.13 * textures.fractal(rng, shape, 45, 4))[..., None]
        damp = np.linspace(1.04, 0.72, shape[0], dtype=np.float32)[:, None, None]
        return np.clip(image * damp, 0, 255).astype(np.uint8)

    fronts, backs = np.hsplit(side(), n), np.hsplit(side(), n)[::-1]  # seen from the other side
    return [WallPlan(length_m, height_m, *faces) for faces in zip(fronts, backs, strict=True)]


def high_wall(plan: WallPlan, rng: Generator) -> _Surfaces:
    """A wall higher than a man along x, with buttresses and a coping."""
    model = Model()
    half, thick, top = plan.length_m / 2, 0.2, plan.height_m
    end = plan.front[:, : round(2 * thick * _PX_PER_M)]
    for sides, image in (("f", plan.front), ("b", plan.back), ("lr", end)):
        face = box((-half, -thick, 0), (half, thick, top), top=False, sides=sides)
        model.add(face, image)
    coping = textures.plain(rng, random_hsv(rng, (20, 45), 0.08, (0.5, 0.75)), (12, 128), 0.12)
    lid = box((-half, -thick - 0.05, top), (half, thick + 0.05, top + 0.1), bottom=True)
    model.add(lid, coping)
    for y0, y1, image in ((-thick - 0.16, -thick, plan.front), (thick, thick + 0.16, plan.back)):
        for x in (-half + 1.2, half - 1.7):
            column = int(rng.integers(image.shape[1] - 20))
            high = top - rng.uniform(0.5, 0.9)
            stones = image[-round(high * _PX_PER_M) :, column : column + 18]
            model.add(box((x, y0, 0), (x + 0.5, y1, high)), stones)
    return (model.surface(),)


def shed(rng: Generator) -> _Surfaces:
    """A field shed of boards under a gable, an advertisement painted on its front."""
    model = Model()
    w, d, top = rng.uniform(5.4, 6.2), rng.uniform(3.2, 3.8), rng.uniform(2.5, 2.8)
    rgb = textures.hsv(*_PAINT[int(rng.integers(len(_PAINT)))])
    trim_rgb = textures.hsv(45, 0.06, 0.93)
    x, y = w / 2, d / 2

    def boards(width_m: float, height_m: float) -> Image:
        shape = (round(height_m * _PX_PER_M), round(width_m * _PX_PER_M))
        plain = textures.boards(rng, shape, rgb, _PX_PER_M)
        worn = (1 + 0.1 * textures.fractal(rng, shape, 40, 4))[..., None]
        image = np.clip(plain * worn, 0, 255).astype(np.uint8)
        frame(image, (0, 0, shape[1] - 1, shape[0] - 1), trim_rgb, 5)
        return image

    front = boards(w, top)
    _advert(rng, front, (0.05, 0.1, 0.62, 0.9))
    _door(rng, front, (0.7, 0.92), 0.2, rgb, trim_rgb)
    around = Rect(-x, -y, x, y)
    model.add(wall(*around.side("f"), 0, top), front)
    model.add(wall(*around.side("b"), 0, top), boards(w, top))
    slopes = (rng.uniform(0.55, 0.7),)
    for side in "rl":
        part, width, height = roofs.gable_wall(around.side(side), 0.0, top, slopes)
        model.add(part, boards(width, height))
    faces = roofs.roof("gable_x", around, top, slopes, 0.3)
    shape = (round(faces.slope_m * 24), round(faces.length_m * 24))
    tiles = textures.hsv(rng.choice([8, 20, 210]), 0.35, rng.uniform(0.36, 0.5))
    model.add(faces.cover, textures.shingles(rng, shape, tiles, 24.0))
    model.add(faces.soffit, textures.plain(rng, textures.times(rgb, 0.6)), 0.8)
    model.add(faces.fascia, textures.plain(rng, trim_rgb))
    return (model.surface(),)


def _advert(rng: Generator, image: Image, share: Share) -> None:
    """A painted board on a share of a picture: big word, frame, three stars."""
    h, w = image.shape[:2]
    x0, y0, x1, y1 = (round(s * n) for s, n in zip(share, (w, h, w, h), strict=True))
    hue = rng.uniform(0, 360)
    ground, ink = textures.hsv(hue, 0.22, 0.93), textures.hsv(hue + 180, 0.75, 0.4)
    board = textures.plain(rng, ground, (y1 - y0, x1 - x0), 0.04)
    bh, bw = board.shape[:2]
    frame(board, (4, 4, bw - 5, bh - 5), ink, 3)
    write_within(board, str(rng.choice(_ADVERTS)), (0.08, 0.1, 0.92, 0.5), ink)
    n = int(rng.integers(5, 10))
    for x in np.linspace(0.2, 0.8, 3) * bw:
        star(board, (x, 0.74 * bh), 0.15 * bh, n, random_hsv(rng, (0, 360), 0.7, (0.4, 0.8)), 0.45)
    image[y0:y1, x0:x1] = board


def _door(
    rng: Generator, image: Image, x_share: tuple[float, float], y_share: float, rgb: Colour,
    trim_rgb: Colour,
) -> None:  # fmt: skip
    """A braced door down to the foot of a wall; where it is, as shares from the left and top."""
    h, w = image.shape[:2]
    x0, x1, y0 = round(x_share[0] * w), round(x_share[1] * w), round(y_share * h)
    leaf = (h - y0, x1 - x0)
    image[y0:h, x0:x1] = textures.boards(rng, leaf, textures.times(rgb, 0.7), _PX_PER_M)
    frame(image, (x0, y0, x1, h), trim_rgb, 4)
    middle = (y0 + h) // 2
    for left, right in ((h, middle), (middle, middle), (middle, y0)):
        cv2.line(image, (x0, left), (x1, right), trim_rgb, 4)


def water_tower(rng: Generator) -> _Surfaces:
    """A painted tank under a cone, on four braced legs with a board; a little over 5 m high."""
    model = Model()
    r, low, high = rng.uniform(1.5, 1.75), rng.uniform(2.0, 2.3), rng.uniform(4.3, 4.6)
    rgb = random_hsv(rng, (0, 360), (0.25, 0.6), (0.55, 0.85))
    timber = random_hsv(rng, (18, 32), 0.4, (0.3, 0.45))
    leg = model.patch(textures.wood(rng, (128, 16), timber))
    foot = 0.8 * r
    ring = foot * np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    for k in range(4):
        (ax, ay), (bx, by) = ring[k], ring[(k + 1) % 4]
        model.add(tube((1.1 * ax, 1.1 * ay, 0), (0.8 * ax, 0.8 * ay, low), 0.12, n=6), leg)
        for z0, z1 in ((0.25, low - 0.2), (low - 0.2, 0.25)):
            model.add(tube((ax, ay, z0), (bx, by, z1), 0.05, n=5), leg)
    deck = model.patch(textures.wood(rng, (64, 64), timber))
    front = textures.wood(rng, (round(1.5 * _PX_PER_M), round(2 * foot * _PX_PER_M)), timber, True)
    _advert(rng, front, (0.02, 0.03, 0.98, 0.97))
    board = (-foot, -foot - 0.2, 0.35), (foot, -foot - 0.14, 1.85)
    model.add(box(*board, bottom=True, sides="f"), front)
    model.add(box(*board, top=False, sides="blr"), deck)
    disc = box((-r - 0.1, -r - 0.1, low - 0.12), (r + 0.1, r + 0.1, low), bottom=True)
    model.add(disc, deck, 0.85)
    model.add(tube((0, 0, low), (0, 0, high), r, n=24), _tank(rng, rgb, r, high - low))
    roof = model.patch(textures.metal_sheet(rng, (40, 256), textures.times(rgb, 0.7), 24.0))
    eave = (0, 0, high - 0.02)
    model.add(tube(eave, (0, 0, high + 0.42 * r), r + 0.18, 0.02, n=24), roof)
    model.add(tube(eave, (0, 0, high), r + 0.18, 0.1, n=24), roof, 0.7)
    return (model.surface(),)


def _tank(rng: Generator, rgb: Colour, radius_m: float, height_m: float) -> Image:
    """Staves and hoops, a chequered band, and on three sides the farm's name, year and goods."""
    shape = (round(height_m * _PX_PER_M), round(2 * np.pi * radius_m * _PX_PER_M))
    image = textures.boards(rng, shape, rgb, _PX_PER_M)
    ink, pale = textures.times(rgb, 0.3), textures.hsv(48, 0.1, 0.96)
    for y in np.linspace(3, shape[0] - 4, 5):
        cv2.line(image, (0, round(y)), (shape[1], round(y)), textures.times(rgb, 0.45), 2)
    cell, first = shape[1] // 28, round(0.74 * shape[0])
    for k in range(28):
        row = first + (k % 2) * cell // 2
        fill(image, (k * cell, row, (k + 1) * cell - 1, row + cell // 2), pale)
    lines = (str(rng.choice(_FARMS)), f"EST {rng.integers(1850, 1960)}", str(rng.choice(_ADVERTS)))
    for third, line in enumerate(lines):
        x0, x1 = (round((third + s) / 3 * shape[1]) for s in (0.05, 0.95))
        plate = image[round(0.14 * shape[0]) : round(0.62 * shape[0]), x0:x1]
        plate[:] = textures.plain(rng, pale, plate.shape[:2], 0.05)
        write_within(plate, line, (0.05, 0.25, 0.95, 0.75), ink)
    return image


def bales(rng: Generator) -> _Surfaces:
    """Three round straw bales, one on two."""
    model = Model()
    r, half = rng.uniform(0.62, 0.7), rng.uniform(0.55, 0.65)
    straw = random_hsv(rng, (40, 50), (0.45, 0.6), (0.7, 0.85))
    skin = model.patch(_straw(rng, straw, (96, 256)))
    for x, z in ((-1.02 * r, r), (1.02 * r, r), (0.0, 2.72 * r)):
        end = model.patch(_spiral(rng, straw))
        for y in (-half, half):
            model.add_drum((x, 0, z), (x, y, z), r, 16, skin, end)
    return (model.surface(),)


def _straw(rng: Generator, rgb: Colour, shape: tuple[int, int]) -> Image:
    grain = textures.wood(rng, shape, rgb, along_x=True)
    stalks = (1 + 0.12 * textures.noise(rng, shape, 2))[..., None]
    image = np.clip(grain * stalks, 0, 255).astype(np.uint8)
    for y in np.linspace(12, shape[0] - 12, 4):
        cv2.line(image, (0, round(y)), (shape[1], round(y)), textures.times(rgb, 0.6), 1)
    return image


def _spiral(rng: Generator, rgb: Colour, size_px: int = 72) -> Image:
    y, x = np.mgrid[:size_px, :size_px] - (size_px - 1) / 2
    turn, reach = np.arctan2(y, x), np.hypot(x, y)
    wave = np.sin(2 * np.pi * reach / rng.uniform(6, 9) + turn + rng.uniform(0, 2 * np.pi))
    light = 0.2 * wave + 0.07 * textures.noise(rng, (size_px, size_px), 2) - 0.05
    return textures.coloured(rgb, light.astype(np.float32))


def trough(rng: Generator) -> _Surfaces:
    """A stone trough with water, along x."""
    model = Model()
    half, deep, high = rng.uniform(0.9, 1.2), 0.35, rng.uniform(0.5, 0.6)
    rgb = random_hsv(rng, (25, 50), 0.1, (0.5, 0.65))
    stones = textures.stone(rng, (40, 128), rgb, 60.0)
    model.add(box((-half, -deep, 0), (half, deep, high), top=False), stones)
    rim = model.patch(textures.plain(rng, textures.times(rgb, 1.15), (16, 64), 0.12))
    x, y = half - 0.1, deep - 0.1  # of the water
    for x0, y0, x1, y1 in (
        (-half, -deep, half, -y), (-half, y, half, deep), (-half, -y, -x, y), (x, -y, half, y),
    ):  # fmt: skip
        model.add(box((x0, y0, high), (x1, y1, high + 0.04)), rim)
    water = textures.plain(rng, (70.0, 96.0, 112.0), (16, 32), 0.08)
    model.add(box((-x, -y, 0), (x, y, high - 0.02), sides=""), water)
    return (model.surface(),)

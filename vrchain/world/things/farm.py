"""Things of a farm: high walls, a shed, a water tower, straw bales, a trough.

Model frame: the middle at the origin, standing on z = 0; what has a front turns it to -y.
"""

from dataclasses import dataclass

import cv2
import numpy as np

from vrchain.world import textures
from vrchain.world.buildings import roofs
from vrchain.world.model import Surface
from vrchain.world.shapes import Image, Model, Part, box, polygon, tube, wall
from vrchain.world.textures import Colour

_Surfaces = tuple[Surface, ...]
_PX_PER_M = 36.0
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
    n: int, length_m: float, height_m: float, material: str, rng: np.random.Generator
) -> list[WallPlan]:
    """The runs of one wall of "stone" or "brick", painted as a whole, so that they fit together."""
    bond, hue, saturation = {
        "stone": (textures.stone, 35.0, 0.15),
        "brick": (textures.brick, 12.0, 0.5),
    }[material]
    rgb = textures.hsv(hue + rng.uniform(-8, 8), saturation, rng.uniform(0.55, 0.8))
    width_px = round(length_m * _PX_PER_M)
    shape = (round(height_m * _PX_PER_M), n * width_px)

    def side() -> Image:
        image = bond(rng, shape, rgb, _PX_PER_M).astype(np.float32)
        image *= (1 + 0.13 * textures.fractal(rng, shape, 45, 4))[..., None]
        damp = np.linspace(1.04, 0.72, shape[0], dtype=np.float32)[:, None, None]
        return np.clip(image * damp, 0, 255).astype(np.uint8)

    front, back = side(), side()[:, ::-1]  # the back is seen from the other side
    cuts = [slice(k * width_px, (k + 1) * width_px) for k in range(n)]
    return [
        WallPlan(length_m, height_m, front[:, cut], np.ascontiguousarray(back[:, cut][:, ::-1]))
        for cut in cuts
    ]


def high_wall(plan: WallPlan, rng: np.random.Generator) -> _Surfaces:
    """A wall higher than a man along x, with buttresses and a coping."""
    model = Model()
    half, thick, top = plan.length_m / 2, 0.2, plan.height_m
    for side, image in (("f", plan.front), ("b", plan.back)):
        face = box((-half, -thick, 0), (half, thick, top), top=False, sides=side)
        model.add(face, model.patch(image))
    ends = box((-half, -thick, 0), (half, thick, top), top=False, sides="lr")
    model.add(ends, model.patch(plan.front[:, : round(2 * thick * _PX_PER_M)]))
    grey = textures.hsv(rng.uniform(20, 45), 0.08, rng.uniform(0.5, 0.75))
    coping = model.patch(textures.plain(rng, grey, (12, 128), 0.12))
    lid = box((-half, -thick - 0.05, top), (half, thick + 0.05, top + 0.1), bottom=True)
    model.add(lid, coping)
    for y0, y1, image in ((-thick - 0.16, -thick, plan.front), (thick, thick + 0.16, plan.back)):
        for x in (-half + 1.2, half - 1.7):
            column = int(rng.integers(image.shape[1] - 20))
            high = top - rng.uniform(0.5, 0.9)
            stones = image[-round(high * _PX_PER_M) :, column : column + 18]
            model.add(box((x, y0, 0), (x + 0.5, y1, high)), model.patch(stones))
    return (model.surface(),)


def shed(rng: np.random.Generator) -> _Surfaces:
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
        cv2.rectangle(image, (0, 0), (shape[1] - 1, shape[0] - 1), trim_rgb, 5)
        return image

    front = boards(w, top)
    _advert(rng, front, (0.05, 0.1, 0.62, 0.9))
    _door(rng, front, (0.7, 0.2, 0.92), rgb, trim_rgb)
    model.add(wall((-x, -y), (x, -y), 0, top), model.patch(front))
    model.add(wall((x, y), (-x, y), 0, top), model.patch(boards(w, top)))
    pitch = rng.uniform(0.55, 0.7)
    rise = pitch * y
    for a, b in (((x, -y), (x, y)), ((-x, y), (-x, -y))):
        v = top / (top + rise)
        side = wall(a, b, 0, top)
        corners = [*side.points[:3], (a[0], 0.0, top + rise), side.points[3]]
        uv = [(0, 0), (1, 0), (1, v), (0.5, 1), (0, v)]
        model.add(polygon(corners, uv), model.patch(boards(d, top + rise)))
    faces = roofs.roof("gable_x", (-x, -y, x, y), top, pitch, 0.3)
    shape = (round(faces.slope_m * 24), round(faces.length_m * 24))
    tiles = textures.hsv(rng.choice([8, 20, 210]), 0.35, rng.uniform(0.36, 0.5))
    model.add(faces.cover, model.patch(textures.shingles(rng, shape, tiles, 24.0)))
    model.add(faces.soffit, model.patch(textures.plain(rng, textures.times(rgb, 0.6))), 0.8)
    model.add(faces.fascia, model.patch(textures.plain(rng, trim_rgb)))
    return (model.surface(),)


def _advert(
    rng: np.random.Generator, image: Image, share: tuple[float, float, float, float]
) -> None:
    """A painted board on part (x0, y0, x1, y1 in 0..1) of a picture: big word, frame, emblem."""
    h, w = image.shape[:2]
    x0, y0, x1, y1 = (round(s * n) for s, n in zip(share, (w, h, w, h), strict=True))
    hue = rng.uniform(0, 360)
    ground, ink = textures.hsv(hue, 0.22, 0.93), textures.hsv(hue + 180, 0.75, 0.4)
    board = textures.plain(rng, ground, (y1 - y0, x1 - x0), 0.04)
    bh, bw = board.shape[:2]
    cv2.rectangle(board, (4, 4), (bw - 5, bh - 5), ink, 3)
    _words(board, str(rng.choice(_ADVERTS)), (0.08, 0.1, 0.92, 0.5), ink)
    n, r = int(rng.integers(5, 10)), 0.15 * bh
    for centre in np.linspace(0.2, 0.8, 3) * bw:
        turn = np.arange(2 * n) * np.pi / n
        reach = np.where(np.arange(2 * n) % 2, 0.45, 1.0) * r
        star = np.column_stack([centre + reach * np.cos(turn), 0.74 * bh + reach * np.sin(turn)])
        colour = textures.hsv(rng.uniform(0, 360), 0.7, rng.uniform(0.4, 0.8))
        cv2.fillPoly(board, [np.round(star).astype(np.int32)], colour, cv2.LINE_AA)
    image[y0:y1, x0:x1] = board


def _words(image: Image, text: str, share: tuple[float, float, float, float], ink: Colour) -> None:
    """Text as large as fits a part (x0, y0, x1, y1 in 0..1) of a picture, in its middle."""
    h, w = image.shape[:2]
    x0, y0, x1, y1 = (s * n for s, n in zip(share, (w, h, w, h), strict=True))
    (tw, th), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_DUPLEX, 1.0, 2)
    scale = min((x1 - x0) / tw, (y1 - y0) / th)
    at = (round((x0 + x1 - scale * tw) / 2), round((y0 + y1 + scale * th) / 2))
    thick = max(1, round(2.2 * scale))
    cv2.putText(image, text, at, cv2.FONT_HERSHEY_DUPLEX, scale, ink, thick, cv2.LINE_AA)


def _door(
    rng: np.random.Generator,
    image: Image,
    share: tuple[float, float, float],
    rgb: Colour,
    trim_rgb: Colour,
) -> None:
    """A braced door from x0 to x1, as high as y (0..1 from the top), down to the foot."""
    h, w = image.shape[:2]
    x0, x1, y0 = round(share[0] * w), round(share[2] * w), round(share[1] * h)
    image[y0:h, x0:x1] = textures.boards(
        rng, (h - y0, x1 - x0), textures.times(rgb, 0.7), _PX_PER_M
    )
    cv2.rectangle(image, (x0, y0), (x1, h), trim_rgb, 4)
    cv2.line(image, (x0, h), (x1, (y0 + h) // 2), trim_rgb, 4)
    cv2.line(image, (x0, (y0 + h) // 2), (x1, (y0 + h) // 2), trim_rgb, 4)
    cv2.line(image, (x0, (y0 + h) // 2), (x1, y0), trim_rgb, 4)


def water_tower(rng: np.random.Generator) -> _Surfaces:
    """A painted tank under a cone, on four braced legs with a board; a little over 5 m high."""
    model = Model()
    r, low, high = rng.uniform(1.5, 1.75), rng.uniform(2.0, 2.3), rng.uniform(4.3, 4.6)
    rgb = textures.hsv(rng.uniform(0, 360), rng.uniform(0.25, 0.6), rng.uniform(0.55, 0.85))
    timber = textures.hsv(rng.uniform(18, 32), 0.4, rng.uniform(0.3, 0.45))
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
    board = box((-foot, -foot - 0.2, 0.35), (foot, -foot - 0.14, 1.85), bottom=True, sides="f")
    model.add(board, model.patch(front))
    back = box((-foot, -foot - 0.2, 0.35), (foot, -foot - 0.14, 1.85), top=False, sides="blr")
    model.add(back, deck)
    disc = box((-r - 0.1, -r - 0.1, low - 0.12), (r + 0.1, r + 0.1, low), bottom=True)
    model.add(disc, deck, 0.85)
    tank = tube((0, 0, low), (0, 0, high), r, n=24)
    model.add(tank, model.patch(_tank(rng, rgb, r, high - low)))
    roof = model.patch(textures.metal_sheet(rng, (40, 256), textures.times(rgb, 0.7), 24.0))
    cone = tube((0, 0, high - 0.02), (0, 0, high + 0.42 * r), r + 0.18, 0.02, n=24)
    model.add(cone, roof)
    model.add(tube((0, 0, high - 0.02), (0, 0, high), r + 0.18, 0.1, n=24), roof, 0.7)
    return (model.surface(),)


def _tank(rng: np.random.Generator, rgb: Colour, radius_m: float, height_m: float) -> Image:
    """Staves and hoops, a chequered band, and on three sides the farm's name, year and goods."""
    shape = (round(height_m * _PX_PER_M), round(2 * np.pi * radius_m * _PX_PER_M))
    image = textures.boards(rng, shape, rgb, _PX_PER_M)
    ink, pale = textures.times(rgb, 0.3), textures.hsv(48, 0.1, 0.96)
    for y in np.linspace(3, shape[0] - 4, 5):
        cv2.line(image, (0, round(y)), (shape[1], round(y)), textures.times(rgb, 0.45), 2)
    cell, first = shape[1] // 28, round(0.74 * shape[0])
    for k in range(28):
        row = first + (k % 2) * cell // 2
        cv2.rectangle(image, (k * cell, row), ((k + 1) * cell - 1, row + cell // 2), pale, -1)
    lines = (str(rng.choice(_FARMS)), f"EST {rng.integers(1850, 1960)}", str(rng.choice(_ADVERTS)))
    for third, line in enumerate(lines):
        x0, x1 = (round((third + s) / 3 * shape[1]) for s in (0.05, 0.95))
        plate = image[round(0.14 * shape[0]) : round(0.62 * shape[0]), x0:x1]
        plate[:] = textures.plain(rng, pale, plate.shape[:2], 0.05)
        _words(plate, line, (0.05, 0.25, 0.95, 0.75), ink)
    return image


def bales(rng: np.random.Generator) -> _Surfaces:
    """Three round straw bales, one on two."""
    model = Model()
    r, half = rng.uniform(0.62, 0.7), rng.uniform(0.55, 0.65)
    straw = textures.hsv(rng.uniform(40, 50), rng.uniform(0.45, 0.6), rng.uniform(0.7, 0.85))
    skin = model.patch(_straw(rng, straw, (96, 256)))
    for x, z in ((-1.02 * r, r), (1.02 * r, r), (0.0, 2.72 * r)):
        end = model.patch(_spiral(rng, straw))
        for sign in (-1, 1):
            roll = tube((x, 0, z), (x, sign * half, z), r, n=16, cap=True)
            side, discs = len(roll.points) - 16, 2 * 16
            model.add(Part(roll.points[:side], roll.faces[:discs], roll.uv[:side]), skin)
            cap = Part(roll.points[side:], roll.faces[discs:] - side, roll.uv[side:])
            model.add(cap, end)
    return (model.surface(),)


def _straw(rng: np.random.Generator, rgb: Colour, shape: tuple[int, int]) -> Image:
    grain = textures.wood(rng, shape, rgb, along_x=True)
    stalks = (1 + 0.12 * textures.noise(rng, shape, 2))[..., None]
    image = np.clip(grain * stalks, 0, 255).astype(np.uint8)
    for y in np.linspace(12, shape[0] - 12, 4):
        cv2.line(image, (0, round(y)), (shape[1], round(y)), textures.times(rgb, 0.6), 1)
    return image


def _spiral(rng: np.random.Generator, rgb: Colour, size_px: int = 72) -> Image:
    y, x = np.mgrid[:size_px, :size_px] - (size_px - 1) / 2
    turn, reach = np.arctan2(y, x), np.hypot(x, y)
    wave = np.sin(2 * np.pi * reach / rng.uniform(6, 9) + turn + rng.uniform(0, 2 * np.pi))
    light = 0.2 * wave + 0.07 * textures.noise(rng, (size_px, size_px), 2) - 0.05
    return textures.coloured(rgb, light.astype(np.float32))


def trough(rng: np.random.Generator) -> _Surfaces:
    """A stone trough with water, along x."""
    model = Model()
    half, deep, high = rng.uniform(0.9, 1.2), 0.35, rng.uniform(0.5, 0.6)
    rgb = textures.hsv(rng.uniform(25, 50), 0.1, rng.uniform(0.5, 0.65))
    side = model.patch(textures.stone(rng, (40, 128), rgb, 60.0))
    model.add(box((-half, -deep, 0), (half, deep, high), top=False), side)
    rim = model.patch(textures.plain(rng, textures.times(rgb, 1.15), (16, 64), 0.12))
    for low, up in (
        ((-half, -deep), (half, -deep + 0.1)),
        ((-half, deep - 0.1), (half, deep)),
        ((-half, -deep + 0.1), (-half + 0.1, deep - 0.1)),
        ((half - 0.1, -deep + 0.1), (half, deep - 0.1)),
    ):
        model.add(box((*low, high), (*up, high + 0.04)), rim)
    water = model.patch(textures.plain(rng, (70.0, 96.0, 112.0), (16, 32), 0.08))
    x, y, z = half - 0.1, deep - 0.1, high - 0.02
    model.add(polygon([(-x, -y, z), (x, -y, z), (x, y, z), (-x, y, z)]), water)
    return (model.surface(),)

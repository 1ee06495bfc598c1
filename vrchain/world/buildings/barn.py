"""Barns: boarded walls under a big gabled or gambrel roof, cross-braced doors, a loft door.

Model frame: the plan's middle at the origin, the big door towards -y.
"""

import itertools

import cv2
import numpy as np
from numpy.random import Generator

from vrchain.world import textures
from vrchain.world.buildings import roofs
from vrchain.world.buildings.facades import PX_PER_M
from vrchain.world.buildings.plans import BarnPlan, Silo
from vrchain.world.buildings.shell import Shell
from vrchain.world.drawing import fill, frame, grown, star
from vrchain.world.model import Surface
from vrchain.world.shapes import Image, Rect, box, polygon, tube, wall
from vrchain.world.textures import random_hsv, times

_OVERHANG_M = 0.45
_LEAN_TOP_M = 2.3  # the low side of a lean-to

# Ranges of hue (degrees), saturation and value: reds, greys, browns, a cream and a green.
_PAINTS = (
    ((-4, 10), (0.6, 0.75), (0.42, 0.6)),
    ((-4, 10), (0.5, 0.7), (0.35, 0.5)),
    ((2, 14), (0.6, 0.75), (0.5, 0.65)),
    ((25, 50), (0.03, 0.12), (0.5, 0.7)),
    ((205, 225), (0.08, 0.2), (0.4, 0.6)),
    ((18, 32), (0.4, 0.6), (0.35, 0.55)),
    ((40, 50), (0.15, 0.25), (0.8, 0.92)),
    ((130, 160), (0.25, 0.4), (0.3, 0.45)),
)
_TRIMS = (
    ((30, 60), (0.0, 0.08), (0.9, 0.99)),
    ((30, 60), (0.0, 0.08), (0.9, 0.99)),
    ((20, 35), (0.3, 0.5), (0.2, 0.35)),
)
_ROOFS = ((10, 0.5), (215, 0.15), (120, 0.25), (25, 0.35), (0, 0.02))  # hue, saturation


class _Barn(Shell):
    """What the pieces of one barn share while it is built."""

    soffit_shade = 0.8

    def __init__(self, plan: BarnPlan, rng: Generator) -> None:
        super().__init__(rng)
        self.plan = plan
        self.wall_rgb = random_hsv(rng, *_PAINTS[int(rng.integers(len(_PAINTS)))])
        self.trim_rgb = random_hsv(rng, *_TRIMS[int(rng.integers(3))])
        self.door_rgb = self.wall_rgb
        if rng.random() >= 0.5:
            self.door_rgb = random_hsv(rng, (0, 360), (0.1, 0.5), (0.3, 0.7))
        self.roof_rgb = random_hsv(rng, *rng.choice(_ROOFS), (0.35, 0.65))
        self.roofing = textures.metal_sheet if rng.random() < 0.5 else textures.shingles
        self.brace = str(rng.choice(["X", "Z", "K"]))
        self.trim = self.model.patch(textures.plain(rng, self.trim_rgb))
        self.soffit = self.model.patch(textures.plain(rng, times(self.wall_rgb, 0.5)))

    def boards(self, width_m: float, height_m: float) -> Image:
        """Weathered upright boards of a wall's size, on a stone foot."""
        shape = (max(8, round(height_m * PX_PER_M)), max(8, round(width_m * PX_PER_M)))
        image = textures.boards(self.rng, shape, self.wall_rgb, PX_PER_M)
        worn = textures.fractal(self.rng, shape, 1.2 * PX_PER_M, 4)
        bare = np.clip(0.4 * (worn - 0.9), 0, 0.4)[..., None]
        wood = 0.5 * (np.array([150, 140, 128]) + self.wall_rgb)
        image = (1 - bare) * image + bare * wood
        image = (image * (1 + 0.07 * worn[..., None])).clip(0, 255).astype(np.uint8)
        foot = round(0.4 * PX_PER_M)
        stones = random_hsv(self.rng, (20, 50), 0.12, (0.45, 0.7))
        image[-foot:] = textures.stone(self.rng, (foot, shape[1]), stones, PX_PER_M)
        return image

    def windows(
        self, image: Image, width_m: float, n: int, z_m: float, size_m: tuple[float, float]
    ) -> None:
        """Draw a row of ``n`` windows on a wall."""
        for k in range(n):
            _window(self, image, (k + 0.5) * width_m / n, z_m, *size_m)


def build(plan: BarnPlan, rng: Generator) -> tuple[Surface, ...]:
    """The barn of a plan, its colours and boards drawn from ``rng``."""
    barn, r = _Barn(plan, rng), plan.main
    _ends(barn)
    for side in "rl":
        image = barn.boards(r.depth_m, plan.wall_m)
        barn.windows(image, r.depth_m, int(rng.integers(2, 6)), 1.5, (0.75, 0.8))
        barn.model.add(wall(*r.side(side), 0.0, plan.wall_m), image)
    barn.cover(roofs.roof("gambrel", r, plan.wall_m, plan.slopes, _OVERHANG_M))
    _hoist(barn)
    if plan.lean_to:
        _lean_to(barn, plan.lean_to)
    if plan.silo:
        _silo(barn, plan.silo)
    for k in range(plan.vents):
        _vent(barn, r.y0 + r.depth_m * (k + 1) / (plan.vents + 1))
    return (barn.model.surface(),)


def _ends(barn: _Barn) -> None:
    """Front and back under the roof's profile."""
    plan, r, rng = barn.plan, barn.plan.main, barn.rng
    for side in "fb":
        part, width, height = roofs.gable_wall(r.side(side), 0.0, plan.wall_m, plan.slopes)
        image = barn.boards(width, height)
        rim = [_px(image, *point) for point in part.uv * (width, height)]
        edge = np.array([*rim[1:], rim[0]], dtype=np.int32)  # boards, but not along the foot
        thick = round(0.36 * PX_PER_M)
        cv2.polylines(image, [edge], False, barn.trim_rgb, thick, cv2.LINE_AA)
        if side == "f" or rng.random() < 0.5:
            _leaves(barn, image, width / 2, 0.05, *plan.door_m, 2)
        loft = (1.3, 1.5) if rng.random() < 0.5 else (1.7, 1.4)
        _leaves(barn, image, width / 2, plan.wall_m + 0.25, *loft, 1 + int(loft[0] > 1.5))
        for x in (0.16, 0.84):
            _window(barn, image, x * width, 1.3, 0.8, 0.9)
        if side == "f" and height > plan.wall_m + 3.4:
            _emblem(barn, image, width / 2, height - 1.05)
        barn.model.add(part, image)


def _px(image: Image, x_m: float, z_m: float) -> tuple[int, int]:
    """Pixel of a point of a wall, x from its left, z from its foot."""
    return round(x_m * PX_PER_M), image.shape[0] - round(z_m * PX_PER_M)


def _leaves(
    barn: _Barn, image: Image, x_m: float, z_m: float, width_m: float, height_m: float, n: int
) -> None:
    """A door of n cross-braced leaves, x_m: its middle."""
    thick = max(3, round(0.16 * PX_PER_M))
    top_m = min(z_m + height_m, image.shape[0] / PX_PER_M - 0.3)
    x0, y1 = _px(image, x_m - width_m / 2, z_m)
    x1, y0 = _px(image, x_m + width_m / 2, top_m)
    trim, dark = barn.trim_rgb, times(barn.door_rgb, 0.3)
    fill(image, (x0 - thick, y0 - thick, x1 + thick, y1), trim)
    image[y0:y1, x0:x1] = textures.boards(barn.rng, (y1 - y0, x1 - x0), barn.door_rgb, PX_PER_M)
    for k in range(n):
        left, right = x0 + k * (x1 - x0) // n, x0 + (k + 1) * (x1 - x0) // n
        # X: both diagonals; Z: one; K: one in each half, over and under a rail.
        middle = y0 + round(0.45 * (y1 - y0)) if barn.brace == "K" else y0
        a, b = (left, right) if k % 2 else (right, left)
        lines = [((a, middle), (b, y1))]
        if barn.brace == "X":
            lines.append(((b, middle), (a, y1)))
        if barn.brace == "K":
            lines += [((b, y0), (a, middle)), ((left, middle), (right, middle))]
        for start, end in [*lines, ((left, y0), (right, y0)), ((left, y1), (right, y1))]:
            cv2.line(image, start, end, trim, thick)
        frame(image, (left, y0, right, y1), trim, thick)
        cv2.line(image, (right, y0), (right, y1), dark, 1)
    frame(image, (x0 - thick - 1, y0 - thick - 1, x1 + thick + 1, y1), dark)


def _window(
    barn: _Barn, image: Image, x_m: float, z_m: float, width_m: float, height_m: float
) -> None:
    x0, y1 = _px(image, x_m - width_m / 2, z_m)
    x1, y0 = _px(image, x_m + width_m / 2, z_m + height_m)
    fill(image, grown((x0, y0, x1, y1), 3), barn.trim_rgb)
    value = barn.rng.uniform(0.2, 0.5)
    fill(image, (x0, y0, x1, y1), textures.hsv(215, 0.3, value))
    cv2.line(image, (x0, y1), (x1, y0), textures.hsv(210, 0.2, value + 0.2), 2, cv2.LINE_AA)
    x, y = (x0 + x1) // 2, (y0 + y1) // 2
    cv2.line(image, (x, y0), (x, y1), barn.trim_rgb, 2)
    cv2.line(image, (x0, y), (x1, y), barn.trim_rgb, 2)


def _emblem(barn: _Barn, image: Image, x_m: float, z_m: float) -> None:
    """A painted star, a quilt square or the year, high on the front."""
    rng, centre, r = barn.rng, np.array(_px(image, x_m, z_m)), 0.5 * PX_PER_M
    first, second = (random_hsv(rng, (0, 360), (0.3, 0.8), (0.6, 0.95)) for _ in range(2))
    kind = str(rng.choice(["star", "quilt", "year"]))
    if kind == "year":
        year = str(rng.integers(1871, 1960))
        at = (int(centre[0] - 0.55 * PX_PER_M), int(centre[1] + 0.15 * PX_PER_M))
        ink = (245, 243, 235) if max(barn.wall_rgb) < 170 else (70, 50, 40)
        cv2.putText(image, year, at, cv2.FONT_HERSHEY_DUPLEX, 0.5, ink, 1, cv2.LINE_AA)
    elif kind == "star":
        star(image, centre, r, int(rng.integers(5, 9)), (240, 238, 228), 0.42, -np.pi / 2)
    else:
        cells = int(rng.integers(3, 5))
        side = 2 * r / cells
        for i, j in np.ndindex(cells, cells):
            corner = centre - r + side * np.array([i, j])
            square = corner + side * np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
            half = square[[0, 1, 2] if (i < cells / 2) == (j < cells / 2) else [1, 2, 3]]
            colours = (first, second) if (i + j) % 2 else (second, first)
            for shape, rgb in zip((square, half), colours, strict=True):
                cv2.fillPoly(image, [np.round(shape).astype(np.int32)], rgb)


def _hoist(barn: _Barn) -> None:
    """The beam above the loft door that hay is lifted by."""
    r, z = barn.plan.main, barn.plan.ridge_m - 0.45
    x = r.middle_x_m
    beam = box((x - 0.08, r.y0 - 0.9, z), (x + 0.08, r.y0, z + 0.16), bottom=True)
    barn.model.add(beam, barn.soffit)
    barn.model.add(tube((x, r.y0 - 0.8, z - 0.35), (x, r.y0 - 0.8, z), 0.03, n=5), barn.soffit)


def _lean_to(barn: _Barn, r: Rect) -> None:
    """A shed against a side wall, its roof falling away from it."""
    high = barn.plan.wall_m - 0.25
    right = r.x0 > barn.plan.main.x0
    top = (high, _LEAN_TOP_M) if right else (_LEAN_TOP_M, high)  # at x0, at x1
    for side, (z0, z1) in (("f", top), ("b", top[::-1])):
        image = barn.boards(r.width_m, high)
        _leaves(barn, image, r.width_m / 2, 0.05, 1.0, 1.9, 1)
        (ax, ay), (bx, by) = r.side(side)
        uv = [(0, 0), (1, 0), (1, z1 / high), (0, z0 / high)]
        end = polygon([(ax, ay, 0), (bx, by, 0), (bx, by, z1), (ax, ay, z0)], uv)
        barn.model.add(end, image)
    image = barn.boards(r.depth_m, _LEAN_TOP_M)
    barn.windows(image, r.depth_m, int(barn.rng.integers(1, 4)), 1.1, (0.8, 0.7))
    barn.model.add(wall(*r.side("r" if right else "l"), 0.0, _LEAN_TOP_M), image)
    over = 0.3
    low = _LEAN_TOP_M - (high - _LEAN_TOP_M) / r.width_m * over
    (x, y0), (_, y1) = r._replace(y0=r.y0 - over, y1=r.y1 + over).side("r" if right else "l")
    x, inner = (x + over, r.x0) if right else (x - over, r.x1)
    barn.cover(roofs.slab([(x, y0, low), (x, y1, low), (inner, y1, high), (inner, y0, high)]))


def _silo(barn: _Barn, silo: Silo) -> None:
    """A tower of staves with iron hoops under a faceted dome."""
    rng, n = barn.rng, 14
    shape = (round(silo.height_m * 16), round(2 * np.pi * silo.radius_m * 16))
    rgb = random_hsv(rng, (20, 220), (0.02, 0.2), (0.55, 0.8))
    image = textures.boards(rng, shape, rgb, 16.0)
    every = int(rng.integers(9, 16))
    for y in range(every, shape[0], every):
        cv2.line(image, (0, y), (shape[1], y), times(rgb, 0.45), 1)
    foot = np.array([silo.x_m, silo.y_m, 0.0])
    up = np.array([0.0, 0.0, 1.0])
    barn.model.add(tube(foot, foot + silo.height_m * up, silo.radius_m, n=n), image)
    dome = barn.model.patch(textures.metal_sheet(rng, (48, 160), barn.roof_rgb, 30.0))
    tilt = np.linspace(0, np.pi / 2, 4)
    rings = np.column_stack([np.cos(tilt), np.sin(tilt)]) * (silo.radius_m + 0.06)
    rings[-1, 0] = 0.02
    for (r0, z0), (r1, z1) in itertools.pairwise(rings):
        low, high = (foot + (silo.height_m + z) * up for z in (z0, z1))
        barn.model.add(tube(low, high, r0, r1, n=n), dome)


def _vent(barn: _Barn, y: float) -> None:
    """A little louvred tower with a roof of its own on the ridge."""
    x, ridge, half = barn.plan.main.middle_x_m, barn.plan.ridge_m, 0.45
    around, top = Rect(x, y, x, y).grown(half), ridge + 0.95
    louvres = textures.plain(barn.rng, barn.trim_rgb, (28, 28))
    for line in range(8, 24, 4):
        cv2.line(louvres, (5, line), (22, line), times(barn.trim_rgb, 0.4), 2)
    low, high = (*around[:2], ridge - 0.4), (*around[2:], top)
    barn.model.add(box(low, high, top=False), louvres)
    barn.cover(roofs.roof("hip", around, top, (1.0,), 0.15))

"""A barn: boarded walls under a big gabled or gambrel roof, cross-braced doors, a loft door.

Model frame: the plan's middle at the origin, the big door towards -y.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import shapely

from vrchain.world import textures
from vrchain.world.buildings import roofs
from vrchain.world.buildings.facade_style import PX_PER_M
from vrchain.world.buildings.house_plans import Rect
from vrchain.world.model import Surface
from vrchain.world.shapes import Image, Model, Part, box, polygon, tube, wall
from vrchain.world.textures import Colour

_OVERHANG_M = 0.45
_LEAN_TOP_M = 2.3  # the low side of a lean-to


@dataclass(frozen=True)
class Silo:
    """A round tower under a dome; x_m, y_m: its axis."""

    x_m: float
    y_m: float
    radius_m: float
    height_m: float


@dataclass(frozen=True)
class BarnPlan:
    """Where the parts of a barn stand, in the model frame."""

    main: Rect
    wall_m: float  # height of the side walls
    slopes: tuple[float, ...]  # of the roof, rise over run, from the eave up
    door_m: tuple[float, float]  # width and height of the big door
    lean_to: Rect | None  # a low shed along a side wall
    silo: Silo | None  # stands free of the other side wall by a hand's breadth
    vents: int  # little towers on the ridge

    @property
    def outline(self) -> shapely.Geometry:
        """Convex outline on the ground, as ``SceneObject.footprint`` has it."""
        rects = [r for r in (self.main, self.lean_to) if r]
        parts = [shapely.box(r.x0, r.y0, r.x1, r.y1) for r in rects]
        if self.silo:
            foot = shapely.Point(self.silo.x_m, self.silo.y_m)
            parts.append(foot.buffer(self.silo.radius_m + 0.05))
        return shapely.union_all(parts).convex_hull

    @property
    def size_m(self) -> tuple[float, float]:
        """Width (along the front) and depth of the rectangle around it all."""
        x0, y0, x1, y1 = self.outline.bounds
        return x1 - x0, y1 - y0


def draw_plan(rng: np.random.Generator) -> BarnPlan:
    """A random barn of 7.6 to 8.8 m by 9.5 to 13 m, alone or with a lean-to or a silo."""
    w, d = rng.uniform(7.6, 8.8), rng.uniform(9.5, 13.0)
    main = Rect(-w / 2, -d / 2, w / 2, d / 2)
    side = int(rng.choice([-1, 1]))
    steep = (float(rng.uniform(1.4, 2.1)), float(rng.uniform(0.4, 0.62)))
    slopes = steep if rng.random() < 0.6 else (float(rng.uniform(0.6, 0.95)),)
    annex = rng.choice(["none", "lean-to", "silo"], p=[0.3, 0.35, 0.35])
    lean_to = silo = None
    if annex == "lean-to":
        out, y0 = rng.uniform(2.2, 3.0), -d / 2 + rng.uniform(0.6, 2.5)
        x0 = w / 2 if side > 0 else -w / 2 - out
        lean_to = Rect(x0, y0, x0 + out, d / 2 - rng.uniform(0.0, 1.5))
    elif annex == "silo":
        r = rng.uniform(1.4, 1.8)
        y = rng.uniform(-d / 4, d / 4)
        silo = Silo(side * (w / 2 + r + 0.15), y, r, float(rng.uniform(7.5, 10.0)))
    plan = BarnPlan(
        main=main,
        wall_m=float(rng.uniform(3.3, 4.3)),
        slopes=slopes,
        door_m=(float(rng.uniform(2.8, 3.8)), float(rng.uniform(2.6, 3.1))),
        lean_to=lean_to,
        silo=silo,
        vents=int(rng.integers(0, 3)),
    )
    x0, y0, x1, y1 = plan.outline.bounds
    dx, dy = -(x0 + x1) / 2, -(y0 + y1) / 2
    return replace(
        plan,
        main=main.shifted(dx, dy),
        lean_to=lean_to.shifted(dx, dy) if lean_to else None,
        silo=replace(silo, x_m=silo.x_m + dx, y_m=silo.y_m + dy) if silo else None,
    )


class _Barn:
    """What the pieces of one barn share while it is built."""

    def __init__(self, plan: BarnPlan, rng: np.random.Generator) -> None:
        self.plan, self.rng, self.model = plan, rng, Model()
        paint = _PAINTS[int(rng.integers(len(_PAINTS)))]
        self.wall_rgb = textures.hsv(*(rng.uniform(*r) for r in paint))
        self.trim_rgb = textures.hsv(*(rng.uniform(*r) for r in _TRIMS[int(rng.integers(3))]))
        self.door_rgb = (
            self.wall_rgb
            if rng.random() < 0.5
            else textures.hsv(rng.uniform(0, 360), rng.uniform(0.1, 0.5), rng.uniform(0.3, 0.7))
        )
        hue, saturation = rng.choice([[10, 0.5], [215, 0.15], [120, 0.25], [25, 0.35], [0, 0.02]])
        self.roof_rgb = textures.hsv(hue, saturation, rng.uniform(0.35, 0.65))
        self.roofing = textures.metal_sheet if rng.random() < 0.5 else textures.shingles
        self.brace = str(rng.choice(["X", "Z", "K"]))
        self.trim = self.model.patch(textures.plain(rng, self.trim_rgb))
        self.dark = self.model.patch(textures.plain(rng, textures.times(self.wall_rgb, 0.5)))

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
        stones = textures.hsv(self.rng.uniform(20, 50), 0.12, self.rng.uniform(0.45, 0.7))
        image[-foot:] = textures.stone(self.rng, (foot, shape[1]), stones, PX_PER_M)
        return image

    def cover(self, faces: roofs.Roof) -> None:
        """A roof's faces, its texture drawn to scale."""
        scale = 18.0  # texels a metre
        shape = (max(8, int(faces.slope_m * scale)), max(8, int(faces.length_m * scale)))
        patch = self.model.patch(self.roofing(self.rng, shape, self.roof_rgb, scale))
        self.model.add(faces.cover, patch)
        self.model.add(faces.soffit, self.dark, 0.8)
        self.model.add(faces.fascia, self.trim)


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


def build(plan: BarnPlan, rng: np.random.Generator) -> tuple[Surface, ...]:
    """The barn of a plan, its colours and boards drawn from ``rng``."""
    barn = _Barn(plan, rng)
    _ends(barn)
    _sides(barn)
    r = plan.main
    barn.cover(roofs.gambrel((r.x0, r.y0, r.x1, r.y1), plan.wall_m, plan.slopes, _OVERHANG_M))
    _hoist(barn)
    if plan.lean_to:
        _lean_to(barn, plan.lean_to)
    if plan.silo:
        _silo(barn, plan.silo)
    for k in range(plan.vents):
        _vent(barn, r.y0 + r.depth_m * (k + 1) / (plan.vents + 1))
    return (barn.model.surface(),)


def _rise_m(plan: BarnPlan) -> float:
    return float(roofs.profile(plan.main.width_m / 2, plan.slopes)[-1, 1])


def _ends(barn: _Barn) -> None:
    """Front and back under the roof's profile."""
    plan, r, rng = barn.plan, barn.plan.main, barn.rng
    inward = roofs.profile(r.width_m / 2, plan.slopes)
    height = plan.wall_m + _rise_m(plan)
    left = [(x, plan.wall_m + z) for x, z in inward[:-1]]
    right = [(r.width_m - x, z) for x, z in left]
    rim = [(0.0, 0.0), (r.width_m, 0.0), *right, (r.width_m / 2, height), *left[::-1]]
    for front in (True, False):
        image = barn.boards(r.width_m, height)
        _edges(image, rim, barn.trim_rgb)
        if front or rng.random() < 0.5:
            _leaves(barn, image, r.width_m / 2, 0.05, *plan.door_m, 2)
        loft = (1.3, 1.5) if rng.random() < 0.5 else (1.7, 1.4)
        _leaves(barn, image, r.width_m / 2, plan.wall_m + 0.25, *loft, 1 + int(loft[0] > 1.5))
        for x in (0.16, 0.84):
            _window(barn, image, x * r.width_m, 1.3, 0.8, 0.9)
        if front and height > plan.wall_m + 3.4:
            _emblem(rng, image, r.width_m / 2, height - 1.05, barn.wall_rgb)
        turn = 1.0 if front else -1.0
        x_at, y_at = (r.x0, r.y0) if front else (r.x1, r.y1)
        corners = [(x_at + turn * x, y_at, z) for x, z in rim]
        uv = [(x / r.width_m, z / height) for x, z in rim]
        barn.model.add(polygon(corners, uv), barn.model.patch(image))


def _sides(barn: _Barn) -> None:
    plan, r = barn.plan, barn.plan.main
    for a, b in (((r.x1, r.y0), (r.x1, r.y1)), ((r.x0, r.y1), (r.x0, r.y0))):
        image = barn.boards(r.depth_m, plan.wall_m)
        n = int(barn.rng.integers(2, 6))
        for k in range(n):
            _window(barn, image, (k + 0.5) * r.depth_m / n, 1.5, 0.75, 0.8)
        barn.model.add(wall(a, b, 0.0, plan.wall_m), barn.model.patch(image))


def _px(image: Image, x_m: float, z_m: float) -> tuple[int, int]:
    """Pixel of a point of a wall, x from its left, z from its foot."""
    return round(x_m * PX_PER_M), image.shape[0] - round(z_m * PX_PER_M)


def _edges(image: Image, rim: Sequence[tuple[float, float]], rgb: Colour) -> None:
    """Boards along the outline of a wall, but for its foot."""
    points = np.array([_px(image, x, z) for x, z in [*rim[1:], rim[0]]], dtype=np.int32)
    cv2.polylines(image, [points], False, rgb, round(0.36 * PX_PER_M), cv2.LINE_AA)


def _leaves(
    barn: _Barn, image: Image, x_m: float, z_m: float, width_m: float, height_m: float, n: int
) -> None:
    """A door of n cross-braced leaves, x_m: its middle."""
    thick = max(3, round(0.16 * PX_PER_M))
    (x0, y1), (x1, y0) = (
        _px(image, x_m + s * width_m / 2, z)
        for s, z in ((-1, z_m), (1, min(z_m + height_m, image.shape[0] / PX_PER_M - 0.3)))
    )
    dark = textures.times(barn.door_rgb, 0.3)
    cv2.rectangle(image, (x0 - thick, y0 - thick), (x1 + thick, y1), barn.trim_rgb, -1)
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
            cv2.line(image, start, end, barn.trim_rgb, thick)
        cv2.rectangle(image, (left, y0), (right, y1), barn.trim_rgb, thick)
        cv2.line(image, (right, y0), (right, y1), dark, 1)
    cv2.rectangle(image, (x0 - thick - 1, y0 - thick - 1), (x1 + thick + 1, y1), dark, 1)


def _window(
    barn: _Barn, image: Image, x_m: float, z_m: float, width_m: float, height_m: float
) -> None:
    x0, y1 = _px(image, x_m - width_m / 2, z_m)
    x1, y0 = _px(image, x_m + width_m / 2, z_m + height_m)
    cv2.rectangle(image, (x0 - 3, y0 - 3), (x1 + 3, y1 + 3), barn.trim_rgb, -1)
    value = barn.rng.uniform(0.2, 0.5)
    cv2.rectangle(image, (x0, y0), (x1, y1), textures.hsv(215, 0.3, value), -1)
    cv2.line(image, (x0, y1), (x1, y0), textures.hsv(210, 0.2, value + 0.2), 2, cv2.LINE_AA)
    cv2.line(image, ((x0 + x1) // 2, y0), ((x0 + x1) // 2, y1), barn.trim_rgb, 2)
    cv2.line(image, (x0, (y0 + y1) // 2), (x1, (y0 + y1) // 2), barn.trim_rgb, 2)


def _emblem(
    rng: np.random.Generator, image: Image, x_m: float, z_m: float, wall_rgb: Colour
) -> None:
    """A painted star, a quilt square or the year, high on the front."""
    centre, r = np.array(_px(image, x_m, z_m)), 0.5 * PX_PER_M
    first, second = (
        textures.hsv(rng.uniform(0, 360), rng.uniform(0.3, 0.8), rng.uniform(0.6, 0.95))
        for _ in range(2)
    )
    kind = str(rng.choice(["star", "quilt", "year"]))
    if kind == "year":
        year = str(rng.integers(1871, 1960))
        at = (int(centre[0] - 0.55 * PX_PER_M), int(centre[1] + 0.15 * PX_PER_M))
        ink = (245, 243, 235) if max(wall_rgb) < 170 else (70, 50, 40)
        cv2.putText(image, year, at, cv2.FONT_HERSHEY_DUPLEX, 0.5, ink, 1, cv2.LINE_AA)
        return
    if kind == "star":
        n = int(rng.integers(5, 9))
        turn = np.arange(2 * n) * np.pi / n - np.pi / 2
        reach = np.where(np.arange(2 * n) % 2, 0.42, 1.0) * r
        points = centre + np.column_stack([np.cos(turn), np.sin(turn)]) * reach[:, None]
        cv2.fillPoly(image, [np.round(points).astype(np.int32)], (240, 238, 228), cv2.LINE_AA)
        return
    cells = int(rng.integers(3, 5))
    side = 2 * r / cells
    for i, j in np.ndindex(cells, cells):
        corner = centre - r + side * np.array([i, j])
        square = corner + side * np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
        colours = (first, second) if (i + j) % 2 else (second, first)
        cv2.fillPoly(image, [np.round(square).astype(np.int32)], colours[0])
        half = square[[0, 1, 2] if (i < cells / 2) == (j < cells / 2) else [1, 2, 3]]
        cv2.fillPoly(image, [np.round(half).astype(np.int32)], colours[1])


def _hoist(barn: _Barn) -> None:
    """The beam above the loft door that hay is lifted by."""
    plan, r = barn.plan, barn.plan.main
    z = plan.wall_m + _rise_m(plan) - 0.45
    x = (r.x0 + r.x1) / 2
    barn.model.add(
        box((x - 0.08, r.y0 - 0.9, z), (x + 0.08, r.y0, z + 0.16), bottom=True), barn.dark
    )
    barn.model.add(tube((x, r.y0 - 0.8, z - 0.35), (x, r.y0 - 0.8, z), 0.03, n=5), barn.dark)


def _lean_to(barn: _Barn, r: Rect) -> None:
    """A shed against a side wall, its roof falling away from it."""
    inner_top = barn.plan.wall_m - 0.25
    outer, inner = (r.x1, r.x0) if r.x0 > barn.plan.main.x0 else (r.x0, r.x1)
    right = outer > inner
    top = {outer: _LEAN_TOP_M, inner: inner_top}

    def end(y: float, left_x: float, right_x: float) -> None:
        image = barn.boards(r.width_m, inner_top)
        _leaves(barn, image, r.width_m / 2, 0.05, 1.0, 1.9, 1)
        v = {x: z / inner_top for x, z in top.items()}
        corners = [
            (left_x, y, 0), (right_x, y, 0), (right_x, y, top[right_x]), (left_x, y, top[left_x]),
        ]  # fmt: skip
        uv = [(0, 0), (1, 0), (1, v[right_x]), (0, v[left_x])]
        barn.model.add(polygon(corners, uv), barn.model.patch(image))

    end(r.y0, r.x0, r.x1)
    end(r.y1, r.x1, r.x0)
    image = barn.boards(r.depth_m, _LEAN_TOP_M)
    n = int(barn.rng.integers(1, 4))
    for k in range(n):
        _window(barn, image, (k + 0.5) * r.depth_m / n, 1.1, 0.8, 0.7)
    ends = ((outer, r.y0), (outer, r.y1)) if right else ((outer, r.y1), (outer, r.y0))
    barn.model.add(wall(*ends, 0.0, _LEAN_TOP_M), barn.model.patch(image))
    over, out = 0.3, 1 if right else -1
    fall = (inner_top - _LEAN_TOP_M) / r.width_m * over
    ys = (r.y0 - over, r.y1 + over) if right else (r.y1 + over, r.y0 - over)
    low, high = (outer + out * over, _LEAN_TOP_M - fall), (inner, inner_top)
    corners = [(low[0], ys[0], low[1]), (low[0], ys[1], low[1]),
               (high[0], ys[1], high[1]), (high[0], ys[0], high[1])]  # fmt: skip
    barn.cover(roofs.slab(corners))


def _silo(barn: _Barn, silo: Silo) -> None:
    """A tower of staves with iron hoops under a faceted dome."""
    rng, n = barn.rng, 14
    shape = (round(silo.height_m * 16), round(2 * np.pi * silo.radius_m * 16))
    rgb = textures.hsv(rng.uniform(20, 220), rng.uniform(0.02, 0.2), rng.uniform(0.55, 0.8))
    image = textures.boards(rng, shape, rgb, 16.0)
    every = int(rng.integers(9, 16))
    for y in range(every, shape[0], every):
        cv2.line(image, (0, y), (shape[1], y), textures.times(rgb, 0.45), 1)
    foot = np.array([silo.x_m, silo.y_m, 0.0])
    up = np.array([0.0, 0.0, 1.0])
    barn.model.add(
        tube(foot, foot + silo.height_m * up, silo.radius_m, n=n), barn.model.patch(image)
    )
    dome = barn.model.patch(textures.metal_sheet(rng, (48, 160), barn.roof_rgb, 30.0))
    tilt = np.linspace(0, np.pi / 2, 4)
    rings = np.column_stack([np.cos(tilt), np.sin(tilt)]) * (silo.radius_m + 0.06)
    rings[-1, 0] = 0.02
    for (r0, z0), (r1, z1) in itertools.pairwise(rings):
        low, high = (foot + (silo.height_m + z) * up for z in (z0, z1))
        barn.model.add(tube(low, high, r0, r1, n=n), dome)


def _vent(barn: _Barn, y: float) -> None:
    """A little louvred tower with a roof of its own on the ridge."""
    plan, rng = barn.plan, barn.rng
    x = (plan.main.x0 + plan.main.x1) / 2
    ridge = plan.wall_m + _rise_m(plan)
    half, top = 0.45, ridge + 0.95
    louvres = textures.plain(rng, barn.trim_rgb, (28, 28))
    for line in range(8, 24, 4):
        cv2.line(louvres, (5, line), (22, line), textures.times(barn.trim_rgb, 0.4), 2)
    patch = barn.model.patch(louvres)
    body: Part = box((x - half, y - half, ridge - 0.4), (x + half, y + half, top), top=False)
    barn.model.add(body, patch)
    barn.cover(roofs.roof("hip", (x - half, y - half, x + half, y + half), top, 1.0, 0.15))

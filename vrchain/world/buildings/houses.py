"""Houses: walls, roof, porch, garage and chimney on a plan.

Model frame: the plan's middle at the origin, the front towards -y.
"""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from vrchain.world import textures
from vrchain.world.buildings import facade_style, facades, roofs
from vrchain.world.buildings.house_plans import STOREY_M, HousePlan, Rect
from vrchain.world.buildings.openings import Opening
from vrchain.world.model import Surface
from vrchain.world.shapes import Model, Part, box, polygon, wall

_PORCH_ROOF_M = 2.35
_Intervals = list[tuple[float, float]]


class _House:
    """What the pieces of one house share while it is built."""

    def __init__(self, plan: HousePlan, rng: np.random.Generator, index: int) -> None:
        self.plan, self.rng, self.model = plan, rng, Model()
        self.style = facade_style.random_style(rng, index)
        hue, saturation = rng.choice(
            [[10, 0.5], [20, 0.35], [215, 0.2], [30, 0.1], [120, 0.12], [0, 0.02]]
        )
        self.roof_rgb = textures.hsv(hue + rng.uniform(-8, 8), saturation, rng.uniform(0.3, 0.65))
        kinds = (textures.shingles, textures.pantiles, textures.metal_sheet)
        self.roofing = kinds[int(rng.choice(3, p=[0.65, 0.2, 0.15]))]
        self.trim = self.model.patch(textures.plain(rng, self.style.trim_rgb))
        self.soffit = self.model.patch(
            textures.plain(rng, textures.times(self.style.trim_rgb, 0.75))
        )

    def wall(
        self,
        a: tuple[float, float],
        b: tuple[float, float],
        bottom: float,
        top: float,
        openings: Sequence[Opening],
        slopes: Sequence[float] = (),
    ) -> None:
        """A painted wall seen from the right of a -> b, with a gable of those slopes on it."""
        width = float(np.hypot(b[0] - a[0], b[1] - a[1]))
        gable = roofs.profile(width / 2, slopes) if slopes else np.zeros((1, 2))
        height = top - bottom + gable[-1, 1]
        patch = self.model.patch(facades.paint(self.rng, self.style, width, height, openings))
        part = wall(a, b, bottom, top)
        if slopes:
            left = gable + np.array([0.0, top - bottom])
            right = left[:-1] * (-1.0, 1.0) + (width, 0.0)
            uv = np.vstack([(0, 0), (width, 0), right, left[::-1]]) / (width, height)
            along = np.array(a) + uv[:, :1] * (np.array(b) - a)
            part = polygon(np.column_stack([along, bottom + uv[:, 1] * height]), uv)
        self.model.add(part, patch)

    def roof(self, kind: str, rect: Rect, top: float, overhang: float = 0.35) -> None:
        """A roof on a rectangle; its textures are drawn to scale."""
        corners = (rect.x0, rect.y0, rect.x1, rect.y1)
        if kind == "gambrel":
            faces = roofs.gambrel(corners, top, self.plan.slopes, overhang)
        else:
            faces = roofs.roof(kind, corners, top, self.plan.pitch, overhang)
        scale = 18.0  # texels a metre
        shape = (max(8, int(faces.slope_m * scale)), max(8, int(faces.length_m * scale)))
        patch = self.model.patch(self.roofing(self.rng, shape, self.roof_rgb, scale))
        self.model.add(faces.cover, patch)
        self.model.add(faces.soffit, self.soffit, 0.6)
        self.model.add(faces.fascia, self.trim)

    def plain(self, part: Part, shade: float = 1.0) -> None:
        """A part in the trim's colour."""
        self.model.add(part, self.trim, shade)


def build(plan: HousePlan, rng: np.random.Generator, index: int) -> tuple[Surface, ...]:
    """The house of a plan; ``index`` keeps neighbours' materials apart."""
    house = _House(plan, rng, index)
    _main_block(house)
    if plan.garage:
        _garage(house, plan.garage)
    if plan.wing:
        _wing(house, plan.wing)
    if plan.porch:
        _porch(house, plan.porch)
    if plan.bay:
        _bay(house, plan.bay)
    if plan.chimney:
        r = plan.chimney
        _chimney(house, (r.x0, r.y0, 0.0), (r.x1, r.y1))
    if plan.stack_xy_m:
        x, y = plan.stack_xy_m
        foot = plan.top_m + plan.ridge_m - 1.0
        _chimney(house, (x - 0.35, y - 0.25, foot), (x + 0.35, y + 0.25))
    if plan.on_roof != "none":
        _on_roof(house)
    for k in range(plan.dormers):
        _dormer(house, plan.main.x0 + plan.main.width_m * (k + 1) / (plan.dormers + 1))
    return (house.model.surface(),)


def _windows(
    house: _House,
    width_m: float,
    storeys: int,
    taken: Sequence[tuple[float, float]] = (),
    chance: float = 0.85,
) -> list[Opening]:
    """Windows in regular bays of a wall; ``taken``: intervals of its ground floor, m."""
    w, h = house.plan.window_m
    bay = w * (1.9 if house.style.shutters else 1.35) + 0.5
    n = max(1, int((width_m - 0.3) / bay))
    found = []
    for floor in range(storeys):
        for k in range(n):
            x = (k + 0.5) * width_m / n
            reach = bay / 2 - 0.15
            blocked = floor == 0 and any(x + reach > a and x - reach < b for a, b in taken)
            if not blocked and house.rng.random() < chance:
                found.append(Opening("window", x, 0.95 + floor * STOREY_M, w, h))
    return found


def _main_block(house: _House) -> None:
    plan, r, top = house.plan, house.plan.main, house.plan.top_m
    gable = {"gable_x": "rl", "gable_y": "fb", "gambrel": "fb", "hip": ""}[plan.roof]
    rise = plan.ridge_m
    door = Opening("door", plan.door_x_m - r.x0, 0.15, 0.95, 2.05)
    in_front = [(door.x_m - 0.9, door.x_m + 1.3)]
    in_front += [(part.x0 - r.x0, part.x1 - r.x0) for part in (plan.wing, plan.bay) if part]
    left, right = _covered_sides(plan)
    w, d, n = r.width_m, r.depth_m, plan.storeys
    sides = {
        "f": ((r.x0, r.y0), (r.x1, r.y0), [door, *_windows(house, w, n, in_front)]),
        "r": ((r.x1, r.y0), (r.x1, r.y1), _windows(house, d, n, right, 0.6)),
        "b": ((r.x1, r.y1), (r.x0, r.y1), _windows(house, w, n)),
        "l": ((r.x0, r.y1), (r.x0, r.y0), _windows(house, d, n, left, 0.6)),
    }
    for side, (a, b, openings) in sides.items():
        if side in gable:
            width = float(np.hypot(b[0] - a[0], b[1] - a[1]))
            if plan.roof == "gambrel":
                wide, high = plan.window_m
                openings += [
                    Opening("window", width * u, top + 0.5, min(wide, 1.1), high)
                    for u in (0.36, 0.64)
                ]
            elif rise > 1.6:
                openings.append(Opening("window", width / 2, top + 0.15, 0.7, min(1.0, rise - 1.0)))
            house.wall(a, b, 0.0, top, openings, plan.slopes)
        else:
            house.wall(a, b, 0.0, top, openings)
    house.roof(plan.roof, r, top)


def _covered_sides(plan: HousePlan) -> tuple[_Intervals, _Intervals]:
    """What a garage or chimney hides of the left and of the right wall, from each wall's left."""
    left: _Intervals = []
    right: _Intervals = []
    for part in (plan.garage, plan.chimney):
        if part is None:
            continue
        low, high = part.y0 - plan.main.y0, part.y1 - plan.main.y0
        if part.x0 > plan.main.x0:
            right.append((low, high))
        else:
            left.append((plan.main.depth_m - high, plan.main.depth_m - low))
    return left, right


def _garage(house: _House, r: Rect) -> None:
    plan, rng = house.plan, house.rng
    top = 2.55
    rise = () if plan.garage_flat else (plan.pitch,)
    door = Opening("garage", r.width_m / 2, 0.02, r.width_m - 0.7, 2.1)
    house.wall((r.x0, r.y0), (r.x1, r.y0), 0.0, top, [door], rise)
    house.wall((r.x1, r.y1), (r.x0, r.y1), 0.0, top, _windows(house, r.width_m, 1), rise)
    if plan.garage_side > 0:
        house.wall((r.x1, r.y0), (r.x1, r.y1), 0.0, top, _windows(house, r.depth_m, 1, chance=0.5))
    else:
        house.wall((r.x0, r.y1), (r.x0, r.y0), 0.0, top, _windows(house, r.depth_m, 1, chance=0.5))
    if plan.garage_flat:
        tar = house.model.patch(textures.plain(rng, (95.0, 95.0, 100.0), (64, 64), 0.15))
        house.plain(
            box(
                (r.x0 - 0.12, r.y0 - 0.12, top),
                (r.x1 + 0.12, r.y1 + 0.12, top + 0.22),
                bottom=True,
                top=False,
            )
        )
        house.model.add(_lid(r, top + 0.22, 0.12), tar)
    else:
        house.roof("gable_y", r, top, 0.25)


def _lid(r: Rect, z: float, rim: float) -> Part:
    x0, y0, x1, y1 = r.x0 - rim, r.y0 - rim, r.x1 + rim, r.y1 + rim
    return polygon([(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)])


def _wing(house: _House, r: Rect) -> None:
    plan, top = house.plan, house.plan.top_m
    openings = _windows(house, r.width_m, plan.storeys, chance=1.0)
    house.wall((r.x0, r.y0), (r.x1, r.y0), 0.0, top, openings, (plan.pitch,))
    house.wall((r.x1, r.y0), (r.x1, r.y1), 0.0, top, [])
    house.wall((r.x0, r.y1), (r.x0, r.y0), 0.0, top, [])
    # Run back into the main roof until the ridges' slopes meet.
    house.roof("gable_y", replace(r, y1=r.y1 + r.width_m / 2), top, 0.3)


def _porch(house: _House, r: Rect) -> None:
    rng = house.rng
    deck = house.model.patch(
        textures.paving(rng, textures.hsv(rng.uniform(0, 60), 0.2, 0.65), 16, 64)
    )
    house.model.add(box((r.x0, r.y0, 0.0), (r.x1, r.y1, 0.15), sides="flr"), deck)
    if r.depth_m < 1.0:
        return
    n = 2 + int(r.width_m > 2.6) + int(r.width_m > 3.8) + int(r.width_m > 5.5)
    for k in range(n):
        x = r.x0 + 0.1 + (r.width_m - 0.2) * k / (n - 1)
        if abs(x - house.plan.door_x_m) < 0.65:  # it would stand in the way
            continue
        house.plain(
            box((x - 0.07, r.y0 + 0.03, 0.15), (x + 0.07, r.y0 + 0.17, _PORCH_ROOF_M), top=False)
        )
    if r.width_m > 2.6 and rng.random() < 0.7:  # a balustrade at both ends
        for x in (r.x0 + 0.05, r.x1 - 0.05):
            house.plain(box((x - 0.03, r.y0 + 0.1, 0.85), (x + 0.03, r.y1, 0.93), bottom=True))
            for y in np.arange(r.y0 + 0.3, r.y1, 0.22):
                house.plain(
                    box((x - 0.02, y - 0.02, 0.15), (x + 0.02, y + 0.02, 0.85), top=False), 0.9
                )
    slope = roofs.slab(
        [
            (r.x0 - 0.2, r.y0 - 0.2, _PORCH_ROOF_M),
            (r.x1 + 0.2, r.y0 - 0.2, _PORCH_ROOF_M),
            (r.x1 + 0.2, r.y1, _PORCH_ROOF_M + 0.3),
            (r.x0 - 0.2, r.y1, _PORCH_ROOF_M + 0.3),
        ],
        0.13,
    )
    scale = 20.0
    shape = (int((r.depth_m + 0.2) * scale), int((r.width_m + 0.4) * scale))
    house.model.add(
        slope.cover, house.model.patch(house.roofing(rng, shape, house.roof_rgb, scale))
    )
    house.model.add(slope.soffit, house.soffit, 0.6)
    house.plain(slope.fascia)


def _bay(house: _House, r: Rect) -> None:
    """A bay window: three walls under a little roof."""
    plan, rng = house.plan, house.rng
    top = 2.2
    h = min(plan.window_m[1], 1.2)
    wide = Opening("window", r.width_m / 2, 0.8, r.width_m - 0.5, h)
    narrow = Opening("window", r.depth_m / 2, 0.8, r.depth_m - 0.3, h)
    sides = [narrow] if r.depth_m > 0.6 else []
    house.wall((r.x0, r.y0), (r.x1, r.y0), 0.0, top, [wide])
    house.wall((r.x1, r.y0), (r.x1, r.y1), 0.0, top, sides)
    house.wall((r.x0, r.y1), (r.x0, r.y0), 0.0, top, sides)
    low, high = top, top + 0.3
    slope = roofs.slab(
        [
            (r.x0 - 0.12, r.y0 - 0.12, low),
            (r.x1 + 0.12, r.y0 - 0.12, low),
            (r.x1 + 0.12, r.y1, high),
            (r.x0 - 0.12, r.y1, high),
        ],
        0.1,
    )
    shape = (max(8, int(slope.slope_m * 20)), int(slope.length_m * 20))
    patch = house.model.patch(house.roofing(rng, shape, house.roof_rgb, 20.0))
    house.model.add(slope.cover, patch)
    house.model.add(slope.soffit, house.soffit, 0.6)
    house.plain(slope.fascia)


def _chimney(house: _House, low: tuple[float, float, float], high: tuple[float, float]) -> None:
    """A brick chimney between two corners, from a foot up over the ridge."""
    plan, rng = house.plan, house.rng
    (x0, y0, foot), (x1, y1) = low, high
    top = plan.top_m + plan.ridge_m + rng.uniform(0.4, 0.9)
    colour = textures.hsv(rng.uniform(0, 40), rng.uniform(0.2, 0.6), rng.uniform(0.45, 0.75))
    shape = (round((top - foot) * 30), round(1.2 * 30))
    patch = house.model.patch(textures.brick(rng, shape, colour, 30.0))
    house.model.add(box((x0, y0, foot), (x1, y1, top), top=False), patch)
    cap = house.model.patch(textures.plain(rng, (150.0, 146.0, 140.0), (16, 16), 0.12))
    house.model.add(
        box((x0 - 0.06, y0 - 0.06, top), (x1 + 0.06, y1 + 0.06, top + 0.14), bottom=True), cap
    )


def _on_roof(house: _House) -> None:
    """Solar panels or skylights on the front slope of a roof whose ridge runs along the front."""
    plan, rng, r = house.plan, house.rng, house.plan.main
    n = int(rng.integers(1, 4))
    width, rows = (1.7, (0.18, 0.85)) if plan.on_roof == "panels" else (0.8, (0.4, 0.68))
    first = rng.uniform(0.08, 0.3) * r.width_m + r.x0
    step = width + (0.06 if plan.on_roof == "panels" else rng.uniform(0.6, 1.4))
    glass = textures.plain(rng, (32.0, 42.0, 72.0), (48, 30), 0.06)
    if plan.on_roof == "panels":
        glass[::8] = glass[:, ::10] = (120, 130, 150)
    else:
        cv2.line(glass, (0, 40), (29, 12), (150, 175, 195), 4, cv2.LINE_AA)
    cv2.rectangle(glass, (0, 0), (29, 47), (190, 192, 195), 2)
    patch = house.model.patch(glass)
    near, far = (share * r.depth_m / 2 for share in rows)
    z0, z1 = (plan.top_m + plan.pitch * y + 0.13 for y in (near, far))
    for k in range(n):
        x = first + k * step
        if x + width > r.x1 - 0.2:
            return
        pane = roofs.slab(
            [
                (x, r.y0 + near, z0),
                (x + width, r.y0 + near, z0),
                (x + width, r.y0 + far, z1),
                (x, r.y0 + far, z1),
            ],
            0.09,
        )
        house.model.add(pane.cover, patch)
        house.plain(pane.fascia)


def _dormer(house: _House, x: float) -> None:
    plan = house.plan
    w, front = 1.5, plan.main.y0 + 1.0
    foot = plan.top_m + plan.pitch * 0.9
    top = foot + 1.0
    rise = plan.pitch * w / 2
    back = front + (top + rise - foot) / plan.pitch
    rect = Rect(x - w / 2, front, x + w / 2, min(back, (plan.main.y0 + plan.main.y1) / 2))
    house.wall(
        (rect.x0, front),
        (rect.x1, front),
        foot,
        top,
        [Opening("window", w / 2, 0.2, 0.8, 0.75)],
        (plan.pitch,),
    )
    for side in ((rect.x1, front, rect.x1, rect.y1), (rect.x0, rect.y1, rect.x0, front)):
        house.plain(wall(side[:2], side[2:], foot, top), 0.9)
    house.roof("gable_y", rect, top, 0.15)

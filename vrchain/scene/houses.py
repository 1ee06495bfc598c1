"""Houses: walls, roof, porch, garage and chimney on a plan.

Model frame: the plan's middle at the origin, the front towards -y.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vrchain.scene import facade_style, facades, roofs, textures
from vrchain.scene.house_plans import STOREY_M, HousePlan, Rect
from vrchain.scene.model import Surface
from vrchain.scene.openings import Opening
from vrchain.scene.shapes import Model, Part, box, polygon, wall

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
        self.roofing = textures.metal_sheet if rng.random() < 0.12 else textures.shingles
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
        gable_m: float = 0.0,
    ) -> None:
        """A painted wall seen from the right of a -> b, with a gable of that height on it."""
        width = float(np.hypot(b[0] - a[0], b[1] - a[1]))
        height = top - bottom + gable_m
        patch = self.model.patch(facades.paint(self.rng, self.style, width, height, openings))
        part = wall(a, b, bottom, top)
        if gable_m:
            v = (top - bottom) / height
            apex = ((a[0] + b[0]) / 2, (a[1] + b[1]) / 2, top + gable_m)
            corners = [*part.points[:3], apex, part.points[3]]
            part = polygon(corners, [(0, 0), (1, 0), (1, v), (0.5, 1), (0, v)])
        self.model.add(part, patch)

    def roof(self, kind: str, rect: Rect, top: float, overhang: float = 0.35) -> None:
        """A roof on a rectangle; its textures are drawn to scale."""
        faces = roofs.roof(
            kind, (rect.x0, rect.y0, rect.x1, rect.y1), top, self.plan.pitch, overhang
        )
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
    if plan.chimney:
        _chimney(house, plan.chimney)
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
    gable = {"gable_x": ("", "rl"), "gable_y": ("", "fb"), "hip": ("", "")}[plan.roof][1]
    rise = plan.pitch * (r.depth_m if plan.roof == "gable_x" else r.width_m) / 2
    door = Opening("door", plan.door_x_m - r.x0, 0.15, 0.95, 2.05)
    in_front = [(door.x_m - 0.9, door.x_m + 1.3)]
    if plan.wing:
        in_front.append((plan.wing.x0 - r.x0, plan.wing.x1 - r.x0))
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
            if rise > 1.6:
                openings.append(Opening("window", width / 2, top + 0.15, 0.7, min(1.0, rise - 1.0)))
            house.wall(a, b, 0.0, top, openings, rise)
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
    rise = 0.0 if plan.garage_flat else plan.pitch * r.width_m / 2
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
    rise = plan.pitch * r.width_m / 2
    openings = _windows(house, r.width_m, plan.storeys, chance=1.0)
    house.wall((r.x0, r.y0), (r.x1, r.y0), 0.0, top, openings, rise)
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
    n = 2 + int(r.width_m > 2.6) + int(r.width_m > 3.8)
    for k in range(n):
        x = r.x0 + 0.1 + (r.width_m - 0.2) * k / (n - 1)
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


def _chimney(house: _House, r: Rect) -> None:
    plan, rng = house.plan, house.rng
    ridge = plan.top_m + plan.pitch * min(plan.main.width_m, plan.main.depth_m) / 2
    top = ridge + rng.uniform(0.3, 0.8)
    colour = textures.hsv(rng.uniform(0, 40), rng.uniform(0.2, 0.6), rng.uniform(0.45, 0.75))
    shape = (round(top * 30), round(1.2 * 30))
    patch = house.model.patch(textures.brick(rng, shape, colour, 30.0))
    house.model.add(box((r.x0, r.y0, 0.0), (r.x1, r.y1, top), top=False), patch)
    cap = house.model.patch(textures.plain(rng, (150.0, 146.0, 140.0), (16, 16), 0.12))
    house.model.add(
        box((r.x0 - 0.06, r.y0 - 0.06, top), (r.x1 + 0.06, r.y1 + 0.06, top + 0.14), bottom=True),
        cap,
    )


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
        rise,
    )
    for side in ((rect.x1, front, rect.x1, rect.y1), (rect.x0, rect.y1, rect.x0, front)):
        house.plain(wall(side[:2], side[2:], foot, top), 0.9)
    house.roof("gable_y", rect, top, 0.15)

"""Houses: walls, roof, porch, garage and chimney on a plan.

Model frame: the plan's middle at the origin, the front towards -y.
"""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.random import Generator

from vrchain.world import textures
from vrchain.world.buildings import facades, roofs
from vrchain.world.buildings.facades import Opening
from vrchain.world.buildings.plans import STOREY_M, HousePlan
from vrchain.world.buildings.shell import Shell
from vrchain.world.drawing import frame
from vrchain.world.model import Surface
from vrchain.world.shapes import Rect, box, wall
from vrchain.world.textures import random_hsv

_PORCH_ROOF_M = 2.35
_ROOFS = ((10, 0.5), (20, 0.35), (215, 0.2), (30, 0.1), (120, 0.12), (0, 0.02))  # hue, saturation
_Intervals = Sequence[tuple[float, float]]


class _House(Shell):
    """What the pieces of one house share while it is built."""

    def __init__(self, plan: HousePlan, rng: Generator, index: int) -> None:
        super().__init__(rng)
        self.plan = plan
        self.style = facades.random_style(rng, index)
        hue, saturation = rng.choice(_ROOFS)
        self.roof_rgb = textures.hsv(hue + rng.uniform(-8, 8), saturation, rng.uniform(0.3, 0.65))
        kinds = (textures.shingles, textures.pantiles, textures.metal_sheet)
        self.roofing = kinds[int(rng.choice(3, p=[0.65, 0.2, 0.15]))]
        self.trim = self.model.patch(textures.plain(rng, self.style.trim_rgb))
        shade = textures.times(self.style.trim_rgb, 0.75)
        self.soffit = self.model.patch(textures.plain(rng, shade))

    def wall(
        self,
        rect: Rect,
        side: str,
        top: float,
        openings: Sequence[Opening] = (),
        slopes: Sequence[float] = (),
        bottom: float = 0.0,
    ) -> None:
        """A painted wall of a rectangle, with a gable of those slopes on it."""
        part, width, height = roofs.gable_wall(rect.side(side), bottom, top, slopes)
        self.model.add(part, facades.paint(self.rng, self.style, width, height, openings))

    def roof(self, kind: str, rect: Rect, top: float, overhang: float = 0.35) -> None:
        """A roof on a rectangle."""
        slopes = self.plan.slopes if kind == "gambrel" else (self.plan.pitch,)
        self.cover(roofs.roof(kind, rect, top, slopes, overhang))

    def windows(
        self, width_m: float, storeys: int = 1, taken: _Intervals = (), chance: float = 0.85
    ) -> list[Opening]:
        """Windows in regular bays of a wall; ``taken``: intervals of its ground floor, m."""
        w, h = self.plan.window_m
        bay = w * (1.9 if self.style.shutters else 1.35) + 0.5
        n = max(1, int((width_m - 0.3) / bay))
        reach = bay / 2 - 0.15
        found = []
        for floor, k in np.ndindex(storeys, n):
            x = (k + 0.5) * width_m / n
            blocked = floor == 0 and any(x + reach > a and x - reach < b for a, b in taken)
            if not blocked and self.rng.random() < chance:
                found.append(Opening("window", x, 0.95 + floor * STOREY_M, w, h))
        return found


def build(plan: HousePlan, rng: Generator, index: int) -> tuple[Surface, ...]:
    """The house of a plan; ``index`` keeps neighbours' materials apart."""
    house = _House(plan, rng, index)
    _main_block(house)
    if plan.garage:
        _garage(house, plan.garage)
    if plan.wing:
        _wing(house, plan.wing)
    _porch(house, plan.porch)
    if plan.bay:
        _bay(house, plan.bay)
    if plan.chimney:
        _chimney(house, plan.chimney, 0.0)
    if plan.stack_xy_m:
        x, y = plan.stack_xy_m
        stack = Rect(x - 0.35, y - 0.25, x + 0.35, y + 0.25)
        _chimney(house, stack, plan.top_m + plan.ridge_m - 1.0)
    if plan.on_roof != "none":
        _on_roof(house)
    for k in range(plan.dormers):
        _dormer(house, plan.main.x0 + plan.main.width_m * (k + 1) / (plan.dormers + 1))
    return (house.model.surface(),)


def _main_block(house: _House) -> None:
    plan, r, top, rise = house.plan, house.plan.main, house.plan.top_m, house.plan.ridge_m
    door = Opening("door", plan.door_x_m - r.x0, 0.15, 0.95, 2.05)
    in_front = [(door.x_m - 0.9, door.x_m + 1.3)]
    in_front += [(part.x0 - r.x0, part.x1 - r.x0) for part in (plan.wing, plan.bay) if part]
    covered = _covered(plan)
    w, d, n = r.width_m, r.depth_m, plan.storeys
    openings = {
        "f": [door, *house.windows(w, n, in_front)],
        "r": house.windows(d, n, covered.get("r", ()), 0.6),
        "b": house.windows(w, n),
        "l": house.windows(d, n, covered.get("l", ()), 0.6),
    }
    gables = {"gable_x": "rl", "gable_y": "fb", "gambrel": "fb", "hip": ""}[plan.roof]
    for side in gables:
        width = d if side in "rl" else w
        if plan.roof == "gambrel":
            wide, high = min(plan.window_m[0], 1.1), plan.window_m[1]
            attic = [Opening("window", width * u, top + 0.5, wide, high) for u in (0.36, 0.64)]
        else:
            attic = [Opening("window", width / 2, top + 0.15, 0.7, min(1.0, rise - 1.0))]
        if plan.roof == "gambrel" or rise > 1.6:
            openings[side] += attic
    for side, found in openings.items():
        house.wall(r, side, top, found, plan.slopes if side in gables else ())
    house.roof(plan.roof, r, top)


def _covered(plan: HousePlan) -> dict[str, _Intervals]:
    """What a garage or chimney hides of a side wall, from the wall's left."""
    part, main = plan.garage or plan.chimney, plan.main  # no house has both
    if part is None:
        return {}
    low, high = part.y0 - main.y0, part.y1 - main.y0
    if part.x0 > main.x0:
        return {"r": [(low, high)]}
    return {"l": [(main.depth_m - high, main.depth_m - low)]}


def _garage(house: _House, r: Rect) -> None:
    plan, top = house.plan, 2.55
    slopes = () if plan.garage_flat else (plan.pitch,)
    door = Opening("garage", r.width_m / 2, 0.02, r.width_m - 0.7, 2.1)
    house.wall(r, "f", top, [door], slopes)
    house.wall(r, "b", top, house.windows(r.width_m), slopes)
    outer = "r" if plan.garage_side > 0 else "l"
    house.wall(r, outer, top, house.windows(r.depth_m, chance=0.5))
    if plan.garage_flat:
        x0, y0, x1, y1 = r.grown(0.12)
        house.flat_roof((x0, y0, top), (x1, y1, top + 0.22))
    else:
        house.roof("gable_y", r, top, 0.25)


def _wing(house: _House, r: Rect) -> None:
    plan, top = house.plan, house.plan.top_m
    windows = house.windows(r.width_m, plan.storeys, chance=1.0)
    house.wall(r, "f", top, windows, (plan.pitch,))
    house.wall(r, "r", top)
    house.wall(r, "l", top)
    # Run back into the main roof until the ridges' slopes meet.
    house.roof("gable_y", r._replace(y1=r.y1 + r.width_m / 2), top, 0.3)


def _porch(house: _House, r: Rect) -> None:
    rng = house.rng
    deck = textures.paving(rng, random_hsv(rng, (0, 60), 0.2, 0.65), 16, 64)
    house.model.add(box((r.x0, r.y0, 0.0), (r.x1, r.y1, 0.15), sides="flr"), deck)
    if r.depth_m < 1.0:
        return
    n = 2 + sum(r.width_m > wide for wide in (2.6, 3.8, 5.5))
    for k in range(n):
        x = r.x0 + 0.1 + (r.width_m - 0.2) * k / (n - 1)
        if abs(x - house.plan.door_x_m) < 0.65:  # it would stand in the way
            continue
        low, high = (x - 0.07, r.y0 + 0.03, 0.15), (x + 0.07, r.y0 + 0.17, _PORCH_ROOF_M)
        house.plain(box(low, high, top=False))
    if r.width_m > 2.6 and rng.random() < 0.7:  # a balustrade at both ends
        for x in (r.x0 + 0.05, r.x1 - 0.05):
            house.plain(box((x - 0.03, r.y0 + 0.1, 0.85), (x + 0.03, r.y1, 0.93), bottom=True))
            for y in np.arange(r.y0 + 0.3, r.y1, 0.22):
                rod = box((x - 0.02, y - 0.02, 0.15), (x + 0.02, y + 0.02, 0.85), top=False)
                house.plain(rod, 0.9)
    over = Rect(r.x0 - 0.2, r.y0 - 0.2, r.x1 + 0.2, r.y1)
    slope = roofs.pent(over, _PORCH_ROOF_M, _PORCH_ROOF_M + 0.3, 0.13)
    house.cover(replace(slope, slope_m=over.depth_m), 20.0)


def _bay(house: _House, r: Rect) -> None:
    """A bay window: three walls under a little roof."""
    top, high = 2.2, min(house.plan.window_m[1], 1.2)
    wide = Opening("window", r.width_m / 2, 0.8, r.width_m - 0.5, high)
    narrow = Opening("window", r.depth_m / 2, 0.8, r.depth_m - 0.3, high)
    sides = [narrow] if r.depth_m > 0.6 else []
    for side, windows in (("f", [wide]), ("r", sides), ("l", sides)):
        house.wall(r, side, top, windows)
    over = Rect(r.x0 - 0.12, r.y0 - 0.12, r.x1 + 0.12, r.y1)
    house.cover(roofs.pent(over, top, top + 0.3, 0.1), 20.0)


def _chimney(house: _House, r: Rect, foot: float) -> None:
    """A brick chimney from a foot up over the ridge."""
    plan, rng = house.plan, house.rng
    top = plan.top_m + plan.ridge_m + rng.uniform(0.4, 0.9)
    colour = random_hsv(rng, (0, 40), (0.2, 0.6), (0.45, 0.75))
    bricks = textures.brick(rng, (round((top - foot) * 30), round(1.2 * 30)), colour, 30.0)
    house.model.add(box((r.x0, r.y0, foot), (r.x1, r.y1, top), top=False), bricks)
    cap = textures.plain(rng, (150.0, 146.0, 140.0), (16, 16), 0.12)
    x0, y0, x1, y1 = r.grown(0.06)
    house.model.add(box((x0, y0, top), (x1, y1, top + 0.14), bottom=True), cap)


def _on_roof(house: _House) -> None:
    """Solar panels or skylights on the front slope of a roof whose ridge runs along the front."""
    plan, rng, r = house.plan, house.rng, house.plan.main
    panels = plan.on_roof == "panels"
    n = int(rng.integers(1, 4))
    width, rows = (1.7, (0.18, 0.85)) if panels else (0.8, (0.4, 0.68))
    first = rng.uniform(0.08, 0.3) * r.width_m + r.x0
    step = width + (0.06 if panels else rng.uniform(0.6, 1.4))
    glass = textures.plain(rng, (32.0, 42.0, 72.0), (48, 30), 0.06)
    if panels:
        glass[::8] = glass[:, ::10] = (120, 130, 150)
    else:
        cv2.line(glass, (0, 40), (29, 12), (150, 175, 195), 4, cv2.LINE_AA)
    frame(glass, (0, 0, 29, 47), (190, 192, 195), 2)
    patch = house.model.patch(glass)
    near, far = (share * r.depth_m / 2 for share in rows)
    z0, z1 = (plan.top_m + plan.pitch * y + 0.13 for y in (near, far))
    for k in range(n):
        x = first + k * step
        if x + width > r.x1 - 0.2:
            return
        pane = roofs.pent(Rect(x, r.y0 + near, x + width, r.y0 + far), z0, z1, 0.09)
        house.model.add(pane.cover, patch)
        house.plain(pane.fascia)


def _dormer(house: _House, x: float) -> None:
    plan = house.plan
    w, front = 1.5, plan.main.y0 + 1.0
    foot = plan.top_m + plan.pitch * 0.9
    top, rise = foot + 1.0, plan.pitch * w / 2
    back = front + (top + rise - foot) / plan.pitch
    rect = Rect(x - w / 2, front, x + w / 2, min(back, (plan.main.y0 + plan.main.y1) / 2))
    window = Opening("window", w / 2, 0.2, 0.8, 0.75)
    house.wall(rect, "f", top, [window], (plan.pitch,), foot)
    for side in "rl":
        house.plain(wall(*rect.side(side), foot, top), 0.9)
    house.roof("gable_y", rect, top, 0.15)

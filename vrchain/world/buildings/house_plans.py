"""Plans of houses: which parts one has, and where they stand on the ground."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from vrchain.world.buildings.roofs import profile

STOREY_M = 2.75
_WIDEST_M = 12.7  # house and garage: a narrow lot has room at both sides


@dataclass(frozen=True)
class Rect:
    """An upright rectangle on the ground, metres."""

    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def width_m(self) -> float:
        return self.x1 - self.x0

    @property
    def depth_m(self) -> float:
        return self.y1 - self.y0

    def shifted(self, dx: float, dy: float) -> "Rect":
        return Rect(self.x0 + dx, self.y0 + dy, self.x1 + dx, self.y1 + dy)


@dataclass(frozen=True)
class HousePlan:
    """Where the parts of a house stand, in the model frame."""

    main: Rect
    storeys: int
    roof: str  # "gable_x" (ridge along the front), "gable_y" (gable to the front), "hip", "gambrel"
    pitch: float  # rise over run
    garage: Rect | None
    garage_flat: bool
    wing: Rect | None  # projects to the front under a gable of its own
    porch: Rect | None  # deck, posts and roof before the door, or before the whole front
    chimney: Rect | None  # stands against a side wall
    bay: Rect | None  # a bay window on the ground floor of the front
    stack_xy_m: tuple[float, float] | None  # a chimney that comes through the roof
    door_x_m: float
    window_m: tuple[float, float]  # width and height
    dormers: int
    on_roof: str  # "panels" (solar), "skylights" or "none", on the front slope of a gable_x

    @property
    def size_m(self) -> tuple[float, float]:
        """Width (along the street) and depth of the rectangle around it all."""
        around = _around([r for r in _parts(self) if r])
        return around.width_m, around.depth_m

    @property
    def outline(self) -> shapely.Geometry:
        """Convex outline on the ground, as ``SceneObject.footprint`` has it."""
        boxes = [shapely.box(r.x0, r.y0, r.x1, r.y1) for r in _parts(self) if r]
        return shapely.union_all(boxes).convex_hull

    @property
    def top_m(self) -> float:
        """Height of the walls."""
        return self.storeys * STOREY_M + 0.1

    @property
    def slopes(self) -> tuple[float, ...]:
        """Rise over run of the roof of a gable, from the eave up."""
        return (1.5 + self.pitch, 0.75 * self.pitch) if self.roof == "gambrel" else (self.pitch,)

    @property
    def ridge_m(self) -> float:
        """Height of the ridge over the walls."""
        w, d = self.main.width_m, self.main.depth_m
        span = {"gable_x": d, "hip": min(w, d)}.get(self.roof, w)
        return float(profile(span / 2, self.slopes)[-1, 1])

    @property
    def garage_side(self) -> int:
        """-1 or 1 for a garage at the left or right, 0 for none."""
        return 0 if self.garage is None else int(np.sign(self.garage.x0 + self.garage.x1))


def _parts(plan: HousePlan) -> list[Rect | None]:
    return [plan.main, plan.garage, plan.wing, plan.porch, plan.chimney, plan.bay]


def _around(rects: Sequence[Rect]) -> Rect:
    return Rect(
        min(r.x0 for r in rects),
        min(r.y0 for r in rects),
        max(r.x1 for r in rects),
        max(r.y1 for r in rects),
    )


def draw_plan(rng: np.random.Generator, two_storey: float) -> HousePlan:
    """A random plan; ``two_storey``: the chance of an upper floor."""
    storeys = 2 if rng.random() < two_storey else 1
    w, d = rng.uniform(7.6, 10.2), rng.uniform(6.6, 8.4)
    shares = [0.38, 0.22, 0.25, 0.15] if storeys == 1 else [0.45, 0.25, 0.3, 0.0]
    roof = str(rng.choice(["gable_x", "gable_y", "hip", "gambrel"], p=shares))
    to_front = roof in ("gable_y", "gambrel")
    if to_front:
        w = min(w, 8.6)
    has_garage, gw = rng.random() < 0.5, rng.uniform(3.1, 3.6)
    if has_garage:
        w = min(w, _WIDEST_M - gw)
    main = Rect(-w / 2, -d / 2, w / 2, d / 2)
    side = int(rng.choice([-1, 1]))

    garage = wing = chimney = None
    if has_garage:
        gd, back = rng.uniform(5.2, 6.0), rng.uniform(0.0, 0.8)
        x0 = w / 2 if side > 0 else -w / 2 - gw
        garage = Rect(x0, -d / 2 + back, x0 + gw, -d / 2 + back + gd)
    elif rng.random() < 0.5:
        cw, cy = 0.55, rng.uniform(-d / 4, d / 4)
        x0 = w / 2 if side > 0 else -w / 2 - cw
        chimney = Rect(x0, cy - 0.6, x0 + cw, cy + 0.6)
    if not to_front and rng.random() < 0.55:
        ww, out = rng.uniform(3.2, 4.4), rng.uniform(1.2, 2.2)
        x0 = -side * (w / 2 - 0.5) - (ww if side < 0 else 0)
        wing = Rect(x0, -d / 2 - out, x0 + ww, -d / 2)

    # The door takes what the wing leaves of the front.
    low, high = main.x0 + 0.9, main.x1 - 0.9
    if wing:
        low, high = (wing.x1 + 0.8, high) if wing.x0 + wing.x1 < 0 else (low, wing.x0 - 0.8)
    door_x = float(rng.uniform(low, high))
    deck = rng.uniform(1.2, 1.7) if rng.random() < 0.6 else 0.5
    half = rng.uniform(0.9, 2.4) if deck > 1 else 0.8
    porch = Rect(
        max(door_x - half, main.x0, wing.x1 if wing and wing.x1 < door_x else -np.inf),
        -d / 2 - deck,
        min(door_x + half, main.x1, wing.x0 if wing and wing.x0 > door_x else np.inf),
        -d / 2,
    )
    if not wing and rng.random() < 0.2:  # a veranda before the whole front
        porch = Rect(main.x0, -d / 2 - rng.uniform(1.3, 1.7), main.x1, -d / 2)
    stack = None
    if not chimney and rng.random() < 0.5:
        along, across = rng.uniform(-0.33, 0.33), rng.uniform(0.0, 0.08)
        stack = (along * w, across * d) if not to_front else (across * w, along * d)
        if roof == "hip":
            stack = (0.0, across * d)
    on_roof = str(rng.choice(["none", "panels", "skylights"], p=[0.5, 0.25, 0.25]))
    plan = HousePlan(
        main=main,
        storeys=storeys,
        roof=roof,
        pitch=float(rng.uniform(0.45, 0.8) if storeys == 1 else rng.uniform(0.4, 0.65)),
        garage=garage,
        garage_flat=bool(rng.random() < 0.35),
        wing=wing,
        porch=porch,
        chimney=chimney,
        bay=_bay(rng, main, wing, porch) if rng.random() < 0.45 else None,
        stack_xy_m=stack,
        door_x_m=door_x,
        window_m=(float(rng.uniform(0.85, 1.45)), float(rng.uniform(1.05, 1.45))),
        dormers=int(rng.integers(1, 3))
        if roof == "gable_x" and not wing and rng.random() < 0.5
        else 0,
        on_roof=on_roof,
    )
    if plan.roof != "gable_x" or plan.dormers or plan.wing:
        plan = replace(plan, on_roof="none")
    around = _around([r for r in _parts(plan) if r])
    dx, dy = -(around.x0 + around.x1) / 2, -(around.y0 + around.y1) / 2
    centred = [r.shifted(dx, dy) if r else None for r in _parts(plan)]
    names = ("main", "garage", "wing", "porch", "chimney", "bay")
    if stack:
        plan = replace(plan, stack_xy_m=(stack[0] + dx, stack[1] + dy))
    return replace(plan, door_x_m=door_x + dx, **dict(zip(names, centred, strict=True)))  # type: ignore[arg-type]


def _bay(rng: np.random.Generator, main: Rect, wing: Rect | None, porch: Rect) -> Rect | None:
    """A bay window where wing and porch leave room for it."""
    w, out = rng.uniform(1.7, 2.3), rng.uniform(0.45, 0.7)
    edges = sorted([(main.x0, main.x0), (main.x1, main.x1)]
                   + [(r.x0, r.x1) for r in (wing, porch) if r])  # fmt: skip
    gaps = [(a[1] + 0.35, b[0] - 0.35) for a, b in itertools.pairwise(edges)]
    low, high = max(gaps, key=lambda gap: gap[1] - gap[0])
    if high - low < w:
        return None
    x = rng.uniform(low, high - w)
    return Rect(x, main.y0 - out, x + w, main.y0)

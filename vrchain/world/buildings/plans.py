"""Plans of houses, shops and barns: which parts one has, and where they stand on the ground.

Model frame: the middle of the rectangle around all parts at the origin, the front towards -y.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import shapely
from numpy.random import Generator

from vrchain.world.buildings.roofs import profile
from vrchain.world.shapes import Rect

STOREY_M = 2.75
GROUND_FLOOR_M = 3.5  # height of a shop's ground floor, its sign included
_WIDEST_M = 12.7  # house and garage: a narrow lot has room at both sides


class _Plan:
    """What all plans have; ``main`` is the block under the largest roof."""

    main: Rect

    def _parts(self) -> Sequence[shapely.Geometry]:
        """What stands on the ground."""
        return [shapely.box(*self.main)]

    @property
    def outline(self) -> shapely.Geometry:
        """Convex outline on the ground, as ``SceneObject.footprint`` has it."""
        return shapely.union_all(self._parts()).convex_hull

    @property
    def size_m(self) -> tuple[float, float]:
        """Width (along the street) and depth of the rectangle around it all."""
        x0, y0, x1, y1 = self.outline.bounds
        return x1 - x0, y1 - y0

    def _off_middle(self, *names: str) -> tuple[float, float, dict[str, Any]]:
        """The step that centres the plan, and what parts become by it."""
        x0, y0, x1, y1 = self.outline.bounds
        dx, dy = -(x0 + x1) / 2, -(y0 + y1) / 2
        parts = {name: getattr(self, name) for name in names}
        return dx, dy, {name: part.shifted(dx, dy) for name, part in parts.items() if part}


@dataclass(frozen=True)
class HousePlan(_Plan):
    """Where the parts of a house stand, in the model frame."""

    main: Rect
    storeys: int
    roof: str  # "gable_x" (ridge along the front), "gable_y" (gable to the front), "hip", "gambrel"
    pitch: float  # rise over run
    garage: Rect | None
    garage_flat: bool
    wing: Rect | None  # projects to the front under a gable of its own
    porch: Rect  # deck, posts and roof before the door, or before the whole front
    chimney: Rect | None  # stands against a side wall
    bay: Rect | None  # a bay window on the ground floor of the front
    stack_xy_m: tuple[float, float] | None  # a chimney that comes through the roof
    door_x_m: float
    window_m: tuple[float, float]  # width and height
    dormers: int
    on_roof: str  # "panels" (solar), "skylights" or "none", on the front slope of a gable_x

    def _parts(self) -> Sequence[shapely.Geometry]:
        rects = (self.main, self.garage, self.wing, self.porch, self.chimney, self.bay)
        return [shapely.box(*r) for r in rects if r]

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


def draw_house(rng: Generator, two_storey: float) -> HousePlan:
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
        garage = _beside(main, side, gw, -d / 2 + back, -d / 2 + back + gd)
    elif rng.random() < 0.5:
        y = rng.uniform(-d / 4, d / 4)
        chimney = _beside(main, side, 0.55, y - 0.6, y + 0.6)
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
        stack = (across * w, along * d) if to_front else (along * w, across * d)
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
        dormers=_dormers(rng) if roof == "gable_x" and not wing else 0,
        on_roof=on_roof,
    )
    if plan.roof != "gable_x" or plan.dormers or plan.wing:
        plan = replace(plan, on_roof="none")
    dx, dy, parts = plan._off_middle("main", "garage", "wing", "porch", "chimney", "bay")
    stack = (stack[0] + dx, stack[1] + dy) if stack else None
    return replace(plan, door_x_m=door_x + dx, stack_xy_m=stack, **parts)


def _dormers(rng: Generator) -> int:
    return int(rng.integers(1, 3)) if rng.random() < 0.5 else 0


def _beside(main: Rect, side: int, out_m: float, y0: float, y1: float) -> Rect:
    """What stands against the right (1) or left (-1) side of a block, ``out_m`` wide."""
    x0 = main.x1 if side > 0 else main.x0 - out_m
    return Rect(x0, y0, x0 + out_m, y1)


def _bay(rng: Generator, main: Rect, wing: Rect | None, porch: Rect) -> Rect | None:
    """A bay window where wing and porch leave room for it."""
    w, out = rng.uniform(1.7, 2.3), rng.uniform(0.45, 0.7)
    taken = [(main.x0, main.x0), (main.x1, main.x1), *((r.x0, r.x1) for r in (wing, porch) if r)]
    gaps = [(a[1] + 0.35, b[0] - 0.35) for a, b in itertools.pairwise(sorted(taken))]
    low, high = max(gaps, key=lambda gap: gap[1] - gap[0])
    if high - low < w:
        return None
    x = rng.uniform(low, high - w)
    return Rect(x, main.y0 - out, x + w, main.y0)


@dataclass(frozen=True)
class ShopPlan(_Plan):
    """Where the parts of a shop stand, in the model frame, and what it is called."""

    main: Rect
    storeys: int
    roof: str  # "flat", "gable_x" (ridge along the front), "gable_y" (gable to the front) or "hip"
    pitch: float  # rise over run
    door: float  # where in the front the door is, 0..1
    bays: int  # display windows
    shelter: str  # over the windows: "awning" (sloped cloth), "canopy" (a slab) or "none"
    hanging: bool  # a second sign that stands out from the wall
    board: bool  # a third one on posts upon a flat roof
    advert_side: int  # -1 or 1: an advertisement painted on that side wall; 0: none
    name: str
    trade: str
    wares: tuple[str, ...]

    @property
    def top_m(self) -> float:
        """Height of the walls, without a flat roof's parapet."""
        return GROUND_FLOOR_M + (self.storeys - 1) * STOREY_M + 0.2


_TRADES = [line.split() for line in """\
BAKERY BREAD CAKES PIES
BOOKS MAPS PRINTS NOVELS
CAFE COFFEE TEA SOUP
BARBER CUTS SHAVES WIGS
FLOWERS ROSES WREATHS BULBS
GROCER FRUIT CHEESE EGGS
HARDWARE TOOLS NAILS PAINT
PHARMACY PILLS SOAP TONICS
TOYS GAMES KITES DOLLS
SHOES BOOTS HEELS LACES
BIKES TYRES REPAIRS BELLS
RECORDS VINYL TAPES GUITARS
TAILOR SUITS COATS HATS
BUTCHER BEEF HAM SAUSAGE
LAUNDRY WASH PRESS DRY
CLOCKS WATCHES REPAIRS RINGS
FABRICS WOOL SILK YARN
PETS SEED FISH BIRDS
CAMERAS FILM FRAMES LENSES
NOODLES RICE BROTH DUMPLINGS""".splitlines()]  # fmt: skip
_FIRST = (
    "Al", "Bel", "Cas", "Dor", "El", "Fen", "Gar", "Hol", "Ing", "Jas", "Kel", "Lor", "Mar",
    "Nor", "Os", "Pen", "Quil", "Ros", "Sel", "Tor", "Um", "Ven", "Wal", "Yar", "Zel",
)  # fmt: skip
_LAST = (
    "bury", "combe", "dale", "der", "ford", "gan", "holm", "kin", "lett", "mond", "ner", "pole",
    "rick", "sby", "ton", "vane", "well", "wick", "worth", "zano",
)  # fmt: skip


def draw_shop(rng: Generator) -> ShopPlan:
    """A random shop of 7.5 to 12 m by 7 to 10 m."""
    w, d = rng.uniform(7.5, 12.0), rng.uniform(7.0, 10.0)
    storeys = 2 if rng.random() < 0.45 else 1
    roof = str(rng.choice(["flat", "gable_x", "gable_y", "hip"], p=[0.5, 0.2, 0.2, 0.1]))
    trade, *wares = _TRADES[int(rng.integers(len(_TRADES)))]
    owner = str(rng.choice(_FIRST)) + str(rng.choice(_LAST))
    forms = (owner, owner + "'s", owner + " & Co", owner + " & Sons", "The " + owner)
    return ShopPlan(
        main=Rect(-w / 2, -d / 2, w / 2, d / 2),
        storeys=storeys,
        roof=roof,
        pitch=float(rng.uniform(0.35, 0.6)),
        door=float(rng.choice([0.13, 0.5, 0.87])),
        bays=int(rng.integers(2, 5)),
        shelter=str(rng.choice(["awning", "canopy", "none"], p=[0.5, 0.2, 0.3])),
        hanging=bool(rng.random() < 0.5),
        board=bool(roof == "flat" and rng.random() < 0.4),
        advert_side=int(rng.integers(-1, 2)),
        name=str(rng.choice(forms)),
        trade=trade,
        wares=tuple(wares),
    )


@dataclass(frozen=True)
class Silo:
    """A round tower under a dome; x_m, y_m: its axis."""

    x_m: float
    y_m: float
    radius_m: float
    height_m: float

    def shifted(self, dx: float, dy: float) -> "Silo":
        return replace(self, x_m=self.x_m + dx, y_m=self.y_m + dy)


@dataclass(frozen=True)
class BarnPlan(_Plan):
    """Where the parts of a barn stand, in the model frame."""

    main: Rect
    wall_m: float  # height of the side walls
    slopes: tuple[float, ...]  # of the roof, rise over run, from the eave up
    door_m: tuple[float, float]  # width and height of the big door
    lean_to: Rect | None  # a low shed along a side wall
    silo: Silo | None  # stands free of the other side wall by a hand's breadth
    vents: int  # little towers on the ridge

    def _parts(self) -> Sequence[shapely.Geometry]:
        parts = [shapely.box(*r) for r in (self.main, self.lean_to) if r]
        if self.silo:
            foot = shapely.Point(self.silo.x_m, self.silo.y_m)
            parts.append(foot.buffer(self.silo.radius_m + 0.05))
        return parts

    @property
    def ridge_m(self) -> float:
        """Height of the ridge over the ground."""
        return self.wall_m + float(profile(self.main.width_m / 2, self.slopes)[-1, 1])


def draw_barn(rng: Generator) -> BarnPlan:
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
        lean_to = _beside(main, side, out, y0, d / 2 - rng.uniform(0.0, 1.5))
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
    return replace(plan, **plan._off_middle("main", "lean_to", "silo")[2])

"""Lots along streets, and what is built on each: a house with driveway and path, a shop, a barn."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.random import Generator
from numpy.typing import NDArray

from vrchain.geometry import Pose
from vrchain.world.buildings.plans import BarnPlan, HousePlan, ShopPlan
from vrchain.world.suburb.streets import TURNING_M, Streets

_DEPTH_M = 22.0
_WIDTH_M = (14.8, 17.4)
_TIGHT_M = ((14.5, 22.0), (14.5, 18.8))  # width and depth, where a whole lot does not fit
_SIDE_M = 0.85  # from a house to its lot's side
_RIM_M = 0.35  # of a lot that its neighbour's may overlap
DRIVEWAY_M = 2.7


@dataclass(frozen=True, eq=False)
class Lot:
    """A rectangle of land. Its frame: u along the street, v away from it, the front at v = 0."""

    front_xy_m: NDArray[np.float64]
    yaw_rad: float
    width_m: float
    depth_m: float

    def to_world(self, uv_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """Points of the lot's frame, (..., 2), in the world."""
        c, s = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        return self.front_xy_m + uv_m @ np.array([[c, s], [-s, c]])

    def pose(self, u_m: float, v_m: float, turn_rad: float = 0.0) -> Pose:
        """A pose of the lot's frame in the world; turn 0: a model's -y looks at the street."""
        x, y = self.to_world(np.array([u_m, v_m]))
        return Pose(float(x), float(y), self.yaw_rad + float(turn_rad))

    def rectangle(self, u0: float, v0: float, u1: float, v1: float) -> shapely.Polygon:
        """A rectangle of the lot's frame in the world."""
        return shapely.Polygon(self.to_world(np.array([(u0, v0), (u1, v0), (u1, v1), (u0, v1)])))

    def strip(self, u_m: float, half_m: float, reach_m: float) -> shapely.Polygon:
        """A rectangle around u from the pavement inwards."""
        return self.rectangle(u_m - half_m, 0.0, u_m + half_m, reach_m)

    @property
    def middle_xy_m(self) -> NDArray[np.float64]:
        """The middle in the world, (2,)."""
        return self.to_world(np.array([0.0, self.depth_m / 2]))

    @cached_property
    def polygon(self) -> shapely.Polygon:
        """The whole lot."""
        return self.strip(0.0, self.width_m / 2, self.depth_m)

    @cached_property
    def inner(self) -> shapely.Polygon:
        """The lot less a rim; rims of neighbours may overlap where a street bends."""
        half = self.width_m / 2 - _RIM_M
        return self.rectangle(-half, _RIM_M, half, self.depth_m - _RIM_M)


@dataclass(frozen=True, eq=False)
class _Built:
    """A lot with a building; centre_uv_m: where its plan's middle is."""

    lot: Lot
    centre_uv_m: tuple[float, float]

    @property
    def pose(self) -> Pose:
        return self.lot.pose(*self.centre_uv_m)


@dataclass(frozen=True, eq=False)
class Homestead(_Built):
    """A lot with its house."""

    plan: HousePlan
    driveway_u_m: float

    @property
    def front_v_m(self) -> float:
        """Where the house begins, its porch included."""
        return self.centre_uv_m[1] - self.plan.size_m[1] / 2

    @cached_property
    def driveway(self) -> shapely.Polygon:
        """From the pavement to the garage, or beside the house."""
        garage = self.plan.garage
        reach = self.centre_uv_m[1] + garage.y0 if garage else self.front_v_m + 2.5
        return self.lot.strip(self.driveway_u_m, DRIVEWAY_M / 2, reach)

    @cached_property
    def path(self) -> shapely.Polygon:
        """From the pavement to the door."""
        u, v = self.centre_uv_m
        return self.lot.strip(u + self.plan.door_x_m, 0.6, v + self.plan.porch.y0)


@dataclass(frozen=True, eq=False)
class Premises(_Built):
    """A lot with a shop or a barn."""

    plan: ShopPlan | BarnPlan

    @property
    def kind(self) -> str:
        """ "shop" or "barn"."""
        return "barn" if isinstance(self.plan, BarnPlan) else "shop"

    @cached_property
    def yard(self) -> shapely.Polygon:
        """What is paved from the pavement to a shop's whole front, or to a barn's door."""
        (u, v), main = self.centre_uv_m, self.plan.main
        if isinstance(self.plan, BarnPlan):
            return self.lot.strip(u + main.middle_x_m, self.plan.door_m[0] / 2 + 0.3, v + main.y0)
        return self.lot.strip(u, main.width_m / 2 + 0.6, v + main.y0)


def draw_lots(streets: Streets, extent_m: tuple[float, float], rng: Generator) -> list[Lot]:
    """As many lots as fit side by side along the streets, none overlapping."""
    on_map = shapely.box(*(-e / 2 + 0.5 for e in extent_m), *(e / 2 - 0.5 for e in extent_m))
    lots: list[Lot] = []
    taken = [streets.corridor.buffer(-0.4)]

    def fits(lot: Lot) -> bool:
        ground = lot.inner
        return bool(on_map.contains(ground)) and not shapely.intersects(taken, ground).any()

    def take(lot: Lot) -> None:
        lots.append(lot)
        taken.append(lot.inner)

    for street in streets.lines:
        for side in (1, -1):
            along, end = street.on_map_m
            width = rng.uniform(*_WIDTH_M)
            along += rng.uniform(0, 1.5) + width / 2
            while along < end - width / 2:
                front = streets.beside(street, along, side, streets.pavement_m)
                sizes = ((float(width), _DEPTH_M), *_TIGHT_M)
                tries = [Lot(front.xy_m, front.yaw_rad, *size) for size in sizes]
                if not fits(tries[-1]):  # the least, so no other does
                    along += 0.5
                    continue
                lot = next(lot for lot in tries if fits(lot))
                take(lot)
                along += lot.width_m / 2
                width = rng.uniform(*_WIDTH_M)
                along += width / 2
    for lot in _round_heads(streets):
        if fits(lot):
            take(lot)
    return lots


def _round_heads(streets: Streets) -> Iterator[Lot]:
    """Lots that look at the turning circles where streets end: ahead, left, right."""
    for street in streets.lines:
        if street.head is None:
            continue
        end = street.at(street.line.length)
        for turn in (0.0, 1.15, -1.15):
            outward = np.array([np.cos(end.yaw_rad + turn), np.sin(end.yaw_rad + turn)])
            centre = np.array([street.head.x, street.head.y])
            front = centre + outward * (streets.half_m + TURNING_M)
            yield Lot(front, end.yaw_rad + turn - np.pi / 2, *_TIGHT_M[0])


def settle(lot: Lot, plan: HousePlan, setback_m: float, rng: Generator) -> Homestead:
    """The house on its lot, set back; without a garage to one side, so that a car fits beside."""
    width, depth = plan.size_m
    room = lot.width_m / 2 - width / 2 - _SIDE_M
    side = plan.garage_side or int(rng.choice([-1, 1]))
    if plan.garage:
        u = float(rng.uniform(-room, room))
        drive = u + plan.garage.middle_x_m
    else:
        u = -side * room
        drive = side * (lot.width_m / 2 - DRIVEWAY_M / 2 - 0.4)
    return Homestead(lot, (u, setback_m + depth / 2), plan, drive)


def occupy(
    lot: Lot, plan: ShopPlan | BarnPlan, setback_m: tuple[float, float], rng: Generator
) -> Premises:
    """A shop or a barn on its lot, somewhere between its sides, set back if there is room."""
    width, depth = plan.size_m
    room = max(0.0, lot.width_m / 2 - width / 2 - _SIDE_M)
    setback = min(float(rng.uniform(*setback_m)), lot.depth_m - depth - _SIDE_M)
    return Premises(lot, (float(rng.uniform(-room, room)), setback + depth / 2), plan)

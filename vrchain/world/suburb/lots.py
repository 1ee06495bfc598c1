"""Lots along streets, and what is built on each: a house with driveway and path, a shop, a barn."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from vrchain.geometry import Pose
from vrchain.world.buildings.plans import BarnPlan, HousePlan, ShopPlan
from vrchain.world.suburb.streets import TURNING_M, Street, Streets

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
        return Pose(float(x), float(y), self.yaw_rad + turn_rad)

    def rectangle(self, u0: float, v0: float, u1: float, v1: float) -> shapely.Polygon:
        """A rectangle of the lot's frame in the world."""
        return shapely.Polygon(self.to_world(np.array([(u0, v0), (u1, v0), (u1, v1), (u0, v1)])))

    @property
    def middle_xy_m(self) -> NDArray[np.float64]:
        """The middle in the world, (2,)."""
        return self.to_world(np.array([0.0, self.depth_m / 2]))

    @cached_property
    def polygon(self) -> shapely.Polygon:
        """The whole lot."""
        return self.rectangle(-self.width_m / 2, 0.0, self.width_m / 2, self.depth_m)

    @cached_property
    def inner(self) -> shapely.Polygon:
        """The lot less a rim; rims of neighbours may overlap where a street bends."""
        half = self.width_m / 2 - _RIM_M
        return self.rectangle(-half, _RIM_M, half, self.depth_m - _RIM_M)


@dataclass(frozen=True, eq=False)
class Homestead:
    """A lot with its house."""

    lot: Lot
    plan: HousePlan
    house_uv_m: tuple[float, float]  # the plan's middle
    driveway_u_m: float

    @property
    def pose(self) -> Pose:
        return self.lot.pose(*self.house_uv_m)

    @property
    def house_front_v_m(self) -> float:
        return self.house_uv_m[1] - self.plan.size_m[1] / 2

    @cached_property
    def driveway(self) -> shapely.Polygon:
        """From the pavement to the garage, or beside the house."""
        reach = self.house_front_v_m + 2.5
        if self.plan.garage:
            reach = self.house_uv_m[1] + self.plan.garage.y0
        half = DRIVEWAY_M / 2
        return self.lot.rectangle(self.driveway_u_m - half, 0.0, self.driveway_u_m + half, reach)

    @cached_property
    def path(self) -> shapely.Polygon:
        """From the pavement to the door."""
        u = self.house_uv_m[0] + self.plan.door_x_m
        porch = self.plan.porch
        return self.lot.rectangle(
            u - 0.6, 0.0, u + 0.6, self.house_uv_m[1] + (porch.y0 if porch else 0.0)
        )


@dataclass(frozen=True, eq=False)
class Premises:
    """A lot with a shop or a barn."""

    kind: str  # "shop" or "barn"
    lot: Lot
    plan: ShopPlan | BarnPlan
    centre_uv_m: tuple[float, float]  # the plan's middle

    @property
    def pose(self) -> Pose:
        return self.lot.pose(*self.centre_uv_m)

    @cached_property
    def yard(self) -> shapely.Polygon:
        """What is paved from the pavement to a shop's whole front, or to a barn's door."""
        u, v = self.centre_uv_m
        main = self.plan.main
        if isinstance(self.plan, BarnPlan):
            u += (main.x0 + main.x1) / 2
            half = self.plan.door_m[0] / 2 + 0.3
        else:
            half = self.plan.main.width_m / 2 + 0.6
        return self.lot.rectangle(u - half, 0.0, u + half, v + main.y0)


def draw_lots(
    streets: Streets, extent_m: tuple[float, float], rng: np.random.Generator
) -> list[Lot]:
    """As many lots as fit side by side along the streets, none overlapping."""
    on_map = shapely.box(*(-e / 2 + 0.5 for e in extent_m), *(e / 2 - 0.5 for e in extent_m))
    lots: list[Lot] = []
    taken = [streets.corridor.buffer(-0.4)]

    def fits(ground: shapely.Geometry) -> bool:
        return bool(on_map.contains(ground)) and not shapely.intersects(taken, ground).any()

    for street in streets.lines:
        for side in (1, -1):
            along, end = street.on_map_m
            width = rng.uniform(*_WIDTH_M)
            along += rng.uniform(0, 1.5) + width / 2
            while along < end - width / 2:
                front, heading = street.at(along, side * streets.half_m)
                yaw = heading if side > 0 else heading + np.pi
                sizes = ((float(width), _DEPTH_M), *_TIGHT_M)
                tries = [Lot(front, float(yaw), *size) for size in sizes]
                if not fits(tries[-1].inner):  # the least, so no other does
                    along += 0.5
                    continue
                lot = next(lot for lot in tries if fits(lot.inner))
                lots.append(lot)
                taken.append(lot.inner)
                along += lot.width_m / 2
                width = rng.uniform(*_WIDTH_M)
                along += width / 2
    for street in streets.lines:
        for lot in _round_head(street, streets):
            if fits(lot.inner):
                lots.append(lot)
                taken.append(lot.inner)
    return lots


def _round_head(street: Street, streets: Streets) -> list[Lot]:
    """Lots that look at the turning circle where a street ends: ahead, left, right."""
    if street.head is None:
        return []
    _, heading = street.at(street.line.length)
    found = []
    for turn in (0.0, 1.15, -1.15):
        yaw = heading + turn - np.pi / 2
        outward = np.array([np.cos(heading + turn), np.sin(heading + turn)])
        front = np.array([street.head.x, street.head.y]) + outward * (streets.half_m + TURNING_M)
        found.append(Lot(front, float(yaw), *_TIGHT_M[0]))
    return found


def settle(lot: Lot, plan: HousePlan, setback_m: float, rng: np.random.Generator) -> Homestead:
    """The house on its lot, set back; without a garage to one side, so that a car fits beside."""
    width, depth = plan.size_m
    room = lot.width_m / 2 - width / 2 - _SIDE_M
    side = plan.garage_side or int(rng.choice([-1, 1]))
    if plan.garage:
        u = float(rng.uniform(-room, room))
        drive = u + (plan.garage.x0 + plan.garage.x1) / 2
    else:
        u = -side * room
        drive = side * (lot.width_m / 2 - DRIVEWAY_M / 2 - 0.4)
    return Homestead(lot, plan, (u, setback_m + depth / 2), drive)


def occupy(
    kind: str,
    lot: Lot,
    plan: ShopPlan | BarnPlan,
    setback_m: tuple[float, float],
    rng: np.random.Generator,
) -> Premises:
    """A shop or a barn on its lot, somewhere between its sides, set back if there is room."""
    width, depth = plan.size_m
    room = max(0.0, lot.width_m / 2 - width / 2 - _SIDE_M)
    setback = min(float(rng.uniform(*setback_m)), lot.depth_m - depth - _SIDE_M)
    return Premises(kind, lot, plan, (float(rng.uniform(-room, room)), setback + depth / 2))

"""Where a thing of each kind may stand: groups of candidates in order of preference."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
import shapely
from numpy.random import Generator

from vrchain import seeding
from vrchain.geometry import Pose
from vrchain.world.spec import SceneSpec
from vrchain.world.suburb.lots import Homestead, Lot
from vrchain.world.suburb.site import Candidate, Placement, repeats
from vrchain.world.suburb.streets import Street, Streets
from vrchain.world.things import plants, vehicles

_RUN_M = 6.5  # of a fence, wall or hedge; a run may have 8 m at most
_TURN_RAD = 2 * np.pi

Groups = Iterator[list[Candidate]]
_T = TypeVar("_T")


def _disc(radius_m: float, segments: int = 4) -> shapely.Polygon:
    return shapely.Point(0, 0).buffer(radius_m, segments)


def _around(half_x_m: float, half_y_m: float) -> shapely.Polygon:
    return shapely.box(-half_x_m, -half_y_m, half_x_m, half_y_m)


def _anywhere(streets: Streets, rng: Generator) -> tuple[Street, float, int]:
    """A street, a place along it on the map, and a side."""
    street = streets.lines[int(rng.integers(len(streets.lines)))]
    return street, float(rng.uniform(*street.on_map_m)), int(rng.choice([-1, 1]))


def _shuffled(things: Sequence[_T], rng: Generator) -> Iterator[_T]:
    return (things[int(k)] for k in rng.permutation(len(things)))


def parked(
    spec: SceneSpec,
    streets: Streets,
    homesteads: Sequence[Homestead],
    keep_off: shapely.Geometry,
    placed: Sequence[Placement],
    rng: Generator,
) -> Groups:
    """Vehicles: the first share in driveways, the others at kerbs on the right-hand side.

    ``placed`` grows as groups are taken: a twin repeats one of the vehicles there.
    """
    shapely.prepare(keep_off)
    count = spec.vehicles.count
    twins = repeats(count, spec.twins, seeding.generator(spec.seed, "vehicle", "twins"))
    for i in range(count + 60):
        so_far = [p for p in placed if p.kind == "vehicle"]
        if len(so_far) in twins:
            original = so_far[twins[len(so_far)]]
            plan, model = original.plan, original.model
        else:
            draws = seeding.generator(spec.seed, "vehicle", i, "plan")
            plan, model = vehicles.draw_plan(draws), None
        shape = _around(plan.length_m / 2 + 0.05, plan.width_m / 2 + 0.15)
        group = []
        if i < round(spec.vehicles.in_driveway * count):
            for home in _shuffled(homesteads, rng):
                turn = float(rng.choice([-1, 1])) * np.pi / 2
                pose = home.lot.pose(home.driveway_u_m, 0.35 + plan.length_m / 2, turn)
                group.append(Candidate(pose, shape, plan, model))
        for _ in range(60):
            street, along, side = _anywhere(streets, rng)
            pose = street.at(along, side * (streets.width_m / 2 - 0.2 - plan.width_m / 2))
            pose = replace(pose, yaw_rad=pose.yaw_rad + (np.pi if side > 0 else 0.0))
            candidate = Candidate(pose, shape, plan, model)
            if not keep_off.intersects(candidate.ground):
                group.append(candidate)
        yield group


def kerbside(
    streets: Streets, rng: Generator, count: int, beyond_kerb_m: float, radius_m: float
) -> Groups:
    """Evenly along all streets, left and right in turn; then anywhere along them."""
    shape = _disc(radius_m)
    ends = np.cumsum([s.on_map_m[1] - s.on_map_m[0] for s in streets.lines])
    first = rng.uniform(0.2, 0.8)
    for k in range(count):
        total = (k + first) / count * ends[-1]
        i = int(np.searchsorted(ends, total))
        street, along = streets.lines[i], streets.lines[i].on_map_m[1] - (ends[i] - total)
        side = 1 if k % 2 else -1
        yield [
            Candidate(streets.beside(street, along + shift, side, beyond_kerb_m), shape)
            for shift in (0, 2, -2, 4, -4, 6, -6)
        ]
    for _ in range(20 * count + 100):
        yield [Candidate(streets.beside(*_anywhere(streets, rng), beyond_kerb_m), shape)]


def signs(streets: Streets, rng: Generator) -> Groups:
    """Before junctions, facing those who come; then anywhere along the streets."""
    shape = _around(0.55, 0.12)
    places = []
    for street in streets.lines:
        for junction_m, arm in streets.arms(street):
            reach = streets.half_m + float(rng.uniform(2.0, 5.0))
            places.append((street, junction_m + arm * reach, arm))
    places = [*_shuffled(places, rng), *(_anywhere(streets, rng) for _ in range(600))]
    for place in places:
        pose = streets.beside(*place, 0.7)
        yield [Candidate(replace(pose, yaw_rad=pose.yaw_rad + np.pi / 2), shape)]


def mailboxes(homesteads: Sequence[Homestead], rng: Generator) -> Groups:
    """One a house, at the pavement beside the driveway."""
    shape = _around(0.2, 0.32)
    for home in _shuffled(homesteads, rng):
        u, toward = home.driveway_u_m, -1 if home.driveway_u_m > 0 else 1
        shifts = (2.7, 3.6, 4.5, -2.7, 5.4, 6.5, 8.0)
        yield [Candidate(home.lot.pose(u + toward * s, 0.45), shape) for s in shifts]


def bins(homesteads: Sequence[Homestead], rng: Generator) -> Groups:
    """Beside driveways, one a house before any has a second."""
    shape = _around(0.36, 0.41)
    for _ in range(6):
        for home in _shuffled(homesteads, rng):
            group = []
            for _ in range(8):
                u = home.driveway_u_m + rng.choice([-1, 1]) * rng.uniform(2.85, 3.6)
                v = rng.uniform(0.6, home.front_v_m + 4)
                turn = rng.choice([0, np.pi / 2, -np.pi / 2])
                group.append(Candidate(home.lot.pose(u, v, turn), shape))
            yield group


def boundaries(lots: Sequence[Lot], rng: Generator) -> Groups:
    """Runs at the sides, backs and fronts of lots, low ones in front: plan is (length, low)."""
    found: list[tuple[Lot, float, float, float, float, bool]] = []
    for lot in lots:
        half, depth = lot.width_m / 2 - 0.25, lot.depth_m
        back, quarter = min(_RUN_M, lot.width_m / 2 - 1.5), lot.width_m / 4
        for u in (-half, half):
            found.append((lot, u, 3.45, np.pi / 2, 5.1, True))
            found += [(lot, u, v, np.pi / 2, _RUN_M, False) for v in (10.6, 18.3)]
        found += [(lot, u, depth - 0.4, 0.0, back, False) for u in (-quarter, quarter)]
        for u in (3 - half, 0.0, half - 3):
            found += [(lot, u, 0.5, 0.0, length, True) for length in (5.5, 3.5)]
    for lot, u, v, turn, length, low in _shuffled(found, rng):
        shape = _around(length / 2 + 0.05, 0.4)
        yield [Candidate(lot.pose(u, v, turn), shape, (length, low))]


def trees(spec: SceneSpec, lots: Sequence[Lot], rng: Generator) -> Groups:
    """Two of three in front or back gardens, the others wherever there is room."""
    for i in range(40 * spec.trees.count + 1000):
        plan = plants.draw_tree(rng, spec.trees.height_m)
        turn = float(rng.uniform(0, _TURN_RAD))
        if i % 3 and lots:
            lot = lots[int(rng.integers(len(lots)))]
            u = rng.uniform(-0.48, 0.48) * lot.width_m
            v = rng.uniform(1.0, 4.5 if i % 3 == 1 else lot.depth_m - 0.7)
            pose = lot.pose(u, v, turn)
        else:
            x, y = rng.uniform(-0.5, 0.5, 2) * spec.extent_m
            pose = Pose(float(x), float(y), turn)
        yield [Candidate(pose, _disc(plan.foot_radius_m), plan)]


def bushes(spec: SceneSpec, lots: Sequence[Lot], rng: Generator) -> Groups:
    """Before houses and in gardens; plan is the width in metres."""
    for _ in range(60 * spec.furniture.bushes + 500 if lots else 0):
        size, lot = float(rng.uniform(0.7, 1.5)), lots[int(rng.integers(len(lots)))]
        u = rng.uniform(-0.47, 0.47) * lot.width_m
        v = rng.uniform(1.0, 5.0) if rng.random() < 0.5 else rng.uniform(5.0, 21.0)
        pose = lot.pose(u, v, rng.uniform(0, _TURN_RAD))
        yield [Candidate(pose, _disc(0.6 * size, 6), size)]

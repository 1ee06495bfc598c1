from math import gcd

import numpy as np
import pytest
import shapely
from hamlet import hamlet
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from worlds import world

from vrchain.simulation.collision_free import FreeSpace, _steps_m


@pytest.fixture(scope="module")
def free() -> FreeSpace:
    return FreeSpace(hamlet())


@pytest.mark.parametrize("start", [(0.25, 0.25), (-14.75, 8.25)])
def test_on_open_ground_a_way_is_straight_to_one_and_a_half_per_cent(
    start: tuple[float, float],
) -> None:
    free = FreeSpace(world(extent_m=(40.0, 40.0)))
    straight_m = np.hypot(*(free.points_m - start).T)
    others = straight_m > 0
    longer = free.from_m(np.array(start))[others] / straight_m[others]
    assert others.sum() == len(others) - 1
    assert longer.min() > 1 - 1e-9 and longer.max() < 1.014
    assert longer.mean() < 1.006


def test_ways_around_things_are_no_shorter_than_straight(free: FreeSpace) -> None:
    start = np.array([-20.0, -20.0])
    far_m = free.from_m(start)
    straight_m = np.hypot(*(free.points_m - start).T)
    reached = np.isfinite(far_m)
    assert reached.mean() > 0.95
    assert (far_m[reached] >= straight_m[reached] - 1.0).all()
    assert (far_m[reached] <= 1.02 * straight_m[reached] + 6.0).mean() > 0.9
    assert hamlet().is_free(free.points_m, 0.49).all()


def test_a_region_is_what_ways_join(free: FreeSpace) -> None:
    reached = np.isfinite(free.from_m(free.points_m[0]))
    assert (reached == (free.region == free.region[0])).all()


@pytest.mark.parametrize("slope", [0.0, 0.2, 1 / 3, 0.45, 0.5, 0.6, 2 / 3, 0.9, 1.0])
@pytest.mark.parametrize("turns", range(4))
def test_no_way_leads_through_a_wall_one_cell_wide(slope: float, turns: int) -> None:
    column = np.arange(31)
    wall = np.round(15 + slope * (column - 15)).astype(int)
    above = np.arange(31)[:, None] - wall
    free, side = (np.rot90(grid, turns) for grid in (above != 0, above > 0))
    _, region = connected_components(_steps_m(free), directed=False)
    assert len({*region[side[free]]}) == len({*region[~side[free]]}) == 1
    assert region[side[free]][0] != region[~side[free]][0]


def test_steps_are_those_that_touch_no_blocked_cell() -> None:
    free = np.random.default_rng(0).random((9, 11)) > 0.2
    cells = np.argwhere(free)
    blocked = shapely.union_all(
        [shapely.box(y - 0.5, x - 0.5, y + 0.5, x + 0.5) for y, x in np.argwhere(~free)]
    )
    expected = np.zeros((len(cells), len(cells)))
    for a, here in enumerate(cells):
        for b, there in enumerate(cells):
            step = there - here
            if abs(step).max() > 3 or gcd(*map(int, step)) != 1:
                continue
            if not blocked.intersects(shapely.LineString([here, there])):
                expected[a, b] = 0.5 * np.hypot(*step)
    assert _steps_m(free).toarray() == pytest.approx(expected)


def test_a_way_through_a_zone_is_the_shortest_by_any_of_its_places(free: FreeSpace) -> None:
    far_m = free.from_m(np.array([-20.0, -20.0]))
    zone = np.array([int(far_m.argmin()), 100, len(far_m) // 2])
    for chosen in (zone, zone[1:]):
        through_m = free.through_m(far_m[chosen], chosen)
        by_hand = [far_m[z] + free.from_m(free.points_m[z]) for z in chosen]
        assert through_m == pytest.approx(np.min(by_hand, axis=0))
    assert np.isinf(free.through_m(np.full(3, np.inf), zone)).all()


def test_around_a_footprint(free: FreeSpace) -> None:
    footprint = hamlet().objects[0].footprint
    zone = free.around(footprint, 3.0)
    away: NDArray[np.float64] = shapely.distance(footprint, shapely.points(free.points_m))
    assert sorted(zone) == sorted(np.flatnonzero(away <= 3.0))

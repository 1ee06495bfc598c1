"""When what may be the goal surely is, and how far its size says it is."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vrchain.geometry import Pose
from vrchain.navigation.driving.estimates import Estimate
from vrchain.navigation.goal.candidates import Candidate, by_growth
from vrchain.navigation.goal.recognition import GoalSight
from vrchain.navigation.settings import MissionConfig


def is_sure(
    *sights: tuple[float, int, float, float],
    n_shown: int = 400,
    unsure: int = 0,
    unsure_m: float = 10.0,
) -> bool:
    """x_m of the robot, keypoints, range of the goal's side and looks of each sight.

    n_shown: keypoints that the goal's picture shows; unsure: sights more, that tell little.
    """
    seen = tuple(
        (
            Pose(x_m, 0.0),
            GoalSight(0.0, range_m, range_m, 0.2, keypoints, looks, 0.9, n_shown=n_shown),
        )
        for x_m, keypoints, range_m, looks in sights
    )
    seen += ((Pose(5.0, 0.0), GoalSight(0.0, unsure_m, unsure_m, 0.2, 7, 2.6, 0.3)),) * unsure
    return Candidate(Estimate(np.zeros(2), np.eye(2)), 0.9, seen).is_sure(MissionConfig())


LIKE_NOTHING_ELSE, OTHER = (0, 28, 15, 3.4), (3, 8, 12, 3.1)
ONCE = (0, 24, 7.8, 3.3)  # as a house was met in a suburb: like nothing else in one sight of four


@pytest.mark.parametrize(
    ("sights", "more", "sure"),
    [
        # one good sight is enough; its keypoints show from near too, its shape does not
        ([(0, 10, 15, 2.8), (3, 54, 12, 2.8)], {}, True),
        ([(0, 10, 15, 2.8), (11, 54, 4, 2.0)], {}, True),
        ([(0, 10, 4, 2.8), (11, 54, 12, 2.0)], {}, False),
        # fewer keypoints are in a sight that looks like nothing else, not from too near
        ([LIKE_NOTHING_ELSE, OTHER], {"n_shown": 700}, True),
        ([(0, 28, 4, 3.4), OTHER], {}, False),
        ([(0, 28, 15, 3.1), (3, 8, 12, 3.4)], {}, False),  # nor in another sight
        # but not in one unlike most; so many keypoints are no house's of its make
        ([ONCE], {}, False),
        ([ONCE, ONCE], {"unsure": 2}, True),
        ([ONCE, ONCE], {"unsure": 3}, False),
        ([ONCE, ONCE], {"unsure": 9, "unsure_m": 25.0}, True),  # from afar no goal is seen surely
        ([(0, 54, 12, 2.8)], {"unsure": 3}, True),
        # a plain goal needs fewer, but no goal is so plain
        ([(0, 12, 15, 3.4)] * 2, {}, False),
        ([(0, 12, 15, 3.4)] * 2, {"n_shown": 150}, True),
        ([(0, 11, 15, 3.4)] * 2, {"n_shown": 20}, False),
        # keypoints without its looks are not the goal
        *(([(0, n, 15, 2.0), (3, n, 12, 2.0)], {}, False) for n in (40, 80)),
        ([], {}, False),
    ],
)
def test_what_is_seen_of_the_goal_makes_it_sure_or_not(
    sights: list[tuple[float, int, float, float]], more: dict[str, Any], sure: bool
) -> None:
    assert is_sure(*sights, **more) == sure


@pytest.mark.parametrize(
    "sights",
    [
        [(11, 29, 3.1), (13, 22, 2.8), (9, 15, 3.3)],
        [(9, 20, 2.8), (11, 18, 2.8), (19, 15, 2.8), (27, 12, 2.8), (19, 10, 2.8), (22, 8, 2.8)],
        [(7, 39, 2.8), (7, 40, 3.2), (8, 23, 3.4), (8, 19, 3.5), (8, 14, 3.4), (9, 9, 3.3)] * 3,
        [(18, 7, 3.3), (15, 5, 3.3), (11, 11, 2.7), (15, 9, 3.2), (16, 6, 3.0), (12, 4, 3.5)],
        [(11, 12, 2.5), (11, 10, 2.6), (11, 7, 2.7), (13, 12, 2.2), (20, 11, 2.4), (15, 7, 2.5)],
    ],
)
def test_a_house_like_the_goal_is_not_the_goal(sights: list[tuple[int, float, float]]) -> None:
    """As five were met in suburbs: what agrees are windows, doors and timber of the same make."""
    assert not is_sure(*((3.0 * k, *sight) for k, sight in enumerate(sights)))


def _driven_to(ranges_m: Sequence[float], off_by: Sequence[float]) -> float:
    stood = np.array([[30.0 - range_m, 0.0] for range_m in ranges_m])
    return by_growth(
        stood, np.array([[r * off, 0.0] for r, off in zip(ranges_m, off_by, strict=True)])
    )


@given(
    off_by=st.floats(0.3, 2.0),
    ranges_m=st.lists(st.floats(2.0, 25.0), min_size=3, max_size=12, unique=True),
)
def test_growth_tells_no_more_than_how_far_it_is_and_no_less(
    off_by: float, ranges_m: list[float]
) -> None:
    ranges_m = sorted(ranges_m, reverse=True)
    told = _driven_to(ranges_m, [off_by] * len(ranges_m))
    low, high = sorted([1.0, 1 / off_by])
    assert low - 1e-6 <= told <= high + 1e-6
    assert _driven_to(ranges_m[:2], [off_by] * 2) == 1.0  # too few


def test_how_it_grows_is_not_told_by_sizes_that_are_rough() -> None:
    """Sizes as they are in suburbs, each off by a tenth."""
    draws = np.random.default_rng(0)
    told = [_driven_to(np.arange(20.0, 1.0, -2.5), draws.normal(1.0, 0.1, 8)) for _ in range(500)]
    assert 0.8 < min(told) <= max(told) < 1.2 and abs(np.mean(told) - 1.0) < 0.02


def test_a_sight_that_may_be_of_something_else_tells_no_size() -> None:
    """As it was met: the house behind a fence, first seen from 35 m by 8 keypoints, by chance.

    Without that sight it goes back before the robot, and is 4.7 m away.
    """
    seen = [(31.9, 39.7, 0.23), (15.2, 13.1, 0.72), (12.3, 11.4, 0.95), (9.2, 9.1, 0.95)]
    seen += [(6.1, 7.4, 0.96), (3.0, 5.6, 0.99), (0.0, 4.2, 0.84)]
    sights = tuple(
        (Pose(-off_m, 0.0), GoalSight(0.0, side_m, side_m, 0.2, 17, 3.2, chance, sized=True))
        for off_m, side_m, chance in seen
    )
    told = Candidate(Estimate(np.zeros(2), np.eye(2)), 0.99, sights).by_size()
    assert told is not None and told[0][0] == pytest.approx(4.7, abs=1.5)


def test_what_comes_to_meet_the_robot_is_nearer_than_its_size_says() -> None:
    """A house whose pictures were taken from nearer than was supposed; three sights tell little."""
    far, near = ([20.0, 17.0, 14.0], [20.0, 17.0, 14.0, 11.0, 8.0, 5.0, 2.0])
    assert 0.9 < _driven_to(far, [1.4] * 3) < 1.0
    assert _driven_to(near, [1.4] * 7) == pytest.approx(1 / 1.4, abs=0.05)

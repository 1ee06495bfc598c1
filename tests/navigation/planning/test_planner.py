"""Planning on arrays: nothing that could be tried is better than what is found."""

import math
from itertools import pairwise, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vrchain.navigation.planning.planner import Chain, Planner, PlanningError
from vrchain.seeding import generator

Leg = tuple[int, int, int, float]  # robot, robot, landmark, score


def planner(n_robots: int, legs: list[Leg]) -> Planner:
    columns = [list(column) for column in zip(*legs, strict=True)] or [[], [], [], []]
    return Planner(n_robots, *columns)


def every_chain(legs: list[Leg], start: int, goal: dict[int, float], avoid: set[int]):
    """Score, number of legs and landmarks of every chain that visits no robot twice."""

    def go(robots: tuple[int, ...], landmarks: tuple[int, ...], score: float):
        if robots[-1] in goal:
            yield score * goal[robots[-1]], len(landmarks), landmarks
        for a, b, landmark, chance in legs:
            for here, there in ((a, b), (b, a)):
                if here == robots[-1] and there not in robots and landmark not in avoid:
                    yield from go((*robots, there), (*landmarks, landmark), score * chance)

    yield from go((start,), (), 1.0)


def check_chain(chain: Chain, legs: list[Leg], start: int, goal: dict[int, float]) -> None:
    """It is one: each leg joins its robots by its landmark, and the score is the product."""
    assert chain.robots[0] == start and chain.robots[-1] in goal
    assert len(chain.robots) == len(chain.legs) + 1 == len(set(chain.robots))
    for (a, b), leg, landmark in zip(
        pairwise(chain.robots), chain.legs, chain.landmarks, strict=True
    ):
        assert {a, b} == set(legs[leg][:2]) and legs[leg][2] == landmark
    scores = [legs[leg][3] for leg in chain.legs]
    assert chain.score == pytest.approx(math.prod(scores) * goal[chain.robots[-1]])


def random_legs(seed: int, n_robots: int, n_legs: int, scores: list[float]) -> list[Leg]:
    draws = generator(seed, "legs")
    legs = []
    for _ in range(n_legs):
        a, b = draws.choice(n_robots, 2, replace=False)
        score = scores[draws.integers(len(scores))] if scores else draws.uniform(0.01, 1.0)
        legs.append((int(a), int(b), int(draws.integers(n_legs)), float(score)))
    return legs


# the same few scores make ties: products of them in any order are equal
SCORES = st.sampled_from([[], [1.0], [0.5], [0.5, 0.25, 1.0], [0.9, 0.81, 0.729]])


@given(st.integers(0, 100_000), st.integers(2, 5), st.integers(0, 8), SCORES)
def test_no_chain_is_better_and_no_equal_one_is_shorter(
    seed: int, n_robots: int, n_legs: int, scores: list[float]
) -> None:
    legs = random_legs(seed, n_robots, n_legs, scores)
    draws = generator(seed, "goal")
    goal = {
        i: float(draws.choice([0.5, 0.9, 1.0])) for i in range(n_robots) if draws.random() < 0.4
    }
    every = list(every_chain(legs, 0, goal, set()))
    chain = planner(n_robots, legs).best(0, goal)
    if not every:
        assert chain is None
        return
    check_chain(chain, legs, 0, goal)
    best = max(score for score, *_ in every)
    assert chain.score == pytest.approx(best, rel=1e-8)
    fewest = min(n for score, n, _ in every if score == pytest.approx(best, rel=1e-12))
    assert len(chain.legs) == fewest


@given(st.integers(0, 100_000), st.integers(2, 5), st.integers(0, 8))
def test_each_further_route_is_the_best_without_the_landmarks_before(
    seed: int, n_robots: int, n_legs: int
) -> None:
    legs = random_legs(seed, n_robots, n_legs, [])
    goal = {n_robots - 1: 0.9}
    found = planner(n_robots, legs).routes(0, goal, 10)
    used: set[int] = set()
    for chain in found:
        check_chain(chain, legs, 0, goal)
        assert used.isdisjoint(chain.landmarks)
        best = max(score for score, *_ in every_chain(legs, 0, goal, used))
        assert chain.score == pytest.approx(best, rel=1e-8)
        used.update(chain.landmarks)
    assert not list(every_chain(legs, 0, goal, used))


@given(st.integers(0, 100_000), st.data())
def test_what_is_excluded_is_not_used(seed: int, data: st.DataObject) -> None:
    legs = random_legs(seed, 4, 8, [])
    out = data.draw(st.sets(st.integers(0, 7)))
    chain = planner(4, legs).best(0, {3: 1.0}, without_legs=out)
    rest = [leg for i, leg in enumerate(legs) if i not in out]
    every = [score for score, *_ in every_chain(rest, 0, {3: 1.0}, set())]
    assert (chain is None) == (not every)
    if chain is not None:
        assert out.isdisjoint(chain.legs)
        assert chain.score == pytest.approx(max(every), rel=1e-8)


def test_whoever_sees_the_goal_already_needs_no_landmark() -> None:
    graph = planner(2, [(0, 1, 7, 0.9)])
    assert graph.best(0, {0: 0.8}) == Chain((0,), (), (), 0.8)
    here_and_there = graph.routes(0, {0: 0.8, 1: 1.0}, 3)
    assert [chain.robots for chain in here_and_there] == [(0, 1), (0,)]
    assert [chain.robots for chain in graph.routes(0, {0: 0.95, 1: 1.0}, 3)] == [(0,), (0, 1)]


def test_the_best_of_parallel_legs_then_the_next() -> None:
    graph = planner(2, [(0, 1, 5, 0.6), (1, 0, 4, 0.9), (0, 1, 3, 0.7)])
    assert [chain.landmarks for chain in graph.routes(0, {1: 1.0}, 9)] == [(4,), (3,), (5,)]
    assert [chain.legs for chain in graph.routes(0, {1: 1.0}, 2, {4})] == [(2,), (0,)]


def test_nowhere_to_go() -> None:
    assert planner(1, []).best(0, {}) is None
    assert planner(1, []).routes(0, {}, 3) == []
    assert planner(3, [(0, 1, 0, 0.9)]).best(0, {2: 1.0}) is None
    assert planner(2, [(0, 1, 0, 0.9)]).best(0, {1: 1.0}, without_landmarks={0}) is None


def test_hopeless_scores_add_up() -> None:
    legs = [(i, i + 1, i, 1e-300) for i in range(5)]
    chain = planner(6, legs).best(0, {5: 1.0})
    assert len(chain.legs) == 5 and chain.score == 0.0  # less than a float can say


@pytest.mark.parametrize("score", [0.0, -0.1, 1.1, math.nan, math.inf])
def test_a_score_is_a_probability(score: float) -> None:
    with pytest.raises(PlanningError, match="expected scores over 0 and up to 1, got"):
        planner(2, [(0, 1, 0, score)])
    with pytest.raises(PlanningError, match="expected scores over 0 and up to 1, got"):
        planner(2, []).best(0, {1: score})


def test_robots_that_are_none() -> None:
    with pytest.raises(PlanningError, match="expected robots 0 to 1"):
        planner(2, [(0, 2, 0, 0.5)])
    for start, end in product((-1, 0), (1, 2)):
        if (start, end) != (0, 1):
            with pytest.raises(PlanningError, match="expected a robot of 0 to 1"):
                planner(2, []).best(start, {end: 0.5})
    with pytest.raises(PlanningError, match="as many robots as landmarks"):
        Planner(2, [0], [1], [0, 1], np.array([0.5]))

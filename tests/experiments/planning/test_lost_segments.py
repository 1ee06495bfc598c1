"""What it means that a segment is lost, and what drives come to."""

from collections.abc import Sequence
from itertools import product

import numpy as np
import pandas as pd
import pytest

from vrchain.experiments.planning import lost_segments as planning
from vrchain.experiments.planning.lost_segments import (
    METHODS,
    Driver,
    blocked_drives,
    drives_until_arrival,
    published_rule,
    shares,
    standing_rule,
)
from vrchain.experiments.planning.published_drives import PUBLISHED
from vrchain.experiments.planning.wavn import Path, Task, World, breadth_first, random_world
from vrchain.seeding import generator


def drives_to_its_end(landmarks: Sequence[Sequence[int]], p: float, thrown: Sequence[int]) -> bool:
    passable = published_rule(p, iter(thrown))
    return all(passable(-1, -1, options) for options in landmarks)


def test_the_published_rule() -> None:
    single, two, three = (5,), (5, 6), (5, 6, 7)
    assert all(drives_to_its_end([single], 0.55, [coin]) == (coin >= 55) for coin in range(101))
    assert not drives_to_its_end([two], 0.55, [54]) and drives_to_its_end([three], 0.55, [54])
    # what was lost stays lost until another is, or the drive is over
    assert not drives_to_its_end([three, single], 0.5, [0, 100])
    assert drives_to_its_end([three, (6, 5, 7), single], 0.5, [0, 0, 100])
    again = published_rule(0.5, iter([0, 100]))
    assert not again(0, 1, single) and again(0, 1, single)


@pytest.mark.parametrize("p", [0.05, 0.5, 0.95])
@pytest.mark.parametrize("before", [[], [(1, 2, 3)], [(9,)], [(1, 2, 3), (9, 2, 3), (4, 5)]])
def test_no_path_that_ends_with_the_target_beats_the_bound(
    before: list[tuple[int, ...]], p: float
) -> None:
    coins = range(0, 101, 1 if len(before) < 2 else 25), range(101)
    thrown = [
        (*early, late) for early in product(coins[0], repeat=len(before)) for late in coins[1]
    ]
    arrived = np.mean([drives_to_its_end([*before, (9,)], p, each) for each in thrown])
    bound = 1 - 100 * p / 101
    assert arrived <= bound + 1e-9
    assert (arrived == pytest.approx(bound)) == all(x[0] != 9 and len(x) > 2 for x in before)
    # the bound is the target's: with spares at the end there is none
    spared = [
        drives_to_its_end([(1, 2, 3), (9, 2, 3)], p, each) for each in product((0, 100), repeat=2)
    ]
    assert all(spared)


def test_the_standing_rule() -> None:
    world = random_world(3000, 0)
    rule = standing_rule(world, 0.5, generator(0))
    pair = world.ledger[:2]
    common = world.common(*pair)
    one_by_one = [rule(*pair, (i,)) for i in common]
    assert one_by_one == [rule(*pair[::-1], (i,)) for i in common]  # stands, either way
    assert rule(*pair, common) == any(one_by_one)
    harder = standing_rule(world, 0.9, generator(0))
    assert all(rule(*pair, (i,)) for i in common if harder(*pair, (i,)))
    assert {rule(a, -1, (0,)) for a in range(40)} == {True, False}


def test_a_drive_ends_at_the_first_loss_and_the_next_starts_there() -> None:
    sees = np.eye(3, 4, dtype=bool) | np.eye(3, 4, k=1, dtype=bool)
    world, task = World(sees, (0, 1, 2)), Task(0, 3, 2)
    asked: list[tuple[int, int]] = []

    def plans(driver: Driver) -> Path | None:
        asked.append((driver.at, len(driver.lost_pairs)))
        return breadth_first(world, driver.at, task.target)

    lost = [True, False, True, True, True]
    answers = iter(lost)
    driver = Driver(world, task, generator(0), task.start)
    assert drives_until_arrival(driver, plans, lambda *_: next(answers), 5) == 2
    assert asked == [(0, 0), (1, 1)] and driver.lost_pairs == {(1, 2)} and driver.at == 2
    driver = Driver(world, task, generator(0), task.start)
    assert drives_until_arrival(driver, plans, lambda a, b, _: b >= 0, 3) is None
    assert driver.lost_views == {2}
    assert drives_until_arrival(driver, lambda _: None, lambda *_: True, 3) is None


@pytest.fixture(scope="module")
def table() -> pd.DataFrame:
    return shares(blocked_drives(4, 10, seed=3000), seed=3000)


def share(table: pd.DataFrame, rule: str, p: float, method: str, drives: int) -> float:
    line = table[
        (table.rule == rule) & (table.p == p) & (table.method == method) & (table.drives == drives)
    ]
    return float(line.arrives.iloc[0])


def test_shares_are_as_the_rules_have_it(table: pd.DataFrame) -> None:
    assert set(table.method) == set(METHODS) and len(table) == 2 * 3 * 5 * 4
    assert (table.n == 40).all() and (table.low <= table.arrives).all()
    assert (table.arrives <= table.high).all() and (table.low < table.high).all()
    for rule in planning.RULES:
        for p in planning.PROBABILITIES:
            for method in METHODS:
                by_drives = [share(table, rule, p, method, d) for d in (1, 2, 3, 10)]
                assert by_drives == sorted(by_drives)
            assert share(table, rule, p, "best chance", 1) <= 1 - p + 0.2  # the target has no spare
            for method in METHODS[:-1]:
                ours, theirs = (share(table, rule, p, m, 3) for m in ("best chance", method))
                assert ours >= theirs - 0.05
    ours = table[(table.method == "best chance") & (table.drives == planning.MAX_DRIVES)]
    assert (ours[ours.rule == "standing"].of_free > 0.99).all()


def test_two_drives_are_ahead_of_every_published_line(table: pd.DataFrame) -> None:
    for p in planning.PROBABILITIES:
        ours = share(table, "drive", p, "best chance", 2)
        assert all(ours > line.loc[p].mean() for line in PUBLISHED.values())


def test_the_same_seed_gives_the_same_table() -> None:
    once, again = (blocked_drives(1, 3, seed=3000) for _ in range(2))
    pd.testing.assert_frame_equal(once, again)

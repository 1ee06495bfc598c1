"""Random graphs, the known planners, and what it means that a segment is lost."""

from itertools import pairwise

import numpy as np
import pandas as pd
import pytest

from vrchain.errors import MissionError
from vrchain.experiments import planning
from vrchain.experiments.planning import (
    METHODS,
    Driver,
    Path,
    Task,
    World,
    blocked_drives,
    breadth_first,
    drives_until_arrival,
    ledger_chain,
    published_rule,
    random_tasks,
    random_world,
    shares,
    shorten,
    standing_rule,
    with_spares,
)
from vrchain.navigation.planner import Planner
from vrchain.seeding import generator


def seen(rows: list[str]) -> World:
    """A world from what each robot sees, a letter a landmark; the ledger in the robots' order."""
    letters = sorted(set("".join(rows)))
    return World(np.array([[x in row for x in letters] for row in rows]), tuple(range(len(rows))))


def check_path(world: World, path: Path, start: int, target: int) -> None:
    assert path.robots[0] == start and target in world.landmarks_of[path.robots[-1]]
    assert len(path.landmarks) == len(path.robots) - 1 == path.length - 1
    for (a, b), landmarks in zip(pairwise(path.robots), path.landmarks, strict=True):
        assert landmarks and set(landmarks) <= set(world.common(a, b))


def test_a_world_is_as_it_is_described_and_the_same_every_time() -> None:
    world = random_world(3000, 0)
    again, other = random_world(3000, 0), random_world(3000, 1)
    assert np.array_equal(world.sees, again.sees) and world.ledger == again.ledger
    assert not np.array_equal(world.sees[:, :300], other.sees[:, :300])
    assert 380 < world.sees.shape[1] <= 400 and 50 < world.sees.sum(axis=1).mean() < 80
    assert len(set(world.ledger)) == len(world.ledger) >= 32
    for a, b in pairwise(world.ledger):
        assert world.common(a, b)


def test_no_world_can_be_had() -> None:
    with pytest.raises(MissionError, match="take more robots or landmarks"):
        random_world(3000, 0, 40, 1)


def test_tasks_have_the_target_out_of_sight() -> None:
    world = random_world(3000, 0)
    tasks = random_tasks(world, 30, 3000, 0)
    assert tasks == random_tasks(world, 31, 3000, 0)[:30]
    for task in tasks:
        assert world.sees[task.viewer, task.target] and not world.sees[task.start, task.target]
        assert {task.start, task.viewer} <= set(world.ledger)
    with pytest.raises(MissionError, match="expected 2 tasks"):
        random_tasks(seen(["a", "a"]), 2, 0, 0)


def test_every_planner_gives_a_chain_and_ours_is_as_short_as_the_shortest() -> None:
    for index in range(3):
        world = random_world(3000, index)
        a, b, landmark = world.legs()
        planner = Planner(len(world.sees), a, b, landmark, np.full(len(a), 0.9))
        draws = generator(0, "chains")
        for task in random_tasks(world, 20, 3000, index):
            shortest = breadth_first(world, task.start, task.target)
            check_path(world, shortest, task.start, task.target)
            check_path(world, with_spares(world, shortest), task.start, task.target)
            goal = dict.fromkeys(world.seen_by[task.target], 0.9)
            ours = planner.best(task.start, goal)
            chosen = Path(ours.robots, tuple((i,) for i in ours.landmarks))
            check_path(world, chosen, task.start, task.target)
            assert len(ours.robots) == shortest.length
            for robust in (False, True):
                chain = ledger_chain(world, task.start, task.viewer, draws, robust)
                check_path(world, chain, task.start, task.target)
                short = shorten(world, chain, task.target, draws)
                check_path(world, short, task.start, task.target)
                assert shortest.length <= short.length <= chain.length


def test_the_ledger_is_walked_either_way() -> None:
    world = seen(["ab", "bc", "cd", "de"])
    assert ledger_chain(world, 0, 2, generator(0), False) == Path((0, 1, 2), ((1,), (2,)))
    assert ledger_chain(world, 3, 1, generator(0), True) == Path((3, 2, 1), ((3,), (2,)))
    assert ledger_chain(world, 2, 2, generator(0), True) == Path((2,), ())


def test_shortening_goes_straight_from_the_first_that_sees_a_later_landmark() -> None:
    world = seen(["abd", "bc", "cd", "de"])
    chain = ledger_chain(world, 0, 3, generator(0), True)
    short = shorten(world, chain, 4, generator(0, "many draws"))
    assert short == Path((0, 3), ((3,),))
    stiff = seen(["ab", "bc", "cd", "de"])
    chain = ledger_chain(stiff, 0, 3, generator(0), True)
    assert shorten(stiff, chain, 4, generator(0)) == chain


def test_breadth_first_finds_nothing_where_nothing_is() -> None:
    assert breadth_first(seen(["ab", "b", "c"]), 0, 2) is None
    assert breadth_first(seen(["ab", "b", "c"]), 0, 0) == Path((0,), ())


def test_the_published_rule() -> None:
    sure, never = published_rule(0.0, generator(0)), published_rule(1.0, generator(0))
    assert sure(0, 1, (5,)) and not never(0, 1, (5,)) and not never(0, 1, (5, 6))
    assert never(0, 1, (5, 6, 7))
    half = published_rule(0.5, generator(0))
    assert 0.4 < np.mean([half(0, 1, (5,)) for _ in range(1000)]) < 0.6  # drawn anew each time


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
    world, task = seen(["ab", "bc", "cd"]), Task(0, 3, 2)
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
    assert (table.arrives <= table.high).all()
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
    published = table[table.published.notna()]
    assert len(published) == 6 and (published.drives == 1).all()


def test_two_drives_are_ahead_of_every_published_line(table: pd.DataFrame) -> None:
    for k, p in enumerate(planning.PROBABILITIES):
        ours = share(table, "drive", p, "best chance", 2)
        assert all(ours > line[k] for line in planning.PUBLISHED_SHARES.values())


def test_the_same_seed_gives_the_same_table() -> None:
    once, again = (blocked_drives(1, 3, seed=3000) for _ in range(2))
    pd.testing.assert_frame_equal(once, again)


def test_bad_input_is_refused() -> None:
    for counts in ((0, 5), (5, 0)):
        with pytest.raises(MissionError, match="expected 1 world and task or more"):
            blocked_drives(*counts, seed=3000)

"""Random worlds, and the known planners on them."""

from itertools import pairwise

import numpy as np
import pytest

from vrchain.errors import MissionError
from vrchain.experiments.planning.wavn import (
    Path,
    Task,
    World,
    breadth_first,
    ledger_chain,
    published_breadth_first,
    published_chain,
    random_tasks,
    random_world,
    shorten,
    with_spares,
)
from vrchain.navigation.planning.planner import Planner
from vrchain.seeding import generator


def seen(rows: list[str]) -> World:
    """A world from what each robot sees, a letter a landmark; the ledger in the robots' order."""
    letters = sorted(set("".join(rows)))
    return World(np.array([[x in row for x in letters] for row in rows]), tuple(range(len(rows))))


def check_path(world: World, path: Path, start: int, target: int) -> None:
    assert path.robots[0] == start and target in world.landmarks_of[path.robots[-1]]
    *between, last = path.landmarks
    assert last == (target,)
    for (a, b), landmarks in zip(pairwise(path.robots), between, strict=True):
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


def test_small_teams_often_have_a_ledger_without_spares() -> None:
    few, many = ([random_world(3000, k, n, 10 * n).spares for k in range(20)] for n in (10, 90))
    assert 3 < sum(few) < 17 and all(many)


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
            spared = with_spares(world, shortest.robots, task.target)
            check_path(world, spared, task.start, task.target)
            goal = dict.fromkeys(world.seen_by[task.target], 0.9)
            ours = planner.best(task.start, goal)
            chosen = Path(ours.robots, tuple((i,) for i in (*ours.landmarks, task.target)))
            check_path(world, chosen, task.start, task.target)
            assert len(ours.robots) == len(shortest.robots)
            for robust in (False, True):
                chain = ledger_chain(world, task, draws, robust)
                check_path(world, chain, task.start, task.target)
                short = shorten(world, chain, draws)
                check_path(world, short, task.start, task.target)
                assert len(shortest.robots) <= len(short.robots) <= len(chain.robots)


def test_the_ledger_is_walked_either_way() -> None:
    world, draws = seen(["ab", "bc", "cd", "de"]), generator(0)
    there, back, here = Task(0, 3, 2), Task(3, 1, 1), Task(2, 3, 2)
    assert ledger_chain(world, there, draws, False) == Path((0, 1, 2), ((1,), (2,), (3,)))
    assert ledger_chain(world, back, draws, True) == Path((3, 2, 1), ((3,), (2,), (1,)))
    assert ledger_chain(world, here, draws, True) == Path((2,), ((3,),))
    # as published, backwards each segment has the landmarks of the one before
    assert ledger_chain(world, there, draws, True, slips=True).landmarks == ((1,), (2,), (3,))
    assert ledger_chain(world, back, draws, True, slips=True).landmarks == ((3,), (3,), (1,))


def test_shortening_goes_straight_from_the_first_that_sees_a_later_landmark() -> None:
    world, task = seen(["abd", "bc", "cd", "de"]), Task(0, 4, 3)
    chain = ledger_chain(world, task, generator(0), True)
    assert shorten(world, chain, generator(0, "many draws")) == Path((0, 3), ((3,), (4,)))
    stiff = seen(["ab", "bc", "cd", "de"])
    chain = ledger_chain(stiff, task, generator(0), True)
    assert shorten(stiff, chain, generator(0)) == chain


def test_a_published_chain_may_lose_its_target() -> None:
    world, task = seen(["abd", "bc", "cd", "de"]), Task(0, 4, 3)
    draws = generator(0, "many draws")
    assert published_chain(world, task, draws) == Path((0, 0), ((1,), (3,)))
    alone = World(world.sees, world.ledger, spares=False)
    assert published_chain(alone, task, draws) == Path((0, 3), ((3,), (4,)))
    begun = published_breadth_first(with_spares(world, (0, 3), 4))
    assert begun == Path((0, 0, 3), ((0,), (3,), (4,)))


def test_breadth_first_finds_nothing_where_nothing_is() -> None:
    assert breadth_first(seen(["ab", "b", "c"]), 0, 2) is None
    assert breadth_first(seen(["ab", "b", "c"]), 0, 0) == Path((0,), ((0,),))
    # of paths alike, that by the first robot, as published
    assert breadth_first(seen(["ab", "bc", "ac", "cd"]), 0, 3).robots == (0, 1, 3)

"""Driving planned chains when segments are lost, on the random worlds of ``experiments.wavn``.

Blocking follows the published code and logs of Lyons's Wide Area Visual Navigation,
https://github.com/frcvlab/WAVNRobustRSC (``wavnRobustRSC_MAIN.py``; facts, no code).

As published, rule ``drive``: at the start of each segment its landmark is lost with
probability p. If the robust path has three landmarks or more there, the next one serves, and is
never lost; else the drive has failed. The target has no spare, so that no planner can arrive in one
drive with more than 1 - p (the published 55 % at 0.5 is of 150 tasks). There, breadth-first paths
begin with a segment from the start to itself that can be lost too, hence (1 - p)^2: here they do
not. One drive is all there is there; here a second one is planned from where the first ended, for
every method alike, and draws anew. The known planners remember nothing of the drives before; ours,
*best chance*, leaves out what it found lost as long as there is another way.

Rule ``standing``, ours and harder: between each two robots each landmark is lost or not, and from
each robot the target, once for the whole task; it is found out by driving.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations, pairwise

import numpy as np
import pandas as pd

from vrchain.errors import MissionError
from vrchain.experiments.intervals import interval, resampled
from vrchain.experiments.wavn import (
    Path,
    Task,
    World,
    breadth_first,
    ledger_chain,
    random_tasks,
    random_world,
    shorten,
    with_spares,
)
from vrchain.navigation.planner import Planner
from vrchain.seeding import generator

SPARES_FROM = 3  # landmarks on a segment, under the rule ``drive``
PROBABILITIES = (0.1, 0.2, 0.5)
MAX_DRIVES = 10
TASKS_A_WORLD = 25

# Share that arrives, by p. From the published logs.
PUBLISHED_SHARES = {
    "breadth-first, robust": (0.81, 0.62, 0.21),
    "shortened chain, robust": (0.89, 0.76, 0.55),
}

# How a driver plans from where it stands; it may remember what it found lost.
Plans = Callable[["Driver"], "Path | None"]


@dataclass(eq=False)
class Driver:
    """A robot on its way: where it stands, and what it has found impassable.

    lost_pairs: two robots, the lower first; lost_views: robots from which the target is lost.
    """

    world: World
    task: Task
    draws: np.random.Generator
    at: int
    lost_pairs: set[tuple[int, int]] = field(default_factory=set)
    lost_views: set[int] = field(default_factory=set)


# Whether a segment can be driven: its two robots (-1 for the target) and its landmarks.
Passable = Callable[[int, int, Sequence[int]], bool]


def drives_until_arrival(driver: Driver, plans: Plans, passable: Passable, most: int) -> int | None:
    """Drive, and plan again from where a drive ended; the number of drives, None if over most."""
    for drive in range(1, most + 1):
        path = plans(driver)
        if path is None:
            return None
        for (a, b), landmarks in zip(pairwise(path.robots), path.landmarks, strict=True):
            if not passable(a, b, landmarks):
                driver.lost_pairs.add((min(a, b), max(a, b)))
                break
            driver.at = b
        else:
            if passable(path.robots[-1], -1, (driver.task.target,)):
                return drive
            driver.lost_views.add(path.robots[-1])
    return None


def published_rule(p: float, draws: np.random.Generator) -> Passable:
    """The rule ``drive``."""
    return lambda a, b, landmarks: bool(draws.random() >= p) or len(landmarks) >= SPARES_FROM


def standing_rule(world: World, p: float, draws: np.random.Generator) -> Passable:
    """The rule ``standing``; the same draws lose more at a greater p."""
    n_robots, n_landmarks = world.sees.shape
    between = draws.random((n_robots, n_robots, n_landmarks))
    from_there = draws.random((n_robots,))

    def passable(a: int, b: int, landmarks: Sequence[int]) -> bool:
        if b < 0:
            return bool(from_there[a] >= p)
        return bool((between[min(a, b), max(a, b), list(landmarks)] >= p).any())

    return passable


def _breadth_first_plan(driver: Driver) -> Path | None:
    return breadth_first(driver.world, driver.at, driver.task.target)


def _robust_breadth_first_plan(driver: Driver) -> Path | None:
    path = _breadth_first_plan(driver)
    return with_spares(driver.world, path) if path is not None else None


def _shortened_plan(robust: bool) -> Plans:
    def plans(driver: Driver) -> Path | None:
        if driver.at not in driver.world.ledger:
            return None
        chain = ledger_chain(driver.world, driver.at, driver.task.viewer, driver.draws, robust)
        return shorten(driver.world, chain, driver.task.target, driver.draws)

    return plans


def _chances_plan(planner: Planner, index: Mapping[tuple[int, int], int]) -> Plans:
    """The best chain; what was lost is not tried again while there is another way.

    planner: one leg a pair of robots, that of ``index``: the chance that one of all their common
    landmarks serves.
    """

    def plans(driver: Driver) -> Path | None:
        viewers = driver.world.seen_by[driver.task.target]
        goal = {robot: 1.0 for robot in viewers if robot not in driver.lost_views}
        lost = [index[pair] for pair in driver.lost_pairs]
        chain = planner.best(driver.at, goal, without_legs=lost)
        if chain is None and (driver.lost_pairs or driver.lost_views):
            driver.lost_pairs.clear()
            driver.lost_views.clear()
            return plans(driver)
        if chain is None:
            return None
        common = (tuple(driver.world.common(a, b)) for a, b in pairwise(chain.robots))
        return Path(chain.robots, tuple(common))

    return plans


METHODS = (
    "breadth-first",
    "shortened chain",
    "breadth-first, robust",
    "shortened chain, robust",
    "best chance",
)
RULES = ("drive", "standing")


def blocked_drives(n_worlds: int, n_tasks: int, *, seed: int) -> pd.DataFrame:
    """Each method on the same tasks with the same segments lost. MissionError without worlds.

    One row a world, task, rule, p and method: ``drives`` until it arrived, NaN if it did not within
    ``MAX_DRIVES``; ``free``: under the rule ``standing``, whether any free chain exists.
    """
    if n_worlds < 1 or n_tasks < 1:
        raise MissionError(f"expected 1 world and task or more, got {n_worlds} and {n_tasks}")
    rows = []
    for index in range(n_worlds):
        world = random_world(seed, index)
        tasks = random_tasks(world, n_tasks, seed, index)
        for p in PROBABILITIES:
            for rule in RULES:
                rows += list(_world_drives(world, tasks, rule, p, seed, index))
    return pd.DataFrame(rows)


def _world_drives(
    world: World, tasks: Sequence[Task], rule: str, p: float, seed: int, index: int
) -> Iterator[dict[str, object]]:
    every = combinations(range(len(world.sees)), 2)
    pairs = [
        (a, b) for a, b in every if not world.landmarks_of[a].isdisjoint(world.landmarks_of[b])
    ]
    n_common = np.array([len(world.common(a, b)) for a, b in pairs])
    lost = np.where(n_common >= SPARES_FROM, 0.0, p) if rule == "drive" else p**n_common
    a, b = np.array(pairs).T
    planner = Planner(len(world.sees), a, b, np.arange(len(pairs)), 1 - lost)
    ours = _chances_plan(planner, {pair: k for k, pair in enumerate(pairs)})
    plans = (
        _breadth_first_plan,
        _shortened_plan(False),
        _robust_breadth_first_plan,
        _shortened_plan(True),
        ours,
    )
    for number, task in enumerate(tasks):
        name = ("planning", rule, index, number)
        standing = standing_rule(world, p, generator(seed, *name)) if rule == "standing" else None
        free = _free_chain(world, task, pairs, standing) if standing else float("nan")
        for method, plan in zip(METHODS, plans, strict=True):
            # what is lost is the same for every method; a method's own draws are its own
            passable = standing or published_rule(p, generator(seed, *name))
            driver = Driver(world, task, generator(seed, *name, method), task.start)
            drives = drives_until_arrival(driver, plan, passable, MAX_DRIVES)
            yield {
                "world": index,
                "task": number,
                "rule": rule,
                "p": p,
                "method": method,
                "drives": drives if drives is not None else float("nan"),
                "free": free,
            }


def _free_chain(
    world: World, task: Task, pairs: Sequence[tuple[int, int]], passable: Passable
) -> float:
    """1 if any chain without a lost segment leads to the target, else 0."""
    free = [pair for pair in pairs if passable(*pair, world.common(*pair))]
    a, b = np.array(free, dtype=np.int64).reshape(-1, 2).T
    planner = Planner(len(world.sees), a, b, np.arange(len(free)), np.ones(len(free)))
    goal = {r: 1.0 for r in world.seen_by[task.target] if passable(r, -1, (task.target,))}
    return float(planner.best(task.start, goal) is not None)


def shares(drives: pd.DataFrame, *, seed: int) -> pd.DataFrame:
    """Share that arrives within 1, 2, 3 and 10 drives, with its 95 % interval.

    The interval is a bootstrap over worlds. published: the same line of the published logs, one
    drive. of_free: share of those tasks that have a free chain (rule ``standing``).
    """
    rows = []
    for (rule, p, method), group in drives.groupby(["rule", "p", "method"], sort=False):
        n_worlds = group.world.nunique()
        again = resampled(n_worlds, seed, "planning")
        for most in (1, 2, 3, MAX_DRIVES):
            arrived = group.drives <= most
            by_world = arrived.groupby(group.world).mean().to_numpy()
            low, high = interval(by_world[again].mean(axis=1), n_worlds)
            line = PUBLISHED_SHARES.get(str(method)) if (rule, most) == ("drive", 1) else None
            rows.append(
                {
                    "rule": rule,
                    "p": p,
                    "method": method,
                    "drives": most,
                    "arrives": float(arrived.mean()),
                    "low": low,
                    "high": high,
                    "of_free": float(arrived[group.free == 1].mean()),
                    "published": line[PROBABILITIES.index(p)] if line else float("nan"),
                    "n": len(group),
                }
            )
    return pd.DataFrame(rows)

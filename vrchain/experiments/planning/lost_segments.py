"""Driving planned chains when segments are lost, on the random worlds of ``planning.wavn``.

Rule ``drive``, as published (https://github.com/frcvlab/WAVNRobustRSC, ``wavnRobustRSC_MAIN.py``
and ``moveRobot``; facts, no code): at the start of each segment a number from 0 to 100 is drawn,
and the first landmark of the segment is lost if it is below 100 p. What was lost last stays lost,
until another is. If the segment has three landmarks or more, the next one serves, and is never
lost; else the drive has failed. A path that ends with the target ends with one landmark: no planner
can bring such a path to its end in more than 1 - 100 p / 101 of drives. The published chains do,
because many of them end with something else (``planning.wavn``, slips); it was not looked where
a drive ended.

One drive is all there is there; here a second one is planned from where the first ended, for every
method alike, and draws anew. The known planners remember nothing of the drives before; ours, *best
chance*, leaves out what it found lost as long as there is another way.

Rule ``standing``, ours and harder: between each two robots each landmark is lost or not, and from
each robot the target, once for the whole task; it is found out by driving.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import repeat
from typing import Any

import numpy as np
import pandas as pd

from vrchain.errors import MissionError
from vrchain.experiments.intervals import Bootstrap
from vrchain.experiments.planning.wavn import (
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
from vrchain.navigation.planning.planner import Planner
from vrchain.seeding import generator

SPARES_FROM = 3  # landmarks on a segment, under the rule ``drive``
PROBABILITIES = (0.1, 0.2, 0.5)
MAX_DRIVES = 10
TASKS_A_WORLD = 30  # as published

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
        segments = zip(path.robots, (*path.robots[1:], -1), path.landmarks, strict=True)
        for a, b, landmarks in segments:
            if not passable(a, b, landmarks):
                if b < 0:
                    driver.lost_views.add(a)
                else:
                    driver.lost_pairs.add((min(a, b), max(a, b)))
                break
            driver.at = b if b >= 0 else a
        else:
            return drive
    return None


def published_rule(p: float, coins: Iterator[int]) -> Passable:
    """The rule ``drive``; coins: numbers from 0 to 100, one a segment."""
    below, lost = round(100 * p), -1

    def passable(a: int, b: int, landmarks: Sequence[int]) -> bool:
        nonlocal lost
        if next(coins) < below:
            lost = landmarks[0]
        if lost != landmarks[0] or len(landmarks) >= SPARES_FROM:
            return True
        lost = -1  # the drive is over
        return False

    return passable


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


def robust_breadth_first_plan(driver: Driver) -> Path | None:
    """The shortest path, with spares."""
    path = _breadth_first_plan(driver)
    return with_spares(driver.world, path.robots, driver.task.target) if path is not None else None


def shortened_plan(robust: bool) -> Plans:
    """The chain of the ledger, shortened; robust: with all spares, those of cuts too."""

    def plans(driver: Driver) -> Path | None:
        if driver.at not in driver.world.ledger:
            return None
        task = replace(driver.task, start=driver.at)
        chain = ledger_chain(driver.world, task, driver.draws, robust)
        path = shorten(driver.world, chain, driver.draws)
        return with_spares(driver.world, path.robots, task.target) if robust else path

    return plans


def best_chance_plan(world: World, rule: str, p: float) -> Plans:
    """The best chain, by the chance that one of all common landmarks of each pair serves.

    What was lost is not tried again while there is another way.
    """
    a, b, n_common = world.pairs()
    lost = np.where(n_common >= SPARES_FROM, 0.0, p) if rule == "drive" else p**n_common
    planner = Planner(len(world.sees), a, b, np.arange(len(a)), 1 - lost)
    index = {pair: k for k, pair in enumerate(zip(a.tolist(), b.tolist(), strict=True))}

    def plans(driver: Driver) -> Path | None:
        viewers = world.seen_by[driver.task.target]
        goal = {robot: 1.0 for robot in viewers if robot not in driver.lost_views}
        without = [index[pair] for pair in driver.lost_pairs]
        chain = planner.best(driver.at, goal, without_legs=without)
        if chain is None and (driver.lost_pairs or driver.lost_views):
            driver.lost_pairs.clear()
            driver.lost_views.clear()
            return plans(driver)
        return with_spares(world, chain.robots, driver.task.target) if chain is not None else None

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
    plans = (
        _breadth_first_plan,
        shortened_plan(False),
        robust_breadth_first_plan,
        shortened_plan(True),
        best_chance_plan(world, rule, p),
    )
    for number, task in enumerate(tasks):
        name = ("planning", rule, index, number)
        standing = standing_rule(world, p, generator(seed, *name)) if rule == "standing" else None
        free = _free_chain(world, task, standing) if standing else float("nan")
        for method, plan in zip(METHODS, plans, strict=True):
            # what is lost is the same for every method; a method's own draws are its own
            passable = standing or published_rule(
                p, map(generator(seed, *name).integers, repeat(101))
            )
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


def _free_chain(world: World, task: Task, passable: Passable) -> float:
    """1 if any chain without a lost segment leads to the target, else 0."""
    pairs = np.transpose(world.pairs()[:2]).tolist()
    free = [(a, b) for a, b in pairs if passable(a, b, world.common(a, b))]
    a, b = np.array(free, dtype=np.int64).reshape(-1, 2).T
    planner = Planner(len(world.sees), a, b, np.arange(len(free)), np.ones(len(free)))
    goal = {r: 1.0 for r in world.seen_by[task.target] if passable(r, -1, (task.target,))}
    return float(planner.best(task.start, goal) is not None)


def shares(drives: pd.DataFrame, *, seed: int) -> pd.DataFrame:
    """Share that arrives within 1, 2, 3 and 10 drives, with its 95 % interval.

    The interval is a bootstrap over worlds. of_free: share of those tasks that have a free chain
    (rule ``standing``).
    """
    rows: list[dict[str, object]] = []
    for key, group in drives.groupby(["rule", "p", "method"], sort=False):
        told = Bootstrap(group.world, "planning", seed)
        for most in (1, 2, 3, MAX_DRIVES):
            arrived = group.drives <= most
            found = told.share("arrives", arrived, group.world)
            ends: Any = found["arrives_ci"] or (np.nan, np.nan)
            low, high = ends
            of_free = float(arrived[group.free == 1].mean())
            rows.append(
                dict(zip(("rule", "p", "method"), key, strict=True))
                | {"drives": most, "arrives": found["arrives"], "low": low, "high": high}
                | {"of_free": of_free, "n": len(group)}
            )
    return pd.DataFrame(rows)


def as_text(shares: pd.DataFrame) -> str:
    """The table of ``shares`` to read: a column each number of drives."""
    wide = shares.pivot_table("arrives", ["rule", "p", "method"], "drives", sort=False)
    return f"share that arrives, by drives\n{wide.round(3).to_string()}"

"""Planning on random graphs, beside breadth-first search and randomly shortened chains.

Worlds, baselines and the blocking of segments follow the published code and logs of Lyons's Wide
Area Visual Navigation, https://github.com/frcvlab/WAVNRobustRSC (``wavnRobustRSC.py``,
``wavnbfs.py``, ``wavnrbfs.py``, ``wavnRobustRSC_MAIN.py``; facts, no code):

*World.* Robots and landmarks at whole metres, uniform from 5 to 194 m of a square of 200 m;
landmarks within 2 m of a robot are left out; a robot sees what is within 50 m; nothing hides
anything. The *ledger* is a walk from a random robot, always on to the first robot in the list, not
yet visited, that has a landmark in common with the one before; a world is used if a walk holds 80 %
of the robots. *Task.* A robot of the ledger, a landmark that it does not see, and a robot of the
ledger that does.

*Breadth-first*: over (robot, landmark) states to the first robot that sees the target. *Shortened
chain*: the ledger's robots from the start to one that sees the target, in the ledger's order; then
25 times a random segment is drawn, and if one of 10 robots before it sees its landmark, the first
that does goes there straight. The *robust* forms keep, for each segment, every landmark that its
two robots have in common. A path's length is in landmarks, the target among them; the published
3.35 of breadth-first counts the start as well, which that search gave first. Two slips are not
followed: walked against its order, the chain there keeps the landmark of the segment before; a
robust chain that is shortened loses the robot after the cut.

*Blocking*, as published, rule ``drive``: at the start of each segment its landmark is lost with
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

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations, pairwise

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from vrchain.errors import MissionError
from vrchain.experiments.intervals import interval, resampled
from vrchain.navigation.planner import Planner
from vrchain.seeding import generator

SIDE_M, RANGE_M = 200.0, 50.0
EDGE_M, TOO_NEAR_M = 5.0, 2.0
LEAST_IN_LEDGER = 0.8
SHORTENINGS, REACH = 25, 10
SPARES_FROM = 3  # landmarks on a segment, under the rule ``drive``
PROBABILITIES = (0.1, 0.2, 0.5)
MAX_DRIVES = 10
TASKS_A_WORLD = 25

# Share that arrives, by p. From the published logs.
PUBLISHED_SHARES = {
    "breadth-first, robust": (0.81, 0.62, 0.21),
    "shortened chain, robust": (0.89, 0.76, 0.55),
}
_WORLD_DRAWS = 200


@dataclass(frozen=True, eq=False)
class World:
    """sees: (n_robots, n_landmarks) bool; ledger: robots in the order of its walk."""

    sees: NDArray[np.bool_]
    ledger: tuple[int, ...]

    @cached_property
    def landmarks_of(self) -> list[frozenset[int]]:
        """The landmarks that each robot sees."""
        return [frozenset(np.flatnonzero(row).tolist()) for row in self.sees]

    @cached_property
    def seen_by(self) -> list[list[int]]:
        """The robots that see each landmark, ascending."""
        return [np.flatnonzero(column).tolist() for column in self.sees.T]

    def common(self, a: int, b: int) -> list[int]:
        """Landmarks that two robots both see, ascending."""
        return sorted(self.landmarks_of[a] & self.landmarks_of[b])

    def legs(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Every way from robot to robot by a landmark: two robots and the landmark, (m,) each."""
        ways = [(a, b, i) for i, who in enumerate(self.seen_by) for a, b in combinations(who, 2)]
        a, b, landmark = np.array(ways, dtype=np.int64).reshape(-1, 3).T
        return a, b, landmark


@dataclass(frozen=True)
class Task:
    """From robot ``start`` to landmark ``target``, which ``viewer`` sees and it does not."""

    start: int
    target: int
    viewer: int


@dataclass(frozen=True)
class Path:
    """Robots, (k + 1,), and the landmarks of each segment between them, (k,), the first to use
    first; from the last robot on to the target."""

    robots: tuple[int, ...]
    landmarks: tuple[tuple[int, ...], ...]

    @property
    def length(self) -> int:
        """In landmarks, the target among them."""
        return len(self.robots)


def random_world(
    seed: int,
    index: int,
    n_robots: int = 40,
    n_landmarks: int = 400,
    side_m: float = SIDE_M,
) -> World:
    """World ``index`` of a seed. MissionError if no world of the size has a ledger."""
    draws = generator(seed, "planning", "world", index, n_robots, n_landmarks)
    for _ in range(_WORLD_DRAWS):
        robots, landmarks = (
            draws.integers(int(EDGE_M), int(side_m - EDGE_M), (n, 2))
            for n in (n_robots, n_landmarks)
        )
        apart_m = cdist(robots, landmarks)
        sees = (apart_m <= RANGE_M)[:, (apart_m >= TOO_NEAR_M).all(axis=0)]
        ledger = _ledger_walk(sees, int(draws.integers(n_robots)))
        if len(ledger) >= LEAST_IN_LEDGER * n_robots:
            return World(sees, ledger)
    raise MissionError(
        f"expected a world whose ledger holds {LEAST_IN_LEDGER:.0%} of {n_robots} robots, got none "
        f"in {_WORLD_DRAWS} draws: take more robots or landmarks"
    )


def _ledger_walk(sees: NDArray[np.bool_], start: int) -> tuple[int, ...]:
    common = sees.astype(np.float32) @ sees.T.astype(np.float32) > 0
    left = np.ones(len(sees), dtype=bool)
    walk = [start]
    left[start] = False
    while (onward := np.flatnonzero(common[walk[-1]] & left)).size:
        walk.append(int(onward[0]))
        left[walk[-1]] = False
    return tuple(walk)


def random_tasks(world: World, n: int, seed: int, index: int) -> list[Task]:
    """Tasks in world ``index``, drawn until one can be set. MissionError if none can."""
    draws = generator(seed, "planning", "tasks", index)
    in_ledger = np.isin(np.arange(len(world.sees)), world.ledger)
    tasks: list[Task] = []
    for _ in range(1000 * n):
        start = int(draws.choice(world.ledger))
        target = int(draws.integers(world.sees.shape[1]))
        viewers = np.flatnonzero(world.sees[:, target] & in_ledger)
        if len(viewers) and not world.sees[start, target]:
            tasks.append(Task(start, target, int(draws.choice(viewers))))
        if len(tasks) == n:
            return tasks
    raise MissionError(f"expected {n} tasks with a target out of sight, got {len(tasks)}")


def breadth_first(world: World, start: int, target: int) -> Path | None:
    """Over (robot, landmark) states; the shortest path, its landmarks the first ones found."""
    came: dict[int, tuple[int, int]] = {start: (-1, -1)}
    taken: set[int] = set()
    queue = deque([start])
    while queue:
        robot = queue.popleft()
        if target in world.landmarks_of[robot]:
            return _walked(came, robot)
        for landmark in world.landmarks_of[robot]:
            if landmark in taken:
                continue
            taken.add(landmark)
            for other in world.seen_by[landmark]:
                if other not in came:
                    came[other] = (robot, landmark)
                    queue.append(other)
    return None


def _walked(came: Mapping[int, tuple[int, int]], last: int) -> Path:
    robots, landmarks = [last], []
    while (step := came[robots[-1]])[0] >= 0:
        robots.append(step[0])
        landmarks.append((step[1],))
    return Path(tuple(reversed(robots)), tuple(reversed(landmarks)))


def ledger_chain(
    world: World, start: int, viewer: int, draws: np.random.Generator, robust: bool
) -> Path:
    """The ledger's robots from ``start`` to ``viewer``, with what neighbours have in common."""
    here, there = world.ledger.index(start), world.ledger.index(viewer)
    step = 1 if there >= here else -1
    robots = tuple(world.ledger[i] for i in range(here, there + step, step))
    landmarks = []
    for a, b in pairwise(robots):
        common = world.common(a, b)
        landmarks.append(tuple(common) if robust else (common[draws.integers(len(common))],))
    return Path(robots, tuple(landmarks))


def shorten(world: World, path: Path, target: int, draws: np.random.Generator) -> Path:
    """Cut out robots where an earlier one sees the landmark of a segment drawn at random."""
    robots, segments = list(path.robots), [*path.landmarks, (target,)]
    for _ in range(SHORTENINGS):
        if len(segments) == 1:
            break
        drawn = int(draws.integers(len(segments)))
        options = segments[drawn]
        landmark = options[draws.integers(len(options))] if len(options) > 1 else options[0]
        for earlier in range(max(0, drawn - 1 - REACH), drawn - 1):
            seen = world.landmarks_of[robots[earlier]]
            if landmark in seen:
                segments[earlier : drawn + 1] = [tuple(o for o in options if o in seen)]
                del robots[earlier + 1 : drawn + 1]
                break
    return Path(tuple(robots), tuple(segments[:-1]))


def with_spares(world: World, path: Path) -> Path:
    """The robust form: every landmark that two neighbours have in common, the path's own first."""
    landmarks = []
    for (a, b), (first, *_) in zip(pairwise(path.robots), path.landmarks, strict=True):
        landmarks.append((first, *(i for i in world.common(a, b) if i != first)))
    return Path(path.robots, tuple(landmarks))


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

"""Random worlds of Lyons's Wide Area Visual Navigation, and the planners that are known on them.

They follow the published code, https://github.com/frcvlab/WAVNRobustRSC (``wavnRobustRSC.py``,
``wavnbfs.py``, ``wavnrbfs.py``; facts, no code):

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
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from vrchain.errors import MissionError
from vrchain.seeding import generator

SIDE_M, RANGE_M = 200.0, 50.0
EDGE_M, TOO_NEAR_M = 5.0, 2.0
LEAST_IN_LEDGER = 0.8
SHORTENINGS, REACH = 25, 10
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

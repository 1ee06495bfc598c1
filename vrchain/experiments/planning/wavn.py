"""Random worlds of Lyons's Wide Area Visual Navigation, and the planners that are known on them.

They follow the code of the days of the published logs: ``wavnRobustRSC.py``, ``wavnbfs.py``
and ``wavnrbfs.py`` of https://github.com/frcvlab/WAVNRobustRSC, commit c30366c (facts, no code).

*World.* Robots, and ten times as many landmarks, at whole metres, uniform from 5 to 194 m of a
square of 200 m; landmarks within 2 m of a robot are left out; a robot sees what is within 50 m;
nothing hides anything. So the larger the team, the more landmarks two robots have in common. The
*ledger* is a walk from a random robot, always on to the first robot in the list, not yet visited,
that has a landmark in common with the one before. If a walk holds less than 80 % of the robots, up
to five others are tried; those keep one landmark of each pair, the first keeps all (``spares``).
*Task.* A robot of the ledger, a landmark that it does not see, and a robot of the ledger that does;
the first robot of a walk with spares is neither.

*Breadth-first*: over (robot, landmark) states to the first robot that sees the target. *Shortened
chain*: the ledger's robots from the start to one that sees the target, in the ledger's order; then
25 times a random segment is drawn, and if one of 10 robots before it sees its landmark, the first
that does goes there straight. The *robust* forms keep, for each segment, every landmark that its
two robots have in common.

What was published differs from that by three slips; the planners here make them only if asked to
(``published_chain``, ``published_breadth_first``). A chain is shortened with spares one place too
late: the robot after the cut is lost, and the target itself if the cut is the last. A chain that is
walked against the ledger's order keeps the landmarks of the pair of robots before. A breadth-first
path begins with a segment from the start to itself, with one landmark (which counts in its
published length of 3.35).
"""

from collections import deque
from collections.abc import Mapping, Sequence
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
_WORLD_DRAWS, _WALKS, _TARGETS = 200, 6, 50


@dataclass(frozen=True, eq=False)
class World:
    """sees: (n_robots, n_landmarks) bool; ledger: robots in the order of its walk; spares: whether
    the published ledger names all landmarks of a pair."""

    sees: NDArray[np.bool_]
    ledger: tuple[int, ...]
    spares: bool = True

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

    def pairs(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Robots that have landmarks in common, the lower first, and how many: (m,) each."""
        n_common = np.triu(_n_common(self.sees), k=1)
        a, b = np.nonzero(n_common)
        return a, b, n_common[a, b]

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
    """Robots, (k,), and from each the landmarks of the segment to the next, (k,), the first to use
    first; from the last robot it is the target."""

    robots: tuple[int, ...]
    landmarks: tuple[tuple[int, ...], ...]


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
        for walk in range(_WALKS):
            ledger = _ledger_walk(sees, int(draws.integers(n_robots)))
            if len(ledger) >= LEAST_IN_LEDGER * n_robots:
                return World(sees, ledger, spares=walk == 0)
    raise MissionError(
        f"expected a world whose ledger holds {LEAST_IN_LEDGER:.0%} of {n_robots} robots, got none "
        f"in {_WORLD_DRAWS} draws: take more robots or landmarks"
    )


def _n_common(sees: NDArray[np.bool_]) -> NDArray[np.int64]:
    return (sees.astype(np.float32) @ sees.T.astype(np.float32)).astype(np.int64)


def _ledger_walk(sees: NDArray[np.bool_], start: int) -> tuple[int, ...]:
    common = _n_common(sees) > 0
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
    named = world.ledger[int(world.spares) :]
    tasks: list[Task] = []
    for _ in range(20 * n):
        start = int(draws.choice(named))
        for _ in range(_TARGETS):
            target = int(draws.integers(world.sees.shape[1]))
            viewer = int(draws.choice(world.seen_by[target] or [-1]))
            if viewer in named and not world.sees[start, target]:
                tasks.append(Task(start, target, viewer))
                break
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
            return _walked(came, robot, target)
        found = []
        for landmark in world.landmarks_of[robot]:
            if landmark in taken:
                continue
            taken.add(landmark)
            for other in world.seen_by[landmark]:
                if other not in came:
                    came[other] = (robot, landmark)
                    found.append(other)
        queue.extend(sorted(found))
    return None


def _walked(came: Mapping[int, tuple[int, int]], last: int, target: int) -> Path:
    robots, landmarks = [last], [(target,)]
    while (step := came[robots[-1]])[0] >= 0:
        robots.append(step[0])
        landmarks.append((step[1],))
    return Path(tuple(reversed(robots)), tuple(reversed(landmarks)))


def with_spares(world: World, robots: Sequence[int], target: int) -> Path:
    """The robust form: every landmark that two neighbours have in common."""
    common = (tuple(world.common(a, b)) for a, b in pairwise(robots))
    return Path(tuple(robots), (*common, (target,)))


def published_breadth_first(robust: Path) -> Path:
    """The robust form as published: first a segment without spare from the start to itself."""
    start = robust.robots[0]
    return Path((start, *robust.robots), ((start,), *robust.landmarks))


def ledger_chain(
    world: World, task: Task, draws: np.random.Generator, robust: bool, slips: bool = False
) -> Path:
    """The ledger's robots from the start to the viewer, with what neighbours have in common."""
    ledger = world.ledger
    here, there = ledger.index(task.start), ledger.index(task.viewer)
    step = 1 if there >= here else -1
    landmarks = []
    for place in range(here, there, step):
        later = min(place + 1, len(ledger) - 1) if slips else max(place, place + step)
        common = world.common(ledger[later - 1], ledger[later])
        landmarks.append(tuple(common) if robust else (common[draws.integers(len(common))],))
    robots = tuple(ledger[place] for place in range(here, there + step, step))
    return Path(robots, (*landmarks, (task.target,)))


def shorten(world: World, path: Path, draws: np.random.Generator, slips: bool = False) -> Path:
    """Cut out robots where an earlier one sees the landmark of a segment drawn at random.

    slips: the target is never drawn, and what has spares is cut one place too late.
    """
    robots, segments, late = list(path.robots), list(path.landmarks), int(slips and world.spares)
    for _ in range(SHORTENINGS):
        if len(segments) == 1:
            break
        drawn = int(draws.integers(len(segments) - int(slips)))
        options = segments[drawn]
        landmark = options[draws.integers(len(options))] if len(options) > 1 else options[0]
        for earlier in range(max(0, drawn - 1 - REACH), drawn - 1):
            seen = world.landmarks_of[robots[earlier]]
            if landmark in seen:
                cut = slice(earlier + late, drawn + 1 + late)
                robots[cut] = [robots[earlier]]
                segments[cut] = [tuple(o for o in options if o in seen)]
                break
    return Path(tuple(robots), tuple(segments))


def published_chain(world: World, task: Task, draws: np.random.Generator) -> Path:
    """The robust shortened chain as published; its last landmark need not be the target."""
    chain = ledger_chain(world, task, draws, robust=world.spares, slips=True)
    return shorten(world, chain, draws, slips=True)

"""A team's task, drawn up by ground truth: where each robot stands, and what one looks for.

The robots that carry it out never see it.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice, pairwise

import numpy as np
from numpy.typing import NDArray

from vrchain.errors import MissionError
from vrchain.geometry import Pose
from vrchain.landmarks.quality import co_visible
from vrchain.panorama import CameraRig
from vrchain.seeding import generator
from vrchain.simulation.collision_free import FreeSpace
from vrchain.simulation.goals import GOAL_PICTURES, SHARES, goal_ids, goal_poses
from vrchain.world.model import Scene
from vrchain.world.truth import GroundTruth

Points = NDArray[np.float64]
SUCCESS_RANGE_M = 3.0  # from the goal's side
SPACING_M = (5.0, 8.0)  # between neighbours of a chain
_CLEARANCE_M, _LEAST_CLEARANCE_M = 1.0, 0.5
_BATCH = 20_000  # chains of places tried at once
_BATCHES = 8
_CHOICES = 4  # tasks among which the one that needs the chain most is taken
_GOAL_FROM_LAST_M = (5.0, 15.0)  # from the goal's side
_LEAST_SEEN = 0.2  # share of the goal's surface that the last robot sees
_SURFACE_POINTS = 60
_RUN_UP_M = 6.0  # the way a robot drives to its place


@dataclass(frozen=True)
class Task:
    """Who stands where (places), from where each drives there (starts), and the goal's name.

    goal_poses: from where the goal's pictures are taken.
    """

    places: Mapping[str, Pose]
    starts: Mapping[str, Pose]
    goal: str
    goal_poses: tuple[Pose, ...]


def draw_task(
    scene: Scene,
    truth: GroundTruth,
    rig: CameraRig,
    seed: int,
    n_robots: int = 3,
    robot: str = "R1",
    goal: str | None = None,
) -> Task:
    """A chain of robots, neighbours 5-8 m apart, whose last one sees a fifth of the goal or more.

    All of them, and the goal, are in one room: the largest free region that holds a goal. ``robot``
    stands at the other end, with not a pixel of the goal in view; those between see next to nothing
    of it: none of 60 points all over it. Neighbours see a landmark in common. Of some such places
    the one is taken where the two ends have fewest in common, so that the chain is needed. Where
    there is none, as in rooms, all is half or a quarter as far apart. MissionError if
    none is found, or if there is no such robot or goal.
    """
    names, goals = robot_names(n_robots, robot), goal_ids(scene, goal)
    free = FreeSpace(scene, truth)
    found = list[tuple[int, Task]]()
    for share in SHARES:
        tasks = _tasks(scene, truth, free, rig, seed, names, goals, share)
        if found := list(islice(tasks, _CHOICES)):
            break
    if not found:
        sought = f"the goal {goal!r}" if goal else "a goal"
        raise MissionError(
            f"found no place where the last of {n_robots} robots, {SHARES[-1] * SPACING_M[0]:g}-"
            f"{SPACING_M[1]:g} m apart, sees {sought} and the others do not: "
            "try another goal or seed, or fewer robots"
        )
    return min(found, key=lambda pair: pair[0])[1]


def scene_task(
    scene: Scene,
    truth: GroundTruth,
    seed: int,
    n_robots: int = 3,
    robot: str = "R1",
    goal: str | None = None,
) -> Task:
    """The task that a scene with robots of its own sets; ``robot`` is named first, as it drives.

    Each robot's start, from where it drives to its place, is drawn. MissionError if there is no
    such robot or goal, or if something is in the way.
    """
    own = dict(scene.robots)
    if n_robots != len(own):
        raise MissionError(
            f"the scene {scene.name!r} has {len(own)} robots of its own, not {n_robots}: "
            "leave their number out"
        )
    if robot not in own:
        raise MissionError(f"there is no robot {robot!r}; expected one of {', '.join(own)}")
    places, name = {robot: own[robot], **own}, goal or scene.goal
    if name is None:
        raise MissionError(f"the scene {scene.name!r} sets no goal: name a --goal")
    (target,) = goal_ids(scene, name)
    starts = _starts(scene, list(places.values()), 1.0, generator(seed, "task"))
    pictured = goal_poses(scene, truth, target, seed)
    if len(starts) < len(places) or len(pictured) < GOAL_PICTURES:
        raise MissionError(
            f"found no free way to the robots' places, or too few sights of {name!r}: "
            "try another seed"
        )
    named = dict(zip(places, starts, strict=True))
    return Task(places, named, scene.objects[target].name, tuple(pictured))


def _tasks(
    scene: Scene,
    truth: GroundTruth,
    free: FreeSpace,
    rig: CameraRig,
    seed: int,
    names: list[str],
    goals: list[int],
    share: float,
) -> Iterator[tuple[int, Task]]:
    """Tasks as ``draw_task`` describes them, with the landmarks that both ends see.

    share: of the distances in suburbs.
    """
    draws = generator(seed, "task")
    pictured: dict[int, list[Pose]] = {}
    room, goals = free.room(scene, goals, SUCCESS_RANGE_M)
    if not goals:
        return
    in_room = partial(free.is_in, room)
    for _ in range(_BATCHES):
        for target, chain in _hidden_goals(scene, truth, goals, len(names), share, draws):
            if not in_room(chain).all():
                continue
            if target not in pictured:
                pictured[target] = goal_poses(scene, truth, target, seed, in_room)
            if len(pictured[target]) < GOAL_PICTURES:
                continue
            places = [Pose(*map(float, (*xy, draws.uniform(-np.pi, np.pi)))) for xy in chain]
            if len(truth.visibility(places[0], rig, of=target)):
                continue
            if not all(co_visible(truth, a, b, rig) for a, b in pairwise(places)):
                continue
            starts = _starts(scene, places, share, draws)
            if len(starts) == len(names) and in_room([s.xy_m for s in starts]).all():
                stand, begin = (dict(zip(names, p, strict=True)) for p in (places, starts))
                task = Task(stand, begin, scene.objects[target].name, tuple(pictured[target]))
                yield len(co_visible(truth, places[0], places[-1], rig)), task


def robot_names(n_robots: int, first: str = "R1") -> list[str]:
    """R1, R2, ... with ``first`` in front; MissionError if it is none of them."""
    if not 2 <= n_robots <= 20:
        raise MissionError(f"expected 2 to 20 robots, got {n_robots}")
    names = [f"R{i + 1}" for i in range(n_robots)]
    if first not in names:
        raise MissionError(f"there is no robot {first!r}; expected one of {', '.join(names)}")
    return [first, *(n for n in names if n != first)]


def _hidden_goals(
    scene: Scene,
    truth: GroundTruth,
    goals: list[int],
    n_robots: int,
    share: float,
    draws: np.random.Generator,
) -> Iterator[tuple[int, Points]]:
    """Goals with chains of places, (n_robots, 2), whose last alone sees points of the goal."""
    target = draws.choice(goals, _BATCH)
    bounds = np.array([scene.objects[i].bounds_m[:, :2] for i in target])
    half_m = np.ptp(bounds, axis=1).max(axis=1) / 2
    course = draws.uniform(-np.pi, np.pi, _BATCH)
    step_m = half_m + share * draws.uniform(*_GOAL_FROM_LAST_M, _BATCH)
    chain = [bounds.mean(axis=1) + step_m[:, None] * _unit(course)]
    for _ in range(n_robots - 1):
        course = course + draws.normal(0.0, 1.0, _BATCH)  # away from the goal, round corners
        step_m = share * draws.uniform(*SPACING_M, _BATCH)
        chain.insert(0, chain[0] + step_m[:, None] * _unit(course))
    places = np.stack(chain, axis=1)
    fits = scene.is_free(places.reshape(-1, 2), _clearance_m(share))
    free = fits.reshape(-1, n_robots).all(axis=1)
    if not free.any():
        return
    target, places = target[free], places[free]
    surface = {int(i): _surface_points(scene, int(i), draws) for i in np.unique(target)}
    points = np.array([surface[int(i)] for i in target]).reshape(len(target), -1, 3)
    shares = [_seen_share(truth, places[:, k], points, target) for k in range(n_robots)]
    hidden = (np.array(shares[:-1]) == 0).all(axis=0) & (shares[-1] > _LEAST_SEEN)
    hidden &= _apart(truth, places[:, 0], places[:, -1]) if n_robots > 2 else True
    for index in np.flatnonzero(hidden):
        yield int(target[index]), places[index]


def _surface_points(scene: Scene, target: int, draws: np.random.Generator) -> Points:
    """Points all over an object, (_SURFACE_POINTS, 3)."""
    surfaces = scene.objects[target].surfaces
    triangles = np.concatenate([s.vertices_m[s.faces] for s in surfaces]).astype(float)
    a, b, c = triangles.transpose(1, 0, 2)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    chosen = draws.choice(len(triangles), _SURFACE_POINTS, p=areas / areas.sum())
    weights = draws.dirichlet(np.ones(3), _SURFACE_POINTS)
    return np.einsum("nij,ni->nj", triangles[chosen], weights)


def _seen_share(
    truth: GroundTruth, xy_m: Points, points_m: Points, target: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Share of each target's points, (m, p, 3), seen from each place, (m, 2)."""
    eye = np.insert(xy_m, 2, CameraRig().camera_height_m, axis=1)[:, None, :]
    hit, distance = truth.cast(eye, points_m - eye)
    return ((hit == target[:, None]) & (np.abs(distance - 1) < 0.01)).mean(axis=1)


def _apart(truth: GroundTruth, a_xy_m: Points, b_xy_m: Points) -> NDArray[np.bool_]:
    """Whether something stands between places, (m, 2) each, at the cameras' height."""
    eye = np.insert(a_xy_m, 2, CameraRig().camera_height_m, axis=1)
    _, share = truth.cast(eye, np.insert(b_xy_m, 2, eye[0, 2], axis=1) - eye)
    return share < 1


def _unit(angle_rad: NDArray[np.float64]) -> Points:
    return np.stack([np.cos(angle_rad), np.sin(angle_rad)], axis=-1)


def _starts(
    scene: Scene, places: Sequence[Pose], share: float, draws: np.random.Generator
) -> list[Pose]:
    """Starts some metres off the places, which are reached straight ahead; fewer if one has none.

    Well apart from each other.
    """
    starts: list[Pose] = []
    clearance_m = _clearance_m(share)
    for place in places:
        for yaw in draws.uniform(-np.pi, np.pi, 24):
            back = -np.array([np.cos(yaw), np.sin(yaw)])
            way = place.xy_m + np.linspace(0.0, share * _RUN_UP_M, 13)[:, None] * back
            apart = all(start.distance_to_m(way[-1]) > 2 * clearance_m for start in starts)
            if apart and scene.is_free(way, clearance_m).all():
                starts.append(Pose(float(way[-1, 0]), float(way[-1, 1]), float(yaw)))
                break
    return starts


def _clearance_m(share: float) -> float:
    return max(_LEAST_CLEARANCE_M, share * _CLEARANCE_M)

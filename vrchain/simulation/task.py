"""A team's task, drawn up by ground truth: where each robot stands, and what one looks for.

The robots that carry it out never see it.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice, pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.optimize import brentq

from vrchain.errors import MissionError
from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.landmarks.quality import co_visible
from vrchain.navigation.settings import GOAL_RANGE_M
from vrchain.panorama import CameraRig, Panorama
from vrchain.seeding import generator
from vrchain.simulation.collision_free import FreeSpace
from vrchain.world.model import Scene, SceneObject
from vrchain.world.render import Renderer
from vrchain.world.truth import GroundTruth

Points = NDArray[np.float64]
SUCCESS_RANGE_M = 3.0  # from the goal's side
SUCCESS_RANGE_M = 3.0  # from the goal's side
SPACING_M = (5.0, 8.0)  # between neighbours of a chain
GOAL_PICTURES = 4
_CLEARANCE_M = 1.0
_BATCH = 20_000  # chains of places tried at once
_BATCHES = 8
_CHOICES = 4  # tasks among which the one that needs the chain most is taken
_GOAL_DRAWS = 160
_GOAL_KINDS = (("house",), ("shop", "building", "barn"))  # drawn from, if no goal is named
_LEAST_GOAL_M = 0.8  # wide, where no building can be drawn
_GOAL_FROM_LAST_M = (5.0, 15.0)  # from the goal's side
_LEAST_SEEN = 0.2  # share of the goal's surface that the last robot sees
_SURFACE_POINTS = 60
_UNOCCLUDED = 0.9
_FRAME = 1.1  # the goal's pictures are this much larger than the goal
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
    """A chain of robots, neighbours 5-8 m apart, whose last one alone sees the goal.

    All of them, and the goal, are in one room: the largest free region that holds a goal. ``robot``
    stands at the other end, with not a pixel of the goal in view. Neighbours see a
    landmark in common. Of some such places the one is taken where the two ends have fewest in
    common, so that the chain is needed. MissionError if none is found, or if there is no such
    robot or goal.
    """
    names, goals = robot_names(n_robots, robot), goal_ids(scene, goal)
    found = list(islice(_tasks(scene, truth, rig, seed, names, goals), _CHOICES))
    if not found:
        sought = f"the goal {goal!r}" if goal else "a goal"
        raise MissionError(
            f"found no place where the last of {n_robots} robots, {SPACING_M[0]:g}-"
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
    starts = _starts(scene, list(places.values()), generator(seed, "task"))
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
    rig: CameraRig,
    seed: int,
    names: list[str],
    goals: list[int],
) -> Iterator[tuple[int, Task]]:
    """Tasks as ``draw_task`` describes them, with the landmarks that both ends see."""
    draws = generator(seed, "task")
    pictured: dict[int, list[Pose]] = {}
    free = FreeSpace(scene, truth)
    room, goals = free.room(scene, goals, SUCCESS_RANGE_M)
    if not goals:
        return
    for _ in range(_BATCHES):
        for target, chain in _hidden_goals(scene, truth, goals, len(names), draws):
            if not free.is_in(room, chain).all():
                continue
            if target not in pictured:
                pictured[target] = goal_poses(scene, truth, target, seed)
            if len(pictured[target]) < GOAL_PICTURES:
                continue
            places = [Pose(*map(float, (*xy, draws.uniform(-np.pi, np.pi)))) for xy in chain]
            if len(truth.visibility(places[0], rig, of=target)):
                continue
            if not all(co_visible(truth, a, b, rig) for a, b in pairwise(places)):
                continue
            starts = _starts(scene, places, draws)
            if len(starts) == len(names) and free.is_in(room, [s.xy_m for s in starts]).all():
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


def goal_poses(scene: Scene, truth: GroundTruth, target: int, seed: int) -> list[Pose]:
    """Up to four free poses, 6-15 m from an object's side, that look at it unoccluded."""
    alone = GroundTruth(Scene("alone", scene.extent_m, (scene.objects[target],)))
    centre = scene.objects[target].bounds_m[:, :2].mean(axis=0)
    draws = generator(seed, "goal", target)
    offset_rad = draws.uniform(0, 2 * np.pi)
    rig, found = CameraRig(n_views=1, field_of_view_deg=110.0), list[Pose]()
    for attempt in range(_GOAL_DRAWS):
        if len(found) == GOAL_PICTURES:
            break
        # evenly around the object at first, anywhere if that does not work
        spread_rad = 0.2 + attempt / 40
        azimuth = offset_rad + np.pi / 2 * len(found) + draws.normal(0, spread_rad)
        side_m, outward = draws.uniform(*GOAL_RANGE_M), np.array([np.cos(azimuth), np.sin(azimuth)])
        x_m, y_m = _off(scene.objects[target].footprint, centre, outward, side_m)
        pose = Pose(float(x_m), float(y_m), float(wrap_angle_rad(azimuth + np.pi)))
        if not scene.is_free([pose.xy_m])[0]:
            continue
        seen = truth.visibility(pose, rig, of=target).area_deg2
        whole = alone.visibility(pose, rig, of=0).area_deg2
        if len(seen) and seen[target] >= _UNOCCLUDED * whole[0]:
            found.append(pose)
    return found


def _off(footprint: shapely.Geometry, centre: Points, outward: Points, side_m: float) -> Points:
    """The place outward from a footprint's centre, (2,), that is so far off its side."""

    def too_far_m(way_m: float) -> float:
        point = shapely.Point(centre + way_m * outward)
        return float(shapely.distance(footprint, point)) - side_m

    if too_far_m(0.0) >= 0:  # amidst walls that are as far all around
        return centre
    x0, y0, x1, y1 = footprint.bounds
    most_m = float(np.hypot(x1 - x0, y1 - y0)) + side_m
    return np.asarray(centre + brentq(too_far_m, 0.0, most_m) * outward)


def goal_pictures(
    scene: Scene, renderer: Renderer, goal: str, poses: Sequence[Pose], rig: CameraRig
) -> list[Panorama]:
    """Single views framed on the goal, as one who points it out would take them.

    As many pixels a degree as the team's own cameras have.
    """
    corners = np.concatenate([s.vertices_m for s in scene.objects[scene.index_of(goal)].surfaces])
    pictures = []
    for pose in poses:
        side_rad = max(abs(pose.bearing_to_rad(c)) for c in corners[:, :2])
        rise_m = np.abs(corners[:, 2] - rig.camera_height_m)
        slope = float((rise_m / np.linalg.norm(corners[:, :2] - pose.xy_m, axis=1)).max())
        half_rad = float(np.clip(_FRAME * side_rad, np.radians(3), np.radians(50)))
        width_px = 2 * round(rig.focal_px * np.tan(half_rad))
        height_px = min(rig.height_px, 2 * round(rig.focal_px * _FRAME * slope))
        field_deg = 2 * float(np.degrees(np.arctan(width_px / 2 / rig.focal_px)))
        single = CameraRig(1, width_px, height_px, field_deg, rig.camera_height_m)
        pictures.append(renderer.render(pose, single))
    return pictures


def _hidden_goals(
    scene: Scene, truth: GroundTruth, goals: list[int], n_robots: int, draws: np.random.Generator
) -> Iterator[tuple[int, Points]]:
    """Goals with chains of places, (n_robots, 2), whose last alone sees any of the goal."""
    target = draws.choice(goals, _BATCH)
    bounds = np.array([scene.objects[i].bounds_m[:, :2] for i in target])
    half_m = np.ptp(bounds, axis=1).max(axis=1) / 2
    course = draws.uniform(-np.pi, np.pi, _BATCH)
    step_m = half_m + draws.uniform(*_GOAL_FROM_LAST_M, _BATCH)
    chain = [bounds.mean(axis=1) + step_m[:, None] * _unit(course)]
    for _ in range(n_robots - 1):
        course = course + draws.normal(0.0, 1.0, _BATCH)  # away from the goal, round corners
        chain.insert(0, chain[0] + draws.uniform(*SPACING_M, _BATCH)[:, None] * _unit(course))
    places = np.stack(chain, axis=1)
    free = scene.is_free(places.reshape(-1, 2), _CLEARANCE_M).reshape(-1, n_robots).all(axis=1)
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


def _starts(scene: Scene, places: Sequence[Pose], draws: np.random.Generator) -> list[Pose]:
    """Starts some metres off the places, which are reached straight ahead; fewer if one has none.

    Well apart from each other.
    """
    starts: list[Pose] = []
    for place in places:
        for yaw in draws.uniform(-np.pi, np.pi, 24):
            back = -np.array([np.cos(yaw), np.sin(yaw)])
            way = place.xy_m + np.linspace(0.0, _RUN_UP_M, 13)[:, None] * back
            apart = all(start.distance_to_m(way[-1]) > 2 * _CLEARANCE_M for start in starts)
            if apart and scene.is_free(way, _CLEARANCE_M).all():
                starts.append(Pose(float(way[-1, 0]), float(way[-1, 1]), float(yaw)))
                break
    return starts


def _is_large(thing: SceneObject) -> bool:
    """Whether it is as large as furniture, and stands on the floor or hangs at hand."""
    low_m = float(thing.bounds_m[0, 2])
    return max(thing.size_m[:2]) >= _LEAST_GOAL_M and low_m < _LEAST_GOAL_M


def goal_ids(scene: Scene, goal: str | None) -> list[int]:
    """The object of that name, or without a name all that goals are drawn from.

    Those are houses without a twin, or else other buildings without one, or else, as indoors, other
    landmarks without one that are large. MissionError if there is no such object, or if it is no
    landmark.
    """
    if goal is None:
        placings = Counter(o.model for o in scene.objects)
        alone = [
            (i, o.kind)
            for i, o in enumerate(scene.objects)
            if o.landmark and placings[o.model] == 1
        ]
        for kinds in _GOAL_KINDS:
            if drawn := [i for i, kind in alone if kind in kinds]:
                return drawn
        if large := [i for i, _ in alone if _is_large(scene.objects[i])]:
            return large
        raise MissionError(
            "the scene has no landmark of a size without a twin to draw as a goal: name a --goal"
        )
    try:
        target = scene.index_of(goal)
    except KeyError:
        raise MissionError(
            f"the scene has no object {goal!r}: see `vrchain scene info` for its objects"
        ) from None
    if not scene.objects[target].landmark:
        raise MissionError(
            f"{goal!r} is no landmark and cannot be a goal: choose a standing object"
        )
    return [target]

"""A team of simulated robots: where it stands, how it drives and publishes, what it looks for.

Here ground truth draws up the task; the robots that carry it out never see it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass

import numpy as np
from numpy.typing import NDArray

from vrchain.errors import MissionError
from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.landmarks.quality import co_visible
from vrchain.ledger import Ledger, SigningKey, simulated_key
from vrchain.panorama import CameraRig, Panorama
from vrchain.render import Renderer
from vrchain.robot import Drive, Observation, UpdateMonitor, UpdateRules, steer
from vrchain.scene.model import Scene
from vrchain.seeding import generator
from vrchain.simulator import Simulator
from vrchain.truth import GroundTruth

SPACING_M = (5.0, 8.0)  # between neighbours of a chain
GOAL_RANGE_M = (6.0, 15.0)  # from which the goal's pictures are taken
GOAL_PICTURES = 4
LOOK_EVERY_M = 2.5
_CLEARANCE_M = 1.0
_DRAWS = 400
_GOAL_KINDS = ("house", "vehicle")  # drawn from, if no goal is named
_GOAL_MIN_AZIMUTH_DEG = 6.0
_GOAL_MAX_RANGE_M = 25.0
_UNOCCLUDED = 0.9
_FRAME = 1.1  # the goal's pictures are this much wider than the goal
_RUN_UP_M = 6.0  # the way a robot drives to its place
_TICK_S = 0.5


@dataclass(frozen=True)
class Task:
    """Who stands where, and what the first robot is to find."""

    places: Mapping[str, Pose]
    starts: Mapping[str, Pose]
    goal: str


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

    Neighbours see a landmark in common; not a pixel of the goal is in view of the others.
    MissionError if no such place is found, or if there is no such robot or goal.
    """
    names = robot_names(n_robots, robot)
    _check_goal(scene, goal)
    draws = generator(seed, "task")
    for _ in range(_DRAWS):
        places = _draw_chain(scene, draws, n_robots)
        if places is None:
            continue
        seen = [truth.visibility(p, rig) for p in places]
        candidates = seen[-1][
            (seen[-1].azimuth_deg >= _GOAL_MIN_AZIMUTH_DEG)
            & (seen[-1].range_m <= _GOAL_MAX_RANGE_M)
        ]
        hidden = [
            int(i)
            for i in candidates.index
            if (scene.objects[i].name == goal if goal else scene.objects[i].kind in _GOAL_KINDS)
            and not any(i in table.index for table in seen[:-1])
        ]
        neighbours = list(zip(places[:-1], places[1:], strict=True))
        if not hidden or not all(co_visible(truth, a, b, rig) for a, b in neighbours):
            continue
        chosen = scene.objects[max(hidden, key=lambda i: candidates.azimuth_deg[i])].name
        starts = [_run_up(scene, place, draws) for place in places]
        if None in starts or len(goal_poses(scene, truth, chosen, seed)) < GOAL_PICTURES:
            continue
        return Task(
            dict(zip(names, places, strict=True)),
            {n: s for n, s in zip(names, starts, strict=True) if s is not None},
            chosen,
        )
    sought = f"the goal {goal!r}" if goal else "a goal"
    raise MissionError(
        f"found no place in {_DRAWS} draws where the last of {n_robots} robots, "
        f"{SPACING_M[0]:g}-{SPACING_M[1]:g} m apart, sees {sought} and the others do not: "
        "try another goal, fewer robots or another seed"
    )


def robot_names(n_robots: int, first: str = "R1") -> list[str]:
    """R1, R2, ... with ``first`` in front; MissionError if it is none of them."""
    if not 2 <= n_robots <= 20:
        raise MissionError(f"expected 2 to 20 robots, got {n_robots}")
    names = [f"R{i + 1}" for i in range(n_robots)]
    if first not in names:
        raise MissionError(f"there is no robot {first!r}; expected one of {', '.join(names)}")
    return [first, *(n for n in names if n != first)]


def goal_poses(scene: Scene, truth: GroundTruth, goal: str, seed: int) -> list[Pose]:
    """Up to four free poses, 6-15 m from an object's side, that look at it unoccluded."""
    target = scene.index_of(goal)
    alone = GroundTruth(Scene(goal, scene.extent_m, (scene.objects[target],)))
    centre, half = scene.objects[target].bounds_m.mean(axis=0)[:2], None
    half = np.ptp(scene.objects[target].bounds_m, axis=0)[:2].max() / 2
    draws, found = generator(seed, "goal", goal), list[Pose]()
    offset = draws.uniform(0, 2 * np.pi)
    rig = CameraRig(n_views=1)
    for attempt in range(160):
        azimuth = offset + 2 * np.pi * (len(found) / GOAL_PICTURES) + draws.normal(0, 0.2 + attempt / 40)
        range_m = draws.uniform(*GOAL_RANGE_M) + half
        x_m, y_m = centre + range_m * np.array([np.cos(azimuth), np.sin(azimuth)])
        pose = Pose(float(x_m), float(y_m), float(wrap_angle_rad(azimuth + np.pi)))
        if not scene.is_free([pose.xy_m])[0]:
            continue
        seen, whole = (t.visibility(pose, rig).area_deg2 for t in (truth, alone))
        if target in seen.index and seen[target] >= _UNOCCLUDED * whole.get(0, np.inf):
            found.append(pose)
        if len(found) == GOAL_PICTURES:
            break
    return found


def goal_pictures(
    scene: Scene, renderer: Renderer, goal: str, poses: Sequence[Pose], rig: CameraRig
) -> list[Panorama]:
    """Single views framed on the goal, as one who points it out would take them.

    As many pixels a degree as the team's own cameras have.
    """
    corners = np.concatenate([s.vertices_m for s in scene.objects[scene.index_of(goal)].surfaces])
    pictures = []
    for pose in poses:
        half_rad = max(abs(pose.bearing_to_rad(c)) for c in corners[:, :2])
        half_rad = float(np.clip(_FRAME * half_rad, np.radians(3), np.radians(50)))
        width_px = 2 * round(rig.focal_px * np.tan(half_rad))
        field_deg = 2 * float(np.degrees(np.arctan(width_px / 2 / rig.focal_px)))
        single = CameraRig(1, width_px, rig.height_px, field_deg, rig.camera_height_m)
        pictures.append(renderer.render(pose, single))
    return pictures


@dataclass(frozen=True)
class Publication:
    """One transaction as its robot published it, with the true pose for evaluation."""

    robot: str
    time_s: float
    rule: str
    digest: str
    payload_bytes: int
    x_m: float
    y_m: float
    yaw_rad: float


class PublishingRobot:
    """A simulated robot's senses and wheels; whenever it looks, the update rules may publish."""

    def __init__(
        self, simulator: Simulator, name: str, ledger: Ledger, key: SigningKey, rules: UpdateRules
    ) -> None:
        self.simulator, self.name, self._ledger, self._key = simulator, name, ledger, key
        self.monitor = UpdateMonitor(rules)
        self.publications: list[Publication] = []
        self._looked: Observation | None = None

    def observe(self, look: bool = False) -> Observation:
        """What it senses now; a look publishes if a rule says so."""
        seen = self.simulator.observe(self.name, look=look)
        rule = self.monitor.due(seen)
        if seen.panorama is not None:
            self._looked = seen
            if rule:
                self._publish(seen, rule)
        return seen

    def watch(self) -> Observation:
        """Observe, and look if the last look is some way or time ago: looking costs."""
        last = self._looked
        seen = self.simulator.observe(self.name)
        if last is not None:
            moved_m = last.odometry.distance_to_m(seen.odometry.xy_m)
            waited_s = (seen.time_ns - last.time_ns) / 1e9
            if moved_m < LOOK_EVERY_M and waited_s < self.monitor.rules.max_age_s:
                self.monitor.due(seen)
                return seen
        return self.observe(look=True)

    def drive(self, command: Drive, duration_s: float) -> None:
        """Drive so for a while; the others stand still."""
        self.simulator.step({self.name: command}, duration_s)

    def _publish(self, seen: Observation, rule: str) -> None:
        assert seen.panorama is not None
        blob = seen.panorama.encode()
        entry = self._ledger.publish(self.name, self._key, blob, rule, seen.time_ns)
        self.monitor.published(seen)
        pose = self.simulator.pose(self.name)
        digest = entry.payload_digest.hex()
        self.publications.append(
            Publication(self.name, seen.time_ns / 1e9, rule, digest, len(blob), *astuple(pose))
        )


def assemble(
    simulator: Simulator, ledger: Ledger, seed: int, rules: UpdateRules | None = None
) -> dict[str, PublishingRobot]:
    """The simulator's robots, able to publish with keys that derive from the seed."""
    rules = rules or UpdateRules()
    return {
        name: PublishingRobot(simulator, name, ledger, simulated_key(seed, name), rules)
        for name in simulator.robots
    }


def drive_to_places(simulator: Simulator, robots: Mapping[str, PublishingRobot], task: Task) -> None:
    """All robots drive to their places at once, by odometry, and publish as they go.

    Then they wait until the third rule, time, has had each publish what it sees from there.
    """
    goals = {n: _in_own_frame(task.starts[n], task.places[n]) for n in robots}
    deadline_ns = simulator.clock_ns + int(60e9)
    driving = set(robots)
    while driving and simulator.clock_ns < deadline_ns:
        commands = {}
        for name in sorted(driving):
            seen = robots[name].watch()
            if seen.odometry.distance_to_m(goals[name]) < 0.3:
                driving.remove(name)
            else:
                commands[name] = steer(seen.odometry.bearing_to_rad(goals[name]), seen.range_ring_m)
        simulator.step(commands, _TICK_S)
    simulator.step({}, max(r.monitor.rules.max_age_s for r in robots.values()))
    for robot in robots.values():
        robot.watch()


def _in_own_frame(start: Pose, place: Pose) -> NDArray[np.float64]:
    """A place in the odometry frame of a robot that started at ``start``."""
    distance_m, bearing_rad = start.distance_to_m(place.xy_m), start.bearing_to_rad(place.xy_m)
    return distance_m * np.array([np.cos(bearing_rad), np.sin(bearing_rad)])


def _draw_chain(scene: Scene, draws: np.random.Generator, n: int) -> list[Pose] | None:
    half = np.array(scene.extent_m) / 2
    points = [draws.uniform(-half, half)]
    course = draws.uniform(-np.pi, np.pi)
    for _ in range(n - 1):
        course += draws.normal(0.0, 0.5)  # a chain leads somewhere, it does not curl up
        step = draws.uniform(*SPACING_M) * np.array([np.cos(course), np.sin(course)])
        points.append(points[-1] + step)
    yaws = draws.uniform(-np.pi, np.pi, n)
    if not scene.is_free(points, _CLEARANCE_M).all():
        return None
    return [Pose(float(x), float(y), float(yaw)) for (x, y), yaw in zip(points, yaws, strict=True)]


def _run_up(scene: Scene, place: Pose, draws: np.random.Generator) -> Pose | None:
    """A start some metres off, from which the place is reached straight ahead."""
    for yaw in draws.uniform(-np.pi, np.pi, 24):
        back = -np.array([np.cos(yaw), np.sin(yaw)])
        way = place.xy_m + np.linspace(0.0, _RUN_UP_M, 13)[:, None] * back
        if scene.is_free(way, _CLEARANCE_M).all():
            return Pose(float(way[-1, 0]), float(way[-1, 1]), float(yaw))
    return None


def _check_goal(scene: Scene, goal: str | None) -> None:
    if goal is None:
        return
    try:
        landmark = scene.objects[scene.index_of(goal)].landmark
    except KeyError:
        raise MissionError(
            f"the scene has no object {goal!r}: see `vrchain scene info` for its objects"
        ) from None
    if not landmark:
        raise MissionError(f"{goal!r} is no landmark and cannot be a goal: choose a standing object")

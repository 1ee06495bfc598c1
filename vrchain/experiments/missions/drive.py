"""One mission, driven by one arm: what came of it."""

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from time import perf_counter

import numpy as np

from vrchain.errors import MissionError
from vrchain.experiments.missions.chains import PLACE
from vrchain.experiments.missions.draw import Ground, Mission
from vrchain.experiments.missions.liars import LIES, lie
from vrchain.experiments.missions.obstruction import Barred
from vrchain.experiments.missions.oracle import Oracle
from vrchain.experiments.missions.wire import Wire
from vrchain.experiments.missions.wrong_edges import misled
from vrchain.experiments.scenes import Scenes
from vrchain.geometry import Pose
from vrchain.ledger import Ledger, simulated_key
from vrchain.ledger.records.encoding import digest
from vrchain.navigation.goal.place import GoalPlace
from vrchain.navigation.goal.recognition import KnownGoal, goal_from
from vrchain.navigation.mission import MissionResult, drive_mission
from vrchain.navigation.perception import Perception, learned_perception
from vrchain.navigation.settings import MissionConfig
from vrchain.panorama import CameraRig, Panorama
from vrchain.reader import REMEMBERED, index_of, published_of
from vrchain.robot import UpdateRules
from vrchain.simulation.goals import goal_pictures, pictured_share
from vrchain.simulation.mission import is_at
from vrchain.simulation.patrol import Patrol
from vrchain.simulation.simulator import Simulator
from vrchain.simulation.team import PublishingRobot, assemble
from vrchain.world.render import Renderer
from vrchain.world.truth import GroundTruth

TASKS = ("goal", "return", "change")
_AT_PLACE_M = 1.0
_CHANGE_S = 60.0  # on the way to another goal
_RECALLED = 120  # panoramas, of some 7 MB


@dataclass(frozen=True)
class Conditions:
    """What missions are driven under. MissionError for shares or seconds that cannot be.

    patrol_s: for how long the others are under way before. wrong_edges: the share of the landmark
    graph's edges that are made wrong; barred: of legs, with an obstacle nobody knows of. liars: how
    many of the others publish what is not so; lie: in which way (``liars.lie``). keep: how many
    panoramas of each robot are planned by, the newest, as if no others were kept. rarer: how many
    times the thresholds of the update rules. quiet_s: so long ago the others have stopped, for
    good; if 0 they go on. season, time: as it was on their patrol, and when the goal was pictured;
    now, if None. goal_rise_m: how much higher than the robot's the camera was that pictured it.
    task: *goal*, as drawn; *return*: the driving robot patrols too, and is then asked for the place
    where it set out; *change*: it has been on its way to another goal for a minute.
    """

    patrol_s: float = 300.0
    wrong_edges: float = 0.0
    barred: float = 0.0
    liars: int = 0
    lie: str = "odometry"
    keep: int = REMEMBERED
    rarer: float = 1.0
    quiet_s: float = 0.0
    season: str | None = None
    time: str | None = None
    goal_rise_m: float = 0.0
    task: str = "goal"
    config: MissionConfig = field(default_factory=MissionConfig)

    def __post_init__(self) -> None:
        for what, share in (("wrong edges", self.wrong_edges), ("barred legs", self.barred)):
            if not 0 <= share <= 1:
                raise MissionError(f"expected a share of {what} from 0 to 1, got {share}")
        if self.liars < 0 or self.lie not in LIES:
            raise MissionError(
                f"expected 0 liars or more and a lie of {', '.join(LIES)}, got {self.liars} and "
                f"{self.lie}"
            )
        for what, seconds in (("patrol", self.patrol_s), ("silence", self.quiet_s)):
            if not 0 <= seconds < np.inf:
                raise MissionError(f"expected seconds of {what}, 0 or more, got {seconds}")
        if self.keep < 1:
            raise MissionError(
                f"expected to keep 1 panorama of each robot or more, got {self.keep}"
            )
        if not 0 < self.rarer < np.inf:
            raise MissionError(f"expected rules so many times rarer, above 0, got {self.rarer}")
        if not np.isfinite(self.goal_rise_m):
            raise MissionError(f"expected metres of rise, got {self.goal_rise_m}")
        if self.task not in TASKS:
            raise MissionError(f"expected a task of {', '.join(TASKS)}, got {self.task}")

    @property
    def rules(self) -> UpdateRules:
        """When robots publish."""
        usual = asdict(UpdateRules())
        return UpdateRules(**{name: self.rarer * value for name, value in usual.items()})

    def goal_rig(self, rig: CameraRig) -> CameraRig:
        """The robot's cameras at the height from which the goal is pictured."""
        return replace(rig, camera_height_m=rig.camera_height_m + self.goal_rise_m)


class _Recalled(Renderer):
    """Draws what it drew before from memory: two arms begin with the same patrol."""

    def __init__(self, renderer: Renderer) -> None:
        self._renderer, self._drawn = renderer, dict[object, Panorama]()

    def render(
        self,
        pose: Pose,
        rig: CameraRig | None = None,
        robots: Mapping[str, Pose] | None = None,
    ) -> Panorama:
        asked = pose, rig, tuple((robots or {}).items())
        drawn = self._drawn.get(asked) or self._renderer.render(pose, rig, robots)
        if len(self._drawn) < _RECALLED:
            self._drawn[asked] = drawn
        return replace(drawn)  # with nothing that is derived from it


def _taken_at(panorama: bytes, robots: Mapping[str, PublishingRobot]) -> Pose:
    """From where a published panorama was."""
    told = [p for body in robots.values() for p in body.publications]
    return {p.digest: Pose(p.x_m, p.y_m, p.yaw_rad) for p in told}[digest(panorama).hex()]


def _patrol(
    simulator: Simulator,
    robots: Mapping[str, PublishingRobot],
    names: Sequence[str],
    robot: str,
    seed: int,
    conditions: Conditions,
) -> None:
    """Let these drive about and publish; but for the robot, they go on while it drives."""
    if not names:
        return
    for name in names:
        robots[name].observe(look=True)
    patrol = Patrol(simulator, {name: robots[name] for name in names}, seed)
    patrol.drive(conditions.patrol_s)
    patrol.leave(robot)
    if conditions.quiet_s > 0:
        simulator.step({}, conditions.quiet_s)
    else:
        robots[robot].body.others = patrol.drives


class Suburb:
    """One scene with all that is made of it once, and missions in it."""

    def __init__(self, scenes: Scenes, seed: int, k: int, rig: CameraRig) -> None:
        self.scene, self.seed, self.k, self.rig = scenes.scene(seed, k), seed, k, rig
        self.truth, self.renderer = GroundTruth(self.scene), Renderer(self.scene)
        self.ground = Ground(self.scene, self.truth, rig)
        self._scenes = scenes
        self._other = lru_cache(maxsize=1)(lambda other: Renderer(other.scene(seed, k)))
        # of the mission at work
        self._recalled = lru_cache(maxsize=1)(lambda renderer, mission: _Recalled(renderer))

    def _before(self, conditions: Conditions) -> Renderer:
        """Draws the scene as it was on the others' patrol."""
        scenes = self._scenes.at(conditions.season, conditions.time)
        return self.renderer if scenes is self._scenes else self._other(scenes)

    def drive(self, mission: Mission, arm: str, conditions: Conditions) -> dict[str, object]:
        """Drive a mission by one arm: a row of ``success.evaluate``'s table, and its log."""
        start = perf_counter()
        number = self.seed * 100_003 + self.k * 1009 + mission.number
        simulator = Simulator(self.scene, mission.poses, seed=number, rig=self.rig)
        before = self._before(conditions)
        simulator.truth, simulator.renderer = self.truth, self._recalled(before, number)
        robot, *others = mission.poses
        if conditions.task == "return":
            mission = replace(mission, goal=PLACE, goal_poses=(mission.poses[robot],))
        members = {name: simulated_key(number, name).public for name in mission.poses}
        operator = simulated_key(number, "operator")
        with (
            tempfile.TemporaryDirectory() as folder,
            Ledger.create(Path(folder) / "ledger", members, operator) as ledger,
        ):
            oracle = Oracle(self.truth, self.rig) if arm == "oracle" else None
            if oracle:
                perception = oracle.perception(
                    lambda: simulator.pose(robot), lambda panorama: _taken_at(panorama, robots)
                )
            else:
                perception = learned_perception()
            goal = self._goal(mission, before, conditions, perception, oracle)
            told = {
                name: lie(conditions.lie, simulator, name, number)
                for name in others[: conditions.liars]
            }
            examine = oracle.record if oracle else perception.record
            robots = assemble(
                simulator, ledger, number, conditions.rules, examine=examine, told=told
            )
            patrols = [] if arm == "alone" else [*others]
            patrols += [robot] if conditions.task == "return" else []
            _patrol(simulator, robots, patrols, robot, number, conditions)
            simulator.renderer = self.renderer
            # among panoramas: the goal is as it was shown
            misleading = misled(perception, conditions.wrong_edges, number)
            wire, bars = Wire(ledger), Barred(simulator, robot, conditions.barred, number)
            index = index_of(ledger, misleading, wire.read)

            def drive_to(mission: Mission, goal: KnownGoal, limit_s: float) -> MissionResult:
                known = published_of(ledger, robot, conditions.keep, memory=True)
                config = replace(conditions.config, limit_s=limit_s)
                return drive_mission(
                    robot, robots[robot], known, index, goal, misleading, config, bars.tell
                )

            bumped = simulator.collisions(robot)
            if conditions.task == "change":
                other = self.ground.another(mission, number)
                drive_to(
                    other, self._goal(other, before, conditions, perception, oracle), _CHANGE_S
                )
            if conditions.task != "goal":
                pose = simulator.pose(robot)
                way_m = self.ground.way_m(pose, mission.goal, mission.goal_poses)
                mission = replace(mission, way_m=way_m, chain=None)
            first, started_ns = len(simulator.times_s) - 1, simulator.clock_ns
            result = drive_to(mission, goal, conditions.config.limit_s)
            sent = wire.sent(robot, len(others))
        seconds = (simulator.clock_ns - started_ns) / 1e9
        row = self._row(mission, arm, simulator, robot, result, seconds, first)
        counted = {"collisions": simulator.collisions(robot) - bumped, "barred": bars.rows}
        costs = {"clock_s": simulator.clock_ns / 1e9, "wall_s": perf_counter() - start}
        return {**row, **sent, **counted, **costs}

    def _goal(
        self,
        mission: Mission,
        before: Renderer,
        conditions: Conditions,
        perception: Perception,
        oracle: Oracle | None,
    ) -> KnownGoal:
        """As the robot is shown it."""
        if mission.goal == PLACE:
            (place,) = mission.goal_poses
            if oracle:
                return oracle.place(place, perception)
            shown = before.render(place, self.rig).encode()
            return GoalPlace(perception.stored(shown, None), perception)
        poses, rig = mission.goal_poses, conditions.goal_rig(self.rig)
        share = pictured_share(self.scene, mission.goal, poses)
        if oracle:
            return oracle.goal(mission.goal, share)
        return goal_from(goal_pictures(self.scene, before, mission.goal, poses, rig), share=share)

    def _row(
        self,
        mission: Mission,
        arm: str,
        simulator: Simulator,
        robot: str,
        result: MissionResult,
        seconds: float,
        first: int,
    ) -> dict[str, object]:
        pose = simulator.pose(robot)
        if mission.goal == PLACE:
            range_m = pose.distance_to_m(mission.goal_poses[0].xy_m)
            at_goal = range_m <= _AT_PLACE_M
        else:
            at_goal, range_m = is_at(self.scene, self.truth, mission.goal, pose, self.rig)
        path = simulator.path_xy_m(robot)[first:]
        chain = mission.chain
        reached = [d for d in result.decisions if d.what == "reached"]
        return {
            "mission": mission.number,
            "arm": arm,
            "arrived": result.arrived,
            "success": result.arrived and at_goal,
            "reason": result.reason,
            "range_m": range_m,
            "driven_m": float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()),
            "way_m": mission.way_m,
            "chain": len(chain.landmarks) if chain else 0,
            "chain_way_m": chain.way_m if chain else None,
            "replans": max(0, len(result.plans) - 1),
            "legs": len(reached),
            "to_landmarks": sum(d.values["landmark"] for d in reached),
            "seconds_simulated": seconds,
            "log": [asdict(d) for d in result.decisions],
        }

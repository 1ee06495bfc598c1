"""A whole mission in a scene: the team and its ledger, the drive, and whether it truly arrived.

``run_mission`` is what users call. The drive itself, by what the robot senses, is
``vrchain.navigation.mission.drive_mission``.
"""

import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TypeAlias

import numpy as np
import pandas as pd
import shapely
from numpy.typing import NDArray

from vrchain.errors import VRChainError
from vrchain.geometry import Pose
from vrchain.landmarks.extraction.weights import SHIPPED
from vrchain.ledger import Ledger
from vrchain.navigation.goal.recognition import goal_from
from vrchain.navigation.mission import MissionResult, drive_mission
from vrchain.navigation.perception import Perception, learned_perception
from vrchain.navigation.settings import Decision, MissionConfig
from vrchain.panorama import CameraRig, Panorama
from vrchain.reader import index_of, published_of
from vrchain.simulation.goals import goal_pictures, pictured_share
from vrchain.simulation.simulator import Simulator, Trajectory
from vrchain.simulation.task import SUCCESS_RANGE_M, Task, draw_task, scene_task
from vrchain.simulation.team import PublishingRobot, assemble, drive_to_places, team_ledger
from vrchain.simulation.trajectory import as_tum
from vrchain.world.model import Scene
from vrchain.world.render import Renderer
from vrchain.world.truth import GroundTruth

MARKER = "mission.json"

Outset: TypeAlias = tuple[Simulator, Task, list[Panorama]]


@dataclass(frozen=True, eq=False)
class MissionRun:
    """A mission as it was driven, and what truth says of it.

    arrived: the robot's own claim. success: it is so. range_m: from the goal's footprint at the
    end. paths_xy_m: true positions of each robot, (n, 2), at times_s, (n,), by the clock of the
    decisions. trajectories: of each robot all its poses, truly and by odometry.
    """

    scene: Scene
    task: Task
    robot: str
    result: MissionResult
    pictures: tuple[Panorama, ...]
    panoramas: dict[str, Panorama]
    paths_xy_m: dict[str, NDArray[np.float64]]
    times_s: NDArray[np.float64]
    final_pose: Pose
    success: bool
    range_m: float
    collisions: int
    seconds: float
    head: str
    trajectories: dict[str, tuple[Trajectory, Trajectory]] = field(default_factory=dict)

    def summary(self) -> dict:
        """The outcome as plain values."""
        sent = self.times_s >= self.times_s[-1] - self.seconds - 1e-6  # before, all drove out
        steps_m = np.diff(self.paths_xy_m[self.robot][sent], axis=0)
        return {
            "robot": self.robot,
            "goal": self.task.goal,
            "arrived": self.result.arrived,
            "success": self.success,
            "reason": self.result.reason,
            "range_m": round(self.range_m, 2),
            "driven_m": round(float(np.linalg.norm(steps_m, axis=1).sum()), 2),
            "simulated_s": round(self.seconds, 1),
            "collisions": self.collisions,
            "chain": list(self.result.plans[-1][1].robots) if self.result.plans else [],
            "head": self.head,
        }

    def log(self) -> pd.DataFrame:
        """The decisions, one row each."""
        return pd.DataFrame([asdict(d) for d in self.result.decisions])


def run_mission(
    scene: Scene,
    ledger_folder: str | Path,
    *,
    seed: int = 0,
    n_robots: int = 3,
    robot: str = "R1",
    goal: str | None = None,
    rig: CameraRig | None = None,
    config: MissionConfig | None = None,
    weights: Path = SHIPPED,
    tell: Callable[[Decision], None] = lambda decision: None,
) -> MissionRun:
    """Draw a task, let the team drive and publish, and send ``robot`` to the goal.

    Whether it arrived is judged by truth, which the robot is not told.

    A scene with robots of its own sets the task itself. weights: of the network by whose landmarks
    they recognise things; LearnedError without torch or weights.
    """
    perception = learned_perception(weights)
    outset = set_out(scene, seed, n_robots, robot, goal, rig or CameraRig())
    simulator, task, _ = outset
    with team_ledger(ledger_folder, task.starts, seed) as ledger:
        robots = assemble(simulator, ledger, seed, examine=perception.record)
        drive_to_places(simulator, robots, task)
        return send(robot, robots[robot], outset, ledger, perception, config, weights, tell)


def send(
    robot: str,
    body: PublishingRobot,
    outset: Outset,
    ledger: Ledger,
    perception: Perception,
    config: MissionConfig | None = None,
    weights: Path = SHIPPED,
    tell: Callable[[Decision], None] = lambda decision: None,
) -> MissionRun:
    """Send a robot, whose team is at its places, to the goal by what the ledger holds."""
    simulator, task, pictures = outset
    scene, started_ns = simulator.scene, simulator.clock_ns
    bumped = simulator.collisions(robot)
    published, index = published_of(ledger, robot), index_of(ledger, perception)
    panoramas = {}
    for name, newest in published().items():
        with suppress(VRChainError):  # whatever a member appended
            panoramas[name] = index.panorama(newest.digest)
    share = pictured_share(scene, task.goal, task.goal_poses)
    shown = goal_from(pictures, weights, share)
    result = drive_mission(robot, body, published, index, shown, perception, config, tell)
    pose = simulator.pose(robot)
    at_goal, range_m = is_at(scene, simulator.truth, task.goal, pose, simulator.rig)
    return MissionRun(
        scene, task, robot, result, tuple(pictures), panoramas,
        {n: simulator.path_xy_m(n) for n in simulator.robots}, simulator.times_s, pose,
        result.arrived and at_goal, range_m, simulator.collisions(robot) - bumped,
        (simulator.clock_ns - started_ns) / 1e9, ledger.head.hash.hex(),
        {n: simulator.trajectories(n) for n in simulator.robots},
    )  # fmt: skip


def set_out(
    scene: Scene, seed: int, n_robots: int, robot: str, goal: str | None, rig: CameraRig
) -> Outset:
    """A task in a scene, its robots where they start, and the goal's pictures."""
    truth, renderer = GroundTruth(scene), Renderer(scene)
    if scene.robots:
        task = scene_task(scene, truth, seed, n_robots, robot, goal)
    else:
        task = draw_task(scene, truth, rig, seed, n_robots, robot, goal)
    simulator = Simulator(scene, task.starts, seed=seed, rig=rig)
    simulator.truth, simulator.renderer = truth, renderer
    return simulator, task, goal_pictures(scene, renderer, task.goal, task.goal_poses, rig)


def is_at(
    scene: Scene, truth: GroundTruth, goal: str, pose: Pose, rig: CameraRig
) -> tuple[bool, float]:
    """Whether a robot is at the goal, in sight of it, and how far it is from its footprint."""
    target = scene.index_of(goal)
    range_m = float(scene.objects[target].footprint.distance(shapely.Point(*pose.xy_m)))
    return truth.sees(target, pose, rig) and range_m <= SUCCESS_RANGE_M, range_m


def save_log(run: MissionRun, folder: Path) -> None:
    """Write the outcome (mission.json), decisions (decisions.jsonl) and trajectories (*.tum)."""
    (folder / MARKER).write_text(json.dumps(run.summary(), indent=2) + "\n")
    lines = [json.dumps(asdict(d), sort_keys=True) for d in run.result.decisions]
    (folder / "decisions.jsonl").write_text("\n".join(lines) + "\n")
    for name, (truth, odometry) in run.trajectories.items():
        (folder / f"{name}_truth.tum").write_text(as_tum(truth))
        (folder / f"{name}_odometry.tum").write_text(as_tum(odometry))

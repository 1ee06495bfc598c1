"""The clock of a whole team: until when has every robot reached a goal of its own?

All set out at once, from anywhere, plan by the ledger, publish on their way, and mind each other by
their range rings alone. No two have one goal. Who has arrived, or gives up, stays where it is.
"""

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache, partial
from itertools import combinations
from math import ceil
from pathlib import Path
from time import perf_counter

import numpy as np
import pandas as pd

from vrchain.errors import MissionError
from vrchain.experiments.intervals import Bootstrap, table_of
from vrchain.experiments.kept import folder_of, kept_each
from vrchain.experiments.missions.chains import Views
from vrchain.experiments.missions.draw import Ground
from vrchain.experiments.scenes import Scenes, seed_of
from vrchain.geometry import Pose
from vrchain.landmarks.extraction.record import maker_of
from vrchain.navigation.goal.recognition import goal_from
from vrchain.navigation.mission import MissionResult, drive_mission
from vrchain.navigation.perception import learned_perception
from vrchain.navigation.settings import MissionConfig
from vrchain.panorama import CameraRig
from vrchain.reader import REMEMBERED, index_of, published_of
from vrchain.seeding import generator
from vrchain.simulation.collision_free import Array
from vrchain.simulation.goals import goal_pictures, pictured_share
from vrchain.simulation.mission import is_at
from vrchain.simulation.patrol import Patrol
from vrchain.simulation.simulator import Simulator
from vrchain.simulation.task import robot_names
from vrchain.simulation.team import assemble, team_ledger
from vrchain.simulation.together import Together
from vrchain.world.model import ROBOT_RADIUS_M
from vrchain.world.render import Renderer
from vrchain.world.truth import GroundTruth

SUBURBS = 10
NEAR_M = 0.3  # between the sides of two robots: a near miss
LIMIT_S = 1800.0  # of each robot: long enough to ask until when, not only whether
LOOKS_PER_S = 1 / 3  # at most, as a mission of 600 s has
_DRAWS = 200
_APART_M = 2.0  # at the start


@dataclass(frozen=True)
class Errand:
    """Where a robot starts, its goal, from where that is pictured, and the shortest free way."""

    pose: Pose
    goal: str
    goal_poses: tuple[Pose, ...]
    way_m: float


def draw(ground: Ground, seed: int, k: int, number: int, n_robots: int) -> dict[str, Errand]:
    """What each robot has to do, uniform as missions are. MissionError: there is no room for it."""
    names, (room, goals) = robot_names(n_robots), ground.room()
    draws, own = generator(seed, "team", k, number), seed_of(seed, k)
    for _ in range(_DRAWS):
        poses = [Pose(*map(float, stand)) for stand in ground.stands(draws, n_robots, room)]
        if any(a.distance_to_m(b.xy_m) < _APART_M for a, b in combinations(poses, 2)):
            continue
        views = Views(ground.truth, ground.rig, ground.free)
        left, errands = list(draws.permutation(goals)), dict[str, Errand]()
        for name, pose in zip(names, poses, strict=True):
            for target in map(int, left):
                if found := ground.within_reach(pose, target, own, room, views):
                    way_m, pictured = found
                    goal = ground.scene.objects[target].name
                    errands[name] = Errand(pose, goal, pictured, way_m)
                    left.remove(target)
                    break
        if len(errands) == n_robots:
            return errands
    raise MissionError(
        f"found no goals of their own for {n_robots} robots in {ground.scene.name}: "
        "try fewer robots, or another scene"
    )


def evaluate(
    scenes: Scenes, n_runs: int, n_robots: int, *, seed: int, folder: Path,
    patrol_s: float = 0.0, limit_s: float = LIMIT_S, jobs: int | None = 1,
) -> pd.DataFrame:  # fmt: skip
    """One row a run and robot, by turns in ten suburbs; what is under ``folder`` is read.

    patrol_s: for how long all drive about and publish before. limit_s: who has not arrived then
    gives up. Columns: suburb, run, robot, arrived (by its own word), success, reason, seconds,
    driven_m, way_m, collisions, log (its decisions), and of the run: near_misses, nearest_m between
    two robots' sides, published, wall_s.
    """
    robot_names(n_robots)  # refused before a scene is built
    if n_runs < 1 or not 0 <= patrol_s < np.inf or not 0 < limit_s < np.inf:
        raise MissionError(
            "expected 1 run or more, seconds of patrol and more than 0 seconds for each robot, "
            f"got {n_runs}, {patrol_s} and {limit_s}"
        )
    config = MissionConfig(limit_s=limit_s, max_looks=ceil(limit_s * LOOKS_PER_S))
    where = folder_of(folder, scenes, n_robots, seed, patrol_s, repr(config), maker_of())
    files = [where / f"run_{number:04d}.json" for number in range(n_runs)]
    run = partial(_run, scenes, seed, n_robots, patrol_s, config)
    found = kept_each(run, files, jobs, "runs")
    return pd.DataFrame([row for rows in found for row in rows])


def _run(
    scenes: Scenes, seed: int, n_robots: int, patrol_s: float, config: MissionConfig, number: int
) -> list[dict[str, object]]:
    began_s, k = perf_counter(), number % SUBURBS if scenes.varied else 0
    scene, rig = scenes.scene(seed, k), CameraRig()
    ground = Ground(scene, GroundTruth(scene), rig)
    errands = draw(ground, seed, k, number, n_robots)
    own = seed * 100_003 + number
    simulator = Simulator(scene, {n: e.pose for n, e in errands.items()}, seed=own, rig=rig)
    simulator.truth, simulator.renderer = ground.truth, Renderer(scene)
    together, perception = Together(simulator), learned_perception()
    with (
        tempfile.TemporaryDirectory() as kept,
        team_ledger(Path(kept) / "ledger", errands, own) as ledger,
    ):
        robots = assemble(simulator, ledger, own, examine=perception.record, body_of=together.body)
        for robot in robots.values():
            robot.observe(look=True)
        Patrol(simulator, robots, own).drive(patrol_s)
        first = len(simulator.times_s) - 1
        bumped = {name: simulator.collisions(name) for name in robots}
        way_m = {
            name: ground.way_m(simulator.pose(name), e.goal, e.goal_poses)
            for name, e in errands.items()
        }
        # what one has worked out the others need not, but each has its own budget for it
        shared = replace(perception, stored=cache(perception.stored),
                         compare=cache(perception.compare))  # fmt: skip

        def drive(name: str) -> tuple[MissionResult, int]:
            e, index = errands[name], index_of(ledger, shared)
            known = published_of(ledger, name, REMEMBERED, memory=patrol_s > 0)
            pictures = goal_pictures(scene, simulator.renderer, e.goal, e.goal_poses, rig)
            shown = goal_from(pictures, share=pictured_share(scene, e.goal, e.goal_poses))
            result = drive_mission(name, robots[name], known, index, shown, perception, config)
            return result, simulator.clock_ns

        found = together.run({name: partial(drive, name) for name in robots})
        published = sum(len(ledger.history(name)) for name in ledger.robots)
    paths = {name: simulator.path_xy_m(name)[first:] for name in errands}
    nearest_m, near = _nearness(list(paths.values()))
    began_ns = round(simulator.times_s[first] * 1e9)
    rows = []
    for name, (result, ended_ns) in found.items():
        at_goal, _ = is_at(scene, simulator.truth, errands[name].goal, simulator.pose(name), rig)
        rows.append({
            "suburb": k if scenes.varied else number, "run": number, "robot": name,
            "arrived": result.arrived, "success": result.arrived and at_goal,
            "reason": result.reason, "seconds": (ended_ns - began_ns) / 1e9,
            "driven_m": float(np.hypot(*np.diff(paths[name], axis=0).T).sum()),
            "way_m": way_m[name], "collisions": simulator.collisions(name) - bumped[name],
            "near_misses": near, "nearest_m": nearest_m, "published": published,
            "wall_s": perf_counter() - began_s, "log": [asdict(d) for d in result.decisions],
        })  # fmt: skip
    return rows


def _nearness(paths_xy_m: Sequence[Array]) -> tuple[float, int]:
    """How near two robots came, side to side, and how often two came nearer than ``NEAR_M``."""
    nearest_m, near = np.inf, 0
    for a, b in combinations(paths_xy_m, 2):
        apart_m = np.hypot(*(a - b).T) - 2 * ROBOT_RADIUS_M
        nearest_m = min(nearest_m, float(apart_m.min()))
        within = apart_m < NEAR_M
        near += int(within[0]) + int((within[1:] & ~within[:-1]).sum())
    return nearest_m, near


def summarise(table: pd.DataFrame) -> dict[str, dict[str, object]]:
    """The figures, under ``team``, with 95 % intervals under NAME_ci: bootstrap over suburbs.

    Over runs: all_arrived, the share in which every robot reached its goal, and all_600s, within a
    mission's usual 600 s; all_s, the mean of the seconds until the last did, of those in which all
    did; near_misses, nearest_m, published, wall_s. Over robots: success, seconds, driven_over_way.
    Counts: runs, robots, false_arrivals, collisions.
    """
    told = Bootstrap(table.suburb, "team")
    runs = table.groupby("run").agg(
        suburb=("suburb", "first"), all_arrived=("success", "all"), last_s=("seconds", "max"),
        near_misses=("near_misses", "first"), nearest_m=("nearest_m", "min"),
        published=("published", "first"), wall_s=("wall_s", "first"),
    )  # fmt: skip
    whole = runs[runs.all_arrived]
    success = table.success.astype(bool)
    drove = success & (table.way_m > 0)  # after a patrol a robot may stand at its goal
    found: dict[str, object] = {
        "runs": len(runs),
        "robots": len(table) // len(runs),
        **told.share("all_arrived", runs.all_arrived.astype(float), runs.suburb),
        **told.share("all_600s", (runs.all_arrived & (runs.last_s <= 600)).astype(float),
                     runs.suburb),
        **told.mean("all_s", whole.last_s, whole.suburb),
        **told.share("success", success.astype(float), table.suburb, len(runs)),
        **told.mean("seconds", table.seconds[success], table.suburb[success]),
        **told.mean("driven_over_way", (table.driven_m / table.way_m)[drove], table.suburb[drove]),
        "false_arrivals": int((table.arrived.astype(bool) & ~success).sum()),
        "collisions": int(table.collisions.sum()),
        "nearest_m": float(runs.nearest_m.min()),
    }  # fmt: skip
    found |= {name: float(runs[name].mean()) for name in ("near_misses", "published", "wall_s")}
    return {"team": found}


def as_table(summary: Mapping[str, Mapping[str, object]]) -> str:
    """The figures to read."""
    names = (
        "runs", "robots", "all_arrived", "all_600s", "all_s", "success", "seconds",
        "driven_over_way", "false_arrivals", "collisions", "near_misses", "nearest_m",
        "published", "wall_s",
    )  # fmt: skip
    return str(table_of(summary, names, "team", ".2f").T.to_string())

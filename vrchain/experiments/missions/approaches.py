"""From where it sees its goal, does a robot get there? The last part of each mission, alone.

A robot that knows its goal by pictures stands 8 to 20 m from it, and has neither a ledger nor a
team. Hundreds take as long as a few missions: what ends falsely once in hundreds shows here.
"""

from collections.abc import Mapping
from pathlib import Path
from time import perf_counter

import numpy as np
import pandas as pd
import shapely

from vrchain.experiments.intervals import Bootstrap, table_of
from vrchain.experiments.missions.draw import Ground
from vrchain.experiments.missions.goals import by_suburb
from vrchain.experiments.scenes import Scenes, seed_of
from vrchain.geometry import Pose
from vrchain.landmarks.retrieval.index import LandmarkIndex
from vrchain.navigation.goal.recognition import goal_from
from vrchain.navigation.mission import drive_mission
from vrchain.navigation.perception import learned_perception
from vrchain.navigation.settings import MissionConfig
from vrchain.panorama import CameraRig
from vrchain.seeding import generator
from vrchain.simulation.goals import GOAL_PICTURES, goal_pictures, goal_poses, pictured_share
from vrchain.simulation.mission import is_at
from vrchain.simulation.simulator import Simulator
from vrchain.simulation.team import SimulatedBody
from vrchain.world.render import Renderer
from vrchain.world.truth import GroundTruth

RANGE_M = 8.0, 20.0  # from the goal's side, or as much less as the goal is pictured from nearer
LIMIT_S = 120.0
_STANDS = 40  # at most, until the goal is seen from one


def evaluate(
    scenes: Scenes, n_suburbs: int, n_goals: int, *, seed: int, folder: Path, jobs: int | None = 1
) -> pd.DataFrame:
    """One row an approach; what is under ``folder`` is read.

    n_goals: of each suburb, at most. Columns: suburb, goal, from_m (its side, at the start),
    pictured_off (of each picture the log of how many times as far from there it seems to be taken),
    at_once (whether it was driven to by the first look), arrived (by its own word), success,
    range_m (from its side, at the end), seconds, collisions, wall_s. Suburbs and MissionError as of
    ``goals.evaluate``.
    """
    return by_suburb(_rows, scenes, n_suburbs, n_goals, seed, folder, jobs)


def summarise(found: pd.DataFrame) -> dict[str, dict[str, object]]:
    """The figures, under ``approach``, with 95 % intervals under NAME_ci: bootstrap over suburbs.

    success, at_once: shares; seconds: the mean, of those that succeed; counts of approaches, false
    arrivals and collisions; pictured_off: root mean square.
    """
    told, success = Bootstrap(found.suburb, "approaches"), found.success.astype(bool)
    return {
        "approach": {
            "approaches": len(found),
            **told.share("success", success.astype(float), found.suburb),
            **told.share("at_once", found.at_once.astype(float), found.suburb),
            **told.mean("seconds", found.seconds[success], found.suburb[success]),
            "false_arrivals": int((found.arrived.astype(bool) & ~success).sum()),
            "collisions": int(found.collisions.sum()),
            "pictured_off": float((np.stack([*found.pictured_off]) ** 2).mean() ** 0.5),
            "wall_s": float(found.wall_s.mean()),
        }
    }


def as_table(summary: Mapping[str, Mapping[str, object]]) -> str:
    """The figures to read."""
    names = [n for n in summary["approach"] if not n.endswith("_ci")]
    return str(table_of(summary, names, "approach", ".2f").T.to_string())


def _rows(scenes: Scenes, seed: int, n_goals: int, k: int) -> list[dict[str, object]]:
    scene, rig = scenes.scene(seed, k), CameraRig()
    ground, renderer = Ground(scene, GroundTruth(scene), rig), Renderer(scene)
    draws, (room, goals) = generator(seed, "approaches", k), ground.room()
    rows: list[dict[str, object]] = []
    for goal in map(int, draws.permutation(goals)):
        if len(rows) == n_goals:
            break
        poses = tuple(goal_poses(scene, ground.truth, goal, seed_of(seed, k)))
        if len(poses) == GOAL_PICTURES:
            share = pictured_share(scene, scene.objects[goal].name, poses)
            start = _start(ground, room, goal, share, draws)
            if start is not None:
                own = int(draws.integers(2**31))
                rows.append(_drive(ground, renderer, goal, poses, start, share, own))
    return rows


def _start(
    ground: Ground, room: int, goal: int, share: float, draws: np.random.Generator
) -> Pose | None:
    """Where a robot stands that sees the goal; None if there is no such place."""
    places_m = ground.free.points_m[ground.free.region == room]
    footprint = ground.scene.objects[goal].footprint
    off_m = shapely.distance(footprint, shapely.points(places_m)) / share
    within_m = places_m[(off_m >= RANGE_M[0]) & (off_m <= RANGE_M[1])]
    for x_m, y_m in draws.permutation(within_m)[:_STANDS]:
        pose = Pose(float(x_m), float(y_m), float(draws.uniform(-np.pi, np.pi)))
        if ground.truth.sees(goal, pose, ground.rig):
            return pose
    return None


def _drive(
    ground: Ground, renderer: Renderer, goal: int, poses: tuple[Pose, ...], start: Pose,
    share: float, seed: int,
) -> dict[str, object]:  # fmt: skip
    began_s, scene, name = perf_counter(), ground.scene, ground.scene.objects[goal].name
    simulator = Simulator(scene, {"R1": start}, seed=seed, rig=ground.rig)
    simulator.truth, simulator.renderer = ground.truth, renderer
    perception = learned_perception()
    known = goal_from(goal_pictures(scene, renderer, name, poses, ground.rig), share=share)
    footprint, places = scene.objects[goal].footprint, shapely.points([p.xy_m for p in poses])
    off = np.log(known.taken_m / shapely.distance(footprint, places))
    result = drive_mission(
        "R1", SimulatedBody(simulator, "R1"), dict,
        LandmarkIndex(lambda digest: b"", lambda digest: None, perception.stored,
                      perception.compare),
        known,
        perception, MissionConfig(limit_s=LIMIT_S),
    )  # fmt: skip
    at_goal, range_m = is_at(scene, ground.truth, name, simulator.pose("R1"), ground.rig)
    return {
        "goal": name,
        "from_m": float(footprint.distance(shapely.Point(*start.xy_m))),
        "pictured_off": off.tolist(),
        "at_once": result.decisions[0].what == "approach",
        "arrived": result.arrived,
        "success": bool(result.arrived and at_goal),
        "range_m": float(range_m),
        "seconds": simulator.clock_ns / 1e9,
        "collisions": simulator.collisions("R1"),
        "wall_s": perf_counter() - began_s,
    }

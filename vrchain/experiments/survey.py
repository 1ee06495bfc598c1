"""Robots wander through a scene and publish by the paper's three rules: positions for a ledger."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import pandas as pd
from tqdm.auto import tqdm

from vrchain.errors import MissionError
from vrchain.experiments.team import assemble
from vrchain.geometry import Pose
from vrchain.ledger import Ledger, simulated_key
from vrchain.panorama import CameraRig
from vrchain.robot import UpdateRules, Wander, wander
from vrchain.scene.model import Scene
from vrchain.seeding import generator
from vrchain.simulator import Simulator

_TICK_S = 0.5
_START_SPACING_M = 8.0
_CLEARANCE_M = 2.0
_MAX_TICKS_A_POSITION = 400


def survey(
    scene: Scene,
    ledger_folder: Path,
    n_positions: int,
    *,
    seed: int = 0,
    robots: Sequence[str] = ("R1", "R2"),
    rig: CameraRig | None = None,
    rules: UpdateRules | None = None,
) -> pd.DataFrame:
    """Drive until the ledger holds ``n_positions`` transactions of ``robots``.

    One row a position, in the order of the ledger: see ``team.Publication``. MissionError if the
    robots get nowhere.
    """
    simulator = Simulator(scene, start_poses(scene, robots, seed), seed=seed, rig=rig)
    members = {name: simulated_key(seed, name).public for name in robots}
    draws = {name: generator(seed, "wander", name) for name in robots}
    minds = dict.fromkeys(robots, Wander())
    rows: list[dict] = []
    with (
        Ledger.create(ledger_folder, members, simulated_key(seed, "operator")) as ledger,
        tqdm(total=n_positions, desc="positions", unit="", disable=None) as progress,
    ):
        team = assemble(simulator, ledger, seed, rules)
        for _ in range(_MAX_TICKS_A_POSITION * n_positions):
            commands = {}
            for name, robot in team.items():
                before = len(robot.publications)
                seen = robot.watch()
                for publication in robot.publications[before:]:
                    rows.append(asdict(publication))
                    progress.update()
                if len(rows) == n_positions:
                    return pd.DataFrame(rows)
                commands[name], minds[name] = wander(seen, draws[name], minds[name])
            simulator.step(commands, _TICK_S)
    raise MissionError(f"only {len(rows)} of {n_positions} positions were reached: no way on")


def start_poses(scene: Scene, robots: Sequence[str], seed: int) -> dict[str, Pose]:
    """Free places for robots, 8 m and more apart; MissionError if the scene has no room."""
    draws = generator(seed, "survey")
    half = [e / 2 for e in scene.extent_m]
    poses: dict[str, Pose] = {}
    for _ in range(10_000):
        x_m, y_m = (float(draws.uniform(-h, h)) for h in half)
        pose = Pose(x_m, y_m, float(draws.uniform(-3.14, 3.14)))
        apart = all(pose.distance_to_m(p.xy_m) >= _START_SPACING_M for p in poses.values())
        if apart and scene.is_free([pose.xy_m], _CLEARANCE_M)[0]:
            poses[robots[len(poses)]] = pose
        if len(poses) == len(robots):
            return poses
    raise MissionError(f"the scene has no room for {len(robots)} robots {_START_SPACING_M:g} m apart")

"""A survey: robots wander through a scene and publish by the update rules, so many positions."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pandas as pd
from tqdm.auto import tqdm

from vrchain.errors import MissionError
from vrchain.geometry import Pose
from vrchain.panorama import CameraRig
from vrchain.robot import UpdateRules, Wander, wander
from vrchain.seeding import generator
from vrchain.simulation.simulator import Simulator
from vrchain.simulation.team import assemble, team_ledger
from vrchain.world.model import Scene

_TICK_S = 0.5
_START_SPACING_M = (8.0, 20.0)  # a team starts within sight of each other
_DRAWS = 200
_CLEARANCE_M = 2.0
_MAX_TICKS_A_POSITION = 400


def survey(
    scene: Scene,
    ledger_folder: str | Path,
    n_positions: int,
    *,
    seed: int = 0,
    robots: Sequence[str] = ("R1", "R2"),
    rig: CameraRig | None = None,
    rules: UpdateRules | None = None,
) -> pd.DataFrame:
    """Drive until the ledger holds ``n_positions`` transactions, as many of each robot.

    A robot that has published its share stands still. One row a position, in the order of the
    ledger: see ``team.LocatedPublication``. MissionError if the robots get nowhere, or if the
    positions cannot be shared out evenly.
    """
    if not robots or len(set(robots)) < len(robots):
        raise MissionError(
            f"expected names of robots, each once, got {', '.join(robots) or 'none'}"
        )
    share, rest = divmod(n_positions, len(robots))
    if rest or share < 1:
        raise MissionError(f"{n_positions} positions cannot be shared out to {len(robots)} robots")
    simulator = Simulator(scene, start_poses(scene, robots, seed), seed=seed, rig=rig)
    draws = {name: generator(seed, "wander", name) for name in robots}
    minds = dict.fromkeys(robots, Wander())
    rows: list[dict] = []
    with (
        team_ledger(ledger_folder, robots, seed) as ledger,
        tqdm(total=n_positions, desc="positions", unit="", disable=None) as progress,
    ):
        team = assemble(simulator, ledger, seed, rules)
        for _ in range(_MAX_TICKS_A_POSITION * n_positions):
            commands = {}
            for name, robot in team.items():
                before = len(robot.publications)
                if before == share:
                    continue
                seen = robot.watch()
                for publication in robot.publications[before:]:
                    rows.append(asdict(publication))
                    progress.update()
                commands[name], minds[name] = wander(seen, draws[name], minds[name])
            if len(rows) == n_positions:
                return pd.DataFrame(rows)
            simulator.step(commands, _TICK_S)
    raise MissionError(f"only {len(rows)} of {n_positions} positions were reached: no way on")


def start_poses(scene: Scene, robots: Sequence[str], seed: int) -> dict[str, Pose]:
    """Free places for a team: 8 m and more apart, none over 20 m from the first robot.

    MissionError if the scene has no room.
    """
    draws = generator(seed, "survey")
    half = np.array(scene.extent_m) / 2
    for _ in range(_DRAWS):
        xy_m = draws.uniform(-half, half)
        placed: list[Pose] = []
        for _ in range(_DRAWS):
            pose = Pose(float(xy_m[0]), float(xy_m[1]), float(draws.uniform(-np.pi, np.pi)))
            apart = all(pose.distance_to_m(p.xy_m) >= _START_SPACING_M[0] for p in placed)
            if apart and scene.is_free([pose.xy_m], _CLEARANCE_M)[0]:
                placed.append(pose)
            if len(placed) == len(robots):
                return dict(zip(robots, placed, strict=True))
            if not placed:
                break  # not a free place for the first robot
            course = draws.uniform(-np.pi, np.pi)
            reach = draws.uniform(*_START_SPACING_M) * np.array([np.cos(course), np.sin(course)])
            xy_m = placed[0].xy_m + reach
    low, high = _START_SPACING_M
    raise MissionError(f"the scene has no room for {len(robots)} robots {low:g}-{high:g} m apart")

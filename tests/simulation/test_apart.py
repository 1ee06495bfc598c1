"""Robots of a team, each by itself: what comes of them is what comes of one process."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from clusters import skip_without_servers
from hamlet import GOAL, hamlet
from ledgers import ROOT
from sights import RIG
from typer.testing import CliRunner

from vrchain.cli import app
from vrchain.errors import MissionError
from vrchain.ledger import Ledger, simulated_key, verify
from vrchain.navigation.settings import MissionConfig
from vrchain.simulation.apart import run_apart
from vrchain.simulation.mission import run_mission
from vrchain.simulation.team import team_ledger

TASK = {"seed": 2, "n_robots": 2, "goal": GOAL, "rig": RIG, "config": MissionConfig(limit_s=240.0)}


def published(folder: Path) -> dict[str, list[tuple[bytes, bytes, int, str]]]:
    with Ledger.open(folder) as ledger:
        return {
            robot: [
                (t.payload_digest, t.landmarks_digest, t.timestamp_ns, t.reason)
                for t in ledger.history(robot)
            ]
            for robot in ledger.robots
        }


def test_a_mission_in_parts_is_the_mission(tmp_path: Path) -> None:
    whole = run_mission(hamlet(), tmp_path / "whole", **TASK)
    parts = {}
    with team_ledger(tmp_path / "parts", ("R1", "R2"), 2) as ledger:
        for robot in ("R2", "R1"):
            key = simulated_key(2, robot)
            body, parts[robot] = run_apart(hamlet(), ledger, robot, key, **TASK)
            assert {p.robot for p in body.publications} == {robot}
    assert parts["R2"] is None and parts["R1"] is not None
    assert parts["R1"].result.decisions == whole.result.decisions
    assert parts["R1"].summary() | {"head": ""} == whole.summary() | {"head": ""}
    assert published(tmp_path / "parts") == published(tmp_path / "whole")
    assert verify(tmp_path / "parts").ok


@pytest.mark.parametrize(
    ("robot", "complaint"),
    [("R7", "no robot 'R7'; expected one of R1, R2"), ("R1", "R2 published nothing .* within 0 s")],
)
def test_who_is_alone_says_so(robot: str, complaint: str, tmp_path: Path) -> None:
    with (
        team_ledger(tmp_path / "ledger", ("R1", "R2"), 2) as ledger,
        pytest.raises(MissionError, match=complaint),
    ):
        run_apart(hamlet(), ledger, robot, simulated_key(2, robot), **TASK, wait_s=0.0)


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        ([], "either --ros or --scene"),
        (["--ros", "--scene", "scenes/barn.yaml"], "either --ros or --scene"),
        (["--scene", "scenes/barn.yaml", "--goal", "a", "--goal", "b"], "one --goal .* got 2"),
        (["--scene", "scenes/barn.yaml", "-o", "log"], "-o with the robot that is sent, R1, got"),
        (
            ["--scene", "scenes/barn.yaml", "--ledger", "log/ledger", "-o", "log"],
            "which is replaced",
        ),
    ],
)
def test_options_that_do_not_go_together(words: list[str], complaint: str, tmp_path: Path) -> None:
    asked = ["robot", "run", "--ledger", str(tmp_path), "--robot", "R2", "--simulated", "0"]
    result = CliRunner().invoke(app, [*asked, *words])
    with pytest.raises(Exception, match=complaint):
        raise result.exception or AssertionError(result.output)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_the_barns_mission_by_a_process_a_robot_over_three_servers(tmp_path: Path) -> None:
    """Servers, a maker and three robots, by the commands that the how-to names."""
    skip_without_servers()

    def vrchain(*words: str) -> dict:
        said = start(*words).communicate(timeout=1800)[0]
        return json.loads(said)

    def start(*words: str) -> "subprocess.Popen[str]":
        command = [sys.executable, "-m", "vrchain", *words, "--json"]
        return subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True)

    keys, robots = str(tmp_path / "keys"), ("R1", "R2", "R3")
    members = [word for name in (*robots, "M") for word in ("--member", name)]
    vrchain("ledger", "init", str(tmp_path / "team"), *members, "--keys", keys)
    address = vrchain("cluster", "up", "--nodes", "3", "-o", str(tmp_path / "servers"))["address"]
    running = []
    try:
        vrchain("cluster", "put", str(tmp_path / "team"), address, "--keys", keys, "--anonymous")
        maker = ["--folder", str(tmp_path / "M"), "--robot", "M", "--keys", keys, "--anonymous"]
        running.append(start("cluster", "make", address, *maker))
        for robot in robots:
            words = ["--scene", "scenes/barn.yaml", "--robot", robot, "--ledger", address]
            words += ["--folder", str(tmp_path / robot), "--keys", keys]
            words += ["-o", str(tmp_path / "log")] if robot == "R1" else []
            running.append(start("robot", "run", *words))
        told = [json.loads(child.communicate(timeout=1800)[0]) for child in running[1:]]
    finally:
        for child in running:
            child.kill()
            child.wait()
        vrchain("cluster", "down", "-o", str(tmp_path / "servers"))
    whole = vrchain("navigate", "scenes/barn.yaml", "-o", str(tmp_path / "whole"))
    assert told[0]["mission"] | {"head": ""} == whole | {"head": ""}
    logs = [(tmp_path / name / "decisions.jsonl").read_bytes() for name in ("log", "whole")]
    assert logs[0] == logs[1]
    alone = published(tmp_path / "whole" / "ledger")
    assert published(tmp_path / "R1") == {**alone, "M": []}
    assert all(verify(tmp_path / robot).ok for robot in robots)

"""Who sees a goal, asked of a ledger of panoramas without a mission."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from vrchain.cli import app
from vrchain.cli.ledger_panoramas import plan_lines
from vrchain.geometry import Pose
from vrchain.ledger import simulated_key
from vrchain.panorama import CameraRig
from vrchain.paths import SCENES
from vrchain.simulation.team import team_ledger
from vrchain.world import load_scene
from vrchain.world.render import Renderer

HERE, GOAL = Pose(-6.0, -12.0, 0.3), Pose(5.0, -11.0, 0.5)
STOOD = {"R2": Pose(-2.0, -11.0, 0.1), "R3": Pose(2.0, -12.0, 0.4)}
RIG = CameraRig(width_px=320, height_px=240)


def asked(*words: object) -> str:
    done = CliRunner().invoke(app, ["ledger", "route", *map(str, words)])
    return done.output + str(done.exception or "")


@pytest.fixture(scope="module")
def barnyard(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A ledger of R2 and R3, who stand between two panoramas, here and goal."""
    pytest.importorskip("torch", reason="proposals need torch (extra `learned`)")
    folder, renderer = (
        tmp_path_factory.mktemp("barnyard"),
        Renderer(load_scene(SCENES / "barn.yaml")),
    )
    for name, pose in (("here", HERE), ("goal", GOAL)):
        (folder / name).mkdir()
        renderer.render(pose, RIG).save(folder / name)
    with team_ledger(folder / "team", [*STOOD, "R4"], 1) as ledger:
        for name, pose in STOOD.items():
            panorama = renderer.render(pose, RIG).encode()
            ledger.publish(name, simulated_key(1, name), panorama, "start", 1)
    return folder


def test_a_ledger_tells_who_sees_a_place_and_the_way_there(barnyard: Path) -> None:
    found = json.loads(asked(barnyard / "team", barnyard / "here", barnyard / "goal", "--json"))
    there = found["seen_by"]["R3"]["from_here"]
    assert there["range_m"] == pytest.approx(HERE.distance_to_m(GOAL.xy_m), rel=0.2)
    assert there["bearing_deg"] == pytest.approx(np.degrees(HERE.bearing_to_rad(GOAL.xy_m)), abs=10)
    legs = found["legs"]
    assert legs[0]["seen_by"] == "(here)" and legs[-1]["next_by"] in found["seen_by"]
    shared = {frozenset((row["a"], row["b"])) for row in found["graph"]}
    assert all(frozenset((leg["seen_by"], leg["next_by"])) in shared for leg in legs)
    *sights, chain, first = plan_lines(found | {"legs": legs[:1]})
    assert sum("shows it with a chance of" in line for line in sights) == len(found["seen_by"])
    assert chain.startswith("route: (here) - R") and "by landmark N" in first
    legs[0]["bearing_deg"] = None
    assert plan_lines(found | {"legs": legs[:1]})[-1].endswith("by the way that it drove")


def test_what_cannot_be_asked_is_told(barnyard: Path) -> None:
    here, goal = barnyard / "here", barnyard / "goal"
    with team_ledger(barnyard / "nobody", ["R2"], 1):
        pass
    told = asked(barnyard / "nobody", here, goal)
    assert "no route: the ledger holds no panorama of another robot" in told
    assert "expected as goal one panorama" in asked(barnyard / "team", here, goal, goal)
    assert "none is no panorama" in asked(barnyard / "team", here, barnyard / "none")
    for unknown in ("R2~x", "R5"):
        assert f"{unknown} is no panorama" in asked(barnyard / "team", here, unknown)
    assert "R3, who published 1, got R3~1" in asked(barnyard / "team", "R2", "R3~1")

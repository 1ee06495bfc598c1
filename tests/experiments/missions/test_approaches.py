"""Approaches alone: the figures of a made-up table, and one that is truly driven."""

import json
from pathlib import Path

import pandas as pd
import pytest

from vrchain.cli import app
from vrchain.errors import MissionError
from vrchain.experiments.missions import approaches
from vrchain.experiments.missions.approaches import LIMIT_S, RANGE_M, as_table, evaluate, summarise
from vrchain.experiments.scenes import scenes_of
from vrchain.paths import SCENES

BARN = SCENES / "barn.yaml"


def ended(suburb: int, arrived: bool, success: bool, seconds: float) -> dict[str, object]:
    return {
        "suburb": suburb, "goal": "house_1", "from_m": 9.0, "at_once": arrived, "arrived": arrived,
        "success": success, "range_m": 1.0, "seconds": seconds, "collisions": 1, "wall_s": 4.0,
        "pictured_off": [0.1, -0.1, 0.1, -0.1],
    }  # fmt: skip


def test_figures_are_those_of_the_table() -> None:
    """Of four that say so three are there; who never says so arrives neither truly nor falsely."""
    ends = [(True, True, 20.0), (True, True, 30.0), (True, True, 40.0), (True, False, 9.0)]
    ends += [(False, False, LIMIT_S)] * 2
    found = summarise(pd.DataFrame([ended(k % 2, *end) for k, end in enumerate(ends)]))["approach"]
    assert (found["approaches"], found["false_arrivals"], found["collisions"]) == (6, 1, 6)
    assert found["success"] == 0.5 and found["at_once"] == pytest.approx(4 / 6)
    assert found["seconds"] == 30.0 and found["pictured_off"] == pytest.approx(0.1)
    assert "false_arrivals" in as_table({"approach": found})


def test_nothing_asked_for_is_refused(tmp_path: Path) -> None:
    for n_suburbs, n_goals in ((0, 1), (1, 0)):
        with pytest.raises(MissionError, match="1 suburb and goal or more"):
            evaluate(scenes_of(BARN), n_suburbs, n_goals, seed=3000, folder=tmp_path)


def test_a_robot_that_sees_its_goal_gets_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    command = ["evaluate", "approaches", str(BARN), "--suburbs", "1", "--goals", "1"]
    app([*command, "--jobs", "1", "--json", "-o", str(tmp_path)], standalone_mode=False)
    found = json.loads(capsys.readouterr().out)["approach"]
    assert (found["approaches"], found["success"], found["collisions"]) == (1, 1.0, 0)
    assert 0 < found["pictured_off"] < 0.15
    monkeypatch.setattr(approaches, "Simulator", None)  # nothing is left to do
    (row,) = evaluate(scenes_of(BARN), 1, 1, seed=3000, folder=tmp_path).itertuples()
    assert RANGE_M[0] <= row.from_m <= RANGE_M[1] and row.range_m < 3.0
    assert row.seconds == found["seconds"]

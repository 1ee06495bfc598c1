"""Missions of the experiment, driven with true landmarks: no network, so that they are quick."""

import json
from pathlib import Path

import pandas as pd
import pytest
from hamlet import the_hamlet
from sights import RIG

from vrchain.errors import MissionError
from vrchain.experiments import missions, navigation
from vrchain.experiments.missions import Mission
from vrchain.experiments.navigation import evaluate
from vrchain.experiments.scenes import Scenes
from vrchain.navigation.terms import MissionConfig
from vrchain.scene.model import Scene

HAMLET = Scenes(the_hamlet, "hamlet", varied=False)
SHORT = MissionConfig(limit_s=150.0)


@pytest.fixture(autouse=True)
def _short_ways(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(missions, "WAY_M", (12.0, 60.0))


def oracle(folder: Path, jobs: int = 1) -> tuple[pd.DataFrame, list[Mission]]:
    return evaluate(
        HAMLET, 2, 4, ["oracle"], seed=3, folder=folder, rig=RIG, config=SHORT, patrol_s=20.0,
        jobs=jobs,
    )  # fmt: skip


def test_by_true_landmarks_robots_arrive_and_a_rerun_drives_nothing_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    table, drawn = oracle(tmp_path)
    assert list(table.mission) == [0, 1] and set(table.arm) == {"oracle"}
    assert table.success.all() and table.arrived.all(), table.reason.to_list()
    assert (table.collisions == 0).all()
    assert (table.driven_m > 0).all() and (table.range_m <= 3.0).all()
    assert (table.seconds_simulated <= SHORT.limit_s + 1).all()
    assert (table.published > 6).all()  # three others, who drove about and published again
    monkeypatch.setattr(navigation, "Suburb", None)  # nothing is left to do
    again, same = oracle(tmp_path)
    pd.testing.assert_frame_equal(table, again)
    assert same == drawn
    stored = [json.loads(f.read_text()) for f in sorted(tmp_path.rglob("*_oracle.json"))]
    assert all(s["log"][-1]["what"] == "arrived" for s in stored)


@pytest.mark.slow
def test_two_processes_at_once_find_the_same(tmp_path: Path) -> None:
    table, drawn = oracle(tmp_path / "one")
    for file in (tmp_path / "one").glob("*/mission_*.json"):  # drawn by shorter ways, see above
        copy = tmp_path / "two" / file.relative_to(tmp_path / "one")
        copy.parent.mkdir(parents=True, exist_ok=True)
        copy.write_bytes(file.read_bytes())
    again, same = oracle(tmp_path / "two", jobs=2)
    pd.testing.assert_frame_equal(table.drop(columns="wall_s"), again.drop(columns="wall_s"))
    assert same == drawn


def test_to_a_place_robots_arrive_within_a_metre(tmp_path: Path) -> None:
    table, drawn = evaluate(
        HAMLET, 1, 4, ["oracle"], seed=3, folder=tmp_path, rig=RIG, config=SHORT, to_places=True,
        patrol_s=20.0,
    )  # fmt: skip
    assert drawn[0].goal == missions.PLACE
    assert table.success.all() and (table.range_m <= 1.0).all(), table.reason.to_list()
    assert (table.collisions == 0).all()


@pytest.mark.parametrize(
    ("n", "n_robots", "arm", "refusal"),
    [
        (0, 4, "oracle", "expected 1 mission or more"),
        (1, 4, "magic", "and arms of ledger, alone, oracle, got 1 and magic"),
        (1, 1, "oracle", "expected 2 to 20 robots, got 1"),
    ],
)
def test_what_cannot_be_asked(
    n: int, n_robots: int, arm: str, refusal: str, tmp_path: Path
) -> None:
    def unbuilt(seed: int, k: int) -> Scene:
        raise AssertionError("refused before a scene is built")

    with pytest.raises(MissionError, match=refusal):
        evaluate(Scenes(unbuilt, ""), n, n_robots, [arm], seed=3, folder=tmp_path)
    assert not any(tmp_path.iterdir())

"""Missions of the experiment, driven with true landmarks: no network, so that they are quick."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from blind import Nowhere, blind
from hamlet import the_hamlet
from sights import RIG

from vrchain.experiments.missions import draw, drive, success
from vrchain.experiments.missions.chains import PLACE, TrueChain
from vrchain.experiments.missions.draw import Mission
from vrchain.experiments.missions.drive import Conditions
from vrchain.experiments.missions.success import (
    MEANS,
    as_table,
    evaluate,
    looking_s,
    routes_of,
    routes_table,
    summarise,
)
from vrchain.experiments.scenes import Scenes
from vrchain.geometry import Pose
from vrchain.navigation.settings import MissionConfig
from vrchain.simulation.simulator import Simulator
from vrchain.world.render import Renderer

HAMLET = Scenes(the_hamlet, "hamlet", varied=False)
SHORT = Conditions(20.0, config=MissionConfig(limit_s=150.0))


@pytest.fixture(autouse=True)
def _short_ways(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(draw, "WAY_M", (12.0, 60.0))


def oracle(folder: Path, jobs: int = 1) -> tuple[pd.DataFrame, list[Mission]]:
    return evaluate(
        HAMLET, 2, 4, ["oracle"], seed=3, folder=folder, rig=RIG, conditions=SHORT, jobs=jobs
    )  # fmt: skip


def test_by_true_landmarks_robots_arrive_and_a_rerun_drives_nothing_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    table, drawn = oracle(tmp_path)
    assert list(table.mission) == [0, 1] and set(table.arm) == {"oracle"}
    assert table.success.all() and table.arrived.all(), table.reason.to_list()
    assert (table.collisions == 0).all()
    assert (table.driven_m > 0).all() and (table.range_m <= 3.0).all()
    assert (table.seconds_simulated <= SHORT.config.limit_s + 1).all()
    assert (table.published > 6).all()  # three others, who drove about and published again
    assert (table.ledger_mb > 0).all() and (table.ledger_mb < table.broadcast_mb).all()
    monkeypatch.setattr(success, "Suburb", None)  # nothing is left to do
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
        HAMLET, 1, 4, ["oracle"], seed=3, folder=tmp_path, rig=RIG, conditions=SHORT,
        to_places=True,
    )  # fmt: skip
    assert drawn[0].goal == PLACE
    assert table.success.all() and (table.range_m <= 1.0).all(), table.reason.to_list()
    assert (table.collisions == 0).all()


def test_alone_there_is_no_ledger_and_the_others_stand_and_all_else_is_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    simulators: list[Simulator] = []

    def simulator(*args: Any, **options: Any) -> Simulator:
        simulators.append(Simulator(*args, **options))
        return simulators[-1]

    monkeypatch.setattr(drive, "Simulator", simulator)
    monkeypatch.setattr(drive, "learned_perception", blind)
    nowhere = Nowhere()
    monkeypatch.setattr(drive.Suburb, "_goal", lambda *mission: nowhere)
    table, (drawn,) = evaluate(
        HAMLET, 1, 4, ["ledger", "alone"], seed=3, folder=tmp_path, rig=RIG,
        conditions=Conditions(20.0, config=MissionConfig(limit_s=15.0)),
    )  # fmt: skip
    ways, whys = [], []
    for arm, world in zip(table.arm, simulators, strict=True):
        path_m = {name: world.path_xy_m(name) for name in drawn.poses}
        assert all((path_m[n][0] == pose.xy_m).all() for n, pose in drawn.poses.items())
        steps_m = {n: np.hypot(*np.diff(p, axis=0).T) for n, p in path_m.items()}
        sets_out = int((steps_m["R1"] > 0).argmax())
        ways.append({n: (m[:sets_out].sum(), m[sets_out:].sum()) for n, m in steps_m.items()})
        (stored,) = tmp_path.rglob(f"*_{arm}.json")
        log = json.loads(stored.read_text())["log"]
        whys.append(next(d["why"] for d in log if d["what"] == "no route"))
    others = [name for name in drawn.poses if name != "R1"]
    assert all(min(ways[0][n]) > 3.0 and max(ways[1][n]) == 0.0 for n in others)  # and go on
    assert table.published[0] > len(others) and table.published[1] == 0
    assert whys == [
        "no other robot's panorama shows the goal",
        "the ledger holds no panorama of another robot",
    ]
    assert list(table.driven_m) == pytest.approx([w["R1"][1] for w in ways])
    assert (table.driven_m > 3.0).all()
    assert table.seconds_simulated.between(15.0, 16.0).all()  # the patrol is no part of it


def test_a_patrol_is_drawn_once_and_the_second_arm_drives_as_if_it_were_the_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(drive, "learned_perception", blind)
    nowhere = Nowhere()
    monkeypatch.setattr(drive.Suburb, "_goal", lambda *mission: nowhere)
    shown, render = list[Pose](), Renderer.render
    monkeypatch.setattr(
        Renderer, "render", lambda own, pose, *a: shown.append(pose) or render(own, pose, *a)
    )
    soon = Conditions(20.0, config=MissionConfig(limit_s=10.0))

    def driven(*arms: str) -> pd.DataFrame:
        shown.clear()
        folder = tmp_path / "-".join(arms)
        table, _ = evaluate(HAMLET, 1, 4, arms, seed=3, folder=folder, rig=RIG, conditions=soon)
        return table.drop(columns="wall_s")

    first, alone = driven("oracle"), len(shown)
    second = driven("ledger", "oracle")
    assert alone < len(shown) <= 2 * alone - 3  # three others looked before
    pd.testing.assert_frame_equal(second[1:].reset_index(drop=True), first)


# --- the figures, of rows made up for them ---


def mission(number: int, landmarks: int) -> Mission:
    chain = TrueChain(("R1",) * (landmarks + 1), ("tree",) * landmarks, 60.0)
    return Mission(
        number, "house", (), {"R1": Pose(0, 0)}, 50.0, chain if landmarks else None,
        {"way too long": 2},
    )  # fmt: skip


def row(number: int, arm: str, success: bool, arrived: bool | None = None) -> dict:
    return {
        "suburb": number // 2, "mission": number, "arm": arm,
        "arrived": success if arrived is None else arrived, "success": success, "reason": "",
        "range_m": 1.0, "driven_m": 100.0, "way_m": 50.0, "chain": number % 3,
        "chain_way_m": 60.0 if number % 3 else None, "collisions": 0, "replans": 1, "legs": 2,
        "to_landmarks": 1, "barred": 3, "published": 80, "ledger_mb": 90.0,
        "broadcast_mb": 400.0, "seconds_simulated": 200.0, "wall_s": 30.0, "seconds_looking": 40.0,
        "clock_s": 500.0,
        "routes": [(0.6, False), (0.9, True)],
    }  # fmt: skip


def test_the_figures_of_made_up_missions() -> None:
    drawn = [mission(n, n % 3) for n in range(6)]
    rows = [row(n, "ledger", n != 5, True) for n in range(6)]
    rows += [row(n, "alone", n < 2) for n in range(6)]
    found = summarise(pd.DataFrame(rows), drawn)
    ledger, alone = found["ledger"], found["alone"]
    assert (ledger["n"], ledger["n_with_chain"]) == (6, 4)
    assert ledger["success"] == ledger["success_300_s"] == pytest.approx(5 / 6)
    assert ledger["success_150_s"] == 0.0
    assert ledger["success_given_chain"] == pytest.approx(3 / 4)
    assert ledger["false_arrivals"] == 1 and alone["false_arrivals"] == 0
    assert ledger["spl"] == pytest.approx(5 / 6 * 0.5)
    assert ledger["spl_chain"] == pytest.approx(3 / 4 * 0.6)
    assert ledger["times_alone"] == pytest.approx(2.5) and "times_alone" not in alone
    low, high = ledger["success_ci"]
    assert low <= ledger["success"] <= high
    assert ledger["chain_lengths"] == {"0": 2, "1": 2, "2": 2}
    place = pd.DataFrame(rows).assign(chain=0, chain_way_m=None)  # driven to in their stead
    assert summarise(place, drawn)["ledger"]["chain_lengths"] == {"0": 6}
    assert ledger["rejected_draws"] == {"way too long": 12}
    assert [ledger[name] for name in MEANS[:7]] == [1, 2, 1, 3, 80, 90, 400]
    assert ledger["success_150_s_ci"] == pytest.approx([0.0, 0.459], abs=1e-3)  # exact: 0 of 6
    assert (ledger["seconds_simulated"], ledger["seconds_looking"]) == (200, 40)
    assert ledger["wall_s_per_300_s"] == pytest.approx(18.0)
    assert [(r["n"], r["led_there"]) for r in ledger["routes"]] == [
        (0, None), (6, 0.0), (6, 1.0), (0, None),
    ]  # fmt: skip
    assert routes_table({"ledger": ledger}).to_dict("list") == {
        "arm": ["ledger"] * 2, "trust": ["0.5 - 0.8", "0.8 - 0.95"], "n": [6, 6], "led": [0.0, 1.0],
    }  # fmt: skip
    assert json.loads(json.dumps(found)) == found
    assert "0.75 [" in as_table(found).success_given_chain["ledger"]


def test_what_came_of_routes_is_read_from_the_log() -> None:
    def log(*said: str) -> list[dict[str, Any]]:
        return [{"what": what, "values": {"trust": k / 10}} for k, what in enumerate(said)]

    driven = ("no route", "route", "leg", "route", "plan again")
    arrived = log(*driven, "route", "approach", "arrived")
    assert routes_of(arrived, success=True) == [(0.1, False), (0.5, True)]
    assert routes_of(arrived, success=False) == [(0.1, False), (0.5, False)]  # somewhere else
    refuted = ("route", "doubt", "plan again")
    assert routes_of(log(*refuted, "route", "approach"), False) == []  # not driven; broken off
    assert routes_of(log(*refuted, "route", "approach", "gave up"), False) == [(0.3, False)]


def test_how_long_a_robot_looked_elsewhere_is_read_from_the_log() -> None:
    said = {300: "no route", 300.5: "explore", 320: "route", 350: "no route", 360: "gave up"}
    assert looking_s([{"time_s": t, "what": what} for t, what in said.items()]) == 30.0
    assert looking_s([]) == 0.0


def test_without_any_chain_what_is_given_a_chain_is_null() -> None:
    found = summarise(pd.DataFrame([row(0, "oracle", True)]), [mission(0, 0)])["oracle"]
    assert found["success_given_chain"] is None and found["spl_chain_ci"] is None
    assert found["success"] == 1.0
    assert np.isfinite(found["seconds_simulated"])

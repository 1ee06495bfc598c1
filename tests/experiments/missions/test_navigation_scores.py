"""The figures of missions, from rows made up for them."""

import json
from typing import Any

import numpy as np
import pandas as pd
import pytest

from vrchain.experiments.missions.chains import TrueChain
from vrchain.experiments.missions.draw import Mission
from vrchain.experiments.missions.success import as_table, routes_of, routes_table, summarise
from vrchain.geometry import Pose


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
        "to_landmarks": 1, "barred": 3, "seconds_simulated": 200.0, "wall_s": 30.0,
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
    assert ledger["rejected_draws"] == {"way too long": 12}
    assert [ledger[name] for name in ("replans", "legs", "to_landmarks", "barred")] == [1, 2, 1, 3]
    assert ledger["success_150_s_ci"] == pytest.approx([0.0, 0.459], abs=1e-3)  # exact: 0 of 6
    assert ledger["seconds_simulated"] == 200
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


def test_without_any_chain_what_is_given_a_chain_is_null() -> None:
    found = summarise(pd.DataFrame([row(0, "oracle", True)]), [mission(0, 0)])["oracle"]
    assert found["success_given_chain"] is None and found["spl_chain_ci"] is None
    assert found["success"] == 1.0
    assert np.isfinite(found["seconds_simulated"])

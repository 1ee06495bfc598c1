"""The bench of the planner: its rows are what is promised, on worlds quickly made."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from vrchain.cli.bench import app
from vrchain.experiments.planning import lost_segments as planning
from vrchain.experiments.planning import speed as bench
from vrchain.experiments.planning.speed import COLUMNS, bench_planner

SMALL = ((20, 300, 150.0, 2, 1_000.0),)


def test_rows_are_what_is_promised() -> None:
    table = bench_planner(5, seed=3000, sizes=SMALL)
    assert list(table.columns) == COLUMNS
    rows = {row["name"].partition(", 20 robots")[0]: row for row in table.to_dict("records")}
    best, equal, known = (
        rows[name] for name in ("best chance", "best chance, equal scores", "breadth-first")
    )
    assert best["positions"] == 6  # three in each of two worlds
    assert best["ratio"] == best["median_us"] / best["reference_us"]
    assert best["reference_us"] == known["median_us"] and best["bar"] == 1_000.0
    assert equal["landmarks"] == known["landmarks"] <= best["landmarks"]
    assert known["landmarks"] <= rows["shortened chain"]["landmarks"]
    assert np.isnan(known["ratio"]) and np.isnan(rows["prepared"]["landmarks"])
    assert rows["prepared"]["positions"] == 2 and (table.median_us > 1).all()


@pytest.mark.slow
def test_planning_is_fast_enough() -> None:
    table = bench_planner(50, seed=3000)
    barred = table[table.bar.notna()]
    print(table.to_string())
    assert len(barred) == 4 and (barred.median_us < barred.bar).all()


def test_the_command_prints_json_or_tables(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench, "SIZES", SMALL)
    monkeypatch.setattr(planning, "TASKS_A_WORLD", 3)
    arguments = ["planner", "--tasks", "2", "--worlds", "1"]
    done = CliRunner().invoke(app, [*arguments, "--json"])
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert set(found["rows"][0]) == set(COLUMNS)
    assert {row["method"] for row in found["blocked"]} == set(planning.METHODS)
    assert {row["robots"] for row in found["one_drive"]} == {0, *range(10, 100, 10)}
    assert found["gains"][0]["gain"] == pytest.approx(0.7185, abs=1e-4)
    text = CliRunner().invoke(app, arguments).stdout
    assert "best chance, equal scores" in text and "share that arrives, by drives" in text
    assert "one drive, to the target" in text and "published shares are in the interval" in text

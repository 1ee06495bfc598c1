"""Who sees my goal: the figures of a made-up table, and a small search that truly runs."""

import json
from pathlib import Path

import pandas as pd
import pytest

from vrchain.cli import app
from vrchain.errors import MissionError
from vrchain.experiments.landmarks import retrieval as search
from vrchain.experiments.landmarks.retrieval import SearchConfig, evaluate, summarise
from vrchain.experiments.scenes import scenes_of
from vrchain.paths import SCENES

SUBURB = SCENES / "suburb.yaml"


def looked_up() -> pd.DataFrame:
    """Four goals by their records, one of them by SIFT as well."""
    rows = []
    for n, (first, nobody) in enumerate([(True, True), (True, False), (False, True), (True, True)]):
        for way in ("gallery", "sift") if n == 0 else ("gallery",):
            seconds = 4.0 if way == "sift" else 0.1
            for present, right in ((True, first), (False, nobody)):
                rows.append(
                    {
                        "scene": 0,
                        "goal": f"house_{n}",
                        "way": way,
                        "showing": 10,
                        "present": present,
                        "answered": 5,
                        "right": right,
                        "found": 4 if way == "gallery" and present else 2 * present,
                        "s": seconds,
                    }
                )
    return pd.DataFrame(rows)


def test_figures_are_those_of_the_table() -> None:
    found = summarise(looked_up())
    own = found["gallery"]
    assert (own["n"], own["first_right"], own["nobody_right"]) == (4, 0.75, 0.75)
    assert own["first_right_ci"][0] < 0.75 < own["first_right_ci"][1] <= 1
    assert own["recall"] == pytest.approx(0.4) and own["ms_per_goal"] == pytest.approx(100)
    assert own["precision"] == pytest.approx(0.8)
    assert own["precision_ci"] is None  # every goal's is
    assert found["sift"]["n"] == 1
    beside = found["side by side"]
    assert beside["times_faster"] == pytest.approx(40) and beside["n"] == 1
    assert (beside["recall_gallery"], beside["recall_sift"]) == (0.4, 0.2)


def test_without_an_answer_there_is_no_precision() -> None:
    silent = looked_up().assign(answered=0, found=0)
    assert summarise(silent)["gallery"]["precision"] is None


def test_without_sift_there_is_nothing_beside() -> None:
    table = looked_up()
    assert set(summarise(table[table.way == "gallery"])) == {"gallery"}


def test_where_no_goal_is_seen_that_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(search, "_search_in", lambda *asked: [])
    with pytest.raises(MissionError, match="ask for more panoramas"):
        evaluate(scenes_of(SUBURB), 1, SearchConfig(1, 1), seed=3000, folder=tmp_path)


@pytest.mark.slow
def test_a_goal_is_found_in_a_few_panoramas(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("torch", reason="proposals need torch (extra `learned`)")
    arguments = ["evaluate", "search", str(SUBURB), "--panoramas", "24", "--goals", "2",
                 "--by-sift", "1", "-o", str(tmp_path), "--json"]  # fmt: skip
    app(arguments, standalone_mode=False)
    found = json.loads(capsys.readouterr().out)
    assert found["gallery"]["n"] == 2 and found["sift"]["n"] == 1
    (kept,) = tmp_path.rglob("scene_*.json")
    before = kept.stat().st_mtime_ns
    app(arguments, standalone_mode=False)
    assert json.loads(capsys.readouterr().out) == found
    assert kept.stat().st_mtime_ns == before

"""``vrchain evaluate homing``: what it prints of a made-up table, and what it refuses."""

import json
from pathlib import Path

import pytest
from test_homing_experiment import field

from vrchain.cli import app
from vrchain.errors import MissionError
from vrchain.experiments import homing as homing
from vrchain.paths import SCENES

SUBURB = str(SCENES / "suburb.yaml")
FIGURES = ("angular_error_deg", "return_ratio", "catchment_m", "no_answer")


def run(*arguments: object) -> None:
    app([str(a) for a in arguments], standalone_mode=False)


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[dict]:
    """What the experiment is asked for; it answers with a made-up field."""
    calls: list[dict] = []

    def made_up(scenes: object, n_places: int, rows: list[str], **others: object) -> object:
        calls.append({"n_places": n_places, "rows": list(rows), **others})
        return field().assign(method=rows[0], home=True)

    monkeypatch.setattr(homing, "evaluate", made_up)
    return calls


def test_json_is_one_object_of_figures_and_intervals(
    asked: list[dict], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    given = ("--method", "scale, compass", "--jobs", 2)
    run("evaluate", "homing", SUBURB, "--json", "-o", tmp_path, *given)
    found = json.loads(capsys.readouterr().out)
    assert list(found) == ["scale, compass"]
    assert {*FIGURES, *(f"{name}_ci" for name in FIGURES)} <= set(found["scale, compass"])
    assert found["scale, compass"]["return_ratio"] == 1.0
    assert asked == [
        {"n_places": 2, "rows": ["scale, compass"], "seed": 3000, "folder": tmp_path, "jobs": 2}
    ]


def test_text_has_a_row_a_method(asked: list[dict], capsys: pytest.CaptureFixture[str]) -> None:
    run("evaluate", "homing", SUBURB, "--places", 3)
    assert "epipolar" in capsys.readouterr().out
    assert asked[0]["n_places"] == 3 and asked[0]["rows"] == list(homing.ROWS)


def test_seeds_for_choosing_are_kept_apart(asked: list[dict]) -> None:
    with pytest.raises(MissionError, match=r"seeds below 2000 .* got 1999"):
        run("evaluate", "homing", SUBURB, "--seed", 1999)
    assert asked == []
    run("evaluate", "homing", SUBURB, "--seed", 1999, "--allow-training-seeds")
    assert asked[0]["seed"] == 1999

"""The evaluation of homing on fields of home vectors whose outcome is known."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from sights import yard
from worlds import SMALL_RIG, box, plain, world

from vrchain.cli import app
from vrchain.errors import MissionError
from vrchain.experiments import homing
from vrchain.experiments.homing import (
    COMPASS,
    Free,
    Grid,
    as_table,
    draw_place,
    evaluate,
    returned,
    starts,
    summarise,
)
from vrchain.experiments.scenes import Scenes
from vrchain.paths import SCENES
from vrchain.seeding import generator
from vrchain.world.model import Scene

SUBURB = str(SCENES / "suburb.yaml")
FIGURES = ("angular_error_deg", "return_ratio", "catchment_m", "no_answer", "false_arrivals")
SMALL = Grid(spacing_m=2.0, reach_m=4.0, near_m=0.2, near_reach_m=0.2)


def field(off_deg: float = 0.0, arrived_m: float = 0.25, grid: Grid | None = None) -> pd.DataFrame:
    """Home vectors from all points of a grid, all as many degrees off."""
    x_m, y_m = (grid or Grid()).points_m().T
    range_m = np.hypot(x_m, y_m)
    return pd.DataFrame(
        {
            "suburb": 0, "place": 0, "method": "made up", "x_m": x_m, "y_m": y_m, "clear": True,
            "answered": True, "course_rad": np.arctan2(-y_m, -x_m) + np.radians(off_deg),
            "error_deg": abs(off_deg), "arrived": range_m <= arrived_m,
        }
    )  # fmt: skip


def ended(table: pd.DataFrame, free: Free = lambda at: np.full(len(at), True)) -> pd.DataFrame:
    """The starts of a field, and whether the robot comes home from each."""
    return starts(table.assign(home=returned(table, free, Grid())))


def test_the_grid_is_the_one_that_is_defined() -> None:
    points = Grid().points_m()
    range_m = np.hypot(*points.T)
    coarse = range_m >= 0.49
    assert (coarse.sum(), (~coarse).sum()) == (316, 49)
    assert range_m.max() == pytest.approx(5.0) and range_m[~coarse].max() == pytest.approx(0.4)
    assert np.allclose(points[coarse] * 2, np.round(points[coarse] * 2))
    assert len(np.unique(points.round(6), axis=0)) == len(points)


@pytest.mark.parametrize(
    ("table", "expected"),
    [
        (field(), 1.0),
        (field(60.0), 1.0),  # the way is twice the distance
        (field(-60.0), 1.0),
        (field(85.0), 0.0),  # eleven times
        (field(180.0), 0.0),  # it leaves the grid
        (field(arrived_m=-1.0), 0.0),  # none is declared
        (field(arrived_m=1.1), 0.0),  # from half a metre on each declares too early
        (field(arrived_m=0.05), 1.0),
        (field().assign(arrived=True), 0.0),
    ],
)
def test_who_goes_right_and_declares_it_there_returns(table: pd.DataFrame, expected: float) -> None:
    assert ended(table).home.mean() == expected


def test_without_an_answer_on_the_way_it_keeps_its_course() -> None:
    table = field()
    range_m = np.hypot(table.x_m, table.y_m)
    silent = (range_m > 2.9) & (range_m < 3.6)
    table.loc[silent, "course_rad"] = np.nan
    table["range_m"] = range_m
    home = ended(table).set_index("range_m").home
    assert home[home.index > 4.0].all()
    assert not home[(home.index > 2.9) & (home.index < 3.6)].any()  # none where it starts
    assert home[home.index < 2.9].all()


def test_who_leaves_the_grid_or_bumps_into_something_is_lost() -> None:
    table = field()
    gap = table.x_m.between(0.9, 3.1)
    home = ended(table[~gap])
    assert not home[(home.x_m > 3) & (home.y_m.abs() < 0.1)].home.any()
    assert home[home.x_m < 0].home.all()
    walled = ended(table, lambda at: np.abs(at[:, 0] - 1.7) > 0.05)
    assert not walled[walled.x_m > 1.8].home.any() and walled[walled.x_m < 1.6].home.all()


def test_figures_are_what_the_module_says() -> None:
    """One place whose far starts fail, one with a blocked and a silent start."""
    near, mixed = field(), field().assign(suburb=1, place=1)
    far = np.hypot(near.x_m, near.y_m) > 3.01
    near.loc[far, "course_rad"] += np.pi
    near.loc[far, "error_deg"] = 180.0
    blocked = (mixed.x_m == 5.0) & (mixed.y_m == 0.0)
    mixed.loc[blocked, ["clear", "error_deg"]] = False, 30.0
    silent = (mixed.x_m == -5.0) & (mixed.y_m == 0.0)
    mixed.loc[silent, ["course_rad", "error_deg"]] = np.nan, 90.0
    mixed.loc[silent, "answered"] = False
    for made in (near, mixed):
        made["home"] = returned(made, lambda at: np.full(len(at), True), Grid())
    mixed.loc[np.hypot(mixed.x_m, mixed.y_m) < 0.6, "arrived"] = True  # four starts at 0.5 m
    table = pd.concat([near, mixed], ignore_index=True)
    n_far = int(far.sum())
    found = summarise(table)["made up"]
    assert (found["n_places"], found["n_starts"], found["n_clear"]) == (2, 632, 631)
    assert found["angular_error_deg"] == pytest.approx((180 * n_far + 30 + 90) / 632)
    assert found["false_arrivals"] == pytest.approx(4 / 632)
    assert found["return_ratio"] == pytest.approx((631 - n_far - 1) / 631)
    assert found["no_answer"] == pytest.approx(1 / 632)
    assert found["catchment_m"] == pytest.approx((3.162 + 5.0) / 2, abs=0.1)
    for name in FIGURES:
        low, high = found[f"{name}_ci"]
        assert low <= found[name] <= high
    assert "made up" in as_table({"made up": found}).to_string()


def test_no_way_home_at_all_is_no_figure() -> None:
    found = summarise(field().assign(clear=False, home=False))["made up"]
    assert found["return_ratio"] is None and found["catchment_m"] is None
    assert found["n_clear"] == 0 and found["angular_error_deg"] == 0.0
    assert "-" in as_table({"made up": found}).to_string()


def yards() -> Scenes:
    return Scenes(lambda seed, k: yard(), "yard", varied=False)


def test_a_yard_is_homed_in_and_a_second_run_reads_what_the_first_found(tmp_path: Path) -> None:
    rows = ["epipolar", "epipolar" + COMPASS, "warping"]
    asked = {"seed": 3000, "folder": tmp_path, "grid": SMALL, "rig": SMALL_RIG}
    first = evaluate(yards(), 1, rows, **asked)
    (file,) = tmp_path.rglob("*.json")
    written = file.stat().st_mtime_ns
    again = evaluate(yards(), 1, rows, **asked)
    assert file.stat().st_mtime_ns == written
    pd.testing.assert_frame_equal(first, again)
    assert list(dict.fromkeys(first.method)) == rows
    assert len(first) == 3 * len(first[["x_m", "y_m"]].drop_duplicates()) > 3 * 10
    file.unlink()
    pd.testing.assert_frame_equal(first, evaluate(yards(), 1, rows, **asked))
    summary = summarise(first, grid=SMALL)
    assert summary["epipolar"]["angular_error_deg_median"] < 5
    more = evaluate(yards(), 1, ["warping"], **asked)  # asked otherwise, found elsewhere
    assert len(list(tmp_path.rglob("*.json"))) == 2 and len(more) == len(first) / 3


def full() -> Scene:
    """A world with no room for a robot."""
    return world(box("block", (0.0, 0.0), (9.0, 9.0, 2.0), plain((9, 9, 9))), extent_m=(8.0, 8.0))


def test_a_world_without_a_free_place_is_named() -> None:
    with pytest.raises(MissionError, match="no free place in boxes"):
        draw_place(full(), generator(0, "home"))


# --- the command ---


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


def test_what_was_found_is_found_again_by_another_process(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Where functions are in memory differs, and is in their own text."""
    asked: list[object] = []

    def stop(*what: object) -> Path:
        asked.extend(what)
        raise InterruptedError

    monkeypatch.setattr(homing, "folder_of", stop)
    with pytest.raises(InterruptedError):
        evaluate(yards(), 1, seed=1, folder=tmp_path)
    assert "scale_space" in str(asked[2:]) and "0x" not in str(asked[2:])

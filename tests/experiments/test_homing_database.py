"""Homing between pictures of a database: a yard's, where truth is known, and refused ones."""

import json
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
from sights import RIG, look, yard

from vrchain.cli import app
from vrchain.errors import MissionError
from vrchain.experiments.homing import Grid, answers
from vrchain.experiments.homing_database import (
    as_table,
    evaluate,
    grid_spacing_m,
    summarise,
)
from vrchain.geometry import Pose
from vrchain.homing import METHODS
from vrchain.panorama.databases import ENTRIES, DatabaseEntry, read_database, write_database
from vrchain.seeding import generator
from vrchain.world.render import Renderer

POSES = [Pose(x, y, 0.7 * x - y) for x in (0.0, 1.0, 2.0) for y in (0.0, 1.0, 2.0)]
SPACING_M = 0.9, 2.9


@pytest.fixture(scope="module")
def grid(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Nine panoramas of a yard on a grid of 1 m."""
    folder = tmp_path_factory.mktemp("grid")
    taken = [(DatabaseEntry(Path(f"{k}"), pose), look(pose, RIG)) for k, pose in enumerate(POSES)]
    write_database(folder, taken)
    return folder


@pytest.fixture(scope="module")
def found(grid: Path) -> pd.DataFrame:
    asked = {"seed": 3000, "most_pairs": 16, "spacing_m": SPACING_M}
    return evaluate(
        read_database(grid), ["epipolar", "scale"], tilts_deg=(0.0, 5.0), **asked,
        compass_errors_deg=(10.0,),
    )  # fmt: skip


def test_home_vectors_are_judged_by_the_poses(found: pd.DataFrame) -> None:
    rows = [f"{m}{c}, tilt {t}" for t in (0, 5) for m in ("epipolar", "scale")
            for c in ("", ", compass 10")]  # fmt: skip
    assert list(dict.fromkeys(found.method)) == rows
    assert found.groupby("method").size().unique().tolist() == [16]
    assert found.range_m.between(*SPACING_M).all() and found.home.nunique() == 2
    summary = summarise(found, SPACING_M)
    for row in rows[:2] + rows[4:6]:
        own = summary[row]
        assert own["n_pairs"] == own["answered"] == 16 and own["false_arrivals"] == 0
        assert own["median_deg"] < 2 and own["angular_error_deg"] < 10
        assert own["within_1_std"] <= own["within_2_std"] and own["within_2_std"] > 0.6
    assert summary[rows[0]]["return_ratio"] == 1.0
    assert summary[rows[2]]["angular_error_deg"] > summary[rows[0]]["angular_error_deg"]
    assert rows[0] in as_table(summary).to_string()


def test_figures_are_what_the_module_says() -> None:
    """Six pairs: right, too sure, silent, declared where it is not, and wrong, surely and not."""
    table = pd.DataFrame(
        {
            "home": [0, 0, 1, 1, 2, 2], "range_m": [1.0, 2.0, 3.0, 4.9, 4.0, 4.1],
            "method": "made up", "answered": [True, True, False, True, True, True],
            "error_deg": [1.0, 8.0, 90.0, 3.0, 46.0, 46.0], "returned": None,
            "std_rad": np.radians([1.0, 3.0, np.nan, 2.0, 19.0, 24.0]),
            "arrived": [False, False, False, True, False, False],
        }
    )  # fmt: skip
    own = summarise(table)["made up"]
    assert (own["n_pairs"], own["answered"], own["median_deg"]) == (6, 5, 8.0)
    assert own["angular_error_deg"] == pytest.approx(194 / 6)
    assert own["within_1_std"] == pytest.approx(1 / 5)
    assert own["within_2_std"] == pytest.approx(3 / 5)
    assert (own["sure_wrong"], own["false_arrivals"]) == (1, 1) and own["return_ratio"] is None
    truth = summarise(table, position_error_m=0.1)["made up"]  # 4 and 1.65 degrees at 2 and 4.9 m
    assert truth["within_1_std"] == pytest.approx(1 / 5) and truth["sure_wrong"] == 1
    assert truth["within_2_std"] == pytest.approx(4 / 5)
    bands = [v for name, v in own.items() if name.startswith("error_")]
    assert bands == pytest.approx([4.5, 90.0, 95 / 3])


def test_our_own_renderings_give_the_same_answers_by_way_of_a_database(tmp_path: Path) -> None:
    """As ``homing.answers`` gives, which ``evaluate homing`` counts."""
    near, home = Grid(1.0, 1.0, 1.0, 0.0), Pose(0.5, -0.3, 1.0)
    renderer, points = Renderer(yard()), near.points_m()
    direct = answers(renderer, home, generator(0, "headings"), tuple(METHODS), grid=near, rig=RIG)
    yaws = generator(0, "headings").uniform(-np.pi, np.pi, len(points))
    poses = [Pose(*(home.xy_m + offset_m), yaw) for offset_m, yaw in zip(points, yaws, strict=True)]
    taken = [(DatabaseEntry(Path(f"{k}"), p), renderer.render(p, RIG))
             for k, p in enumerate([*poses, home])]  # fmt: skip
    write_database(tmp_path, taken)
    found = evaluate(read_database(tmp_path), seed=0, spacing_m=(0.9, 1.1))
    found = found[(found.home == len(poses)) & found.method.isin(METHODS)]
    direct = direct[np.hypot(direct.x_m, direct.y_m) > 0]
    assert len(found) == len(direct) == 4 * len(METHODS)
    told = ["method", "answered", "arrived", "n_matches"]
    assert found[told].to_numpy().tolist() == direct[told].to_numpy().tolist()
    for figure in ("x_m", "y_m", "error_deg", "std_rad", "course_rad", "remoteness"):
        assert found[figure].to_numpy() == pytest.approx(direct[figure].to_numpy(), abs=1e-6)


def test_pictures_of_an_ants_height_are_looked_at(tmp_path: Path) -> None:
    """No rig stands 10 mm high, as examples of Brains on Board say; that only scales distances."""
    for k in range(2):
        cv2.imwrite(str(tmp_path / f"{k}.png"), np.full((256, 512), 90, np.uint8))
    (tmp_path / ENTRIES).write_text(
        "X [mm], Y [mm], Z [mm], Heading [degrees], Filename\n"
        + "".join(f"{1000 * k}, 0, 10, 0, {k}.png\n" for k in range(2))
    )
    found = evaluate(read_database(tmp_path), ["epipolar"], seed=0, spacing_m=(0.9, 1.1))
    assert len(found) == 4 and not found.answered.any()


def test_where_a_robot_is_it_need_not_go(grid: Path) -> None:
    found = evaluate(read_database(grid), ["epipolar"], seed=0, spacing_m=(0.0, 1.1))
    assert len(found) and (found.home != found.start).all() and (found.range_m > 0).all()


def entries(points: list[tuple[float, float]], room: int = 0) -> list[DatabaseEntry]:
    return [DatabaseEntry(Path("none"), Pose(x, y), room=room) for x, y in points]


def test_positions_that_form_a_grid_are_known_from_others() -> None:
    near = [(x / 10, y / 10) for x in range(4) for y in range(4)]
    assert grid_spacing_m(entries(near)) == pytest.approx(0.1)
    assert grid_spacing_m(entries(near[:4])) is None
    for few in (near[:1], near[:2]):  # taken nine times there
        assert grid_spacing_m(entries(9 * few)) is None
    draws = np.random.default_rng(0).uniform(0, 4, (30, 2))
    assert grid_spacing_m(entries([tuple(p) for p in draws])) is None
    assert grid_spacing_m(entries([(0.3 * k, 0.0) for k in range(12)])) == pytest.approx(0.3)


@pytest.mark.parametrize(
    ("asked", "word"),
    [
        ({"methods": ["warp"]}, "no homing method 'warp': there are epipolar"),
        ({"spacing_m": (4.0, 5.0)}, "the nearest two are 0.1 m apart: give another --spacing"),
    ],
)
def test_what_cannot_be_asked_is_refused_before_a_picture_is_read(asked: dict, word: str) -> None:
    with pytest.raises(MissionError, match=word):
        evaluate(entries([(0, 0), (0.1, 0), (0.3, 0)]), seed=0, **asked)
    apart = entries([(0, 0)]) + entries([(1.5, 0)], room=1)
    with pytest.raises(MissionError, match="among 2: no room has two"):
        evaluate(apart, seed=0)


def test_the_command_tells_one_object(grid: Path, capsys: pytest.CaptureFixture[str]) -> None:
    command = ["evaluate", "homing-database", str(grid), "--spacing", "0.9", "1.1", "--json",
               "--pairs", "2", "--method", "scale", "--compass-error", "5"]  # fmt: skip
    app(command, standalone_mode=False)
    told = json.loads(capsys.readouterr().out)
    assert list(told) == ["scale", "scale, compass 5"]
    assert told["scale"]["n_pairs"] >= 2 and told["scale"]["return_ratio"] is not None

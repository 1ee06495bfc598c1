"""What ``vrchain bench`` times, and that its rows are what the contract says."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import worlds
from typer.testing import CliRunner

from vrchain.cli.bench import app
from vrchain.errors import SpecError
from vrchain.experiments.landmarks.speed import bench_landmarks
from vrchain.experiments.planning import lost_segments, speed
from vrchain.experiments.rendering import bench_render
from vrchain.experiments.stopwatch import COLUMNS
from vrchain.geometry import Pose
from vrchain.paths import SCENES
from vrchain.world.render import Renderer
from vrchain.world.render.reference import LitRenderer

SMALL = ((20, 300, 150.0, 2, 1_000.0),)
SPEC = """\
name: hamlet
seed: 3
extent_m: [60, 60]
houses: {count: 2}
trees: {count: 4}
vehicles: {count: 1}
boundaries: {fences: 1, walls: 1, hedges: 1}
furniture: {mailboxes: 1, lamps: 1, poles: 1, signs: 1, bins: 1, hydrants: 1, bushes: 1}
"""


def test_the_reference_draws_the_same_things_at_the_same_places() -> None:
    leaf = np.dstack([worlds.blotches("leaf"), np.full((64, 64), 255, dtype=np.uint8)])
    corners = [(6.0, 1.0, 0.5), (6.0, 3.0, 0.5), (6.0, 3.0, 2.0), (6.0, 1.0, 2.0)]
    board = worlds.place(
        "board", "board", "board", [worlds.quad(corners, leaf)], Pose(0, 0), landmark=True
    )
    scene = worlds.world(
        worlds.box("red", (5.0, 0.0), (1.0, 1.0, 3.0), worlds.plain(worlds.RED)), board
    )
    pose, rig = Pose(0.0, 0.0, 0.2), worlds.SMALL_RIG
    lit = LitRenderer(scene).render(pose, rig).views.astype(int)
    renderer = Renderer(scene)
    flat, ids = renderer.render(pose, rig).views, renderer.segmentation(pose, rig)
    red = (lit[..., 0] > 2 * lit[..., 1]) & (lit[..., 0] > 40) & (ids != 2)
    assert (red == (ids == 1)).mean() > 0.99  # edges are smoother there
    assert (ids == 1).sum() > 200 and flat.shape == lit.shape
    # neither path disturbs the other
    assert np.array_equal(renderer.render(pose, rig).views, flat)


def test_the_rows_of_rendering(tmp_path: Path) -> None:
    spec = tmp_path / "hamlet.yaml"
    spec.write_text(SPEC)
    table = bench_render(spec, 2, seed=3000, rig=replace(worlds.SMALL_RIG, width_px=64))
    assert list(table.columns) == COLUMNS
    panorama, rays, scene = table.to_dict("records")
    assert panorama["name"] == "panorama 8 x 64 x 120" and panorama["positions"] == 2
    assert panorama["ratio"] == panorama["median_us"] / panorama["reference_us"]
    assert (panorama["bar"], scene["bar"]) == (250_000, 5_000_000)
    assert all(row["median_us"] > 100 for row in (panorama, rays, scene))


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match=r"none\.yaml"):
        bench_render(tmp_path / "none.yaml", 1, seed=3000)


@pytest.mark.slow
def test_the_rows_of_landmarks() -> None:
    pytest.importorskip("torch", reason="proposals need torch (extra `learned`)")
    found = bench_landmarks(SCENES / "barn.yaml", 2, seed=3000)
    assert list(found.columns) == COLUMNS
    assert list(found.name) == ["propose", "examine", "pair cnn", "pair cnn+sift"]
    assert (found.median_us > 0).all() and (found.reference_us > 0).all()
    assert np.allclose(found.ratio, found.median_us / found.reference_us)
    assert (found.positions == 2).all()


def test_the_rows_of_planning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(speed, "SIZES", SMALL)
    table = speed.bench_planner(5, seed=3000)
    assert list(table.columns) == speed.COLUMNS
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
    table = speed.bench_planner(50, seed=3000)
    barred = table[table.bar.notna()]
    print(table.to_string())
    assert len(barred) == 4 and (barred.median_us < barred.bar).all()


def test_the_command_prints_json_or_tables(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(speed, "SIZES", SMALL)
    monkeypatch.setattr(lost_segments, "TASKS_A_WORLD", 3)
    arguments = ["planner", "--tasks", "2", "--worlds", "1"]
    done = CliRunner().invoke(app, [*arguments, "--json"])
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    assert set(found["rows"][0]) == set(speed.COLUMNS)
    assert {row["method"] for row in found["blocked"]} == set(lost_segments.METHODS)
    assert {row["robots"] for row in found["one_drive"]} == {0, *range(10, 100, 10)}
    assert found["gains"][0]["gain"] == pytest.approx(0.7185, abs=1e-4)
    text = CliRunner().invoke(app, arguments).stdout
    assert "best chance, equal scores" in text and "share that arrives, by drives" in text
    assert "one drive, to the target" in text
    assert "published shares are in the interval" not in text  # one world tells of no interval

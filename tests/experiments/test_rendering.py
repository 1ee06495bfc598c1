"""The bench of the renderer: what it times is drawn, and its rows are what the contract says."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import worlds

from vrchain.errors import SpecError
from vrchain.experiments.rendering import bench_render
from vrchain.experiments.stopwatch import COLUMNS
from vrchain.geometry import Pose
from vrchain.world.render import Renderer
from vrchain.world.render.reference import LitRenderer

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


def test_rows_are_what_is_promised(tmp_path: Path) -> None:
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

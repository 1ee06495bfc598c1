"""Maps and pictures: everything is in them, and no text leaves them."""

import numpy as np
import pytest
from drawn import strays, words
from matplotlib.figure import Figure
from worlds import RED, SMALL_RIG, box, plain, world, yard

from vrchain.landmarks.matching.common import CommonLandmark, Region
from vrchain.panorama import Panorama
from vrchain.plots.maps import scene_map
from vrchain.plots.missions import _mark
from vrchain.plots.pictures import (
    claims_table,
    common_landmarks_figure,
    panorama_strip,
    truth_sheet,
    view_sheet,
    views_row,
)


def claim(bearing_rad: float, score: float) -> CommonLandmark:
    view = int(SMALL_RIG.view_of_bearing(bearing_rad))
    region = Region(view, (40.0, 30.0, 60.0, 50.0), bearing_rad, 0.1)
    return CommonLandmark(score, region, region, np.arange(6), np.arange(6))


def panorama(seed: int = 0) -> Panorama:
    shape = (SMALL_RIG.n_views, SMALL_RIG.height_px, SMALL_RIG.width_px, 3)
    draws = np.random.default_rng(seed)
    return Panorama(SMALL_RIG, draws.integers(0, 256, shape, dtype=np.uint8))


@pytest.mark.parametrize(
    ("bearing_deg", "lefts"), [(0.0, [10.0]), (175.0, [-175.0, 185.0]), (-179.0, [-169.0, 191.0])]
)
def test_a_box_that_runs_on_behind_the_robot_is_drawn_at_both_ends(
    bearing_deg: float, lefts: list[float]
) -> None:
    figure = Figure()
    axes = figure.add_subplot(xlim=(180, -180), ylim=(-20, 20))
    region = Region(0, (0.0, 0.0, 0.0, 0.0), np.radians(bearing_deg), np.radians(20.0))
    _mark(axes, panorama(), region, "L12", "#ff0000")
    drawn = [patch.get_x() + patch.get_width() for patch in axes.patches]
    assert drawn == pytest.approx(lefts)
    assert [text.get_position()[0] for text in axes.texts] == pytest.approx(np.minimum(lefts, 180))


def test_the_map_has_every_landmark() -> None:
    figure = scene_map(yard())
    assert strays(figure) == []
    assert "other landmarks (12)" in words(figure)
    assert len(figure.axes[0].patches) == 12


def test_a_house_is_drawn_by_its_roof() -> None:
    house = box("h", (0.0, 0.0), (6.0, 4.0, 3.0), plain(RED))
    object.__setattr__(house, "kind", "house")
    (outline,) = scene_map(world(house)).axes[0].patches
    corners = outline.get_path().vertices
    assert np.allclose([corners.min(axis=0), corners.max(axis=0)], [[-3, -2], [3, 2]])


def test_common_landmarks_close_together_are_drawn_once() -> None:
    claims = [claim(0.0, 0.9), claim(0.01, 0.8), claim(1.0, 0.7), claim(-2.0, 0.6)]
    image = panorama().cylinder
    figure = common_landmarks_figure(image, image, claims, SMALL_RIG)
    assert strays(figure) == []
    assert "4 common landmarks; shown: the 3 surest that lie apart" in words(figure)
    numbers = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert sorted(numbers) == ["1", "1", "3", "3", "4", "4"]
    assert "1 common landmarks" not in words(
        common_landmarks_figure(image, image, claims[:1], SMALL_RIG)
    )


def test_claims_as_a_table() -> None:
    table = claims_table([claim(0.5, 0.9)])
    assert table.a_bearing_rad.item() == 0.5 and table.matches.item() == 6
    assert list(table[["b_x0_px", "b_y0_px", "b_x1_px", "b_y1_px"]].iloc[0]) == [40, 30, 60, 50]
    none = claims_table([])
    assert none.empty and list(none.columns) == list(table.columns)
    assert none[["number", "score", "a_bearing_rad"]].head(5).round(2).empty


def test_pictures_of_panoramas() -> None:
    seen = panorama()
    sheet = view_sheet(seen)
    assert strays(sheet) == []
    assert {"view 0: bearing 0°", "view 5: bearing -135°"} <= set(words(sheet))
    assert strays(panorama_strip({"one": seen, "two": panorama(1)})) == []
    assert len(views_row([*seen.views[:3]], "three").axes) == 3
    ids = np.array([[-1, 0], [5, 5]], dtype=np.int32)
    ranges = np.array([[np.inf, 1.0], [2.0, 3.0]], dtype=np.float32)
    truth = truth_sheet(seen.views[0], ids, ranges)
    assert strays(truth) == []
    drawn = truth.axes[1].images[0].get_array()
    assert drawn is not None and (drawn[0, 0] == 235).all() and (drawn[1, 0] == drawn[1, 1]).all()

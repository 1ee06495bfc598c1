"""Figures show what they are given, legibly: no text leaves its figure."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.table import Table
from matplotlib.text import Text
from worlds import RED, SMALL_RIG, box, plain, world, yard

from vrchain.experiments.ledger.latency import STAGES
from vrchain.experiments.ledger.size import COLUMNS, TEAM
from vrchain.experiments.reproduction.paper import bounds_table, summary_table
from vrchain.geometry import Pose
from vrchain.landmarks.matching.common import CommonLandmark, Region
from vrchain.ledger import Entry, Ledger, simulated_key
from vrchain.panorama import CameraRig, Panorama
from vrchain.plots.landmarks import landmark_quality_figure, precision_recall_figure
from vrchain.plots.ledger import ledger_figure, ledger_size_figure, ledger_table
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
from vrchain.plots.reproduction import (
    TABLE_NOTE,
    retrieval_time_figure,
    table_figure,
    update_stages_figure,
    update_time_figure,
)
from vrchain.plots.save import png_bytes, save_figure

SIZES = (40, 200, 500)


def words(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.findobj(Text) if text.get_text()]


def strays(figure: Figure) -> list[str]:
    """Texts that reach beyond the figure's edges, by more than two pixels."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    edge = figure.bbox.padded(2)
    found = []
    for text in figure.findobj(Text):
        if not (text.get_text() and text.get_visible()):
            continue
        extent = text.get_window_extent(canvas.get_renderer())
        clipped = text.get_clip_on() or extent.width == 0
        inside = edge.contains(extent.x0, extent.y0) and edge.contains(extent.x1, extent.y1)
        if not (clipped or inside):
            found.append(text.get_text())
    return found


def updates(sizes: tuple[int, ...] = SIZES) -> dict[int, pd.DataFrame]:
    tables = {}
    for n in sizes:
        draws = np.random.default_rng(n)
        table = pd.DataFrame(
            {"ledger_position": np.arange(1, n + 1), "robot": ["R1", "R2"] * (n // 2)}
        )
        for number, stage in enumerate(STAGES):
            table[f"{stage}_us"] = draws.uniform(0.9, 1.1, n) * 10.0 ** (number / 2)
        table["total_us"] = table[[f"{stage}_us" for stage in STAGES]].sum(axis=1)
        tables[n] = table
    return tables


def retrievals() -> dict[int, pd.DataFrame]:
    times_us = {"newest_transaction": 0.07, "panorama": 90.0, "common_landmark": 2e5}
    tables = {}
    for n in SIZES:
        rows = [(way, k, us) for way, us in times_us.items() for k in range(1, n + 1)]
        tables[n] = pd.DataFrame(rows, columns=["way", "position", "time_us"])
    return tables


def entries(folder: Path) -> list[Entry]:
    keys = {robot: simulated_key(1, robot) for robot in ("R1", "R2", "operator")}
    members = {robot: keys[robot].public for robot in ("R1", "R2")}
    with Ledger.create(folder, members, keys["operator"]) as ledger:
        for number, robot in enumerate(("R1", "R1", "R2")):
            ledger.publish(robot, keys[robot], b"%d" % number, "distance", number)
        return list(ledger.entries())


def claim(bearing_rad: float, score: float) -> CommonLandmark:
    view = int(SMALL_RIG.view_of_bearing(bearing_rad))
    region = Region(view, (40.0, 30.0, 60.0, 50.0), bearing_rad, 0.1)
    return CommonLandmark(score, region, region, np.arange(6), np.arange(6))


def panorama(seed: int = 0, rig: CameraRig = SMALL_RIG) -> Panorama:
    shape = (rig.n_views, rig.height_px, rig.width_px, 3)
    return Panorama(rig, np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8))


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


def test_update_times_are_drawn_for_each_robot_and_number_of_positions() -> None:
    figure = update_time_figure(updates((40, 200)), "a note")
    assert strays(figure) == []
    assert [axes.get_title() for axes in figure.axes] == ["40 positions", "200 positions"]
    for axes, table in zip(figure.axes, updates((40, 200)).values(), strict=True):
        for line, robot in zip(axes.lines, ("R1", "R2"), strict=True):
            rows = table[table.robot == robot]
            assert np.array_equal(line.get_xdata(), rows.ledger_position)
            assert np.allclose(line.get_ydata(), rows.total_us / 1e3)
    assert "update time (ms)" in words(figure) and "a note" in words(figure)


def test_an_update_beyond_the_axis_is_told() -> None:
    tables = updates((40, 200))
    tables[200].loc[77, "total_us"] = 1e6
    assert any("beyond the axis: 1." in text for text in words(update_time_figure(tables)))


def test_every_stage_of_an_update_has_its_bar() -> None:
    figure = update_stages_figure(updates())
    assert strays(figure) == []
    assert len(figure.axes[0].patches) == len(STAGES) * len(SIZES)
    assert any("µs" in text for text in words(figure))


def test_sizes_that_were_computed_are_hollow() -> None:
    rows = [
        (layout, robots, positions, positions * 10**5, size * positions * robots, size == 10**6)
        for layout, size in {"inline": 10**6, "one a block": 10**5}.items()
        for robots in (2, TEAM)
        for positions in (40, 200)
    ]
    for layout in ("several a block", "retention"):
        rows.append((layout, TEAM, 200, 10**6, 2 * 10**6, False))
    sizes = pd.DataFrame(rows, columns=COLUMNS)
    figure = ledger_size_figure(sizes, "a note")
    assert strays(figure) == []
    for axes in figure.axes[:2]:
        (hollow,) = [line for line in axes.lines if line.get_markerfacecolor() == "white"]
        assert len(hollow.get_xdata()) == 2
    assert {"10 GB", "2 GB"} & set(words(figure)) and "a note" in words(figure)


def test_each_retrieval_is_a_point_beside_both_readings_of_the_paper() -> None:
    figure = retrieval_time_figure(retrievals(), "a note")
    assert strays(figure) == []
    *panels, means = figure.axes
    for axes, n in zip(panels, SIZES, strict=True):
        assert axes.get_title().startswith(f"{n} positions")
        points = [(list(line.get_xdata()), set(line.get_ydata())) for line in axes.lines]
        assert points == [(list(range(1, n + 1)), {us}) for us in (0.07, 90.0, 2e5)]
        heights_us = [patch.get_y() + patch.get_height() for patch in axes.patches]
        assert heights_us == pytest.approx([0.055, 55.0])
    said = " ".join(words(figure)).replace("\n", " ")
    assert "paper, as printed, ms: means 17.9 ns to 19.9 ns, all under 55 ns, most under 30" in said
    assert "paper, read as s: means 17.9 µs to 19.9 µs, all under 55 µs, most under 30" in said
    assert words(figure).count("70 ns") == words(figure).count("200 ms") == len(SIZES)
    assert means.get_yscale() == "log" and "a note" in said


def test_the_table_has_every_value_and_claims_no_reading() -> None:
    summary = summary_table(updates(), retrievals(), {40: 0.021, 200: float("nan"), 500: 1.5})
    pairs = pd.DataFrame({"positions": SIZES, "n_claims": [7, 0, 9], "n_pairs": [12, 3, 12]})
    figure = table_figure(summary, bounds_table(updates(), retrievals()), pairs, TABLE_NOTE)
    assert strays(figure) == []
    table, bounds = figure.findobj(Table)
    cells = {at: cell.get_text().get_text() for at, cell in table.get_celld().items()}
    assert [cells[row, 0] for row in range(1, 10)] == [str(n) for n in SIZES for _ in range(3)]
    assert cells[1, 6] == "0.02 (7 claims, 12 pairs)" and cells[4, 6] == "0 claims, 3 pairs"
    assert cells[2, 2] == "0.00082998" and cells[3, 2] == "0.82998"
    assert cells[5, 4].startswith("0.0000199, which way") and cells[6, 4].startswith("0.0199,")
    assert [cells[row, 6] for row in (3, 6, 9)] == [
        f"{q}, unit not known" for q in (3.41, 3.35, "3.40")
    ]
    cells = {at: cell.get_text().get_text() for at, cell in bounds.get_celld().items()}
    assert [cells[1, column] for column in (0, 1, 5)] == ["update", "40", "all under 0.0016"]
    assert [cells[4, column] for column in (2, 4, 6, 7)] == ["0.00007", "0.00007", "0 %", "100 %"]
    assert [cells[9, column] for column in (5, 6, 7)] == ["most under 0.00003", "0 %", "0 %"]
    assert "neither is claimed" in TABLE_NOTE.replace("\n", " ")
    for cell in [*table.get_celld().values(), *bounds.get_celld().values()]:
        extent = cell.get_text().get_window_extent()
        assert extent.width <= cell.get_window_extent().width + 1, cell.get_text().get_text()


def test_the_chain_shows_what_is_new_and_what_is_carried_over(tmp_path: Path) -> None:
    chain = entries(tmp_path / "ledger")
    table = ledger_table(chain)
    assert list(table.new) == [False, False, True, False, True, False, False, True]
    assert list(table.hash[:6:2]) == list(table.previous_hash[2::2])
    carried = table[(table.height == 3) & (table.robot == "R1")].newest_transaction.item()
    assert carried == table[(table.height == 2) & (table.robot == "R1")].newest_transaction.item()
    figure = ledger_figure(chain)
    assert strays(figure) == []
    texts = words(figure)
    for entry in chain:
        assert f"{entry.block.hash.hex()[:8]}…" in texts
    assert texts.count("R1 no. 1 (distance)") == 2 and texts.count("R2: nothing yet") == 3


def quality_bands(suburbs: int = 2) -> pd.DataFrame:
    rows = [
        {
            "band_m": band_m, "variant": variant, "suburbs": suburbs, "n_pairs": 20,
            "landmarks_a_pair": 40.2, "right_a_pair": 2.5 + k, "wrong_a_pair": 0.25,
            "precision": 0.9 - k / 10, "precision_low": 0.6, "precision_high": 0.95,
            "quality_m_median": 0.1 * (k + 1), "quality_m_q25": 0.05, "quality_m_q75": 0.9,
        }
        for band_m in ("1-10", "10-20", "20-40")
        for k, variant in enumerate(("sift", "cnn", "cnn+sift"))
    ]  # fmt: skip
    return pd.DataFrame(rows)


def test_landmark_quality_has_count_share_and_metres_of_each_band_and_variant() -> None:
    figure = landmark_quality_figure(quality_bands(), "a note")
    assert strays(figure) == []
    counts, shares, quality = figure.axes
    heights = [patch.get_height() for patch in counts.patches]
    assert heights == [h for k in range(3) for h in [2.5 + k] * 3 + [0.25] * 3]
    assert [patch.get_height() for patch in shares.patches] == [0.9] * 3 + [0.8] * 3 + [0.7] * 3
    medians = [line.get_ydata()[0] for line in quality.lines]
    assert medians == pytest.approx([0.1, 0.2, 0.3]) and quality.get_yscale() == "log"
    seen = set(words(figure))
    assert {"a note", "wrong claims", "quality (m, smaller is better)"} <= seen
    assert any(text.startswith("1-10 m apart\n20 pairs") for text in seen)
    assert words(figure).count("2.5") == 3 and words(figure).count("0.90") == 3


def test_landmark_quality_says_where_a_variant_claims_nothing() -> None:
    bands = quality_bands(suburbs=1)
    bands[["precision_low", "precision_high"]] = np.nan
    silent = bands.variant == "sift"
    quality = ["quality_m_median", "quality_m_q25", "quality_m_q75"]
    bands.loc[silent, ["precision", *quality]] = np.nan
    bands.loc[silent, ["right_a_pair", "wrong_a_pair"]] = 0.0
    figure = landmark_quality_figure(bands)
    assert strays(figure) == [] and words(figure).count("no claim") == 3
    bands[["precision", *quality]] = np.nan
    assert strays(landmark_quality_figure(bands)) == []


def test_precision_recall_is_a_line_a_variant_with_its_threshold_marked() -> None:
    curves = pd.DataFrame(
        [
            (band_m, variant, 0.9 - k / 10, 1 - k / 10, k / 10, k == 1)
            for band_m, variants in {"1-10": ("sift", "cnn"), "10-20": ("cnn",)}.items()
            for variant in variants
            for k in range(4)
        ],
        columns=["band_m", "variant", "threshold", "precision", "recall", "in_use"],
    )
    figure = precision_recall_figure(curves, "a note")
    assert strays(figure) == []
    assert [axes.get_title() for axes in figure.axes] == ["1-10 m apart", "10-20 m apart"]
    assert [len(axes.lines) for axes in figure.axes] == [4, 2]  # a line and a marker a variant
    line, marker = figure.axes[1].lines
    assert list(line.get_xdata()) == [0.0, 0.1, 0.2, 0.3]
    assert (list(marker.get_xdata()), list(marker.get_ydata())) == ([0.1], [0.9])
    assert {"a note", "no claim: sift"} <= set(words(figure))


def test_the_map_has_every_landmark_and_robot() -> None:
    scene = yard()
    figure = scene_map(scene, {"R1": Pose(0.0, 0.0), "R2": Pose(3.0, 0.0, 1.0)})
    assert strays(figure) == []
    assert {"R1", "R2", "other landmarks (12)"} <= set(words(figure))
    # twelve boxes, two robots
    assert len(figure.axes[0].patches) == 14


def test_a_house_is_drawn_by_its_roof() -> None:
    house = box("h", (0.0, 0.0), (6.0, 4.0, 3.0), plain(RED))
    object.__setattr__(house, "kind", "house")
    (outline,) = scene_map(world(house)).axes[0].patches
    corners = outline.get_xy()
    assert np.allclose([corners.min(axis=0), corners.max(axis=0)], [[-3, -2], [3, 2]])


def test_common_landmarks_close_together_are_drawn_once() -> None:
    claims = [claim(0.0, 0.9), claim(0.01, 0.8), claim(1.0, 0.7), claim(-2.0, 0.6)]
    image = panorama().cylinder
    figure = common_landmarks_figure(image, image, claims, SMALL_RIG)
    assert strays(figure) == []
    assert "4 common landmarks; 3 shown, of several close together the surest" in words(figure)
    numbers = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert sorted(numbers) == ["1", "1", "3", "3", "4", "4"]
    assert "1 common landmarks" not in words(
        common_landmarks_figure(image, image, claims[:1], SMALL_RIG)
    )


def test_claims_as_a_table() -> None:
    table = claims_table([claim(0.5, 0.9)])
    assert table.a_bearing_rad.item() == 0.5 and table.matches.item() == 6
    assert list(table[["b_x0_px", "b_y0_px", "b_x1_px", "b_y1_px"]].iloc[0]) == [40, 30, 60, 50]
    assert claims_table([]).empty


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


@pytest.mark.parametrize("kind", ["png", "pdf"])
def test_a_figure_gives_the_same_bytes_every_time(kind: str, tmp_path: Path) -> None:
    for name in ("first", "second"):
        save_figure(update_stages_figure(updates()), updates()[40], tmp_path / name)
    first, second = ((tmp_path / f"{name}.{kind}").read_bytes() for name in ("first", "second"))
    assert first == second
    assert pd.read_csv(tmp_path / "first.csv").shape == updates()[40].shape
    assert png_bytes(update_stages_figure(updates())) == (tmp_path / "first.png").read_bytes()

"""Figures of the paper's table and times: every value is in them, and no text leaves them."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from drawn import strays, words
from matplotlib.table import Table

from vrchain.experiments.ledger.latency import STAGES
from vrchain.experiments.reproduction.paper import bounds_table, summary_table
from vrchain.plots.reproduction import (
    TABLE_NOTE,
    retrieval_time_figure,
    table_figure,
    update_stages_figure,
    update_time_figure,
)
from vrchain.plots.save import png_bytes, save_figure

SIZES = (40, 200, 500)


def updates(sizes: tuple[int, ...] = SIZES) -> dict[int, pd.DataFrame]:
    tables = {}
    for n in sizes:
        us = np.random.default_rng(n).uniform(0.9, 1.1, (n, len(STAGES)))
        us *= 10.0 ** (np.arange(len(STAGES)) / 2)
        table = pd.DataFrame(us, columns=[f"{stage}_us" for stage in STAGES])
        table["total_us"] = table.sum(axis=1)
        tables[n] = table.assign(ledger_position=range(1, n + 1), robot=["R1", "R2"] * (n // 2))
    return tables


def retrievals() -> dict[int, pd.DataFrame]:
    times_us = {"newest_transaction": 0.07, "panorama": 90.0, "common_landmark": 2e5}
    tables = {}
    for n in SIZES:
        rows = [(way, k, us) for way, us in times_us.items() for k in range(1, n + 1)]
        tables[n] = pd.DataFrame(rows, columns=["way", "position", "time_us"])
    return tables


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


def test_updates_over_servers_have_a_panel_and_an_axis_of_their_own() -> None:
    tables = updates((40, 200))
    over = tables[40].assign(total_us=tables[40].total_us * 50)
    figure = update_time_figure(tables, over=over)
    assert strays(figure) == []
    assert [axes.get_title() for axes in figure.axes] == [
        "40 positions", "200 positions", "40 positions, over three servers",
    ]  # fmt: skip
    ends_ms = [axes.get_ylim()[1] for axes in figure.axes]
    assert ends_ms[0] == ends_ms[1] < over.total_us.max() / 1e3 < ends_ms[2]
    assert not any("beyond the axis" in text for text in words(figure))
    assert any("durable in both robots' folders" in text for text in words(figure))


def test_an_update_beyond_the_axis_is_told() -> None:
    tables = updates((40, 200))
    tables[200].loc[77, "total_us"] = 1e6
    assert any("beyond the axis: 1." in text for text in words(update_time_figure(tables)))


def test_every_stage_of_an_update_has_its_bar() -> None:
    figure = update_stages_figure(updates())
    assert strays(figure) == []
    assert len(figure.axes[0].patches) == len(STAGES) * len(SIZES)
    assert any("µs" in text for text in words(figure))


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


@pytest.mark.parametrize("kind", ["png", "pdf"])
def test_a_figure_gives_the_same_bytes_every_time(kind: str, tmp_path: Path) -> None:
    for name in ("first", "second"):
        save_figure(update_stages_figure(updates()), updates()[40], tmp_path / name)
    first, second = ((tmp_path / f"{name}.{kind}").read_bytes() for name in ("first", "second"))
    assert first == second
    assert pd.read_csv(tmp_path / "first.csv").shape == updates()[40].shape
    shown = [png_bytes(update_stages_figure(updates())) for _ in range(2)]
    assert shown[0] == shown[1] and len(first) < 2 * len(shown[0])

"""How long the ledger takes: updates, retrieval three ways, and the paper's table and bounds."""

from collections.abc import Hashable, Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.table import Table
from matplotlib.transforms import Bbox

from vrchain.experiments.ledger.latency import RETRIEVALS, STAGES, stage_quartiles
from vrchain.experiments.reproduction.paper import BOUNDS, OURS, READINGS, RETRIEVAL, TABLE
from vrchain.plots.style import (
    BLUE,
    GREEN,
    GREY,
    MICROSECONDS,
    RED,
    SIDEWAYS_CM,
    in_units,
    label,
    legend_below,
    note_below,
    panels,
    robot_colour,
)

_WAYS = {
    "newest_transaction": "newest transaction",
    "panorama": "panorama, bytes checked",
    "common_landmark": "common landmark with the other robot",
}
_COLOURS = (BLUE, GREEN, RED)
_MARKERS = ("o", "s", "^")
_STAGES = {
    "encode": "encode records",
    "hash": "hash panorama",
    "sign": "sign",
    "validate": "validate",
    "append_memory": "append in memory",
    "append_durable": "append durably",
    "transmit": "transmit to the\nother robot",
}


def update_time_figure(
    updates: Mapping[int, pd.DataFrame], note: str = "", over: pd.DataFrame | None = None
) -> Figure:
    """Update time of each robot over the positions; one panel for each number of positions.

    over: ``cluster.update_over_servers``, in one more panel.
    """
    drawn = [(f"{n} positions", table) for n, table in updates.items()]
    if over is not None:
        drawn.append((f"{len(over)} positions, over three servers", over))
    figure, _ = panels(5.2 * len(drawn), 3.9, 1, len(drawn))
    hidden = 0
    for axes, (title, table) in zip(figure.axes, drawn, strict=True):
        alike = [table] if table is over else [*updates.values()]
        end_ms = 1.9 * max(float(each.total_us.quantile(0.99)) / 1e3 for each in alike)
        for k, (robot, rows) in enumerate(table.groupby("robot")):
            times_ms = rows.total_us / 1e3
            axes.plot(
                rows.ledger_position, times_ms, _MARKERS[k % 3], ls="-", lw=0.8, ms=3.5,
                color=robot_colour(k), label=f"{robot}: mean {times_ms.mean():.2f} ms",
            )  # fmt: skip
        hidden += int((table.total_us / 1e3 > end_ms).sum())
        axes.set(title=title, xlabel="position in the ledger (R1's and R2's in turn)")
        axes.set(ylim=(0, end_ms))
        axes.legend(loc="upper right")
    figure.axes[0].set_ylabel("update time (ms)")
    title = "One update of the ledger: from the panorama's bytes to the other robot's receipt"
    if over is not None:
        title += "; over servers, until it is durable in both robots' folders"
    figure.suptitle(title)
    beyond = f"Slower updates, beyond the axis: {hidden}. " if hidden else ""
    note_below(figure, f"{beyond}{note}")
    return figure


def update_stages_figure(updates: Mapping[int, pd.DataFrame], note: str = "") -> Figure:
    """What an update's time goes into: median of each stage, its quartiles as a line."""
    figure, axes = panels(8.6, 4.4)
    height, columns = 0.8 / len(updates), [f"{stage}_us" for stage in STAGES]
    for index, (n, rows) in enumerate(stage_quartiles(updates).groupby("positions", sort=False)):
        low, middle, high = rows[columns].to_numpy()
        at = np.arange(len(STAGES)) + (index - (len(updates) - 1) / 2) * height
        axes.barh(
            at, middle, height * 0.9, color=_COLOURS[index % 3], label=f"{n} positions",
            xerr=(middle - low, high - middle), error_kw={"lw": 1.0, "ecolor": "#333333"},
        )  # fmt: skip
        for y, us, right in zip(at, middle, high, strict=True):
            text = f"{us:,.0f}" if us >= 100 else f"{us:.3g}"
            axes.text(right * 1.08, y, text, va="center", fontsize=7.5)
    axes.set(xscale="log", title="Where the time of one update goes")
    axes.set_xlim(0.5, axes.get_xlim()[1] * 3)
    axes.set_yticks(range(len(STAGES)), [_STAGES[stage] for stage in STAGES])
    axes.invert_yaxis()
    axes.set_xlabel("median and quartiles (µs, logarithmic)")
    legend_below(figure, axes.containers[1::2], 3, note)
    return figure


def retrieval_time_figure(retrievals: Mapping[int, pd.DataFrame], note: str = "") -> Figure:
    """Each retrieval over its position, as the paper draws it, one panel a ledger; then the means.

    What the paper prints is a grey band in each reading: from its least mean to its upper bound.
    """
    n_ledgers = len(retrievals)
    figure, (*each, means) = panels(
        3.4 * n_ledgers + 4.2, 5.4, 1, n_ledgers + 1, sharey=True,
        width_ratios=[*[1.0] * n_ledgers, 1.15],
    )  # fmt: skip
    for axes, n in zip(each, retrievals, strict=True):
        axes.set(title=f"{n} positions, each retrieval", xlabel="position in the ledger")
    for (way, name), colour, marker in zip(_WAYS.items(), _COLOURS, _MARKERS, strict=True):
        found = [table[table.way == way] for table in retrievals.values()]
        for axes, rows in zip(each, found, strict=True):
            axes.plot(rows.position, rows.time_us, marker, ms=3, alpha=0.6, color=colour)
        means_us = [float(rows.time_us.mean()) for rows in found]
        means.plot(range(n_ledgers), means_us, marker, ls="-", ms=8, color=colour, label=name)
        for x, us in enumerate(means_us):
            text = in_units(us, MICROSECONDS)
            label(means, text, (x, us), (0, 8), ha="center", fontsize=9, color=colour)
    means.set_xticks(range(n_ledgers), [str(n) for n in retrievals])
    means.set(xlim=(-0.5, n_ledgers - 0.5), title="Mean over each ledger")
    means.set_xlabel("positions in the ledger")
    for axes in figure.axes:
        _paper_bands(axes, named=axes is figure.axes[0])
    figure.axes[0].set(yscale="log", ylim=(1e-3, 1e7))
    figure.axes[0].set_ylabel("time of one retrieval (µs, logarithmic)")
    title = "Retrieval in three ways. Grey: what the paper prints, in both readings of its unit"
    figure.legend(loc="outside upper center", ncols=len(_WAYS), title=title, frameon=False)
    note_below(figure, f"{RETRIEVAL_NOTE}\n{note}".strip())
    return figure


def table_figure(
    summary: pd.DataFrame, bounds: pd.DataFrame, pairs: pd.DataFrame, note: str = ""
) -> Figure:
    """``paper.summary_table`` and ``paper.bounds_table`` drawn; pairs: ``Results.qualities``."""
    heights = len(summary) + 2, len(bounds) + 2
    figure, (upper, lower) = panels(12.5, 9.6, 2, 1, SIDEWAYS_CM, height_ratios=heights)
    rows = summary.to_dict("records")
    table = _draw_table(
        upper,
        ["positions in\nthe ledger", "", "mean update\n(ms)",
         "mean retrieval:\nnewest transaction\n(ms)",
         "mean retrieval:\nchecked panorama\n(ms)", "mean retrieval:\ncommon landmark\n(ms)",
         "mean landmark\nquality (ours: m)"],
        [_table_row(row, pairs) for row in rows],
    )  # fmt: skip
    for line, row in enumerate(rows, start=1):
        if row["source"] != OURS:
            for column in range(7):
                table[line, column].set_text_props(fontstyle="italic", color="#8a4b00")
            # which of the three ways is the paper's own is not known: one cell over all three
            for column, edges in {3: "BTL", 4: "BT", 5: "BTR"}.items():
                table[line, column].visible_edges = edges
    upper.set_title("The paper's table, row beside row")
    table = _draw_table(
        lower,
        ["", "positions in\nthe ledger", "measured here:\nmedian (ms)",
         "95 % took\nless than (ms)", "the slowest\n(ms)", "the paper's text\n(its unit: ms)",
         "ours under it,\nif ms", "ours under it,\nif it means s"],
        [_bound_row(row) for row in bounds.to_dict("records")],
    )  # fmt: skip
    for line in range(1, len(bounds) + 1):
        table[line, 5].set_text_props(fontstyle="italic", color="#8a4b00")
    lower.set_title("The paper's bounds, beside what single updates and retrievals took here")
    note_below(figure, note)
    return figure


def _draw_table(axes: Axes, heads: list[str], cells: list[list[str]]) -> Table:
    axes.set_axis_off()
    whole = Bbox([[0, 0], [1, 1]])
    table = axes.table(cells, colLabels=heads, loc="center", cellLoc="center", bbox=whole)
    table.auto_set_font_size(False)
    table.set_fontsize(9.5)
    table.auto_set_column_width(range(len(heads)))
    for (line, _), cell in table.get_celld().items():
        cell.set(edgecolor="#bbbbbb")
        if line == 0:
            cell.set(facecolor="#dfe8ef", height=1.9 * cell.get_height())
            cell.set_text_props(fontweight="bold")
    return table


TABLE_NOTE = (
    "The paper labels its times milliseconds. As printed, a retrieval takes 18 ns, less than its "
    "timer can see; read as seconds its times are plausible. Both readings are given,\nneither is "
    "claimed, nor which way of retrieving is the paper's. Its text and its table do not agree on "
    "200 positions: by the text an update takes mostly under 0.01 ms and\nrarely near 0.04 ms, by "
    "the table 0.001 ms on average. The formula and unit of its landmark quality are not public; "
    "it may be another measure. Quality here: metres between\nthe median surface points of a "
    "claim's matches in the two views, smaller is better. Pairs: R1's panoramas, each with R2's "
    "nearest, 2-20 m away. Positions: R1's and R2's together."
)
RETRIEVAL_NOTE = (
    "A point is one retrieval: of the position's panorama; of the landmark that it has in common "
    "with the other robot's nearest (at ten positions); of its robot's newest transaction, the "
    "mean of 1000, since one is too short for the clock.\nThe paper speaks of retrieving panoramic "
    "views, and of retrieving a common landmark. As printed its times are less than its timer can "
    "see; read as seconds they are plausible. Neither reading is claimed."
)


def _table_row(row: Mapping[Hashable, Any], pairs: pd.DataFrame) -> list[str]:
    if row["source"] != OURS:  # as exactly as it is printed
        update, retrieval = (_decimal(row[f"mean_{of}_ms"], 6) for of in ("update", "retrieval"))
        retrieval += ", which way: not known"
        quality = f"{row['mean_landmark_quality']:.2f}, unit not known"
        return [str(row["positions"]), row["source"], update, "", retrieval, "", quality]
    times = [_decimal(row[f"mean_{of}_ms"]) for of in ("update", *RETRIEVALS)]
    found = pairs[pairs.positions == row["positions"]].iloc[0]
    quality = f"{found.n_claims:.0f} claims, {found.n_pairs:.0f} pairs"
    if pd.notna(row["mean_landmark_quality_m"]):
        quality = f"{row['mean_landmark_quality_m']:.2f} ({quality})"
    return [str(row["positions"]), row["source"], *times, quality]


def _bound_row(row: Mapping[Hashable, Any]) -> list[str]:
    shares = [row[f"share_under_if_{unit}"] for unit in ("ms", "s")]
    return [
        f"retrieval: {_WAYS[row['of']]}" if row["of"] in _WAYS else row["of"],
        row["positions"],
        *(_decimal(row[f"{what}_ms"]) for what in ("p50", "p95", "max")),
        f"{row['paper_says']} {_decimal(row['paper_value'])}",
        *("not measured" if pd.isna(share) else f"{100 * share:.3g} %" for share in shares),
    ]


def _decimal(value: float, digits: int = 3) -> str:
    """So many significant digits, without an exponent."""
    if pd.isna(value):
        return "not measured"
    return np.format_float_positional(value, precision=digits, fractional=False, trim="-")


def _paper_bands(axes: Axes, named: bool) -> None:
    bounds = [bound for bound in BOUNDS if bound.of == RETRIEVAL]
    means = [row.retrieval for row in TABLE]
    for reading, to_ms in READINGS.items():
        low_us, high_us, *bounds_us = (
            value * to_ms * 1e3 for value in (min(means), max(means), *(b.value for b in bounds))
        )
        axes.axhspan(low_us, max(bounds_us), color="#777777", alpha=0.25, lw=0)
        if named:
            low, high, *ends = (in_units(us, MICROSECONDS) for us in (low_us, high_us, *bounds_us))
            said = ", ".join(f"{b.says} {end}" for b, end in zip(bounds, ends, strict=True))
            axes.text(
                0.02, low_us / 1.2, f"paper, {reading}: means {low} to\n{high}, {said}",
                color=GREY, fontsize=8, va="top", transform=axes.get_yaxis_transform(),
            )  # fmt: skip

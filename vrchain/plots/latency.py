"""How long the ledger takes: updates, retrieval three ways, and the paper's table."""

from collections.abc import Hashable, Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.transforms import Bbox

from vrchain.experiments.latency import PAPER, RETRIEVALS, STAGES
from vrchain.plots.maps import ROBOT_COLOURS

_WAYS = {
    "newest_transaction": "newest transaction",
    "panorama": "panorama, bytes checked",
    "common_landmark": "common landmark with the other robot",
}
_WAY_COLOURS = ("#0072B2", "#009E73", "#D55E00")
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


def update_time_figure(updates: Mapping[int, pd.DataFrame], note: str = "") -> Figure:
    """Update time of each robot over the positions; one panel for each number of positions."""
    figure = Figure(figsize=(5.2 * len(updates), 3.9), layout="constrained")
    panels = np.atleast_1d(figure.subplots(1, len(updates), sharey=True))
    for axes, (n, table) in zip(panels, updates.items(), strict=True):
        for (robot, rows), colour, marker in zip(
            table.groupby("robot"), ROBOT_COLOURS, _MARKERS, strict=False
        ):
            times_ms = rows.total_us / 1e3
            axes.plot(
                rows.ledger_position, times_ms, marker, ls="-", lw=0.8, ms=3.5, color=colour,
                label=f"{robot}: mean {times_ms.mean():.2f} ms",
            )  # fmt: skip
        axes.set_title(f"{n} positions")
        axes.set_xlabel("position in the ledger (R1's and R2's in turn)")
        axes.legend(loc="upper right")
    panels[0].set_ylabel("update time (ms)")
    top = max(float(table.total_us.quantile(0.99)) / 1e3 for table in updates.values())
    panels[0].set_ylim(0, 1.9 * top)
    hidden = sum(int((table.total_us / 1e3 > 1.9 * top).sum()) for table in updates.values())
    figure.suptitle(
        "One update of the ledger: from the panorama's bytes to the other robot's receipt"
    )
    beyond = f"Slower updates, beyond the axis: {hidden}. " if hidden else ""
    _note(figure, f"{beyond}{note}")
    return figure


def update_stages_figure(updates: Mapping[int, pd.DataFrame], note: str = "") -> Figure:
    """What an update's time goes into: median of each stage, its quartiles as a line."""
    figure = Figure(figsize=(8.6, 4.4), layout="constrained")
    axes = figure.add_subplot()
    height = 0.8 / len(updates)
    for index, (n, table) in enumerate(updates.items()):
        stages = table[[f"{stage}_us" for stage in STAGES]]
        low, middle, high = (stages.quantile(q).to_numpy() for q in (0.25, 0.5, 0.75))
        at = np.arange(len(STAGES)) + (index - (len(updates) - 1) / 2) * height
        axes.barh(
            at, middle, height * 0.9, color=_WAY_COLOURS[index % 3], label=f"{n} positions",
            xerr=(middle - low, high - middle), error_kw={"lw": 1.0, "ecolor": "#333333"},
        )  # fmt: skip
        for y, us, right in zip(at, middle, high, strict=True):
            axes.text(
                right * 1.08,
                y,
                f"{us:,.0f}" if us >= 100 else f"{us:.3g}",
                va="center",
                fontsize=7.5,
            )
    axes.set_xscale("log")
    axes.set_xlim(0.5, axes.get_xlim()[1] * 2)
    axes.set_yticks(range(len(STAGES)), [_STAGES[stage] for stage in STAGES])
    axes.invert_yaxis()
    axes.set_xlabel("time in one update (µs, logarithmic): median and quartiles")
    axes.legend(loc="upper right")
    axes.set_title("Where the time of an update goes")
    _note(figure, note)
    return figure


def retrieval_time_figure(retrievals: Mapping[int, pd.DataFrame], note: str = "") -> Figure:
    """Retrieval three ways over the number of positions, beside the paper's value read twice."""
    figure = Figure(figsize=(8.6, 5.0), layout="constrained")
    axes = figure.add_subplot()
    sizes = list(retrievals)
    for (way, label), colour, marker in zip(_WAYS.items(), _WAY_COLOURS, _MARKERS, strict=True):
        means_us = [float(t[t.way == way].mean_us.mean()) for t in retrievals.values()]
        axes.plot(range(len(sizes)), means_us, marker, ls="-", ms=8, color=colour)
        axes.text(-0.4, means_us[0] * 9, label, color=colour, fontweight="bold")
        for x, us in enumerate(means_us):
            axes.annotate(
                _time_text(us), (x, us), xytext=(0, 8), textcoords="offset points", ha="center",
                fontsize=9, color=colour,
            )  # fmt: skip
    _paper_lines(axes, PAPER.retrieval_printed)
    axes.set_yscale("log")
    axes.set_ylim(2e-3, 1e7)
    axes.set_xlim(-0.5, len(sizes))  # room for the paper's values at the right
    axes.set_xticks(range(len(sizes)), [str(n) for n in sizes])
    axes.set_xlabel("positions in the ledger")
    axes.set_ylabel("mean time of one retrieval (µs, logarithmic)")
    axes.set_title("Retrieval in three ways, over the positions in the ledger (mean of R1 and R2)")
    _note(figure, note)
    return figure


def table_figure(summary: pd.DataFrame, pairs: pd.DataFrame, note: str = "") -> Figure:
    """``latency.summary_table`` drawn, the paper's rows below; pairs: ``Results.qualities``."""
    figure = Figure(figsize=(12.5, 4.2), layout="constrained")
    axes = figure.add_subplot()
    axes.set_axis_off()
    heads = [
        "", "positions in\nthe ledger", "mean update\n(ms)",
        "mean retrieval:\nnewest transaction\n(ms)",
        "mean retrieval:\nchecked panorama\n(ms)", "mean retrieval:\ncommon landmark\n(ms)",
        "mean landmark\nquality (m)",
    ]  # fmt: skip
    cells = [_table_row(row, pairs) for row in summary.to_dict("records")]
    whole = Bbox([[0, 0], [1, 1]])
    table = axes.table(cells, colLabels=heads, loc="center", cellLoc="center", bbox=whole)
    table.auto_set_font_size(False)
    table.set_fontsize(9.5)
    table.auto_set_column_width(range(len(heads)))
    for (line, column), cell in table.get_celld().items():
        cell.set_edgecolor("#bbbbbb")
        if line == 0:
            cell.set_facecolor("#dfe8ef")
            cell.set_text_props(fontweight="bold")
            cell.set_height(1.9 * cell.get_height())
        elif line > len(summary) - len(PAPER.rows()):
            cell.set_text_props(fontstyle="italic", color="#8a4b00")
            # the paper does not say which of the three ways is its own: one cell over all three
            cell.visible_edges = {3: "BTL", 4: "BT", 5: "BTR"}.get(column, "closed")
        if column == 0:
            cell.set_text_props(ha="left")
            cell.PAD = 0.03
    axes.set_title("The paper's table, measured here, and the paper's own values")
    _note(figure, note)
    return figure


TABLE_NOTE = (
    "The paper labels both time columns milliseconds. 1.79e-5 ms is 18 ns, less than its timer can "
    "see; read as seconds both are plausible. Both readings are\ngiven, neither is claimed, nor "
    "which row or which way of retrieving a value of the paper belongs to. The formula and unit of "
    "its landmark quality are not\npublic; it may be another measure. Quality here: metres between "
    "the median surface points of a claim's matches in the two views, smaller is better. Pairs: "
    "R1's panoramas, each with R2's nearest,\n2-20 m away. Positions: R1's and R2's together."
)


def _table_row(row: Mapping[Hashable, Any], pairs: pd.DataFrame) -> list[str]:
    if pd.isna(row["positions"]):
        low, high = PAPER.landmark_quality_printed
        update, retrieval = (_decimal(row[f"mean_{what}_ms"]) for what in ("update", "retrieval"))
        quality = f"{low}-{high}, unit not known"
        return [
            row["source"],
            "not known",
            update,
            "",
            f"{retrieval}, which way: not known",
            "",
            quality,
        ]
    times = [row["mean_update_ms"], *(row[f"mean_{way}_ms"] for way in RETRIEVALS)]
    found = pairs[pairs.positions == row["positions"]].iloc[0]
    quality = f"{found.n_claims:.0f} claims, {found.n_pairs:.0f} pairs"
    if pd.notna(row["mean_landmark_quality_m"]):
        quality = f"{row['mean_landmark_quality_m']:.2f} ({quality})"
    return [row["source"], str(row["positions"]), *map(_decimal, times), quality]


def _decimal(value: float) -> str:
    """Three significant digits without an exponent."""
    if pd.isna(value):
        return "not measured"
    return np.format_float_positional(value, precision=3, fractional=False, trim="-")


def _paper_lines(axes: Axes, printed: float) -> None:
    readings = {"as printed, ms": 1e3, "read as s": 1e6}
    for (reading, to_us), style in zip(readings.items(), ("--", ":"), strict=True):
        us = printed * to_us
        axes.axhline(us, color="#777777", ls=style, lw=1.2)
        axes.text(
            0.99, us * 1.15, f"paper {reading}: {_time_text(us)}", color="#555555", fontsize=8.5,
            ha="right", transform=axes.get_yaxis_transform(),
        )  # fmt: skip


def _time_text(us: float) -> str:
    for unit, factor in (("s", 1e6), ("ms", 1e3), ("µs", 1.0)):
        if us >= factor:
            return f"{us / factor:.3g} {unit}"
    return f"{us * 1e3:.3g} ns"


def _note(figure: Figure, text: str) -> None:
    if text:
        figure.supxlabel(text, fontsize=8, color="#555555", x=0.01, ha="left")

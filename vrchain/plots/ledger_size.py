"""How large a ledger gets, beside the paper's inline layout."""

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, NullFormatter, NullLocator

from vrchain.experiments.ledger.size import KEEP, LAYOUTS, TEAM, TOGETHER

_STYLES = {
    "inline": ("#D55E00", "o"),
    "one a block": ("#0072B2", "s"),
    "several a block": ("#56B4E9", "D"),
    "retention": ("#009E73", "^"),
}
_SHORT = {
    "one a block": "one transaction\na block",
    "several a block": f"{TOGETHER} transactions\na block",
    "retention": f"newest {KEEP}\nkept",
}


def ledger_size_figure(sizes: pd.DataFrame, note: str = "") -> Figure:
    """``bloat.ledger_sizes`` over positions, over robots, and what stands beside the panoramas."""
    figure = Figure(figsize=(14.5, 4.9), layout="constrained")
    over_positions, over_robots, beside = figure.subplots(1, 3, width_ratios=(1.25, 1.0, 1.0))
    team = sizes[sizes.robots == TEAM]
    most = sizes.positions.max()
    _curves(over_positions, team, "positions")
    over_positions.set_xlabel("positions in the ledger")
    over_positions.set_title(f"{TEAM} robots")
    _curves(over_robots, sizes[sizes.positions == most], "robots")
    over_robots.set_xlabel("robots")
    over_robots.set_title(f"{most} positions")
    for axes in (over_positions, over_robots):
        axes.set_ylabel("size in files (logarithmic)")
    _bars(beside, team[(team.positions == most) & (team.layout != "inline")])
    beside.set_title(f"Records, beside the panoramas: {TEAM} robots")
    handles, labels = over_positions.get_legend_handles_labels()
    figure.legend(
        handles, labels, loc="outside lower center", ncols=3, frameon=False, fontsize=9, title=note,
        title_fontsize=8,
    )  # fmt: skip
    figure.suptitle("How large a ledger gets")
    return figure


def _curves(axes: Axes, sizes: pd.DataFrame, over: str) -> None:
    alone = sizes[sizes.layout == "one a block"]
    axes.plot(
        alone[over], alone.panorama_bytes, ":", lw=2, color="#333333",
        label="the panoramas alone, each once",
    )  # fmt: skip
    for layout, (colour, marker) in _STYLES.items():
        rows = sizes[sizes.layout == layout].sort_values(over)
        axes.plot(
            rows[over], rows.size_bytes, "-", lw=1.2, marker=marker, ms=7, color=colour,
            label=LAYOUTS[layout],
        )  # fmt: skip
        last = rows.iloc[-1]
        if layout != "several a block":  # it would stand on its neighbour
            axes.annotate(
                _size_text(last.size_bytes), (last[over], last.size_bytes), xytext=(-4, 9),
                textcoords="offset points", ha="right", fontsize=9, color=colour,
            )  # fmt: skip
    computed = sizes[sizes.computed]
    axes.plot(
        computed[over], computed.size_bytes, "o", ms=7, mec=_STYLES["inline"][0], mfc="white",
        label="hollow: computed, being over 2 GB",
    )  # fmt: skip
    axes.set_xscale("log")
    axes.set_yscale("log")
    ticks = sorted(sizes[over].unique())
    axes.set_xticks(ticks, [str(tick) for tick in ticks])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.margins(x=0.12, y=0.1)
    axes.yaxis.set_major_formatter(FuncFormatter(lambda size, _: _size_text(size)))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.grid(axis="y", color="#dddddd", lw=0.6)


def _bars(axes: Axes, sizes: pd.DataFrame) -> None:
    """Bytes that are no panorama's, a position."""
    bytes_each = (sizes.size_bytes - sizes.panorama_bytes) / sizes.positions
    colours = [_STYLES[layout][0] for layout in sizes.layout]
    names = [_SHORT[layout] for layout in sizes.layout]
    bars = axes.bar(names, bytes_each, color=colours, width=0.6)
    axes.bar_label(bars, [f"{value:,.0f}" for value in bytes_each], padding=2)
    axes.set_ylabel("bytes a position")
    axes.margins(y=0.15)


def _size_text(size_bytes: float) -> str:
    for unit, factor in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size_bytes >= factor:
            return f"{size_bytes / factor:.3g} {unit}"
    return f"{size_bytes:.0f} B"

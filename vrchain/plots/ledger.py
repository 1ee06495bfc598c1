"""The ledger: its chain of blocks, how large it gets, and what a flood does to it."""

from collections.abc import Sequence

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch
from matplotlib.ticker import FuncFormatter, NullFormatter, NullLocator

from vrchain.experiments.ledger.flood import BAR, QUIET, FloodConfig
from vrchain.experiments.ledger.size import KEEP, LAYOUTS, TEAM, TOGETHER
from vrchain.ledger import Entry, Transaction
from vrchain.ledger.records.transaction import NO_TRANSACTION
from vrchain.plots.maps import ROBOT_COLOURS

_WIDTH, _GAP, _ROW = 2.0, 0.55, 0.5


def ledger_figure(entries: Sequence[Entry], title: str = "The ledger's first blocks") -> Figure:
    """Blocks from left to right; in each, every robot's newest transaction."""
    robots = [robot for robot, _ in entries[-1].block.newest]
    figure = Figure(
        figsize=(2.05 * len(entries) + 0.2, 2.15 + 0.42 * len(robots)), layout="constrained"
    )
    axes = figure.add_subplot()
    known: dict[bytes, Transaction] = {}
    top = 1.42 + _ROW * len(robots)
    for index, entry in enumerate(entries):
        known |= {r.id: r for r in entry.records if isinstance(r, Transaction)}
        _draw_block(axes, index * (_WIDTH + _GAP), top, entry, robots, known)
        if index:
            start = index * (_WIDTH + _GAP)
            axes.add_patch(
                FancyArrowPatch(
                    (start, top - 0.78), (start - _GAP, top - 0.42), arrowstyle="-|>",
                    mutation_scale=13, color="#333333", lw=1.3,
                )
            )  # fmt: skip
    axes.set_xlim(-0.1, len(entries) * (_WIDTH + _GAP) - _GAP + 0.1)
    axes.set_ylim(-0.55, top + 0.1)
    axes.set_axis_off()
    axes.text(
        0, -0.1,
        "Filled: a new transaction, signed by its robot. Outlined: carried over from the block "
        "before.\nArrows: each block holds the hash of the one before it.",
        fontsize=9, va="top", color="#333333",
    )  # fmt: skip
    figure.suptitle(title, fontsize=12)
    return figure


def ledger_table(entries: Sequence[Entry]) -> pd.DataFrame:
    """One row per (block, robot): height, hash, previous_hash, author, robot, transaction, new."""
    rows = []
    for entry in entries:
        block, brought = entry.block, {record.id for record in entry.records}
        for robot, newest in block.newest:
            rows.append(
                {
                    "height": block.height,
                    "hash": block.hash.hex(),
                    "previous_hash": block.previous_hash.hex(),
                    "timestamp_s": block.timestamp_ns / 1e9,
                    "author": block.author,
                    "robot": robot,
                    "newest_transaction": "" if newest == NO_TRANSACTION else newest.hex(),
                    "new": newest in brought,
                }
            )
    return pd.DataFrame(rows)


def _draw_block(
    axes: Axes,
    left: float,
    top: float,
    entry: Entry,
    robots: Sequence[str],
    known: dict[bytes, Transaction],
) -> None:
    block, brought = entry.block, {record.id for record in entry.records}
    axes.add_patch(
        FancyBboxPatch(
            (left, 0), _WIDTH, top, boxstyle="round,pad=0,rounding_size=0.08", facecolor="#f6f6f2",
            edgecolor="#333333", lw=1.2,
        )
    )  # fmt: skip
    title = "block 0: genesis" if block.height == 0 else f"block {block.height}"
    axes.text(left + 0.1, top - 0.16, title, fontsize=10, fontweight="bold", va="center")
    lines = {
        "hash": block.hash.hex()[:8] + "…",
        "previous": "none" if block.height == 0 else block.previous_hash.hex()[:8] + "…",
        "time": f"{block.timestamp_ns / 1e9:.1f} s",
        "author": block.author,
    }
    for number, (name, value) in enumerate(lines.items()):
        y = top - 0.42 - 0.25 * number
        axes.text(left + 0.1, y, name, fontsize=8, va="center", color="#666666")
        axes.text(left + 0.78, y, value, fontsize=8, va="center", family="monospace")
    newest = dict(block.newest)
    for number, robot in enumerate(robots):
        colour = ROBOT_COLOURS[number % len(ROBOT_COLOURS)]
        y = 0.1 + _ROW * (len(robots) - 1 - number)
        transaction = known.get(newest.get(robot, NO_TRANSACTION))
        is_new = transaction is not None and transaction.id in brought
        axes.add_patch(
            FancyBboxPatch(
                (left + 0.08, y), _WIDTH - 0.16, _ROW - 0.12,
                boxstyle="round,pad=0,rounding_size=0.05", lw=1.2,
                facecolor=colour if is_new else "white",
                edgecolor=colour if transaction else "#cccccc",
            )
        )  # fmt: skip
        text = f"{robot}: nothing yet"
        if transaction is not None:
            text = f"{robot} no. {transaction.sequence} ({transaction.reason})"
        axes.text(
            left + 0.16, y + (_ROW - 0.12) / 2, text, fontsize=8.5, va="center",
            color="white" if is_new else (colour if transaction else "#999999"),
            fontweight="bold" if is_new else "normal",
        )  # fmt: skip


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


_FATES = {
    "admitted": ("admitted", "#009E73"),
    "SignatureError": ("signature does not hold", "#D55E00"),
    "InputLimitError": ("too large", "#CC79A7"),
    "RateLimitError": ("over the robot's rate", "#E69F00"),
    "other": ("duplicate, or after a gap", "#F0E442"),
    "unheard": ("sent, not listened to", "#BBBBBB"),
}


def flood_figure(table: pd.DataFrame, floods: pd.DataFrame, config: FloodConfig) -> Figure:
    """``summarise`` and ``outcomes`` of an experiment with ``config``."""
    figure = Figure(figsize=(12.5, 0.5 * len(table) + 2.6), layout="constrained")
    noticed, became = figure.subplots(1, 2, sharey=True, width_ratios=(1.1, 1.0))
    places = range(len(table))
    quiet_ms = float(table.reference_us.iloc[0]) / 1e3
    limit_ms = BAR * quiet_ms
    for place, row in zip(places, table.itertuples(), strict=True):
        ends_ms = [float(row.median_us) / 1e3, float(row.p99_us) / 1e3]  # type: ignore[arg-type]
        noticed.plot(ends_ms, [place, place], "-", lw=1.2, color="#999999", zorder=1)
        noticed.plot(ends_ms[:1], [place], "o", ms=7, color="#0072B2")
        noticed.plot(ends_ms[1:], [place], "D", ms=7, color="#D55E00")
        if row.name != QUIET:
            text = f"{row.ratio:.2f} x ({row.ratio_low:.2f} to {row.ratio_high:.2f})"
            noticed.annotate(
                text, (ends_ms[1], place), xytext=(9, 0), textcoords="offset points", va="center",
                fontsize=8.5, bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.5},
            )  # fmt: skip
    noticed.axvline(quiet_ms, color="#D55E00", lw=0.9, ls=":")
    noticed.axvline(limit_ms, color="#333333", lw=1.1, ls="--")
    top = len(table) - 0.45
    noticed.text(limit_ms, -0.5, f" {BAR:g} x quiet", fontsize=8.5, va="center")
    noticed.set_yticks(places, list(table["name"]))
    noticed.set_ylim(top, -0.6)
    most_ms = max(float(table.p99_us.max()) / 1e3, limit_ms)
    noticed.set_xlim(0, 1.45 * most_ms)
    noticed.set_xlabel("until a transaction is durable (ms): median ●, 99th percentile ◆")
    refused = int(table.refused.sum())
    noticed.set_title(
        f"What the {config.robots} honest robots notice: "
        f"{refused} of their {table.positions.sum()} refused"
    )
    shares = _shares(floods).reindex(table["name"])
    left = pd.Series(0.0, index=shares.index)
    for fate, (label, colour) in _FATES.items():
        became.barh(places, shares[fate], left=left, height=0.6, color=colour, label=label)
        left += shares[fate]
    sent = floods.set_index("name")["sent"].reindex(table["name"])
    for place, number in zip(places, sent, strict=True):
        became.text(1.02, place, f"{number:,.0f}" if number else "none", va="center", fontsize=9)
    became.set_xlim(0, 1.16)
    became.set_xticks([0, 0.25, 0.5, 0.75, 1.0], ["0", "25 %", "50 %", "75 %", "100 %"])
    became.set_xlabel("share of the messages that the flooder got rid of; how many")
    became.set_title("What becomes of the flood")
    figure.legend(*became.get_legend_handles_labels(), loc="outside lower center", ncols=6)
    figure.suptitle("One robot floods the one that takes in transactions")
    return figure


def _shares(floods: pd.DataFrame) -> pd.DataFrame:
    """Of the messages sent, by fate."""
    counts = floods.set_index("name").drop(columns=["sent", "sent_mb", "gate_busy"])
    named = [fate for fate in _FATES if fate in counts]
    fates = counts.reindex(columns=list(_FATES), fill_value=0.0)
    fates["other"] = counts.drop(columns=named).sum(axis="columns")
    return fates.div(fates.sum(axis="columns").clip(lower=1), axis="index")

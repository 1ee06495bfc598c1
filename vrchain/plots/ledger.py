"""The ledger: its chain of blocks, and how large it gets."""

from collections.abc import Sequence
from typing import Any

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch
from matplotlib.ticker import MaxNLocator, NullFormatter, NullLocator

from vrchain.errors import LedgerError
from vrchain.experiments.ledger.size import KEEP, LAYOUTS, TEAM, TOGETHER
from vrchain.experiments.ledger.transmission import WAYS
from vrchain.ledger import Entry, Transaction
from vrchain.ledger.records.transaction import NO_TRANSACTION
from vrchain.plots.style import (
    BLUE,
    BYTES,
    GREEN,
    RED,
    SIDEWAYS_CM,
    SKY,
    in_units,
    label,
    legend_below,
    panels,
    robot_colour,
)

_WIDTH, _GAP, _ROW = 2.0, 0.55, 0.5  # of a block of the chain
_STYLES = {
    "inline": (RED, "o"),
    "one a block": (BLUE, "s"),
    "several a block": (SKY, "D"),
    "retention": (GREEN, "^"),
}
_WIRES = {"everyone": (RED, "o"), "blobs": (BLUE, "s"), "fetched": (GREEN, "^")}
_SHORT = {
    "one a block": "one transaction\na block",
    "several a block": f"{TOGETHER} transactions\na block",
    "retention": f"newest {KEEP}\nkept",
}


def ledger_figure(entries: Sequence[Entry], title: str = "The ledger's first blocks") -> Figure:
    """Blocks from left to right; in each, every robot's newest transaction. LedgerError: none."""
    if not entries:
        raise LedgerError("expected entries of a ledger to draw, got none")
    robots = [robot for robot, _ in entries[-1].block.newest]
    figure, axes = panels(
        2.05 * len(entries) + 0.2, 2.15 + 0.42 * len(robots), print_cm=SIDEWAYS_CM
    )
    known: dict[bytes, Transaction] = {}
    top = 1.42 + _ROW * len(robots)
    for index, entry in enumerate(entries):
        known |= {r.id: r for r in entry.records if isinstance(r, Transaction)}
        left = index * (_WIDTH + _GAP)
        _draw_block(axes, left, top, entry, robots, known)
        if index:
            axes.annotate(
                "", (left - _GAP, top - 0.42), (left, top - 0.78),
                arrowprops={
                    "arrowstyle": "-|>", "mutation_scale": 13, "color": "#333333", "lw": 1.3,
                },
            )  # fmt: skip
    end = len(entries) * (_WIDTH + _GAP) - _GAP
    axes.set(xlim=(-0.1, end + 0.1), ylim=(-0.55, top + 0.1))
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
    rows = [
        {
            "height": block.height,
            "hash": block.hash.hex(),
            "previous_hash": block.previous_hash.hex(),
            "timestamp_s": block.timestamp_ns / 1e9,
            "author": block.author,
            "robot": robot,
            "newest_transaction": "" if newest == NO_TRANSACTION else newest.hex(),
            "new": newest in {record.id for record in records},
        }
        for block, records in entries
        for robot, newest in block.newest
    ]
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
    _rounded(axes, left, 0, _WIDTH, top, 0.08, facecolor="#f6f6f2", edgecolor="#333333")
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
        colour = robot_colour(number)
        y = 0.1 + _ROW * (len(robots) - 1 - number)
        transaction = known.get(newest.get(robot, NO_TRANSACTION))
        is_new = transaction is not None and transaction.id in brought
        none_yet = newest.get(robot, NO_TRANSACTION) == NO_TRANSACTION
        text = f"{robot}: {'nothing yet' if none_yet else 'an earlier one'}"
        ink, edge = "#999999", "#cccccc"
        if transaction is not None:
            text = f"{robot} no. {transaction.sequence} ({transaction.reason})"
            ink, edge = "white" if is_new else colour, colour
        _rounded(
            axes, left + 0.08, y, _WIDTH - 0.16, _ROW - 0.12, 0.05,
            facecolor=colour if is_new else "white", edgecolor=edge,
        )  # fmt: skip
        axes.text(
            left + 0.16, y + (_ROW - 0.12) / 2, text, fontsize=8.5, va="center", color=ink,
            fontweight="bold" if is_new else "normal",
        )  # fmt: skip


def _rounded(
    axes: Axes, x: float, y: float, width: float, height: float, radius: float, **style: Any
) -> None:
    shape = f"round,pad=0,rounding_size={radius}"
    axes.add_patch(FancyBboxPatch((x, y), width, height, boxstyle=shape, lw=1.2, **style))


def ledger_size_figure(sizes: pd.DataFrame, note: str = "") -> Figure:
    """``size.ledger_sizes`` over positions, over robots, and what stands beside the panoramas."""
    figure, (over_positions, over_robots, beside) = panels(
        14.5, 4.9, 1, 3, width_ratios=(1.25, 1.0, 1.0)
    )
    team, most = sizes[sizes.robots == TEAM], sizes.positions.max()
    _size_curves(over_positions, team, "positions")
    over_positions.set(xlabel="positions in the ledger", title=f"{TEAM} robots")
    _size_curves(over_robots, sizes[sizes.positions == most], "robots")
    over_robots.set(xlabel="robots", title=f"{most} positions")
    _record_bars(beside, team[(team.positions == most) & (team.layout != "inline")])
    beside.set_title(f"Records, beside the panoramas: {TEAM} robots")
    legend_below(figure, over_positions.lines, 3, note)
    figure.suptitle("How large a ledger gets")
    return figure


def transmission_figure(table: pd.DataFrame, payload_bytes: int, note: str = "") -> Figure:
    """``transmission.transmission``: on all wires, messages, and what one robot sends."""
    figure, (on_wires, messages, sent) = panels(14.5, 4.9, 1, 3)
    robots = table.robots.drop_duplicates()
    square = "n² panoramas: the formula"
    on_wires.plot(robots, robots**2 * payload_bytes, ":", lw=2.5, color="#333333", label=square)
    for axes, what in ((on_wires, "bytes"), (messages, "messages"), (sent, "sent_bytes")):
        for way, (colour, marker) in _WIRES.items():
            rows = table[(table.way == way) & ~table.measured]
            axes.plot(
                rows.robots, rows[what], marker, ls="-", lw=1.2, ms=7, color=colour,
                label=WAYS[way], mfc="white" if way == "fetched" else colour,
            )  # fmt: skip
        axes.set(xscale="log", yscale="log", xlabel="robots, one panorama each")
        axes.set_xticks(list(robots), [str(count) for count in robots])
        axes.xaxis.set_minor_locator(NullLocator())
        axes.grid(axis="y", color="#dddddd", lw=0.6)
    for axes in (on_wires, sent):
        axes.yaxis.set_major_formatter(lambda size, _: in_units(size, BYTES))
    on_wires.set(title="On all wires", ylabel="bytes (logarithmic)")
    messages.set(title="Messages", ylabel="messages (logarithmic)")
    sent.set(title="Sent by one robot", ylabel="bytes (logarithmic)")
    legend_below(figure, on_wires.lines, 4, note)
    figure.suptitle("What a team sends until every robot can have every panorama")
    return figure


def regions_figure(table: pd.DataFrame, note: str = "") -> Figure:
    """``regions.regional``: what a robot receives, beside what it misses, a bar a way."""
    figure, (received, lost) = panels(11.5, 4.2, 1, 2, sharey=True)
    received.barh(table.follows, table.received_bytes, color=BLUE)
    received.bar_label(
        received.containers[0], [in_units(n, BYTES) for n in table.received_bytes], padding=3
    )
    received.xaxis.set_major_formatter(lambda size, _: in_units(size, BYTES))
    received.xaxis.set_major_locator(MaxNLocator(4, prune="upper"))
    received.set(title="What a robot receives", xlabel="bytes")
    for k, (share, colour, name) in enumerate(
        (
            (table.missed / table.common, SKY, "in common with another's panorama: not received"),
            (table.lost / table.landmarks, RED, "in common with nobody's that is received"),
        )
    ):
        at = [row + 0.2 - 0.4 * k for row in range(len(table))]
        bars = lost.barh(at, 100 * share, 0.38, color=colour, label=name)
        lost.bar_label(bars, [f"{100 * value:.1f} %" for value in share], padding=3)
    lost.set(title="What it misses of landmarks in common", xlabel="share (%)")
    received.invert_yaxis()
    for axes in (received, lost):
        axes.margins(x=0.25)
    legend_below(figure, lost.containers, 2, note)
    figure.suptitle("A ledger for each region: a robot follows ...")
    return figure


def _size_curves(axes: Axes, sizes: pd.DataFrame, over: str) -> None:
    alone = sizes[sizes.layout == "one a block"]
    panoramas = "the panoramas alone, each once"
    axes.plot(alone[over], alone.panorama_bytes, ":", lw=2, color="#333333", label=panoramas)
    for layout, (colour, marker) in _STYLES.items():
        rows = sizes[sizes.layout == layout].sort_values(over)
        axes.plot(
            rows[over], rows.size_bytes, marker, ls="-", lw=1.2, ms=7, color=colour,
            label=LAYOUTS[layout],
        )  # fmt: skip
        last = rows.iloc[-1]
        if layout != "several a block":  # it would stand on its neighbour
            text, at = in_units(last.size_bytes, BYTES), (last[over], last.size_bytes)
            label(axes, text, at, (-4, 9), ha="right", fontsize=9, color=colour)
    computed = sizes[sizes.computed]
    axes.plot(
        computed[over], computed.size_bytes, "o", ms=7, mec=_STYLES["inline"][0], mfc="white",
        label="hollow: computed, being over 2 GB",
    )  # fmt: skip
    axes.set(xscale="log", yscale="log", ylabel="size in files (logarithmic)")
    ticks = sorted(sizes[over].unique())
    axes.set_xticks(ticks, [str(tick) for tick in ticks])
    axes.xaxis.set_minor_locator(NullLocator())
    axes.margins(x=0.12, y=0.1)
    axes.yaxis.set_major_formatter(lambda size, _: in_units(size, BYTES))
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.grid(axis="y", color="#dddddd", lw=0.6)


def _record_bars(axes: Axes, sizes: pd.DataFrame) -> None:
    """Bytes that are no panorama's, a position."""
    bytes_each = (sizes.size_bytes - sizes.panorama_bytes) / sizes.positions
    colours = [_STYLES[layout][0] for layout in sizes.layout]
    bars = axes.bar(sizes.layout.map(_SHORT), bytes_each, color=colours, width=0.6)
    axes.bar_label(bars, [f"{value:,.0f}" for value in bytes_each], padding=2)
    axes.set_ylabel("bytes a position")
    axes.margins(y=0.15)

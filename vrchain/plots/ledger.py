"""The chain as a picture: blocks, the hashes that join them, what each brings or carries over."""

from collections.abc import Sequence

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch

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

"""How many arrive when segments of their chains are lost."""

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vrchain.experiments.planning.lost_segments import METHODS, PROBABILITIES, RULES
from vrchain.experiments.planning.published_drives import AS_PUBLISHED, PUBLISHED, TO_TARGET
from vrchain.plots.style import BLUE, PAGE_CM, RED, legend_below, panels

TEAMS_SHOWN = (10, 40, 90)
_COLOURS = dict(zip(METHODS, ("#7a8694", "#c9a227", BLUE, RED, "#c2185b"), strict=True))
_DASHED = METHODS[:2]  # without spares
_RULES = {
    "drive": "lost anew at each drive,\n40 robots",
    "standing": "what is lost stays lost,\n40 robots",
}


def planning_figure(shares: pd.DataFrame, teams: pd.DataFrame) -> Figure:
    """Share that arrives over the probability of a loss.

    First row, of ``published_drives.by_team``: one drive, a column a size of team, beside the
    published shares. Then, of ``lost_segments.shares``: a row a rule, a column a drive more.
    Bars: 95 % interval of ours.
    """
    drives = sorted(shares.drives.unique())[:3]
    figure, (first, *rest) = panels(10.2, 10.2, 1 + len(RULES), len(drives), PAGE_CM, sharey=True)
    for axes, robots in zip(first, TEAMS_SHOWN, strict=True):
        _published_panel(axes, teams[teams.robots == robots], robots)
        axes.set_title(f"1 drive, {robots} robots", fontsize=10)
    first[-1].text(
        0.97, 0.97, "above the line: many of these drives\ndid not end at the target",
        transform=first[-1].transAxes, ha="right", va="top", fontsize=8,
        color=_COLOURS["shortened chain, robust"],
    )  # fmt: skip
    first[0].set_ylabel("share that arrives\nlost anew at each drive")
    for row, rule in zip(rest, RULES, strict=True):
        for axes, most in zip(row, drives, strict=True):
            _panel(axes, shares[(shares.rule == rule) & (shares.drives == most)])
            axes.set_title(f"{most} drive{'s' if most > 1 else ''}", fontsize=10)
        row[0].set_ylabel(f"share that arrives\n{_RULES[rule]}")
    for axes in rest[-1]:
        axes.set_xlabel("probability p that a landmark is lost")
    handles: dict[str, Artist] = {}
    for line in (*first[0].lines, *rest[-1][-1].lines):
        handles.setdefault(line.get_label(), line)
    legend_below(figure, handles.values(), 3)
    figure.suptitle(
        "Chains planned and driven while landmarks get lost, and planned again\n"
        "(lines that are not dotted: every path ends at the target)"
    )
    return figure


def _published_panel(axes: Axes, teams: pd.DataFrame, robots: int) -> None:
    for method, published in PUBLISHED.items():
        colour = _COLOURS[method]
        shares, name = published[robots], f"{method}: published"
        axes.plot(shares.index, shares, "s", ms=4.5, mfc="none", color=colour, label=name)
        line = teams[(teams.rule == AS_PUBLISHED) & (teams.method == method)]
        again = f"{method}: as published, run here"
        axes.plot(line.p, line.arrives, ":", color=colour, label=again)
    reached = teams[teams.rule == TO_TARGET]
    for method in (*PUBLISHED, METHODS[-1]):
        _line(axes, reached, method)
    p, most = np.unique(reached.p), "most that a path to the target can reach"
    axes.plot(p, 1 - 100 * p / 101, "-", color="black", lw=0.8, zorder=2, label=most)
    axes.grid(alpha=0.3)


def _panel(axes: Axes, shares: pd.DataFrame) -> None:
    for method in METHODS:
        _line(axes, shares, method, marker="o")
    axes.set_xticks(PROBABILITIES)
    axes.set_ylim(0, 1.03)
    axes.grid(alpha=0.3)


def _line(axes: Axes, shares: pd.DataFrame, method: str, marker: str = "") -> None:
    line = shares[shares.method == method].sort_values("p")
    ours = method == METHODS[-1]
    axes.plot(
        line.p, line.arrives, marker=marker, ls="--" if method in _DASHED else "-", ms=4,
        lw=2.6 if ours else 1.4, color=_COLOURS[method], label=method, zorder=4 if ours else 3,
    )  # fmt: skip
    if ours:
        axes.vlines(line.p, line.low, line.high, color=_COLOURS[method], lw=1.4, zorder=4)

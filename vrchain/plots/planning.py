"""How many arrive when segments of their chains are lost."""

import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vrchain.experiments.planning import METHODS, PROBABILITIES, PUBLISHED_SHARES, RULES

_COLOURS = dict(zip(METHODS, ("#7a8694", "#c9a227", "#0072B2", "#D55E00", "#c2185b"), strict=True))
_DASHED = METHODS[:2]  # without spares
_RULES = {
    "drive": "lost anew at each drive (published rule)",
    "standing": "what is lost stays lost",
}


def planning_figure(shares: pd.DataFrame) -> Figure:
    """Share that arrives over the probability of a loss; a row a rule, a column a drive more.

    Open markers: the published shares, after one drive. Bars: 95 % interval of ours.
    """
    drives = sorted(shares.drives.unique())[:3]
    figure = Figure(figsize=(10.2, 6.8), layout="constrained")
    panels = figure.subplots(len(RULES), len(drives), sharex=True, sharey=True)
    for row, rule in zip(panels, RULES, strict=True):
        for axes, most in zip(row, drives, strict=True):
            _panel(axes, shares[(shares.rule == rule) & (shares.drives == most)])
            axes.set_title(f"{most} drive{'s' if most > 1 else ''}", fontsize=10)
        row[0].set_ylabel(f"share that arrives\n{_RULES[rule]}")
    _one_drive_as_published(panels[0, 0])
    for axes in panels[-1]:
        axes.set_xlabel("probability that a landmark is lost")
    handles: dict[str, Artist] = {}
    for axes in (panels[0, 0], panels[-1, -1]):
        for handle, label in zip(*axes.get_legend_handles_labels(), strict=True):
            handles.setdefault(label, handle)
    figure.legend(
        list(handles.values()), list(handles), loc="outside lower center", ncols=4, frameon=False
    )
    figure.suptitle("40 robots, 400 landmarks: chains planned, driven, and planned again")
    return figure


def _panel(axes: Axes, shares: pd.DataFrame) -> None:
    for method in METHODS:
        line = shares[shares.method == method].sort_values("p")
        ours = method == METHODS[-1]
        axes.plot(
            line.p, line.arrives, marker="o", ls="--" if method in _DASHED else "-", ms=4,
            lw=2.6 if ours else 1.4, color=_COLOURS[method], label=method, zorder=4 if ours else 3,
        )  # fmt: skip
        if ours:
            axes.vlines(line.p, line.low, line.high, color=_COLOURS[method], lw=1.4, zorder=4)
    axes.set_xticks(PROBABILITIES)
    axes.set_ylim(0, 1.03)
    axes.grid(alpha=0.3)


def _one_drive_as_published(axes: Axes) -> None:
    for method, line in PUBLISHED_SHARES.items():
        axes.plot(
            PROBABILITIES, line, "s", ms=8, mfc="none", mew=1.6, color=_COLOURS[method],
            label=f"published: {method}", zorder=5,
        )  # fmt: skip
    axes.plot(
        PROBABILITIES, [1 - p for p in PROBABILITIES], ":", color="black", lw=1.2,
        label="most that one drive allows: 1 - p", zorder=2,
    )  # fmt: skip

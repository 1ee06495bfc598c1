"""Common landmarks over the distance between two robots: how many, how right, how well placed."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

_RIGHT, _WRONG = "#0072B2", "#D55E00"
_FLOOR_M = 1e-3  # a logarithmic axis has no zero


def landmark_quality_figure(claims: pd.DataFrame, bands: pd.DataFrame, note: str = "") -> Figure:
    """Claims of ``landmarks.landmark_pairs`` with a column band_m; bands: their summaries."""
    figure = Figure(figsize=(11, 4.4), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[1.6, 1])
    made = claims[claims.score.notna() & ~claims.duplicate.eq(True)]
    for is_right, colour, marker, label in (
        (True, _RIGHT, "o", "right: both on one landmark"),
        (False, _WRONG, "x", "wrong"),
    ):
        rows = made[made.right == is_right]
        left.plot(
            rows.spacing_m, rows.quality_m.clip(lower=_FLOOR_M), marker, color=colour, ls="none",
            ms=6, alpha=0.8, label=f"{label} ({len(rows)})",
        )  # fmt: skip
    left.set_yscale("log")
    left.set_xlabel("distance between the two robots (m)")
    left.set_ylabel("quality (m, smaller is better)")
    left.set_title("each claim of a common landmark (at 0.001 m: that or less)", fontsize=10)
    left.legend(loc="best")
    _bars(right, bands)
    figure.suptitle("How well two robots agree on a landmark, over the distance between them")
    _note(figure, note)
    return figure


def _bars(axes: Any, bands: pd.DataFrame) -> None:
    shares: Mapping[str, tuple[str, str]] = {
        "precision": ("claims that are right", "#0072B2"),
        "pair_success": ("pairs whose surest claim is right", "#E69F00"),
        "recall": ("common landmarks found", "#009E73"),
    }
    width = 0.8 / len(shares)
    for index, (column, (label, colour)) in enumerate(shares.items()):
        at = np.arange(len(bands)) + (index - 1) * width
        bars = axes.bar(at, bands[column], width * 0.92, color=colour, label=label)
        axes.bar_label(bars, [f"{v:.2f}" for v in bands[column]], fontsize=8, padding=2)
    names = [f"{b.band_m} m apart\n{b.n_pairs} pairs" for b in bands.itertuples()]
    axes.set_xticks(range(len(bands)), names)
    axes.set_ylim(0, 1.45)
    axes.set_yticks(np.arange(0, 1.01, 0.25))
    axes.set_ylabel("share")
    axes.legend(loc="upper center", fontsize=8)
    axes.set_title("over all pairs of a band", fontsize=10)


def _note(figure: Figure, text: str) -> None:
    if text:
        figure.supxlabel(text, fontsize=8, color="#555555", x=0.01, ha="left")

"""Move the threshold for a claim along the curves of precision against recall."""

import pandas as pd

from vrchain.experiments.landmarks.over_distance import precision_recall
from vrchain.experiments.reproduction.results import Results
from vrchain.play.controls import WIDTH_IN, Choice, Play, Shown, Slider
from vrchain.plots.style import BLUE, GREEN, ORANGE, panels

_COLOURS = BLUE, GREEN, ORANGE


def threshold(results: Results | None = None, variant: str = "cnn+sift") -> Play:
    """A variant's claims at a threshold: how many of them are right, how many landmarks are found.

    results: ``Results.here()`` if none are given; ReproductionError without them.
    """
    results = results or Results.here()
    claims, pairs = (results.table("landmarks", name) for name in ("pairs", "pairs_drawn"))
    curves = precision_recall(claims, pairs)
    variants = tuple(curves.variant.unique())

    def draw(threshold: float, variant: str) -> Shown:
        figure, axes = panels(WIDTH_IN, 5.4)
        own = curves[curves.variant == variant]
        rows = []
        for number, band_m in enumerate(own.band_m.unique()):
            line, colour = own[own.band_m == band_m], _COLOURS[number % len(_COLOURS)]
            name = f"{band_m} m apart"
            axes.plot(line.recall, line.precision, color=colour, lw=2, label=name)
            made = line[line.threshold >= threshold]
            row: dict[str, object] = {"apart (m)": band_m, "precision": None, "recall": 0.0}
            if len(made):  # in falling order: the last one is the point
                at = made.iloc[-1]
                axes.plot(at.recall, at.precision, "o", color=colour, mec="black", ms=11, zorder=4)
                row |= {"precision": at.precision, "recall": at.recall}
            rows.append(row)
        axes.legend(loc="lower left", frameon=False)
        axes.set(
            xlim=(0, 1.05 * max(curves.recall.max(), 0.05)), ylim=(0, 1.04),
            xlabel="recall: share of the landmarks that both see which is found",
            ylabel="precision: share of the claims that is right",
        )  # fmt: skip
        axes.set_title(f"{variant} at the threshold {threshold:.2f}", fontsize=10)
        axes.grid(alpha=0.3)
        used = ", ".join(f"{v:.2f}" for v in own[own.in_use].threshold.unique()[:1])
        says = (
            f"Claims that are right with a probability of {threshold:.2f} or more, by {variant}. "
            f"In use: {used or 'none'}. A lower threshold finds more, and errs more."
        )
        table = pd.DataFrame(rows).astype({"precision": float}).round(3)
        return Shown(says, figure, table)

    if variant not in variants:
        variant = variants[0]
    return Play(
        draw,
        {
            "threshold": Slider("threshold", 0.0, 1.0, 0.01, 0.85),
            "variant": Choice("found by", variants, variant),
        },
    )

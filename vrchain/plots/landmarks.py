"""Common landmarks: how many and how right over distance; proposals, and the worst mistakes."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import StrMethodFormatter
from numpy.typing import NDArray

from vrchain.experiments.landmarks.mistakes import Mistake
from vrchain.landmarks.extraction.proposer import KINDS, Proposals
from vrchain.landmarks.matching.common import Region
from vrchain.panorama import Panorama
from vrchain.plots.pictures import region_box
from vrchain.plots.style import (
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PAGE_CM,
    claim_colour,
    label,
    legend_below,
    outline,
    panels,
    tag,
)

_LOOKS = {  # the markers tell them apart in grey
    "sift": (ORANGE, "s", "sift: keypoints alone, nothing learned"),
    "cnn": (GREEN, "^", "cnn: a network alone"),
    "cnn+sift": (BLUE, "o", "cnn+sift: both, as the robots use it"),
}
_BAND = 0.8  # width of a band's bars together, of the way to the next band
_AROUND = 0.6  # of a region's size, shown beside it
_LEAST_PX = 60


def landmark_quality_figure(bands: pd.DataFrame, note: str = "") -> Figure:
    """A table of ``over_distance.by_band``: claims a pair, the share that is right, quality."""
    figure, (counts, shares, quality) = panels(13, 5.6, 1, 3)
    variants, names = list(bands.variant.unique()), list(bands.band_m.unique())
    width = _BAND / len(variants)
    for place, variant in enumerate(variants):
        rows = bands[bands.variant == variant].set_index("band_m").reindex(names)
        at = np.arange(len(names)) + (place - (len(variants) - 1) / 2) * width
        _count_bars(counts, at, 0.92 * width, rows, variant)
        _share_bars(shares, at, 0.92 * width, rows, variant)
        _quality_points(quality, at, rows, variant)
    ticks = [
        f"{b.band_m} m apart\n{b.n_pairs} pairs\nboth see {b.landmarks_a_pair:.0f}"
        for b in bands.drop_duplicates("band_m").itertuples()
    ]
    for axes in figure.axes:
        axes.set_xticks(range(len(ticks)), ticks, fontsize=8.5)
        axes.set_xlim(-0.55, len(ticks) - 0.45)
        axes.set_xlabel("both see: landmarks in view of both robots, on average", fontsize=8.5)
        axes.grid(axis="y", alpha=0.3)
        axes.set_axisbelow(True)
    counts.margins(y=0.1)
    counts.set(ylabel="claims of a landmark, a pair of places")
    counts.set_title("How many do they claim? (number: right claims)", fontsize=11)
    shares.set(ylim=(0, 1.1), ylabel="right claims, of all claims")
    shares.set_title("What share of the claims is right?", fontsize=11)
    if bands.quality_m_median.notna().any():  # a logarithmic axis cannot be empty
        quality.set_yscale("log")
    quality.margins(y=0.12)
    quality.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    quality.set_ylabel("quality (m, smaller is better)")
    quality.set_title("How far apart do the two robots place it?", fontsize=11)
    handles: list[Artist] = [Patch(color=_LOOKS[v][0], label=_LOOKS[v][2]) for v in variants]
    handles.append(Patch(fc="white", ec=GREY, hatch="////", label="wrong claims"))
    handles.append(
        Line2D([], [], color="#999999", lw=4, marker="o", mfc="white", mec="#222222", ms=8,
               label="median, and the middle half of all claims")
    )  # fmt: skip
    legend_below(figure, handles, 5, note)
    figure.suptitle("Landmarks that two robots have in common, over the distance between them")
    return figure


def precision_recall_figure(curves: pd.DataFrame, note: str = "") -> Figure:
    """A table of ``over_distance.precision_recall``: a panel a band, a line a variant."""
    bands, variants = list(curves.band_m.unique()), list(curves.variant.unique())
    figure, ((first, *_),) = panels(
        4.4 * max(2, len(bands)), 5.0, 1, len(bands), sharex=True, sharey=True, squeeze=False
    )
    for axes, band_m in zip(figure.axes, bands, strict=True):
        lines = dict(list(curves[curves.band_m == band_m].groupby("variant")))
        for variant in variants:
            if variant in lines:
                _curve(axes, lines[variant], variant)
        if silent := [variant for variant in variants if variant not in lines]:
            axes.text(0.03, 0.03, f"no claim: {', '.join(silent)}", transform=axes.transAxes)
        axes.set_title(f"{band_m} m apart", fontsize=11)
        axes.set_xlabel("recall: share of the landmarks\nthat both see which is found")
        axes.grid(alpha=0.3)
    first.set(xlim=(0, 1.08 * max(curves.recall.max(), 0.05)), ylim=(0, 1.04))
    first.set_ylabel("precision: share of the claims\nmade that is right")
    handles = [
        Line2D([], [], color=colour, marker=marker, mec="#222222", ms=8, label=label)
        for colour, marker, label in (_LOOKS[variant] for variant in variants)
    ]
    legend_below(figure, handles, 3, note)
    figure.suptitle(
        "Finding more against erring less: along a line the threshold for a claim falls;\n"
        "the marker is the threshold in use; up and to the right is better"
    )
    return figure


def _count_bars(
    axes: Axes, at: NDArray[np.floating], width: float, rows: pd.DataFrame, variant: str
) -> None:
    colour = _LOOKS[variant][0]
    axes.bar(at, rows.right_a_pair, width, color=colour)
    wrong = axes.bar(
        at, rows.wrong_a_pair, width, bottom=rows.right_a_pair, fc="white", ec=colour, hatch="////"
    )
    axes.bar_label(wrong, [f"{n:.1f}" for n in rows.right_a_pair], fontsize=9, padding=1)


def _share_bars(
    axes: Axes, at: NDArray[np.floating], width: float, rows: pd.DataFrame, variant: str
) -> None:
    axes.bar(at, rows.precision, width, color=_LOOKS[variant][0])
    axes.vlines(at, rows.precision_low, rows.precision_high, color="#222222", lw=1.4)
    tops = rows[["precision", "precision_high"]].max(axis=1).fillna(0.0)
    for x, top, share in zip(at, tops, rows.precision, strict=True):
        text = "no claim" if np.isnan(share) else f"{share:.2f}"
        upright = 90 if np.isnan(share) else 0
        axes.text(x, top + 0.01, text, ha="center", va="bottom", fontsize=9, rotation=upright)


def _quality_points(axes: Axes, at: NDArray[np.floating], rows: pd.DataFrame, variant: str) -> None:
    colour, marker, _ = _LOOKS[variant]
    axes.vlines(at, rows.quality_m_q25, rows.quality_m_q75, color=colour, lw=5, alpha=0.6)
    axes.plot(at, rows.quality_m_median, marker, color=colour, mec="#222222", ms=8)
    for x, median_m, top_m in zip(at, rows.quality_m_median, rows.quality_m_q75, strict=True):
        if np.isfinite(median_m):
            label(axes, f"{median_m:.2g}", (x, top_m), (0, 5), ha="center", fontsize=9)


def _curve(axes: Axes, line: pd.DataFrame, variant: str) -> None:
    colour, marker, _ = _LOOKS[variant]
    axes.plot(line.recall, line.precision, color=colour, lw=1.8)
    used = line[line.in_use]
    axes.plot(
        used.recall, used.precision, marker, color=colour, mec="#222222", ms=10, zorder=4,
        clip_on=False,
    )  # fmt: skip


def proposals_figure(panorama: Panorama, found: Proposals, most: int = 40) -> Figure:
    """A panorama in two halves with the surest proposals boxed, coloured and named by kind."""
    figure, (upper, lower) = panels(13, 5.6, 2, 1, PAGE_CM)
    image, rig = panorama.cylinder, panorama.rig
    width_px = image.shape[1]
    half_px = width_px // 2
    for axes, left, name in ((upper, 0, "left half"), (lower, half_px, "right half")):
        axes.imshow(image)
        axes.set_xlim(left - 0.5, left + half_px - 0.5)
        axes.set_axis_off()
        axes.set_title(name, fontsize=9, loc="left")
        for i in range(min(most, len(found))):
            right_rad, left_rad, low, high = found.box[i]
            x0, x1 = rig.column_of_bearing(np.array([left_rad, right_rad]))
            x1 = x0 + (x1 - x0) % width_px
            y0, y1 = rig.row_of_slope(np.array([high, low]))
            colour = claim_colour(int(found.kind[i]))
            for shift in (-width_px, 0, width_px):  # a box may cross the seam
                outline(axes, (x0 + shift, y0, x1 + shift, y1), colour, lw=1.3)
                if left <= x0 + shift < left + half_px:
                    text = f"{KINDS[found.kind[i]]} {found.range_m[i]:.0f} m"
                    tag(axes, text, x0 + shift, y0 - 3, colour, pad=0.6, fontsize=6)
    figure.suptitle(
        f"What may be a landmark, and how far it is by one look: the surest "
        f"{min(most, len(found))} of {len(found)} proposals",
        fontsize=11,
    )
    return figure


def proposals_table(found: Proposals) -> pd.DataFrame:
    """Proposals as rows, surest first."""
    lowest, highest = np.degrees(np.arctan(found.box[:, 2:].T))
    return pd.DataFrame(
        {
            "score": found.score,
            "kind": [KINDS[k] for k in found.kind],
            "bearing_deg": np.degrees(found.bearing_rad),
            "range_m": found.range_m,
            "range_std": found.range_std,
            "width_deg": np.degrees(found.box[:, 1] - found.box[:, 0]),
            "lowest_deg": lowest,
            "highest_deg": highest,
        }
    )


def mistakes_figure(mistakes: Sequence[Mistake], note: str) -> Figure:
    """Wrong claims, a row each: the region in A and in B with what is around it."""
    n = len(mistakes)
    figure = Figure(figsize=(9, 2.5 * max(n, 1) + 0.8), layout="constrained")
    if n == 0:
        figure.text(0.5, 0.5, "no wrong claim was made", ha="center")
    for k, mistake in enumerate(mistakes):
        sides = (mistake.a, mistake.claim.a, "A"), (mistake.b, mistake.claim.b, "B")
        row = [figure.add_subplot(n, 2, 2 * k + 1), figure.add_subplot(n, 2, 2 * k + 2)]
        for axes, (panorama, region, name), truth in zip(row, sides, mistake.shows, strict=True):
            _show_region(axes, panorama, region)
            axes.set_title(f"in {name}: truly {truth}", fontsize=9)
        row[0].text(
            -0.02, 0.5, f"score {mistake.claim.score:.2f}\n{mistake.spacing_m:.0f} m apart",
            transform=row[0].transAxes, ha="right", va="center", fontsize=9,
        )  # fmt: skip
    figure.suptitle("The surest claims that were wrong", fontsize=11)
    figure.supxlabel(note, fontsize=8, color=GREY)
    return figure


def _show_region(axes: Axes, panorama: Panorama, region: Region) -> None:
    """A piece of the cylinder around a region, which is boxed."""
    x0, y0, x1, y1 = region_box(region, panorama.rig)
    image: NDArray[np.uint8] = panorama.cylinder
    width = max(x1 - x0, _LEAST_PX) * (1 + 2 * _AROUND)
    height = max(y1 - y0, _LEAST_PX) * (1 + 2 * _AROUND)
    width, height = max(width, 1.6 * height), max(height, width / 1.6)
    left, top = round((x0 + x1 - width) / 2), round((y0 + y1 - height) / 2)
    columns = np.arange(left, left + round(width)) % image.shape[1]
    rows = np.arange(max(top, 0), min(top + round(height), len(image)))
    axes.imshow(image[rows][:, columns])
    box = np.array([x0, y0, x1, y1]) - np.tile([left + 0.5, rows[0] + 0.5], 2)
    outline(axes, box, claim_colour(0))
    axes.set_axis_off()

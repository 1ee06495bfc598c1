"""Common landmarks: how many and how right over distance; proposals, and the worst mistakes."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle
from matplotlib.ticker import StrMethodFormatter
from numpy.typing import NDArray

from vrchain.landmarks.extraction.proposer import KINDS, Proposals
from vrchain.landmarks.matching.common import CommonLandmark, Region
from vrchain.panorama import Panorama
from vrchain.plots.pictures import CLAIM_COLOURS, region_box

# Okabe and Ito's colours, told apart by the colour-blind; markers tell them apart in grey.
_LOOKS = {
    "sift": ("#E69F00", "s", "sift: keypoints alone, nothing learned"),
    "cnn": ("#009E73", "^", "cnn: a network alone"),
    "cnn+sift": ("#0072B2", "o", "cnn+sift: both, as the robots use it"),
}
_BAND = 0.8  # width of a band's bars together, of the way to the next band


def landmark_quality_figure(bands: pd.DataFrame, note: str = "") -> Figure:
    """A table of ``landmark_bands.by_band``: claims a pair, the share that is right, quality."""
    figure = Figure(figsize=(13, 5.6), layout="constrained")
    counts, shares, quality = figure.subplots(1, 3)
    variants, names = list(bands.variant.unique()), list(bands.band_m.unique())
    width = _BAND / len(variants)
    for place, variant in enumerate(variants):
        rows = bands[bands.variant == variant].set_index("band_m").reindex(names)
        at = np.arange(len(names)) + (place - (len(variants) - 1) / 2) * width
        _counted(counts, at, 0.92 * width, rows, variant)
        _shares(shares, at, 0.92 * width, rows, variant)
        _placed(quality, at, rows, variant)
    _name_bands(figure, bands)
    counts.margins(y=0.1)
    counts.set_ylabel("claims of a landmark, a pair of places")
    counts.set_title("How many do they claim? (number: right claims)", fontsize=11)
    shares.set_ylim(0, 1.1)
    shares.set_ylabel("right claims, of all claims")
    shares.set_title("What share of the claims is right?", fontsize=11)
    if bands.quality_m_median.notna().any():  # a logarithmic axis cannot be empty
        quality.set_yscale("log")
    quality.margins(y=0.12)
    quality.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    quality.set_ylabel("quality (m, smaller is better)")
    quality.set_title("How far apart do the two robots place it?", fontsize=11)
    handles: list[Artist] = [Patch(color=_LOOKS[v][0], label=_LOOKS[v][2]) for v in variants]
    handles.append(Patch(fc="white", ec="#555555", hatch="////", label="wrong claims"))
    handles.append(
        Line2D([], [], color="#999999", lw=4, marker="o", mfc="white", mec="#222222", ms=8,
               label="median, and the middle half of all claims")
    )  # fmt: skip
    figure.legend(handles=handles, loc="outside lower center", ncols=5, fontsize=9, **_beside(note))
    figure.suptitle("Landmarks that two robots have in common, over the distance between them")
    return figure


def precision_recall_figure(curves: pd.DataFrame, note: str = "") -> Figure:
    """A table of ``landmark_bands.precision_recall``: a panel a band, a line a variant."""
    bands, variants = list(curves.band_m.unique()), list(curves.variant.unique())
    figure = Figure(figsize=(4.4 * max(2, len(bands)), 5.0), layout="constrained")
    panels = figure.subplots(1, len(bands), sharex=True, sharey=True, squeeze=False)[0]
    for axes, band_m in zip(panels, bands, strict=True):
        lines = dict(list(curves[curves.band_m == band_m].groupby("variant")))
        for variant in variants:
            if variant in lines:
                _line(axes, lines[variant], variant)
        silent = [variant for variant in variants if variant not in lines]
        if silent:
            axes.text(0.03, 0.03, f"no claim: {', '.join(silent)}", transform=axes.transAxes)
        axes.set_title(f"{band_m} m apart", fontsize=11)
        axes.set_xlabel("recall: share of the landmarks\nthat both see which is found")
        axes.grid(alpha=0.3)
    panels[0].set_xlim(0, 1.08 * max(curves.recall.max(), 0.05))
    panels[0].set_ylim(0, 1.04)
    panels[0].set_ylabel("precision: share of the claims\nmade that is right")
    handles = [
        Line2D([], [], color=colour, marker=marker, mec="#222222", ms=8, label=label)
        for colour, marker, label in (_LOOKS[variant] for variant in variants)
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, **_beside(note))
    figure.suptitle(
        "Finding more against erring less: along a line the threshold for a claim falls;\n"
        "the marker is the threshold in use; up and to the right is better"
    )
    return figure


def _name_bands(figure: Figure, bands: pd.DataFrame) -> None:
    first = bands.drop_duplicates("band_m")
    names = [
        f"{b.band_m} m apart\n{b.n_pairs} pairs\nboth see {b.landmarks_a_pair:.0f}"
        for b in first.itertuples()
    ]
    for axes in figure.axes:
        axes.set_xticks(range(len(names)), names, fontsize=8.5)
        axes.set_xlim(-0.55, len(names) - 0.45)
        axes.set_xlabel("both see: landmarks in view of both robots, on average", fontsize=8.5)
        axes.grid(axis="y", alpha=0.3)
        axes.set_axisbelow(True)


def _counted(
    axes: Axes, at: NDArray[np.floating], width: float, rows: pd.DataFrame, variant: str
) -> None:
    colour = _LOOKS[variant][0]
    axes.bar(at, rows.right_a_pair, width, color=colour)
    wrong = axes.bar(
        at, rows.wrong_a_pair, width, bottom=rows.right_a_pair, fc="white", ec=colour, hatch="////"
    )
    axes.bar_label(wrong, [f"{n:.1f}" for n in rows.right_a_pair], fontsize=9, padding=1)


def _shares(
    axes: Axes, at: NDArray[np.floating], width: float, rows: pd.DataFrame, variant: str
) -> None:
    axes.bar(at, rows.precision, width, color=_LOOKS[variant][0])
    axes.vlines(at, rows.precision_low, rows.precision_high, color="#222222", lw=1.4)
    tops = rows[["precision", "precision_high"]].max(axis=1).fillna(0.0)
    for x, top, share in zip(at, tops, rows.precision, strict=True):
        text = "no claim" if np.isnan(share) else f"{share:.2f}"
        upright = 90 if np.isnan(share) else 0
        axes.text(x, top + 0.01, text, ha="center", va="bottom", fontsize=9, rotation=upright)


def _placed(axes: Axes, at: NDArray[np.floating], rows: pd.DataFrame, variant: str) -> None:
    colour, marker, _ = _LOOKS[variant]
    axes.vlines(at, rows.quality_m_q25, rows.quality_m_q75, color=colour, lw=5, alpha=0.6)
    axes.plot(at, rows.quality_m_median, marker, color=colour, mec="#222222", ms=8)
    for x, median_m, top_m in zip(at, rows.quality_m_median, rows.quality_m_q75, strict=True):
        if np.isfinite(median_m):
            axes.annotate(
                f"{median_m:.2g}", (x, top_m), xytext=(0, 5), textcoords="offset points",
                ha="center", fontsize=9,
            )  # fmt: skip


def _line(axes: Axes, line: pd.DataFrame, variant: str) -> None:
    colour, marker, _ = _LOOKS[variant]
    axes.plot(line.recall, line.precision, color=colour, lw=1.8)
    used = line[line.in_use]
    axes.plot(
        used.recall, used.precision, marker, color=colour, mec="#222222", ms=10, zorder=4,
        clip_on=False,
    )  # fmt: skip


def _beside(note: str) -> dict[str, Any]:
    """What makes a legend carry the figure's note."""
    return {"frameon": False, "title": note, "title_fontsize": 8.5}


_AROUND = 0.6  # of a region's size, shown beside it
_LEAST_PX = 60


def proposals_figure(panorama: Panorama, found: Proposals, most: int = 40) -> Figure:
    """A panorama in two halves with the surest proposals boxed, coloured and named by kind."""
    figure = Figure(figsize=(13, 5.6), layout="constrained")
    image, rig = panorama.cylinder, panorama.rig
    half_px = image.shape[1] // 2
    for axes, (left, name) in zip(
        figure.subplots(2, 1), ((0, "left half"), (half_px, "right half")), strict=True
    ):
        axes.imshow(image)
        axes.set_xlim(left - 0.5, left + half_px - 0.5)
        axes.set_axis_off()
        axes.set_title(name, fontsize=9, loc="left")
        for i in range(min(most, len(found))):
            right_rad, left_rad, low, high = found.box[i]
            x0, x1 = rig.column_of_bearing(np.array([left_rad, right_rad]))
            x1 = x0 + (x1 - x0) % image.shape[1]
            y0, y1 = rig.row_of_slope(np.array([high, low]))
            kind = KINDS[found.kind[i]]
            colour = CLAIM_COLOURS[int(found.kind[i]) % len(CLAIM_COLOURS)]
            for shift in image.shape[1] * np.arange(-1, 2):  # a box may cross the seam
                axes.add_patch(
                    Rectangle((x0 + shift, y0), x1 - x0, y1 - y0, fill=False, ec=colour, lw=1.3)
                )
                if left <= x0 + shift < left + half_px:
                    axes.text(
                        x0 + shift, y0 - 3, f"{kind} {found.range_m[i]:.0f} m", fontsize=6,
                        color="black", clip_on=True,
                        bbox={"facecolor": colour, "edgecolor": "none", "pad": 0.6},
                    )  # fmt: skip
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


@dataclass(frozen=True, eq=False)
class Mistake:
    """A wrong claim: the two panoramas, the claim, and what its regions truly show."""

    a: Panorama
    b: Panorama
    claim: CommonLandmark
    shows: tuple[str, str]
    spacing_m: float


def mistakes_figure(mistakes: Sequence[Mistake], note: str = "") -> Figure:
    """Wrong claims, a row each: the region in A and in B with what is around it."""
    n = len(mistakes)
    figure = Figure(figsize=(9, 2.5 * max(n, 1) + 0.8), layout="constrained")
    if n == 0:
        figure.text(0.5, 0.5, "no wrong claim was made", ha="center")
    for row, mistake in zip(
        figure.subplots(n, 2, squeeze=False) if n else [], mistakes, strict=True
    ):
        sides = (mistake.a, mistake.claim.a, "A"), (mistake.b, mistake.claim.b, "B")
        for axes, (panorama, region, name), truth in zip(row, sides, mistake.shows, strict=True):
            _show_region(axes, panorama, region)
            axes.set_title(f"in {name}: truly {truth}", fontsize=9)
        row[0].text(
            -0.02, 0.5, f"score {mistake.claim.score:.2f}\n{mistake.spacing_m:.0f} m apart",
            transform=row[0].transAxes, ha="right", va="center", fontsize=9,
        )  # fmt: skip
    figure.suptitle("The surest claims that were wrong", fontsize=11)
    if note:
        figure.supxlabel(note, fontsize=8, color="#555555")
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
    corner = x0 - left - 0.5, y0 - rows[0] - 0.5
    axes.add_patch(Rectangle(corner, x1 - x0, y1 - y0, fill=False, ec=CLAIM_COLOURS[0], lw=2))
    axes.set_axis_off()

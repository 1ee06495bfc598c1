"""Pictures of the learned landmarks: what is proposed, and where two robots were surely wrong."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from vrchain.landmarks.extraction.proposer import KINDS, Proposals
from vrchain.landmarks.matching.common import CommonLandmark, Region
from vrchain.panorama import Panorama
from vrchain.plots.pictures import CLAIM_COLOURS, region_box

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

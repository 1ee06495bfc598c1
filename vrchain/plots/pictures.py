"""Pictures: panoramas, and the regions that two of them have in common."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import ConnectionPatch, Rectangle
from numpy.typing import NDArray

from vrchain.geometry import wrap_angle_rad
from vrchain.landmarks.matching.common import CommonLandmark, Region
from vrchain.panorama import CameraRig, Panorama
from vrchain.seeding import generator

CLAIM_COLOURS = (
    "#ffd400",
    "#ff3b30",
    "#00e5ff",
    "#ff7af6",
    "#7cff4f",
    "#ff9f0a",
    "#b18cff",
    "#0a84ff",
)
_APART = 0.03  # of the picture's width, between two landmarks that are drawn


def panorama_strip(panoramas: dict[str, Panorama]) -> Figure:
    """Joined cylinders one above the other, with the bearing as the axis."""
    figure = Figure(figsize=(12, 1.9 * len(panoramas) + 0.4), layout="constrained")
    for axes, (title, panorama) in zip(
        np.atleast_1d(figure.subplots(len(panoramas), 1)), panoramas.items(), strict=True
    ):
        show_panorama(axes, panorama)
        axes.set_title(title, fontsize=10)
    return figure


def view_sheet(panorama: Panorama) -> Figure:
    """All views of a rig, and the cylinder that joins them."""
    n, rig = len(panorama.views), panorama.rig
    columns = min(n, 4)
    rows = -(-n // columns)
    figure = Figure(figsize=(12, 2.4 * rows + 2.2), layout="constrained")
    bearings_deg = np.degrees(wrap_angle_rad(rig.azimuths_rad))
    grid = figure.add_gridspec(rows + 1, columns, height_ratios=[*[2.3] * rows, 1.7])
    for i, view in enumerate(panorama.views):
        axes = figure.add_subplot(grid[i // columns, i % columns])
        axes.imshow(view)
        axes.set_axis_off()
        axes.set_title(f"view {i}: bearing {bearings_deg[i]:.0f}°", fontsize=9)
    axes = figure.add_subplot(grid[rows, :])
    show_panorama(axes, panorama)
    axes.set_title("the joined cylinder", fontsize=10)
    return figure


def views_row(views: Sequence[NDArray[np.uint8]], title: str) -> Figure:
    """Single pictures side by side."""
    figure = Figure(figsize=(12, 3.0), layout="constrained")
    for axes, view in zip(np.atleast_1d(figure.subplots(1, len(views))), views, strict=True):
        axes.imshow(view)
        axes.set_axis_off()
    figure.suptitle(title)
    return figure


def truth_sheet(
    rgb: NDArray[np.uint8], object_id: NDArray[np.int32], range_m: NDArray[np.float32]
) -> Figure:
    """One view as it is drawn, and by ray casting: an object's own colour, and the range."""
    figure = Figure(figsize=(12, 3.4), layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    left.imshow(rgb)
    left.set_title("what the camera sees", fontsize=10)
    colours = generator(0, "object colours").integers(60, 256, (int(object_id.max()) + 2, 3))
    colours[-1] = 235  # the sky, whose id is -1
    middle.imshow(colours[object_id].astype(np.uint8))
    middle.set_title("ground truth: one colour an object", fontsize=10)
    drawn = right.imshow(np.where(np.isfinite(range_m), range_m, np.nan), cmap="viridis_r", vmax=60)
    right.set_title("ground truth: range", fontsize=10)
    figure.colorbar(drawn, ax=right, label="range (m)", extend="max")
    for axes in (left, middle, right):
        axes.set_axis_off()
    return figure


def show_panorama(axes: Axes, panorama: Panorama) -> None:
    """Draw a cylinder; x is the bearing in degrees, left positive, ahead in the middle."""
    half = np.degrees(panorama.rig.span_rad) / 2
    slope = panorama.rig.slope_of_row(-0.5)
    elevation = float(np.degrees(np.arctan(slope)))
    axes.imshow(panorama.cylinder, extent=(half, -half, -elevation, elevation), aspect="auto")
    axes.set_xlabel("bearing (degrees, left positive)", fontsize=8)
    axes.set_yticks([])
    if panorama.rig.closed:
        axes.set_xticks(np.arange(180, -181, -45))
    axes.tick_params(labelsize=8)


def common_landmarks_figure(
    a_rgb: NDArray[np.uint8],
    b_rgb: NDArray[np.uint8],
    claims: Sequence[CommonLandmark],
    rig: CameraRig | None = None,
    titles: tuple[str, str] = ("A", "B"),
) -> Figure:
    """Two pictures with the claimed regions boxed alike and joined by lines.

    Cylinders (give their rig) stand one above the other, photographs side by side.
    """
    tall = a_rgb.shape[1] > 3 * a_rgb.shape[0]
    size, shape = ((13, 4.3), (2, 1)) if tall else ((12, 5.2), (1, 2))
    figure = Figure(figsize=size, layout="constrained")
    upper, lower = figure.subplots(*shape)
    for axes, image, title in zip((upper, lower), (a_rgb, b_rgb), titles, strict=True):
        axes.imshow(image)
        axes.set_title(title, fontsize=10, loc="left")
        axes.set_axis_off()
    chosen = _apart(claims, a_rgb.shape[1], rig)
    for colour, number in zip(CLAIM_COLOURS, chosen, strict=False):
        claim = claims[number]
        boxes = [region_box(region, rig) for region in (claim.a, claim.b)]
        for axes, image, (x0, y0, x1, y1) in zip(
            (upper, lower), (a_rgb, b_rgb), boxes, strict=True
        ):
            for shift in (0, image.shape[1]) if rig else (0,):  # a region may cross the seam
                axes.add_patch(
                    Rectangle(
                        (x0 + shift, y0), x1 - x0, y1 - y0, fill=False, edgecolor=colour, lw=2
                    )
                )
            axes.set_xlim(-0.5, image.shape[1] - 0.5)
            highest = 0.08 * image.shape[0]  # or it would be cut off
            axes.text(
                max(x0, 0.0), max(y0 - 4, highest), str(number + 1), color="black", fontsize=8,
                clip_on=True, bbox={"facecolor": colour, "edgecolor": "none", "pad": 1.0},
            )  # fmt: skip
        ends = [
            ((x0 + x1) / 2, y1 if tall and i == 0 else y0)
            for i, (x0, y0, x1, y1) in enumerate(boxes)
        ]
        if not tall:
            ends = [((x0 + x1) / 2, (y0 + y1) / 2) for x0, y0, x1, y1 in boxes]
        figure.add_artist(
            ConnectionPatch(
                ends[0], ends[1], "data", "data", axesA=upper, axesB=lower, color=colour, lw=1.2
            )
        )
    shown = ""
    if len(claims) > len(chosen):
        shown = f"; {len(chosen)} shown, of several close together the surest"
    figure.suptitle(
        f"{len(claims)} common landmark{'' if len(claims) == 1 else 's'}{shown}", fontsize=11
    )
    return figure


def _apart(claims: Sequence[CommonLandmark], width_px: int, rig: CameraRig | None) -> list[int]:
    """Indices of the surest claims of which none covers another in the first picture."""
    chosen: list[int] = []
    middles: list[float] = []
    for index, claim in enumerate(claims):
        x0, _, x1, _ = region_box(claim.a, rig)
        middle = (x0 + x1) / 2
        if all(abs(middle - other) > _APART * width_px for other in middles):
            chosen.append(index)
            middles.append(middle)
    return chosen[: len(CLAIM_COLOURS)]


def claims_table(claims: Sequence[CommonLandmark]) -> pd.DataFrame:
    """Common landmarks as rows: score, matches, and each side's view, box, bearing and size."""
    rows = []
    for number, claim in enumerate(claims, 1):
        row: dict[str, object] = {
            "number": number,
            "score": claim.score,
            "matches": claim.matches,
        }
        for side, region in (("a", claim.a), ("b", claim.b)):
            row[f"{side}_view"] = region.view
            row |= dict(
                zip(
                    [f"{side}_{c}_px" for c in ("x0", "y0", "x1", "y1")], region.box_px, strict=True
                )
            )
            row[f"{side}_bearing_rad"] = region.bearing_rad
            row[f"{side}_angular_size_rad"] = region.angular_size_rad
        rows.append(row)
    return pd.DataFrame(rows)


def region_box(region: Region, rig: CameraRig | None) -> tuple[float, float, float, float]:
    """A region's x0, y0, x1, y1: in cylinder pixels if a rig is given, else in its own view's."""
    if rig is None or region.bearing_rad is None or region.angular_size_rad is None:
        return region.box_px
    half = region.angular_size_rad / 2
    centre = region.bearing_rad
    x0, x1 = rig.column_of_bearing(np.array([centre + half, centre - half]))
    # slope of a view's row at its axis; regions are near enough to it for a drawing
    low, high = (
        (rig.height_px / 2 - 0.5 - y) / rig.focal_px for y in (region.box_px[3], region.box_px[1])
    )
    y0, y1 = rig.row_of_slope(np.array([high, low]))
    return float(x0), float(y0), float(x1), float(y1)

"""Pictures: panoramas, and the regions that two of them have in common."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import ConnectionPatch
from numpy.typing import NDArray

from vrchain.geometry import wrap_angle_rad
from vrchain.landmarks.matching.common import CommonLandmark, Region
from vrchain.panorama import CameraRig, Panorama
from vrchain.plots.style import CLAIMS_TOLD_APART, claim_colour, outline, panels, tag
from vrchain.seeding import generator

_APART = 0.03  # of the picture's width, between two landmarks that are drawn
_SIDE = ("view", "x0_px", "y0_px", "x1_px", "y1_px", "bearing_rad", "angular_size_rad")
_CLAIM = ["number", "score", "matches", *(f"{side}_{name}" for side in "ab" for name in _SIDE)]


def panorama_strip(panoramas: dict[str, Panorama]) -> Figure:
    """Joined cylinders one above the other, with the bearing as the axis."""
    n = len(panoramas)
    figure, column = panels(9, 1.6 * n + 0.4, n, 1, squeeze=False)
    for axes, (title, panorama) in zip(column.flat, panoramas.items(), strict=True):
        show_panorama(axes, panorama, title)
    return figure


def view_sheet(panorama: Panorama) -> Figure:
    """All views of a rig, and the cylinder that joins them."""
    n = len(panorama.views)
    columns = min(n, 4)
    rows = -(-n // columns)
    figure = Figure(figsize=(9, 1.9 * rows + 1.9), layout="constrained")
    bearings_deg = np.degrees(wrap_angle_rad(panorama.rig.azimuths_rad))
    grid = figure.add_gridspec(rows + 1, columns, height_ratios=[*[2.3] * rows, 1.7])
    for i, view in enumerate(panorama.views):
        axes = figure.add_subplot(grid[i // columns, i % columns])
        _show(axes, view, f"view {i}: bearing {bearings_deg[i]:.0f}°", fontsize=9)
    show_panorama(figure.add_subplot(grid[rows, :]), panorama, "the joined cylinder")
    return figure


def views_row(views: Sequence[NDArray[np.uint8]], title: str) -> Figure:
    """Single pictures side by side."""
    figure, row = panels(9, 2.4, 1, len(views), squeeze=False)
    for axes, view in zip(row.flat, views, strict=True):
        _show(axes, view)
    figure.suptitle(title)
    return figure


def truth_sheet(
    rgb: NDArray[np.uint8], object_id: NDArray[np.int32], range_m: NDArray[np.float32]
) -> Figure:
    """One view as it is drawn, and by ray casting: an object's own colour, and the range."""
    figure, (left, middle, right) = panels(9, 2.7, 1, 3)
    _show(left, rgb, "what the camera sees")
    colours = generator(0, "object colours").integers(60, 256, (int(object_id.max()) + 2, 3))
    colours[-1] = 235  # the sky, whose id is -1
    _show(middle, colours[object_id].astype(np.uint8), "ground truth: one colour an object")
    drawn = right.imshow(np.where(np.isfinite(range_m), range_m, np.nan), cmap="viridis_r", vmax=60)
    right.set_title("ground truth: range", fontsize=10)
    right.set_axis_off()
    figure.colorbar(drawn, ax=right, label="range (m)", extend="max")
    return figure


def show_panorama(axes: Axes, panorama: Panorama, title: str, loc: str = "center") -> None:
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
    axes.set_title(title, fontsize=10, loc=loc)  # type: ignore[arg-type]


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
    figure, (first, second) = panels(9.5, 3.6, 2, 1) if tall else panels(9.5, 4.2, 1, 2)
    for axes, image, title in zip((first, second), (a_rgb, b_rgb), titles, strict=True):
        _show(axes, image, title, loc="left")
    chosen = _apart(claims, a_rgb.shape[1], rig)
    for place, number in enumerate(chosen):
        colour, claim, ends = claim_colour(place), claims[number], []
        for axes, image, region in ((first, a_rgb, claim.a), (second, b_rgb, claim.b)):
            height_px, width_px = image.shape[:2]
            x0, y0, x1, y1 = region_box(region, rig)
            for shift in (0, width_px) if rig else (0,):  # a region may cross the seam
                outline(axes, (x0 + shift, y0, x1 + shift, y1), colour)
            axes.set_xlim(-0.5, width_px - 0.5)
            top = max(y0 - 4, 0.08 * height_px)  # or it would be cut off
            tag(axes, str(number + 1), max(x0, 0.0), top, colour, fontsize=8)
            facing = y1 if axes is first else y0
            ends.append(((x0 + x1) / 2, facing if tall else (y0 + y1) / 2))
        start, end = ends
        figure.add_artist(
            ConnectionPatch(start, end, "data", axesA=first, axesB=second, color=colour, lw=1.2)
        )
    shown = ""
    if len(claims) > len(chosen):
        shown = f"; shown: the {len(chosen)} surest that lie apart"
    landmarks = "common landmark" if len(claims) == 1 else "common landmarks"
    figure.suptitle(f"{len(claims)} {landmarks}{shown}", fontsize=11)
    return figure


def claims_table(claims: Sequence[CommonLandmark]) -> pd.DataFrame:
    """Common landmarks as rows: score, matches, and each side's view, box, bearing and size.

    Without claims the columns stay.
    """
    rows: list[list[float | None]] = []
    for number, claim in enumerate(claims, 1):
        row: list[float | None] = [number, claim.score, claim.matches]
        for region in (claim.a, claim.b):
            row += [region.view, *region.box_px, region.bearing_rad, region.angular_size_rad]
        rows.append(row)
    return pd.DataFrame(rows, columns=_CLAIM, dtype=None if rows else float)


def region_box(region: Region, rig: CameraRig | None) -> tuple[float, float, float, float]:
    """A region's x0, y0, x1, y1: in cylinder pixels if a rig is given, else in its own view's."""
    if rig is None or region.bearing_rad is None or region.angular_size_rad is None:
        return region.box_px
    half, centre = region.angular_size_rad / 2, region.bearing_rad
    x0, x1 = rig.column_of_bearing(np.array([centre + half, centre - half]))
    # slope of a view's row at its axis; regions are near enough to it for a drawing
    rows_px = np.array([region.box_px[1], region.box_px[3]])
    y0, y1 = rig.row_of_slope((rig.height_px / 2 - 0.5 - rows_px) / rig.focal_px)
    return float(x0), float(y0), float(x1), float(y1)


def _show(
    axes: Axes, image: NDArray[np.uint8], title: str = "", fontsize: float = 10, loc: str = "center"
) -> None:
    axes.imshow(image)
    axes.set_axis_off()
    axes.set_title(title, fontsize=fontsize, loc=loc)  # type: ignore[arg-type]


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
    return chosen[:CLAIMS_TOLD_APART]

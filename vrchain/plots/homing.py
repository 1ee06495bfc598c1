"""Home vectors from all around one place, a panel a method."""

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure

from vrchain.geometry import Pose
from vrchain.plots.maps import draw_scene, zoom_to
from vrchain.plots.style import RED, panels
from vrchain.world.model import Scene

_MOST_DEG = 45.0  # from here on the colour tells no difference
_COLOURS = LinearSegmentedColormap.from_list("error", ["#0057a8", "#7b3fa0", "#d81b60", "#8a0000"])
_ARROW = 0.75  # of the gap between two points


def home_vectors_figure(
    scene: Scene, home: Pose, answers: pd.DataFrame, rows: Sequence[str]
) -> Figure:
    """An arrow for each point around ``home`` (rows of ``experiments.homing.answers``), coloured
    by its angular error; a cross where the method had no answer."""
    figure, _ = panels(5.4 * len(rows) + 0.8, 5.9, 1, len(rows), sharey=True)
    colour = Normalize(0, _MOST_DEG)
    for axes, row in zip(figure.axes, rows, strict=True):
        draw_scene(axes, scene)
        made = answers[answers.method == row]
        places = home.xy_m + made[["x_m", "y_m"]].to_numpy()
        told = made.answered.to_numpy(dtype=bool)
        course = made.course_rad[told]
        gap_m = np.diff(np.unique(made.x_m)).min()
        arrows = axes.quiver(
            *places[told].T, np.cos(course), np.sin(course), made.error_deg[told], norm=colour,
            cmap=_COLOURS, pivot="tail", scale=1 / (_ARROW * gap_m), scale_units="xy",
            angles="xy", width=0.006, zorder=5,
        )  # fmt: skip
        axes.plot(*places[~told].T, "x", color="black", ms=6, zorder=5)
        axes.plot(*home.xy_m, "*", color=RED, mec="white", ms=17, zorder=6)
        zoom_to(axes, places, margin_m=0.8)
        none = f", {(~told).sum()} without an answer" if not told.all() else ""
        axes.set_title(f"{row}: {made.error_deg.mean():.1f}° off on average{none}", fontsize=11)
        axes.label_outer()
    figure.colorbar(
        arrows, ax=figure.axes, label="angular error (degrees)", extend="max", shrink=0.8, pad=0.02
    )
    figure.suptitle("Home vectors around one place (star), every robot facing its own way")
    return figure

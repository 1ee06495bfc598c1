"""A scene's map as a picture, drawn once, so that robots on it are drawn in no time."""

from functools import lru_cache

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vrchain.plots.maps import draw_scene
from vrchain.world.model import Scene

_LONGEST_PX = 1500


def draw_map(axes: Axes, scene: Scene) -> None:
    """The scene from above, with axes in metres."""
    x, y = np.array(scene.extent_m) / 2
    axes.imshow(_picture(scene), extent=(-x, x, -y, y))
    axes.set(xlabel="x, east (m)", ylabel="y, north (m)", aspect="equal")


@lru_cache(maxsize=4)
def _picture(scene: Scene) -> NDArray[np.uint8]:
    width_m, height_m = scene.extent_m
    size = np.array(scene.extent_m) / max(scene.extent_m)
    figure = Figure(figsize=tuple(10 * size), dpi=_LONGEST_PX / 10)
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    draw_scene(axes, scene)
    axes.set(xlim=(-width_m / 2, width_m / 2), ylim=(-height_m / 2, height_m / 2))
    axes.set_axis_off()
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()

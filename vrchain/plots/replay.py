"""A mission replayed: the way driven so far, what was decided, and what that rested on."""

import io
from base64 import b64encode
from collections.abc import Callable, Iterator, Sequence
from html import escape
from textwrap import shorten
from typing import NamedTuple

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from vrchain.navigation.settings import Decision
from vrchain.plots.maps import draw_name
from vrchain.plots.missions import Row, chain_rows, draw_row, draw_stage
from vrchain.plots.style import robot_colour
from vrchain.simulation.mission import MissionRun

_DPI, _HEIGHT_IN, _MAP_IN, _BESIDE_IN = 80, 6.0, 5.8, 7.2
_FRAMES, _LEAST_S = 120, 0.5  # about so many, and not more often
_FRAME_MS, _DECIDED_MS, _END_MS = 80, 1000, 4000  # shown
_LINES, _WIDTH = 9, 62  # of the log, and characters of a reason
_COLOURS = 255  # besides the one that GIF takes for "as before"

Pixels = NDArray[np.uint8]


class Frame(NamedTuple):
    """A moment: (height, width, 3) pixels, and how long they are shown."""

    rgb: Pixels
    shown_ms: int


def mission_gif(run: MissionRun) -> bytes:
    """The frames as an animated GIF."""
    from PIL import Image

    frames = list(replay(run))
    some = np.concatenate([f.rgb[::4, ::4] for f in frames[:: len(frames) // 12 + 1]])
    palette = Image.fromarray(some).quantize(_COLOURS)  # one for all, or what stands still flickers
    first, *rest = (
        Image.fromarray(f.rgb).quantize(palette=palette, dither=Image.Dither.NONE) for f in frames
    )
    gif, shown_ms = io.BytesIO(), [f.shown_ms for f in frames]
    first.save(gif, "GIF", save_all=True, append_images=rest, duration=shown_ms, loop=0)
    return gif.getvalue()


def gif_html(gif: bytes, what: str) -> str:
    """An animation as HTML: notebooks leave it out as a picture when they are exported."""
    return f'<img src="data:image/gif;base64,{b64encode(gif).decode()}" alt="{escape(what)}">'


def replay(run: MissionRun) -> Iterator[Frame]:
    """Frames at even times, and one for each moment at which something was decided."""
    decisions, end_s = run.result.decisions, float(run.times_s[-1])
    decided_s = {d.time_s for d in decisions}
    even_s = np.arange(end_s - run.seconds, end_s, max(_LEAST_S, run.seconds / _FRAMES))
    map_at, beside = _map(run), _beside(run, ())
    for time_s in np.unique([*even_s, *decided_s, end_s]):
        shown_ms = _FRAME_MS
        if time_s in decided_s:
            beside = _beside(run, [d for d in decisions if d.time_s <= time_s])
            shown_ms = _DECIDED_MS
        if time_s == end_s:
            shown_ms = _END_MS
        yield Frame(np.hstack([map_at(time_s), beside]), shown_ms)


def _map(run: MissionRun) -> Callable[[float], Pixels]:
    """Draws the map at a time: the scene once, over it where the robots are and came from."""
    figure, canvas = _page(_MAP_IN)
    axes = figure.add_subplot()
    draw_stage(axes, run)
    axes.set_title("from above, as the simulator knows it: no robot has this map", fontsize=10)
    ways, names = [], []
    for i, (name, path) in enumerate(run.paths_xy_m.items()):
        colour = robot_colour(i)
        ways += axes.plot(*path.T, "o-", color=colour, mec="white", ms=9, lw=2, animated=True)
        names.append(draw_name(axes, name, path[0], colour))
        names[-1].set_animated(True)
    canvas.draw()
    empty = canvas.copy_from_bbox(figure.bbox)

    def at(time_s: float) -> Pixels:
        canvas.restore_region(empty)
        n = max(1, int(np.searchsorted(run.times_s, time_s, "right")))
        for way, name, path in zip(ways, names, run.paths_xy_m.values(), strict=True):
            way.set_data(*path[:n].T)
            way.set_markevery([n - 1])
            name.xy = path[n - 1]
            axes.draw_artist(way)
            axes.draw_artist(name)
        return _pixels(canvas)

    return at


def _beside(run: MissionRun, decided: Sequence[Decision]) -> Pixels:
    """What the robot saw when it decided, who sees the goal, and the log so far."""
    figure, canvas = _page(_BESIDE_IN)
    own, other, log = figure.subplots(3, 1, height_ratios=[1, 1, 1.2])
    look = next((d.look for d in reversed(decided) if d.look is not None), 0)
    n_plans = sum(d.what == "route" for d in decided)
    rows = chain_rows(run, *run.result.plans[n_plans - 1]) if n_plans else []
    for axes in (own, other, log):
        axes.set_axis_off()
    if run.result.looks:
        seen = run.result.looks[look]
        is_plans = bool(rows) and rows[0].panorama is seen
        marks = rows[0].marks if is_plans else ()
        draw_row(own, Row(f"look {look} of {run.robot}, by which it decided", seen, marks))
    if rows:
        draw_row(other, rows[-1]._replace(title=f"by the ledger, {rows[-1].title}"))
    for i, d in enumerate(decided[-_LINES:]):
        line = f"{d.time_s:6.1f} s  {d.what:10}  {shorten(d.why, _WIDTH)}"
        now = d.time_s == decided[-1].time_s
        log.text(
            0.0, 1.0 - (i + 0.5) / _LINES, line, family="monospace", fontsize=9,
            color="black" if now else "#808080", transform=log.transAxes,
        )  # fmt: skip
    canvas.draw()
    return _pixels(canvas)


def _page(width_in: float) -> tuple[Figure, FigureCanvasAgg]:
    figure = Figure(figsize=(width_in, _HEIGHT_IN), dpi=_DPI, layout="constrained")
    return figure, FigureCanvasAgg(figure)


def _pixels(canvas: FigureCanvasAgg) -> Pixels:
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()

"""A finished figure laid out anew for print, so wide as its label says: see ``style.panels``.

In a column, 8.5 cm wide, panels that stood side by side stand under each other. Texts have 6 to 7.5
points, and are wrapped.
"""

import textwrap
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.lines import Line2D
from matplotlib.table import Table
from matplotlib.text import Text

from vrchain.plots.style import COLUMN_CM

_CM = 1 / 2.54
_TALLEST_CM = 24.0
_SMALLEST_PT, _LARGEST_PT, _SMALLER = 6.0, 7.5, 0.75
_LETTER = 0.56  # a letter's mean width, of its size
_LINE_IN = 0.13  # a line of text
_AROUND_IN = 0.42  # a panel's title, ticks and label
_INSIDE = 0.85  # of the width, beside the ticks
_FLAT, _HIGH, _ALONE = 0.5, 0.8, 0.75  # a panel's height over its width
_LEGEND_LETTERS, _ENTRY_LETTERS = 62, 7  # in a column's legend; what an entry takes beside its text


def lay_out_for_print(figure: Figure) -> None:
    """Change a figure of any size to one of its width in print."""
    width_cm = float(str(figure.get_label() or COLUMN_CM))
    width_in, (before_in, high_in) = width_cm * _CM, figure.get_size_inches()
    placed = [axes for axes in figure.axes if axes.get_subplotspec() is not None]
    shapes = [_shape(axes, high_in / before_in, len(placed)) for axes in placed]
    _shrink(figure)
    if stacked := width_cm <= COLUMN_CM and not all(axes.images for axes in placed):
        _stack(figure, placed, shapes)
        height_in = _INSIDE * width_in * sum(shapes) + _AROUND_IN * len(placed)
    else:
        height_in = width_in * high_in / before_in
    n_lines = 1 + _wrap(figure, placed, width_in) + _legends(figure, width_cm)
    height_in = min(height_in + _LINE_IN * n_lines, _TALLEST_CM * _CM)
    figure.set_size_inches(width_in, height_in)
    for axes in placed if stacked else ():
        _wrapped(axes.yaxis.label, 0.6 * height_in / len(placed))


def _place(axes: Axes) -> Any:
    """Where it is in its grid."""
    return axes.get_subplotspec()


def _shape(axes: Axes, figure_shape: float, n: int) -> float:
    """Height over width that a panel of n is given: as it was, if it is a map or a picture."""
    if axes.get_aspect() != "auto":
        (x0, x1), (y0, y1) = axes.get_xlim(), axes.get_ylim()
        return abs((y1 - y0) / (x1 - x0))
    place = _place(axes).get_position(axes.figure)
    shape = float(place.height * figure_shape / place.width)
    return shape if axes.images else min(max(shape, _FLAT if n > 1 else _ALONE), _HIGH)


def _stack(figure: Figure, placed: list[Axes], shapes: list[float]) -> None:
    """Panels under each other, each with labels of its own."""
    grid, y_label = GridSpec(len(placed), 1, figure=figure, height_ratios=shapes), ""
    for k, axes in enumerate(placed):
        axes.set_subplotspec(grid[k, 0])
        if not axes.images:
            y_label = axes.get_ylabel() or y_label
            axes.set_ylabel(y_label)
            axes.tick_params(labelleft=True, labelbottom=True)


def _shrink(figure: Figure) -> None:
    in_tables: set[Any] = set()
    for table in figure.findobj(Table):
        table.auto_set_font_size(False)
        in_tables |= {*table.findobj(Text)}
    for text in figure.findobj(Text):
        size = _SMALLEST_PT if text in in_tables else float(text.get_fontsize()) * _SMALLER
        text.set_fontsize(min(max(size, _SMALLEST_PT), _LARGEST_PT))
    for line in figure.findobj(Line2D):
        line.set_markersize(line.get_markersize() * _SMALLER)


def _wrap(figure: Any, placed: list[Any], width_in: float) -> int:
    """Wrap what is written around panels; the lines that it takes."""
    titles = [text for text in (figure._suptitle, figure._supxlabel) if text is not None]
    n_lines = sum(_wrapped(text, width_in) for text in titles)
    for axes in placed:
        place = _place(axes)
        own_in = _INSIDE * width_in * len(place.colspan) / place.get_gridspec().ncols
        for text in (axes.title, axes._left_title, axes.xaxis.label):
            n_lines += _wrapped(text, own_in) - 1
    return n_lines


def _legends(figure: Any, width_cm: float) -> int:
    """Make the figure's legends anew, in as many columns as there is room; their lines."""
    n_lines = 0
    for legend in [*figure.legends]:
        labels, note = [text.get_text() for text in legend.get_texts()], legend.get_title()
        longest = max(map(len, labels)) + _ENTRY_LETTERS
        columns = max(1, int(_LEGEND_LETTERS * width_cm / COLUMN_CM) // longest)
        n_lines += -(-len(labels) // columns) + _wrapped(note, width_cm * _CM)
        side = "lower" if figure._supxlabel is None else "upper"  # not over what stands below
        figure.legend(
            legend.legend_handles, labels, ncols=columns, frameon=False, fontsize=_SMALLEST_PT,
            loc=f"outside {side} center", title=note.get_text(), title_fontsize=_SMALLEST_PT,
        )  # fmt: skip
        legend.remove()
    return n_lines


def _wrapped(text: Text, width_in: float) -> int:
    """Wrap a text; the lines that it has now."""
    lines = text.get_text().split("\n")
    letters = int(width_in * 72 / (_LETTER * float(text.get_fontsize())))
    if max(map(len, lines)) > letters:
        lines = textwrap.wrap(" ".join(lines), letters)
        text.set_text("\n".join(lines))
    return len(lines)

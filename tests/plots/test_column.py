"""Figures for print: as wide as a column, and all of it can be read."""

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text

from vrchain.plots.column import lay_out_for_print
from vrchain.plots.style import COLUMN_CM, PAGE_CM, legend_below, note_below, panels

CM = 1 / 2.54
LONG = "one more of the long words of which there are always some, up to the very end of it"


def drawn(print_cm: float = COLUMN_CM, columns: int = 3, note: str = "") -> Figure:
    figure, row = panels(14.0, 4.0, 1, columns, print_cm, sharey=True, squeeze=False)
    for k, axes in enumerate(row.flat):
        axes.plot([0, 1], [k, 1], label=f"{LONG[:30]} {k}")
        axes.set(title=f"panel {k}", xlabel=LONG)
    row.flat[0].set_ylabel("metres")
    figure.suptitle(LONG, fontsize=14)
    legend_below(figure, row.flat[0].lines, columns, LONG)
    note_below(figure, note)
    lay_out_for_print(figure)
    return figure


@pytest.mark.parametrize(
    ("print_cm", "columns", "note"),
    [(COLUMN_CM, 3, ""), (COLUMN_CM, 1, ""), (COLUMN_CM, 2, LONG), (PAGE_CM, 2, "")],
)
def test_all_is_on_the_page_and_large_enough(print_cm: float, columns: int, note: str) -> None:
    figure = drawn(print_cm, columns, note)
    width_in, height_in = figure.get_size_inches()
    assert (width_in, height_in < 24 * CM) == (pytest.approx(print_cm * CM), True)
    FigureCanvasAgg(figure).draw()
    texts = [t for t in figure.findobj(Text) if t.get_visible() and t.get_text()]
    assert min(float(t.get_fontsize()) for t in texts) >= 6.0
    ticks = {t for a in figure.axes for t in (*a.get_xticklabels(), *a.get_yticklabels())}
    page = figure.bbox
    for text in set(texts) - ticks:
        box = text.get_window_extent()
        assert page.x0 - 3 <= box.x0 and box.x1 <= page.x1 + 3, text
        assert page.y0 - 3 <= box.y0 and box.y1 <= page.y1 + 3, text


def test_panels_of_a_column_stand_under_each_other_each_with_its_label() -> None:
    figure = drawn()
    FigureCanvasAgg(figure).draw()
    tops = [axes.get_position().y1 for axes in figure.axes]
    assert tops == sorted(tops, reverse=True)
    assert len({round(axes.get_position().x0, 3) for axes in figure.axes}) == 1
    assert [axes.get_ylabel() for axes in figure.axes] == ["metres"] * 3
    assert all(axes.yaxis.get_ticklabels()[1].get_visible() for axes in figure.axes)


def test_a_map_keeps_its_shape_and_a_page_its_rows() -> None:
    figure, axes = panels(8.0, 8.0)
    axes.set(aspect="equal", xlim=(0, 10), ylim=(0, 20))
    lay_out_for_print(figure)
    FigureCanvasAgg(figure).draw()
    box = axes.get_window_extent()
    assert box.height / box.width == pytest.approx(2.0, rel=0.01)
    page = drawn(PAGE_CM, 2)
    assert len({axes.get_position().y0 for axes in page.axes}) == 1


def test_pictures_alone_stay_side_by_side() -> None:
    figure, row = panels(9.0, 3.0, 1, 3)
    for axes in row:
        axes.imshow(np.zeros((3, 4)))
    lay_out_for_print(figure)
    assert [axes.get_subplotspec().colspan.start for axes in figure.axes] == [0, 1, 2]

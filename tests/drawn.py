"""What is in a figure: its texts, and those that do not fit into it."""

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.text import Text


def words(figure: Figure) -> list[str]:
    return [text.get_text() for text in figure.findobj(Text) if text.get_text()]


def strays(figure: Figure) -> list[str]:
    """Texts that reach beyond the figure's edges, by more than two pixels."""
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    edge = figure.bbox.padded(2)
    found = []
    for text in figure.findobj(Text):
        if not (text.get_text() and text.get_visible()):
            continue
        extent = text.get_window_extent(canvas.get_renderer())
        clipped = text.get_clip_on() or extent.width == 0
        inside = edge.contains(extent.x0, extent.y0) and edge.contains(extent.x1, extent.y1)
        if not (clipped or inside):
            found.append(text.get_text())
    return found

"""What all figures have alike: colours, panels, labels, legends, notes, and numbers with units."""

from collections.abc import Iterable, Mapping
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.text import Annotation

# Told apart by the colour-blind: Okabe and Ito's palette, and lightness on a map.
BLUE, SKY, GREEN, RED, ORANGE = "#0072B2", "#56B4E9", "#009E73", "#D55E00", "#E69F00"
GREY = "#555555"
_ROBOTS = (RED, BLUE, "#aa3f83", ORANGE, SKY, GREEN)
_CLAIMS = (
    "#ffd400", "#ff3b30", "#00e5ff", "#ff7af6", "#7cff4f", "#ff9f0a", "#b18cff", "#0a84ff",
)  # fmt: skip
CLAIMS_TOLD_APART = len(_CLAIMS)
WHITE_BOX = {"boxstyle": "round,pad=0.15", "facecolor": "white", "edgecolor": "none", "alpha": 0.8}

COLUMN_CM, PAGE_CM, SIDEWAYS_CM = 8.5, 17.6, 24.0  # of print; a page turned by 90 degrees

BYTES = {"GB": 1e9, "MB": 1e6, "kB": 1e3, "B": 1.0}
MICROSECONDS = {"s": 1e6, "ms": 1e3, "µs": 1.0, "ns": 1e-3}


def robot_colour(number: int) -> str:
    """Of a team's robot by its place in the team."""
    return _ROBOTS[number % len(_ROBOTS)]


def claim_colour(number: int) -> str:
    """Of a claim, bright on photographs."""
    return _CLAIMS[number % len(_CLAIMS)]


def panels(
    width_in: float,
    height_in: float,
    rows: int = 1,
    columns: int = 1,
    print_cm: float = COLUMN_CM,
    **given: Any,
) -> tuple[Figure, Any]:
    """A figure and its axes, or an array of them; ``given``: see ``Figure.subplots``.

    print_cm: how wide it has to be in print, its label; see ``column``.
    """
    figure = Figure(figsize=(width_in, height_in), layout="constrained", label=f"{print_cm}")
    return figure, figure.subplots(rows, columns, **given)


def label(
    axes: Axes, text: str, at: tuple[float, float], offset_pt: tuple[float, float], **style: Any
) -> Annotation:
    """A text beside a point."""
    return axes.annotate(text, at, xytext=offset_pt, textcoords="offset points", **style)


def outline(axes: Axes, box: Iterable[float], colour: str, lw: float = 2, **style: Any) -> None:
    """A box x0, y0, x1, y1, not filled."""
    x0, y0, x1, y1 = box
    axes.add_patch(Rectangle((x0, y0), x1 - x0, y1 - y0, fill=False, ec=colour, lw=lw, **style))


def tag(
    axes: Axes, text: str, x: float, y: float, colour: str, pad: float = 1.0, **style: Any
) -> None:
    """A small text on a coloured ground, cut off where the axes end."""
    ground = {"facecolor": colour, "edgecolor": "none", "pad": pad}
    axes.text(x, y, text, clip_on=True, bbox=ground, **style)


def legend_below(figure: Figure, handles: Iterable[Any], columns: int, note: str = "") -> None:
    """The legend of all panels, under the figure's note."""
    figure.legend(
        handles=list(handles), loc="outside lower center", ncols=columns, frameon=False, fontsize=9,
        title=note, title_fontsize=8.5,
    )  # fmt: skip


def note_below(figure: Figure, text: str) -> None:
    """Small print; nothing without a text."""
    if text:
        figure.supxlabel(text, fontsize=8, color=GREY, x=0.01, ha="left")


def in_units(value: float, units: Mapping[str, float]) -> str:
    """Three digits and the largest of ``BYTES`` or ``MICROSECONDS`` that gives 1 or more."""
    *larger, least = units.items()
    unit, factor = next((u for u in larger if value >= u[1]), least)
    return f"{value / factor:.3g} {unit}"

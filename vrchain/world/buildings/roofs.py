"""Roofs with thickness and overhang over a rectangle of walls, and the walls that reach up to them.

A roof has slopes: rise over run of each strip from the eave up. One makes a gable, a steep and a
flat one a gambrel.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vrchain.world.shapes import Part, Rect, join, polygon, wall

_THICK_M = 0.14


@dataclass(frozen=True, eq=False)
class Roof:
    """What is seen from above, from below, and at the edges; the cover's size for its texture."""

    cover: Part
    soffit: Part
    fascia: Part
    length_m: float
    slope_m: float


def slab(corners: ArrayLike, thick_m: float = _THICK_M) -> Roof:
    """One sloping board, corners (4, 3) anticlockwise from above, the lower edge first."""
    low = np.asarray(corners, dtype=float)
    high = low + np.array([0, 0, thick_m])
    edges = [polygon([low[i], low[j], high[j], high[i]]) for i, j in itertools.pairwise(_AROUND)]
    length_m, slope_m = (float(np.linalg.norm(low[i + 1] - low[i])) for i in (0, 1))
    return Roof(polygon(high), polygon(low[::-1]), join(edges), length_m, slope_m)


_AROUND = (0, 1, 2, 3, 0)


def pent(rect: Rect, low_m: float, high_m: float, thick_m: float) -> Roof:
    """One board over a rectangle that rises towards +y."""
    x0, y0, x1, y1 = rect
    return slab([(x0, y0, low_m), (x1, y0, low_m), (x1, y1, high_m), (x0, y1, high_m)], thick_m)


def roof(kind: str, rect: Rect, top_m: float, slopes: Sequence[float], overhang_m: float) -> Roof:
    """A roof over walls of height ``top_m`` on a rectangle.

    kind: "gable_x" or "gable_y" (the ridge along that axis), "gambrel" (along y) or "hip".
    """
    wide, deep = rect.width_m, rect.depth_m
    along_x = kind == "gable_x" or (kind == "hip" and wide >= deep)
    length, span = (wide, deep) if along_x else (deep, wide)
    made = (_hip if kind == "hip" else _ridged)(length, span, top_m, slopes, overhang_m)
    centre = ((rect.x0 + rect.x1) / 2, (rect.y0 + rect.y1) / 2, 0.0)
    turn = 0.0 if along_x else np.pi / 2
    cover, soffit, fascia = (p.moved(centre, turn) for p in (made.cover, made.soffit, made.fascia))
    return Roof(cover, soffit, fascia, made.length_m, made.slope_m)


def _ridged(length: float, span: float, top: float, slopes: Sequence[float], over: float) -> Roof:
    """Ridge along x over the origin."""
    reach = length / 2 + over
    edge = profile(span / 2, slopes) * (-1, 1) + (span / 2, top)  # y from the ridge, z
    edge[0] += over * np.array([1.0, -slopes[0]])
    slabs = [
        slab([(-x, -y0, z0), (x, -y0, z0), (x, -y1, z1), (-x, -y1, z1)])
        for (low, z0), (high, z1) in itertools.pairwise(edge)
        for x, y0, y1 in ((reach, low, high), (-reach, -low, -high))
    ]
    cover, soffit, fascia = (
        join([getattr(s, part) for s in slabs]) for part in ("cover", "soffit", "fascia")
    )
    return Roof(cover, soffit, fascia, slabs[0].length_m, slabs[-1].slope_m)


def _hip(length: float, span: float, top: float, slopes: Sequence[float], over: float) -> Roof:
    """Ridge along x over the origin, all four sides sloping alike; length >= span."""
    x, y, ridge_x = length / 2 + over, span / 2 + over, (length - span) / 2
    eave = top - over * slopes[0]
    up, ridge = eave + _THICK_M, top + slopes[0] * span / 2 + _THICK_M
    low = [(-x, -y, eave), (x, -y, eave), (x, y, eave), (-x, y, eave)]
    a, b, c, d = ((*corner[:2], up) for corner in low)
    end_u, half = ridge_x / (2 * x), y / (2 * x)
    trapezoid = [(0, 0), (1, 0), (0.5 + end_u, 1), (0.5 - end_u, 1)]
    triangle = [(0.5 - half, 0), (0.5 + half, 0), (0.5, 1)]
    left, right = (-ridge_x, 0.0, ridge), (ridge_x, 0.0, ridge)
    cover = [
        polygon([a, b, right, left], trapezoid),
        polygon([c, d, left, right], trapezoid),
        polygon([b, c, right], triangle),
        polygon([d, a, left], triangle),
    ]
    high = (a, b, c, d)
    fascia = [polygon([low[i], low[j], high[j], high[i]]) for i, j in itertools.pairwise(_AROUND)]
    return Roof(
        join(cover), polygon(low[::-1]), join(fascia), 2 * x, float(np.hypot(y, ridge - up))
    )


def profile(half_span_m: float, slopes: Sequence[float]) -> NDArray[np.float64]:
    """From eave to ridge across a roof: (n + 1, 2) of inward and upward, slopes equally long."""
    tilt = np.arctan(slopes)
    length = half_span_m / np.cos(tilt).sum()
    steps = length * np.column_stack([np.cos(tilt), np.sin(tilt)])
    points = np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
    points[-1, 0] = half_span_m  # to the last bit
    return points


def gable_wall(
    ends: tuple[tuple[float, float], tuple[float, float]],
    bottom_m: float,
    top_m: float,
    slopes: Sequence[float] = (),
) -> tuple[Part, float, float]:
    """A wall seen from the right of its ends' direction, and its width and height.

    slopes: of the roof that it reaches up to, none for a wall under an eave.
    """
    a, b = np.array(ends)
    width = float(np.hypot(*(b - a)))
    if not slopes:
        return wall(a, b, bottom_m, top_m), width, top_m - bottom_m
    left = profile(width / 2, slopes) + np.array([0.0, top_m - bottom_m])
    height = float(left[-1, 1])
    right = left[:-1] * (-1.0, 1.0) + (width, 0.0)
    uv = np.vstack([(0, 0), (width, 0), right, left[::-1]]) / (width, height)
    corners = np.column_stack([a + uv[:, :1] * (b - a), bottom_m + uv[:, 1] * height])
    return polygon(corners, uv), width, height

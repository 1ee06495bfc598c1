"""Roofs with thickness and overhang over a rectangle of walls."""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vrchain.world.shapes import Part, join, polygon

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
    edges = [
        polygon([low[i], low[j], high[j], high[i]]) for i, j in ((0, 1), (1, 2), (2, 3), (3, 0))
    ]
    return Roof(
        polygon(high),
        polygon(low[::-1]),
        join(edges),
        float(np.linalg.norm(low[1] - low[0])),
        float(np.linalg.norm(low[2] - low[1])),
    )


def roof(
    kind: str,
    rect: tuple[float, float, float, float],
    top_m: float,
    pitch: float,
    overhang_m: float,
) -> Roof:
    """A roof over walls of height ``top_m`` on (x0, y0, x1, y1).

    kind: "gable_x" or "gable_y" (the ridge along that axis), or "hip".
    """
    x0, y0, x1, y1 = rect
    centre = ((x0 + x1) / 2, (y0 + y1) / 2, 0.0)
    along_x = kind == "gable_x" or (kind == "hip" and x1 - x0 >= y1 - y0)
    length, span = (x1 - x0, y1 - y0) if along_x else (y1 - y0, x1 - x0)
    made = (_hip if kind == "hip" else _gable)(length, span, top_m, pitch, overhang_m)
    turn = 0.0 if along_x else np.pi / 2
    cover, soffit, fascia = (p.moved(centre, turn) for p in (made.cover, made.soffit, made.fascia))
    return Roof(cover, soffit, fascia, made.length_m, made.slope_m)


def _gable(length: float, span: float, top: float, pitch: float, over: float) -> Roof:
    """Ridge along x over the origin."""
    x, y = length / 2 + over, span / 2 + over
    eave, ridge = top - over * pitch, top + pitch * span / 2
    front = slab([(-x, -y, eave), (x, -y, eave), (x, 0, ridge), (-x, 0, ridge)])
    back = slab([(x, y, eave), (-x, y, eave), (-x, 0, ridge), (x, 0, ridge)])
    return Roof(
        join([front.cover, back.cover]),
        join([front.soffit, back.soffit]),
        join([front.fascia, back.fascia]),
        front.length_m,
        front.slope_m,
    )


def _hip(length: float, span: float, top: float, pitch: float, over: float) -> Roof:
    """Ridge along x over the origin, all four sides sloping alike; length >= span."""
    x, y, ridge_x = length / 2 + over, span / 2 + over, (length - span) / 2
    eave = top - over * pitch
    up, ridge = eave + _THICK_M, top + pitch * span / 2 + _THICK_M
    a, b, c, d = (-x, -y), (x, -y), (x, y), (-x, y)
    end_u = ridge_x / (2 * x)
    trapezoid = [(0, 0), (1, 0), (0.5 + end_u, 1), (0.5 - end_u, 1)]
    half = y / (2 * x)
    triangle = [(0.5 - half, 0), (0.5 + half, 0), (0.5, 1)]
    left, right = (-ridge_x, 0.0, ridge), (ridge_x, 0.0, ridge)
    cover = [
        polygon([(*a, up), (*b, up), right, left], trapezoid),
        polygon([(*c, up), (*d, up), left, right], trapezoid),
        polygon([(*b, up), (*c, up), right], triangle),
        polygon([(*d, up), (*a, up), left], triangle),
    ]
    rim = [(a, b), (b, c), (c, d), (d, a)]
    fascia = [polygon([(*p, eave), (*q, eave), (*q, up), (*p, up)]) for p, q in rim]
    soffit = polygon([(*d, eave), (*c, eave), (*b, eave), (*a, eave)])
    return Roof(join(cover), soffit, join(fascia), 2 * x, float(np.hypot(y, ridge - up)))


def profile(half_span_m: float, slopes: Sequence[float]) -> NDArray[np.float64]:
    """From eave to ridge across a roof: (n + 1, 2) of inward and upward, slopes equally long.

    slopes: rise over run of each from the eave up; one is a gable, a steep and a flat a gambrel.
    """
    tilt = np.arctan(slopes)
    length = half_span_m / np.cos(tilt).sum()
    steps = length * np.column_stack([np.cos(tilt), np.sin(tilt)])
    return np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])


def gambrel(
    rect: tuple[float, float, float, float],
    top_m: float,
    slopes: Sequence[float],
    overhang_m: float,
) -> Roof:
    """A roof of ``profile`` over walls of height ``top_m`` on (x0, y0, x1, y1), ridge along y."""
    x0, y0, x1, y1 = rect
    front, back = y0 - overhang_m, y1 + overhang_m
    edge = profile((x1 - x0) / 2, slopes) + np.array([0.0, top_m])
    edge[0] -= overhang_m * np.array([1.0, slopes[0]])
    slabs = []
    for (low, low_z), (high, high_z) in itertools.pairwise(edge):
        right = [(x1 - low, low_z), (x1 - low, low_z), (x1 - high, high_z), (x1 - high, high_z)]
        left = [(x0 + low, low_z), (x0 + low, low_z), (x0 + high, high_z), (x0 + high, high_z)]
        for side, ys in ((right, (front, back, back, front)), (left, (back, front, front, back))):
            slabs.append(slab([(x, y, z) for (x, z), y in zip(side, ys, strict=True)]))
    return Roof(
        join([s.cover for s in slabs]),
        join([s.soffit for s in slabs]),
        join([s.fascia for s in slabs]),
        back - front,
        slabs[-1].slope_m,
    )

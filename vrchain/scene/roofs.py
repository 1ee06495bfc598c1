"""Roofs with thickness and overhang over a rectangle of walls."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from vrchain.scene.shapes import Part, join, polygon

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

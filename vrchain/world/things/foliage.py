"""Leaf cards: small cut-out pictures of twigs, and the rectangles in space that show them.

The pictures are (h, w, 4) uint8, a twig's foot at the middle of the bottom. Leaves are drawn a
little larger than life, or they would be finer than a pixel ten metres away.
"""

from typing import NamedTuple

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from vrchain.world.shapes import Image, Part
from vrchain.world.textures import Colour, Shape, times

Points = NDArray[np.float64]

_WOOD_RGB = (84.0, 70.0, 56.0)


def twig(rng: Generator, size_px: int, colour: Colour, leaf_px: float, slim: float) -> Image:
    """A branching twig in leaf, filling a ragged disc; ``slim``: a leaf's width by its length."""
    card = _empty((size_px, size_px), colour)
    foot = np.array([size_px / 2, size_px - 2.0])
    n = int(rng.integers(7, 10))
    lean = np.linspace(-1.15, 1.15, n) + rng.normal(0, 0.08, n)
    reach = size_px * (0.88 - 0.36 * (lean / 1.15) ** 2) * rng.uniform(0.8, 1.05, n)
    tips = foot + reach[:, None] * np.stack([np.sin(lean), -np.cos(lean)], axis=1)
    for tip in tips:
        _line(card, foot, tip, _WOOD_RGB)
    many = round(0.9 * size_px**2 / (n * leaf_px**2 * slim))
    along = np.sqrt(rng.uniform(0.04, 1.0, many * n))
    stem = rng.permutation(np.repeat(np.arange(n), many))
    at = foot + along[:, None] * (tips[stem] - foot) + rng.normal(0, 0.05 * size_px, (many * n, 2))
    angle = lean[stem] + rng.normal(0, 0.9, many * n)
    _leaves(rng, card, at, angle, leaf_px, slim, colour)
    return card


def strands(rng: Generator, shape: Shape, colour: Colour) -> Image:
    """Thin shoots that hang from the top to uneven ends, with narrow leaves."""
    h, w = shape
    card = _empty(shape, colour)
    for x in np.linspace(0.14, 0.86, 6) * w + rng.normal(0, 0.02 * w, 6):
        end = h * rng.uniform(0.62, 0.98)
        sway = rng.normal(0, 0.05 * w) * np.linspace(0, 1, 44) ** 2
        at = np.stack([x + sway, np.linspace(0, end, 44)], axis=1)
        _line(card, at[0], at[-1], times(colour, 0.7))
        angle = np.pi + rng.choice([-0.45, 0.45], 44) + rng.normal(0, 0.2, 44)
        _leaves(rng, card, at, angle, 0.2 * w, 0.3, colour)
    return card


def bough(rng: Generator, shape: Shape, colour: Colour) -> Image:
    """A branch of a conifer, its foot below: side shoots that needles make ragged."""
    h, w = shape
    card = _empty(shape, colour)
    n = 15
    for k, level in enumerate(np.linspace(0.05, 0.97, n)):
        root = np.array([w / 2, h * (1 - level)])
        wide = 0.5 * w * min(1.0, 1.9 * (1.04 - level), 0.55 + 1.6 * level)
        for side in (-1, 1):
            out = wide * rng.uniform(0.75, 1.0)
            tip = root + out * np.array([side, -0.55])
            tone = rng.uniform(0.6, 1.15) + 0.1 * k / n
            _needles(rng, card, root, tip, times(colour, tone))
    return card


def strew(rng: Generator, card: Image, rgb: Colour, n: int) -> None:
    """Draw flowers or fruit on the leaves of a picture."""
    y, x = np.nonzero(card[..., 3])
    for k in rng.integers(0, len(x), n):
        light = times(rgb, rng.uniform(0.8, 1.05))
        cv2.circle(card, (int(x[k]), int(y[k])), 2, (*light, 255), -1)


class Cards(NamedTuple):
    """Rectangles that each show a whole picture, from both sides.

    foot_m: (k, 3), the middle of the picture's lower edge; right_m, up_m: (k, 3), its edges; they
    face right x up. fold_m: (k, 3) or None, how far the middle line from the foot up is lifted.
    """

    foot_m: Points
    right_m: Points
    up_m: Points
    fold_m: Points | None = None

    def every(self, step: int, first: int) -> "Cards":
        """Each ``step``-th card, from card ``first``."""
        cut = slice(first, None, step)
        fold = None if self.fold_m is None else self.fold_m[cut]
        return Cards(self.foot_m[cut], self.right_m[cut], self.up_m[cut], fold)

    def part(self) -> Part:
        """The triangles: two a card, four where it is folded."""
        across = (0, 1) if self.fold_m is None else (0, 0.5, 1)
        n, k = len(across), len(self.foot_m)
        uv = np.array([(u, v) for v in (0, 1) for u in across])
        u, v = uv[:, :1], uv[:, 1:]
        points = self.foot_m[:, None] + (u - 0.5) * self.right_m[:, None] + v * self.up_m[:, None]
        if self.fold_m is not None:
            points += (u == 0.5) * self.fold_m[:, None]
        quads = [(i, i + 1, i + n + 1, i + n) for i in range(n - 1)]
        faces = np.array([f for a, b, c, d in quads for f in ((a, b, c), (a, c, d))])
        first = len(uv) * np.arange(k)[:, None, None]
        return Part(points.reshape(-1, 3), (first + faces).reshape(-1, 3), np.tile(uv, (k, 1)))


def _empty(shape: Shape, colour: Colour) -> Image:
    """Nothing but air, of the leaves' colour: or small mip levels would have dark rims."""
    return np.full((*shape, 4), (*times(colour, 0.8), 0), dtype=np.uint8)


def _line(card: Image, start: Points, end: Points, rgb: Colour) -> None:
    a, b = (tuple(int(c) for c in np.round(p)) for p in (start, end))
    cv2.line(card, a, b, (*rgb, 255), 1)


def _leaves(
    rng: Generator, card: Image, at: Points, angle_rad: Points, leaf_px: float, slim: float,
    colour: Colour,
) -> None:  # fmt: skip
    """Pointed leaves from ``at`` (n, 2) px, angle 0 upwards, later ones lighter; none cut off."""
    n = len(at)
    length = leaf_px * rng.uniform(0.7, 1.15, n)[:, None]
    ahead = np.stack([np.sin(angle_rad), -np.cos(angle_rad)], axis=1) * length
    aside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1) * slim / 2
    share = np.array([(0.0, 0.0), (0.3, 0.85), (0.55, 0.9), (1.0, 0.0), (0.55, -0.9), (0.3, -0.85)])
    outline = at[:, None] + share[:, :1] * ahead[:, None] + share[:, 1:] * aside[:, None]
    h, w = card.shape[:2]
    inside = ((outline >= 1) & (outline <= (w - 2, h - 2))).all(axis=(1, 2))
    light = np.linspace(0.62, 1.1, n) * rng.normal(1, 0.13, n)
    warm = rng.normal(0, 7, n)[:, None] * (0.8, 0.3, -0.5)
    rgb = np.clip(light[:, None] * np.asarray(colour) + warm, 0, 255)
    for polygon, leaf in zip(np.round(outline[inside]).astype(np.int32), rgb[inside], strict=True):
        cv2.fillConvexPoly(card, polygon, (*leaf.tolist(), 255))


def _needles(rng: Generator, card: Image, root: Points, tip: Points, rgb: Colour) -> None:
    """A shoot: a tapering ragged sliver from root to tip."""
    ahead = tip - root
    aside = np.array([-ahead[1], ahead[0]]) / max(np.linalg.norm(ahead), 1e-9)
    t = np.linspace(0, 1, 6)[:, None]
    thick = card.shape[1] * 0.055 * (1.15 - t)
    left = root + t * ahead + aside * thick * rng.uniform(0.5, 1.5, (6, 1))
    right = root + t * ahead - aside * thick * rng.uniform(0.5, 1.5, (6, 1))
    outline = np.round(np.concatenate([left, right[::-1]])).astype(np.int32)
    cv2.fillPoly(card, [outline], (*rgb, 255))
    _line(card, root, tip, times(rgb, 0.7))

"""Walls as pictures: a material with trim and small things, and openings drawn on it."""

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.random import Generator

from vrchain.world import textures
from vrchain.world.buildings.facade_style import PX_PER_M, Style
from vrchain.world.buildings.openings import Opening, draw
from vrchain.world.drawing import fill, frame
from vrchain.world.shapes import Image
from vrchain.world.textures import times


def paint(
    rng: Generator, style: Style, width_m: float, height_m: float, openings: Sequence[Opening]
) -> Image:
    """The picture of one wall, its left as seen from outside at the picture's left."""
    w, h = max(8, round(width_m * PX_PER_M)), max(8, round(height_m * PX_PER_M))
    image = style.material(rng, (h, w), style.wall_rgb, PX_PER_M)
    split = h - round(style.upper_from_m * PX_PER_M)
    if style.upper is not style.material and split > 8:
        image[:split] = style.upper(rng, (split, w), style.upper_rgb, PX_PER_M)
        fill(image, (0, split - 3, w, split + 2), style.trim_rgb)
    plinth = min(round(0.35 * PX_PER_M), h // 3)
    image[h - plinth :] = textures.stone(rng, (plinth, w), style.plinth_rgb, PX_PER_M)
    _age(rng, image)
    _trim(rng, image, style)
    _add_boxes(rng, image, openings)
    if rng.random() < 0.3:
        _creeper(rng, image)
    for opening in openings:
        draw(rng, image, style, opening)
    return image


def _age(rng: Generator, image: Image) -> None:
    """Broad stains, darker at the foot: what tells two walls of one material apart."""
    h, w = image.shape[:2]
    stain = 1 + 0.07 * textures.fractal(rng, (h, w), 1.3 * PX_PER_M, 3)
    foot = np.exp(-np.arange(h, dtype=np.float32)[::-1] / (0.3 * PX_PER_M))
    stain *= 1 - 0.35 * foot[:, None]
    image[:] = np.clip(image * stain[..., None], 0, 255).astype(np.uint8)


def _trim(rng: Generator, image: Image, style: Style) -> None:
    """Corner boards, and sometimes a downpipe."""
    h, w = image.shape[:2]
    edge = max(3, round(0.12 * PX_PER_M))
    for x in (0, w - edge):
        fill(image, (x, 0, x + edge, h), style.trim_rgb)
    for x in (edge, w - edge):
        cv2.line(image, (x, 0), (x, h), times(style.wall_rgb, 0.4), 1)
    if rng.random() < 0.4:
        x = edge + 6 if rng.random() < 0.5 else w - edge - 8
        fill(image, (x, 0, x + 3, h), times(style.trim_rgb, 0.5))


def _add_boxes(rng: Generator, image: Image, openings: Sequence[Opening]) -> None:
    """Vents and meter boxes, clear of the openings."""
    h, w = image.shape[:2]
    taken = np.zeros(w, dtype=bool)
    for o in openings:
        left, right = ((o.x_m + s * (o.width_m / 2 + 0.5)) * PX_PER_M for s in (-1, 1))
        taken[max(0, int(left)) : max(0, int(right))] = True
    for _ in range(int(rng.integers(0, 4))):
        x = int(rng.integers(8, max(9, w - 24)))
        y = int(rng.integers(h // 3, max(h // 3 + 1, h - 24)))
        size = int(rng.integers(7, 17))
        if taken[x : x + size].any():
            continue
        box = (x, y, x + size, y + int(size * 1.3))
        fill(image, box, textures.random_hsv(rng, (0, 360), (0, 0.5), (0.3, 0.9)))
        frame(image, box, (40, 40, 40))
        for line in range(y + 3, y + size, 3):
            cv2.line(image, (x + 2, line), (x + size - 2, line), (70, 70, 70), 1)


def _creeper(rng: Generator, image: Image) -> None:
    h, w = image.shape[:2]
    middle, spread = rng.uniform(0, w), rng.uniform(0.5, 1.6) * PX_PER_M
    x, y = np.arange(w, dtype=np.float32)[None, :], np.arange(h, dtype=np.float32)[:, None] / h
    reach = 1.5 - ((x - middle) / spread) ** 2 - 1.6 * (1 - y)
    reach = reach + 0.5 * textures.fractal(rng, (h, w), 20, 4)
    green = textures.random_hsv(rng, (75, 130), 0.6, 0.5)
    leaves = textures.leaves(rng, (h, w), green, 5.0)
    image[reach > 0.6] = leaves[reach > 0.6]

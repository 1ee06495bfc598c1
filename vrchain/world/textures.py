"""Procedural materials: small RGB pictures, every one from its own random generator.

A material takes ``rng``, a ``shape`` (height, width) in pixels, usually a base colour (r, g, b)
in 0..255 and a scale in pixels a metre; it returns (h, w, 3) uint8. Colours are sRGB as drawn.
"""

import colorsys
import itertools
from collections.abc import Callable

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from vrchain.world.shapes import Image

Colour = tuple[float, float, float]
Shape = tuple[int, int]
Field = NDArray[np.float32]
Material = Callable[[Generator, Shape, Colour, float], Image]


def hsv(hue_deg: float, saturation: float, value: float) -> Colour:
    """A colour (r, g, b) in 0..255; saturation and value in 0..1."""
    saturation, value = np.clip((saturation, value), 0, 1)
    r, g, b = colorsys.hsv_to_rgb(hue_deg % 360 / 360, saturation, value)
    return 255 * r, 255 * g, 255 * b


def random_hsv(rng: Generator, *ranges: tuple[float, float] | float) -> Colour:
    """A random colour; ranges of hue in degrees, saturation and value, or one number of each."""
    return hsv(*(rng.uniform(*r) if isinstance(r, tuple) else r for r in ranges))


def times(colour: Colour, factor: float) -> Colour:
    """A darker or lighter colour, white at most."""
    r, g, b = (min(255.0, factor * c) for c in colour)
    return r, g, b


def noise(rng: Generator, shape: Shape, cell_px: float, *, tile: bool = False) -> Field:
    """Smooth noise of mean 0 and deviation about 1, features of ``cell_px``; (h, w) float32."""
    h, w = shape
    rows, cols = max(2, round(h / cell_px)), max(2, round(w / cell_px))
    grid = rng.standard_normal((rows, cols), dtype=np.float32)
    if not tile:
        return cv2.resize(grid, (w, h), interpolation=cv2.INTER_CUBIC) * np.float32(1.25)
    scale_y, scale_x = h / rows, w / cols
    size = (round((cols + 4) * scale_x), round((rows + 4) * scale_y))
    big = cv2.resize(np.pad(grid, 2, mode="wrap"), size, interpolation=cv2.INTER_CUBIC)
    top, left = round(2 * scale_y), round(2 * scale_x)
    return big[top : top + h, left : left + w] * np.float32(1.25)


def fractal(
    rng: Generator, shape: Shape, cell_px: float, octaves: int = 4, *, tile: bool = False
) -> Field:
    """Noise summed over halving cells and amplitudes; (h, w) float32, deviation about 1."""
    total = np.zeros(shape, dtype=np.float32)
    for k in range(octaves):
        total += np.float32(0.6**k) * noise(rng, shape, max(cell_px / 2**k, 1.0), tile=tile)
    return total / np.float32(np.sqrt(sum(0.36**k for k in range(octaves))))


def coloured(base: Colour, brightness: Field, tint: Field | None = None) -> Image:
    """The base colour times 1 + brightness, warmer where ``tint`` (h, w) is positive."""
    image = np.asarray(base, dtype=np.float32) * (1 + brightness)[..., None]
    if tint is not None:
        image += tint[..., None] * np.array([0.8, 0.2, -0.6], dtype=np.float32)
    return np.clip(image, 0, 255).astype(np.uint8)


def plain(rng: Generator, base: Colour, shape: Shape = (24, 24), rough: float = 0.05) -> Image:
    """A nearly uniform colour."""
    return coloured(base, rough * noise(rng, shape, 2) + rough * noise(rng, shape, 8))


def _cells(
    rng: Generator, shape: Shape, cell_h: float, cell_w: float, stagger: float
) -> tuple[Field, Field, Field, Field]:
    """Courses of units: draws of brightness and warmth of each, and (dy, dx) in px inside it."""
    h, w = shape
    y = np.arange(h, dtype=np.float32)[::-1, None] + np.float32(0.5)  # courses from the bottom
    x = np.arange(w, dtype=np.float32)[None, :] + np.float32(rng.uniform(0, cell_w))
    course = np.floor(y / cell_h).astype(np.int64)
    shifted = x + cell_w * ((course * stagger) % 1.0).astype(np.float32)
    unit = np.floor(shifted / cell_w).astype(np.int64)
    draws = rng.standard_normal((2, course.max() + 1, unit.max() + 1)).astype(np.float32)
    value, warmth = (d[course, unit] for d in draws)
    dy = np.broadcast_to(y - course * np.float32(cell_h), shape)
    return value, warmth, dy, shifted - unit * np.float32(cell_w)


def brick(rng: Generator, shape: Shape, base: Colour, px_per_m: float) -> Image:
    """Bricks in running bond, each of its own shade, in light or dark mortar."""
    cell_h, cell_w = rng.uniform(0.09, 0.13) * px_per_m, rng.uniform(0.26, 0.4) * px_per_m
    value, warmth, dy, dx = _cells(rng, shape, cell_h, cell_w, rng.choice([0.5, 0.33, 0.25]))
    odd = (value > rng.uniform(1.0, 2.0)) * np.float32(rng.choice([-0.35, 0.3]))
    image = coloured(base, 0.13 * value + odd + 0.05 * noise(rng, shape, 2), 12 * warmth)
    joint = (dy < max(1.0, 0.02 * px_per_m)) | (dx < max(1.0, 0.02 * px_per_m))
    mortar = rng.choice([70, 150, 200]) + 10 * rng.standard_normal(shape, dtype=np.float32)
    image[joint] = np.clip(mortar[joint, None], 0, 255).astype(np.uint8)
    return image


def siding(rng: Generator, shape: Shape, base: Colour, px_per_m: float) -> Image:
    """Horizontal boards that overlap: a dark line under each, streaky wood."""
    cell_h, cell_w = rng.uniform(0.14, 0.26) * px_per_m, rng.uniform(1.6, 3.6) * px_per_m
    value, warmth, dy, dx = _cells(rng, shape, cell_h, cell_w, 0.37)
    streak = cv2.blur(rng.standard_normal(shape, dtype=np.float32), (15, 1)) * 2
    light = 0.055 * value + 0.04 * streak + 0.1 * (dy / cell_h - 0.6)
    light += 0.04 * fractal(rng, shape, 40, 3)
    light -= 0.4 * (dy < max(1.2, 0.025 * px_per_m)) + 0.3 * (dx < 1.0)
    return coloured(base, light, 4 * warmth)


def boards(rng: Generator, shape: Shape, base: Colour, px_per_m: float) -> Image:
    """Upright boards with battens over their joints."""
    h, w = shape
    turned = siding(rng, (w, h), base, px_per_m)
    return np.ascontiguousarray(np.rot90(turned))


def shakes(rng: Generator, shape: Shape, base: Colour, px_per_m: float) -> Image:
    """Wooden shingles on a wall, uneven in width and shade."""
    cell_h, cell_w = rng.uniform(0.22, 0.34) * px_per_m, rng.uniform(0.14, 0.26) * px_per_m
    value, warmth, dy, dx = _cells(rng, shape, cell_h, cell_w, 0.41)
    light = 0.16 * value + 0.06 * noise(rng, shape, 2) - 0.12 * (dy / cell_h - 0.5)
    light -= 0.4 * (dy < 1.3) + 0.35 * (dx < 1.1)
    return coloured(base, light, 10 * warmth)


def plaster(rng: Generator, shape: Shape, base: Colour, px_per_m: float) -> Image:
    """Rough plaster with stains, patches and a few cracks."""
    light = 0.05 * fractal(rng, shape, 0.8 * px_per_m, 4) + 0.035 * noise(rng, shape, 1.5)
    h, w = shape
    stain = np.clip(fractal(rng, shape, 0.9 * px_per_m, 3) - 1.0, 0, 1)
    image = coloured(base, light - 0.18 * stain, 6 * fractal(rng, shape, px_per_m, 2))
    for _ in range(rng.poisson(h * w / px_per_m**2 / 5)):
        start = rng.uniform([0, 0], [w, h])
        steps = rng.normal(0, 0.14 * px_per_m, (7, 2)) + rng.normal(0, 0.1 * px_per_m, 2)
        line = (start + np.cumsum(steps, axis=0)).astype(np.int32)
        cv2.polylines(image, [line], False, times(base, 0.62), 1, cv2.LINE_AA)
    return image


def half_timber(rng: Generator, shape: Shape, base: Colour, px_per_m: float) -> Image:
    """Plaster between dark beams: posts, rails and braces."""
    image = plaster(rng, shape, base, px_per_m)
    h, w = shape
    dark = hsv(rng.uniform(12, 35), rng.uniform(0.3, 0.6), rng.uniform(0.18, 0.35))
    thick = max(3, int(rng.uniform(0.13, 0.2) * px_per_m))
    posts = range(0, w + 1, max(8, int(rng.uniform(0.9, 1.6) * px_per_m)))
    rails = range(0, h + 1, max(8, int(rng.uniform(1.0, 1.5) * px_per_m)))
    for (x0, x1), (y0, y1) in itertools.product(*map(itertools.pairwise, (posts, rails))):
        style = rng.integers(4)
        if style in (0, 2):
            cv2.line(image, (x0, h - y0), (x1, h - y1), dark, thick)
        if style in (1, 2):
            cv2.line(image, (x1, h - y0), (x0, h - y1), dark, thick)
    for x in posts:
        cv2.line(image, (x, 0), (x, h), dark, thick)
    for y in rails:
        cv2.line(image, (0, h - y), (w, h - y), dark, thick)
    return image


def stone(rng: Generator, shape: Shape, base: Colour, px_per_m: float) -> Image:
    """Uneven stones: the cells nearest to jittered points, with joints between."""
    h, w = shape
    cell = rng.uniform(0.24, 0.42) * px_per_m
    rows, cols = int(h / (0.7 * cell)) + 4, int(w / cell) + 4
    jitter = rng.uniform(-0.38, 0.38, (rows, cols, 2)).astype(np.float32)
    value = rng.standard_normal((2, rows, cols)).astype(np.float32)
    y = np.arange(h, dtype=np.float32)[:, None] / np.float32(0.7 * cell) + 1.5
    x = np.arange(w, dtype=np.float32)[None, :] / np.float32(cell) + 1.5
    row, col = np.floor(y).astype(np.int64), np.floor(x).astype(np.int64)
    cells, distances = [], []
    for di, dj in itertools.product((-1, 0, 1), repeat=2):
        i, j = row + di, col + dj
        gap_y, gap_x = y - (i + 0.5 + jitter[i, j, 0]), x - (j + 0.5 + jitter[i, j, 1])
        cells.append(i * cols + j)
        distances.append(np.abs(gap_y) ** 1.6 + np.abs(gap_x) ** 1.6)
    owner = np.choose(np.argmin(distances, axis=0), cells)
    near, second = np.sort(distances, axis=0)[:2]
    light = 0.2 * value[0].ravel()[owner] + 0.06 * noise(rng, shape, 2) - 0.15 * near
    image = coloured(base, light, 14 * value[1].ravel()[owner])
    image[second - near < 0.12] = np.clip(rng.choice([60, 170, 205]), 0, 255)
    return image


def tiles(rng: Generator, shape: Shape, base: Colour, px_per_m: float) -> Image:
    """Glazed tiles in straight courses, glossy, a few of another shade."""
    side = rng.uniform(0.14, 0.26) * px_per_m
    value, warmth, dy, dx = _cells(rng, shape, side, side * rng.choice([1.0, 2.0]), 0.0)
    gloss = 0.12 * np.clip(dy / side - 0.5, -1, 1)
    image = coloured(base, 0.05 * value + 0.25 * (value > 1.9) + gloss, 4 * warmth)
    image[(dy < 1.1) | (dx < 1.1)] = times(base, float(rng.choice([0.6, 1.3])))
    return image


def shingles(rng: Generator, shape: Shape, base: Colour, px_per_m: float) -> Image:
    """A roof: rows of shingles or tiles, with moss or bleached patches."""
    cell_h, cell_w = rng.uniform(0.24, 0.36) * px_per_m, rng.uniform(0.24, 0.5) * px_per_m
    value, warmth, dy, dx = _cells(rng, shape, cell_h, cell_w, rng.choice([0.5, 0.29, 0.0]))
    light = rng.uniform(0.09, 0.2) * value + 0.05 * noise(rng, shape, 2) - 0.35 * (dy < 1.4)
    light -= 0.2 * (dx < 1.0) + 0.1 * np.clip(fractal(rng, shape, px_per_m, 3), -1, 1)
    return coloured(base, light, 9 * warmth)


def pantiles(rng: Generator, shape: Shape, base: Colour, px_per_m: float) -> Image:
    """A roof of rounded tiles: upright ribs, stepped at every course."""
    cell_h, cell_w = rng.uniform(0.3, 0.4) * px_per_m, rng.uniform(0.24, 0.34) * px_per_m
    value, warmth, dy, dx = _cells(rng, shape, cell_h, cell_w, 0.0)
    light = 0.22 * np.sin(np.pi * dx / cell_w) - 0.12 + 0.1 * value
    light -= 0.3 * (dy < 1.3) + 0.12 * np.clip(fractal(rng, shape, 1.3 * px_per_m, 3), -1, 1)
    return coloured(base, light.astype(np.float32), 10 * warmth)


def metal_sheet(rng: Generator, shape: Shape, base: Colour, px_per_m: float) -> Image:
    """A roof of metal sheets with upright seams."""
    pitch = rng.uniform(0.35, 0.6) * px_per_m
    x = np.arange(shape[1], dtype=np.float32)[None, :] % np.float32(pitch)
    light = 0.3 * (x < 1.2) - 0.3 * ((x > 1.2) & (x < 2.6))
    light = light + 0.07 * fractal(rng, shape, 1.5 * px_per_m, 4)
    return coloured(base, light.astype(np.float32), 5 * noise(rng, shape, 10))


def wood(rng: Generator, shape: Shape, base: Colour, along_x: bool = False) -> Image:
    """Grain along y (or x) and a few knots."""
    h, w = shape
    white = rng.standard_normal(shape, dtype=np.float32)
    grain: Field = cv2.blur(white, (25, 1) if along_x else (1, 25)) * np.float32(4)
    image = coloured(base, 0.16 * grain + 0.08 * fractal(rng, shape, 20, 3), 6 * grain)
    for _ in range(rng.poisson(h * w / 2500)):
        centre = (int(rng.integers(w)), int(rng.integers(h)))
        cv2.ellipse(image, centre, (2, 3), 0, 0, 360, times(base, 0.5), -1, cv2.LINE_AA)
    return image


def leaves(rng: Generator, shape: Shape, base: Colour, leaf_px: float) -> Image:
    """Foliage: leaves ``leaf_px`` long strewn over dark gaps, later ones lighter; tiles in x."""
    h, w = shape
    clumps = fractal(rng, shape, 8 * leaf_px, 3, tile=True)
    gaps = np.float32(-0.55) + 0.1 * noise(rng, shape, 2, tile=True)
    light = gaps + 0.12 * clumps
    n = int(2.2 * h * w / (0.35 * leaf_px**2))
    y, x = rng.integers(0, h, n), rng.integers(0, w, n)
    value = np.linspace(-0.4, 0.2, n) + rng.normal(0, 0.13, n) + 0.16 * clumps[y, x]
    stamps = _leaf_stamps(leaf_px)
    for stamp, members in zip(stamps, np.array_split(np.arange(n), 24), strict=True):
        rows = np.clip(y[members, None] + stamp[0], 0, h - 1)
        columns = (x[members, None] + stamp[1]) % w
        light[rows, columns] = value[members, None]
    return coloured(base, np.clip(light, -0.75, 0.6), 9 * noise(rng, shape, 4 * leaf_px, tile=True))


def _leaf_stamps(leaf_px: float) -> list[NDArray[np.int64]]:
    """Pixel offsets (2, k) of leaves in 24 directions."""
    reach = int(np.ceil(leaf_px / 2))
    dy, dx = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    stamps = []
    for angle in np.arange(24) * 2.4:
        along = (dx * np.cos(angle) + dy * np.sin(angle)) / (leaf_px / 2)
        across = (dy * np.cos(angle) - dx * np.sin(angle)) / (leaf_px / 4)
        inside = along**2 + across**2 <= 1
        stamps.append(np.stack([dy[inside], dx[inside]]))
    return stamps


def bark(rng: Generator, shape: Shape, base: Colour) -> Image:
    """Upright ridges, tileable sideways."""
    h, w = shape
    short = noise(rng, (max(2, h // 8), w), 3, tile=True)
    ridges = cv2.resize(short, (w, h), interpolation=cv2.INTER_LINEAR)
    return coloured(base, 0.25 * ridges + 0.12 * noise(rng, shape, 2, tile=True))


def ground(
    rng: Generator, base: Colour, contrast: float, warmth: float, size_px: int = 512
) -> Image:
    """Tileable ground: fine grain over broad patches without a feature that catches the eye."""
    shape = (size_px, size_px)
    grain = noise(rng, shape, 1.5, tile=True) + 0.7 * noise(rng, shape, 4, tile=True)
    broad = 0.15 * fractal(rng, shape, 90, 3, tile=True)
    warmer = np.float32(warmth) * noise(rng, shape, 24, tile=True)
    return coloured(base, np.float32(contrast) * (grain + broad), warmer)


def paving(rng: Generator, base: Colour, slab_px: int, size_px: int = 512) -> Image:
    """Tileable slabs; ``size_px`` is rounded to whole slabs."""
    n = max(1, round(size_px / slab_px))
    shape = (n * slab_px, n * slab_px)
    draws = rng.standard_normal((n, n), dtype=np.float32)
    value: Field = draws.repeat(slab_px, axis=0).repeat(slab_px, axis=1)
    y, x = np.indices(shape) % slab_px
    light = 0.05 * value + 0.05 * noise(rng, shape, 1.5, tile=True)
    light += 0.04 * fractal(rng, shape, 50, 3, tile=True)
    return coloured(base, light - 0.3 * ((x < 2) | (y < 2)), np.float32(3) * value)

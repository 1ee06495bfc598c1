"""Walls as pictures: a style that a building's walls share, small things, windows and doors."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.random import Generator

from vrchain.world import textures
from vrchain.world.drawing import Box, fill, frame, grown
from vrchain.world.shapes import Image
from vrchain.world.textures import Colour, random_hsv, times

PX_PER_M = 30.0  # of a facade: 3.3 cm a texel
_SKY_RGB = np.array([85, 110, 135], dtype=np.float32)


@dataclass(frozen=True)
class Style:
    """What the walls of one building have in common."""

    material: textures.Material
    wall_rgb: Colour
    upper: textures.Material  # from ``upper_from_m`` up
    upper_rgb: Colour
    upper_from_m: float
    plinth_rgb: Colour
    trim_rgb: Colour
    door_rgb: Colour
    shutter_rgb: Colour
    shutters: bool
    curtain_rgb: Colour
    panes: tuple[int, int]  # across and up
    arched: bool
    lintel: bool
    number: int  # of the house


# Paint, and the ranges of hue (degrees), saturation and value of its colour.
_MATERIALS = (
    (textures.brick, (0, 30), (0.45, 0.7), (0.5, 0.75)),
    (textures.brick, (20, 45), (0.15, 0.4), (0.65, 0.85)),
    (textures.siding, (20, 230), (0.03, 0.3), (0.75, 0.97)),
    (textures.siding, (170, 225), (0.25, 0.5), (0.5, 0.8)),
    (textures.boards, (0, 120), (0.2, 0.5), (0.55, 0.85)),
    (textures.shakes, (15, 50), (0.2, 0.55), (0.5, 0.8)),
    (textures.plaster, (10, 60), (0.1, 0.45), (0.8, 0.97)),
    (textures.plaster, (-30, 210), (0.12, 0.32), (0.78, 0.95)),
    (textures.stone, (20, 50), (0.05, 0.25), (0.55, 0.8)),
    (textures.half_timber, (30, 55), (0.05, 0.25), (0.85, 0.97)),
)
_TRIMS = (
    ((30, 60), (0.0, 0.08), (0.93, 0.99)),  # white
    ((30, 60), (0.0, 0.08), (0.93, 0.99)),
    ((40, 55), (0.15, 0.25), (0.88, 0.95)),  # cream
    ((15, 35), (0.4, 0.6), (0.25, 0.4)),  # brown
    ((130, 170), (0.35, 0.55), (0.25, 0.4)),  # dark green
    ((205, 225), (0.35, 0.6), (0.3, 0.45)),  # dark blue
    ((0, 10), (0.5, 0.65), (0.4, 0.55)),  # dark red
    ((200, 230), (0.05, 0.15), (0.3, 0.5)),  # grey
)


def random_style(rng: Generator, index: int) -> Style:
    """A style; neighbours by ``index`` differ in material."""

    def material(k: int) -> tuple[textures.Material, Colour]:
        paint, *ranges = _MATERIALS[k % len(_MATERIALS)]
        return paint, random_hsv(rng, *ranges)

    paint, wall_rgb = material(3 * index + int(rng.integers(3)))
    trim_rgb = random_hsv(rng, *_TRIMS[int(rng.integers(len(_TRIMS)))])
    two = rng.random() < 0.4
    upper, upper_rgb = material(int(rng.integers(len(_MATERIALS)))) if two else (paint, wall_rgb)
    return Style(
        material=paint,
        wall_rgb=wall_rgb,
        upper=upper,
        upper_rgb=upper_rgb,
        upper_from_m=float(rng.choice([1.0, 2.6, 2.8])),
        plinth_rgb=random_hsv(rng, (0, 60), (0, 0.25), (0.3, 0.6)),
        trim_rgb=trim_rgb,
        door_rgb=random_hsv(rng, (0, 360), (0.4, 0.8), (0.3, 0.7)),
        shutter_rgb=random_hsv(rng, (0, 360), (0.3, 0.8), (0.25, 0.6)),
        shutters=bool(rng.random() < 0.45),
        curtain_rgb=random_hsv(rng, (0, 360), (0, 0.5), (0.6, 0.95)),
        panes=(int(rng.integers(1, 4)), int(rng.integers(1, 5))),
        arched=bool(rng.random() < 0.15),
        lintel=bool(rng.random() < 0.6),
        number=int(rng.integers(1, 400)),
    )


@dataclass(frozen=True)
class Opening:
    """A window, door or garage door; x_m: its middle from the wall's left; z_m: its foot."""

    kind: str  # "window", "door" or "garage"
    x_m: float
    z_m: float
    width_m: float
    height_m: float


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
        _draw(rng, image, style, opening)
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
        fill(image, box, random_hsv(rng, (0, 360), (0, 0.5), (0.3, 0.9)))
        frame(image, box, (40, 40, 40))
        for line in range(y + 3, y + size, 3):
            cv2.line(image, (x + 2, line), (x + size - 2, line), (70, 70, 70), 1)


def _creeper(rng: Generator, image: Image) -> None:
    h, w = image.shape[:2]
    middle, spread = rng.uniform(0, w), rng.uniform(0.5, 1.6) * PX_PER_M
    x, y = np.arange(w, dtype=np.float32)[None, :], np.arange(h, dtype=np.float32)[:, None] / h
    reach = 1.5 - ((x - middle) / spread) ** 2 - 1.6 * (1 - y)
    reach = reach + 0.5 * textures.fractal(rng, (h, w), 20, 4)
    green = random_hsv(rng, (75, 130), 0.6, 0.5)
    leaves = textures.leaves(rng, (h, w), green, 5.0)
    image[reach > 0.6] = leaves[reach > 0.6]


def _draw(rng: Generator, image: Image, style: Style, opening: Opening) -> None:
    """Draw an opening on the picture of its wall."""
    height = image.shape[0]
    x0, x1 = ((opening.x_m + s * opening.width_m / 2) * PX_PER_M for s in (-1, 1))
    y0, y1 = height - (opening.z_m + opening.height_m) * PX_PER_M, height - opening.z_m * PX_PER_M
    kinds = {"window": _window, "door": _door, "garage": _garage_door}
    kinds[opening.kind](rng, image, style, (round(x0), round(y0), round(x1), round(y1)))


def _window(rng: Generator, image: Image, style: Style, box: Box) -> None:
    x0, y0, x1, y1 = box
    w, h = x1 - x0, y1 - y0
    trim, dark = style.trim_rgb, times(style.wall_rgb, 0.35)
    rim = max(2, round(0.09 * PX_PER_M))
    if style.shutters:
        leaf = max(4, w // 3)
        for left in (x0 - rim - leaf, x1 + rim):
            shutter = (left, y0, left + leaf, y1)
            fill(image, shutter, style.shutter_rgb)
            slat = times(style.shutter_rgb, 0.6)
            for y in range(y0 + 3, y1 - 1, 4):
                cv2.line(image, (left + 2, y), (left + leaf - 2, y), slat, 1)
            frame(image, shutter, times(style.shutter_rgb, 0.5))
    frame(image, grown(box, rim + 1), dark)
    fill(image, grown(box, rim), trim)
    pane = image[max(y0, 0) : y1, max(x0, 0) : x1]
    pane[:] = _glass(rng, (h, w), style)[max(-y0, 0) :, max(-x0, 0) :][
        : pane.shape[0], : pane.shape[1]
    ]
    if style.arched:
        middle = (x0 + w // 2, y0)
        cv2.ellipse(image, middle, (w // 2 + rim, w // 3), 0, 180, 360, trim, -1)
        cv2.ellipse(image, middle, (w // 2, w // 3 - rim), 0, 180, 360, (70, 85, 105), -1)
    across, up = style.panes
    for x in (x0 + k * w // across for k in range(1, across)):
        cv2.line(image, (x, y0), (x, y1), trim, 2)
    for y in (y0 + k * h // up for k in range(1, up)):
        cv2.line(image, (x0, y), (x1, y), trim, 2)
    left, right, sill = x0 - 2 * rim, x1 + 2 * rim, y1 + rim
    fill(image, (left, sill, right, sill + 2), times(trim, 1.1))
    cv2.line(image, (left, sill + 3), (right, sill + 3), dark, 1)
    if style.lintel:
        fill(image, (left, y0 - 3 * rim, right, y0 - rim), style.plinth_rgb)
    if rng.random() < 0.2:  # a flower box
        y = sill + 3
        fill(image, (x0, y, x1, y + 6), (105, 70, 45))
        for x in range(x0, x1, 3):
            flower = rng.random() < 0.5
            rgb = random_hsv(rng, (-60, 60), 0.8, 0.9) if flower else (60, 120, 50)
            cv2.circle(image, (x, y - int(rng.integers(0, 5))), 2, rgb, -1)


def _glass(rng: Generator, shape: textures.Shape, style: Style) -> Image:
    """Dark glass that mirrors the sky above, with curtains or a blind behind some of it."""
    h, w = shape
    up = np.linspace(1, 0, h, dtype=np.float32)[:, None]
    tilt = np.linspace(-0.3, 0.3, w, dtype=np.float32)[None, :] * np.float32(rng.choice([-1, 1]))
    sky = np.clip(up + tilt + 0.25 * textures.noise(rng, shape, 12), 0, 1)[..., None]
    image = 35 + sky * _SKY_RGB
    curtain = np.asarray(style.curtain_rgb)
    behind_it = rng.integers(4)
    if behind_it < 2:  # curtains
        x = np.arange(w)
        fold = 0.75 + 0.25 * np.sin(x * rng.uniform(0.7, 1.4))
        reach = rng.uniform(0.15, 0.35) * w
        cloth = (x < reach) | (x > w - reach)
        image[:, cloth] = 0.35 * image[:, cloth] + 0.65 * (curtain * fold[:, None])[cloth]
    elif behind_it == 2:  # a blind, drawn part of the way
        reach = int(rng.uniform(0.2, 0.8) * h)
        slats = np.where(np.arange(reach) % 4 == 0, 0.6, 0.95)[:, None, None]
        image[:reach] = 0.3 * image[:reach] + 0.7 * curtain * slats
    image[:3] *= 0.6
    return np.clip(image, 0, 255).astype(np.uint8)


def _door(rng: Generator, image: Image, style: Style, box: Box) -> None:
    x0, y0, x1, y1 = box
    w, h = x1 - x0, y1 - y0
    rim = max(3, round(0.11 * PX_PER_M))
    fill(image, (x0 - rim, y0 - rim, x1 + rim, y1), style.trim_rgb)
    image[y0:y1, x0:x1] = textures.wood(rng, (h, w), style.door_rgb)
    across, up = int(rng.integers(1, 3)), int(rng.integers(2, 4))
    glazed = rng.random() < 0.6
    for i, j in np.ndindex(across, up):
        left, top = x0 + 3 + i * (w - 4) // across, y0 + 4 + j * (h - 4) // up
        right, bottom = x0 + (i + 1) * (w - 4) // across, y0 + (j + 1) * (h - 4) // up
        if glazed and j == 0:
            fill(image, (left, top, right, bottom), (75, 90, 110))
            cv2.line(image, (left, bottom), (right, top), (150, 170, 185), 1, cv2.LINE_AA)
        frame(image, (left, top, right, bottom), times(style.door_rgb, 0.55))
        light = times(style.door_rgb, 1.35)
        cv2.line(image, (left, bottom + 1), (right, bottom + 1), light, 1)
    cv2.circle(image, (x1 - 5, y0 + int(0.55 * h)), 2, (225, 200, 110), -1)
    fill(image, (x0, y1 - 5, x1, y1), (150, 140, 120))
    x, y = x1 + rim + 4, y0 + int(0.3 * h)  # the plate of the house number
    fill(image, (x, y, x + 26, y + 14), (235, 235, 225))
    font = cv2.FONT_HERSHEY_SIMPLEX
    cv2.putText(image, str(style.number), (x + 2, y + 11), font, 0.36, (25, 25, 25), 1)


def _garage_door(rng: Generator, image: Image, style: Style, box: Box) -> None:
    x0, y0, x1, y1 = box
    rim = max(3, round(0.12 * PX_PER_M))
    base = style.trim_rgb if rng.random() < 0.5 else style.door_rgb
    fill(image, (x0 - rim, y0 - rim, x1 + rim, y1), style.trim_rgb)
    image[y0:y1, x0:x1] = textures.plain(rng, base, (y1 - y0, x1 - x0))
    rows, cols = int(rng.integers(3, 6)), int(rng.integers(3, 7))
    glass_row = int(rng.integers(-2, 2))
    for r in range(rows):
        top, bottom = y0 + r * (y1 - y0) // rows, y0 + (r + 1) * (y1 - y0) // rows
        cv2.line(image, (x0, bottom), (x1, bottom), times(base, 0.4), 1)
        for c in range(cols):
            left, right = x0 + c * (x1 - x0) // cols + 3, x0 + (c + 1) * (x1 - x0) // cols - 3
            panel = (left, top + 4, right, bottom - 4)
            if r == glass_row:
                fill(image, panel, (65, 80, 95))
            frame(image, panel, times(base, 0.6))
    frame(image, box, times(base, 0.4))

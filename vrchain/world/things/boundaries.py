"""Fences and walls, runs along x with their middle at the origin; their height is their own."""

import numpy as np
from numpy.random import Generator

from vrchain.world import textures
from vrchain.world.model import Surface
from vrchain.world.shapes import Image, Model, box
from vrchain.world.textures import Colour, random_hsv, wood

_FENCES = ("picket", "board", "rail", "lattice")
_PX_PER_M = 28.0  # of a wall


def build_fence(length_m: float, low: bool, rng: Generator) -> tuple[Surface, ...]:
    """A wooden fence; ``low``: waist-high, as before a front garden."""
    model = Model()
    style = str(rng.choice(_FENCES[:3] if low else _FENCES))
    white = rng.random() < 0.35
    rgb = random_hsv(rng, (15, 45), (0.25, 0.55), (0.4, 0.75))
    if white:
        rgb = random_hsv(rng, (30, 220), 0.04, 0.95)
    elif rng.random() < 0.3:
        rgb = random_hsv(rng, (0, 260), (0.2, 0.42), (0.4, 0.75))
    height = rng.uniform(0.8, 1.05) if low else rng.uniform(1.3, 1.8)
    half = length_m / 2
    post = model.patch(wood(rng, (64, 24), rgb))
    for x in np.linspace(-half + 0.06, half - 0.06, max(2, round(length_m / 2) + 1)):
        model.add(box((x - 0.06, -0.06, 0), (x + 0.06, 0.06, height + 0.08)), post)
    if style == "board":
        boards = box((-half, -0.02, 0.05), (half, 0.02, height), bottom=True)
        model.add(boards, _boards(rng, rgb, length_m, height - 0.05))
    elif style == "rail":
        rail = model.patch(wood(rng, (16, 256), rgb, along_x=True))
        n = 3 if low else 4
        for z in (height * (k + 0.7) / n for k in range(n)):
            model.add(box((-half, -0.09, z - 0.07), (half, -0.05, z + 0.07), bottom=True), rail)
    else:
        _add_pickets(model, rng, rgb, half, height, closed=style == "lattice")
    return (model.surface(),)


def _boards(rng: Generator, rgb: Colour, width_m: float, height_m: float) -> Image:
    """Upright boards side by side, each of its own shade."""
    image = wood(rng, (round(height_m * 26), round(width_m * 26)), rgb)
    pitch = int(rng.integers(4, 8))
    for x in range(0, image.shape[1], pitch):
        board = image[:, x : x + pitch].astype(float) * rng.uniform(0.7, 1.1)
        image[:, x : x + pitch] = np.clip(board, 0, 255).astype(np.uint8)
        image[:, x] //= 2
    return image


def _add_pickets(
    model: Model, rng: Generator, rgb: Colour, half: float, height: float, *, closed: bool
) -> None:
    """Pickets on two rails, under a wave; ``closed``: with narrow gaps."""
    rail = model.patch(wood(rng, (12, 256), rgb, along_x=True))
    for z in (0.22 * height, 0.78 * height):
        model.add(box((-half, 0.0, z - 0.04), (half, 0.04, z + 0.04), bottom=True), rail)
    tones = [model.patch(wood(rng, (48, 8), textures.times(rgb, k))) for k in (0.8, 0.9, 1.0)]
    width = rng.uniform(0.07, 0.11)
    pitch = width * (1.3 if closed else rng.uniform(1.7, 2.4))
    n = int((2 * half - 0.1) / pitch)
    arch = rng.uniform(-0.08, 0.12)
    for k in range(n):
        x = -half + 0.05 + (k + 0.5) * (2 * half - 0.1) / n
        phase = (x / 2.0) % 1.0
        top = height * (1 + arch * np.sin(np.pi * phase)) + rng.uniform(-0.015, 0.015)
        picket = box((x - width / 2, -0.03, 0.05), (x + width / 2, 0.0, top))
        model.add(picket, tones[int(rng.integers(3))])


def build_wall(length_m: float, low: bool, rng: Generator) -> tuple[Surface, ...]:
    """A brick, stone or plastered wall with a coping and sometimes piers."""
    model = Model()
    height = rng.uniform(0.6, 0.95) if low else rng.uniform(1.2, 1.7)
    half, thick = length_m / 2, 0.14
    materials = (textures.brick, textures.stone, textures.plaster, textures.brick)
    material = materials[int(rng.integers(4))]
    hue, saturation = rng.uniform(0, 40), rng.uniform(0.2, 0.6)
    if material is not textures.brick:
        saturation *= 0.4
    rgb = random_hsv(rng, hue, saturation, (0.5, 0.85))
    shape = (round(height * _PX_PER_M), round(length_m * _PX_PER_M))
    damp = np.linspace(1.0, 0.72, shape[0], dtype=np.float32)[:, None, None] ** 2
    bottom, top = (-half, -thick, 0), (half, thick, height)
    for side in "fb":
        image = material(rng, shape, rgb, _PX_PER_M).astype(np.float32)
        image *= (1 + 0.1 * textures.fractal(rng, shape, 40, 3))[..., None]
        image *= damp
        face = np.clip(image, 0, 255).astype(np.uint8)
        model.add(box(bottom, top, top=False, sides=side), face)
    width_px = max(8, round(2 * thick * _PX_PER_M))
    end = model.patch(material(rng, (shape[0], width_px), rgb, _PX_PER_M))
    model.add(box(bottom, top, top=False, sides="lr"), end)
    coping = model.patch(
        textures.plain(rng, random_hsv(rng, hue, 0.08, (0.5, 0.85)), (12, 128), 0.12)
    )
    lid = (-half, -thick - 0.04, height), (half, thick + 0.04, height + 0.07)
    model.add(box(*lid, bottom=True), coping)
    if rng.random() < 0.6:
        for x in (-half, half - 0.4):
            pier = (x, -thick - 0.07, 0), (x + 0.4, thick + 0.07, height + 0.15)
            model.add(box(*pier, top=False), end)
            cap = (x - 0.03, -thick - 0.1, height + 0.15), (x + 0.43, thick + 0.1, height + 0.22)
            model.add(box(*cap, bottom=True), coping)
    return (model.surface(),)

"""Fences and walls, runs along x with their middle at the origin; their height is their own."""

import numpy as np

from vrchain.world import textures
from vrchain.world.model import Surface
from vrchain.world.shapes import Model, box

_FENCES = ("picket", "board", "rail", "lattice")


def build_fence(length_m: float, low: bool, rng: np.random.Generator) -> tuple[Surface, ...]:
    """A wooden fence; ``low``: waist-high, as before a front garden."""
    model = Model()
    style = str(rng.choice(_FENCES[:3] if low else _FENCES))
    white = rng.random() < 0.35
    rgb = textures.hsv(rng.uniform(15, 45), rng.uniform(0.25, 0.55), rng.uniform(0.4, 0.75))
    if white:
        rgb = textures.hsv(rng.uniform(30, 220), 0.04, 0.95)
    elif rng.random() < 0.3:
        rgb = textures.hsv(rng.uniform(0, 260), rng.uniform(0.2, 0.42), rng.uniform(0.4, 0.75))
    height = rng.uniform(0.8, 1.05) if low else rng.uniform(1.3, 1.8)
    half = length_m / 2
    post = model.patch(textures.wood(rng, (64, 24), rgb))
    for x in np.linspace(-half + 0.06, half - 0.06, max(2, round(length_m / 2) + 1)):
        model.add(box((x - 0.06, -0.06, 0), (x + 0.06, 0.06, height + 0.08)), post)
    if style == "board":
        _boards(model, rng, rgb, half, height)
    elif style == "rail":
        rail = model.patch(textures.wood(rng, (16, 256), rgb, along_x=True))
        n = 3 if low else 4
        for k in range(n):
            z = height * (k + 0.7) / n
            model.add(box((-half, -0.09, z - 0.07), (half, -0.05, z + 0.07), bottom=True), rail)
    else:
        _pickets(model, rng, rgb, half, height, style)
    return (model.surface(),)


def _boards(
    model: Model, rng: np.random.Generator, rgb: textures.Colour, half: float, height: float
) -> None:
    px = 26
    shape = (round((height - 0.05) * px), round(2 * half * px))
    image = textures.wood(rng, shape, rgb)
    pitch = int(rng.integers(4, 8))
    for x in range(0, shape[1], pitch):
        board = image[:, x : x + pitch].astype(float) * rng.uniform(0.7, 1.1)
        image[:, x : x + pitch] = np.clip(board, 0, 255).astype(np.uint8)
        image[:, x] //= 2
    patch = model.patch(image)
    model.add(box((-half, -0.02, 0.05), (half, 0.02, height), bottom=True), patch)


def _pickets(
    model: Model,
    rng: np.random.Generator,
    rgb: textures.Colour,
    half: float,
    height: float,
    style: str,
) -> None:
    rail = model.patch(textures.wood(rng, (12, 256), rgb, along_x=True))
    for z in (0.22 * height, 0.78 * height):
        model.add(box((-half, 0.0, z - 0.04), (half, 0.04, z + 0.04), bottom=True), rail)
    tones = [
        model.patch(textures.wood(rng, (48, 8), textures.times(rgb, k))) for k in (0.8, 0.9, 1.0)
    ]
    width = rng.uniform(0.07, 0.11)
    pitch = width * (rng.uniform(1.7, 2.4) if style == "picket" else 1.3)
    n = int((2 * half - 0.1) / pitch)
    arch = rng.uniform(-0.08, 0.12)
    for k in range(n):
        x = -half + 0.05 + (k + 0.5) * (2 * half - 0.1) / n
        phase = (x / 2.0) % 1.0
        top = height * (1 + arch * np.sin(np.pi * phase)) + rng.uniform(-0.015, 0.015)
        part = box((x - width / 2, -0.03, 0.05), (x + width / 2, 0.0, top), sides="fblr")
        model.add(part, tones[int(rng.integers(3))])


def build_wall(length_m: float, low: bool, rng: np.random.Generator) -> tuple[Surface, ...]:
    """A brick, stone or plastered wall with a coping and sometimes piers."""
    model = Model()
    height = rng.uniform(0.6, 0.95) if low else rng.uniform(1.2, 1.7)
    half, thick = length_m / 2, 0.14
    px = 28.0
    material = (textures.brick, textures.stone, textures.plaster, textures.brick)[
        int(rng.integers(4))
    ]
    hue, saturation = (rng.uniform(0, 40), rng.uniform(0.2, 0.6))
    rgb = textures.hsv(
        hue, saturation if material is textures.brick else 0.4 * saturation, rng.uniform(0.5, 0.85)
    )
    shape = (round(height * px), round(length_m * px))

    def face() -> int:
        image = material(rng, shape, rgb, px).astype(np.float32)
        image *= (1 + 0.1 * textures.fractal(rng, shape, 40, 3))[..., None]
        image *= np.linspace(1.0, 0.72, shape[0], dtype=np.float32)[:, None, None] ** 2
        return model.patch(np.clip(image, 0, 255).astype(np.uint8))

    model.add(box((-half, -thick, 0), (half, thick, height), top=False, sides="f"), face())
    model.add(box((-half, -thick, 0), (half, thick, height), top=False, sides="b"), face())
    end = model.patch(material(rng, (shape[0], max(8, round(2 * thick * px))), rgb, px))
    model.add(box((-half, -thick, 0), (half, thick, height), top=False, sides="lr"), end)
    coping = model.patch(
        textures.plain(rng, textures.hsv(hue, 0.08, rng.uniform(0.5, 0.85)), (12, 128), 0.12)
    )
    model.add(
        box((-half, -thick - 0.04, height), (half, thick + 0.04, height + 0.07), bottom=True),
        coping,
    )
    if rng.random() < 0.6:
        for x in (-half, half - 0.4):
            pier = box((x, -thick - 0.07, 0), (x + 0.4, thick + 0.07, height + 0.15), top=False)
            model.add(pier, end)
            cap = box(
                (x - 0.03, -thick - 0.1, height + 0.15),
                (x + 0.43, thick + 0.1, height + 0.22),
                bottom=True,
            )
            model.add(cap, coping)
    return (model.surface(),)

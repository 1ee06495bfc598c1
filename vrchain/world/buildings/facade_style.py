"""What the walls of one building have in common: materials, colours, kinds of windows."""

from dataclasses import dataclass

from numpy.random import Generator

from vrchain.world import textures
from vrchain.world.textures import Colour, random_hsv

PX_PER_M = 30.0  # of a facade: 3.3 cm a texel


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

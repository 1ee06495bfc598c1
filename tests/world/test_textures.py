"""Materials: the same for one generator, different for another, tileable where they say so."""

from collections.abc import Callable

import numpy as np
import pytest

from vrchain.seeding import generator
from vrchain.world import textures
from vrchain.world.shapes import Image

BASE = (150.0, 120.0, 100.0)
WALLS = [
    textures.brick, textures.siding, textures.boards, textures.shakes, textures.plaster,
    textures.half_timber, textures.stone, textures.shingles, textures.metal_sheet,
]  # fmt: skip


@pytest.mark.parametrize("paint", WALLS, ids=lambda m: m.__name__)
def test_materials_follow_shape_generator_and_base_colour(paint: textures.Material) -> None:
    for shape in ((90, 240), (11, 250), (160, 9)):
        first, again, other = (paint(generator(1, k), shape, BASE, 30.0) for k in "aab")
        assert (first.shape, first.dtype) == ((*shape, 3), np.uint8)
        assert np.array_equal(first, again)
        assert not np.array_equal(first, other)
    images = [paint(generator(k, "wall"), (120, 240), BASE, 30.0) for k in range(5)]
    assert all(image.mean(axis=2).std() > 6 for image in images)
    mean = np.mean([image.mean(axis=(0, 1)) for image in images], axis=0)
    assert np.abs(mean - BASE).max() < 45


def seam(image: Image, axis: int) -> float:
    """Mean step over the wrapped edge over the mean step inside."""
    grey = np.moveaxis(image.astype(float).mean(axis=2), axis, 0)
    inside = np.abs(np.diff(grey, axis=0)).mean()
    return float(np.abs(grey[0] - grey[-1]).mean() / inside)


@pytest.mark.parametrize(
    ("make", "axes"),
    [
        (lambda rng: textures.ground(rng, BASE, 0.1, 3, 256), (0, 1)),
        (lambda rng: textures.leaves(rng, (96, 128), BASE, 6.0), (1,)),
        (lambda rng: textures.bark(rng, (128, 96), BASE), (1,)),
    ],
    ids=["ground", "leaves", "bark"],
)
def test_what_repeats_has_no_seam(
    make: Callable[[np.random.Generator], Image], axes: tuple[int, ...]
) -> None:
    images = [make(generator(k, "tile")) for k in range(8)]
    for axis in axes:
        assert np.mean([seam(image, axis) for image in images]) < 1.5


def test_noise_has_the_mean_and_scale_it_promises() -> None:
    field = textures.noise(generator(5, "noise"), (400, 400), 8)
    assert abs(field.mean()) < 0.1
    assert 0.7 < field.std() < 1.2
    correlation = [np.corrcoef(field[:, :-d].ravel(), field[:, d:].ravel())[0, 1] for d in (1, 16)]
    assert correlation[0] > 0.9  # smooth within a cell
    assert abs(correlation[1]) < 0.1  # and independent two cells on


def test_hsv_knows_the_primary_colours() -> None:
    assert textures.hsv(0, 1, 1) == (255, 0, 0)
    assert textures.hsv(480, 1, 1) == (0, 255, 0)
    assert textures.hsv(77, 0, 0.5) == (127.5, 127.5, 127.5)

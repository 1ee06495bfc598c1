"""Trees of several species, hedges and bushes: wood, and leaves on cut-out cards."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.random import Generator

from vrchain.world import seasons, textures
from vrchain.world.model import Surface
from vrchain.world.shapes import Image, Model, Part, blob, join, polygon, tube
from vrchain.world.textures import Colour, hsv, random_hsv, times
from vrchain.world.things import crowns, foliage
from vrchain.world.things.foliage import Points

SPECIES = ("broadleaf", "broadleaf", "poplar", "conifer", "birch", "willow")


class _Species(NamedTuple):
    """slim: a crown's radius by the tree's height; trunk: its height by the tree's;
    hue_deg: of leaves in summer; upright: a slim straight trunk, up to the tip."""

    crown: Callable[[Generator, Points, float, float, float], crowns.Crown]
    slim: float
    trunk: float
    hue_deg: tuple[float, float]
    upright: bool


_SPECIES = {
    "broadleaf": _Species(crowns.broadleaf, 0.32, 0.6, (55, 118), False),
    "birch": _Species(crowns.birch, 0.24, 0.93, (58, 100), True),
    "poplar": _Species(crowns.poplar, 0.16, 0.8, (72, 112), True),
    "willow": _Species(crowns.willow, 0.36, 0.6, (62, 95), False),
    "conifer": _Species(crowns.conifer, 0.25, 0.97, (100, 160), True),
}


@dataclass(frozen=True)
class TreePlan:
    """Size and species; ``foot_radius_m`` is what a robot could bump into."""

    species: str
    height_m: float
    canopy_radius_m: float
    foot_radius_m: float


def draw_tree(rng: Generator, height_m: tuple[float, float]) -> TreePlan:
    """A random tree of a height in the range."""
    species = str(rng.choice(SPECIES))
    height = float(rng.uniform(*height_m))
    radius = float(height * _SPECIES[species].slim * rng.uniform(0.85, 1.15))
    foot = radius if species == "conifer" else 0.3 + 0.05 * height
    return TreePlan(species, height, radius, foot)


def _leaf_colour(rng: Generator, species: str, season: str) -> Colour:
    """What a tree's leaves are like on the whole."""
    if species == "broadleaf" and rng.random() < 0.18:  # a copper beech, a maple, a cherry
        colour = random_hsv(rng, rng.choice([-25, 8, 28, 325]), (0.35, 0.65), (0.55, 0.8))
    else:
        colour = random_hsv(rng, _SPECIES[species].hue_deg, (0.3, 0.6), (0.48, 0.76))
    return seasons.leaf(colour, season, evergreen=species == "conifer")


def build_tree(plan: TreePlan, rng: Generator, season: str = "summer") -> tuple[Surface, ...]:
    """A tree standing at the origin: its wood, and its leaves cut out of cards."""
    species, height = _SPECIES[plan.species], plan.height_m
    colour = _leaf_colour(rng, plan.species, season)
    wood, leaves = Model(), Model()
    bark = wood.patch(_bark(rng, plan.species))
    top = _trunk(plan, rng, wood, bark, species.trunk * height)
    floor = _floor_m(plan)
    crown = species.crown(rng, top, floor, height, plan.canopy_radius_m)
    for start, end in crown.limbs_m:
        wood.add(tube(start, end, 0.011 * height, 0.004 * height, 3), bark, 0.7)
    if plan.species == "conifer":
        pictures = [foliage.bough(rng, (112, 80), colour) for _ in range(2)]
    else:
        leaf_px, slim = rng.uniform(7.5, 12), rng.uniform(0.4, 0.75)
        pictures = [foliage.twig(rng, 80, colour, leaf_px, slim) for _ in range(3)]
    _add_cards(leaves, plan, floor, crown.twigs, pictures, rng)
    if crown.hanging is not None:
        pictures = [foliage.strands(rng, (160, 48), colour) for _ in range(2)]
        _add_cards(leaves, plan, floor, crown.hanging, pictures, rng)
    return wood.surface(), leaves.surface()


def _floor_m(plan: TreePlan) -> float:
    """Where its leaves begin: robots pass below, but for conifers."""
    h = plan.height_m
    return {"conifer": 0.1 * h, "poplar": max(1.7, 0.18 * h)}.get(plan.species, max(1.75, 0.28 * h))


def _bark(rng: Generator, species: str) -> Image:
    hue, grey = rng.uniform(15, 40), rng.uniform(0.3, 0.55)
    if species != "birch":
        return textures.bark(rng, (72, 48), hsv(hue, 0.3, grey))
    image = textures.bark(rng, (72, 48), hsv(hue, 0.04, 0.9))
    for _ in range(26):  # dark lines across the white
        x, y = int(rng.integers(48)), int(rng.integers(72))
        cv2.line(image, (x, y), (x + int(rng.integers(3, 12)), y), (52, 48, 46), 1)
    return image


def _add_cards(
    leaves: Model, plan: TreePlan, floor_m: float, cards: foliage.Cards, pictures: list[Image],
    rng: Generator,
) -> None:  # fmt: skip
    """Cards of a crown, each with one of the pictures; darker deep inside it and low in it."""
    half_m = (plan.height_m - floor_m) / 2
    scale = np.array([plan.canopy_radius_m, plan.canopy_radius_m, half_m])
    for part, picture in _shared_out(cards, pictures, floor_m):
        off = (part.points - (0, 0, floor_m + half_m)) / scale
        depth = np.clip(np.linalg.norm(off, axis=1), 0, 1)
        light = 0.55 + 0.37 * depth**1.5 + 0.12 * off[:, 2] + rng.uniform(-0.05, 0.05)
        leaves.add(part, picture, np.clip(light, 0.35, 1.0))


def _shared_out(
    cards: foliage.Cards, pictures: list[Image], floor_m: float
) -> Iterator[tuple[Part, Image]]:
    """Each picture with the cards that show it, none lower than a floor."""
    for first, picture in enumerate(pictures):
        part = cards.every(len(pictures), first).part()
        yield _not_below(part, floor_m), picture


def _not_below(part: Part, floor_m: float) -> Part:
    np.maximum(part.points[:, 2], floor_m, out=part.points[:, 2])
    return part


def _trunk(plan: TreePlan, rng: Generator, model: Model, bark: int, top: float) -> Points:
    """A slightly bent trunk; returns its upper end."""
    slim, bend = (0.017, 0.4) if _SPECIES[plan.species].upright else (0.022, 1.0)
    radius = slim * plan.height_m + 0.03
    knee = np.array([*(bend * rng.uniform(-0.06, 0.06, 2) * top), 0.5 * top])
    end = np.array([*(1.4 * knee[:2] + bend * rng.normal(0, 0.03 * top, 2)), top])
    flare = tube((0, 0, 0), knee * 0.3, 1.45 * radius, radius, 8)
    model.add(_not_below(flare, 0.0), bark, 0.85)  # its foot is tilted
    lower = tube(knee * 0.3, knee, radius, 0.8 * radius)
    upper = tube(knee, end, 0.8 * radius, 0.5 * radius if top < 0.7 * plan.height_m else 0.02)
    model.add(join([lower, upper]), bark)
    return end


def build_bush(size_m: float, rng: Generator, season: str = "summer") -> tuple[Surface, ...]:
    """A shrub of two to four lumps within ``size_m`` of width, on the ground."""
    green = random_hsv(rng, (55, 140), (0.35, 0.7), (0.45, 0.75))
    colour = seasons.leaf(green, season, evergreen=False)
    leaf_px, slim = rng.uniform(7, 12), rng.uniform(0.35, 0.8)
    pictures = [foliage.twig(rng, 64, colour, leaf_px, slim) for _ in range(2)]
    if rng.random() < 0.5:  # in flower
        bloom = random_hsv(rng, (-60, 60), (0.3, 0.8), 0.95)
        petal = bloom if seasons.blooms(season) else colour
        for picture in pictures:
            foliage.strew(rng, picture, petal, 14)
    inside, leaves = Model(), Model()
    dark = inside.patch(textures.leaves(rng, (48, 64), times(colour, 0.7), 5.0))
    r = size_m / 2
    for k in range(int(rng.integers(2, 5))):
        angle = 2.4 * k + rng.uniform(0, 1)
        size, height = rng.uniform(0.42, 0.55) * r, rng.uniform(0.7, 1.1) * r
        centre = np.array([0.36 * r * np.cos(angle), 0.36 * r * np.sin(angle), 0.62 * height])
        radii = np.array([size, size, height])
        inside.add(_not_below(blob(centre, 0.6 * radii, n=7, rings=5), 0.0), dark, 0.7)
        twigs = crowns.lump(rng, centre, 0.85 * radii, 34, 0.5 * r + 0.1)
        for part, picture in _shared_out(twigs, pictures, 0.0):
            light = 0.82 + 0.2 * (part.points[:, 2] - centre[2]) / height + rng.uniform(-0.06, 0.04)
            leaves.add(part, picture, np.clip(light, 0.45, 1.0))
    return inside.surface(), leaves.surface()


def build_hedge(
    length_m: float, low: bool, rng: Generator, season: str = "summer"
) -> tuple[Surface, ...]:
    """A clipped hedge along x, its middle at the origin; ``low``: as before a front garden."""
    model = Model()
    height_m = rng.uniform(0.65, 0.95) if low else rng.uniform(1.15, 1.6)
    half, depth = length_m / 2, 0.32
    green = random_hsv(rng, (70, 135), (0.4, 0.7), (0.38, 0.6))
    colour = seasons.leaf(green, season, evergreen=True)
    shape = (max(16, round(height_m * 30)), round(length_m * 30))
    image = textures.leaves(rng, shape, colour, rng.uniform(3.5, 6.0))
    if rng.random() < 0.4:
        bloom = random_hsv(rng, (-60, 60), (0.2, 0.7), 0.95)
        petal = bloom if seasons.blooms(season) else times(colour, 1.1)
        image[textures.noise(rng, shape, 4, tile=True) > 1.8] = petal
    foot = np.linspace(1.0, 0.55, shape[0])[:, None, None] ** 0.7
    side = model.patch(np.clip(image * foot, 0, 255).astype(np.uint8))
    end = model.patch(np.ascontiguousarray(image[:, : round(2 * depth * 30)]))
    n = max(2, round(length_m / 0.8))
    x = np.linspace(-half, half, n + 1)
    wave = height_m * (1 + rng.uniform(-0.05, 0.05, n + 1))
    y = depth + rng.uniform(-0.05, 0.03, n + 1)
    for i in range(n):
        j, u0, u1 = i + 1, i / n, (i + 1) / n
        front = [(x[i], -y[i], 0), (x[j], -y[j], 0), (x[j], -y[j], wave[j]), (x[i], -y[i], wave[i])]
        back = [(x[j], y[j], 0), (x[i], y[i], 0), (x[i], y[i], wave[i]), (x[j], y[j], wave[j])]
        top = [front[3], front[2], back[3], back[2]]
        model.add(polygon(front, [(u0, 0), (u1, 0), (u1, 1), (u0, 1)]), side)
        model.add(polygon(back, [(1 - u1, 0), (1 - u0, 0), (1 - u0, 1), (1 - u1, 1)]), side)
        model.add(polygon(top, [(u0, 0.4), (u1, 0.4), (u1, 1), (u0, 1)]), side)
    for i, sign in ((0, -1), (n, 1)):
        near, far = -sign * y[i], sign * y[i]
        close = [(x[i], near, 0), (x[i], far, 0), (x[i], far, wave[i]), (x[i], near, wave[i])]
        model.add(polygon(close), end)
    return model.surface(), _fringe(rng, x, y, wave, colour)


def _fringe(rng: Generator, x: Points, y: Points, height_m: Points, colour: Colour) -> Surface:
    """Twigs that stick out along a hedge's upper rims, which are at -y and at y over x, (n,)."""
    k = max(4, round(float(np.ptp(x)) / 0.2))
    along = rng.uniform(x[0] + 0.1, x[-1] - 0.1, 2 * k)
    side = np.repeat([-1.0, 1.0], k)
    foot = np.stack([along, 0.9 * side * np.interp(along, x, y), np.interp(along, x, height_m)], 1)
    foot[:, 2] -= 0.16
    size = rng.uniform(0.22, 0.32, (2 * k, 1))
    up = size * np.stack([rng.normal(0, 0.25, 2 * k), 0.35 * side, np.ones(2 * k)], axis=1)
    right = size * np.stack([-side, rng.normal(0, 0.3, 2 * k), np.zeros(2 * k)], axis=1)
    leaves = Model()
    twig = foliage.twig(rng, 64, colour, rng.uniform(11, 15), 0.6)
    leaves.add(foliage.Cards(foot, right, up).part(), twig)
    return leaves.surface()

"""Where a tree's leaf cards are, and the limbs that bear them: one function a species.

A crown fills height ``floor``..``height`` within ``radius`` of the axis; no leaf hangs lower.
"""

from typing import NamedTuple

import numpy as np
from numpy.random import Generator

from vrchain.world.things.foliage import Cards, Points

_GOLDEN_RAD = np.pi * (3 - np.sqrt(5))  # turns by it spread things evenly
_NO_LIMBS = np.zeros((0, 2, 3))


class Crown(NamedTuple):
    """twigs, hanging: cards that stick out, and cards that hang; limbs_m: (n, 2, 3), wood."""

    twigs: Cards
    limbs_m: Points
    hanging: Cards | None = None


def broadleaf(rng: Generator, top: Points, floor: float, height: float, radius: float) -> Crown:
    """Lumps of twigs at the ends of spreading limbs: from a wide oak to a tall ash."""
    n = int(rng.integers(7, 12))
    belly = rng.uniform(-0.35, 0.25)  # the level, -1..1, at which the crown is widest
    tall = (height - floor) / 2
    level = np.linspace(-0.85, 0.9, n) + rng.normal(0, 0.06, n)
    width = np.sqrt(np.clip(1 - ((level - belly) / (1.15 + abs(belly))) ** 2, 0.05, 1))
    turn = rng.uniform(0, 2 * np.pi) + _GOLDEN_RAD * np.arange(n) + rng.normal(0, 0.25, n)
    out = radius * width * rng.uniform(0.35, 0.78, n)
    centre = _ring(turn, out, floor + tall * (1 + 0.78 * level), top[:2])
    size = radius * rng.uniform(0.32, 0.5, n)
    lumps = np.stack([size, size, 0.75 * size], axis=1)
    twigs = [lump(rng, c, r, 20, 0.46 * radius) for c, r in zip(centre, lumps, strict=True)]
    twigs.append(lump(rng, np.array([*top[:2], floor + tall]), 0.8 * lumps[0], 16, 0.5 * radius))
    return Crown(_joined(twigs), _limbs(top, centre, 0.75))


def birch(rng: Generator, top: Points, floor: float, height: float, radius: float) -> Crown:
    """Airy: small lumps up a long leader, their twigs drooping."""
    n = int(rng.integers(11, 15))
    level = np.linspace(0.0, 1.0, n)
    width = radius * np.minimum(0.45 + 1.6 * level, 1.25 * (1.04 - level))
    width *= rng.uniform(0.6, 1.0, n)
    turn = rng.uniform(0, 2 * np.pi) + _GOLDEN_RAD * np.arange(n)
    z = floor + 0.35 + (height - floor - 0.6) * level
    centre = _ring(turn, 0.7 * width, z, top[:2] * np.clip(z / top[2], 0, 1)[:, None])
    size = radius * rng.uniform(0.35, 0.5, n)
    twigs = [
        lump(rng, c, np.array([s, s, 1.1 * s]), 12, 0.38 * radius + 0.12, droop=0.9)
        for c, s in zip(centre, size, strict=True)
    ]
    return Crown(_joined(twigs), _limbs(top, centre, 1.0))


def poplar(rng: Generator, top: Points, floor: float, height: float, radius: float) -> Crown:
    """A column of twigs that all point up."""
    n = int(rng.integers(150, 190))
    level = (np.arange(n) + rng.uniform(0, 1, n)) / n
    turn = _GOLDEN_RAD * np.arange(n) + rng.normal(0, 0.3, n)
    width = radius * np.minimum(1.0, 0.5 + 2.2 * level) * np.sqrt(np.clip(1.03 - level**2.2, 0, 1))
    out = width * np.sqrt(rng.uniform(0.15, 0.75, n))
    away = _ring(turn, 1.0, np.zeros(n))
    size = (0.62 * radius + 0.3) * rng.uniform(0.8, 1.2, n)[:, None]
    foot = out[:, None] * away
    foot[:, 2] = floor + level * (height - floor - 0.9 * size[:, 0])
    foot[:, :2] += top[:2] * np.clip(foot[:, 2] / height, 0, 1)[:, None]
    up = _unit(np.array([0, 0, 1.0]) + 0.28 * away + rng.normal(0, 0.15, (n, 3)))
    side = _unit(np.cross(up, away + rng.normal(0, 0.5, (n, 3))))
    return Crown(Cards(foot, 0.8 * size * side, 1.35 * size * up), _NO_LIMBS)


def willow(rng: Generator, top: Points, floor: float, height: float, radius: float) -> Crown:
    """A dome of limbs that arch over, and long shoots hanging from it."""
    n = int(rng.integers(6, 9))
    turn = rng.uniform(0, 2 * np.pi) + 2 * np.pi * np.arange(n) / n + rng.normal(0, 0.2, n)
    out = radius * rng.uniform(0.35, 0.6, n)
    z = height - (height - floor) * (0.16 + 0.2 * (out / radius) ** 2)
    centre = _ring(turn, out, z, top[:2])
    lumps = [
        lump(rng, c, radius * np.array([0.38, 0.38, 0.2]), 12, 0.4 * radius, droop=0.5)
        for c in [*centre, np.array([*top[:2], height - 0.12 * (height - floor)])]
    ]
    k = 110
    around = _GOLDEN_RAD * np.arange(k) + rng.normal(0, 0.2, k)
    share = np.sqrt((np.arange(k) + 0.5) / k)
    away = _ring(around, 1.0, np.zeros(k))
    begin = radius * (0.25 + 0.68 * share)[:, None] * away
    begin[:, :2] += top[:2]
    begin[:, 2] = height - (height - floor) * (0.06 + 0.34 * share**2.5) * rng.uniform(0.8, 1.3, k)
    end = floor + (height - floor) * rng.uniform(0.0, 0.42, k) * (1.35 - share)
    length = np.maximum(begin[:, 2] - end, 0.5)[:, None]
    fall = length * (np.array([0, 0, -1.0]) + 0.1 * away + rng.normal(0, 0.03, (k, 3)))
    fall[:, 2] = -length[:, 0]
    face = _unit(away + rng.normal(0, 0.45, (k, 3)) * (1, 1, 0))
    wide = 0.24 * radius * rng.uniform(0.8, 1.25, k)[:, None]
    hanging = Cards(begin + fall, wide * np.cross((0, 0, 1.0), face), -fall)
    return Crown(_joined(lumps), _limbs(top, centre, 0.9), hanging)


def conifer(rng: Generator, top: Points, floor: float, height: float, radius: float) -> Crown:
    """Whorls of boughs like small roofs, the low ones drooping, the high ones short and rising."""
    whorls = int(rng.integers(10, 14))
    level = np.repeat(np.linspace(0.0, 1.0, whorls), 9)
    n = len(level)
    turn = 2 * np.pi * np.arange(n) / 9 + np.repeat(rng.uniform(0, 2 * np.pi, whorls), 9)
    turn = turn + rng.normal(0, 0.12, n)
    level = level + rng.normal(0, 0.2 / whorls, n)
    reach = 0.16 + (0.94 * radius - 0.16) * np.clip(1.0 - level, 0, 1) ** 0.9
    reach *= rng.uniform(0.78, 1.0, n)  # a little inside the radius: cards have corners
    slope = -0.55 + 1.1 * level**2 + rng.normal(0, 0.08, n)
    away = _ring(turn, 1.0, slope)
    side = _unit(np.stack([np.sin(turn), -np.cos(turn), rng.normal(0, 0.15, n)], axis=1))
    z = floor + 0.5 * radius + (height - 0.3 - floor - 0.5 * radius) * level
    foot = np.stack([*(top[:2, None] * z / height), z], axis=1)
    wide = np.maximum(0.7 * reach, 0.35)[:, None]
    fold = 0.3 * wide * _unit(np.cross(side, away))
    return Crown(Cards(foot, wide * side, reach[:, None] * away, fold), _NO_LIMBS)


def lump(
    rng: Generator, centre: Points, radii: Points, n: int, size_m: float, droop: float = 0.0
) -> Cards:
    """Twigs all over a lump: they lie on it like scales, loosely, and stick out at the rim."""
    level = 1 - 2 * (np.arange(n) + 0.5) / n
    turn = rng.uniform(0, 2 * np.pi) + _GOLDEN_RAD * np.arange(n)
    flat = np.sqrt(1 - level**2)
    out = _ring(turn, flat, level)
    middle = centre + out * radii * rng.uniform(0.5, 1.0, (n, 1))
    face = _unit(out + rng.normal((0, 0, 0.3), 0.4, (n, 3)))
    lie = 0.4 * out + rng.normal((0, 0, 0.3 - droop), 0.5, (n, 3))
    up = _unit(lie - (lie * face).sum(axis=1, keepdims=True) * face)
    size = size_m * rng.uniform(0.75, 1.2, (n, 1))
    return Cards(middle - 0.5 * size * up, size * np.cross(up, face), size * up)


def _limbs(top: Points, ends: Points, from_share: float) -> Points:
    """Wood from the trunk, at a share of its height below each end, to the ends."""
    low = np.minimum(from_share * ends[:, 2] - 0.35, top[2])
    start = np.stack([*(top[:2, None] * np.clip(low / top[2], 0, 1)), low], axis=1)
    return np.stack([start, ends], axis=1)


def _ring(
    turn_rad: Points, out_m: Points | float, z_m: Points, shift_m: Points | float = 0.0
) -> Points:
    """Points (n, 3) around an axis that is shifted sideways by (2,) or (n, 2)."""
    points = np.stack([out_m * np.cos(turn_rad), out_m * np.sin(turn_rad), z_m], axis=1)
    points[:, :2] += shift_m
    return points


def _joined(groups: list[Cards]) -> Cards:
    return Cards(*(np.concatenate([g[k] for g in groups]) for k in range(3)))


def _unit(vectors: Points) -> Points:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-9)

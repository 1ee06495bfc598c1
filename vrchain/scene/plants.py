"""Trees of several species, hedges and bushes; foliage is made of leafy lumps."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vrchain.scene import textures
from vrchain.scene.model import Surface
from vrchain.scene.shapes import Model, Part, blob, join, polygon, tube

SPECIES = ("broadleaf", "broadleaf", "poplar", "conifer", "birch", "willow")


@dataclass(frozen=True)
class TreePlan:
    """Size and species; ``foot_radius_m`` is what a robot could bump into."""

    species: str
    height_m: float
    canopy_radius_m: float
    foot_radius_m: float


def draw_tree(rng: np.random.Generator, height_m: tuple[float, float]) -> TreePlan:
    """A random tree of a height in the range."""
    species = str(rng.choice(SPECIES))
    height = float(rng.uniform(*height_m))
    slim = {"broadleaf": 0.32, "poplar": 0.16, "conifer": 0.25, "birch": 0.24, "willow": 0.36}[
        species
    ]
    radius = float(height * slim * rng.uniform(0.85, 1.15))
    foot = radius if species == "conifer" else 0.3 + 0.05 * height
    return TreePlan(species, height, radius, foot)


def _bumps(rng: np.random.Generator, strength: float) -> "_Bulge":
    return _Bulge(rng.normal(0, 2.6, (9, 3)), rng.uniform(0, 2 * np.pi, 9), strength)


@dataclass(frozen=True, eq=False)
class _Bulge:
    """Waves over a ball: an uneven outline."""

    waves: NDArray[np.float64]
    phases: NDArray[np.float64]
    strength: float

    def __call__(self, unit: NDArray[np.float64]) -> NDArray[np.float64]:
        total: NDArray[np.float64] = np.sin(unit @ self.waves.T + self.phases).sum(axis=1)
        return 1 + self.strength * total / np.sqrt(len(self.phases) / 2)


def _leaf_patch(rng: np.random.Generator, model: Model, species: str) -> int:
    hue = {"conifer": (100, 160), "willow": (62, 95), "birch": (58, 100), "poplar": (75, 115)}
    low, high = hue.get(species, (55, 125))
    colour = textures.hsv(rng.uniform(low, high), rng.uniform(0.35, 0.7), rng.uniform(0.42, 0.7))
    if (
        species == "broadleaf" and rng.random() < 0.18
    ):  # a copper beech, a maple, a cherry in flower
        colour = textures.hsv(
            rng.choice([-25, 8, 28, 325]), rng.uniform(0.35, 0.65), rng.uniform(0.5, 0.75)
        )
    return model.patch(textures.leaves(rng, (128, 192), colour, rng.uniform(4.5, 8.0)))


def build_tree(plan: TreePlan, rng: np.random.Generator) -> tuple[Surface, ...]:
    """A tree standing at the origin."""
    model = Model()
    leaf = _leaf_patch(rng, model, plan.species)
    hue, grey = rng.uniform(15, 40), rng.uniform(0.3, 0.55)
    bark_rgb = textures.hsv(hue, 0.3, grey)
    if plan.species == "birch":
        bark_rgb = textures.hsv(hue, 0.04, 0.9)
    bark = model.patch(textures.bark(rng, (72, 48), bark_rgb))
    {"conifer": _conifer, "poplar": _poplar}.get(plan.species, _broadleaf)(
        plan, rng, model, leaf, bark
    )
    return (model.surface(),)


def _trunk(
    plan: TreePlan, rng: np.random.Generator, model: Model, bark: int, top: float
) -> NDArray[np.float64]:
    """A slightly bent trunk; returns its upper end."""
    radius = 0.024 * plan.height_m + 0.03
    knee = np.array([*rng.uniform(-0.06, 0.06, 2) * top, 0.5 * top])
    end = np.array([*(1.4 * knee[:2] + rng.normal(0, 0.03 * top, 2)), top])
    flare = tube((0, 0, 0), knee * (0.3, 0.3, 0.3), 1.45 * radius, radius, 8)
    np.maximum(flare.points[:, 2], 0.0, out=flare.points[:, 2])  # its foot is tilted
    model.add(flare, bark, 0.85)
    model.add(
        join(
            [
                tube(knee * 0.3, knee, radius, 0.85 * radius),
                tube(knee, end, 0.85 * radius, 0.5 * radius),
            ]
        ),
        bark,
    )
    return end


def _lump(
    rng: np.random.Generator,
    model: Model,
    leaf: int,
    centre: NDArray[np.float64],
    radii: NDArray[np.float64],
    floor: float,
    n: int = 8,
) -> None:
    """A leafy lump, darker below, with tufts that break its outline; all above ``floor``."""
    part = blob(centre, radii, _bumps(rng, 0.12), n=n, rings=n // 2 + 2)
    part.points[:, 2] = np.maximum(part.points[:, 2], floor)
    part.uv[:, 0] *= rng.uniform(0.55, 1.0)
    tone = rng.uniform(-0.1, 0.06)
    tufts = _tufts(rng, part, centre, min(0.22 * float(radii.min()), 0.28))
    for piece, light in ((part, tone), (tufts, tone + 0.05)):
        up = (piece.points[:, 2] - centre[2]) / radii[2]
        model.add(piece, leaf, np.clip(0.8 + 0.22 * up + light, 0.4, 1.0))


def _tufts(
    rng: np.random.Generator, part: Part, centre: NDArray[np.float64], size_m: float
) -> Part:
    """Ragged triangles of leaves, one on many of a lump's faces."""
    faces = part.faces[rng.permutation(len(part.faces))[: len(part.faces) // 3]]
    foot = part.points[faces].mean(axis=1)
    out = foot - centre
    out /= np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-9)
    across = np.cross(out, rng.normal(size=out.shape))
    across *= (
        size_m
        * rng.uniform(0.5, 1.0, (len(out), 1))
        / np.linalg.norm(across, axis=1, keepdims=True)
    )
    tip = foot + size_m * (0.7 * out + rng.normal(0, 0.55, out.shape))
    foot = foot - 0.2 * size_m * out
    points = np.stack([foot - across, foot + across, tip], axis=1)
    # The side that is seen from outside is the one that its own normal points to.
    normal = np.cross(points[:, 1] - points[:, 0], points[:, 2] - points[:, 0])
    inward = np.einsum("ij,ij->i", normal, out) < 0
    points[inward] = points[inward][:, ::-1]
    low = rng.uniform(0, 0.8, (len(out), 1, 2))
    uv = low + np.array([(0.0, 0.0), (0.14, 0.0), (0.07, 0.18)])
    flat = points.reshape(-1, 3)
    flat[:, 2] = np.maximum(flat[:, 2], part.points[:, 2].min())
    return Part(flat, np.arange(len(flat)).reshape(-1, 3), uv.reshape(-1, 2))


def _broadleaf(
    plan: TreePlan, rng: np.random.Generator, model: Model, leaf: int, bark: int
) -> None:
    h, r = plan.height_m, plan.canopy_radius_m
    floor = max(1.75, 0.28 * h)
    top = _trunk(plan, rng, model, bark, 0.6 * h)
    middle, tall = (h + floor) / 2, (h - floor) / 2
    n = int(rng.integers(6, 10))
    turn = rng.uniform(0, 2 * np.pi)
    for k in range(n):
        angle = turn + 2.4 * k  # the golden angle spreads lumps evenly
        level = (k + 0.5) / n * 2 - 1
        out = 0.55 * r * np.sqrt(1 - 0.6 * level**2) * rng.uniform(0.8, 1.1)
        centre = np.array([out * np.cos(angle), out * np.sin(angle), middle + 0.55 * tall * level])
        centre[:2] += 0.5 * top[:2]
        size = rng.uniform(0.4, 0.58) * r
        drop = 1.6 if plan.species == "willow" else 0.9
        _lump(rng, model, leaf, centre, np.array([size, size, min(size * drop, 0.7 * tall)]), floor)
        model.add(tube(top * (0.8, 0.8, 0.75), centre, 0.012 * h, 0.004 * h, 3), bark, 0.7)
    crown = np.array([*top[:2], middle + 0.3 * tall])
    _lump(rng, model, leaf, crown, np.array([0.55 * r, 0.55 * r, 0.6 * tall]), floor)


def _poplar(plan: TreePlan, rng: np.random.Generator, model: Model, leaf: int, bark: int) -> None:
    h, r = plan.height_m, plan.canopy_radius_m
    _trunk(plan, rng, model, bark, 0.4 * h)
    floor = max(1.7, 0.18 * h)
    tall = (h - floor) / 2
    _lump(
        rng,
        model,
        leaf,
        np.array([0, 0, floor + tall]),
        np.array([0.85 * r, 0.85 * r, 0.97 * tall]),
        floor,
        n=11,
    )
    n = int(rng.integers(5, 8))
    for k in range(n):
        level = (k + 0.6) / n
        out, angle = 0.35 * r * (1 - 0.7 * level), 2.4 * k + rng.uniform(0, 0.6)
        centre = np.array([out * np.cos(angle), out * np.sin(angle), floor + 1.75 * tall * level])
        width = 0.75 * r * (1 - 0.55 * level)
        _lump(rng, model, leaf, centre, np.array([width, width, 0.3 * tall]), floor, n=7)


def _conifer(plan: TreePlan, rng: np.random.Generator, model: Model, leaf: int, bark: int) -> None:
    h, r = plan.height_m, plan.canopy_radius_m
    model.add(tube((0, 0, 0), (0, 0, 0.3 * h), 0.03 * h, 0.02 * h), bark, 0.8)
    n = int(rng.integers(4, 7))
    low = rng.uniform(0.45, 0.9)
    for k in range(n):
        foot = low + (h - low) * (k / n) ** 0.9
        top = min(h, foot + (h - low) / n * rng.uniform(1.6, 2.1))
        radius = r * (1 - k / n) ** 0.8
        skirt = tube(
            (*rng.normal(0, 0.03, 2), foot), (0, 0, h if k == n - 1 else top), radius, 0.04, 12
        )
        ragged = rng.uniform(0.8, 1.0, 13)
        ragged[-1] = ragged[0]
        skirt.points[:13, :2] *= ragged[:, None]
        skirt.points[:13, 2] += 0.1 * radius * rng.uniform(-1, 1)
        shade = np.where(np.arange(26) < 13, 0.72, 1.0)
        model.add(skirt, leaf, shade)
        lid = blob((0, 0, foot + 0.02), (0.93 * radius, 0.93 * radius, 0.1 * radius), n=12, rings=4)
        model.add(lid, leaf, 0.4)


def build_bush(size_m: float, rng: np.random.Generator) -> tuple[Surface, ...]:
    """A shrub of two to four lumps within ``size_m`` of width, on the ground."""
    model = Model()
    colour = textures.hsv(rng.uniform(55, 140), rng.uniform(0.35, 0.7), rng.uniform(0.4, 0.7))
    image = textures.leaves(rng, (72, 128), colour, rng.uniform(4.0, 7.0))
    if rng.random() < 0.5:  # in flower
        petal = textures.hsv(rng.uniform(-60, 60), rng.uniform(0.3, 0.8), 0.95)
        spots = textures.noise(rng, (72, 128), 3, tile=True) > 1.4
        image[spots] = petal
    leaf = model.patch(image)
    r = size_m / 2
    for k in range(int(rng.integers(2, 5))):
        angle = 2.4 * k + rng.uniform(0, 1)
        size = rng.uniform(0.45, 0.6) * r
        height = rng.uniform(0.7, 1.1) * r
        centre = np.array([0.4 * r * np.cos(angle), 0.4 * r * np.sin(angle), 0.62 * height])
        _lump(rng, model, leaf, centre, np.array([size, size, height]), 0.0)
    return (model.surface(),)


def build_hedge(length_m: float, low: bool, rng: np.random.Generator) -> tuple[Surface, ...]:
    """A clipped hedge along x, its middle at the origin; ``low``: as before a front garden."""
    model = Model()
    height_m = rng.uniform(0.65, 0.95) if low else rng.uniform(1.15, 1.6)
    half, depth = length_m / 2, 0.32
    colour = textures.hsv(rng.uniform(70, 135), rng.uniform(0.4, 0.7), rng.uniform(0.38, 0.6))
    px = 30
    shape = (max(16, round(height_m * px)), round(length_m * px))
    image = textures.leaves(rng, shape, colour, rng.uniform(3.5, 6.0))
    if rng.random() < 0.4:
        petal = textures.hsv(rng.uniform(-60, 60), rng.uniform(0.2, 0.7), 0.95)
        image[textures.noise(rng, shape, 4, tile=True) > 1.8] = petal
    foot = np.linspace(1.0, 0.55, shape[0])[:, None, None] ** 0.7
    side = model.patch(np.clip(image * foot, 0, 255).astype(np.uint8))
    end = model.patch(np.ascontiguousarray(image[:, : round(2 * depth * px)]))
    n = max(2, round(length_m / 0.8))
    x = np.linspace(-half, half, n + 1)
    wave = height_m * (1 + rng.uniform(-0.05, 0.05, n + 1))
    bulge = rng.uniform(-0.05, 0.03, n + 1)
    y = depth + bulge
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
    return (model.surface(),)

"""A suburb from its spec: the layout, every object built by its kind, then light and ground."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from vrchain import seeding
from vrchain.scene import backdrop, boundaries, ground, houses, light, plants, street, vehicles
from vrchain.scene.layout import draw_layout
from vrchain.scene.model import Scene, SceneObject, Surface, place
from vrchain.scene.site import Placement
from vrchain.scene.spec import SceneSpec, load_spec

_Builder = Callable[[Placement, np.random.Generator], tuple[Surface, ...]]
_BUILDERS: dict[str, _Builder] = {
    "house": lambda p, rng: houses.build(p.plan, rng, p.index),
    "tree": lambda p, rng: plants.build_tree(p.plan, rng),
    "vehicle": lambda p, rng: vehicles.build(p.plan, rng),
    "fence": lambda p, rng: boundaries.build_fence(p.plan[0], p.plan[1], rng),
    "wall": lambda p, rng: boundaries.build_wall(p.plan[0], p.plan[1], rng),
    "hedge": lambda p, rng: plants.build_hedge(p.plan[0], p.plan[1], rng),
    "bush": lambda p, rng: plants.build_bush(p.plan, rng),
    "lamp": lambda p, rng: street.lamp(rng),
    "pole": lambda p, rng: street.pole(rng),
    "sign": lambda p, rng: street.sign(rng),
    "mailbox": lambda p, rng: street.mailbox(rng),
    "bin": lambda p, rng: street.wheelie_bin(rng),
    "hydrant": lambda p, rng: street.hydrant(rng),
}


def load_scene(path: str | Path, *, seed: int | None = None) -> Scene:
    """The scene of a spec file, with ``seed`` in place of its own if given. Raises SpecError."""
    spec = load_spec(path)
    return build_scene(spec if seed is None else replace(spec, seed=int(seed)))


def build_scene(spec: SceneSpec) -> Scene:
    """Everything of a spec, built. The same spec gives the same bytes. Raises SpecError."""
    layout = draw_layout(spec)
    sun = light.sunlight(spec.light)
    objects = [light.lit(_built(spec.seed, p), sun) for p in layout.placements]
    shadow = light.shadows(objects, sun)
    floor = ground.build_ground(
        layout, spec.extent_m, shadow, sun, seeding.generator(spec.seed, "ground")
    )
    belt = backdrop.build_belt(spec.extent_m, sun, seeding.generator(spec.seed, "backdrop"))
    sky = backdrop.build_sky(sun, seeding.generator(spec.seed, "sky"))
    return Scene(spec.name, spec.extent_m, (*objects, *floor, belt), sky, backdrop.HAZE_RGB)


def _built(seed: int, placement: Placement) -> SceneObject:
    rng = seeding.generator(seed, placement.kind, placement.index)
    surfaces = _BUILDERS[placement.kind](placement, rng)
    return place(
        placement.name, placement.kind, placement.name, surfaces, placement.pose, landmark=True
    )

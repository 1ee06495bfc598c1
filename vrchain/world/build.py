"""A suburb from its spec: the layout, every object built by its kind, then light and ground."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from numpy.random import Generator

from vrchain import seeding
from vrchain.world import gazebo
from vrchain.world.backdrop import outdoors
from vrchain.world.buildings import barn, houses, shops
from vrchain.world.model import Scene, SceneObject, Surface, place
from vrchain.world.spec import SceneSpec, load_spec
from vrchain.world.suburb import barnyard, ground
from vrchain.world.suburb.layout import Layout, draw_layout
from vrchain.world.suburb.site import Placement
from vrchain.world.things import boundaries, furniture, plants, vehicles

_Builder = Callable[[Placement, Generator, str], tuple[Surface, ...]]
_BUILDERS: dict[str, _Builder] = {
    "house": lambda p, rng, season: houses.build(p.plan, rng, p.index),
    "shop": lambda p, rng, season: shops.build(p.plan, rng),
    "barn": lambda p, rng, season: barn.build(p.plan, rng),
    "vehicle": lambda p, rng, season: vehicles.build(p.plan, rng),
    "fence": lambda p, rng, season: boundaries.build_fence(p.plan[0], p.plan[1], rng),
    "wall": lambda p, rng, season: boundaries.build_wall(p.plan[0], p.plan[1], rng),
    "lamp": lambda p, rng, season: furniture.lamp(rng),
    "pole": lambda p, rng, season: furniture.pole(rng),
    "sign": lambda p, rng, season: furniture.sign(rng),
    "mailbox": lambda p, rng, season: furniture.mailbox(rng),
    "bin": lambda p, rng, season: furniture.wheelie_bin(rng),
    "hydrant": lambda p, rng, season: furniture.hydrant(rng),
    "tree": lambda p, rng, season: plants.build_tree(p.plan, rng, season),
    "hedge": lambda p, rng, season: plants.build_hedge(p.plan[0], p.plan[1], rng, season),
    "bush": lambda p, rng, season: plants.build_bush(p.plan, rng, season),
}


def load_scene(path: str | Path, *, seed: int | None = None, strict: bool = False) -> Scene:
    """The scene of a spec file, with ``seed`` in place of its own if given. Raises SpecError.

    A Gazebo world (``.world``, ``.sdf``) stays as it is, whatever the seed; strict: it is refused
    if a file of it is missing.
    """
    if Path(path).suffix.lower() in gazebo.SUFFIXES:
        return gazebo.load_world(path, strict=strict)
    spec = load_spec(path)
    return build_scene(spec if seed is None else replace(spec, seed=seeding.whole(seed)))


def build_scene(spec: SceneSpec) -> Scene:
    """Everything of a spec, built. The same spec gives the same bytes. Raises SpecError."""
    if spec.layout == "barn":
        return barnyard.build(spec)
    layout = draw_layout(spec)
    standing = (
        place(p.name, p.kind, p.model, surfaces, p.pose, landmark=True)
        for p, surfaces in designs(spec, layout)
    )
    return outdoors(spec, standing, floor(spec, layout))


def floor(spec: SceneSpec, layout: Layout | None = None) -> Iterable[SceneObject]:
    """Streets, pavements, lawns: what lies flat on the ground of a spec."""
    draws = seeding.generator(spec.seed, "ground")
    return ground.build_ground(layout or draw_layout(spec), spec.extent_m, spec.season, draws)


def designs(
    spec: SceneSpec, layout: Layout | None = None
) -> Iterator[tuple[Placement, tuple[Surface, ...]]]:
    """What stands, and its surfaces in its own frame; twins share those of the first of them."""
    models: dict[str, tuple[Surface, ...]] = {}
    for p in (layout or draw_layout(spec)).placements:
        if p.model not in models:
            rng = seeding.generator(spec.seed, p.kind, p.index)
            models[p.model] = _BUILDERS[p.kind](p, rng, spec.season)
        yield p, models[p.model]

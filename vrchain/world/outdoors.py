"""What every world of ours ends with: baked light, the wood around it, and the sky."""

from collections.abc import Iterable

from vrchain import seeding
from vrchain.world import backdrop, light
from vrchain.world.model import Scene, SceneObject
from vrchain.world.spec import SceneSpec


def outdoors(
    spec: SceneSpec, standing: Iterable[SceneObject], floor: Iterable[SceneObject]
) -> Scene:
    """Things that stand on a floor, in the spec's light, season and extent."""
    sun = light.sunlight(spec.light)
    objects, ground_light = light.bake(standing, sun, spec.extent_m)
    wood = seeding.generator(spec.seed, "backdrop")
    belt = backdrop.build_belt(spec.extent_m, sun, spec.season, wood)
    return Scene(
        spec.name,
        spec.extent_m,
        (*objects, *floor, belt),
        backdrop.build_sky(sun, seeding.generator(spec.seed, "sky")),
        backdrop.haze_rgb(sun),
        spec.light,
        ground_light,
    )

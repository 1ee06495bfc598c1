"""A few houses and walls, close together, so that a goal can hide: a small place for missions."""

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import numpy as np
import worlds
from numpy.typing import NDArray

from vrchain.geometry import rotation_z
from vrchain.seeding import generator
from vrchain.world.model import Scene, SceneObject
from vrchain.world.truth import GroundTruth

GOAL = "house 4"


def _texture(name: str) -> NDArray[np.uint8]:
    coarse, fine = worlds.blotches(name, 256, 16), worlds.blotches(name + " fine", 256, 64)
    return (coarse // 2 + fine // 2).astype(np.uint8)


@cache
def hamlet() -> Scene:
    """48 x 48 m, every house with walls of its own."""
    made: list[SceneObject] = []
    for k in range(12):
        draws = generator(0, "hamlet", k)
        x_m, y_m = -15 + 10 * (k % 4), -12 + 12 * (k // 4)
        centre = (x_m + float(draws.uniform(-1.5, 1.5)), y_m + float(draws.uniform(-1.5, 1.5)))
        size = (draws.uniform(2.5, 4.5), draws.uniform(2.5, 4.5), draws.uniform(2.5, 4.0))
        name, yaw = f"house {k}", float(draws.uniform(-0.3, 0.3))
        house = worlds.box(name, centre, size, _texture(name), yaw_rad=yaw)
        made.append(replace(house, kind="house"))
    for k, (x_m, y_m) in enumerate([(-5, -6), (5, -6), (-5, 6), (5, 6), (15, 6), (-15, -6)]):
        name = f"wall {k}"
        wall = worlds.box(name, (x_m, y_m), (0.3, 3.5, 1.6), _texture(name), yaw_rad=0.2 * k)
        made.append(wall)
    return worlds.world(*made, extent_m=(48.0, 48.0))


def the_hamlet(seed: int, k: int) -> Scene:
    """As one of many scenes, for processes of their own."""
    return hamlet()


@cache
def hamlet_truth() -> GroundTruth:
    return GroundTruth(hamlet())


def on_grid(scene: Scene, size_m: float) -> Scene:
    """The same on a larger map, rounded to 1/1024 m: then a right angle's turn loses no bit."""

    def rounded(thing: SceneObject) -> SceneObject:
        return _with_vertices(thing, thing.name, lambda v: np.round(v.astype(float) * 1024) / 1024)

    return Scene("grid", (size_m, size_m), tuple(rounded(o) for o in scene.objects))


def moved(scene: Scene, angle_rad: float, offset_xy_m: tuple[float, float]) -> Scene:
    """The same world turned and shifted, with every object's name changed."""
    turn, offset = rotation_z(angle_rad), np.array([*offset_xy_m, 0.0])

    def there(thing: SceneObject) -> SceneObject:
        name = "x" + thing.name[::-1]
        return _with_vertices(thing, name, lambda v: v.astype(float) @ turn.T + offset)

    return Scene("moved", scene.extent_m, tuple(there(o) for o in scene.objects))


def _with_vertices(
    thing: SceneObject, name: str, change: Callable[[NDArray[np.float32]], NDArray[np.float64]]
) -> SceneObject:
    surfaces = tuple(
        replace(s, vertices_m=change(s.vertices_m).astype(np.float32)) for s in thing.surfaces
    )
    return SceneObject(
        name, thing.kind, thing.model, thing.landmark, thing.solid, thing.size_m, surfaces
    )

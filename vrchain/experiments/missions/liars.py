"""Robots that publish what is not so: broken, or dishonest. Each lies always, in one way.

What they sense themselves is true, so they drive about as others do.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import shapely

from vrchain.errors import MissionError
from vrchain.geometry import Pose, placed, relative
from vrchain.panorama import Panorama
from vrchain.publisher import Told
from vrchain.robot import Observation
from vrchain.seeding import generator
from vrchain.simulation.simulator import Simulator
from vrchain.world.model import SceneObject

_CLEARANCE_M = 1.0


def lie(kind: str, simulator: Simulator, robot: str, seed: int) -> Told:
    """What such a robot makes of an observation before it publishes it; MissionError: no such lie.

    odometry: it moved another way than it did, as far. elsewhere: panoramas of any other place.
    old: its first panorama, again and again. photograph: all around one picture, as before a
    photograph. twins: what is seen from the same side of a twin of what stands nearest, of all that
    have one; the truth where none fits. nothing: it publishes nothing.
    """
    if kind not in LIES:
        raise MissionError(f"expected a lie of {', '.join(LIES)}, got {kind}")
    return LIES[kind](simulator, robot, generator(seed, "lie", robot))


def _odometry(simulator: Simulator, robot: str, draws: np.random.Generator) -> Told:
    true: Pose | None = None
    told = Pose(0.0, 0.0)

    def tell(seen: Observation) -> Observation:
        nonlocal true, told
        moved = relative(true or seen.odometry, seen.odometry)
        another_way = Pose(0.0, 0.0, float(draws.uniform(-np.pi, np.pi)))
        told = placed(told, placed(another_way, moved))
        true = seen.odometry
        return replace(seen, odometry=told)

    return tell


def _elsewhere(simulator: Simulator, robot: str, draws: np.random.Generator) -> Told:
    half_m = np.array(simulator.scene.extent_m) / 2

    def tell(seen: Observation) -> Observation:
        assert seen.panorama is not None
        while True:
            place = draws.uniform(-half_m, half_m)
            if simulator.scene.is_free([place], _CLEARANCE_M)[0]:
                break
        pose = Pose(float(place[0]), float(place[1]), float(draws.uniform(-np.pi, np.pi)))
        shown = simulator.renderer.render(pose, seen.panorama.rig)
        return replace(seen, panorama=shown)

    return tell


def _old(simulator: Simulator, robot: str, draws: np.random.Generator) -> Told:
    first: Panorama | None = None

    def tell(seen: Observation) -> Observation:
        nonlocal first
        first = first or seen.panorama
        return replace(seen, panorama=first)

    return tell


def _photograph(simulator: Simulator, robot: str, draws: np.random.Generator) -> Told:
    def tell(seen: Observation) -> Observation:
        assert seen.panorama is not None
        views = np.repeat(seen.panorama.views[:1], seen.panorama.rig.n_views, axis=0)
        return replace(seen, panorama=Panorama(seen.panorama.rig, views))

    return tell


def _twins(simulator: Simulator, robot: str, draws: np.random.Generator) -> Told:
    scene = simulator.scene
    makes = Counter(thing.model for thing in scene.objects)
    doubles = [thing for thing in scene.objects if makes[thing.model] > 1]

    def tell(seen: Observation) -> Observation:
        assert seen.panorama is not None
        pose = simulator.pose(robot)
        here = shapely.Point(*pose.xy_m)
        for thing in sorted(doubles, key=lambda thing: thing.footprint.distance(here)):
            twins = [other for other in doubles if other.model == thing.model and other is not thing]
            for k in draws.permutation(len(twins)):
                there = placed(_frame(twins[k], thing), pose)
                if scene.is_free([there.xy_m], _CLEARANCE_M)[0]:
                    shown = simulator.renderer.render(there, seen.panorama.rig)
                    return replace(seen, panorama=shown)
        return seen

    return tell


def _frame(thing: SceneObject, twin: SceneObject) -> Pose:
    """How the ground is to be turned and moved to bring a thing's twin to it (Kabsch, 1976)."""
    to, of = (
        np.concatenate([surface.vertices_m[:, :2] for surface in one.surfaces])
        for one in (thing, twin)
    )
    (a, b), (c, d) = (of - of.mean(axis=0)).T @ (to - to.mean(axis=0))
    turned = Pose(0.0, 0.0, float(np.arctan2(b - c, a + d)))
    moved_m = to.mean(axis=0) - placed(turned, Pose(*of.mean(axis=0))).xy_m
    return replace(turned, x_m=float(moved_m[0]), y_m=float(moved_m[1]))


def _nothing(simulator: Simulator, robot: str, draws: np.random.Generator) -> Told:
    return lambda seen: None


LIES: dict[str, Callable[[Simulator, str, np.random.Generator], Told]] = {
    "odometry": _odometry,
    "elsewhere": _elsewhere,
    "old": _old,
    "photograph": _photograph,
    "twins": _twins,
    "nothing": _nothing,
}

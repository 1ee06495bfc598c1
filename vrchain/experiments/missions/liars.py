"""Robots that publish what is not so: broken, or dishonest. Each lies always, in one way.

What they sense themselves is true, so they drive about as others do.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from operator import itemgetter

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.spatial import KDTree

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

    odometry: it moved another way than it did, as far. still: it has not moved, as with broken
    encoders. elsewhere: panoramas of any other place.
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


def _still(simulator: Simulator, robot: str, draws: np.random.Generator) -> Told:
    return lambda seen: replace(seen, odometry=Pose(0.0, 0.0))


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
            twins = [
                other for other in doubles if other.model == thing.model and other is not thing
            ]
            for k in draws.permutation(len(twins)):
                there = placed(_frame(twins[k], thing), pose)
                if scene.is_free([there.xy_m], _CLEARANCE_M)[0]:
                    shown = simulator.renderer.render(there, seen.panorama.rig)
                    return replace(seen, panorama=shown)
        return seen

    return tell


def _frame(thing: SceneObject, twin: SceneObject) -> Pose:
    """How the ground is to be turned and moved to bring a thing's twin to it.

    By their footprints, in that of four directions in which the twins' corners meet best: which
    corners they have hangs on the light that is baked into them.
    """
    axis_rad, middle_m = zip(*(_lies(one) for one in (thing, twin)), strict=True)
    to, of = (np.concatenate([s.vertices_m for s in one.surfaces]) for one in (thing, twin))
    corners, found = KDTree(to), list[tuple[float, Pose]]()
    for quarter_rad in np.arange(4) * np.pi / 2:
        turned = Pose(0.0, 0.0, float(axis_rad[0] - axis_rad[1] + quarter_rad))
        x_m, y_m = middle_m[0] - placed(turned, Pose(*middle_m[1])).xy_m
        c, s = np.cos(turned.yaw_rad), np.sin(turned.yaw_rad)
        moved_m = of @ [[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]] + [x_m, y_m, 0.0]
        off_m = float(corners.query(moved_m)[0].mean())
        found.append((off_m, replace(turned, x_m=float(x_m), y_m=float(y_m))))
    return min(found, key=itemgetter(0))[1]


def _lies(thing: SceneObject) -> tuple[float, NDArray[np.float64]]:
    """The direction of a side of its footprint, and the middle."""
    around = thing.footprint.minimum_rotated_rectangle
    (x_m, y_m), (to_x_m, to_y_m), *_ = around.exterior.coords
    middle = around.centroid
    return float(np.arctan2(to_y_m - y_m, to_x_m - x_m)), np.array([middle.x, middle.y])


def _nothing(simulator: Simulator, robot: str, draws: np.random.Generator) -> Told:
    return lambda seen: None


LIES: dict[str, Callable[[Simulator, str, np.random.Generator], Told]] = {
    "odometry": _odometry,
    "still": _still,
    "elsewhere": _elsewhere,
    "old": _old,
    "photograph": _photograph,
    "twins": _twins,
    "nothing": _nothing,
}
FORGED = "elsewhere", "old", "photograph", "twins"  # panoramas of where the robot is not

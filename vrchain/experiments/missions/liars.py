"""Robots that publish what is not so: broken, or dishonest. Each lies always, in one way.

What they sense themselves is true, so they drive about as others do.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from vrchain.errors import MissionError
from vrchain.geometry import Pose, placed, relative
from vrchain.panorama import Panorama
from vrchain.publisher import Told
from vrchain.robot import Observation
from vrchain.seeding import generator
from vrchain.simulation.simulator import Simulator

_CLEARANCE_M = 1.0


def lie(kind: str, simulator: Simulator, robot: str, seed: int) -> Told:
    """What such a robot makes of an observation before it publishes it; MissionError: no such lie.

    odometry: it moved another way than it did, as far. elsewhere: panoramas of any other place.
    old: its first panorama, again and again. photograph: all around one picture, as before a
    photograph. nothing: it publishes nothing.
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


def _nothing(simulator: Simulator, robot: str, draws: np.random.Generator) -> Told:
    return lambda seen: None


LIES: dict[str, Callable[[Simulator, str, np.random.Generator], Told]] = {
    "odometry": _odometry,
    "elsewhere": _elsewhere,
    "old": _old,
    "photograph": _photograph,
    "nothing": _nothing,
}

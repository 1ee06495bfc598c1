"""Visual homing: from the current snapshot and a stored one, which way to drive, and whether there.

Pure functions of what two panoramas show; no map, no coordinates. ``METHODS`` holds ours,
``epipolar``, and three known ones to compare with.
"""

from collections.abc import Callable, Mapping

from vrchain.errors import MissionError
from vrchain.homing.epipolar import Epipolar
from vrchain.homing.landmark_vector import landmark_vector
from vrchain.homing.scale import scale_space
from vrchain.homing.views import HomeVector, Snapshot, Views, snapshot
from vrchain.homing.warping import Warping
from vrchain.landmarks.extraction.sift import Features

__all__ = [
    "METHODS",
    "HomeVector",
    "Method",
    "Snapshot",
    "Views",
    "home_vector",
    "snapshot",
    "step",
]

Method = Callable[[Views, float | None], HomeVector | None]
"""A homing step: the two views, and home's heading against the robot's by a compass, or None."""

METHODS: Mapping[str, Method] = {
    "epipolar": Epipolar(),
    "scale": scale_space,
    "average landmark vector": landmark_vector,
    "warping": Warping(),
}


def step(
    method: str, current: Snapshot, home: Snapshot, heading_rad: float | None = None
) -> HomeVector | None:
    """One homing step by a named method; None when the two views share too little.

    heading_rad: home's heading against the robot's, anticlockwise, if a compass tells.
    MissionError: there is no such method. ImageError: the panoramas were taken from two heights.
    """
    if method not in METHODS:
        raise MissionError(f"expected a homing method of {', '.join(METHODS)}, got {method!r}")
    return METHODS[method](Views(current, home), heading_rad)


def home_vector(
    current: Features, home: Features, arrived_m: float = 1.0, camera_height_m: float = 1.0
) -> HomeVector | None:
    """One sure step by ``epipolar`` from keypoints alone, both cameras so high above the ground.

    arrived_m: wider than its own, for a robot that looks once a metre, at a place where another
    robot may stand.
    """
    here, there = (Snapshot(f, camera_height_m=camera_height_m) for f in (current, home))
    return Epipolar(arrived_m, only_sure=True)(Views(here, there), None)

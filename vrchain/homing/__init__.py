"""Visual homing: from the current snapshot and a stored one, which way to drive, and whether there.

Pure functions of what two panoramas show; no map, no coordinates. ``METHODS`` holds ours,
``epipolar``, and three known ones to compare with.
"""

from collections.abc import Callable, Mapping
from math import isfinite

from vrchain.errors import MissionError
from vrchain.homing.epipolar import Epipolar
from vrchain.homing.landmark_vector import landmark_vector
from vrchain.homing.scale import scale_space
from vrchain.homing.views import HomeVector, Snapshot, Views, snapshot
from vrchain.homing.warping import Warping
from vrchain.landmarks.extraction.sift import Features
from vrchain.plugins import plugged_in

__all__ = [
    "METHODS",
    "HomeVector",
    "Method",
    "Snapshot",
    "Views",
    "home_vector",
    "maker_of",
    "method_named",
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


def method_named(name: str) -> Method:
    """A homing method by its name, or MODULE:NAME of one's own. MissionError: there is none."""
    if name in METHODS:
        return METHODS[name]
    found, _ = _own(name)

    def checked(views: Views, heading_rad: float | None) -> HomeVector | None:
        vector = found(views, heading_rad)
        if vector is None or (isinstance(vector, HomeVector) and isfinite(vector.bearing_rad)):
            return vector
        raise MissionError(
            f"the homing method {name!r} gave {vector!r:.80}: expected a HomeVector, whose bearing "
            "is a number, or None"
        )

    return checked


def maker_of(name: str) -> str:
    """What tells a method's answers from those of another, or of one's own before an edit.

    MissionError: there is no such method.
    """
    method = METHODS.get(name)
    # a function's own text is another in each process
    return _own(name)[1] if method is None else getattr(method, "__qualname__", repr(method))


def _own(name: str) -> tuple[Method, str]:
    return plugged_in(name, "homing method", ", ".join(METHODS), callable)


def step(
    method: str, current: Snapshot, home: Snapshot, heading_rad: float | None = None
) -> HomeVector | None:
    """One homing step by a method; None when the two views share too little.

    method: as ``method_named`` takes it. heading_rad: home's heading against the robot's,
    anticlockwise, if a compass tells. MissionError: there is no such method. ImageError: the
    panoramas were taken from two heights.
    """
    return method_named(method)(Views(current, home), heading_rad)


def home_vector(
    current: Features, home: Features, arrived_m: float = 1.0, camera_height_m: float = 1.0
) -> HomeVector | None:
    """One sure step by ``epipolar`` from keypoints alone, both cameras so high above the ground.

    arrived_m: wider than its own, for a robot that looks once a metre, at a place where another
    robot may stand.
    """
    here, there = (Snapshot(f, camera_height_m=camera_height_m) for f in (current, home))
    return Epipolar(arrived_m, only_sure=True)(Views(here, there), None)

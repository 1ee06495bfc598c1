"""What a homing step is given, two snapshots, and what it answers, a home vector."""

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from vrchain.errors import ImageError
from vrchain.geometry import circular_mean_rad, wrap_angle_rad
from vrchain.landmarks.extraction.sift import Features, extract, mutual_matches
from vrchain.panorama import Panorama

HORIZON_COLUMNS = 180
_BELT_SLOPE = 0.1  # rows so near the horizon are taken together
_LEAST_MATCHES = 3
_MEDIAN_STEPS = 5


@dataclass(frozen=True)
class HomeVector:
    """bearing_rad: where home lies, from the robot's heading. std_rad: how sure that is.

    n_matches: keypoints, or columns of the horizon, that it rests on. arrived: home is where the
    robot stands. remoteness: what that was judged by, in metres by ``epipolar``, by each other
    method in a measure of its own.
    """

    bearing_rad: float
    std_rad: float
    n_matches: int
    arrived: bool
    remoteness: float


def at_home(n_matches: int, remoteness: float) -> HomeVector:
    """Arrived, where no direction follows."""
    return HomeVector(0.0, np.pi, n_matches, True, remoteness)


@dataclass(frozen=True, eq=False)
class Snapshot:
    """What homing keeps of a panorama.

    features: all its keypoints. horizon: (180,) float, grey values around the horizon, from bearing
    -pi on; None if the views close no ring. camera_height_m: above the ground.
    """

    features: Features
    horizon: NDArray[np.float64] | None = None
    camera_height_m: float = 1.0


def snapshot(panorama: Panorama) -> Snapshot:
    """The snapshot of a panorama."""
    ring = _horizon(panorama) if panorama.rig.closed else None
    return Snapshot(extract(panorama), ring, panorama.rig.camera_height_m)


def _horizon(panorama: Panorama) -> NDArray[np.float64] | None:
    """Grey values around; their mean where nothing is seen, None where that is so all around."""
    slopes = panorama.rig.slope_of_row(np.arange(len(panorama.cylinder)))
    belt = np.abs(slopes) <= _BELT_SLOPE
    grey = panorama.cylinder[belt].mean(axis=2)
    seen = np.ones(grey.shape)
    if panorama.seen_cylinder is not None:
        seen = panorama.seen_cylinder[belt].astype(float)
    columns = np.stack([(grey * seen).mean(axis=0), seen.mean(axis=0)])[:, ::-1]  # from -pi on
    total, share = cv2.resize(columns, (HORIZON_COLUMNS, 2), interpolation=cv2.INTER_AREA)
    known = share > 0
    if not known.any():
        return None
    ring = np.full(HORIZON_COLUMNS, total.sum() / share.sum())
    ring[known] = total[known] / share[known]
    return ring


@dataclass(frozen=True, eq=False)
class Views:
    """The snapshot from where the robot stands, and the one from home.

    ImageError if they were taken from different heights: no method here would be right.
    """

    current: Snapshot
    home: Snapshot

    def __post_init__(self) -> None:
        heights = self.current.camera_height_m, self.home.camera_height_m
        if heights[0] != heights[1]:
            raise ImageError(
                f"homing: expected panoramas from one height, got {heights[0]:g} and "
                f"{heights[1]:g} m above the ground: take both with the same rig"
            )

    @cached_property
    def matched(self) -> tuple[Features, Features]:
        """Matched keypoints, (m,) in the current view and (m,) in home's."""
        now, then = self.current.features, self.home.features
        i, j = mutual_matches(now.descriptors, then.descriptors)
        return now.take(i), then.take(j)

    @cached_property
    def heading_rad(self) -> float | None:
        """Home's heading against the robot's: the median change of bearing; None if unclear."""
        now, then = self.matched
        if len(now) < _LEAST_MATCHES:
            return None
        return _median_rad(wrap_angle_rad(now.bearing_rad - then.bearing_rad))

    def swing_rad(self, heading_rad: float) -> NDArray[np.float64]:
        """By how much matched bearings, (m,), changed, the turn between the headings aside."""
        now, then = self.matched
        return wrap_angle_rad(now.bearing_rad - then.bearing_rad - heading_rad)


def _median_rad(angles: NDArray[np.float64]) -> float:
    """The middle of some angles, most of which lie on one side of the circle."""
    middle = circular_mean_rad(angles)
    for _ in range(_MEDIAN_STEPS):
        middle += float(np.median(wrap_angle_rad(angles - middle)))
    return float(wrap_angle_rad(middle))

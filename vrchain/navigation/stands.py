"""Where other panoramas were taken, in the frame of the robot's odometry.

It is no chance if looks from different places, told by odometry, agree on that.
"""

import numpy as np

from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.landmarks.common import Comparison
from vrchain.navigation.places import beyond
from vrchain.panorama import CameraRig

AGREED = 0.95  # chance of a relative pose that looks from two places agree on
_APART_M = 5.0  # between such places
_OFF, _OFF_M, _OFF_RAD = 0.25, 3.0, 0.25  # agreement: share of the way there, metres, heading


class Stands:
    """Where the panoramas were taken by each look so far."""

    def __init__(self) -> None:
        self._told: dict[bytes, dict[Pose, Pose]] = {}  # by where the look was taken

    def agree(self, here: Pose, digest: bytes, found: Comparison, rig: CameraRig) -> bool:
        """Take in what a look from ``here`` tells; whether one from elsewhere told the same."""
        stand = stand_of(here, found, rig)
        if stand is None:
            return False
        told = self._told.setdefault(digest, {})
        told[here] = stand
        away_m = here.distance_to_m(stand.xy_m)
        return any(
            here.distance_to_m(then.xy_m) >= _APART_M
            and stand.distance_to_m(other.xy_m)
            <= _OFF * max(away_m, then.distance_to_m(other.xy_m)) + _OFF_M
            and abs(float(wrap_angle_rad(stand.yaw_rad - other.yaw_rad))) <= _OFF_RAD
            for then, other in told.items()
        )


def baseline_m(found: Comparison, rig: CameraRig) -> float | None:
    """How far apart two panoramas were taken, None if nothing tells."""
    if found.geometry is None or not np.isfinite(found.geometry.baseline_heights):
        return None
    return float(found.geometry.baseline_heights * rig.camera_height_m)


def stand_of(here: Pose, found: Comparison, rig: CameraRig, back: bool = False) -> Pose | None:
    """Where the other panorama was taken, if the one was at ``here``; None: nothing tells.

    back: from the comparison's second panorama to its first.
    """
    geometry, way_m = found.geometry, baseline_m(found, rig)
    if geometry is None or way_m is None:
        return None
    if back:
        return beyond(here, geometry.back_rad, way_m, -geometry.heading_rad)
    return beyond(here, geometry.direction_rad, way_m, geometry.heading_rad)

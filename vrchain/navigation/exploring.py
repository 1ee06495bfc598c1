"""Going and looking where nobody has looked yet, as far as the robot knows."""

from collections.abc import Sequence

import numpy as np

from vrchain.geometry import wrap_angle_rad
from vrchain.navigation.driving import Array, Pilot
from vrchain.navigation.terms import GaveUp, Log

_TURNS = 16  # directions in which it may go and look elsewhere
_WITHIN_M = 60.0
_TURN_M = 4.0  # of way, that a radian of turn counts for


class Explorer:
    """Drives on, a look at a time, towards the nearest place around which it has not looked."""

    def __init__(self, pilot: Pilot, log: Log) -> None:
        self.pilot, self.log = pilot, log
        self._unreachable: list[Array] = []
        self._target: Array | None = None

    def drive_on(self, others_xy_m: Sequence[Array] = ()) -> None:
        """Drive some way towards such a place; GaveUp if there is none.

        others_xy_m: where others have looked, which is left out while anything else is left.
        """
        pilot = self.pilot
        target = self._unseen(others_xy_m)
        if target is None and len(others_xy_m):
            target = self._unseen(())
        if target is None:
            raise GaveUp("there is nowhere left to look from where I can get")
        if self._target is None or np.hypot(*(target - self._target)) > 1e-6:
            self.log("explore", "going where nobody has looked yet", len(pilot.looks) - 1)
        self._target = target
        way_m = 0.0
        while way_m < pilot.config.look_every_m:
            if pilot.here.distance_to_m(target) < 3.0:
                return
            driven_m = pilot.stretch(target, 2.0, 1.0)
            if driven_m is None:
                self._unreachable.append(target)
                return
            way_m += driven_m

    def _unseen(self, others_xy_m: Sequence[Array]) -> Array | None:
        """The nearest place far from all looked-at ones; as before, if that is near."""
        pilot, apart_m = self.pilot, self.pilot.config.explore_m
        known = np.array([*pilot.looked, *self._unreachable, *others_xy_m])
        angle = np.arange(_TURNS) * 2 * np.pi / _TURNS
        rim = (apart_m + 1.0) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        places = (known[:, None] + rim).reshape(-1, 2)
        places = places if self._target is None else np.vstack([self._target, places])
        new = np.hypot(*(places[:, None] - known).transpose(2, 0, 1)).min(axis=1) >= apart_m
        own = self._target is not None and bool(new[0])
        near = np.hypot(*(places - pilot.here.xy_m).T) < _WITHIN_M
        places = places[new & near]
        if len(places) == 0:
            return None
        length_m = pilot.ways.lengths_m(pilot.here, places)
        turn = np.arctan2(*(places - pilot.here.xy_m).T[::-1]) - pilot.here.yaw_rad
        value = length_m + _TURN_M * np.abs(wrap_angle_rad(turn))
        if own and near[0]:
            value[0] *= 0.6  # no dithering
        best = int(value.argmin())
        return np.asarray(places[best]) if np.isfinite(value[best]) else None

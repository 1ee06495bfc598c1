"""Going and looking where nobody has looked yet, as far as the robot knows.

Of such places it takes one that is near and around which much stands that it saw from afar only:
along a suburb's edge there is little to find. Where none is as far from all others as in a suburb,
as in rooms, half, a quarter or an eighth of that will do. Where none is left at all, it looks
everywhere anew: it may have passed by what it seeks, and others may know more by now.
"""

from collections.abc import Sequence
from itertools import product

import numpy as np
from scipy.spatial.distance import cdist

from vrchain.geometry import wrap_angle_rad
from vrchain.navigation.driving.drive import Pilot
from vrchain.navigation.driving.estimates import Array
from vrchain.navigation.settings import GaveUp, Log

_TURNS = 16  # directions in which it may go and look elsewhere
_WITHIN_M = 60.0
_TURN_M = 4.0  # of way, that a radian of turn counts for
_SEEN_M, _SHOWS_M = 15.0, 20.0  # what was seen from so near is known; a place shows so much around
_CELL_M = 5.0  # what is seen to stand in one such cell is one thing
_SHARES = (1.0, 0.5, 0.25, 0.125)  # of all that is far, one after the other
_WORTH = 6.0  # so many things to see are worth as long a way again


class Explorer:
    """Drives on, a look at a time, towards a place around which it has not looked."""

    def __init__(self, pilot: Pilot, log: Log) -> None:
        self.pilot, self.log = pilot, log
        self._unreachable: list[Array] = []
        self._target: Array | None = None
        self._forgotten = 0  # looks, the first ones

    def drive_on(self, others_xy_m: Sequence[Array] = ()) -> None:
        """Drive some way towards such a place; GaveUp if there is none.

        others_xy_m: where others have looked, which is left out while anything else is left.
        """
        pilot = self.pilot
        share, target = self._unseen_anywhere(others_xy_m)
        if self._target is None or np.hypot(*(target - self._target)) > 1e-6:
            self.log("explore", "going where nobody has looked yet", len(pilot.looks) - 1)
        self._target = target
        way_m = 0.0
        while way_m < share * pilot.config.search_every_m:
            if pilot.here.distance_to_m(target) < share * 3.0:
                return
            driven_m = pilot.stretch(target, share * 2.0, 1.0)
            if driven_m is None:
                self._unreachable.append(target)
                return
            way_m += driven_m

    def _unseen_anywhere(self, others_xy_m: Sequence[Array]) -> tuple[float, Array]:
        """The best such place, and the share of what is far there; GaveUp if there is none."""
        for _ in range(2):
            for share, others in product(_SHARES, (others_xy_m, ())):
                target = self._unseen(share, others)
                if target is not None:
                    return share, target
            self._forgotten = len(self.pilot.looked) - 1
        raise GaveUp("there is nowhere left to look from where I can get")

    def _unseen(self, share: float, others_xy_m: Sequence[Array]) -> Array | None:
        """The best place far from all looked-at ones; as before, if that is near."""
        pilot, apart_m = self.pilot, share * self.pilot.config.explore_m
        looked = pilot.looked[self._forgotten :]
        known = np.array([*looked, *self._unreachable, *others_xy_m])
        angle = np.arange(_TURNS) * 2 * np.pi / _TURNS
        rim = (apart_m + 1.0) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        places = (known[:, None] + rim).reshape(-1, 2)
        places = places if self._target is None else np.vstack([self._target, places])
        new = cdist(places, known).min(axis=1) >= apart_m
        own = self._target is not None and bool(new[0])
        near = np.hypot(*(places - pilot.here.xy_m).T) < share * _WITHIN_M
        places = places[new & near]
        if len(places) == 0:
            return None
        turn = np.arctan2(*(places - pilot.here.xy_m).T[::-1]) - pilot.here.yaw_rad
        value = pilot.obstacles.lengths_m(pilot.here, places)
        value += _TURN_M * np.abs(wrap_angle_rad(turn))
        value /= 1 + self._to_see(places, share) / _WORTH
        if own and near[0]:
            value[0] *= 0.6  # no dithering
        best = int(value.argmin())
        return np.asarray(places[best]) if np.isfinite(value[best]) else None

    def _to_see(self, places: Array, share: float) -> Array:
        """How much stands around each that was seen from afar only: (n,)."""
        things, looked = np.concatenate(self.pilot.standing), np.array(self.pilot.looked)
        afar = cdist(things, looked).min(axis=1) > share * _SEEN_M
        cell_m = share * _CELL_M
        cells = cell_m * np.unique(np.round(things[afar] / cell_m), axis=0)
        return np.asarray((cdist(places, cells) < share * _SHOWS_M).sum(axis=1))

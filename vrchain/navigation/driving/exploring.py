"""Going and looking where nobody has looked yet, as far as the robot knows.

First at what may be the goal and was seen from afar only, by the robot or by others: the way there
is to be short for the chance that it is the goal, by what shows from afar. And at another side of
what looks like the goal and was seen from near in vain: its pictures may show that. Then where
nobody has been. Where no such place is as far from all others as in a suburb, as in rooms, half, a
quarter or an eighth of that will do. Where none is left at all, it looks everywhere anew: it may
have passed by what it seeks, and others may know more by now.
"""

from collections.abc import Callable, Sequence
from functools import cache
from itertools import product

import numpy as np
from scipy.spatial.distance import cdist

from vrchain.geometry import Pose, rotation_z, wrap_angle_rad
from vrchain.navigation.driving.drive import Pilot
from vrchain.navigation.driving.estimates import Array
from vrchain.navigation.perception import Look
from vrchain.navigation.settings import GaveUp, Log

Looked = tuple[Pose, Look]  # from where, by the robot's odometry, and what it shows

_TURNS = 16  # directions in which it may go and look elsewhere
_WITHIN_M = 60.0
_TURN_M = 4.0  # of way, that a radian of turn counts for
_PROPOSED, _FARTHEST_M = 0.5, 60.0  # score and range of what is taken to stand somewhere
_SEEN_M, _ONE_M = 18.0, 7.0  # what was seen from so near is known; sights so near are of one thing
_ASIDE_M, _SIDES = 10.0, 8  # from what it goes to see, and from how many sides it may
# Of goals 0.78 are known from the first side, and 0.98 with three more (seed 1380): another side is
# worth so much less than the first one, and nothing for what would be the goal by less than this.
_OTHER_SIDE, _SIDE_RAD, _LEAST = 0.15, 1.1, 0.02
_THERE_M = 3.0  # from where it goes
_MOVED_M = 1.0  # since it has looked everywhere, or it is shut in
_LOOK_M = 30.0  # a look counts for so much way: it may show several things
_SHARES = (1.0, 0.5, 0.25, 0.125)  # of all that is far, one after the other


class Explorer:
    """Drives on, a look at a time, towards a place around which it has not looked.

    promise: the chance of each proposal in a look that it is the goal, (n,).
    """

    def __init__(self, pilot: Pilot, promise: Callable[[Look], Array], log: Log) -> None:
        self.pilot, self.promise, self.log = pilot, cache(promise), log
        self._unreachable: list[Array] = []
        self._target: Array | None = None
        self._forgotten = 0  # looks, the first ones

    def drive_on(self, others: Sequence[Looked] = ()) -> None:
        """Drive some way towards such a place; GaveUp if there is none.

        others: where others have looked, which is left out while anything else is left, and what
        they saw.
        """
        pilot = self.pilot
        share, target = self._unseen_anywhere(others)
        if self._target is None or np.hypot(*(target - self._target)) > 1e-6:
            self.log("explore", "going where nobody has looked yet", len(pilot.looks) - 1)
        self._target = target
        way_m = 0.0
        while way_m < share * pilot.config.search_every_m:
            if pilot.here.distance_to_m(target) < share * _THERE_M:
                return
            driven_m = pilot.stretch(target, share * 2.0, 1.0)
            if driven_m is None:
                self._unreachable.append(target)
                return
            way_m += driven_m

    def _unseen_anywhere(self, others: Sequence[Looked]) -> tuple[float, Array]:
        """The best such place, and the share of what is far there; GaveUp if there is none."""
        for _ in range(2):
            for share, also in product(_SHARES, (others, ()) if others else ((),)):
                for choose in (self._to_see, self._unseen):
                    target = choose(share, also)
                    if target is not None:
                        return share, target
            since = (pose for pose, _ in self.pilot.looked[self._forgotten :])
            if any(pose.distance_to_m(self.pilot.here.xy_m) > _MOVED_M for pose in since):
                self._unreachable.clear()  # what stood in the way may be gone
            self._forgotten = len(self.pilot.looked) - 1
        raise GaveUp("there is nowhere left to look from where I can get")

    def _looked(self, others: Sequence[Looked]) -> list[Array]:
        """Where it or others have looked, as far as it is not forgotten."""
        own = [pose for pose, _ in self.pilot.looked[self._forgotten :]]
        return [pose.xy_m for pose in (*own, *(pose for pose, _ in others))]

    def _to_see(self, share: float, others: Sequence[Looked]) -> Array | None:
        """The best place beside what may be the goal, where more of it shows than was seen."""
        stands = [self._things(*seen) for seen in (*self.pilot.looked, *others)]
        range_m, chance, things = (np.concatenate(part) for part in zip(*stands, strict=True))
        aside_m, seen_m = share * _ASIDE_M, share * _SEEN_M
        looked = np.array(self._looked(others))
        left = cdist(things, looked).min(axis=1) > seen_m
        left |= _OTHER_SIDE * chance >= _LEAST
        for missed in self._unreachable:
            left &= np.hypot(*(things - missed).T) > aside_m + 1.0
        apart, chances = list[Array](), list[float]()
        for k in np.argsort(range_m, kind="stable"):  # placed the more surely the nearer
            if left[k]:
                same = left & (np.hypot(*(things - things[k]).T) <= share * _ONE_M)
                apart.append(things[k])
                chances.append(float(chance[same].max()))
                left &= ~same
        if not apart:
            return None
        places = np.concatenate([xy_m + aside_m * _around(_SIDES) for xy_m in apart])
        new = np.stack([_new(places - xy_m, looked - xy_m, seen_m) for xy_m in apart], axis=1)
        with np.errstate(divide="ignore"):  # where nothing new shows
            cost = (self._ways_m(places) + share * _LOOK_M) / (new @ np.array(chances))
        cost[cdist(places, looked).min(axis=1) < share * _THERE_M] = np.inf  # it may stand there
        return self._best(places, cost)

    def _things(self, here: Pose, look: Look) -> tuple[Array, Array, Array]:
        """What may be the goal: from how far it was seen, its chance, (n,), and where, (n, 2)."""
        p, chance = look.proposals, self.promise(look)
        chosen = (p.score >= _PROPOSED) & (p.range_m < _FARTHEST_M) & (chance > 0)
        turn = rotation_z(here.yaw_rad)[:2, :2]
        return p.range_m[chosen], chance[chosen], here.xy_m + p.xy_m[chosen] @ turn.T

    def _unseen(self, share: float, others: Sequence[Looked]) -> Array | None:
        """The best place far from all looked-at ones; as before, if that is near."""
        apart_m = share * self.pilot.config.explore_m
        known = np.array([*self._looked(others), *self._unreachable])
        places = (known[:, None] + (apart_m + 1.0) * _around(_TURNS)).reshape(-1, 2)
        places = places if self._target is None else np.vstack([self._target, places])
        fit = cdist(places, known).min(axis=1) >= apart_m
        fit &= np.hypot(*(places - self.pilot.here.xy_m).T) < share * _WITHIN_M
        if not fit.any():
            return None
        own, places = self._target is not None and bool(fit[0]), places[fit]
        ways_m = self._ways_m(places)
        if own:
            ways_m[0] *= 0.6  # no dithering
        return self._best(places, ways_m)

    def _ways_m(self, places: Array) -> Array:
        """How long the ways are, turns at the start counted in: (n,), infinite where none is."""
        here = self.pilot.here
        turn = np.arctan2(*(places - here.xy_m).T[::-1]) - here.yaw_rad
        ways_m = self.pilot.obstacles.lengths_m(here, places)
        return np.asarray(ways_m + _TURN_M * np.abs(wrap_angle_rad(turn)))

    def _best(self, places: Array, cost: Array) -> Array | None:
        """Of places (n, 2) that of the least cost, (n,); None if there is no way to any."""
        best = int(cost.argmin())
        return np.asarray(places[best]) if np.isfinite(cost[best]) else None


def _new(places: Array, looked: Array, seen_m: float) -> Array:
    """How much a thing shows at places (n, 2) that looks (m, 2) did not: (n,), both as from it."""
    shows = (np.hypot(*places.T) < seen_m).astype(float)
    near = looked[np.hypot(*looked.T) <= seen_m]
    if len(near):
        sides = np.arctan2(*places.T[::-1])[:, None] - np.arctan2(*near.T[::-1])
        shows *= _OTHER_SIDE * (np.abs(wrap_angle_rad(sides)).min(axis=1) > _SIDE_RAD)
    return shows


def _around(n: int) -> Array:
    """Directions all around, (n, 2)."""
    angle = np.arange(n) * 2 * np.pi / n
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)

"""A goal that is a place, known by the panorama taken there, and homing to it.

From afar, what a look around and that panorama have in common tells where it was taken; from near,
homing tells it, look by look.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from vrchain.homing import HomeVector, home_vector
from vrchain.landmarks.matching.common import Comparison
from vrchain.navigation.driving.estimates import Array, Estimate, sighted
from vrchain.navigation.goal.candidates import EVEN, Candidate, Candidates
from vrchain.navigation.goal.recognition import GoalSight, any_sight
from vrchain.navigation.perception import Look, Perception
from vrchain.navigation.planning.relative_poses import baseline_m

_HOMES_M = 8.0  # from so near, homing is believed
_SURE_MATCHES = 40  # keypoints that agree on the way home, to claim arrival
_STEP, _STEP_M = 0.7, (0.4, 10.0)  # of the way there from one look to the next; least and most
_NEAR_M = 0.2  # a place is driven to within so much
_LOOKS, _ASTRAY = 25, 3  # looks around on the way; those that tell nothing, on end
ARRIVED_M = 0.7  # by homing; paths are no finer


@dataclass(frozen=True, eq=False)
class GoalPlace:
    """A place as a robot knows it: what it makes of the panorama taken there."""

    look: Look
    perception: Perception

    def find(
        self,
        look: Look,
        near_rad: float | None = None,
        window_rad: float = 0.4,
        fair: Callable[[GoalSight], bool] = any_sight,
    ) -> GoalSight | None:
        """Where the place is, by a look around; a view by one camera does not tell."""
        if look.record is None and self.look.record is not None:
            return None
        found = self._compared(look)
        geometry, range_m = found.geometry, baseline_m(found, look.rig)
        if geometry is None or range_m is None or not found.common:
            return None
        chance = self.perception.trust(look, self.look, found)
        sight = GoalSight(
            geometry.direction_rad, range_m, range_m, 0.0, len(found.common), 0.0, chance
        )
        return sight if fair(sight) else None

    @cached_property
    def _compared(self) -> Callable[[Look], Comparison]:
        """With another look: one is asked of again and again, around whatever bearing."""
        return cache(lambda look: self.perception.compare(look, self.look))

    def promise(self, look: Look) -> Array:
        """The same for all: where something stands, the place may be."""
        return np.full(len(look.proposals), 0.01)

    def homing(self, look: Look) -> HomeVector | None:
        """The way there from near; None: too little speaks for it."""
        height_m = look.rig.camera_height_m
        home = home_vector(look.features, self.look.features, ARRIVED_M, height_m)
        return home if home is not None and home.n_matches >= _SURE_MATCHES else None


class PlaceArrival(Candidates):
    """Driving up to a place: nothing stands there, and it is reached when nothing is displaced."""

    goal: GoalPlace

    def is_blocked(self, place: Estimate) -> bool:
        """Never: where the place was not found, it had been looked for."""
        return False

    def drive_to(self, candidate: Candidate) -> bool:
        """Drive to where the place should be; True if the robot surely stands there."""
        pilot = self.pilot
        self._begin(candidate)
        place, told_nothing = candidate.place, 0
        for _ in range(_LOOKS):
            way_m = float(np.clip(_STEP * place.range_m(pilot.here), *_STEP_M))
            if pilot.stretch(place.xy_m, _NEAR_M, way_m) is None and told_nothing:
                break
            look = pilot.look_around()
            home = self.goal.homing(look)
            if home is not None and home.arrived:
                return True
            told = self._told(look, home, place)
            place, told_nothing = (place, told_nothing + 1) if told is None else (told, 0)
            if told_nothing == _ASTRAY:
                break
        self.log("doubt", "what is seen here is not what the goal's panorama shows")
        if candidate.sights:
            self._not_again(replace(candidate, place=place))
        return False

    def _told(self, look: Look, home: HomeVector | None, before: Estimate) -> Estimate | None:
        """Where the place is, by homing from near, by all that is in common from afar."""
        here = self.pilot.here
        if home is not None and before.range_m(here) <= _HOMES_M:
            return sighted(here, home.bearing_rad, home.remoteness)
        sight = self.goal.find(look)
        if sight is None or sight.chance < EVEN:
            return None
        return sight.place(here)

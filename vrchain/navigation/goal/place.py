"""A goal that is a place, known by the panorama taken there, and homing to it.

From afar, what a look around and that panorama have in common tells where it was taken; from near,
homing tells it, look by look.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np

from vrchain.geometry import Pose
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
_CAME_M, _TOO_NEAR = 0.3, 2.0  # of way; what is supposed to be so many times too near is refuted
_LOOKS, _ASTRAY = 25, 3  # looks around on the way; those that tell nothing, on end
ARRIVED_M = 0.7  # by homing; paths are no finer


@dataclass(frozen=True, eq=False)
class GoalPlace:
    """A place as a robot knows it: what it makes of the panorama taken there."""

    look: Look
    perception: Perception
    share = 1.0  # of the distances in suburbs

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
        place, in_vain, nearest_m = candidate.place, 0, np.inf
        before: tuple[Pose, float] | None = None  # from where homing told it, and how far it is
        for _ in range(_LOOKS):
            bearing, range_m = place.seen_from(pilot.here)
            way_m = float(np.clip(_STEP * range_m, *_STEP_M))
            beyond = sighted(pilot.here, bearing, max(range_m, way_m + _NEAR_M))
            stopped = pilot.stretch(beyond.xy_m, _NEAR_M, way_m) is None
            if stopped and in_vain:
                break
            look = pilot.look_around()
            home, nearer = self.goal.homing(look), True
            if home is not None:
                told = pilot.here, home.remoteness
                nearer, nearest_m = told[1] < nearest_m, min(nearest_m, told[1])
                home = _by_growth(home, pilot.here, *(before or told))
                if home.arrived:
                    return True
                if before is None or before[0].distance_to_m(pilot.here.xy_m) >= _CAME_M:
                    before = told
            seen = self._told(look, home, place)
            in_vain = 0 if seen is not None and nearer and not stopped else in_vain + 1
            place = place if seen is None else seen
            if in_vain == _ASTRAY:
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


def _by_growth(home: HomeVector, here: Pose, stood: Pose, remoteness: float) -> HomeVector:
    """Home farther away, where it came much less near than the robot drove towards it.

    stood, remoteness: from where, and how far, it was told before. Where all that is seen is far
    away, it is supposed to be too near; but not how fast that changes on the way. So who has not
    moved has not arrived; who has passed it, has.
    """
    course_rad = here.yaw_rad + home.bearing_rad
    came_m = float((here.xy_m - stood.xy_m) @ [np.cos(course_rad), np.sin(course_rad)])
    nearer_m = remoteness - home.remoteness
    if abs(came_m) < _CAME_M:
        return replace(home, arrived=False)
    if not home.arrived or came_m < 0 or _TOO_NEAR * nearer_m >= came_m:
        return home
    range_m = min(home.remoteness * came_m / max(nearer_m, 0.05), _HOMES_M)
    return replace(home, arrived=range_m <= ARRIVED_M, remoteness=range_m)

"""What may be the goal, driving up to it, and making sure that it is the goal.

A wrong arrival is worse than none: it is claimed where a sight was surely of the goal, the range
ring meets something there, and the goal has grown on the way as it should.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from vrchain.navigation.driving import Array, Pilot
from vrchain.navigation.eyes import Look
from vrchain.navigation.goal import GoalSight, KnownGoal
from vrchain.navigation.places import Place, sighted
from vrchain.navigation.terms import Log

_DOUBTED_M = 7.0  # around where a goal was not confirmed, nothing is taken for it again
_SAME_STD = 3.0  # standard deviations within which two sights are of one thing
_ASTRAY = 4.0  # ... beyond which a glance did not show what is driven to
_NEAR_M, _AGAINST = 18.0, 3  # glances from so near that do not show the goal: it is not there
_AGAIN = 0.7  # of its chance is left after each
_DOUBT_CHANCE = 0.2  # of a sight from near that speaks against it
_START_M = 10.0  # a detour of no length costs so much
_FEELS_M, _FELT_M = 4.0, 0.7  # a goal so near is felt by the range ring, within so much
_AHEAD_RAD = 0.15
_LEAST_WAY_M = 4.0  # of way, after which the growth of a thing tells how far it is
_LOOKS_FAR_M = 7.5  # to the middle of what is seen of a goal, whose side is near
_TRIES = 3  # to drive on to what still looks far
_SIDES = (1, 2, 3, 4, 5)  # of the six around a goal, counted from where the robot stands
_HALF_M, _AROUND_M = 4.0, 5.0  # from a goal's side to its middle, and on to where it is looked at
_SIDE_S = 25.0  # to get there


@dataclass(frozen=True, eq=False)
class Suspect:
    """What may be the goal: its nearest side, and the chance that it is.

    seen: by the robot itself; sure: so well that arrival may be claimed; against: glances from near
    that did not show it.
    """

    place: Place
    chance: float
    seen: bool = True
    sure: bool = False
    against: int = 0


class Arrival:
    """Suspects, and driving up to one of them."""

    def __init__(self, pilot: Pilot, goal: KnownGoal, log: Log) -> None:
        self.pilot, self.goal, self.log = pilot, goal, log
        self.suspects: list[Suspect] = []
        self._mistaken: list[Array] = []  # where what looked like the goal was something else
        self._sizes: list[tuple[Array, GoalSight]] = []  # how large it looked, and from where

    @property
    def likeliest(self) -> Suspect | None:
        """What may be the goal and is worth the way to it, the most likely one first."""
        pilot = self.pilot
        worth = [
            s for s in self.suspects
            if s.chance >= pilot.config.likely
            or s.chance >= pilot.config.chance_per_m * (s.place.range_m(pilot.here) + _START_M)
        ]  # fmt: skip
        return max(worth, key=lambda s: s.chance, default=None)

    def note(self, look: Look) -> Suspect | None:
        """Take in a look around; what may be the goal in it, if that was no mistake before."""
        sight = self.goal.find(look)
        if sight is None or sight.chance < self.pilot.config.least_chance:
            return None
        place = self._place_of(sight)
        if self.was_mistaken(place):
            return None
        self._sizes.append((self.pilot.here.xy_m, sight))
        for i, known in enumerate(self.suspects):
            if known.place.astray(place) < _SAME_STD:
                self.suspects[i] = self._with_sight(known, sight)
                return self.suspects[i]
        self.suspects.append(Suspect(place, sight.chance, sure=self._is_sure(sight)))
        return self.suspects[-1]

    def was_mistaken(self, place: Place) -> bool:
        """Whether what is there looked like the goal and was something else."""
        return any(np.hypot(*(place.xy_m - m)) < _DOUBTED_M for m in self._mistaken)

    def drive_to(self, suspect: Suspect) -> bool:
        """Drive up to what may be the goal; True if it surely is, and the robot stands there."""
        self._begin(suspect)
        suspect = self._close_in(suspect)
        if not suspect.sure and self._is_likely(suspect):
            self.log("circle", "it has not looked enough like the goal yet: from other sides")
            for seen in self._sides(suspect):
                suspect = seen
                if suspect.sure:
                    suspect = self._close_in(suspect)
                if suspect.sure or suspect.against >= _AGAINST:
                    break
        if not suspect.sure:
            self.log("doubt", "it never looked enough like the goal's pictures")
            if suspect.seen:
                self._mistaken.append(suspect.place.xy_m)
            return False
        for _ in range(_TRIES):
            far_m = self._looks_far_m()
            if far_m is None or far_m <= _LOOKS_FAR_M:
                break
            self.log("farther", "it has not grown enough: it must be behind this")
            bearing = suspect.place.bearing_rad(self.pilot.here)
            place = sighted(self.pilot.here, bearing, far_m - _HALF_M)
            suspect = self._close_in(replace(suspect, place=place))
        else:
            self._mistaken.append(suspect.place.xy_m)
            return False
        if self._is_at(suspect.place):
            return True
        for seen in self._sides(suspect):
            suspect = self._close_in(seen)
            if self._is_at(suspect.place) and (self._looks_far_m() or 0.0) <= _LOOKS_FAR_M:
                return True
        self.log("blocked", "no way leads to the goal from here")
        self._mistaken.append(suspect.place.xy_m)
        return False

    def _begin(self, suspect: Suspect) -> None:
        """It is a suspect no longer: it is driven to."""
        pilot = self.pilot
        self.suspects = [s for s in self.suspects if s is not suspect]
        self.log(
            "approach", "the goal", len(pilot.looks) - 1,
            bearing_deg=round(float(np.degrees(suspect.place.bearing_rad(pilot.here))), 1),
            range_m=round(suspect.place.range_m(pilot.here), 1), chance=round(suspect.chance, 2),
        )  # fmt: skip

    def _place_of(self, sight: GoalSight) -> Place:
        """Where the goal's nearest side is."""
        return sighted(self.pilot.here, sight.bearing_rad, sight.surface_m)

    def _is_sure(self, sight: GoalSight) -> bool:
        config = self.pilot.config
        return sight.chance >= config.sure_chance and sight.n_matches >= config.sure_matches

    def _is_likely(self, suspect: Suspect) -> bool:
        return suspect.seen and suspect.chance >= self.pilot.config.likely

    def _with_sight(self, suspect: Suspect, sight: GoalSight) -> Suspect:
        return replace(
            suspect,
            place=suspect.place.with_sight(self._place_of(sight)),
            chance=max(suspect.chance if suspect.seen else 0.0, sight.chance),
            seen=True,
            sure=suspect.sure or self._is_sure(sight),
        )

    def _close_in(self, suspect: Suspect) -> Suspect:
        """Drive up to its side, with a glance every few metres, unless it turns out to be none."""
        pilot, config = self.pilot, self.pilot.config
        glanced, looked = config.glance_every_m, 0.0
        until_ns = pilot.until_ns(suspect.place)
        while pilot.now.time_ns < until_ns and not self._is_at(suspect.place):
            if suspect.place.range_m(pilot.here) <= config.sees_m:
                if glanced >= config.glance_every_m:
                    glanced = 0.0
                    suspect = self._regarded(suspect)
            elif looked >= config.look_every_m:
                looked = 0.0
                sight = self.goal.find(pilot.look_around())
                if sight is not None and sight.chance >= config.least_chance:
                    place = self._place_of(sight)
                    if sight.chance > suspect.chance or suspect.place.astray(place) < _SAME_STD:
                        suspect = replace(self._with_sight(suspect, sight), place=place)
            if suspect.against >= _AGAINST and not self._is_likely(suspect):
                break
            suspect = replace(suspect, place=self._felt(suspect.place))
            way_m = pilot.stretch(suspect.place.xy_m, 1.0, 0.5)
            if way_m is None:
                break
            glanced, looked = glanced + way_m, looked + way_m
            suspect = replace(suspect, place=suspect.place.after(way_m))
        return replace(suspect, place=self._felt(suspect.place))

    def _regarded(self, suspect: Suspect) -> Suspect:
        """What a glance at it tells."""
        pilot, place = self.pilot, suspect.place
        bearing, range_m = place.bearing_rad(pilot.here), place.range_m(pilot.here)
        look = pilot.glance(bearing)
        window_rad = float(np.clip(2 * place.std_m / max(range_m, 1.0), 0.2, 1.0))
        sight = self.goal.find(look, bearing, window_rad)
        missed = sight is None or sight.chance < _DOUBT_CHANCE
        if sight is None or missed or place.astray(self._place_of(sight)) > _ASTRAY:
            if range_m > _NEAR_M:
                return suspect
            chance = _AGAIN * suspect.chance
            return replace(suspect, chance=chance, against=suspect.against + 1)
        self._sizes.append((pilot.here.xy_m, sight))
        return self._with_sight(suspect, sight)

    def _sides(self, suspect: Suspect) -> Iterator[Suspect]:
        """What is seen of it from places around it, from one after the other."""
        pilot = self.pilot
        away = suspect.place.xy_m - pilot.here.xy_m
        middle = suspect.place.xy_m + _HALF_M * away / max(float(np.hypot(*away)), 0.1)
        first = np.arctan2(*(pilot.here.xy_m - middle)[::-1])
        for turn in _SIDES:
            angle = first + turn * np.pi / 3
            outward = np.array([np.cos(angle), np.sin(angle)])
            stand_xy_m = middle + (_HALF_M + _AROUND_M) * outward
            until_ns = pilot.now.time_ns + int(_SIDE_S * 1e9)
            while pilot.now.time_ns < until_ns and pilot.here.distance_to_m(stand_xy_m) > 1.5:
                if pilot.stretch(stand_xy_m, 1.0, 1.0) is None:
                    break
            side = Place(middle + _HALF_M * outward, 4.0 * np.eye(2))
            suspect = self._regarded(replace(suspect, place=side))
            yield suspect

    def _is_at(self, place: Place) -> bool:
        """Whether the goal's side is within reach, and something is there."""
        pilot, reach_m = self.pilot, self.pilot.config.arrival_m
        ahead_m = pilot.ahead_m(place.bearing_rad(pilot.here), _AHEAD_RAD)
        return place.range_m(pilot.here) <= reach_m and ahead_m <= reach_m + _FELT_M

    def _felt(self, place: Place) -> Place:
        """The goal's side where the range ring meets something, once it is believed so near."""
        pilot = self.pilot
        bearing, range_m = place.bearing_rad(pilot.here), place.range_m(pilot.here)
        ahead_m = pilot.ahead_m(bearing, _AHEAD_RAD)
        if range_m > _FEELS_M or not range_m - _FELT_M < ahead_m < pilot.ways.reach_m:
            return place  # what is before it is to be driven around
        course = pilot.here.yaw_rad + bearing
        there = pilot.here.xy_m + ahead_m * np.array([np.cos(course), np.sin(course)])
        return Place(there, place.covariance)

    def _looks_far_m(self) -> float | None:
        """How far the middle of the goal is by its growth; None: nothing tells.

        What looks g times larger after a way D towards it is D / (g - 1) away.
        """
        here = self.pilot.here
        now = self.goal.find(self.pilot.look_around())
        ranges_m = [
            here.distance_to_m(then) / max(now.sizes[k] / size - 1.0, 1e-3)
            for then, sight in self._sizes
            if now is not None and here.distance_to_m(then) > _LEAST_WAY_M
            for k, size in sight.sizes.items()
            if k in now.sizes
        ]
        return float(np.median(ranges_m)) if ranges_m else None

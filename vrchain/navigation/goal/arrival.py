"""Driving up to what may be the goal, and making sure that it is the goal.

A wrong arrival is worse than none: it is claimed where sights were surely of the goal, the range
ring meets something there, and the goal looks as large as it should.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace

import numpy as np

from vrchain.geometry import Pose
from vrchain.navigation.driving.estimates import Array, Estimate, sighted
from vrchain.navigation.driving.obstacles import REACH_M
from vrchain.navigation.goal.candidates import (
    AGAIN,
    EVEN,
    NEAR_M,
    SAME_STD,
    SHAPE_M,
    UNSURE,
    Candidate,
    Candidates,
    about,
    at_odds,
)
from vrchain.navigation.settings import GOAL_RANGE_M

_ASTRAY = 4.0  # standard deviations beyond which a glance did not show what is driven to
_AGAINST = 3  # glances from near that do not show it: it is not there
_DOUBT_CHANCE = 0.2  # of a sight from near that speaks against it
_FEELS_M, _FELT_M = 4.0, 0.7  # a goal so near is felt by the range ring, within so much,
_FELT_STD = 2.0  # or, if it was surely seen, within so many standard deviations
_SHIFTS_M2_PER_M = 0.2  # the nearest side of what is wide is another as the robot drives
_AHEAD_RAD, _NEARLY_M = 0.15, 2.2  # a goal may be so far ahead that can be got no nearer
_BESIDE_M, _TOUCH_M, _BESIDE_RAD = 2.5, 1.2, 1.0  # a goal believed so near, and what is met there
_DRAWN_UP_M, _STEPS_UP = 1.0, 5  # to what is met, at the end
# A wide goal's wall is wider than a bush before it: those of suburbs are up to 1.5 m wide.
_WIDE_M, _WALL_M, _THIN_M = 3.0, 2.0, 1.0
_STEPS_ROUND, _AWAY_M = 10, 0.5  # round that, unless it leads away from where it stands already
# What looks to be so much farther is not what the range ring met (see ``Candidate.by_size``),
# unless that goes on, as its wall does, to where it is met, so much of the way to where it looks.
# Of 123 sights from within 2.2 m of its side 37 looked 3 m far, 13 with that, and all 83 from 3.2
# to 5.5 m, in suburbs of seeds 1343 to 1347. By 2.4 m two approaches of 19 fewer end falsely.
_LOOKS_FAR_M, _OF_THE_WAY, _FRONT_M = 2.4, 0.5, 3.0
_TRIES, _HEADWAY_M = 3, 0.5  # to drive on to what still looks far, unless that gets it nowhere
# At most, of the six around a goal, until it is sure; and then, to get nearer to it. From 231
# places that showed one of 56 goals by a chance of 0.5 or more, in suburbs of seeds 1343 and 1344,
# it was sure from that side in 75 %, with 1, 2, 3 sides more in 89, 96, 98 %. A side costs 17 s.
_SIDES, _SIDES_OF_IT = 5, 3
# What is touched so near its middle is of it: in 37 approaches in suburbs of seed 1371 its walls
# were touched up to 7.3 m from there, what was not from 8.7 m on.
_OF_IT_M = 7.5
_SURER = 10.0  # so many times its odds make another sight worth leaving a circle for
_HALF_M, _AROUND_M = 4.0, 8.0  # from a goal's side to its middle, at least, and on to a look at it
_SIDE_S = 30.0  # to get there


class Arrival(Candidates):
    """Candidates for the goal, and driving up to one of them."""

    def drive_to(self, candidate: Candidate) -> bool:
        """Drive up to what may be the goal; True if it surely is, and the robot stands there."""
        self._begin(candidate)
        candidate = self._close_in(candidate)
        if self._is_worth_a_circle(candidate) and not candidate.is_shape_seen(self.goal.share):
            candidate = self._from_farther(candidate)
        if self._is_worth_a_circle(candidate):
            candidate = self._circle(candidate)
        if self._is_sure(candidate):
            candidate = self._driven_on(candidate, _TRIES)
            if self._is_claimed(candidate):
                return True
            before = candidate.place
            for side in self._sides(candidate, range(1, _SIDES_OF_IT + 1)):
                candidate = self._regarded(replace(candidate, place=side))
                candidate = self._driven_on(self._close_in(candidate), 1)
                if self._is_claimed(candidate):
                    return True
            candidate = replace(candidate, place=before)
        if self._is_sure(candidate):
            self.log("blocked", "no way leads to the goal from here")
            self._not_again(candidate)
        else:
            self.log("doubt", "it never looked enough like the goal's pictures")
            if candidate.sights:
                self._not_again(candidate, candidate.place.range_m(self.pilot.here) < NEAR_M)
        return False

    def _is_worth_a_circle(self, candidate: Candidate) -> bool:
        """Whether it may be the goal, unsurely, and, its place surer from near, is no mistake."""
        if self._is_sure(candidate) or self.was_mistaken(candidate.place, candidate.surest):
            return False
        return bool(candidate.sights) and candidate.chance_unsure >= EVEN

    def _from_farther(self, candidate: Candidate) -> Candidate:
        """Up to it once more, from as far as pictures are taken."""
        self.log("back", "it was seen from too near only to know its shape")
        side = next(self._sides(candidate, [0], GOAL_RANGE_M[1]))
        return self._close_in(self._regarded(replace(candidate, place=side)))

    def _circle(self, candidate: Candidate) -> Candidate:
        """What looks at its other sides tell, until it is sure, or no longer likely and a mistake.

        Each side that leaves it unsure speaks against it, much like the goal or not at all. It is
        left, too, for what is far surer and stands elsewhere, and waits again, without sights here.
        """
        self.log("circle", "it has not looked enough like the goal yet: from other sides")
        before, (middle_xy_m, _) = candidate.place, self._middle(candidate)
        candidate, chance = replace(candidate, against=0), candidate.chance_unsure
        for side in self._sides(candidate, range(1, _SIDES + 1)):
            surest = candidate.surest
            candidate = self._regarded(replace(candidate, place=side))
            around = self.note(self.pilot.look_around())
            if around is not None and self._is_near(around.place.xy_m, candidate.place):
                candidate = candidate.with_sight(*around.sights[-1])
            if self._is_sure(candidate):
                return self._close_in(candidate)
            if candidate.surest > surest:
                chance = max(chance, at_odds(candidate.surest, UNSURE))
            chance = at_odds(chance, AGAIN)
            if chance < EVEN:
                break
            if self._is_surer_elsewhere(candidate.place, at_odds(chance, _SURER)):
                self.candidates.append(replace(candidate, chance=chance, place=before))
                return replace(candidate, sights=(), place=before)
        if self.pilot.here.distance_to_m(middle_xy_m) < NEAR_M:
            self._mistaken.append((middle_xy_m, candidate.surest))
        return replace(candidate, place=before)

    def _is_claimed(self, candidate: Candidate) -> bool:
        """Whether the robot is there, and it is sure still: later sights may speak against it."""
        claimed = self._is_sure(candidate) and self._is_there(candidate)
        if claimed:
            self._draw_up(candidate)
        return claimed

    def _driven_on(self, candidate: Candidate, tries: int) -> Candidate:
        """On to where it is by its size, while it looks farther than what was met, or none was."""
        for _ in range(tries):
            candidate = self._seen_around(candidate)
            there = self._onward(candidate)
            if there is None:
                break
            self.log("farther", "it does not look large enough: it must be behind this")
            before, behind = self.pilot.here, replace(candidate, place=about(there))
            candidate = self._close_in(behind, behind=True)
            if self.pilot.here.distance_to_m(before.xy_m) < _HEADWAY_M:
                return behind  # from another side, then
        return candidate

    def _onward(self, candidate: Candidate) -> Array | None:
        """Where it is by its size, (2,), if that is not here or nothing is here; else None."""
        by_size, there = candidate.by_size(), self._behind_this(candidate)
        if there is not None or by_size is None or self._is_there(candidate):
            return there
        came = candidate.place.range_m(self.pilot.here) <= self.pilot.config.arrival_m
        return by_size[0] if came else None

    def _is_there(self, candidate: Candidate) -> bool:
        """Whether the robot has got as near to it as may be, and it is as large as it should be.

        It may be nearer than it is believed: what is in the way to it is its own wall, then.
        """
        by_size = candidate.by_size()
        places = [candidate.place] if by_size is None else [candidate.place, about(by_size[0])]
        met = filter(None, (self._met_at(place, _NEARLY_M) for place in places))
        at = any(self._front(candidate, thing)[1] <= _FRONT_M for thing in met)
        return at and self._behind_this(candidate) is None

    def _close_in(self, candidate: Candidate, behind: bool = False) -> Candidate:
        """Drive up to its side, with a glance every few metres, unless it turns out to be none.

        behind: it is behind what the robot touches.
        """
        pilot, config = self.pilot, self.pilot.config
        glanced_m, looked_m = config.glance_every_m, 0.0
        until_ns = pilot.until_ns(candidate.place)
        while pilot.now.time_ns < until_ns and not self._met_at(candidate.place, config.arrival_m):
            if candidate.place.range_m(pilot.here) <= config.sees_m:
                if glanced_m >= config.glance_every_m:
                    glanced_m = 0.0
                    candidate = self._regarded(candidate)
            elif looked_m >= config.look_every_m:
                looked_m = 0.0
                candidate = self._seen_from_afar(candidate)
            if candidate.against >= _AGAINST and (not candidate.sights or candidate.chance < EVEN):
                break
            touched = None if behind else self._touched(candidate)
            if touched is not None:
                return replace(candidate, place=Estimate(touched, candidate.place.covariance))
            candidate = self._felt(candidate)
            way_m = pilot.stretch(candidate.place.xy_m, 1.0, 0.5)
            if way_m is None:
                break
            glanced_m, looked_m = glanced_m + way_m, looked_m + way_m
            candidate = replace(candidate, place=candidate.place.after(way_m, _SHIFTS_M2_PER_M))
        return self._felt(candidate)

    def _seen_from_afar(self, candidate: Candidate) -> Candidate:
        """What a look all around tells of it, or what more likely is the goal."""
        sight, here = self.goal.find(self.pilot.look_around(), fair=self._is_fair), self.pilot.here
        if sight is not None and sight.chance >= self.pilot.config.least_chance:
            place = sight.place(here)
            if candidate.place.astray(place) < SAME_STD:
                return replace(candidate.with_sight(here, sight), place=place)
            if sight.chance > candidate.chance:
                self.candidates.append(candidate)  # which waits again
                return Candidate.seen(here, sight)
        return candidate

    def _regarded(self, candidate: Candidate) -> Candidate:
        """What a glance at it tells."""
        pilot, place = self.pilot, candidate.place
        bearing, range_m = place.seen_from(pilot.here)
        look = pilot.glance(bearing)
        window_rad = float(np.clip(2 * place.std_m / max(range_m, 1.0), 0.2, 1.0))
        sight = self.goal.find(look, bearing, window_rad)
        missed = sight is None or sight.chance < _DOUBT_CHANCE
        if sight is None or missed or place.astray(sight.place(pilot.here)) > _ASTRAY:
            shown_m = min(range_m, pilot.ahead_m(bearing, _AHEAD_RAD, np.median))
            if not (self.goal.share * SHAPE_M < shown_m < NEAR_M and pilot.shows(bearing)):
                return candidate  # from so far, or so near to what hides it, it may not be seen
            left = at_odds(candidate.chance, AGAIN)
            return replace(candidate, chance=left, against=candidate.against + 1)
        return candidate.with_sight(pilot.here, sight)

    def _sides(
        self, candidate: Candidate, turns: Iterable[int], off_m: float = _AROUND_M
    ) -> Iterator[Estimate]:
        """Its sides by sixths of a turn from here, each once the robot looks at it from off it."""
        pilot = self.pilot
        middle, half_m = self._middle(candidate)
        first = np.arctan2(*(pilot.here.xy_m - middle)[::-1])
        for turn in turns:
            angle = first + turn * np.pi / 3
            outward = np.array([np.cos(angle), np.sin(angle)])
            stand_xy_m = middle + (half_m + self.goal.share * off_m) * outward
            until_ns = pilot.now.time_ns + int(_SIDE_S * 1e9)
            while pilot.now.time_ns < until_ns and pilot.here.distance_to_m(stand_xy_m) > 1.5:
                if pilot.stretch(stand_xy_m, 1.0, 1.0) is None:
                    break
            yield about(middle + half_m * outward)

    def _middle(self, candidate: Candidate, stood: Pose | None = None) -> tuple[Array, float]:
        """Where its middle is, about, (2,), and how far from its sides, seen from there or here."""
        away = candidate.place.xy_m - (stood or self.pilot.here).xy_m
        share = self.goal.share
        half_m = max(share * _HALF_M, candidate.width_m(share) / 2)
        return candidate.place.xy_m + half_m * away / max(float(np.hypot(*away)), 0.1), half_m

    def _touched(self, candidate: Candidate) -> Array | None:
        """What the robot touches of where a goal stands that was surely seen, (2,), or None.

        Who comes round its corner has another side before it than the one that was seen, from near.
        """
        if not self._is_sure(candidate) or candidate.sights[-1][1].surface_m > NEAR_M:
            return None
        pilot, (stood, sight) = self.pilot, candidate.sights[-1]
        middle, half_m = self._middle(replace(candidate, place=sight.place(stood)), stood)
        bearing = about(middle).bearing_rad(pilot.here)
        touched = pilot.nearest(bearing, _BESIDE_RAD)
        if touched[1] > _TOUCH_M or pilot.ahead_m(bearing, _AHEAD_RAD) > _BESIDE_M:
            return None  # its own wall would be in the way to its middle
        met = sighted(pilot.here, *touched).xy_m
        std_m, of_it_m = sight.place(stood).std_along_m(stood), self.goal.share * _OF_IT_M
        of_it = float(np.hypot(*(met - middle))) <= max(half_m + _FELT_STD * std_m, of_it_m)
        return met if of_it and self._front(candidate, touched) == touched else None

    def _met_at(self, place: Estimate, reach_m: float) -> tuple[float, float] | None:
        """What is met, its bearing and range, where the goal's side is within reach; else None."""
        pilot, (bearing, range_m) = self.pilot, place.seen_from(self.pilot.here)
        if range_m <= _BESIDE_M:  # where it is at hand, the bearing means nothing
            met = pilot.nearest(bearing, np.pi if range_m <= _TOUCH_M else _BESIDE_RAD)
            if met[1] <= _TOUCH_M:
                return met
        ahead_m = pilot.ahead_m(bearing, _AHEAD_RAD)
        return (bearing, ahead_m) if max(range_m, ahead_m - _FELT_M) <= reach_m else None

    def _front(self, candidate: Candidate, met: tuple[float, float]) -> tuple[float, float]:
        """What is met of its front, bearing and range: that or, if it is narrow, beside it."""
        narrow, _, width_m = self.pilot.surface(met[0])
        if width_m >= _WALL_M or candidate.width_m(self.goal.share) < _WIDE_M:
            return met
        beside = self.pilot.nearest(met[0], _BESIDE_RAD, but=narrow)
        return beside if met[1] + _THIN_M < beside[1] < REACH_M else met

    def _draw_up(self, candidate: Candidate) -> None:
        """As near as may be: what the range ring met may stand before the goal."""
        pilot, place = self.pilot, candidate.place
        for _ in range(_STEPS_UP):
            near = pilot.ahead_m(place.bearing_rad(pilot.here), _AHEAD_RAD) <= _DRAWN_UP_M
            if near or pilot.stretch(place.xy_m, 0.5, 0.3) is None:
                break
        bearing = place.bearing_rad(pilot.here)
        ahead_m = pilot.ahead_m(bearing, _AHEAD_RAD)
        beam, front_m = self._front(candidate, (bearing, ahead_m))
        if front_m > ahead_m:
            self.log("round", "something narrow stands before it")
            there = sighted(pilot.here, beam, front_m - _DRAWN_UP_M).xy_m
            to_m = pilot.here.distance_to_m(there) + _AWAY_M
            for _ in range(_STEPS_ROUND):
                if pilot.here.distance_to_m(there) > to_m or pilot.stretch(there, 0.5, 0.5) is None:
                    break

    def _felt(self, candidate: Candidate) -> Candidate:
        """Its side is where the range ring meets something, once it is believed so near.

        What is met before that is another thing, unless the goal was surely seen, whose side may be
        as much nearer as it is unsure. Nor is what is met beyond where it was seen last: the robot
        has passed it.
        """
        pilot, place = self.pilot, candidate.place
        bearing, range_m = place.seen_from(pilot.here)
        ahead_m = pilot.ahead_m(bearing, _AHEAD_RAD)
        nearer_m = _FELT_M
        if self._is_sure(candidate):
            nearer_m = max(nearer_m, _FELT_STD * place.std_along_m(pilot.here))
        if range_m > _FEELS_M or not range_m - nearer_m < ahead_m < REACH_M:
            return candidate  # what is before it is to be driven around
        met_xy_m = sighted(pilot.here, bearing, ahead_m).xy_m
        for stood, sight in candidate.sights[-1:]:
            seen = sight.place(stood)
            if float(np.hypot(*(met_xy_m - seen.xy_m))) > SAME_STD * seen.std_m:
                return candidate
        return replace(candidate, place=Estimate(met_xy_m, place.covariance))

    def _seen_around(self, candidate: Candidate) -> Candidate:
        """What a look all around from beside it tells of its size."""
        look, here = self.pilot.look_around(), self.pilot.here
        sight = self.goal.find(look, candidate.place.bearing_rad(here), _BESIDE_RAD)
        if sight is None or sight.chance < EVEN or not candidate.is_anew(here):
            return candidate
        return replace(candidate, sights=(*candidate.sights, (here, sight)))

    def _behind_this(self, candidate: Candidate) -> Array | None:
        """Where its side is, (2,), by how large it looked lately, if that is not here.

        It is here if the robot, seeing it there, looks along its wall, and stands before that.
        """
        pilot, by_size = self.pilot, candidate.by_size()
        if by_size is None:
            return None
        there, away = by_size
        bearing, range_m = about(there).seen_from(pilot.here)
        if range_m <= _LOOKS_FAR_M or (there - pilot.here.xy_m) @ away <= 0:
            return None
        along = pilot.ahead_m(bearing, _AHEAD_RAD, np.median) >= _OF_THE_WAY * range_m
        return None if along and pilot.surface(bearing)[1] <= _NEARLY_M else there

"""What may be the goal, and what its sights tell: whether it surely is, how wide, and how far."""

from dataclasses import dataclass, replace

import numpy as np

from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.navigation.driving.drive import Pilot
from vrchain.navigation.driving.estimates import Array, Estimate
from vrchain.navigation.goal.recognition import BY_CHANCE, GoalSight, KnownGoal
from vrchain.navigation.perception import Look
from vrchain.navigation.settings import Log, MissionConfig

EVEN = 0.5  # chance of a sight that is rather of the goal than not
SHAPE_M = 5.0  # sights from nearer show no shape
NEAR_M = 18.0  # from within so much the goal is seen well
SAME_STD = 3.0  # standard deviations within which two sights are of one thing
_AGREE = 2  # sights from farther, at least, that a plain goal is known by
_ANEW_M = 0.5  # from each other, and it is another sight
_RICH = 500  # keypoints on a goal in a picture, from which it is no plain thing
_SIDE_RAD = 0.8  # sights in directions so far apart show one side of it
# How large it looks tells how far it is to a share and some metres more, beside an error of its
# pictures' distance, the same in all sights. On 104 approaches in suburbs of seeds 1341 and 1342
# it told more than 3 m in 6 of 43 sights from 2 m, and less in 2 of 79 from 4 to 5 m.
_GREW, _SIZE_STD, _SIZE_STD_M = 3, 0.1, 0.3  # in so many sights, at least
_TAKEN_STD = 0.16
_MISTAKEN_M = 7.0  # around what was not the goal, nothing is taken for it again,
_SURER = 5.0  # unless its odds are so many times what they were
_START_M = 10.0  # a detour of no length costs so much
# Of its odds is left after each glance from near that does not show it: at 11 m likely goals were
# not seen from 6.5 m in 24 %, likely other houses in 48 %, in suburbs of seeds 1343 and 1344;
AGAIN = 0.5
UNSURE = 0.25  # and where the first side leaves it unsure (see ``arrival``)


@dataclass(frozen=True, eq=False)
class Candidate:
    """What may be the goal: its nearest side, and the chance that it is.

    sights: the robot's own, and by odometry from where; against: glances from near that did not
    show it.
    """

    place: Estimate
    chance: float
    sights: tuple[tuple[Pose, GoalSight], ...] = ()
    against: int = 0

    @classmethod
    def seen(cls, here: Pose, sight: GoalSight) -> "Candidate":
        """By its first sight."""
        return cls(sight.place(here), sight.chance, ((here, sight),))

    def is_anew(self, here: Pose) -> bool:
        """Whether it was not seen from here before."""
        return all(stood.distance_to_m(here.xy_m) >= _ANEW_M for stood, _ in self.sights)

    def with_sight(self, here: Pose, sight: GoalSight) -> "Candidate":
        """With one more sight of it; a second one from one place tells nothing new."""
        if not self.is_anew(here):
            return replace(self, chance=max(self.chance, sight.chance))
        return replace(
            self,
            place=self.place.with_sight(sight.place(here)),
            chance=max(self.chance if self.sights else 0.0, sight.chance),
            sights=(*self.sights, (here, sight)),
        )

    def is_sure(self, config: MissionConfig, share: float = 1.0) -> bool:
        """Whether arrival may be claimed there: more is seen of it than of a house of its make.

        share: of 6 to 15 m, from how far the goal was pictured at most.
        Such a house shows as much as a plain goal now and then, from near a goal in most.
        """
        sights = [sight for _, sight in self.sights if sight.chance >= config.sure_chance]
        shape_m = share * SHAPE_M
        shapes = [sight for sight in sights if sight.surface_m >= shape_m]
        many = any(sight.n_matches - BY_CHANCE >= config.sure_matches for sight in sights)
        if many and any(sight.looks >= config.sure_looks for sight in shapes):
            return True
        well_m = share * NEAR_M
        n_seen = sum(shape_m <= sight.surface_m < well_m for _, sight in self.sights)
        surest = any(_is_surest(sight, config) for sight in shapes)
        return surest and len(shapes) >= max(_AGREE, n_seen / 2)

    def is_shape_seen(self, share: float) -> bool:
        """Whether a sight that is rather of it than not shows its shape. share: as above."""
        return any(s.chance >= EVEN and s.surface_m >= share * SHAPE_M for _, s in self.sights)

    @property
    def surest(self) -> float:
        """The chance of its surest sight, none if it was not seen."""
        return max((sight.chance for _, sight in self.sights), default=0.0)

    @property
    def chance_unsure(self) -> float:
        """The chance left to what one side left unsure; glances that did not show it told some."""
        return at_odds(self.chance, min(1.0, UNSURE / AGAIN**self.against))

    def width_m(self, share: float) -> float:
        """How wide it looks from where its shape is seen, none if it was not. share: as above."""
        widths = [
            2 * np.tan(min(sight.half_width_rad, 1.0)) * sight.surface_m
            for _, sight in self.sights
            if sight.surface_m >= share * SHAPE_M
        ]
        return float(np.median(widths)) if widths else 0.0

    def by_size(self) -> tuple[Array, Array] | None:
        """Where its side is by how large it looked last, (2,), and its way there as seen then."""
        sized = [(here, s) for here, s in self.sights if s.sized and s.chance >= EVEN]
        if not sized:
            return None
        course = np.array([here.yaw_rad + sight.bearing_rad for here, sight in sized])
        side = np.abs(wrap_angle_rad(course - course[-1])) < _SIDE_RAD
        stood = np.array([here.xy_m for here, _ in sized])[side]
        range_m = np.array([sight.surface_m for _, sight in sized])
        away = (range_m * np.stack([np.cos(course), np.sin(course)])).T[side]
        return stood[-1] + by_growth(stood, away) * away[-1], away[-1]


class Candidates:
    """What looks around show that may be the goal, and what there turned out to be none."""

    def __init__(self, pilot: Pilot, goal: KnownGoal, log: Log) -> None:
        self.pilot, self.goal, self.log = pilot, goal, log
        self.candidates: list[Candidate] = []
        self._mistaken: list[tuple[Array, float]] = []  # where that was, and its surest sight
        self._blocked: list[Array] = []  # where no path led to it

    @property
    def likeliest(self) -> Candidate | None:
        """What may be the goal and is worth the way to it, the most likely one first."""
        config = self.pilot.config

        def is_worth_it(candidate: Candidate) -> bool:
            detour_m = candidate.place.range_m(self.pilot.here) + _START_M
            return candidate.chance >= min(config.likely, config.chance_per_m * detour_m)

        worth = [
            c
            for c in self.candidates
            if not self.was_mistaken(c.place, c.surest) and is_worth_it(c)
        ]
        return max(worth, key=lambda c: c.chance, default=None)

    def note(self, look: Look) -> Candidate | None:
        """Take in a look around; what may be the goal in it and was no mistake before."""
        here = self.pilot.here
        sight = self.goal.find(look, fair=self._is_fair)
        if sight is None or sight.chance < self.pilot.config.least_chance:
            return None
        for i, known in enumerate(self.candidates):
            if known.place.astray(sight.place(here)) < SAME_STD:
                self.candidates[i] = known.with_sight(here, sight)
                return self.candidates[i]
        self.candidates.append(Candidate.seen(here, sight))
        return self.candidates[-1]

    def was_mistaken(self, place: Estimate, chance: float = 0.0) -> bool:
        """Whether what is there looked like the goal and was something else.

        chance: of a sight of it; one that is far surer than all before makes it worth another try.
        """
        return any(
            self._is_near(xy_m, place) and chance <= at_odds(before, _SURER)
            for xy_m, before in self._mistaken
        )

    def is_blocked(self, place: Estimate) -> bool:
        """Whether no path led to what is there, which may be the goal all the same."""
        return self._was_blocked(place) and not self.was_mistaken(place)

    def _is_sure(self, candidate: Candidate) -> bool:
        return candidate.is_sure(self.pilot.config, self.goal.share)

    def _begin(self, candidate: Candidate) -> None:
        """It waits no longer: it is driven to."""
        self.candidates = [c for c in self.candidates if c.place is not candidate.place]
        bearing, range_m = candidate.place.seen_from(self.pilot.here)
        self.log(
            "approach", "the goal", len(self.pilot.looks) - 1,
            bearing_deg=round(float(np.degrees(bearing)), 1), range_m=round(range_m, 1),
            chance=round(candidate.chance, 2),
        )  # fmt: skip

    def _not_again(self, candidate: Candidate, refuted: bool = False) -> None:
        """Nothing there is the goal, or else it is tried once more."""
        if refuted or self._was_blocked(candidate.place):
            self._mistaken.append((candidate.place.xy_m, candidate.surest))
        else:
            self._blocked.append(candidate.place.xy_m)

    def _was_blocked(self, place: Estimate) -> bool:
        return any(self._is_near(xy_m, place) for xy_m in self._blocked)

    def _is_near(self, known_xy_m: Array, place: Estimate) -> bool:
        """Whether a place is one that is known, about."""
        within_m = self.goal.share * _MISTAKEN_M
        return bool(np.hypot(*(place.xy_m - known_xy_m)) < within_m)

    def _is_surer_elsewhere(self, place: Estimate, chance: float) -> bool:
        """Whether what is likeliest by the looks around is likelier than that, and not there."""
        other = self.likeliest
        return bool(other and other.chance > chance and not self._is_near(place.xy_m, other.place))

    def _is_fair(self, sight: GoalSight) -> bool:
        """Whether it is of nothing that only looks like the goal: behind that the goal may be."""
        return not self.was_mistaken(sight.place(self.pilot.here), sight.chance)


def _is_surest(sight: GoalSight, config: MissionConfig) -> bool:
    """Whether it looks like nothing but the goal, and shows enough of it, however plain."""
    rich = min(1.0, sight.n_shown / _RICH) if sight.n_shown else 1.0
    least = max(config.least_matches, config.surest_matches * rich)
    return sight.n_matches - BY_CHANCE >= least and sight.looks >= config.surest_looks


def by_growth(stood: Array, away: Array) -> float:
    """How many times as far a thing is as its size told, by how that grew on the way.

    stood, away: from where it was seen, and where it seemed to be from there, (n, 2) each. What
    seems to go back before the robot is larger than was supposed, what comes to meet it smaller:
    least squares for where it is and for that share, and the mean of what size and growth say, each
    as it is sure; or farther by as much as growth alone is sure of, two standard deviations less.
    """
    n = len(stood)
    if n < _GREW:
        return 1.0
    weight = np.repeat(1 / (_SIZE_STD_M + _SIZE_STD * np.hypot(*away.T)), 2)
    known = np.column_stack([np.tile(np.eye(2), (n, 1)), -away.ravel()]) * weight[:, None]
    asked = stood.ravel() * weight
    spread = np.linalg.pinv(known.T @ known)
    fitted = spread @ known.T @ asked
    off = float(((known @ fitted - asked) ** 2).sum()) / (2 * n - 3)
    share, variance = max(0.0, float(fitted[2])), max(1.0, off) * float(spread[2, 2])
    mean = (variance + _TAKEN_STD**2 * share) / (variance + _TAKEN_STD**2)
    return max(mean, share - 2 * variance**0.5)


def at_odds(chance: float, times: float) -> float:
    """A chance, at so many times its odds."""
    odds = times * chance  # against 1 - chance
    return odds / (odds + 1 - chance)


def about(xy_m: Array) -> Estimate:
    """A place known to some 2 m."""
    return Estimate(xy_m, 4.0 * np.eye(2))

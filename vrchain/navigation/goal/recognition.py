"""How a goal is recognised: what a robot knows of it by pictures alone, and finding it in a look.

Three things speak for a proposal being the goal: that it looks alike as a whole, how alike its
spots are to those of the pictures at about the same height above the ground, and that keypoints
agree with one of the pictures. Those on the goal itself: what stands before it stands elsewhere
too. A logistic regression weighs them, and how far the proposal is: from afar less can be alike.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property
from itertools import islice
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.landmarks.extraction.record import LandmarkRecord, examine, owners
from vrchain.landmarks.extraction.sift import Features, extract
from vrchain.landmarks.extraction.weights import SHIPPED
from vrchain.landmarks.matching.calibration import Calibration, load_calibration
from vrchain.landmarks.retrieval.query import Query, depth, query_of, subject, worth_of
from vrchain.landmarks.retrieval.template import (
    GOAL_MATCHES,
    LOWEST_SLOPE,
    Goal,
    Sighting,
    Template,
    locate,
    template_around,
)
from vrchain.navigation.driving.estimates import RANGE_STD, Array, Estimate, sighted
from vrchain.navigation.perception import Look, foot_m, surface_m
from vrchain.navigation.settings import GOAL_RANGE_M
from vrchain.panorama import Panorama

# Log-odds that a proposal is the goal: 1, looks, ten times how alike its spots are, log of its
# range over 15 m, root of keypoints beyond those that agree by chance. Fitted to what patrols
# published in suburbs of seeds 1310 and 1311, of 16 goals; in those of seeds 1334 and 1335, of 28
# goals, all 339 sights that are 0.8 sure by it were right.
_BELIEF = np.array([-24.2, 1.52, 2.09, 2.22, 1.54])
_AMONG = 3  # proposals looked at closely
BY_CHANCE = 4  # keypoints that agree by chance
_MANY, _LEAST_ODDS = 16, -3.0  # keypoints that agree beyond chance, which would not do either
# From how far pictures were taken is off by 6 % in suburbs of seed 1394, by 18 % in the Gazebo one;
# by the lower edge of the network's box, or its range, by 17 and 33 %.
_OUT_OF = 1.5  # what stands so many times too far or too near is something else
_SIZED_MATCHES, _SIZED_STD = 8, 0.15  # keypoints from which a size is told, and its error, a share
# What a wide thing shows is farther than its nearest side, by so much of half its width: in 272
# sights of 12 goals in suburbs of seed 1373. From 8 to 14 m its side was more than 2 m nearer than
# that in 22 %, and is in 6 %.
_BEYOND = 0.25
_PROMISE = 0.005, 0.5  # the chance by what shows from afar: it is never surer, nor sure of nothing
_WIDE_RAD = 0.15  # a goal's keypoints may lie so far beside its proposal


@dataclass(frozen=True)
class GoalSight:
    """A sight of what may be the goal, in the robot's frame.

    surface_m: how far its nearest side is; chance: that it is the goal.
    n_matches: keypoints that agree with one of its pictures, of n_shown that this shows on it.
    sized: whether its range is told by how large it looks against the pictures.
    """

    bearing_rad: float
    range_m: float
    surface_m: float
    half_width_rad: float
    n_matches: int
    looks: float
    chance: float
    sized: bool = False
    n_shown: int = 0

    def place(self, here: Pose) -> Estimate:
        """Where its nearest side is, seen from here."""
        range_std = _SIZED_STD if self.sized else RANGE_STD
        return sighted(here, self.bearing_rad, self.surface_m, self.half_width_rad, range_std)


def any_sight(sight: GoalSight) -> bool:
    """Every sight is fair: nothing is known that speaks against it."""
    return True


class KnownGoal(Protocol):
    """A goal that can be recognised."""

    @property
    def share(self) -> float:
        """Of 6 to 15 m, from how far it was pictured, and is looked at."""

    def find(
        self,
        look: Look,
        near_rad: float | None = None,
        window_rad: float = 0.4,
        fair: Callable[[GoalSight], bool] = any_sight,
    ) -> GoalSight | None:
        """The best fair sight of the goal, within a window around a bearing if one is given."""

    def promise(self, look: Look) -> Array:
        """The chance of each proposal that it is the goal, by what shows from afar: (n,)."""


@dataclass(frozen=True, eq=False)
class GoalPictures:
    """A goal as a robot knows it: what its pictures show, and the keypoints of each.

    keypoints: of what the pictures are framed on, without what stands before or beside it, which
    may stand elsewhere too. taken_m: from how far, about, each picture was taken; share: of 6 to
    15 m, from how far at most.
    """

    shown: Query
    keypoints: Goal
    calibration: Calibration
    taken_m: tuple[float, ...]
    share: float = 1.0

    def find(
        self,
        look: Look,
        near_rad: float | None = None,
        window_rad: float = 0.4,
        fair: Callable[[GoalSight], bool] = any_sight,
    ) -> GoalSight | None:
        """The best fair sight of the goal, within a window around a bearing if one is given."""
        p = look.proposals
        if len(p) == 0 or len(self.shown.embedding) == 0:
            return None
        worth = worth_of(*self._likeness(look))
        if near_rad is not None:
            half = (p.box[:, 1] - p.box[:, 0]) / 2
            off = np.abs(wrap_angle_rad((p.box[:, 0] + p.box[:, 1]) / 2 - near_rad))
            worth = np.where(off < half + window_rad, worth, -np.inf)
        in_order = np.argsort(-worth, kind="stable")
        sights = (self._sight(look, int(i)) for i in in_order if np.isfinite(worth[i]))
        return max(islice(filter(fair, sights), _AMONG), key=lambda s: s.chance, default=None)

    def promise(self, look: Look) -> Array:
        """By looks, spots and range; none for what is of no kind that its pictures show."""
        p = look.proposals
        odds = _odds_from_afar(*self._likeness(look), p.range_m)
        chance = (1 / (1 + np.exp(-odds))).clip(*_PROMISE)
        kinds = [r.proposals.kind[k] for r in self.shown.pictures if (k := subject(r)) is not None]
        return np.where(np.isin(p.kind, kinds) | (not kinds), chance, 0.0)

    @cached_property
    def _likeness(self) -> Callable[[Look], tuple[Array, Array]]:
        """Of each proposal of a look: how alike it looks, and its spots. One is asked for often."""
        shown = self.shown
        return cache(
            lambda look: (
                shown.appearance(look.proposals.embedding, self.calibration),
                shown.alike(look.proposals, look.spots),
            )
        )

    @cached_property
    def _sight(self) -> Callable[[Look, int], GoalSight]:
        return cache(self._sight_of)

    def _sight_of(self, look: Look, i: int) -> GoalSight:
        """Of a proposal, by how alike it looks, its spots, and its keypoints if they may decide."""
        looks, alike = (of[i] for of in self._likeness(look))
        left, right, *_ = look.proposals.box[i]
        bearing, half_rad = float((left + right) / 2), float((right - left) / 2)
        range_m = look.proposals.range_m[i]
        *_, by_keypoint = _BELIEF
        odds = float(_odds_from_afar(looks, alike, range_m))
        hopeless = odds + by_keypoint * np.sqrt(_MANY) < _LEAST_ODDS
        seen = dict[int, Sighting]()
        if not hopeless:
            near = look.features_near(bearing, half_rad + _WIDE_RAD)
            seen = _located(dict(enumerate(self.keypoints.templates)), near, BY_CHANCE + 1)
        matches, n_shown = max(
            ((s.n_matches, len(self.keypoints.templates[k].features)) for k, s in seen.items()),
            default=(0, 0),
        )
        odds += float(by_keypoint * np.sqrt(max(matches - BY_CHANCE, 0)))
        away_m = [
            self.taken_m[k] / s.scale for k, s in seen.items() if s.n_matches >= _SIZED_MATCHES
        ]
        side_m = surface_m(look, i)
        if away_m:
            side_m = float(np.median(away_m)) * (1 - _BEYOND * min(half_rad, 1.0))
        return GoalSight(
            float(wrap_angle_rad(bearing)), float(range_m), side_m, half_rad, matches,
            float(looks), float(1 / (1 + np.exp(-odds))), bool(away_m), n_shown,
        )  # fmt: skip


def _located(pictures: Mapping[int, Template], shown: Features, least: int) -> dict[int, Sighting]:
    """The goal by its keypoints, by the pictures that agree with what is shown in so many."""
    found = {k: locate(template, shown, min_matches=least) for k, template in pictures.items()}
    return {k: seen for k, seen in found.items() if seen is not None}


def _odds_from_afar(looks: ArrayLike, alike: ArrayLike, range_m: ArrayLike) -> Array:
    """Log-odds of being the goal without keypoints, by looks, how alike spots are, and range."""
    even, by_looks, by_spots, by_range, _ = _BELIEF
    spots = 10 * np.asarray(alike)
    return np.asarray(
        even + by_looks * np.asarray(looks) + by_spots * spots + by_range * depth(range_m)
    )


def goal_from(
    pictures: Sequence[Panorama], weights: Path = SHIPPED, share: float = 1.0
) -> GoalPictures:
    """A goal by single views that are framed on it, taken from that share of 6 to 15 m."""
    records, own, feet_m = list[LandmarkRecord](), list[Template](), list[float]()
    for picture in pictures:
        features = extract(picture)
        records.append(examine(picture, weights, features))
        # nearer by, the ground is seen lower
        above = LOWEST_SLOPE / share, np.inf
        shown = template_around(features, 0.0, picture.rig.span_rad / 2, above)
        template, far_m = _of_subject(shown, records[-1])
        own.append(template)
        feet_m.append(far_m)
    known, calibration = query_of(records), load_calibration(weights)
    taken_m = _taken_m(own, feet_m, share)
    return GoalPictures(known, Goal(tuple(own)), calibration, taken_m, share)


def _of_subject(template: Template, picture: LandmarkRecord) -> tuple[Template, float]:
    """Of a picture's keypoints those on what it is framed on, and how far that stands.

    All keypoints, and inf, if it cannot be told what it is framed on.
    """
    framed = subject(picture)
    if framed is None:
        return template, np.inf
    own = owners(picture.rig, picture.proposals, template.features) == framed
    return replace(template, features=template.features.take(own)), foot_m(picture, framed)


def _taken_m(
    templates: Sequence[Template], feet_m: Sequence[float], share: float
) -> tuple[float, ...]:
    """From how far pictures were taken: by where the goal stands in each.

    Where that does not show, by its size against pictures in which it does, else as is usual.
    """
    low_m, high_m = share * np.array(GOAL_RANGE_M)
    stands = {
        k: float(np.clip(far_m, low_m, high_m))
        for k, far_m in enumerate(feet_m)
        if low_m / _OUT_OF <= far_m <= high_m * _OUT_OF
    }

    def by_size_m(shown: Template) -> float:
        seen = _located({j: templates[j] for j in stands}, shown.features, GOAL_MATCHES)
        found_m = [stands[j] / s.scale for j, s in seen.items()]
        return float(np.clip(np.median(found_m or (low_m * high_m) ** 0.5), low_m, high_m))

    return tuple(stands[k] if k in stands else by_size_m(t) for k, t in enumerate(templates))

"""Homing by the epipolar geometry of matched keypoints, ours: the direction, how sure, how far.

Direction: where many matches agree on one pose (``landmarks.epipolar``), by that pose; else by all
that the matches make believe (``belief``), which is an answer with a large deviation where little
speaks for it. Cameras may be tilted (``landmarks.tilted``), and a compass is one more measurement.
How far: a point on the ground, one camera height h down, that is seen at slope t lies at range
h / -t, so two sights of it tell the way between them. What stands higher tells more than there is;
of the low points the nearer answers count, but not far below the median, since tiles repeat. What
is far away hardly moves, however far the robot goes: where too little of the ground is known again,
it does not say that it is there.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vrchain.geometry import wrap_angle_rad
from vrchain.homing.belief import believe, likeliest, of_peaks
from vrchain.homing.views import HomeVector, Views
from vrchain.landmarks.extraction.sift import Features, matches_and_ratios, root
from vrchain.landmarks.matching.epipolar import estimate
from vrchain.landmarks.matching.tilted import Compass, Likelihood, Peaks

Array = NDArray[np.float64]

_CLEAR_CHANCE = 0.7  # that a match which passes the ratio test is right
_RATIO, _CHANCE = (0.7, 0.8, 0.85, 0.9, 0.95, 1.0), (0.5, 0.3, 0.18, 0.1, 0.05, 0.025)
_MOST = 250  # matches that are heard where few are clear
_HALF = 0.5  # share of them that agree on a pose, to seek no other
_AROUND = 24  # directions from which others are sought
_SURE = 30.0  # log evidence of a pose that needs no rivals to be sought
_SECTORS, _LEAST_SECTORS = 12, 4  # of the view, and in how many matches agree for all to be right
_ONE_SIDE_RAD = 0.4  # deviation else: one thing may look like another one
_CERTAIN, _CERTAIN_SHARE = 10.0, 0.9  # evidence of a pose, and its share, to be certain of it
_LIKE_HOME = 0.1  # share of keypoints that clearly match at home
_LOW_SLOPE = -0.12  # what is seen lower, from both places, is near and mostly ground
_LEAST_LOW_POINTS = 3
_LOW_SHARE = 0.25  # the quantile of their answers that is believed
_OF_MEDIAN = 0.7  # if it is not less than this
_DEPTH_M = 20.0  # of half of what is around, where no ground is matched
_LEAST_DEPTH_M = 5.0  # half of what is around is farther, in rooms too


@dataclass(frozen=True)
class Epipolar:
    """arrived_m: nearer than this, the robot is home. tolerance_rad, min_inliers: as ``estimate``.

    only_sure: no answer unless many matches agree, which is soon known. most_error_rad: the mean
    error expected up to which there is an answer else; even chances have a quarter turn.
    most_tilt_rad: cameras tilted farther are not believed. compass_std_rad: of the compass, if any.
    camera_std_rad: what lenses and the joining of views add to a direction's deviation.
    """

    arrived_m: float = 0.15
    tolerance_rad: float = 0.003
    min_inliers: int = 8
    only_sure: bool = False
    most_error_rad: float = 1.3
    most_tilt_rad: float = 0.26
    compass_std_rad: float = 0.09
    camera_std_rad: float = 0.009

    def __call__(self, views: Views, heading_rad: float | None = None) -> HomeVector | None:
        """One step; None when the two views share too little, or are tilted too far."""
        compass = None if heading_rad is None else Compass(heading_rad, self.compass_std_rad)
        found = self._clear(views, compass)
        return found if found is not None or self.only_sure else self._doubtful(views, compass)

    def _clear(self, views: Views, compass: Compass | None) -> HomeVector | None:
        """The answer where many matches agree."""
        now, then = views.matched
        if len(now) < 2 * self.min_inliers or views.heading_rad is None:
            return None
        pose = estimate(now.directions, then.directions, self.min_inliers, self.tolerance_rad)
        if pose is not None and pose.inliers.mean() > _HALF:  # or, of what is far away, the reverse
            ways = np.array([pose.direction_rad, pose.direction_rad + np.pi])
            heading_rad = pose.heading_rad
        else:  # what is far away holds the heading, but any direction nearly as well
            ways = np.arange(_AROUND) * (2 * np.pi / _AROUND)
            heading_rad = views.heading_rad
        starts = np.column_stack([ways, ways - heading_rad])
        likelihood = _likelihood(now, then, np.full(len(now), _CLEAR_CHANCE), compass)
        belief = of_peaks(likeliest(likelihood, starts))
        agree = likelihood.agreeing(belief.peaks.poses[0], 2 * self.tolerance_rad)
        spread = _around(now.bearing_rad[agree])
        if belief.peaks.log_evidence[0] < _SURE or agree.mean() < _HALF or not spread:
            return None
        return self._answer(views, likelihood, belief.peaks, belief.best()[:2], True)

    def _doubtful(self, views: Views, compass: Compass | None) -> HomeVector | None:
        """The answer by all that any match makes believe."""
        now, then = views.current.features, views.home.features
        i, j, ratio = matches_and_ratios(root(now.descriptors), root(then.descriptors), np.inf)
        best = np.argsort(ratio, kind="stable")[:_MOST]
        now, then, ratio = now.take(i[best]), then.take(j[best]), ratio[best]
        if len(now) < self.min_inliers:
            return None
        likelihood = _likelihood(now, then, np.interp(ratio, _RATIO, _CHANCE), compass)
        belief = believe(likelihood, (now.bearing_rad, now.slope, then.bearing_rad, then.slope))
        direction, std_rad, error_rad = belief.best()
        sure = belief.share[0] > _CERTAIN_SHARE and belief.peaks.log_evidence[0] > _CERTAIN
        found = self._answer(views, likelihood, belief.peaks, (direction, std_rad), sure)
        if found is None:
            return None
        return found if found.arrived or error_rad <= self.most_error_rad else None

    def _answer(
        self,
        views: Views,
        likelihood: Likelihood,
        peaks: Peaks,
        found: tuple[float, float],
        sure: bool,
    ) -> HomeVector | None:
        """The direction and deviation found, with the distance by the likeliest pose."""
        if peaks.tilt_rad[0] > self.most_tilt_rad:
            return None
        pose = peaks.poses[0]
        agree = likelihood.agreeing(pose, 2 * self.tolerance_rad)
        a, b = (rays[agree] for rays in likelihood.upright(pose))
        besides_rad = 0.0 if _around(np.arctan2(a[:, 1], a[:, 0])) else _ONE_SIDE_RAD
        told = found[0], float(np.hypot(found[1], self.camera_std_rad + besides_rad))
        sides = [
            (np.arctan2(r[:, 1], r[:, 0]) - angle, r[:, 2] / np.hypot(r[:, 0], r[:, 1]))
            for r, angle in ((a, pose[0]), (b, pose[1]))
        ]
        (da, slope_a), (db, slope_b) = sides
        if not agree.any():
            return HomeVector(*told, 0, False, np.inf)
        heights = _distance_heights(da, slope_a, db, slope_b)
        parallax = float(np.median(np.abs(wrap_angle_rad(da - db))))
        if np.isnan(heights):
            distance_m = _DEPTH_M * parallax
        else:  # a pattern of the ground that repeats may tell that nothing has moved
            distance_m = max(views.home.camera_height_m * heights, _LEAST_DEPTH_M * parallax)
        fewer = min(len(views.current.features), len(views.home.features))
        alike = max(self.min_inliers, _LIKE_HOME * fewer) <= len(views.matched[0])
        arrived = bool(sure and alike and not np.isnan(heights) and distance_m <= self.arrived_m)
        return HomeVector(*told, int(agree.sum()), arrived, distance_m)


def _likelihood(
    now: Features, then: Features, chance: Array, compass: Compass | None
) -> Likelihood:
    growth = np.log(then.size_rad / now.size_rad)
    return Likelihood(now.rays, then.rays, growth, chance, compass)


def _around(bearing_rad: Array) -> bool:
    """Whether they are so many ways that they cannot all be of one thing."""
    return len(np.unique(bearing_rad // (2 * np.pi / _SECTORS))) >= _LEAST_SECTORS


def _distance_heights(da: Array, t_a: Array, db: Array, t_b: Array) -> float:
    """How far home is, in heights of the camera; NaN where too little of the ground is matched."""
    low = (t_a < _LOW_SLOPE) & (t_b < _LOW_SLOPE)
    if low.sum() < _LEAST_LOW_POINTS:
        return np.nan
    along = np.cos(db[low]) / t_b[low] - np.cos(da[low]) / t_a[low]
    nearer, median = np.quantile(along, (_LOW_SHARE, 0.5))
    return float(max(0.0, nearer, _OF_MEDIAN * median))

"""Homing by the planar epipolar geometry of matched bearings, ours: the direction, and how far.

Direction: ``landmarks.epipolar``; with a compass the same constraint, of which one angle remains
unknown. How far: a point on the ground, one camera height h down, that is seen at slope t lies at
range h / -t, so two sights of it tell the way between them. What stands higher tells more than
there is; of the low points the nearer answers count.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vrchain.geometry import wrap_angle_rad
from vrchain.homing.views import HomeVector, Views
from vrchain.landmarks.extraction.sift import Features
from vrchain.landmarks.matching.epipolar import estimate, one_point, sampson

Array = NDArray[np.float64]

_COURSES = 360  # directions tried when a compass leaves no other unknown
_POLISH_STEPS = 5
_LOW_SLOPE = -0.12  # what is seen lower, from both places, is near and mostly ground
_LEAST_LOW_POINTS = 7
_LOW_SHARE = 0.25  # the quantile of their answers that is believed
_DEPTH_M = 20.0  # of half of what is around, where no ground is matched
_LEAST_DEPTH_M = 8.0  # half of what is around is farther


@dataclass(frozen=True)
class Epipolar:
    """arrived_m: nearer than this, the robot is home. The others as for ``estimate``."""

    arrived_m: float = 0.15
    tolerance_rad: float = 0.003
    min_inliers: int = 8

    def __call__(self, views: Views, heading_rad: float | None = None) -> HomeVector | None:
        """One step; None when the two views share too little."""
        now, then = views.matched
        found = self._geometry(now, then, heading_rad)
        if found is None:
            return None
        direction, heading, std_rad, inliers = found
        a, b = now.take(inliers), then.take(inliers)
        da = a.bearing_rad - direction
        db = b.bearing_rad + heading - direction
        heights = _distance_heights(da, a.slope, db, b.slope)
        parallax = float(np.median(np.abs(wrap_angle_rad(da - db))))
        if np.isnan(heights):
            distance_m = _DEPTH_M * parallax
        else:  # a pattern of the ground that repeats may tell that nothing has moved
            distance_m = max(views.home.camera_height_m * heights, _LEAST_DEPTH_M * parallax)
        arrived = distance_m <= self.arrived_m
        return HomeVector(direction, std_rad, len(a), arrived, distance_m)

    def _geometry(
        self, now: Features, then: Features, heading_rad: float | None
    ) -> tuple[float, float, float, NDArray[np.bool_]] | None:
        """Home's direction and heading, the direction's deviation, and the matches that agree."""
        limits = self.min_inliers, self.tolerance_rad
        if heading_rad is not None:
            beta = then.bearing_rad + heading_rad
            found = _direction(now.bearing_rad, now.slope, beta, then.slope, *limits)
            return found and (found[0], heading_rad, *found[1:])
        g = estimate(now.directions, then.directions, *limits)
        if g is None:
            return None
        return g.direction_rad, g.heading_rad, g.direction_std_rad, g.inliers


def _direction(
    alpha: Array, t_a: Array, beta: Array, t_b: Array, min_inliers: int, tolerance_rad: float
) -> tuple[float, float, NDArray[np.bool_]] | None:
    """Direction of home, its deviation and the inliers, bearings counted from one heading."""
    if len(alpha) < max(1, min_inliers):
        return None
    courses = 2 * np.pi * np.arange(_COURSES)[:, None] / _COURSES
    course = float(courses[_agree(alpha - courses, t_a, beta - courses, t_b, tolerance_rad)
                           .sum(axis=1).argmax(), 0])  # fmt: skip
    std_rad = np.inf
    for _ in range(_POLISH_STEPS):
        inliers = _agree(alpha - course, t_a, beta - course, t_b, tolerance_rad)
        if inliers.sum() < min_inliers:
            return None
        da, ta, db, tb = (x[inliers] for x in (alpha - course, t_a, beta - course, t_b))
        residual, scale = sampson(da, ta, db, tb)
        slope = (ta * np.cos(db) - tb * np.cos(da)) / scale
        information = float(slope @ slope) + 1e-12
        course += float(np.clip(-(slope @ residual) / information, -0.1, 0.1))
        variance = float(residual @ residual) / max(1, len(residual) - 1)
        std_rad = float(np.sqrt(variance / information))
    inliers = _agree(alpha - course, t_a, beta - course, t_b, tolerance_rad)
    if inliers.sum() < min_inliers:
        return None
    return float(wrap_angle_rad(course)), std_rad, inliers


def _agree(da: Array, t_a: Array, db: Array, t_b: Array, tolerance_rad: float) -> NDArray[np.bool_]:
    """Matches near the constraint whose point lies in front of both."""
    return one_point(np.sin(da), np.cos(da), t_a, np.sin(db), np.cos(db), t_b, tolerance_rad)


def _distance_heights(da: Array, t_a: Array, db: Array, t_b: Array) -> float:
    """How far home is, in heights of the camera; NaN where too little of the ground is matched."""
    low = (t_a < _LOW_SLOPE) & (t_b < _LOW_SLOPE)
    if low.sum() < _LEAST_LOW_POINTS:
        return np.nan
    along = np.cos(db[low]) / t_b[low] - np.cos(da[low]) / t_a[low]
    return max(0.0, float(np.quantile(along, _LOW_SHARE)))

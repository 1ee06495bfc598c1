"""Recognising one landmark, seen before, in a new panorama; tracking it from view to view."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vrchain.geometry import wrap_angle_rad
from vrchain.landmarks.extraction.sift import Features, extract, mutual_matches
from vrchain.panorama import Panorama
from vrchain.seeding import generator

Array = NDArray[np.float64]

RATIO = 0.85  # nearest over second nearest descriptor distance
_SAMPLES = 400
_TOLERANCE_RAD = 0.02  # the model below is flat, landmarks are not
# Of 97 panoramas without the goal (suburbs of seeds 1000, 1001) one had 12 matches, none more;
# of goals in view, over 8 degrees wide and within 25 m, three quarters have 15.
GOAL_MATCHES = 15
LOWEST_SLOPE = -0.12  # what lies lower is ground, mostly
_SQUEEZE = (0.25, 2.0)  # width against height of a landmark, seen anew, over the same as stored


@dataclass(frozen=True, eq=False)
class Template:
    """A landmark as it was seen once: its keypoints, bearings counted from its middle."""

    features: Features
    half_width_rad: float


@dataclass(frozen=True)
class Sighting:
    """A landmark recognised.

    bearing_rad: its middle. scale: how many times taller it looks than in the template, so how
    many times nearer it is. half_width_rad: how wide it looks. n_matches: how many agree.
    """

    bearing_rad: float
    scale: float
    half_width_rad: float
    n_matches: int


def template_around(
    features: Features,
    bearing_rad: float,
    half_width_rad: float,
    slopes: tuple[float, float] = (-np.inf, np.inf),
) -> Template:
    """The keypoints around a bearing, as a template to recognise the same thing by."""
    offset = wrap_angle_rad(features.bearing_rad - bearing_rad)
    inside = (np.abs(offset) <= half_width_rad) & (features.slope >= slopes[0])
    inside &= features.slope <= slopes[1]
    return Template(replace(features, bearing_rad=offset).take(inside), half_width_rad)


def locate(
    template: Template,
    current: Features,
    near_rad: float | None = None,
    window_rad: float = np.pi,
    min_matches: int = 5,
    ratio: float = RATIO,
) -> Sighting | None:
    """Find a template in the current features; None if fewer than ``min_matches`` agree.

    Drawing nearer, slopes grow by one factor and bearing offsets by another (an oblique front is
    squeezed): found by RANSAC over pairs of matches. ``near_rad`` limits the search to
    ``window_rad`` around a bearing, as when tracking from view to view.
    """
    if near_rad is not None:
        current = current.near(near_rad, window_rad)
    i, j = mutual_matches(template.features.descriptors, current.descriptors, ratio)
    if len(i) < min_matches:
        return None
    offset, stored_slope = template.features.bearing_rad[i], template.features.slope[i]
    bearing, slope = current.bearing_rad[j], current.slope[j]
    p, q = generator(0, "locate", len(i)).integers(0, len(i), (2, _SAMPLES))
    gap = offset[p] - offset[q]
    p, q, gap = (x[np.abs(gap) > 0.005] for x in (p, q, gap))
    widening = wrap_angle_rad(bearing[p] - bearing[q]) / gap
    middle = bearing[p] - widening * offset[p]
    square = stored_slope[p] ** 2 + stored_slope[q] ** 2
    scale = (stored_slope[p] * slope[p] + stored_slope[q] * slope[q]) / np.maximum(square, 1e-12)
    scale = np.where(square > 4e-4, scale, widening)  # at the horizon slopes tell no scale
    low, high = _SQUEEZE
    fair = (scale > 0.1) & (scale < 10) & (widening > low * scale) & (widening < high * scale)
    middle, widening, scale = middle[fair], widening[fair], scale[fair]
    if len(middle) == 0:
        return None
    tolerance = _TOLERANCE_RAD * np.maximum(1.0, scale)[:, None]
    astray = np.abs(wrap_angle_rad(bearing - middle[:, None] - widening[:, None] * offset))
    agree = (astray < tolerance) & (np.abs(slope - scale[:, None] * stored_slope) < tolerance)
    counts = agree.sum(axis=1)
    best = int(counts.argmax())
    if counts[best] < min_matches:
        return None
    own = agree[best]
    return _settle(
        template, offset[own], stored_slope[own], bearing[own], slope[own],
        float(middle[best]), float(scale[best]),
    )  # fmt: skip


def _settle(
    template: Template,
    offset: Array,
    stored_slope: Array,
    bearing: Array,
    slope: Array,
    middle_rad: float,
    scale: float,
) -> Sighting | None:
    """The sighting that all inliers agree on, by least squares; the pair's own is a rough one."""
    away = wrap_angle_rad(bearing - middle_rad)
    spread = offset - offset.mean()
    widening = float((spread @ (away - away.mean())) / max(float(spread @ spread), 1e-9))
    middle = middle_rad + float(away.mean() - widening * offset.mean())
    square = float(stored_slope @ stored_slope)
    if square > 4e-4 * len(offset):
        scale = float(stored_slope @ slope) / square
    if scale <= 0 or widening <= 0:
        return None
    half_width = template.half_width_rad * widening
    return Sighting(float(wrap_angle_rad(middle)), scale, half_width, len(offset))


@dataclass(frozen=True, eq=False)
class Goal:
    """What to find: templates, one a picture. A robot knows nothing else about its goal."""

    templates: tuple[Template, ...]


def goal_of(pictures: Sequence[Panorama]) -> Goal:
    """A goal from single views that it fills: all their keypoints above the ground count."""
    upright = LOWEST_SLOPE, np.inf
    return Goal(
        tuple(template_around(extract(p), 0.0, p.rig.span_rad / 2, upright) for p in pictures)
    )


def find_goal(goal: Goal, current: Features, min_matches: int = GOAL_MATCHES) -> Sighting | None:
    """The goal in a panorama by the picture that agrees best, or None."""
    sightings = [locate(t, current, min_matches=min_matches) for t in goal.templates]
    return max((s for s in sightings if s), key=lambda s: s.n_matches, default=None)

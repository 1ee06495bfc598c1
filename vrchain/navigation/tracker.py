"""Keeping a landmark in sight while driving towards it, and judging how near it is."""

from collections.abc import Sequence

import numpy as np

from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.landmarks.recognition import LOWEST_SLOPE, Sighting, Template, locate, template_around
from vrchain.landmarks.sift import Features

_WINDOW_RAD = 0.5  # from one look to the next a landmark's bearing changes less
_LEAST_WAY_M = 1.5  # before which growth tells nothing
_DOUBT = 2.0  # scale is a rough measure


class Tracker:
    """Follows a landmark from view to view.

    The pictures of it that one started with are trusted most; between them, and when the robot
    has come too near for them, the newest view of it serves as the next picture.

    bearing_rad: where it was last seen. growth: how many times larger it looks than at the start.
    lost: looks since it was seen. best_matches: for each picture the most keypoints that agreed.
    """

    def __init__(
        self,
        templates: Sequence[Template],
        min_matches: int,
        sighting: Sighting,
        features: Features,
        here: Pose,
    ) -> None:
        self.templates, self._min_matches = templates, min_matches
        self.bearing_rad, self.growth, self.lost = sighting.bearing_rad, 1.0, 0
        self.best_matches = [0] * len(templates)
        self._start, self._yaw_rad = here, here.yaw_rad
        self._track = sighting_template(features, sighting)
        self._first: dict[int, tuple[float, float]] = {}  # picture -> its scale, growth then
        self.update(features, here)

    def turn_to(self, here: Pose) -> float:
        """The bearing of the landmark now that the robot's odometry reads ``here``."""
        self.bearing_rad = float(wrap_angle_rad(self.bearing_rad + self._yaw_rad - here.yaw_rad))
        self._yaw_rad = here.yaw_rad
        return self.bearing_rad

    def update(self, features: Features, here: Pose) -> bool:
        """Take in a new look; whether the landmark is in it."""
        near_rad = self.turn_to(here)
        seen = self._by_picture(features, near_rad)
        if seen is None:
            seen = locate(self._track, features, near_rad, _WINDOW_RAD)
            self.growth *= seen.scale if seen is not None else 1.0
        self.lost = 0 if seen is not None else self.lost + 1
        if seen is None:
            return False
        self.bearing_rad = seen.bearing_rad
        self._track = sighting_template(features, seen)
        return True

    def may_be_within(self, range_m: float, here: Pose) -> bool:
        """Whether the landmark can be so near.

        A thing that looks g times larger after a way D towards it is D / (g - 1) away: so an
        obstacle in the way is not taken for the landmark behind it.
        """
        way_m = here.distance_to_m(self._start.xy_m)
        return way_m >= _LEAST_WAY_M and way_m <= (self.growth - 1) * range_m * _DOUBT

    def _by_picture(self, features: Features, near_rad: float) -> Sighting | None:
        found = best_sighting(self.templates, features, self._min_matches, near_rad)
        if found is None:
            return None
        picture, seen = found
        scale, growth = self._first.setdefault(picture, (seen.scale, self.growth))
        self.growth = growth * seen.scale / scale
        self.best_matches[picture] = max(self.best_matches[picture], seen.n_matches)
        return seen


def best_sighting(
    templates: Sequence[Template],
    features: Features,
    min_matches: int,
    near_rad: float | None = None,
) -> tuple[int, Sighting] | None:
    """The picture (its index) with most matches, and where it says the landmark is."""
    found = [
        (index, seen)
        for index, template in enumerate(templates)
        if (seen := locate(template, features, near_rad, _WINDOW_RAD, min_matches)) is not None
    ]
    return max(found, key=lambda pair: pair[1].n_matches, default=None)


def sighting_template(features: Features, sighting: Sighting) -> Template:
    """What is seen now, as the next picture to recognise it by."""
    half_width = float(np.clip(sighting.half_width_rad, 0.05, 0.6))
    return template_around(features, sighting.bearing_rad, half_width, (LOWEST_SLOPE, np.inf))

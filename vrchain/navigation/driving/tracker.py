"""Keeping in mind what is driven to: where it is, and whether a view shows it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.landmarks.matching.calibration import Calibration
from vrchain.navigation.driving.estimates import Estimate, sighted
from vrchain.navigation.perception import Look

_ASTRAY = 3.0  # standard deviations from where it is believed to be
_LEAST = 0.0  # log-likelihood ratio of looks and place from which it is taken for the landmark


@dataclass(eq=False)
class Tracker:
    """A landmark, or a mere place, that is driven to.

    place: where it is believed to be; embedding: (k, d) of how it was seen, none of a mere place;
    seen: sights of it, and missed: looks since the last one.
    """

    name: str
    place: Estimate
    embedding: NDArray[np.float32]
    calibration: Calibration
    seen: int = 0
    missed: int = 0

    @classmethod
    def of_place(cls, name: str, place: Estimate, calibration: Calibration) -> "Tracker":
        """A mere place."""
        return cls(name, place, np.empty((0, 0), dtype=np.float32), calibration)

    def moved(self, way_m: float) -> None:
        """The robot has driven so far: odometry has drifted."""
        self.place = self.place.after(way_m)

    def update(self, look: Look, here: Pose) -> bool:
        """Take in a look that should show it; whether it does."""
        if len(self.embedding) == 0:
            return False
        best = self._best(look, here)
        if best is None:
            self.missed += 1
            return False
        index, sight = best
        self.place = self.place.with_sight(sight)
        self.embedding = np.vstack([self.embedding[:4], look.proposals.embedding[index]])
        self.seen, self.missed = self.seen + 1, 0
        return True

    def _best(self, look: Look, here: Pose) -> tuple[int, Estimate] | None:
        p = look.proposals
        if len(p) == 0:
            return None
        looks = self.calibration.appearance((p.embedding @ self.embedding.T).max(axis=1))
        found = []
        for i in np.flatnonzero(looks > -1.0):
            bearing, range_m = float(wrap_angle_rad(p.bearing_rad[i])), float(p.range_m[i])
            sight = sighted(here, bearing, range_m)
            astray = self.place.astray(sight)
            if astray <= _ASTRAY:
                found.append((float(looks[i]) + 1.0 - astray**2 / 2, int(i), sight))
        worth, index, sight = max(found, key=lambda f: f[0], default=(_LEAST, -1, self.place))
        return (index, sight) if worth > _LEAST else None

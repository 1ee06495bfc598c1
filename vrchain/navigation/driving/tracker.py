"""Keeping in mind what is driven to: where it is, and whether a view shows it."""

from dataclasses import dataclass, field

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
    calibration: Calibration
    embedding: NDArray[np.float32] = field(
        default_factory=lambda: np.empty((0, 0), dtype=np.float32)
    )
    seen: int = 0
    missed: int = 0

    def update(self, look: Look, here: Pose) -> None:
        """Take in a look that should show it."""
        if len(self.embedding) == 0:
            return
        worth, index, sight = max(
            self._sights(look, here), key=lambda found: found[0], default=(_LEAST, -1, self.place)
        )
        if worth <= _LEAST:
            self.missed += 1
            return
        self.place = self.place.with_sight(sight)
        self.embedding = np.vstack([self.embedding[:4], look.proposals.embedding[index]])
        self.seen, self.missed = self.seen + 1, 0

    def _sights(self, look: Look, here: Pose) -> list[tuple[float, int, Estimate]]:
        """Proposals that may be it: how much speaks for each, its index, and where it is."""
        p, found = look.proposals, list[tuple[float, int, Estimate]]()
        if len(p) == 0:
            return found
        looks = self.calibration.appearance((p.embedding @ self.embedding.T).max(axis=1))
        for i in np.flatnonzero(looks > -1.0):
            bearing, range_m = float(wrap_angle_rad(p.bearing_rad[i])), float(p.range_m[i])
            sight = sighted(here, bearing, range_m)
            astray = self.place.astray(sight)
            if astray <= _ASTRAY:
                found.append((float(looks[i]) + 1.0 - astray**2 / 2, int(i), sight))
        return found

"""Eyes that see nothing."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from plains import CALIBRATION
from sights import RIG

from vrchain.landmarks.extraction.proposer import nothing
from vrchain.landmarks.extraction.record import LandmarkRecord
from vrchain.landmarks.extraction.sift import NO_FEATURES
from vrchain.landmarks.matching.common import Comparison
from vrchain.navigation.perception import Look, Perception


def blind(*weights: Path) -> Perception:
    """In place of ``learned_perception``."""
    record = LandmarkRecord(RIG, "ab" * 32, nothing(), NO_FEATURES)
    look = Look(RIG, nothing(), lambda: NO_FEATURES, record=record)
    return Perception(
        lambda s: look, lambda *s: look, lambda a, b: Comparison((), None), CALIBRATION
    )


class Nowhere:
    """A goal that nothing is."""

    share = 1.0

    def find(self, *look: Any, **more: Any) -> None:
        """Nothing is the goal,"""

    def promise(self, look: Look) -> NDArray[np.float64]:
        """and nothing looks like it."""
        return np.zeros(len(look.proposals))

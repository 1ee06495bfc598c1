"""Whether two panoramas were joined rightly, told by all their claims at once.

Of panoramas far apart, or of two suburbs, a wrong relative pose is sometimes found, and the more
proposals there are, the more claims under it; it mostly says that they are near to each other, but
then they would have much more in common.
"""

import numpy as np
from numpy.typing import ArrayLike

from vrchain.landmarks.matching.epipolar import PlanarGeometry

LEAST_CLAIM = 0.3  # score from which claims are heard
# Claims a proposal, all of them sure, of panoramas joined rightly half the time, and how steeply
# that chance rises: logistic regression on 955 pairs of seed 1003.
_FEW, _STEEP = 0.04, 3.4
_NEAR_HEIGHTS = 20.0  # at shorter distances, in camera heights, each claim counts for less


def chance_joined(scores: ArrayLike, n_proposals: int, geometry: PlanarGeometry | None) -> float:
    """The chance that two panoramas were joined rightly.

    scores: of claims from ``LEAST_CLAIM`` on; n_proposals: of the panorama that has fewer.
    """
    heights = np.inf if geometry is None else geometry.baseline_heights
    counted = min(1.0, 0.15 + heights / _NEAR_HEIGHTS) if np.isfinite(heights) else 1.0
    speaks = counted * float((np.asarray(scores, dtype=float) ** 2).sum())
    few = max(_FEW * n_proposals, 1e-9)
    return float(1.0 / (1.0 + (few / speaks) ** _STEEP)) if speaks > 0 else 0.0

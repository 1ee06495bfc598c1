"""How likely a claim is right, and two panoramas joined rightly, learned from suburbs for choosing.

Logistic regression on what speaks for a claim. The coefficients are shipped beside the weights.
"""

import json
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize

from vrchain.errors import LearnedError
from vrchain.landmarks.extraction.weights import SHIPPED
from vrchain.landmarks.matching.epipolar import PlanarGeometry

Array = NDArray[np.float64]

LEAST_CLAIM = 0.3  # score from which claims are heard
# Claims a proposal, all of them sure, of panoramas joined rightly half the time, and how steeply
# that chance rises: logistic regression on 955 pairs of seed 1003.
_FEW, _STEEP = 0.04, 3.4
_NEAR_HEIGHTS = 20.0  # at shorter distances, in camera heights, each claim counts for less
_PENALTY = 1e-3


@dataclass(frozen=True, eq=False)
class Logistic:
    """mean, spread: (features,) of what was learned from; weight: (features,); bias."""

    mean: Array
    spread: Array
    weight: Array
    bias: float

    def probability(self, features: Array) -> Array:
        """That claims, (n, features), are right: (n,)."""
        z = (features - self.mean) / self.spread @ self.weight + self.bias
        return np.asarray(1 / (1 + np.exp(-z)))


@dataclass(frozen=True, eq=False)
class Calibration:
    """What cosines and claims of a network are worth.

    alike_scale: log-odds of being the same landmark a unit of cosine; alike_even: the cosine at
    which appearance alone says neither yes nor no; claims: by variant, how likely a claim is right.
    """

    alike_scale: float
    alike_even: float
    claims: dict[str, Logistic]

    def appearance(self, cosine: NDArray[np.floating]) -> Array:
        """Log-likelihood ratio of being the same landmark, by appearance alone, of cosines."""
        return np.asarray(self.alike_scale * (cosine.astype(float) - self.alike_even))


def fit(features: Array, right: NDArray[np.bool_]) -> Logistic:
    """What explains best which claims, (n, features), were right, (n,)."""
    mean, spread = features.mean(axis=0), np.maximum(features.std(axis=0), 1e-6)
    x, sign = (features - mean) / spread, np.where(right, 1.0, -1.0)

    def loss(w: Array) -> tuple[float, Array]:
        margin = sign * (x @ w[:-1] + w[-1])
        pull = -sign / (1 + np.exp(margin.clip(-500, 500))) / len(x)
        value = np.logaddexp(0, -margin).mean() + _PENALTY * (w[:-1] @ w[:-1])
        return float(value), np.r_[x.T @ pull + 2 * _PENALTY * w[:-1], pull.sum()]

    found = minimize(loss, np.zeros(x.shape[1] + 1), jac=True, method="L-BFGS-B").x
    return Logistic(mean, spread, found[:-1], float(found[-1]))


def expected_calibration_error(score: Array, right: NDArray[np.bool_], bins: int = 10) -> float:
    """Mean distance of score and share right over bins of equal width, weighted by their claims."""
    place = np.minimum((score * bins).astype(int), bins - 1)
    gaps = [
        (place == k).mean() * abs(score[place == k].mean() - right[place == k].mean())
        for k in np.unique(place)
    ]
    return float(np.sum(gaps))


def chance_joined(scores: ArrayLike, n_proposals: int, geometry: PlanarGeometry | None) -> float:
    """The chance that two panoramas were joined rightly, told by all their claims at once.

    Of panoramas far apart, or of two suburbs, a wrong relative pose is sometimes found, and the
    more proposals there are, the more claims under it; it mostly says that they are near to each
    other, but then they would have much more in common. scores: of claims from ``LEAST_CLAIM`` on;
    n_proposals: of the panorama that has fewer.
    """
    heights = np.inf if geometry is None else geometry.baseline_heights
    counted = min(1.0, 0.15 + heights / _NEAR_HEIGHTS) if np.isfinite(heights) else 1.0
    speaks = counted * float((np.asarray(scores, dtype=float) ** 2).sum())
    few = max(_FEW * n_proposals, 1e-9)
    return float(1.0 / (1.0 + (few / speaks) ** _STEEP)) if speaks > 0 else 0.0


def to_json(calibration: Calibration) -> dict[str, Any]:
    """The calibration as numbers and lists."""
    claims = {
        name: {key: np.asarray(value).tolist() for key, value in vars(logistic).items()}
        for name, logistic in calibration.claims.items()
    }
    return {**vars(calibration), "claims": claims}


@lru_cache(maxsize=4)
def load_calibration(weights: Path = SHIPPED) -> Calibration:
    """The calibration kept beside a weights file; LearnedError if there is none."""
    file = weights.with_suffix(".json")
    try:
        stored = json.loads(file.read_text(encoding="utf-8"))["calibration"]
        claims = {name: _logistic(table) for name, table in stored["claims"].items()}
        return Calibration(float(stored["alike_scale"]), float(stored["alike_even"]), claims)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise LearnedError(
            f"{file} holds no calibration ({type(error).__name__}): make it by `vrchain train`"
        ) from error


def _logistic(table: dict[str, Any]) -> Logistic:
    mean, spread, weight = (np.array(table[k], dtype=float) for k in ("mean", "spread", "weight"))
    return Logistic(mean, spread, weight, float(table["bias"]))

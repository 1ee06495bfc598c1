"""How likely a claim is right, and two panoramas joined rightly, learned from suburbs for choosing.

Logistic regression on what speaks for a claim, at the end on products of two signs as well. The
coefficients are shipped beside the weights.
"""

import json
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from vrchain.errors import LearnedError
from vrchain.landmarks.extraction.weights import SHIPPED

Array = NDArray[np.float64]

_PENALTY, _PENALTY_OF_PRODUCTS = 1e-4, 1e-2
_USUAL = 3.0  # standard deviations, within which signs are taken before they are multiplied


@dataclass(frozen=True, eq=False)
class Logistic:
    """mean, spread: (features,) of what was learned from; bias.

    weight: (features,), or longer: then of ``with_products`` of them.
    """

    mean: Array
    spread: Array
    weight: Array
    bias: float

    def probability(self, features: Array) -> Array:
        """That claims, (n, features), are right: (n,)."""
        return np.asarray(1 / (1 + np.exp(-self.log_odds(features).clip(-500, 500))))

    def log_odds(self, features: Array) -> Array:
        """The same as log-odds."""
        signs = (features - self.mean) / self.spread
        if len(self.weight) > len(self.mean):
            signs = with_products(signs)
        return np.asarray(signs @ self.weight + self.bias)


def with_products(signs: Array) -> Array:
    """Standardized signs (n, k) and the products of any two: (n, k + k (k + 1) / 2)."""
    signs = signs.clip(-_USUAL, _USUAL)
    i, j = np.triu_indices(signs.shape[1])
    return np.column_stack([signs, signs[:, i] * signs[:, j]])


@dataclass(frozen=True, eq=False)
class Worth:
    """How likely something is right, by what speaks for it, in one variant.

    poses: a relative pose, by the matches alone; claims: a joined pair of proposals; joined: the
    pose once claims are made under it; settled: a joined pair once its pose is kept; groups: a
    group of keypoints that agree on it.
    """

    poses: Logistic
    claims: Logistic
    joined: Logistic
    settled: Logistic
    groups: Logistic


@dataclass(frozen=True, eq=False)
class Calibration:
    """What cosines and claims of a network are worth.

    alike_scale: log-odds of being the same landmark a unit of cosine; alike_even: the cosine at
    which appearance alone says neither yes nor no; worth: by variant.
    """

    alike_scale: float
    alike_even: float
    worth: dict[str, Worth] = field(default_factory=dict)

    def of(self, variant: str) -> Worth:
        """What is known of a variant. LearnedError if nothing is."""
        if variant not in self.worth:
            raise LearnedError(f"no calibration for {variant!r}: there is {', '.join(self.worth)}")
        return self.worth[variant]

    def appearance(self, cosine: NDArray[np.floating]) -> Array:
        """Log-likelihood ratio of being the same landmark, by appearance alone, of cosines."""
        return np.asarray(self.alike_scale * (cosine.astype(float) - self.alike_even))


def fit(features: Array, right: NDArray[np.bool_], products: bool = False) -> Logistic:
    """What explains best which claims, (n, features), were right, (n,).

    products: by those of any two features too.
    """
    mean, spread = features.mean(axis=0), np.maximum(features.std(axis=0), 1e-6)
    x, sign = (features - mean) / spread, np.where(right, 1.0, -1.0)
    penalty = _PENALTY
    if products:
        x, penalty = with_products(x), _PENALTY_OF_PRODUCTS

    def loss(w: Array) -> tuple[float, Array]:
        margin = sign * (x @ w[:-1] + w[-1])
        pull = -sign / (1 + np.exp(margin.clip(-500, 500))) / len(x)
        value = np.logaddexp(0, -margin).mean() + penalty * (w[:-1] @ w[:-1])
        return float(value), np.r_[x.T @ pull + 2 * penalty * w[:-1], pull.sum()]

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


def to_json(calibration: Calibration) -> dict[str, Any]:
    """The calibration as numbers and lists."""
    worth = {
        name: {
            what: {key: np.asarray(value).tolist() for key, value in vars(logistic).items()}
            for what, logistic in vars(one).items()
        }
        for name, one in calibration.worth.items()
    }
    return {**vars(calibration), "worth": worth}


@lru_cache(maxsize=4)
def load_calibration(weights: Path = SHIPPED) -> Calibration:
    """The calibration kept beside a weights file; LearnedError if there is none."""
    file = weights.with_suffix(".json")
    try:
        stored = json.loads(file.read_text(encoding="utf-8"))["calibration"]
        worth = {
            name: Worth(**{what: _logistic(table) for what, table in tables.items()})
            for name, tables in stored["worth"].items()
        }
        return Calibration(float(stored["alike_scale"]), float(stored["alike_even"]), worth)
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise LearnedError(
            f"{file} holds no calibration ({type(error).__name__}): make it by `vrchain train`"
        ) from error


def _logistic(table: dict[str, Any]) -> Logistic:
    mean, spread, weight = (np.array(table[k], dtype=float) for k in ("mean", "spread", "weight"))
    return Logistic(mean, spread, weight, float(table["bias"]))

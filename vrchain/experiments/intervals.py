"""Shares of sums over suburbs, and their 95 % intervals: bootstrap over suburbs."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from vrchain.seeding import generator

_RESAMPLED = 1000
_INTERVAL = (0.025, 0.975)


def resampled(n: int, seed: int, what: str) -> NDArray[np.int64]:
    """Which of n suburbs are drawn, with replacement: (draws, n)."""
    return generator(seed, "bootstrap", what).integers(n, size=(_RESAMPLED, n))


def by_suburb(values: pd.Series, of: pd.Series, suburbs: NDArray[np.int64]) -> NDArray[np.float64]:
    """Sums of values, each ``of`` a suburb: (suburbs,)."""
    summed = values.astype(float).groupby(of).sum()
    return np.asarray(summed.reindex(suburbs).fillna(0), dtype=float)


def ratio(
    name: str, top: NDArray[np.float64], bottom: NDArray[np.float64], again: NDArray[np.int64]
) -> dict[str, object]:
    """NAME: top over bottom, (suburbs,) each; NAME_ci: its interval; None: nothing to divide by.

    again: what ``resampled`` gave.
    """
    under = bottom[again].sum(axis=1)
    shares = top[again].sum(axis=1)[under > 0] / under[under > 0]
    ends = [float(q) for q in np.quantile(shares, _INTERVAL)] if len(shares) else None
    return {
        name: float(top.sum() / bottom.sum()) if bottom.sum() else None,
        f"{name}_ci": ends,
    }

"""Common landmarks over the distance between two robots, by variant."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from vrchain.experiments.landmarks.precision import counted, evaluate, from_score, row, summarise
from vrchain.experiments.scenes import Scenes, remembered
from vrchain.experiments.workers import each
from vrchain.landmarks.matching.variants import DEFAULT
from vrchain.panorama import CameraRig

VARIANTS = ("sift", "cnn", DEFAULT)
_QUARTILES = {"quality_m_q25": 0.25, "quality_m_q75": 0.75}


def over_distance(
    scenes: Scenes,
    n_pairs: int,
    bands_m: Sequence[tuple[float, float]],
    *,
    seed: int,
    folder: Path,
    rig: CameraRig,
    variants: Sequence[str] = VARIANTS,
    jobs: int | None = 1,
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Claims and pairs of ``precision.evaluate``, with a column band_m ("1-10").

    n_pairs: in each band of spacings ``bands_m`` (metres), in the same suburbs in all of them.
    jobs: see ``workers.each``.
    """
    measure = partial(evaluate, remembered(scenes), n_pairs, seed=seed, folder=folder, rig=rig)
    work = partial(_band, measure, bands_m, variants)
    claims, pairs = zip(*each(work, range(len(bands_m)), jobs, "bands"), strict=True)
    return pd.concat(claims, ignore_index=True), pd.concat(pairs, ignore_index=True)


def _band(
    measure: Callable[..., tuple[pd.DataFrame, pd.DataFrame]],
    bands_m: Sequence[tuple[float, float]],
    variants: Sequence[str],
    number: int,
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The tables of one band."""
    low_m, high_m = bands_m[number]
    claims, pairs = measure((low_m, high_m), [row(name) for name in variants])
    band_m = f"{low_m:g}-{high_m:g}"
    return claims.assign(band_m=band_m), pairs.assign(band_m=band_m)


def by_band(claims: pd.DataFrame, pairs: pd.DataFrame) -> pd.DataFrame:
    """What the tables of ``over_distance`` come to at each variant's own threshold.

    One row a band and variant: band_m, variant, suburbs, landmarks_a_pair (co-visible ones),
    right_a_pair and wrong_a_pair (claims, no duplicates), the figures of
    ``precision.summarise``, 95 % intervals as NAME_low and NAME_high (NaN where there is
    none), and the quartiles quality_m_q25 and quality_m_q75.
    """
    rows: list[dict[str, object]] = []
    for key, own, drawn in _grouped(claims, pairs):
        (figures,) = summarise(own, drawn).values()
        made = counted(own, drawn)
        made = made[~made.duplicate]
        rows.append(
            {
                **key,
                "suburbs": drawn.suburb.nunique(),
                "landmarks_a_pair": drawn.co_visible.mean(),
                "right_a_pair": made.right.sum() / len(drawn),
                "wrong_a_pair": (~made.right).sum() / len(drawn),
                **_flat(figures),
                **{name: made.quality_m.quantile(q) for name, q in _QUARTILES.items()},
            }
        )
    return pd.DataFrame(rows)


def precision_recall(claims: pd.DataFrame, pairs: pd.DataFrame) -> pd.DataFrame:
    """Precision and recall of the tables of ``over_distance`` at every threshold.

    One row a band, variant and threshold, in falling order: band_m, variant, threshold, precision,
    recall, and in_use: whether these are the claims that the variant makes by its own threshold.
    A second claim on the same two objects counts for nothing.
    """
    tables = []
    for key, own, drawn in _grouped(claims, pairs):
        sums = from_score(own)
        table = pd.DataFrame(
            {
                **key,
                "threshold": sums.index,
                "precision": (sums.right / sums.n).to_numpy(),
                "recall": sums.shared.to_numpy() / max(1, drawn.co_visible.sum()),
            }
        )
        counts = table.threshold >= drawn.claimed.iloc[0]
        tables.append(table.assign(in_use=counts & ~counts.shift(-1, fill_value=False)))
    return pd.concat(tables, ignore_index=True)


def _grouped(
    claims: pd.DataFrame, pairs: pd.DataFrame
) -> Iterator[tuple[dict[str, object], pd.DataFrame, pd.DataFrame]]:
    """Each band and variant, with its claims and its pairs."""
    claims = claims.astype({"right": bool, "shared": bool, "duplicate": bool, "twin": bool})
    for (band_m, variant), drawn in pairs.groupby(["band_m", "variant"], sort=False):
        own = claims[(claims.band_m == band_m) & (claims.variant == variant)]
        yield {"band_m": band_m, "variant": variant}, own, drawn


def _flat(figures: Mapping[str, object]) -> dict[str, object]:
    flat: dict[str, object] = {}
    for name, value in figures.items():
        if name.endswith("_ci"):
            ends = value if isinstance(value, list) else (np.nan, np.nan)
            flat |= dict(zip((f"{name[:-3]}_low", f"{name[:-3]}_high"), ends, strict=True))
        elif isinstance(value, dict):
            flat |= {f"{name}_{key}": one for key, one in value.items()}
        else:
            flat[name] = value
    return {name: np.nan if value is None else value for name, value in flat.items()}

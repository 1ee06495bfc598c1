"""Precision, recall and pose of claims, by variant, as docs/reference/definitions.md has them."""

import numpy as np
import pandas as pd

from vrchain.experiments.intervals import by_suburb, or_none, ratio, resampled, share, shown, sums
from vrchain.landmarks.matching.calibration import expected_calibration_error

PRECISIONS = (0.90, 0.95, 0.98)


def summarise(
    claims: pd.DataFrame, pairs: pd.DataFrame, *, seed: int = 0
) -> dict[str, dict[str, object]]:
    """The figures of each variant, as docs/reference/definitions.md has them, with 95 % intervals.

    Intervals: bootstrap over suburbs.
    """
    return {
        str(variant): _summary(claims[claims.variant == variant], own, seed)
        for variant, own in pairs.groupby("variant", sort=False)
    }


def _summary(claims: pd.DataFrame, pairs: pd.DataFrame, seed: int) -> dict[str, object]:
    score = float(pairs.claimed.iloc[0])
    made = claims[(claims.score >= score) & ~claims.duplicate.astype(bool)]
    fair = pairs[pairs.co_visible > 0]
    key = ["suburb", "pair"]
    best = made.sort_values("score", ascending=False, kind="stable").groupby(key).first()
    success = best.right.reindex(pd.MultiIndex.from_frame(fair[key])).eq(True).to_numpy()
    claimed = made.groupby(key).size()
    empty = pairs[pairs.co_visible == 0]
    accused = claimed.reindex(pd.MultiIndex.from_frame(empty[key])).notna().to_numpy()
    suburbs = np.sort(pairs.suburb.unique())

    shown_to_both = by_suburb(pairs.co_visible, pairs.suburb, suburbs)
    parts = {
        "pair_success": (share, *sums(pd.Series(success, fair.index), fair.suburb, suburbs)),
        "precision": (ratio, *sums(made.right, made.suburb, suburbs)),
        "recall": (ratio, by_suburb(made.shared, made.suburb, suburbs), shown_to_both),
        "false_claim_rate": (share, *sums(pd.Series(accused, empty.index), empty.suburb, suburbs)),
    }
    again = resampled(len(suburbs), seed, "landmarks")
    found: dict[str, object] = {
        "n_pairs": len(pairs),
        "pairs_without_common": len(empty),
    }
    for name, (told, top, bottom) in parts.items():
        found |= told(name, top, bottom, again)
    found["recall_at_precision"] = {f"{p:.2f}": _recall_at(claims, pairs, p) for p in PRECISIONS}
    found["twin_claims"] = int(made.twin.astype(bool).sum())
    found["duplicates"] = int((claims.score >= score).sum() - len(made))
    found["quality_m_mean"] = or_none(made.quality_m.mean())
    found["quality_m_median"] = or_none(made.quality_m.median())
    found["claims_per_pair"] = len(made) / len(pairs)
    found["ms_per_pair"] = float(pairs.ms.median())
    for name in ("heading_error_deg", "direction_error_deg"):
        found[name] = or_none(fair[name].median())
        found[f"{name}_answered"] = or_none((fair[name] < 180.0).mean())
    found["calibration_error"] = _calibration_error(made)
    return found


def _recall_at(claims: pd.DataFrame, pairs: pd.DataFrame, precision: float) -> float | None:
    """The largest recall of any threshold at which the precision is reached; None: never."""
    counted = from_score(claims)
    held = counted[counted.right / counted.n >= precision]
    return float(held.shared.max() / max(1, pairs.co_visible.sum())) if len(held) else None


def from_score(claims: pd.DataFrame) -> pd.DataFrame:
    """How many claims there are from each score on, falling: n, and right and shared ones of them.

    Claims of one score stand or fall together; a second one on the same two objects is none.
    """
    own = claims.astype({"right": bool, "shared": bool, "duplicate": bool})
    counts = (
        own[~own.duplicate]
        .groupby("score")
        .agg(n=("right", "size"), right=("right", "sum"), shared=("shared", "sum"))
    )
    return counts.sort_index(ascending=False).cumsum()


def _calibration_error(made: pd.DataFrame) -> float | None:
    if len(made) == 0:
        return None
    right = made.right.to_numpy(dtype=bool)
    return expected_calibration_error(made.score.to_numpy(dtype=float), right)


def as_table(summary: dict[str, dict[str, object]]) -> pd.DataFrame:
    """The main figures to read: one row a variant, intervals in brackets."""
    names = ("pair_success", "precision", "recall", "false_claim_rate")
    rows = {}
    for variant, figures in summary.items():
        rows[variant] = {
            "pairs": figures["n_pairs"],
            **{name: shown(figures, name) for name in names},
            "recall_at_precision": " ".join(
                "-" if v is None else f"{v:.3f}"
                for v in dict(figures["recall_at_precision"]).values()  # type: ignore[call-overload]
            ),
            "twins": figures["twin_claims"],
            "quality_m": shown(figures, "quality_m_median"),
            "direction_deg": shown(figures, "direction_error_deg"),
            "heading_deg": shown(figures, "heading_error_deg"),
            "answered": shown(figures, "direction_error_deg_answered"),
            "ece": shown(figures, "calibration_error"),
            "ms": shown(figures, "ms_per_pair"),
        }
    return pd.DataFrame(rows).T.rename_axis("variant")

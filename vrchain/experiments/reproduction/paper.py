"""The paper's table and bounds: what it prints of its measurements, and ours beside it.

TABLE is table I, BOUNDS what section IV-B says of figures 5 to 7, of Rahouti, Lyons and Santana,
"VRChain: A Blockchain-Enabled Framework for Visual Homing and Navigation Robots", 2022,
arXiv:2206.11223. Its times are labelled milliseconds. 1.79e-5 ms is 18 ns, which its timer cannot
see (``time.time()`` steps by 238 ns); read as seconds, 0.83 ms and 18 us, they are plausible. Both
readings are given, neither is claimed. What it calls the retrieval of panoramic views it defines as
that of a common landmark: all our ways of retrieving stand beside its one.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd

from vrchain.experiments.intervals import interval, resampled
from vrchain.experiments.ledger.latency import RETRIEVALS

UPDATE, RETRIEVAL = "update", "retrieval"
READINGS = {"as printed, ms": 1.0, "read as s": 1000.0}  # milliseconds of its unit
OURS = "measured here"


@dataclass(frozen=True)
class PaperRow:
    """Means over so many positions; times in its unit, the quality's unit and formula not given."""

    positions: int
    update: float
    retrieval: float
    landmark_quality: float


@dataclass(frozen=True)
class PaperBound:
    """What the text says of the points of one figure, in its unit."""

    of: str
    positions: tuple[int, ...]  # drawn in that figure
    says: str
    value: float


TABLE = (
    PaperRow(40, 0.82998e-3, 1.79e-5, 3.41),
    PaperRow(200, 0.100515e-2, 1.99e-5, 3.35),
    PaperRow(500, 1.09e-3, 1.98e-5, 3.40),
)
# At 200 positions the text speaks of 0.01 ms, the table of a mean of 0.001 ms: they do not agree.
BOUNDS = (
    PaperBound(UPDATE, (40,), "all under", 1.6e-3),
    PaperBound(UPDATE, (200,), "most under", 0.01),
    PaperBound(UPDATE, (200,), "rarely near", 0.04),
    PaperBound(RETRIEVAL, (40, 200, 500), "all under", 5.5e-5),
    PaperBound(RETRIEVAL, (40, 200, 500), "most under", 3e-5),
)


def summary_table(
    updates: Mapping[int, pd.DataFrame],
    retrievals: Mapping[int, pd.DataFrame],
    landmark_quality_m: Mapping[int, float] | None = None,
) -> pd.DataFrame:
    """The paper's table: for each number of positions our row, then the paper's in both readings.

    Each mapping goes from a number of positions to what was measured with it:
    ``latency.update_latency``, ``latency.retrieval_latency``, mean landmark quality. Columns:
    positions, source, mean_update_ms, one ``mean_WAY_ms`` for each of RETRIEVALS, mean_retrieval_ms
    (the paper's), mean_landmark_quality_m, and mean_landmark_quality (the paper's, which names no
    unit). What was not measured is NaN.
    """
    quality, printed = landmark_quality_m or {}, {row.positions: row for row in TABLE}
    rows: list[dict[str, object]] = []
    for positions in sorted({*updates, *retrievals, *quality, *printed}):
        row: dict[str, object] = {"positions": positions, "source": OURS}
        if positions in updates:
            row["mean_update_ms"] = updates[positions]["total_us"].mean() / 1e3
        if positions in retrievals:
            means_us = retrievals[positions].groupby("way")["time_us"].mean()
            row.update({f"mean_{way}_ms": us / 1e3 for way, us in means_us.items()})
        if positions in quality:
            row["mean_landmark_quality_m"] = quality[positions]
        if len(row) > 2:
            rows.append(row)
        if paper := printed.get(positions):
            rows += [
                {
                    "positions": positions,
                    "source": f"paper, {reading}",
                    "mean_update_ms": paper.update * to_ms,
                    "mean_retrieval_ms": paper.retrieval * to_ms,
                    "mean_landmark_quality": paper.landmark_quality,
                }
                for reading, to_ms in READINGS.items()
            ]
    columns = ["positions", "source", "mean_update_ms"]
    columns += [f"mean_{way}_ms" for way in RETRIEVALS]
    columns += ["mean_retrieval_ms", "mean_landmark_quality_m", "mean_landmark_quality"]
    return pd.DataFrame(rows, columns=columns)


def statistics_table(
    updates: Mapping[int, pd.DataFrame], retrievals: Mapping[int, pd.DataFrame], seed: int = 0
) -> pd.DataFrame:
    """How our times are spread, in milliseconds: one row of updates or a way, and of positions.

    Columns: of, positions, n (times measured), mean_ms, low_ms and high_ms (its 95 % interval, by
    bootstrap over the times, of which neighbours may be alike), sd_ms, p50_ms, p95_ms, p99_ms.
    """
    times_us = {(UPDATE, n): table["total_us"] for n, table in updates.items()}
    for way in RETRIEVALS:
        for n, table in retrievals.items():
            times_us[way, n] = table["time_us"][table["way"] == way]
    rows = []
    for (of, positions), us in times_us.items():
        ms = us.to_numpy(dtype=float) / 1e3
        again = resampled(len(ms), seed, f"{of} {positions}")
        low, high = interval(ms[again].mean(axis=1), len(ms))
        row = {"of": of, "positions": positions, "n": len(ms), "mean_ms": ms.mean()}
        row |= {"low_ms": low, "high_ms": high, "sd_ms": us.std() / 1e3}
        row |= {f"p{share}_ms": np.percentile(ms, share) for share in (50, 95, 99)}
        rows.append(row)
    return pd.DataFrame(rows)


def bounds_table(
    updates: Mapping[int, pd.DataFrame], retrievals: Mapping[int, pd.DataFrame]
) -> pd.DataFrame:
    """The paper's bounds beside our times over the same positions, taken together.

    One row a bound, for retrieval one a bound and way. Columns: of (``update`` or a way),
    positions ("40, 200, 500"), n (times measured), p50_ms, p95_ms, max_ms, paper_says, paper_value
    (as printed), share_under_if_ms and share_under_if_s: of our times, under it in each reading.
    What was not measured is NaN, with n 0.
    """
    rows = []
    for of in (UPDATE, *RETRIEVALS):
        kind, tables = (UPDATE, updates) if of == UPDATE else (RETRIEVAL, retrievals)
        for bound in (bound for bound in BOUNDS if bound.of == kind):
            us = [
                table["total_us"] if of == UPDATE else table["time_us"][table["way"] == of]
                for n, table in tables.items()
                if n in bound.positions
            ]
            ms = pd.concat([pd.Series(dtype=float), *us]) / 1e3
            row = {
                "of": of,
                "positions": ", ".join(map(str, bound.positions)),
                "n": len(ms),
                "p50_ms": ms.quantile(0.5),
                "p95_ms": ms.quantile(0.95),
                "max_ms": ms.max(),
                "paper_says": bound.says,
                "paper_value": bound.value,
            }
            for unit, to_ms in zip(("ms", "s"), READINGS.values(), strict=True):
                row[f"share_under_if_{unit}"] = (ms < bound.value * to_ms).mean()
            rows.append(row)
    return pd.DataFrame(rows)

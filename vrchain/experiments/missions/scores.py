"""What missions came to: how often and how directly each arm arrives, and what came of routes."""

from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from vrchain.experiments.intervals import by_suburb, ratio, resampled, share, shown, sums
from vrchain.experiments.missions.draw import Mission

SOON_S = (150, 300)
_TRUST = (0.0, 0.5, 0.8, 0.95, 1.0)  # in routes: between two of these they are counted together


def routes_of(log: Sequence[Mapping[str, Any]], success: bool) -> list[tuple[float, bool]]:
    """Of each route that was driven the trust in it, and whether it led a mission to success.

    At its end, or where the goal came into view on the way. Routes that replaced it on the way are
    not counted by themselves.
    """
    found: list[tuple[float, bool]] = []
    trust, driven = None, False
    for decision in log:
        what = decision["what"]
        if what == "route" and trust is None:
            trust, driven = decision["values"]["trust"], False
        elif what in ("leg", "approach"):
            driven = True
        elif what in ("plan again", "arrived", "gave up") and trust is not None:
            found += [(trust, success and what == "arrived")] if driven else []
            trust = None
    return found


def summarise(
    table: pd.DataFrame, missions: Sequence[Mission], *, seed: int = 0
) -> dict[str, dict[str, object]]:
    """The figures of each arm, with 95 % intervals under NAME_ci: bootstrap over suburbs.

    success, also within 150 and 300 s, and spl over all n missions; success_given_chain and
    spl_chain over the n_with_chain that a chain leads through; false_arrivals and collisions are
    counts; replans, legs, to_landmarks, barred, seconds_simulated and wall_s are means;
    wall_s_per_300_s is what five simulated minutes cost, the patrol's among them. Of ledger,
    times_alone: its successes over those of alone. Also how many missions need how many landmarks,
    and how many draws were rejected for what; and of routes driven, by the trust in them, how many
    led there.
    """
    suburbs = np.sort(table.suburb.unique())
    again = resampled(len(suburbs), seed, "navigation")
    lengths = Counter(len(m.chain.landmarks) if m.chain else 0 for m in missions)
    rejected: Counter[str] = Counter()
    for mission in missions:
        rejected.update(mission.rejected)
    found: dict[str, dict[str, object]] = {}
    for arm, own in table.groupby("arm", sort=False):
        found[str(arm)] = {
            **_summary(own, suburbs, again),
            "routes": _routes(own),
            "chain_lengths": {str(n): lengths[n] for n in sorted(lengths)},
            "rejected_draws": dict(rejected),
        }
    if {"ledger", "alone"} <= found.keys():
        ours, theirs = (
            by_suburb(table[table.arm == arm].success, table[table.arm == arm].suburb, suburbs)
            for arm in ("ledger", "alone")
        )
        found["ledger"] |= ratio("times_alone", ours, theirs, again)
    return found


def _summary(
    own: pd.DataFrame, suburbs: NDArray[np.int64], again: NDArray[np.int64]
) -> dict[str, object]:
    success = own.success.astype(float)
    chained = own[own.chain > 0]
    spl: pd.Series = success * own.way_m / np.maximum(own.driven_m, own.way_m)
    chain_way_m = chained.chain_way_m.astype(float)
    spl_chain = chained.success.astype(float) * chain_way_m
    spl_chain = spl_chain / np.maximum(chained.driven_m, chain_way_m)
    found: dict[str, object] = {"n": len(own), "n_with_chain": len(chained)}
    soon = {f"success_{s}_s": success * (own.seconds_simulated <= s) for s in SOON_S}
    for name, told, values, of in (
        ("success", share, success, own),
        *((name, share, values, own) for name, values in soon.items()),
        ("success_given_chain", share, chained.success, chained),
        ("spl", ratio, spl, own),
        ("spl_chain", ratio, spl_chain, chained),
    ):
        found |= told(name, *sums(values, of.suburb, suburbs), again)
    found["false_arrivals"] = int((own.arrived.astype(bool) & ~own.success.astype(bool)).sum())
    found["collisions"] = int(own.collisions.sum())
    for name in ("replans", "legs", "to_landmarks", "barred", "seconds_simulated", "wall_s"):
        found[name] = float(own[name].mean())
    found["wall_s_per_300_s"] = float(300 * own.wall_s.sum() / own.clock_s.sum())
    return found


def _routes(own: pd.DataFrame) -> list[dict[str, object]]:
    """How many routes were driven on how much trust, and the share that led there."""
    driven = np.array([route for routes in own.routes for route in routes]).reshape(-1, 2)
    found: list[dict[str, object]] = []
    for low, high in pairwise(_TRUST):
        within = (driven[:, 0] > low) & (driven[:, 0] <= high)
        share = float(driven[within, 1].mean()) if within.any() else None
        found.append({"trust": [low, high], "n": int(within.sum()), "led_there": share})
    return found


def as_table(summary: Mapping[str, Mapping[str, object]]) -> pd.DataFrame:
    """The figures to read: one row an arm, intervals in brackets."""
    names = (
        "n", "n_with_chain", "success", *(f"success_{s}_s" for s in SOON_S),
        "success_given_chain", "times_alone", "spl", "spl_chain",
        "false_arrivals", "collisions", "replans", "legs", "to_landmarks", "barred",
        "seconds_simulated", "wall_s", "wall_s_per_300_s",
    )  # fmt: skip
    rows = {arm: {n: shown(figures, n, ".2f") for n in names} for arm, figures in summary.items()}
    return pd.DataFrame(rows).T.rename_axis("arm")


def routes_table(summary: Mapping[str, Mapping[str, Any]]) -> pd.DataFrame:
    """How many routes each arm drove on how much trust, and the share that led there."""
    rows = [
        {"arm": arm, "trust": "{:g} - {:g}".format(*r["trust"]), "n": r["n"], "led": r["led_there"]}
        for arm, figures in summary.items()
        for r in figures["routes"]
        if r["n"]
    ]
    return pd.DataFrame(rows, columns=["arm", "trust", "n", "led"]).round(2)

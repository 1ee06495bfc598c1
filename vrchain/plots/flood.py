"""A flood beside quiet: what honest robots notice of it, and what becomes of it."""

import pandas as pd
from matplotlib.figure import Figure

from vrchain.experiments.ledger.flood import BAR, QUIET, FloodConfig

_FATES = {
    "admitted": ("admitted", "#009E73"),
    "SignatureError": ("signature does not hold", "#D55E00"),
    "InputLimitError": ("too large", "#CC79A7"),
    "RateLimitError": ("over the robot's rate", "#E69F00"),
    "other": ("duplicate, or after a gap", "#F0E442"),
    "unheard": ("sent, not listened to", "#BBBBBB"),
}


def flood_figure(table: pd.DataFrame, floods: pd.DataFrame, config: FloodConfig) -> Figure:
    """``summarise`` and ``outcomes`` of an experiment with ``config``."""
    figure = Figure(figsize=(12.5, 0.5 * len(table) + 2.6), layout="constrained")
    noticed, became = figure.subplots(1, 2, sharey=True, width_ratios=(1.1, 1.0))
    places = range(len(table))
    quiet_ms = float(table.reference_us.iloc[0]) / 1e3
    limit_ms = BAR * quiet_ms
    for place, row in zip(places, table.itertuples(), strict=True):
        ends_ms = [float(row.median_us) / 1e3, float(row.p99_us) / 1e3]  # type: ignore[arg-type]
        noticed.plot(ends_ms, [place, place], "-", lw=1.2, color="#999999", zorder=1)
        noticed.plot(ends_ms[:1], [place], "o", ms=7, color="#0072B2")
        noticed.plot(ends_ms[1:], [place], "D", ms=7, color="#D55E00")
        if row.name != QUIET:
            text = f"{row.ratio:.2f} x ({row.ratio_low:.2f} to {row.ratio_high:.2f})"
            noticed.annotate(
                text, (ends_ms[1], place), xytext=(9, 0), textcoords="offset points", va="center",
                fontsize=8.5, bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.5},
            )  # fmt: skip
    noticed.axvline(quiet_ms, color="#D55E00", lw=0.9, ls=":")
    noticed.axvline(limit_ms, color="#333333", lw=1.1, ls="--")
    top = len(table) - 0.45
    noticed.text(limit_ms, -0.5, f" {BAR:g} x quiet", fontsize=8.5, va="center")
    noticed.set_yticks(places, list(table["name"]))
    noticed.set_ylim(top, -0.6)
    most_ms = max(float(table.p99_us.max()) / 1e3, limit_ms)
    noticed.set_xlim(0, 1.45 * most_ms)
    noticed.set_xlabel("until a transaction is durable (ms): median ●, 99th percentile ◆")
    refused = int(table.refused.sum())
    noticed.set_title(
        f"What the {config.robots} honest robots notice: "
        f"{refused} of their {table.positions.sum()} refused"
    )
    shares = _shares(floods).reindex(table["name"])
    left = pd.Series(0.0, index=shares.index)
    for fate, (label, colour) in _FATES.items():
        became.barh(places, shares[fate], left=left, height=0.6, color=colour, label=label)
        left += shares[fate]
    sent = floods.set_index("name")["sent"].reindex(table["name"])
    for place, number in zip(places, sent, strict=True):
        became.text(1.02, place, f"{number:,.0f}" if number else "none", va="center", fontsize=9)
    became.set_xlim(0, 1.16)
    became.set_xticks([0, 0.25, 0.5, 0.75, 1.0], ["0", "25 %", "50 %", "75 %", "100 %"])
    became.set_xlabel("share of the messages that the flooder got rid of; how many")
    became.set_title("What becomes of the flood")
    figure.legend(*became.get_legend_handles_labels(), loc="outside lower center", ncols=6)
    figure.suptitle("One robot floods the one that takes in transactions")
    return figure


def _shares(floods: pd.DataFrame) -> pd.DataFrame:
    """Of the messages sent, by fate."""
    counts = floods.set_index("name").drop(columns=["sent", "sent_mb", "gate_busy"])
    named = [fate for fate in _FATES if fate in counts]
    fates = counts.reindex(columns=list(_FATES), fill_value=0.0)
    fates["other"] = counts.drop(columns=named).sum(axis="columns")
    return fates.div(fates.sum(axis="columns").clip(lower=1), axis="index")

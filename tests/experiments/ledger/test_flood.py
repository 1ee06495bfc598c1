"""A flood of every kind is refused by its kind, and nothing of the honest robots is."""

import json
from dataclasses import replace

import pandas as pd
import pytest

from vrchain.errors import LedgerError
from vrchain.experiments.ledger.flood import (
    BAR,
    CONDITIONS,
    QUIET,
    FloodConfig,
    Measured,
    flood,
    outcomes,
    summarise,
)
from vrchain.experiments.ledger.flooder import FLOODS

SMALL = FloodConfig(robots=2, rate_per_s=10.0, payload_bytes=2_000, phase_s=0.5, rounds=1)
SMALL = replace(SMALL, limits=replace(SMALL.limits, rate_per_s=20.0, blob_bytes=20_000))


@pytest.fixture(scope="module")
def measured() -> Measured:
    return flood(SMALL)


def test_every_honest_transaction_is_admitted(measured: Measured) -> None:
    work = measured.work
    assert (work.refused == "").all()
    assert (work.latency_us > 0).all()
    assert set(work.condition) == {QUIET, *CONDITIONS}
    assert (work.groupby(["condition", "round", "robot"]).size() == 5).all()


def test_what_becomes_of_the_flood(measured: Measured) -> None:
    found = outcomes(measured).set_index("name")
    assert list(found.index) == [QUIET, *CONDITIONS]
    kinds = found.drop(columns=["sent", "sent_mb", "gate_busy", "unheard"])
    met = {name: {k for k, n in row.items() if n} for name, row in kinds.iterrows()}
    assert met[QUIET] == set()
    assert "admitted" in met["valid"]
    assert met["forged"] == met["reconnecting"] == met["forged, no limits"] == {"SignatureError"}
    assert met["oversized"] == {"InputLimitError"}
    assert met["valid, no limits"] == {"admitted"}
    heard = kinds.sum(axis="columns")
    assert 1 <= heard["forged"] <= 4  # one message, and then two a second
    assert heard["forged, no limits"] > 10 * heard["forged"]
    assert (found.unheard + heard >= found.sent).all()
    assert (found.unheard[["forged", "oversized"]] > 0).all()


def test_the_summary_sets_each_flood_beside_quiet(measured: Measured) -> None:
    table = summarise(measured, seed=0)
    assert list(table["name"]) == [QUIET, *CONDITIONS]
    assert (table.positions == 10).all()
    assert (table.refused == 0).all()
    assert (table.ratio * table.reference_us).round(3).equals(table.p99_us.round(3))
    assert table[["ratio_low", "ratio_high"]].isna().all(axis=None)  # of one round
    assert list(table["name"][table.bar == BAR]) == list(FLOODS)
    assert json.loads(table.to_json(orient="records"))[0]["ratio"] == 1
    pd.testing.assert_frame_equal(table, summarise(measured, seed=0))


def test_one_standstill_decides_nothing() -> None:
    """Three rounds, whose p99 under the flood are 3, 5 and 900 times the quiet one."""
    rows = [
        {"condition": condition, "round": turn, "latency_us": us, "refused": ""}
        for turn, slow in enumerate([3.0, 5.0, 900.0])
        for condition, us in ((QUIET, 1.0), ("forged", slow))
        for _ in range(10)
    ]
    table = summarise(Measured(pd.DataFrame(rows), pd.DataFrame()), seed=0).set_index("name")
    assert (table.ratio["forged"], table.p99_all_us["forged"]) == (5, 900)
    assert (table.ratio_low["forged"], table.ratio_high["forged"]) == (3, 900)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"rounds": 0}, "1 round"),
        ({"robots": 0}, "1 robot"),
        ({"phase_s": 0.01}, "0.1 s or more"),
        ({"phase_s": float("inf")}, "got inf s"),
    ],
)
def test_bad_requests_are_refused(changes: dict[str, int], said: str) -> None:
    with pytest.raises(LedgerError, match=said):
        flood(replace(SMALL, **changes))  # type: ignore[arg-type]
    with pytest.raises(LedgerError, match=r"expected a flood of valid; .* got 'rain'"):
        flood(SMALL, ["rain"])


@pytest.mark.slow
def test_the_honest_robots_hardly_notice(capsys: pytest.CaptureFixture[str]) -> None:
    table = summarise(flood(replace(FloodConfig(), rounds=4), FLOODS), seed=0)
    with capsys.disabled():
        print(f"\n{table.round(2).to_string(index=False)}")
    assert (table.refused == 0).all()
    assert (table.ratio_low <= BAR).all()

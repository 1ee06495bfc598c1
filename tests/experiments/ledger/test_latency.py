"""The latency experiment measures the real ledger and adds up."""

from pathlib import Path

import pandas as pd
import pytest

from vrchain.errors import LedgerError
from vrchain.experiments.ledger.latency import (
    RETRIEVALS,
    STAGES,
    retrieval_latency,
    throughput,
    update_latency,
)
from vrchain.ledger import Ledger, verify

PAYLOADS = [b"%d" % number + bytes(20_000) for number in range(10)]


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> tuple[pd.DataFrame, Path]:
    folder = tmp_path_factory.mktemp("latency") / "ledger"
    return update_latency(PAYLOADS, folder), folder


def test_every_update_is_in_the_ledger_and_has_a_row(measured: tuple[pd.DataFrame, Path]) -> None:
    table, folder = measured
    assert list(table["robot"]) == ["R1", "R2"] * 5
    assert list(table["position"]) == [0, 0, 1, 1, 2, 2, 3, 3, 4, 4]
    assert list(table["payload_bytes"]) == [len(payload) for payload in PAYLOADS]
    assert verify(folder).blocks == 11
    with Ledger.open(folder) as ledger:
        stored = [ledger.payload(t.payload_digest) for t in ledger.history("R2")]
    assert stored == PAYLOADS[1::2]


def test_the_stages_are_parts_of_the_whole(measured: tuple[pd.DataFrame, Path]) -> None:
    table, _ = measured
    stages = table[[f"{stage}_us" for stage in STAGES]]
    assert (stages > 0).all(axis=None)
    parts_us = stages.sum(axis=1)
    assert (parts_us <= table["total_us"]).all()
    # Beside the stages there is only the stopwatch itself.
    assert (table["total_us"] - parts_us).median() < 0.1 * table["total_us"].median()


def test_the_ledger_holds_no_durations(measured: tuple[pd.DataFrame, Path], tmp_path: Path) -> None:
    """Measured again, the same head: no clock got in."""
    update_latency(PAYLOADS, tmp_path / "again")
    with Ledger.open(tmp_path / "again") as again, Ledger.open(measured[1]) as first:
        assert again.head.hash == first.head.hash


def test_retrieval_three_ways(measured: tuple[pd.DataFrame, Path]) -> None:
    given: list[tuple[bytes, bytes]] = []
    with Ledger.open(measured[1]) as ledger:
        table = retrieval_latency(
            ledger, ["R1", "R2"], lambda a, b: given.append((a, b)), n_landmarks=4
        )
        without = retrieval_latency(ledger, ["R1"], len)
    # the last to warm up, then four: each with the one before it, the first with the one after
    assert given == [(PAYLOADS[k], PAYLOADS[abs(k - 1)]) for k in (9, 0, 3, 6, 9)]
    for way, positions in zip(RETRIEVALS, (range(1, 11), range(1, 11), (1, 4, 7, 10)), strict=True):
        rows = table[table["way"] == way]
        assert list(rows["position"]) == list(positions)
        assert list(rows["robot"]) == ["R1" if n % 2 else "R2" for n in positions]
    assert (table["time_us"] > 0).all()
    median_us = table.groupby("way")["time_us"].median()
    assert median_us["newest_transaction"] < median_us["panorama"]
    assert list(without["way"].unique()) == list(RETRIEVALS[:2]) and len(without) == 10


def test_a_robot_that_has_not_published(tmp_path: Path) -> None:
    update_latency(PAYLOADS[:1], tmp_path / "ledger")
    with Ledger.open(tmp_path / "ledger") as ledger, pytest.raises(LedgerError, match="R2"):
        retrieval_latency(ledger, ["R1", "R2"])


def test_throughput(tmp_path: Path) -> None:
    (row,) = throughput(PAYLOADS, tmp_path / "ledger", n_retrievals=50).to_dict("records")
    assert row["n_updates"] == 10
    assert row["payload_bytes"] == pytest.approx(20_001)
    assert row["updates_per_s"] > 1
    assert row["newest_transactions_per_s"] > row["panoramas_per_s"] > row["updates_per_s"]
    assert verify(tmp_path / "ledger").blocks == 11
    with pytest.raises(LedgerError, match="at least one payload"):
        throughput([], tmp_path / "none")

"""The latency experiment measures the real ledger and adds up."""

from pathlib import Path

import pandas as pd
import pytest

from vrchain.errors import LedgerError
from vrchain.experiments.latency import (
    PAPER,
    RETRIEVALS,
    STAGES,
    retrieval_latency,
    summary_table,
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
            ledger, ["R1", "R2"], 5, lambda a, b: given.append((a, b)), n_landmark_repeats=2
        )
        without = retrieval_latency(ledger, ["R1"], n_repeats=2)
    assert set(given) == {(PAYLOADS[8], PAYLOADS[9]), (PAYLOADS[9], PAYLOADS[8])}
    assert list(table["way"]) == list(RETRIEVALS) * 2
    assert (table["positions"] == 5).all()
    assert (table[["median_us", "mean_us"]] > 0).all(axis=None)
    median_us = table.groupby("way")["median_us"].median()
    assert median_us["newest_transaction"] < median_us["panorama"]
    assert list(without["way"]) == list(RETRIEVALS[:2])


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


def test_the_summary_stands_beside_both_readings_of_the_paper() -> None:
    updates = {40: pd.DataFrame({"total_us": [1000.0, 3000.0]})}
    retrievals = {
        n: pd.DataFrame({"way": ["panorama", "panorama"], "mean_us": [100.0, 300.0]})
        for n in (500, 40)
    }
    table = summary_table(updates, retrievals, {40: 1.5}).set_index("source")
    ours, paper = table.loc["measured here"], table.drop("measured here")
    assert list(ours["positions"]) == [40, 500]
    assert ours["mean_update_ms"].iloc[0] == 2.0
    assert pd.isna(ours["mean_update_ms"].iloc[1])
    assert list(ours["mean_panorama_ms"]) == [0.2, 0.2]
    assert ours["mean_landmark_quality_m"].iloc[0] == 1.5
    assert ours["mean_retrieval_ms"].isna().all()
    assert paper["positions"].isna().all()  # which row is whose is not known
    assert list(paper["mean_update_ms"]) == [8.3e-4, pytest.approx(0.83)]
    assert list(paper["mean_retrieval_ms"]) == [1.79e-5, pytest.approx(0.0179)]
    assert all("3.35-3.41" in note for note in paper["note"])
    assert PAPER.landmark_quality_printed == (3.35, 3.41)

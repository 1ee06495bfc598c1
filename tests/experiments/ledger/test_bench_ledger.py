"""The bench of the ledger: its ledgers are the real one, its baselines hold what they promise."""

import hashlib
import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from ledgers import KEYS, OPERATOR_KEY, PUBLIC

from vrchain.errors import LedgerError, OutputError
from vrchain.experiments.ledger import speed as bench
from vrchain.experiments.ledger import stores as ledger_sites
from vrchain.experiments.ledger.baselines import InlineChain, JsonChain, MemoryLedger, Turn
from vrchain.experiments.stopwatch import Stopwatch, race_us
from vrchain.ledger import Ledger, verify
from vrchain.ledger.rules.chain import genesis_entry


def turns(count: int) -> list[Turn]:
    names = [("R1", "R2")[number % 2] for number in range(count)]
    return [Turn(name, KEYS[name], b"%d" % n * 500, n) for n, name in enumerate(names)]


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> bench.Bench:
    """Smaller payloads, so that it takes seconds; and nothing is left behind."""
    folder = tmp_path_factory.mktemp("bench")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ledger_sites, "_LARGE", 20_000)
        patch.setattr(ledger_sites, "_LARGE_UP_TO", 20)
        patch.setattr(bench, "MANY_ROBOTS", 20)
        patch.setattr(ledger_sites, "_COMPUTED_OVER", 400_000)
        found = bench.bench_ledger([60, 15], folder, rounds=4)
    assert list(folder.iterdir()) == []
    return found


def test_every_row_is_measured_beside_its_limit(measured: bench.Bench) -> None:
    rows = measured.rows
    assert list(rows.columns) == bench.COLUMNS
    assert set(rows.positions) == {15, 60, 40}
    timed = rows[rows.reference_us.notna()]
    assert (timed[["median_us", "reference_us"]] > 0).all(axis=None)
    assert np.allclose(timed.ratio, timed.median_us / timed.reference_us)
    assert not rows.duplicated(["name", "positions"]).any()
    bars = rows[rows.bar.notna()].set_index("name").bar.to_dict()
    assert bars == {
        "update in memory, 20 KB": 1.3,
        "update durable, 20 KB": 1.5,
        "update durable, 1 KB": 1.5,
        "latest(robot)": 4.0,
        "latest(robot), beside the one at 15 positions": 1.2,
        "refresh()": 5.0,
        "verification a position, 10 robots, 20 KB": pytest.approx(1 / 0.7),
        "verification a position, 10 robots, 1 KB": pytest.approx(1 / 0.7),
        "verification a position, 20 robots, 1 KB": pytest.approx(1 / 0.7),
        "bytes of the ledger, 20 KB": 1.02,
    }


def test_fewer_positions_than_robots(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bench, "MANY_ROBOTS", 20)
    rows = bench.bench_ledger([1], tmp_path, rounds=3).rows
    assert rows[rows.name == "latest(robot), inline"].median_us.item() > 0


def test_an_update_takes_at_least_the_sum_of_its_limits() -> None:
    """Turn by turn: one signature by the robot and one by the operator, the rest once."""
    turns_us = np.array([1.0, 7.0, 2.0])
    times_us = {name: turns_us * 10**n for n, name in enumerate(bench._LIMITS)}
    assert np.array_equal(sum(bench._limits(times_us).values()), turns_us * 11_121)
    del times_us["commit"], times_us["file"]
    assert np.array_equal(sum(bench._limits(times_us).values()), turns_us * 121)


def test_no_limit_is_above_the_reference_that_it_is_part_of(measured: bench.Bench) -> None:
    rows = measured.rows.set_index(["positions", "name"])
    limits_us = {
        name: rows.loc[(15, f"limit: {name}, 20 KB")].median_us for name in bench._LIMITS.values()
    }
    stage = rows.loc[(15, "update durable, 20 KB: sign")]
    assert stage.reference_us == pytest.approx(2 * limits_us["signature"])
    whole_us = rows.loc[(15, "update durable, 20 KB")].reference_us
    assert max(stage.reference_us, *limits_us.values()) <= whole_us


def test_the_stages_are_parts_of_an_update(measured: bench.Bench) -> None:
    """Of the same clock: the time that an update waits for the disk is in both."""
    rows = measured.rows.set_index(["positions", "name"]).median_us
    for way, size, count in (("in memory", 20, 15), ("durable", 20, 15), ("durable", 1, 60)):
        whole = rows[(count, f"update {way}, {size} KB")]
        stages = rows[[key for key in rows.index if key[1].startswith(f"update {way}, {size} KB:")]]
        assert len(stages) >= 5 and (stages <= whole).all()


def test_sizes_are_those_of_the_layouts(measured: bench.Bench) -> None:
    sizes = measured.sizes.set_index(["positions", "layout"])
    # 15 blocks hold 1, 2, ... 10, 10 ... of ten robots' panoramas
    inline = sizes.loc[(15, "inline")]
    assert inline.n_bytes == pytest.approx((55 + 5 * 10) * 20_000, rel=0.05)
    assert not inline.computed or inline.n_bytes > 400_000
    assert sizes.loc[(60, "inline")].computed
    assert sizes.loc[(60, "inline")].n_bytes == pytest.approx((55 + 50 * 10) * 1_000, rel=0.3)
    assert 4 / 3 < sizes.loc[(15, "JSON")].ratio < 1.5
    assert not sizes.loc[(60, "JSON")].computed
    assert 1 < sizes.loc[(15, "the ledger")].ratio < 1.5


def test_the_text_says_whether_each_bar_is_met(measured: bench.Bench) -> None:
    text = bench.as_text(measured)
    first = text.split("\n\n")[0].splitlines()[1:]
    assert len(first) == measured.rows.bar.notna().sum()
    assert all(line.split().count("yes") + line.split().count("NO") == 1 for line in first)
    assert "of what SHA-256 and Ed25519 alone allow" in text


def test_the_ledger_in_memory_is_the_ledger(tmp_path: Path) -> None:
    """The same blocks as by ``Ledger.publish``, and stored the same files."""
    memory = MemoryLedger(genesis_entry(PUBLIC, OPERATOR_KEY, 0))
    watch = Stopwatch()
    with Ledger.create(tmp_path / "slow", PUBLIC, OPERATOR_KEY) as ledger:
        for turn in turns(9):
            memory.publish([turn], watch.lap)
            ledger.publish(turn.robot, turn.key, turn.payload, "distance", turn.timestamp_ns)
        assert ledger.head == memory.chain.head
    memory.store(tmp_path / "quick")
    assert verify(tmp_path / "quick").blocks == 10
    with Ledger.open(tmp_path / "slow") as slow, Ledger.open(tmp_path / "quick") as quick:
        assert list(slow.entries()) == list(quick.entries()) == memory.entries
    sizes = [ledger_sites.bytes_on_disk(tmp_path / name) for name in ("slow", "quick")]
    assert sizes[0] == sizes[1]
    assert all(watch.us(stage) > 0 for stage in bench._STAGES[:-1])


@pytest.mark.parametrize("kind", [InlineChain, JsonChain])
def test_a_layout_holds_what_was_published(
    kind: type[InlineChain | JsonChain], tmp_path: Path
) -> None:
    layout = kind(tmp_path / "blocks")
    sizes = []
    for turn in turns(6):
        layout.publish(turn, sync=True)
        sizes.append(layout.n_bytes)
    layout.publish(turns(7)[6], sync=None)
    layout.close()
    assert (tmp_path / "blocks").stat().st_size == layout.n_bytes == sizes[-1]
    assert layout.latest("R3") is None
    assert len(layout.blocks) == 7 and sizes == sorted(set(sizes))
    if isinstance(layout, InlineChain):
        assert layout.latest("R1")[1] == turns(7)[6].payload
        assert (tmp_path / "blocks").read_bytes().count(turns(6)[4].payload) == 2  # blocks 4 and 5
    else:
        assert layout.latest("R2")["timestamp_ns"] == 5
        lines = (tmp_path / "blocks").read_bytes().splitlines()
        for line, after in pairwise(lines):
            assert json.loads(after)["previous_hash"] == hashlib.sha256(line).hexdigest()


def test_a_race_is_run_by_all_at_each_turn() -> None:
    seen: list[tuple[str, int]] = []
    runners = {name: (lambda turn, name=name: seen.append((name, turn))) for name in "abc"}
    times_us = race_us(runners, range(20), np.random.default_rng(0))
    assert sorted(seen) == sorted((name, turn) for name in "abc" for turn in range(20))
    assert len({tuple(name for name, _ in seen[at : at + 3]) for at in range(0, 60, 3)}) > 3
    assert all((times > 0).all() and len(times) == 20 for times in times_us.values())


@pytest.mark.parametrize("positions", [[0], [], [40, -1]])
def test_no_positions_are_refused(positions: list[int], tmp_path: Path) -> None:
    with pytest.raises(LedgerError, match="at least 1 position"):
        bench.bench_ledger(positions, tmp_path / "none")
    assert not (tmp_path / "none").exists()


def test_a_folder_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OutputError, match="choose another"):
        bench.bench_ledger([1], tmp_path / "file")
    assert (tmp_path / "file").read_text() == "in the way"

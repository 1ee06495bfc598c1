"""Whatever is changed in a stored ledger, verify fails and names the block."""

import json
import os
import re
import shutil
import sqlite3
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import replace
from itertools import cycle, product
from pathlib import Path
from unittest.mock import Mock, patch

import independent_verifier as independent
import pytest
from ledgers import KEYS, OPERATOR_KEY, PUBLIC, long_ledger, said_by

from vrchain.ledger import Ledger, Offer, Verification, errors, verify
from vrchain.ledger.export import entry_json
from vrchain.ledger.records.block import Entry, records_root
from vrchain.ledger.records.encoding import digest
from vrchain.ledger.records.keys import DATABASE_NAME
from vrchain.ledger.records.table import Table
from vrchain.ledger.storage.database import (
    insert_entry,
    operator_records,
    read_entries,
    read_records,
)
from vrchain.ledger.storage.resume import read_history
from vrchain.ledger.storage.retention import Retention

HEIGHT_OF_LAST = 5


def database(folder: Path) -> sqlite3.Connection:
    db = sqlite3.connect(folder / DATABASE_NAME, isolation_level=None)
    db.execute("PRAGMA synchronous = OFF")
    return db


def run(folder: Path, sql: str) -> None:
    with closing(database(folder)) as db:
        db.executescript(sql)


def test_a_good_ledger_passes(folder: Path) -> None:
    assert verify(folder) == Verification(True, 6, None, "")
    with Ledger.open(folder) as ledger:
        for entry in ledger.entries():
            assert verify(folder, expected_head=entry.block.hash).ok
    steps: list[tuple[int, int]] = []
    verify(folder, progress=lambda done, total: steps.append((done, total)))
    assert steps == [(n, 6) for n in range(1, 7)]


def changes(content: bytes) -> Iterator[bytes]:
    """The content with one bit changed, of each byte in turn."""
    for position in range(len(content)):
        bad = bytearray(content)
        bad[position] ^= 1 << position % 8
        yield bytes(bad)


def is_bad(folder: Path, height: int | None) -> Verification:
    """What ``verify`` says of a spoilt ledger: that block; the other verifier finds it too."""
    found = verify(folder)
    assert (found.ok, found.first_bad_block) == (False, height)
    assert found.reason
    with pytest.raises(Exception):  # noqa: B017 - any refusal will do
        independent.verify(folder)
    return found


def test_every_byte_of_every_record(tmp_path: Path) -> None:
    """Over a genesis, an enrolment and a transaction."""
    folder = tmp_path / "ledger"
    with Ledger.create(folder, {"R1": PUBLIC["R1"]}, OPERATOR_KEY) as ledger:
        ledger.enrol("R2", PUBLIC["R2"], OPERATOR_KEY, 5)
        ledger.publish("R1", KEYS["R1"], b"payload", "start", 10)
    cells = [("blocks", "hash"), ("blocks", "record"), ("records", "id"), ("records", "record")]
    tried = 0
    with closing(database(folder)) as db:
        for (table, column), height in product(cells, range(3)):
            cell = f"SELECT {column} FROM {table} WHERE height = {height}"
            update = f"UPDATE {table} SET {column} = ? WHERE height = {height}"
            (good,) = db.execute(cell).fetchone()
            for bad in changes(good):
                db.execute(update, (bad,))
                is_bad(folder, height)
                tried += 1
            db.execute(update, (good,))
    assert tried > 1500
    assert verify(folder).ok


def test_every_other_column(folder: Path) -> None:
    columns = [("blocks", "height"), *(("records", c) for c in ("height", "position", "robot"))]
    for (table, column), height in product(columns, range(6)):
        copy = shutil.copytree(folder, folder.with_name(f"{table} {column} {height}"))
        value = f"coalesce({column}, 0) + 1000"
        run(copy, f"UPDATE {table} SET {column} = {value} WHERE height = {height}")
        assert verify(copy).first_bad_block == height, (table, column, height)


def test_every_byte_of_every_payload(tmp_path: Path) -> None:
    """And of every landmark record. The block that first names it (since its drop) is bad."""
    folder, retention = tmp_path / "ledger", Retention()
    long_ledger(folder)
    with Ledger.open(folder) as ledger:
        for block, records in ledger.entries():
            for record in records:
                retention.take(record, block.height)
    assert len(retention.kept) == 7
    for blob, height in retention.kept.items():
        path = folder / "blobs" / blob.hex()
        good = path.read_bytes()
        for bad in changes(good):
            path.write_bytes(bad)
            is_bad(folder, height)
        path.write_bytes(good)
    assert verify(folder).ok


@pytest.mark.parametrize(
    ("change", "height"),
    [
        (lambda path: path.unlink(), 4),
        (lambda path: path.write_bytes(path.read_bytes()[:-1]), 4),
        (lambda path: path.write_bytes(path.read_bytes() + b"\0"), 4),
        (lambda path: path.write_bytes(b""), 4),
        (lambda path: (path.unlink(), path.mkdir()), 4),
        (lambda path: shutil.rmtree(path.parent), 1),
    ],
    ids=["removed", "truncated", "longer", "empty", "a folder", "all removed"],
)
def test_a_payload_that_is_not_there_whole(
    folder: Path, change: Callable[[Path], object], height: int
) -> None:
    change(folder / "blobs" / digest(b"first of R3").hex())
    assert is_bad(folder, height).blocks == height


SWAP = """
UPDATE records SET height = 99 WHERE height = 1;
UPDATE records SET height = 1 WHERE height = 2;
UPDATE records SET height = 2 WHERE height = 99;
"""
SWAP_BLOCKS = SWAP.replace("records", "blocks")
COPY = "INSERT INTO records SELECT 6, 0, zeroblob(32), NULL, record FROM records LIMIT 1;"


@pytest.mark.parametrize(
    ("sql", "height"),
    [
        (SWAP, 1),
        (SWAP_BLOCKS, 1),
        (SWAP + SWAP_BLOCKS, 1),
        ("DELETE FROM records WHERE height = 2", 2),
        ("DELETE FROM blocks WHERE height = 2", 2),
        ("DELETE FROM blocks WHERE height = 2; DELETE FROM records WHERE height = 2", 2),
        ("DELETE FROM blocks WHERE height = 0", 0),
        ("DELETE FROM blocks", 0),
        ("DELETE FROM records", 0),
        ("INSERT INTO blocks SELECT 6, hash, record FROM blocks WHERE height = 5", 6),
        (COPY.replace("6, 0", "3, 1"), 3),
        (COPY, 6),
        ("INSERT INTO blocks SELECT -1, hash, record FROM blocks WHERE height = 5", None),
        ("UPDATE blocks SET record = 'text' WHERE height = 3", 3),
        ("UPDATE blocks SET record = 7 WHERE height = 3", 3),
        ("UPDATE blocks SET record = zeroblob(2000000) WHERE height = 3", 3),
        ("UPDATE records SET record = 'text' WHERE height = 3", 3),
        ("UPDATE records SET record = CAST(x'ff' AS TEXT) WHERE height = 3", 3),
        ("DROP TABLE records", 0),
        ("DROP TABLE blocks", 0),
        ("PRAGMA user_version = 1", 0),
    ],
)
def test_rows_swapped_dropped_doubled_or_spoilt(folder: Path, sql: str, height: int | None) -> None:
    run(folder, sql)
    is_bad(folder, height)


ENDLESS = """
DROP TABLE blocks;
CREATE VIEW blocks AS WITH RECURSIVE n(height, hash, record) AS
    (SELECT 0, x'00', x'00' UNION ALL SELECT height + 1, hash, record FROM n) SELECT * FROM n;
"""
TAKE_BACK = """
CREATE TRIGGER t AFTER INSERT ON blocks BEGIN DELETE FROM blocks WHERE height = new.height; END;
CREATE TRIGGER u AFTER INSERT ON records BEGIN DELETE FROM records WHERE height = new.height; END;
"""


@pytest.mark.timeout(60)
@pytest.mark.parametrize(
    "sql",
    [
        ENDLESS,
        TAKE_BACK,
        "CREATE VIEW v AS SELECT 1",
        "CREATE TABLE other (x)",
        "CREATE INDEX i ON blocks (hash)",
        "CREATE INDEX i ON blocks (length(record)) WHERE height > 2",
        "DROP INDEX robots",
        "DROP INDEX robots; CREATE INDEX robots ON records (robot, id)",
        "ALTER TABLE blocks ADD COLUMN double AS (height * 2)",
        "ANALYZE",
    ],
)
def test_a_schema_of_ones_own(folder: Path, sql: str) -> None:
    with Ledger.open(folder, writable=True) as ledger, Ledger.open(folder) as reader:
        run(folder, sql)
        for ask in (
            reader.refresh,
            lambda: ledger.publish("R1", KEYS["R1"], b"x", "time", 60),
            lambda: Ledger.open(folder),
            lambda: Ledger.open(folder, writable=True),
        ):
            with pytest.raises(errors.DamagedError, match="schema"):
                ask()
    found = verify(folder)
    assert (found.ok, found.blocks) == (False, 0) and "schema" in found.reason


@pytest.mark.parametrize(
    ("sql", "kind", "said"),
    [
        ("PRAGMA journal_mode = DELETE", errors.DamagedError, "write-ahead log"),
        ("PRAGMA application_id = 0", errors.NotALedgerError, "application id"),
    ],
)
def test_another_kind_of_database(folder: Path, sql: str, kind: type[Exception], said: str) -> None:
    run(folder, sql)
    with pytest.raises(kind, match=said):
        Ledger.open(folder)
    assert verify(folder).first_bad_block == 0


# Look at a ledger with so much memory and no more.
POOR = """
import resource, sys
from vrchain.ledger import verify
used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (used + 120_000_000,) * 2)
found = verify(sys.argv[1])
print(found.first_bad_block, found.reason)
"""
MANY = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < 150) "


LARGE = "zeroblob(150000000)"


@pytest.mark.parametrize(
    "sql",
    [
        f"UPDATE blocks SET record = {LARGE} WHERE height = 5",
        f"UPDATE blocks SET hash = {LARGE} WHERE height = 5",
        f"UPDATE records SET record = {LARGE} WHERE height = 5",
        f"UPDATE records SET id = {LARGE} WHERE height = 5",
        "UPDATE records SET record = hex(zeroblob(75000000)) WHERE height = 5",
        f"INSERT INTO records {MANY} SELECT 5, i, randomblob(9), 'R1', zeroblob(999999) FROM n",
    ],
)
def test_what_is_too_large_is_not_read(folder: Path, sql: str) -> None:
    run(folder, sql)
    reason = "rows of one block" if "INSERT" in sql else "too big"
    assert re.match(f"5 .*{reason}", said_by(POOR, folder))


@patch("vrchain.ledger.storage.database._CELL_BYTES", (1 << 26) - 1000)
def test_more_than_is_ever_read_is_not_written(folder: Path) -> None:
    with Ledger.open(folder, writable=True) as ledger:
        drafts = [ledger.draft_transaction(robot, b"x", "view", 60) for robot in ("R1", "R2")]
        offers = [Offer(draft.signed(KEYS[draft.robot]), b"x") for draft in drafts]
        with pytest.raises(errors.TooLargeError, match="several blocks"):
            ledger.append_many(offers, "R1", KEYS["R1"])
        assert ledger.append_many(offers[:1], "R1", KEYS["R1"]).height == 6
    assert verify(folder).ok


def test_a_tree_that_leads_round_in_a_circle_ends(folder: Path) -> None:
    """Rows that come again and again are not read for ever, whoever asks."""
    columns = "height, position, id, record"
    for read, condition in (
        (lambda db: list(read_records(db, "the records")), "true"),
        (lambda db: operator_records(db, 5), "robot IS NULL"),
        (lambda db: read_history(db, "R1", 5), "robot = 'R1'"),
    ):
        with closing(database(folder)) as db:
            rows = db.execute(f"SELECT {columns} FROM records WHERE {condition}").fetchall()
        with pytest.raises(errors.DamagedError, match=r"in their order|not whole"):
            read(Mock(execute=lambda *given, rows=rows: cycle(rows)))


LAST = "height = (SELECT max(height) FROM blocks)"


@pytest.mark.parametrize(
    "sql",
    [
        f"UPDATE records SET position = 9 WHERE position = 0 AND {LAST};"
        f"UPDATE records SET position = 0 WHERE position = 1 AND {LAST};"
        f"UPDATE records SET position = 1 WHERE position = 9 AND {LAST};",
        f"DELETE FROM records WHERE position = 0 AND {LAST}",
        f"DELETE FROM records WHERE position = 1 AND {LAST}",
        "INSERT INTO records SELECT height, 2, randomblob(32), robot, record FROM records "
        f"WHERE position = 1 AND {LAST}",
    ],
    ids=["swapped", "first dropped", "last dropped", "doubled"],
)
def test_records_of_one_block_swapped_dropped_or_doubled(tmp_path: Path, sql: str) -> None:
    long_ledger(tmp_path / "ledger")
    with Ledger.open(tmp_path / "ledger") as ledger:
        assert len(ledger.entry(ledger.head.height).records) == 2
        height = ledger.head.height
    run(tmp_path / "ledger", sql)
    is_bad(tmp_path / "ledger", height)


def test_a_tail_cut_off_is_found_under_a_known_head(folder: Path) -> None:
    with Ledger.open(folder) as ledger:
        head = ledger.head.hash
    run(folder, "DELETE FROM blocks WHERE height = 5; DELETE FROM records WHERE height = 5")
    assert verify(folder) == Verification(True, 5, None, "")
    found = verify(folder, expected_head=head)
    assert (found.ok, found.blocks, found.first_bad_block) == (False, 5, 5)
    assert "cut off" in found.reason
    with pytest.raises(independent.Bad, match="known head"):
        independent.verify(folder, head)


def test_records_signed_again_by_another_member(folder: Path) -> None:
    """R2 takes R1's last transaction, and R1's last block, for its own; rows all consistent."""
    with Ledger.open(folder) as ledger:
        newest = dict(ledger.head.newest)
    for forge in ("transaction", "block", "both"):
        copy = folder.with_name(forge)
        shutil.copytree(folder, copy)
        with closing(database(copy)) as db:
            block, (transaction,) = next(read_entries(db, HEIGHT_OF_LAST, HEIGHT_OF_LAST + 1))
            if forge != "block":
                transaction = replace(transaction, signature=b"").signed(KEYS["R2"])
            newest_root = Table(newest | {"R1": transaction.id}).root
            root = records_root((transaction,))
            block = replace(block, records_root=root, newest_root=newest_root)
            key = KEYS["R1"] if forge == "transaction" else KEYS["R2"]
            db.execute("DELETE FROM blocks WHERE height = 5")
            db.execute("DELETE FROM records WHERE height = 5")
            insert_entry(db, Entry(block.signed(key), (transaction,)))
        assert "valid signature" in is_bad(copy, HEIGHT_OF_LAST).reason
        with pytest.raises(errors.DamagedError, match="valid signature"):
            Ledger.open(copy)  # who goes on from it notices too


def test_a_history_that_is_not_linked_is_noticed_when_it_is_read(folder: Path) -> None:
    """R1 signs its first transaction anew, long after, in the place of the one it published."""
    with closing(database(folder)) as db:
        transaction = next(read_entries(db, 1, 2)).records[0]
        other = replace(transaction, timestamp_ns=9, signature=b"").signed(KEYS["R1"])
        update = "UPDATE records SET id = ?, record = ? WHERE height = 1"
        db.execute(update, (other.id, other.record))
    with Ledger.open(folder) as ledger, pytest.raises(errors.DamagedError, match="not whole"):
        ledger.history("R1")
    is_bad(folder, 1)


def test_a_rewritten_history_is_found_under_a_known_head(ledger: Ledger, pristine: Path) -> None:
    """All keys in hand one can write another history; only the known head tells."""
    ledger.publish("R1", KEYS["R1"], b"another first", "start", 10)
    assert verify(ledger.folder).ok
    with Ledger.open(pristine) as other:
        assert not verify(ledger.folder, expected_head=other.head.hash).ok


@pytest.mark.parametrize(
    "spoil",
    [
        lambda good: b"\xa5" * len(good),
        lambda good: b"",
        lambda good: good[: len(good) // 2],
        lambda good: good[:100] + b"\xa5" * (len(good) - 100),
    ],
    ids=["garbage", "empty", "half", "header only"],
)
def test_a_spoilt_database_file_is_no_traceback(
    folder: Path, spoil: Callable[[bytes], bytes]
) -> None:
    path = folder / DATABASE_NAME
    for leftover in folder.glob(f"{DATABASE_NAME}-*"):
        leftover.unlink()
    path.write_bytes(spoil(path.read_bytes()))
    assert not verify(folder).ok
    with pytest.raises(errors.StorageError):
        Ledger.open(folder)


def exported(folder: Path) -> str:
    """All that an export says."""
    with Ledger.open(folder) as ledger:
        return json.dumps([entry_json(entry) for entry in ledger.entries()])


@pytest.mark.timeout(3600)  # some 30,000 verifications
@pytest.mark.parametrize("step", [61, pytest.param(1, marks=pytest.mark.slow)])
def test_every_byte_of_the_database(
    tmp_path: Path, step: int, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whatever byte changes: verify fails, or all that an export says is as it was.

    Bytes of canonical records are of the first kind, and their block is named.
    """
    folder = tmp_path / "ledger"
    long_ledger(folder)
    run(folder, "PRAGMA wal_checkpoint(TRUNCATE)")
    before = exported(folder)
    path = folder / DATABASE_NAME
    good = path.read_bytes()
    height_of: dict[int, int] = {}  # by place in the file, where a canonical record lies
    with Ledger.open(folder) as ledger:
        for block, records in ledger.entries():
            for record in (block, *records):
                assert good.count(record.record) == 1
                start = good.index(record.record)
                height_of |= dict.fromkeys(range(start, start + len(record.record)), block.height)
    counts: Counter[str] = Counter()
    for position in range(0, len(good), step):
        for leftover in folder.glob(f"{DATABASE_NAME}-*"):
            leftover.unlink()
        bad = bytearray(good)
        bad[position] ^= 0xFF
        path.write_bytes(bad)
        found = verify(folder)
        if position in height_of:
            assert (found.ok, found.first_bad_block) == (False, height_of[position])
        if found.first_bad_block is None:  # good blocks, whether the rest is good or not
            assert exported(folder) == before
        kind = "record" if position in height_of else "another byte"
        counts[f"{kind}, {'unchanged' if found.first_bad_block is None else 'named'}"] += 1
    path.write_bytes(good)
    assert verify(folder).ok
    with capsys.disabled():
        print(f"\nbytes changed, every {step}: {dict(counts)}")


def test_what_is_no_ledger_is_told_apart(tmp_path: Path) -> None:
    with pytest.raises(errors.NotALedgerError, match="expected a ledger"):
        verify(tmp_path)
    with pytest.raises(errors.NotALedgerError):
        verify(tmp_path / "missing")
    assert os.listdir(tmp_path) == []
    (tmp_path / DATABASE_NAME).mkdir()
    with pytest.raises(errors.NotALedgerError):
        verify(tmp_path)

"""Old blobs may go when the operator signs that, and only then; what no record needs is cleaned."""

import shutil
from pathlib import Path
from unittest.mock import patch

import pytest
from ledgers import KEYS, OPERATOR_KEY, files, long_ledger

from vrchain.ledger import Ledger, errors, verify
from vrchain.ledger.records.encoding import digest


def stored(folder: Path) -> set[bytes]:
    return {bytes.fromhex(path.name) for path in (folder / "blobs").iterdir()}


def test_dropped_blobs_are_gone_and_verify_says_how_many(folder: Path) -> None:
    with Ledger.open(folder, writable=True) as ledger:
        first = ledger.history("R1")[0]
        (record,) = ledger.drop_old(1, OPERATOR_KEY, 60)
        assert record.blobs == (first.payload_digest,)
        with pytest.raises(errors.DroppedError, match="dropped by the operator"):
            ledger.payload(first.payload_digest)
        assert ledger.drop_old(1, OPERATOR_KEY, 70) == []
        assert ledger.transaction(first.id) == first  # the record stays
    assert stored(folder) == {
        digest(b"first of R2"),
        digest(b"first of R3"),
        digest(b"second of R1"),
    }
    found = verify(folder)
    assert (found.ok, found.blocks, found.dropped) == (True, 7, 1)


def test_a_blob_removed_without_a_record_is_found(tmp_path: Path) -> None:
    folder = tmp_path / "ledger"
    long_ledger(folder)
    assert verify(folder).ok
    for blob in stored(folder):
        copy = shutil.copytree(folder, tmp_path / blob.hex())
        (copy / "blobs" / blob.hex()).unlink()
        found = verify(copy)
        assert not found.ok
        assert blob.hex() in found.reason
        assert found.first_bad_block is not None


def test_a_drop_beside_a_verification_is_no_damage(folder: Path) -> None:
    """Blobs go while their records are read, and the drop's own is in no snapshot of before."""

    def dropping(done: int, total: int) -> None:
        if done == 1:
            with Ledger.open(folder, writable=True) as ledger:
                ledger.drop_old(1, OPERATOR_KEY, 100)

    found = verify(folder, progress=dropping)
    assert found.ok and found.dropped > 0 and found == verify(folder)


def test_what_is_published_again_after_a_drop_must_be_there(folder: Path) -> None:
    with Ledger.open(folder, writable=True) as ledger:
        ledger.drop_old(1, OPERATOR_KEY, 60)
        ledger.publish("R1", KEYS["R1"], b"first of R1", "time", 70)
        assert verify(folder).dropped == 0
        (folder / "blobs" / digest(b"first of R1").hex()).unlink()
        with pytest.raises(errors.NotFoundError, match="is missing"):
            ledger.payload(digest(b"first of R1"))
    assert verify(folder).first_bad_block == 7  # where it was published again


def test_what_is_dropped_and_published_again_beside_a_verification_is_there(folder: Path) -> None:
    with Ledger.open(folder, writable=True) as ledger:
        first = ledger.history("R1")[0]
        payload = ledger.payload(first.payload_digest)
        ledger.publish("R1", KEYS["R1"], b"newer", "view", 70)

    def meanwhile(done: int, total: int) -> None:
        with Ledger.open(folder, writable=True) as other:
            if done == 1:
                other.drop([first.payload_digest], OPERATOR_KEY, 71)
            elif done == 3:
                other.publish("R1", KEYS["R1"], payload, "view", 72)

    found = verify(folder, progress=meanwhile)
    assert found.ok, found.reason


def test_the_newest_cannot_be_dropped(folder: Path) -> None:
    before = files(folder)
    with Ledger.open(folder, writable=True) as ledger:
        for robot in ledger.robots:
            with pytest.raises(errors.DropError, match=f"newest of {robot}"):
                ledger.drop([ledger.latest(robot).payload_digest], OPERATOR_KEY, 60)
        first = ledger.history("R1")[0].payload_digest
        for blobs, key, kind, said in (
            ([bytes(32)], OPERATOR_KEY, errors.NotFoundError, "keeps no blob"),
            ([first], KEYS["R1"], errors.SignatureError, "by operator"),
            ([], OPERATOR_KEY, errors.RecordError, "1 to"),
        ):
            with pytest.raises(kind, match=said):
                ledger.drop(blobs, key, 60)
    assert files(folder) == before


def test_an_expelled_robots_blobs_may_go_too(ledger: Ledger) -> None:
    last = ledger.publish("R1", KEYS["R1"], b"x", "start", 1, landmarks=b"seen")
    ledger.expel("R1", OPERATOR_KEY, 2)
    assert ledger.history("R1") == [last]
    ledger.drop(last.blobs, OPERATOR_KEY, 3)
    assert stored(ledger.folder) == set()
    assert verify(ledger.folder).dropped == 2


def test_bytes_that_two_robots_published_stay_while_one_needs_them(ledger: Ledger) -> None:
    ledger.publish("R1", KEYS["R1"], b"same", "start", 1)
    ledger.publish("R2", KEYS["R2"], b"same", "start", 2)
    ledger.publish("R1", KEYS["R1"], b"more", "time", 3)
    assert ledger.drop_old(1, OPERATOR_KEY, 4) == []
    assert stored(ledger.folder) == {digest(b"same"), digest(b"more")}


def test_keeping_more_than_one(ledger: Ledger) -> None:
    for number in range(5):
        ledger.publish("R1", KEYS["R1"], b"%d" % number, "time", number)
    (record,) = ledger.drop_old(3, OPERATOR_KEY, 9)
    assert set(record.blobs) == {digest(b"0"), digest(b"1")}
    assert verify(ledger.folder).dropped == 2


def test_clean_removes_orphans_only(tmp_path: Path) -> None:
    folder = tmp_path / "ledger"
    long_ledger(folder)
    before = files(folder)
    (folder / "blobs" / ("ab" * 32)).write_bytes(b"no record names it")
    (folder / "blobs" / f".{'cd' * 32}.123.tmp").write_bytes(b"never finished")
    (folder / "blobs" / "notes.txt").write_bytes(b"somebody's own")
    with Ledger.open(folder, writable=True) as ledger:
        assert ledger.clean() == 2
        assert ledger.clean() == 0
    (folder / "blobs" / "notes.txt").unlink()
    assert files(folder) == before
    assert verify(folder).ok


def test_clean_finishes_a_drop_that_was_killed(folder: Path) -> None:
    """The record is durable, the files are still there: a good ledger with orphans."""
    with Ledger.open(folder, writable=True) as ledger:
        with patch.object(ledger, "_remove_unneeded"):
            ledger.drop_old(1, OPERATOR_KEY, 60)
        assert digest(b"first of R1") in stored(folder)
        assert verify(folder).ok
        assert ledger.clean() == 1
        assert digest(b"first of R1") not in stored(folder)
        assert verify(folder).dropped == 1

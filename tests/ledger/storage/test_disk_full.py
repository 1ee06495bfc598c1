"""A disk or database without room: one clear error, and nothing half-written."""

import errno
import os
from pathlib import Path

import pytest
from ledgers import KEYS, files, new_ledger, said_by, small_ledger

from vrchain.ledger import Ledger, errors, verify


def test_a_disk_without_room_for_the_payload(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small_ledger(tmp_path / "ledger")
    before = files(tmp_path / "ledger")

    def full(handle: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with Ledger.open(tmp_path / "ledger", writable=True) as ledger:
        with monkeypatch.context() as patch:
            patch.setattr("os.fsync", full)
            with pytest.raises(errors.StorageFullError, match="no room"):
                ledger.publish("R1", KEYS["R1"], b"x" * 1000, "time", 60)
            with pytest.raises(errors.StorageFullError):
                new_ledger(tmp_path / "new")
        assert files(tmp_path / "ledger") == before
        assert not (tmp_path / "new").exists()
        ledger.publish("R1", KEYS["R1"], b"x" * 1000, "time", 60)  # and goes on
    assert verify(tmp_path / "ledger").ok


def test_a_database_without_room(tmp_path: Path) -> None:
    small_ledger(tmp_path / "ledger")
    with Ledger.open(tmp_path / "ledger", writable=True) as ledger:
        pages = ledger._db.execute("PRAGMA page_count").fetchone()[0]
        ledger._db.execute(f"PRAGMA max_page_count = {pages}")
        acknowledged = 5
        with pytest.raises(errors.StorageFullError, match="no room"):
            for time_ns in range(60, 100):
                ledger.publish("R1", KEYS["R1"], b"%d" % time_ns, "time", time_ns)
                acknowledged += 1
        assert ledger.head.height == acknowledged
        blobs = [f for f in files(tmp_path / "ledger") if f.startswith("blobs")]
        assert len(blobs) == acknowledged - 1  # one block enrols, one payload each otherwise
        ledger._db.execute("PRAGMA max_page_count = 100000")
        ledger.publish("R1", KEYS["R1"], b"more", "time", 100)
    assert verify(tmp_path / "ledger").blocks == acknowledged + 2


def test_a_limit_on_file_size_is_told_as_no_room(tmp_path: Path) -> None:
    """The operating system itself refuses the write, half-way through the payload."""
    small_ledger(tmp_path / "ledger")
    before = files(tmp_path / "ledger")
    code = """
import resource, sys
from ledgers import KEYS
from vrchain.ledger import Ledger, errors
with Ledger.open(sys.argv[1], writable=True) as ledger:
    resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
    try:
        ledger.publish("R1", KEYS["R1"], bytes(300_000), "time", 60)
    except errors.StorageFullError as error:
        print("refused:", error)
"""
    assert said_by(code, tmp_path / "ledger").startswith("refused: no room on the disk")
    assert files(tmp_path / "ledger") == before
    assert verify(tmp_path / "ledger").blocks == 6

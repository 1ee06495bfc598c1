"""A disk or database without room: one clear error, and nothing half-written."""

import errno
from pathlib import Path
from unittest.mock import patch

import pytest
from ledgers import KEYS, files, new_ledger, said_by

from vrchain.ledger import Ledger, errors, verify


def test_a_disk_without_room_for_the_payload(folder: Path) -> None:
    before, new = files(folder), folder.with_name("new")
    with Ledger.open(folder, writable=True) as ledger:
        with patch("os.fsync", side_effect=OSError(errno.ENOSPC, "full")):
            with pytest.raises(errors.StorageFullError, match="no room"):
                ledger.publish("R1", KEYS["R1"], b"x" * 1000, "time", 60)
            with pytest.raises(errors.StorageFullError):
                new_ledger(new)
        assert files(folder) == before
        assert not new.exists()
        ledger.publish("R1", KEYS["R1"], b"x" * 1000, "time", 60)  # and goes on
    assert verify(folder).ok


def test_a_database_without_room(folder: Path) -> None:
    with Ledger.open(folder, writable=True) as ledger:
        pages = ledger._db.execute("PRAGMA page_count").fetchone()[0]
        ledger._db.execute(f"PRAGMA max_page_count = {pages}")
        acknowledged = 5
        with pytest.raises(errors.StorageFullError, match="no room"):
            for time_ns in range(60, 100):
                ledger.publish("R1", KEYS["R1"], b"%d" % time_ns, "time", time_ns)
                acknowledged += 1
        assert ledger.head.height == acknowledged
        blobs = [f for f in files(folder) if f.startswith("blobs")]
        assert len(blobs) == acknowledged - 1  # one block enrols, one payload each otherwise
        ledger._db.execute("PRAGMA max_page_count = 100000")
        ledger.publish("R1", KEYS["R1"], b"more", "time", 100)
    assert verify(folder).blocks == acknowledged + 2


def test_a_limit_on_file_size_is_told_as_no_room(folder: Path) -> None:
    """The operating system itself refuses the write, half-way through the payload."""
    before = files(folder)
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
    assert said_by(code, folder).startswith("refused: no room on the disk")
    assert files(folder) == before
    assert verify(folder).blocks == 6

"""What is acknowledged lies in the folder: files swapped under a handle, files of other kinds."""

import os
import shutil
import sqlite3
import stat
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest
from ledgers import KEYS, files

from vrchain.ledger import Ledger, errors, reader, store, verify
from vrchain.ledger.records.keys import DATABASE_NAME
from vrchain.ledger.storage.database import insert_entry
from vrchain.ledger.storage.resume import read_state

SWAPS: dict[str, Callable[[Path], object]] = {
    "folder moved": lambda f: f.rename(f.with_name("moved")),
    "folder restored": lambda f: (
        f.rename(f.with_name("moved")),
        shutil.copytree(f.with_name("backup"), f),
    ),
    "database deleted": lambda f: (f / DATABASE_NAME).unlink(),
    "database restored": lambda f: os.replace(
        shutil.copy(f.with_name("backup") / DATABASE_NAME, f / "new"), f / DATABASE_NAME
    ),
    "log deleted": lambda f: (f / f"{DATABASE_NAME}-wal").unlink(),
    "index deleted": lambda f: (f / f"{DATABASE_NAME}-shm").unlink(),
}


@pytest.fixture
def folder(pristine: Path, tmp_path: Path) -> Path:
    """A good ledger, with a copy beside it."""
    shutil.copytree(pristine, tmp_path / "backup")
    return shutil.copytree(pristine, tmp_path / "ledger")


@pytest.mark.parametrize("swap", SWAPS)
def test_nothing_is_acknowledged_into_a_file_that_is_gone(folder: Path, swap: str) -> None:
    with Ledger.open(folder, writable=True) as writer, Ledger.open(folder) as reader:
        SWAPS[swap](folder)
        for ask in (
            lambda: writer.publish("R1", KEYS["R1"], b"x", "time", 60),
            lambda: writer.clean(),
            writer.refresh,
            reader.refresh,
            lambda: list(reader.follow(6, wait_s=60)),
        ):
            with pytest.raises(errors.ReplacedError, match="open it again"):
                ask()
        assert writer.head.height == 5


@pytest.mark.parametrize("swap", SWAPS)
@pytest.mark.parametrize("moment", ["before", "after"])
def test_a_swap_in_the_middle_of_an_update_is_not_acknowledged(
    folder: Path, swap: str, moment: str
) -> None:
    """Just before the commit, and just after it."""

    def inserted(*given: Any) -> None:
        insert_entry(*given)
        SWAPS[swap](folder)

    def committed() -> None:
        if not ledger._db.in_transaction:
            SWAPS[swap](folder)
        check()

    with Ledger.open(folder, writable=True) as ledger:
        check = ledger._place.check
        before = patch.object(store, "insert_entry", inserted)
        after = patch.object(ledger._place, "check", committed)
        with before if moment == "before" else after, pytest.raises(errors.ReplacedError):
            ledger.publish("R1", KEYS["R1"], b"x", "time", 60)
        assert ledger.head.height == 5
    if swap == "folder restored":
        assert verify(folder).ok and verify(folder).blocks == 6


def test_a_swap_while_it_is_opened_is_noticed(folder: Path) -> None:
    def swapped(db: sqlite3.Connection) -> object:
        SWAPS["folder restored"](folder)
        return read_state(db)

    with patch.object(reader, "read_state", swapped), pytest.raises(errors.ReplacedError):
        Ledger.open(folder)
    shutil.rmtree(folder.with_name("moved"))
    found = verify(folder, progress=lambda done, total: done == 6 and SWAPS["folder moved"](folder))
    assert not found.ok and "open it again" in found.reason


def test_a_relative_folder_is_meant_from_where_it_was_opened(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder.parent)
    with Ledger.open("ledger", writable=True) as ledger:
        monkeypatch.chdir("/")
        ledger.publish("R1", KEYS["R1"], b"x", "time", 60)
    assert verify(folder).ok and verify(folder).blocks == 7


def special(kind: str, path: Path) -> None:
    """Something at ``path`` that is no plain file and that nobody answers at its other end."""
    if path.exists():
        path.rename(path.with_name("aside"))
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "link":
        path.symlink_to(path.with_name("aside"))
    else:
        try:
            os.mknod(path, stat.S_IFCHR | 0o600, os.makedev(1, 5))  # as /dev/zero
        except PermissionError:
            pytest.skip("making a device needs root")


@pytest.mark.timeout(20)
@pytest.mark.parametrize("kind", ["pipe", "link", "device"])
@pytest.mark.parametrize(
    "name", ["", "-wal", "-shm", "-journal", "queue", "blobs", "a blob"], ids=str
)
def test_only_plain_files_are_opened(folder: Path, kind: str, name: str) -> None:
    """Nothing waits for a pipe, reads a device without end, or follows a link out of the folder."""
    blob = next(iter((folder / "blobs").iterdir()))
    plain = folder / name if name in ("queue", "blobs") else folder / f"{DATABASE_NAME}{name}"
    path = blob if name == "a blob" else plain
    special(kind, path)
    before = path.lstat()
    if name == "":
        for ask in (lambda: verify(folder), lambda: Ledger.open(folder)):
            with pytest.raises(errors.NotALedgerError, match="plain file"):
                ask()
    else:
        found = verify(folder)
        assert not found.ok and ("plain file" in found.reason or "no file of" in found.reason)
        if name == "a blob":
            with Ledger.open(folder) as ledger, pytest.raises(errors.DamagedError, match="plain"):
                ledger.payload(bytes.fromhex(blob.name))
        else:
            for writable in (False, True):
                with pytest.raises(errors.DamagedError):
                    Ledger.open(folder, writable)
    assert path.lstat() == before


def test_a_link_to_the_folder_is_followed_until_it_leads_elsewhere(folder: Path) -> None:
    link = folder.with_name("link")
    link.symlink_to("ledger")
    with Ledger.open(link, writable=True) as ledger:
        ledger.publish("R1", KEYS["R1"], b"x", "time", 60)
        link.unlink()
        link.symlink_to("backup")
        before = files(folder.with_name("backup"))
        with pytest.raises(errors.ReplacedError):
            ledger.publish("R1", KEYS["R1"], b"y", "time", 70)
    assert files(folder.with_name("backup")) == before
    assert verify(folder).blocks == 7


def test_what_lies_at_a_temporary_name_is_not_written_through(folder: Path) -> None:
    mine = folder.with_name("mine")
    mine.write_text("mine")
    name = "2d711642b726b04401627ca9fbac32f5c8530fb1903cc4db02258717921a4881"  # SHA-256 of b"x"
    (folder / "blobs" / f".{name}.{os.getpid()}.tmp").symlink_to(mine)
    with Ledger.open(folder, writable=True) as ledger:
        ledger.publish("R1", KEYS["R1"], b"x", "time", 60)
    assert mine.read_text() == "mine" and verify(folder).ok

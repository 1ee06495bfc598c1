"""A new ledger's folder: wholly there or not at all."""

import os
import sqlite3
from pathlib import Path

from vrchain.ledger.errors import LedgerExistsError
from vrchain.ledger.records.block import Entry
from vrchain.ledger.records.keys import DATABASE_NAME
from vrchain.ledger.storage.database import SCHEMA, insert_entry, prepare
from vrchain.ledger.storage.durable import storage_errors, sync_folder


def create_folder(folder: Path, first: Entry) -> None:
    """Make ``folder``, missing or empty, a ledger of one entry, durably.

    Raises LedgerExistsError when something is there, StorageError when it cannot be
    written; then nothing is left behind.
    """
    made = folder / DATABASE_NAME
    draft = folder / f".{DATABASE_NAME}.{os.getpid()}.new"
    with storage_errors(f"creating the ledger {folder}"):
        is_new, is_made = _check_room(folder), False
        try:
            folder.mkdir(parents=True, exist_ok=True)
            for leftover in folder.glob(f"{draft.name}*"):  # of a killed process of this number
                leftover.unlink()
            _create_database(draft, first)
            try:
                os.link(draft, made)  # unlike a rename, it replaces no ledger of another process
            except FileExistsError:
                raise LedgerExistsError(
                    f"{folder} holds a ledger already, made meanwhile"
                ) from None
            except OSError:  # this file system has no links
                os.rename(draft, made)
            is_made = True
            draft.unlink(missing_ok=True)
            sync_folder(folder)
            sync_folder(folder.absolute().parent)
        except BaseException:
            for leftover in [*[made] * is_made, *folder.glob(f"{draft.name}*")]:
                leftover.unlink(missing_ok=True)
            if is_new and folder.exists() and not any(folder.iterdir()):
                folder.rmdir()
            raise


def _create_database(path: Path, first: Entry) -> None:
    """A new database file with the first entry, closed and durable. Raises sqlite3.Error."""
    db = sqlite3.connect(path, isolation_level=None)
    try:
        prepare(db, wait_s=5.0)
        db.execute("PRAGMA journal_mode = WAL")  # kept in the file's header
        db.executescript(SCHEMA)
        db.execute("BEGIN IMMEDIATE")
        insert_entry(db, first)
        db.execute("COMMIT")
    finally:
        db.close()


def _check_room(folder: Path) -> bool:
    """Whether the folder has to be made."""
    if (folder / DATABASE_NAME).exists():
        raise LedgerExistsError(f"{folder} holds a ledger already; choose another folder")
    if folder.exists() and not folder.is_dir():
        raise LedgerExistsError(f"{folder} is not a folder; choose another name")
    drafts = f".{DATABASE_NAME}."  # of who was killed
    if folder.is_dir() and any(not file.name.startswith(drafts) for file in folder.iterdir()):
        raise LedgerExistsError(f"{folder} is not empty and no ledger; choose another folder")
    return not folder.exists()

"""Tampering with a stored ledger as somebody who holds its folder can, and who notices."""

import shutil
import sqlite3
import tempfile
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pandas as pd

from vrchain.errors import LedgerError
from vrchain.ledger import Ledger, SigningKey, Transaction, Verification, verify
from vrchain.ledger.errors import NotFoundError
from vrchain.ledger.records.block import Entry, records_root
from vrchain.ledger.records.table import Table
from vrchain.ledger.storage.database import insert_entry, last_height
from vrchain.ledger.storage.place import BLOBS_NAME, database_in

Tamper = Callable[[Path], object]
_UNNOTICED = "nothing: all is good"


def who_notices(folder: Path, tamper: Tamper) -> pd.DataFrame:
    """Tamper with a copy of the ledger in ``folder``; who looks, and what they say.

    One row each: who, says. The witness had the ledger open before; the newcomer opens it after.
    Raises NotALedgerError.
    """
    database_in(folder)
    with tempfile.TemporaryDirectory() as name:
        copy = shutil.copytree(folder, Path(name) / "ledger")
        with Ledger.open(copy) as witness:
            head = witness.head.hash
            tamper(copy)
            asked: dict[str, Callable[[], str]] = {
                "a newcomer that reads everything": lambda: _newcomer(copy),
                "a witness of how it was": lambda: _read_all(witness),
                "verify": lambda: _said(verify(copy)),
                "verify, knowing the head's hash": lambda: _said(verify(copy, expected_head=head)),
            }
            rows = [(who, _answer(ask)) for who, ask in asked.items()]
    return pd.DataFrame(rows, columns=["who", "says"])


def change_panorama(folder: Path, blob: bytes) -> None:
    """Turn over one bit in the middle of a stored blob. NotFoundError where none is."""
    path = _blob(folder, blob)
    path.write_bytes(_changed(path.read_bytes()))


def remove_panorama(folder: Path, blob: bytes) -> None:
    """Delete a stored blob. NotFoundError where none is."""
    _blob(folder, blob).unlink()


def change_record(folder: Path, height: int) -> None:
    """Turn over one bit in the middle of the first record at ``height``. NotFoundError."""
    with closing(_database(folder)) as db:
        _check_height(db, height)
        first = "WHERE height = ? AND position = 0"
        (record,) = db.execute(f"SELECT record FROM records {first}", (height,)).fetchone()
        db.execute(f"UPDATE records SET record = ? {first}", (_changed(record), height))


def cut_tail(folder: Path, height: int) -> None:
    """Delete the block at ``height`` and all after it, with their records. NotFoundError."""
    with closing(_database(folder)) as db:
        _check_height(db, height)
        for table in ("blocks", "records"):
            db.execute(f"DELETE FROM {table} WHERE height >= ?", (height,))


def sign_again(folder: Path, author: str, key: SigningKey) -> None:
    """Sign the newest block's transactions, and the block as ``author``'s, with another's key.

    Ids, roots and columns are made to go with the new signatures.
    """
    with Ledger.open(folder) as ledger:
        block, records = ledger.entry(ledger.head.height)
    forged = tuple(replace(r, signature=b"").signed(key) for r in records)
    names = {r.robot: r.id for r in forged if isinstance(r, Transaction)}
    table = Table(dict(block.newest) | names)
    root = records_root(forged)
    draft = replace(block, records_root=root, newest_root=table.root, author=author, signature=b"")
    cut_tail(folder, block.height)
    with closing(_database(folder)) as db:
        insert_entry(db, Entry(draft.signed(key), forged))


def _database(folder: Path) -> sqlite3.Connection:
    return sqlite3.connect(database_in(folder), isolation_level=None)


def _check_height(db: sqlite3.Connection, height: int) -> None:
    last = last_height(db)
    if not 0 <= height <= last:
        raise NotFoundError(f"expected the height of a block, 0 to {last}, got {height}")


def _blob(folder: Path, blob: bytes) -> Path:
    path = folder / BLOBS_NAME / blob.hex()
    if not path.is_file():
        raise NotFoundError(f"expected the digest of a stored blob, got {blob.hex()}")
    return path


def _changed(data: bytes) -> bytes:
    changed = bytearray(data)
    changed[len(changed) // 2] ^= 1
    return bytes(changed)


def _answer(ask: Callable[[], str]) -> str:
    try:
        return ask()
    except LedgerError as error:
        return f"{type(error).__name__}: {error}"


def _newcomer(folder: Path) -> str:
    with Ledger.open(folder) as ledger:
        return _read_all(ledger)


def _read_all(ledger: Ledger) -> str:
    ledger.refresh()
    for robot in ledger.robots:
        for transaction in ledger.history(robot):
            for blob in transaction.blobs:
                ledger.payload(blob)
    return _UNNOTICED


def _said(found: Verification) -> str:
    return _UNNOTICED if found.ok else f"bad block {found.first_bad_block}: {found.reason}"

"""Tampering with a stored ledger as somebody who holds its folder can, and who notices."""

import shutil
import sqlite3
import tempfile
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, replace
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


def change_panorama(folder: Path, robot: str) -> None:
    """Turn over one bit in the middle of a robot's newest panorama. NotFoundError: it has none."""
    path = _newest(folder, robot)
    path.write_bytes(_changed(path.read_bytes()))


def remove_panorama(folder: Path, robot: str) -> None:
    """Delete a robot's newest panorama. NotFoundError where it has none."""
    _newest(folder, robot).unlink()


def change_record(folder: Path, height: int) -> None:
    """Turn over one bit in the middle of the first record at ``height``. NotFoundError."""
    with closing(_database(folder)) as db:
        _check_height(db, height)
        first = "WHERE height = ? AND position = 0"
        (record,) = db.execute(f"SELECT record FROM records {first}", (height,)).fetchone()
        db.execute(f"UPDATE records SET record = ? {first}", (_changed(record), height))


@dataclass(frozen=True)
class Part:
    """Bytes that a ledger keeps: those of a block, or of a record or a blob that it brought."""

    height: int
    data: bytes
    position: int | None = None
    blob: bytes | None = None


def stored(folder: Path) -> dict[str, Part]:
    """All that a good ledger keeps, by name: block 2, block 2: transaction, block 2: panorama.

    Of several alike in a block the later ones are numbered. NotALedgerError.
    """
    with Ledger.open(folder) as ledger:
        entries = list(ledger.entries())
    with closing(_database(folder)) as db:
        blocks = dict(db.execute("SELECT height, record FROM blocks"))
        query = "SELECT height, position, record FROM records"
        records = {(h, p): data for h, p, data in db.execute(query)}
    found = {}
    for block, brought in entries:
        parts = [("", Part(block.height, blocks[block.height]))]
        for position, record in enumerate(brought):
            data = records[block.height, position]
            parts.append((type(record).__name__.lower(), Part(block.height, data, position)))
            blobs = record.blobs if isinstance(record, Transaction) else ()
            for word, blob in zip(("panorama", "landmarks"), blobs, strict=False):
                path = folder / BLOBS_NAME / blob.hex()
                if path.is_file():
                    parts.append((word, Part(block.height, path.read_bytes(), blob=blob)))
        count = Counter[str]()
        for word, part in parts:
            count[word] += 1
            again = f" {count[word]}" if count[word] > 1 else ""
            found[f"block {block.height}" + (f": {word}{again}" if word else "")] = part
    return found


def change_byte(folder: Path, name: str, at: int, bit: int = 0) -> None:
    """Turn over a bit, 0 to 7, of the byte ``at`` of one of ``stored``. NotFoundError."""
    parts = stored(folder)
    if name not in parts:
        raise NotFoundError(f"expected a part of {', '.join(parts)}, got {name!r}")
    part = parts[name]
    changed = bytearray(part.data)
    if not 0 <= at < len(changed) or not 0 <= bit < 8:
        raise NotFoundError(
            f"expected of {name} a byte of 0 to {len(changed) - 1} and a bit of 0 to 7, "
            f"got {at} and {bit}"
        )
    changed[at] ^= 1 << bit
    if part.blob is not None:
        (folder / BLOBS_NAME / part.blob.hex()).write_bytes(changed)
        return
    with closing(_database(folder)) as db:
        if part.position is None:
            db.execute("UPDATE blocks SET record = ? WHERE height = ?", (changed, part.height))
        else:
            row = changed, part.height, part.position
            db.execute("UPDATE records SET record = ? WHERE height = ? AND position = ?", row)


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


def _newest(folder: Path, robot: str) -> Path:
    with Ledger.open(folder) as ledger:
        seen = [name for name in ledger.robots if ledger.latest(name) is not None]
        if robot not in seen:
            raise NotFoundError(f"expected a robot with a panorama: {', '.join(seen)}, got {robot}")
        transaction = ledger.latest(robot)
    assert transaction is not None
    return folder / BLOBS_NAME / transaction.payload_digest.hex()


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

"""Verification of a whole ledger from disk, trusting nothing but the arithmetic."""

import contextlib
import os
import sqlite3
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from vrchain.errors import LedgerError
from vrchain.ledger.errors import AccessError, DamagedError, ReplacedError
from vrchain.ledger.records.block import Record
from vrchain.ledger.rules.validity import State, begin, follow
from vrchain.ledger.storage.blobs import BlobStore
from vrchain.ledger.storage.database import connect, last_height, oversized, read_entries
from vrchain.ledger.storage.durable import storage_errors
from vrchain.ledger.storage.place import BLOBS_NAME, Place, database_in
from vrchain.ledger.storage.resume import first_unreadable
from vrchain.ledger.storage.retention import Retention, named_by


@dataclass(frozen=True)
class Verification:
    """``blocks``: how many were found good, from the first on.

    ``first_bad_block``: its height, None when all are good, or when the blocks are good and can
    be found, but something beside them is not. ``reason``: what is wrong, empty when ``ok``.
    ``dropped``: how many blobs need not be there any more, by the operator's records.
    """

    ok: bool
    blocks: int
    first_bad_block: int | None
    reason: str
    dropped: int = 0


def verify(
    folder: str | os.PathLike[str],
    expected_head: bytes | None = None,
    progress: Callable[[int, int], object] = lambda done, total: None,
) -> Verification:
    """Read everything in ``folder`` again; recompute every hash, signature and blob digest.

    ``expected_head``: a block hash known from elsewhere that must be in the chain; without
    one, a ledger whose last blocks were cut off cleanly is a good, shorter ledger.
    ``progress(done, total)`` is called after each block.
    Raises NotALedgerError where no ledger is, AccessError where none may be read; every damage is
    a Verification, never raised.
    """
    path = Path(folder).absolute()
    place = Place(path)
    with contextlib.suppress(DamagedError):  # that is for ``connect`` to say
        database_in(path)
    try:
        db = connect(path, writable=False, wait_s=5.0)
    except AccessError:
        raise
    except LedgerError as error:
        return Verification(False, 0, 0, str(error))
    try:
        found = _verify(db, BlobStore(path / BLOBS_NAME), expected_head, progress)
        place.settle()
        return found
    except ReplacedError as error:
        return Verification(False, 0, None, str(error))
    finally:
        db.close()


def _verify(
    db: sqlite3.Connection,
    blobs: BlobStore,
    expected_head: bytes | None,
    progress: Callable[[int, int], object],
) -> Verification:
    state: State | None = None
    height = 0
    known = expected_head is None
    retention = Retention()
    missing: dict[bytes, str] = {}  # what is wrong with a blob; a later drop excuses it
    try:
        while True:
            with storage_errors("reading the ledger"):
                db.rollback()
                db.execute("BEGIN")  # one snapshot, whatever others write meanwhile
            if (large := oversized(db)) is not None:
                why = f"a record of block {large} is too big to be read"
                return Verification(False, 0, large, why)
            total, known_blocks = last_height(db) + 1, height
            for entry in read_entries(db, height, max(total, 1)):
                state = follow(state, *entry) if state else begin(*entry)
                for record in entry.records:
                    retention.take(record, height)
                    for blob in named_by([record]):  # it may have come again since
                        missing.pop(blob, None)
                    missing |= _missing(blobs, record)
                known = known or entry.block.hash == expected_head
                height += 1
                progress(height, total)
            kept = retention.kept
            unexcused = [(kept[blob], why) for blob, why in missing.items() if blob in kept]
            if not unexcused or height == known_blocks:
                break  # else a drop that was written since may excuse it
    except LedgerError as error:
        return _bad(height, str(error))
    if unexcused:
        return _bad(*min(unexcused))
    if not known:
        return _bad(height, "the known head is not in the chain: its end was cut off or rewritten")
    try:
        if _any(db, "height >= ?", height):
            reason = f"the tables hold rows of block {height} or later, which is not there"
            return _bad(height, reason)
        _check_rest(db)
    except LedgerError as error:
        return Verification(False, height, first_unreadable(db, height), str(error))
    return Verification(True, height, None, "", len(retention.dropped))


def _bad(height: int, reason: str) -> Verification:
    """All blocks below ``height`` are good, that one is not."""
    return Verification(False, height, height, reason)


def _missing(blobs: BlobStore, record: Record) -> dict[bytes, str]:
    """What is wrong with the blobs that the record names, by digest."""
    found = {}
    for blob in named_by([record]):
        try:
            with storage_errors("reading a payload"):
                blobs.get(blob)
        except LedgerError as error:
            found[blob] = str(error)
    return found


def _any(db: sqlite3.Connection, condition: str, height: int = 0) -> bool:
    """Whether a row of blocks or of records meets a condition on its height."""
    with storage_errors("checking the database"):
        queries = [f"SELECT 1 FROM {t} WHERE {condition} LIMIT 1" for t in ("blocks", "records")]
        return any(db.execute(query, (height,)).fetchone() for query in queries)


def _check_rest(db: sqlite3.Connection) -> None:
    """No rows below those of the good blocks, and indexes that agree with the tables."""
    if _any(db, "height < ?"):
        raise DamagedError("the tables hold rows that belong to no block")
    with storage_errors("checking the database"):
        found = db.execute("PRAGMA integrity_check(1)").fetchone()[0]
        if found != "ok":
            raise DamagedError(f"SQLite finds its file inconsistent: {found}")

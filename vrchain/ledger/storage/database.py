"""Blocks and records in SQLite. Reading is strict: every column must follow from the records."""

import contextlib
import functools
import os
import sqlite3
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, TypeAlias

from vrchain.errors import LedgerError
from vrchain.ledger.errors import (
    AccessError,
    DamagedError,
    NotALedgerError,
    NotFoundError,
    StorageError,
    TooLargeError,
)
from vrchain.ledger.records.block import Block, Entry, Record, decode_record
from vrchain.ledger.records.encoding import MAX_PAYLOAD_BYTES, MAX_RECORD_BYTES
from vrchain.ledger.records.transaction import Transaction
from vrchain.ledger.storage.durable import storage_errors
from vrchain.ledger.storage.place import database_in

APPLICATION_ID = 0x56524C31  # "VRL1"
FORMAT_VERSION = 2

# robot is null for the operator's records. Its index goes on with the primary key's columns, so
# that it finds a robot's transactions in their order, and its newest up to a height.
SCHEMA = f"""
PRAGMA application_id = {APPLICATION_ID};
PRAGMA user_version = {FORMAT_VERSION};
CREATE TABLE blocks (height INTEGER PRIMARY KEY, hash BLOB NOT NULL, record BLOB NOT NULL);
CREATE TABLE records (
    height INTEGER NOT NULL,
    position INTEGER NOT NULL,
    id BLOB NOT NULL UNIQUE,
    robot TEXT,
    record BLOB NOT NULL,
    PRIMARY KEY (height, position)
) WITHOUT ROWID;
CREATE INDEX robots ON records (robot);
"""

_LOG_PAGES = 256  # of 4 KiB, before SQLite's log is written back: it is a small part of the disk
_ORDER = "ORDER BY height, position"  # the chain's
_CELL_BYTES = 2 * MAX_RECORD_BYTES  # a stored value larger than this is not even read
_ROWS_BYTES = MAX_PAYLOAD_BYTES  # of one block

_BlockRow: TypeAlias = tuple[int, bytes, bytes]
_RecordRow: TypeAlias = tuple[int, int, bytes, str | None, bytes]


def connect(folder: Path, writable: bool, wait_s: float) -> sqlite3.Connection:
    """A connection to the ledger in ``folder``; it creates nothing where there is none.

    Raises NotALedgerError, AccessError, DamagedError, StorageError.
    """
    path = database_in(folder)
    _check_access(path, writable)
    with storage_errors(f"opening {path}"):
        uri = f"{path.as_uri()}?mode={'rw' if writable else 'ro'}"
        db = sqlite3.connect(uri, uri=True, isolation_level=None)
        try:
            prepare(db, wait_s)
            application = db.execute("PRAGMA application_id").fetchone()[0]
            version = db.execute("PRAGMA user_version").fetchone()[0]
            if (application, version) != (APPLICATION_ID, FORMAT_VERSION):
                raise NotALedgerError(
                    f"expected a ledger of format {FORMAT_VERSION} in {path}, "
                    f"got application id {application:#x}, format {version}"
                )
            if db.execute("PRAGMA journal_mode").fetchone()[0] != "wal":
                raise DamagedError(f"expected a write-ahead log beside {path}, got none")
            check_schema(db)
        except BaseException:
            db.close()
            raise
        return db


def _check_access(path: Path, writable: bool) -> None:
    """Say plainly what SQLite would be unable to open whatever the file holds: AccessError."""
    if not os.access(path, os.R_OK | os.W_OK if writable else os.R_OK):
        doing = "write" if writable else "read"
        raise AccessError(f"expected to be allowed to {doing} {path}; mend its permissions")
    if not os.access(path.parent, os.W_OK) and not path.with_name(f"{path.name}-shm").exists():
        raise AccessError(
            f"expected a folder in which SQLite may make its working files, got {path.parent}: "
            "copy the ledger to one"
        )


def check_schema(db: sqlite3.Connection) -> None:
    """DamagedError for other tables and indexes than a ledger's, or any view or trigger.

    A view could have rows without end, a trigger take back what was written.
    """
    expected = _schema()
    with storage_errors("reading the schema"):
        if _stored_schema(db, len(expected) + 1) != expected:
            raise DamagedError("expected the schema of a ledger and nothing else, got another one")


@functools.cache
def _schema() -> list[tuple[str, str, str, str | None]]:
    with contextlib.closing(sqlite3.connect(":memory:")) as db:
        db.executescript(SCHEMA)
        return _stored_schema(db, -1)


def _stored_schema(db: sqlite3.Connection, limit: int) -> list[tuple[str, str, str, str | None]]:
    query = "SELECT type, name, tbl_name, sql FROM main.sqlite_master LIMIT ?"
    return sorted(db.execute(query, (limit,)), key=repr)


def insert_entry(db: sqlite3.Connection, entry: Entry) -> None:
    """Insert the entry's rows. TooLargeError for more than is ever read; sqlite3.Error."""
    rows = _record_rows(entry)
    if sum(map(_size_of, rows)) > _ROWS_BYTES - _CELL_BYTES:
        raise TooLargeError(
            f"expected records of at most {_ROWS_BYTES} bytes in one block, got {len(rows)} "
            "records with more; make several blocks of them"
        )
    db.execute("INSERT INTO blocks VALUES (?, ?, ?)", _block_row(entry.block))
    db.executemany("INSERT INTO records VALUES (?, ?, ?, ?, ?)", rows)


def read_entries(db: sqlite3.Connection, start: int, stop: int) -> Iterator[Entry]:
    """The entries from height ``start`` to before ``stop``.

    NotFoundError where a block is missing, DamagedError unless every stored byte and column
    is what these records make it. Whether they follow the chain, and whether a block's roots
    are those of its records and table, is not judged here.
    """
    for height in range(start, stop):
        with storage_errors(f"reading blocks {height} to {height}"):
            block = db.execute("SELECT * FROM blocks WHERE height = ?", (height,)).fetchone()
            query = f"SELECT * FROM records WHERE height = ? {_ORDER}"
            rows = _bounded(db.execute(query, (height,)))
        if block is None:
            raise NotFoundError(f"block {height} is missing")
        yield _entry(block, rows)


def _bounded(rows: Iterable[_RecordRow]) -> list[_RecordRow]:
    """The rows, if they have no more bytes than are taken into memory. DamagedError."""
    found, size = [], 0
    for row in rows:
        found.append(row)
        size += _size_of(row)
        if size > _ROWS_BYTES:
            raise DamagedError(
                f"the rows of one block, or of several, have over {_ROWS_BYTES} bytes"
            )
    return found


def _size_of(row: tuple[object, ...]) -> int:
    return sum(map(sys.getsizeof, row))


def _entry(row: _BlockRow, rows: list[_RecordRow]) -> Entry:
    height = row[0]
    try:
        block = Block.decode(row[2])
        entry = Entry(block, tuple([decode_record(row[-1]) for row in rows]))
    except LedgerError as error:
        raise DamagedError(f"block {height} or a record of it is damaged: {error}") from None
    if row != _block_row(block):
        raise DamagedError(f"block {height} is not stored under its own height and hash")
    if rows != _record_rows(entry):
        raise DamagedError(f"a record of block {height} is not stored under its own columns")
    return entry


def read_record(db: sqlite3.Connection, record_id: bytes) -> Record:
    """The record with this id. NotFoundError, DamagedError."""
    with storage_errors("reading a record"):
        row = db.execute("SELECT record FROM records WHERE id = ?", (record_id,)).fetchone()
    if row is None:
        raise NotFoundError(f"the ledger holds no record {record_id.hex()}")
    return _checked(row[0], record_id)


def _checked(data: bytes, record_id: bytes) -> Record:
    """A stored record, once its bytes are those that the id stands for; DamagedError."""
    try:
        record = decode_record(data)
    except LedgerError as error:
        raise DamagedError(f"a stored record is damaged: {error}; run verify") from None
    if record.id != record_id:
        raise DamagedError(f"the record {record_id.hex()} has other bytes than its id; run verify")
    return record


def last_height(db: sqlite3.Connection) -> int:
    """The greatest height stored, -1 when no block is."""
    with storage_errors("reading the head"):
        height = db.execute("SELECT max(height) FROM blocks").fetchone()[0]
    if height is None:
        return -1
    if not isinstance(height, int):
        raise StorageError("the table of blocks holds no heights")
    return height


def news(db: sqlite3.Connection, height: int) -> list[tuple[int, bytes]]:
    """(height, hash) of the block at ``height`` and of the next one, those that are there."""
    query = "SELECT height, hash FROM blocks WHERE height >= ? ORDER BY height LIMIT 2"
    with storage_errors("reading the head"):
        return db.execute(query, (height,)).fetchall()


def find_transaction(db: sqlite3.Connection, robot: str, sequence: int) -> Transaction | None:
    """The robot's stored transaction with this number, None where none is. DamagedError."""
    # Numbers have no gaps, so the number is the place.
    rest = "robot = ? ORDER BY height, position LIMIT 1 OFFSET ?"
    return _transaction(db, rest, (robot, sequence))


def newest_transaction(db: sqlite3.Connection, robot: str, height: int) -> Transaction | None:
    """The robot's newest up to the block at ``height``, None before its first. DamagedError."""
    rest = "robot = ? AND height <= ? ORDER BY height DESC, position DESC LIMIT 1"
    return _transaction(db, rest, (robot, height))


def _transaction(db: sqlite3.Connection, rest: str, values: tuple[str, int]) -> Transaction | None:
    with storage_errors("reading a transaction"):
        row = db.execute(f"SELECT id, record FROM records WHERE {rest}", values).fetchone()
    if row is None:
        return None
    record = _checked(row[1], row[0])
    if not isinstance(record, Transaction):
        raise DamagedError(f"{record} is stored as a transaction; run verify")
    return record


def read_records(
    db: sqlite3.Connection, what: str, condition: str = "true", values: tuple[Any, ...] = ()
) -> Iterator[Record]:
    """The stored records that meet a condition, in the chain's order; ``what`` are they?

    DamagedError for one that is not what its id says, and where they lead round in a circle.
    """
    query = f"SELECT height, position, id, record FROM records WHERE {condition} {_ORDER}"
    with storage_errors(f"reading {what}"):
        for record_id, data in _in_order(db.execute(query, values)):
            yield _checked(data, record_id)


def operator_records(db: sqlite3.Connection, height: int) -> list[Record]:
    """What the operator signed up to the block at ``height``, genesis first. DamagedError."""
    condition = "robot IS NULL AND height <= ?"
    found = list(read_records(db, "the operator's records", condition, (height,)))
    numbers = [getattr(record, "sequence", -1) for record in found]
    if numbers != list(range(-1, len(found) - 1)):
        raise DamagedError("the operator's records are not whole; run verify")
    return found


def oversized(db: sqlite3.Connection) -> int | None:
    """The height of the first record that is too large to be read, None if none is found.

    A search in the table takes whole rows into memory to compare them, so ask before: this goes
    through it from its beginning, and ends early where the file is spoilt in another way.
    """
    with contextlib.suppress(StorageError), storage_errors("looking for what is too large"):
        size = "max(length(id), length(record), ifnull(length(robot), 0))"
        sizes = db.execute(f"SELECT {size} FROM records {_ORDER}")
        rows = _in_order(db.execute(f"SELECT height, position, height FROM records {_ORDER}"))
        for (height,) in rows:
            try:
                (size,) = next(sizes)
            except sqlite3.DataError:  # too long a text in the row after, which is fetched ahead
                return next(rows, (height,))[0]
            if size is not None and size > _CELL_BYTES:
                return height
    return None


def _in_order(rows: Iterable[tuple[Any, ...]]) -> Iterator[tuple[Any, ...]]:
    """What comes after height and position. DamagedError where these do not go up.

    In a spoilt file the tree of rows may lead round in a circle.
    """
    last = (-1, -1)
    for height, position, *rest in rows:
        if {type(height), type(position)} != {int} or (height, position) <= last:
            raise DamagedError("the records are not stored in their order; run verify")
        last = height, position
        yield tuple(rest)


def prepare(db: sqlite3.Connection, wait_s: float) -> None:
    """Settings of every connection: durable, patient, and bounded in memory and disk."""
    db.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, _CELL_BYTES)
    db.execute(f"PRAGMA busy_timeout = {int(wait_s * 1000)}")
    db.execute("PRAGMA trusted_schema = OFF")
    db.execute("PRAGMA synchronous = FULL")
    db.execute(f"PRAGMA wal_autocheckpoint = {_LOG_PAGES}")


def _block_row(block: Block) -> _BlockRow:
    return block.height, block.hash, block.record


def _record_rows(entry: Entry) -> list[_RecordRow]:
    height = entry.block.height
    return [
        (
            height,
            position,
            record.id,
            record.robot if isinstance(record, Transaction) else None,
            record.record,
        )
        for position, record in enumerate(entry.records)
    ]

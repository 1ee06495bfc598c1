"""Blocks and records in SQLite. Reading is strict: every column must follow from the records."""

import sqlite3
from pathlib import Path

from vrchain.errors import LedgerError
from vrchain.ledger.block import Block, Entry, Record, decode_record
from vrchain.ledger.durable import storage_errors
from vrchain.ledger.errors import (
    DamagedError,
    NotALedgerError,
    NotFoundError,
    StorageError,
)
from vrchain.ledger.keys import DATABASE_NAME
from vrchain.ledger.transaction import Transaction

APPLICATION_ID = 0x56524C31  # "VRL1"
FORMAT_VERSION = 1

# robot and sequence are null for the operator's records.
_SCHEMA = f"""
PRAGMA application_id = {APPLICATION_ID};
PRAGMA user_version = {FORMAT_VERSION};
CREATE TABLE blocks (height INTEGER PRIMARY KEY, hash BLOB NOT NULL, record BLOB NOT NULL);
CREATE TABLE records (
    id BLOB PRIMARY KEY,
    height INTEGER NOT NULL,
    position INTEGER NOT NULL,
    robot TEXT,
    sequence INTEGER,
    record BLOB NOT NULL,
    UNIQUE (height, position),
    UNIQUE (robot, sequence)
);
"""

_COLUMNS = "id, height, position, robot, sequence, record"


def create_database(path: Path, first: Entry) -> None:
    """A new database file with the first entry, closed and durable. Raises sqlite3.Error."""
    db = sqlite3.connect(path, isolation_level=None)
    try:
        _prepare(db, wait_s=5.0)
        db.execute("PRAGMA journal_mode = WAL")  # kept in the file's header
        db.executescript(_SCHEMA)
        db.execute("BEGIN IMMEDIATE")
        insert_entry(db, first)
        db.execute("COMMIT")
    finally:
        db.close()


def connect(folder: Path, writable: bool, wait_s: float) -> sqlite3.Connection:
    """A connection to the ledger in ``folder``; it creates nothing where there is none.

    Raises NotALedgerError, StorageError.
    """
    path = Path(folder).absolute() / DATABASE_NAME
    if not path.is_file():
        raise NotALedgerError(f"expected a ledger's folder with a file {DATABASE_NAME}: {folder}")
    with storage_errors(f"opening {path}"):
        uri = f"{path.as_uri()}?mode={'rw' if writable else 'ro'}"
        db = sqlite3.connect(uri, uri=True, isolation_level=None)
        try:
            _prepare(db, wait_s)
            application = db.execute("PRAGMA application_id").fetchone()[0]
            version = db.execute("PRAGMA user_version").fetchone()[0]
            if (application, version) != (APPLICATION_ID, FORMAT_VERSION):
                raise NotALedgerError(
                    f"expected a ledger of format {FORMAT_VERSION} in {path}, "
                    f"got application id {application:#x}, format {version}"
                )
        except BaseException:
            db.close()
            raise
        return db


def insert_entry(db: sqlite3.Connection, entry: Entry) -> None:
    """Insert the entry's rows. Raises sqlite3.Error."""
    db.execute("INSERT INTO blocks VALUES (?, ?, ?)", _block_row(entry.block))
    db.executemany("INSERT INTO records VALUES (?, ?, ?, ?, ?, ?)", _record_rows(entry))


def read_entry(db: sqlite3.Connection, height: int) -> Entry:
    """The entry at a height.

    NotFoundError where no block is, DamagedError unless every stored byte and column is
    what these records make it. Whether they follow the chain is not judged here.
    """
    with storage_errors(f"reading block {height}"):
        row = db.execute("SELECT * FROM blocks WHERE height = ?", (height,)).fetchone()
        query = f"SELECT {_COLUMNS} FROM records WHERE height = ? ORDER BY position"
        rows = db.execute(query, (height,)).fetchall()
    if row is None:
        raise NotFoundError(f"block {height} is missing")
    try:
        entry = Entry(Block.decode(row[2]), tuple(decode_record(row[-1]) for row in rows))
    except LedgerError as error:
        raise DamagedError(f"block {height} or a record of it is damaged: {error}") from None
    if row != _block_row(entry.block):
        raise DamagedError(f"block {height} is not stored under its own height and hash")
    if entry.block.records != tuple(record.id for record in entry.records):
        raise DamagedError(f"block {height} lists other records than are stored with it")
    if rows != _record_rows(entry):
        raise DamagedError(f"a record of block {height} is not stored under its own columns")
    return entry


def read_record(db: sqlite3.Connection, record_id: bytes) -> Record:
    """The record with this id. NotFoundError, DamagedError."""
    with storage_errors("reading a record"):
        row = db.execute("SELECT record FROM records WHERE id = ?", (record_id,)).fetchone()
    if row is None:
        raise NotFoundError(f"the ledger holds no record {record_id.hex()}")
    return checked_record(row[0], record_id)


def checked_record(data: bytes, record_id: bytes) -> Record:
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


def hash_at(db: sqlite3.Connection, height: int) -> bytes | None:
    """The hash stored for a height, None where no block is."""
    with storage_errors("reading the head"):
        row = db.execute("SELECT hash FROM blocks WHERE height = ?", (height,)).fetchone()
    return row[0] if row else None


def _prepare(db: sqlite3.Connection, wait_s: float) -> None:
    db.execute(f"PRAGMA busy_timeout = {int(wait_s * 1000)}")
    db.execute("PRAGMA trusted_schema = OFF")
    db.execute("PRAGMA synchronous = FULL")


def _block_row(block: Block) -> tuple[int, bytes, bytes]:
    return block.height, block.hash, block.record


def _record_rows(entry: Entry) -> list[tuple[bytes, int, int, str | None, int | None, bytes]]:
    rows = []
    for position, record in enumerate(entry.records):
        robot = record.robot if isinstance(record, Transaction) else None
        sequence = record.sequence if isinstance(record, Transaction) else None
        rows.append((record.id, entry.block.height, position, robot, sequence, record.record))
    return rows

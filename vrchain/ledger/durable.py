"""Files that are wholly there or not at all, and errors of disk and database in words."""

import contextlib
import errno
import os
import sqlite3
from collections.abc import Iterator
from pathlib import Path

from vrchain.ledger.errors import DamagedError, LedgerBusyError, StorageError, StorageFullError

_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}


def write_durably(path: Path, data: bytes) -> None:
    """Write ``path`` under a temporary name, fsync, rename, fsync the folder. Raises OSError."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        with open(temporary, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException:
        with contextlib.suppress(OSError):
            temporary.unlink(missing_ok=True)
        raise
    sync_folder(path.parent)


def sync_folder(folder: Path) -> None:
    """Make the names in ``folder`` durable."""
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@contextlib.contextmanager
def storage_errors(doing: str) -> Iterator[None]:
    """Turn what disk and database raise into StorageError and its kinds; ``doing`` says when."""
    try:
        yield
    except OSError as error:
        if error.errno in _FULL:
            raise StorageFullError(f"no room on the disk while {doing}; make room") from error
        raise StorageError(f"{error.strerror or error} while {doing}: {error.filename}") from error
    except sqlite3.Error as error:
        raise _database_error(doing, error) from error
    except UnicodeError as error:  # SQLite quotes the garbage that it found
        raise DamagedError(f"the database is damaged while {doing}; run verify") from error


def _database_error(doing: str, error: sqlite3.Error) -> StorageError:
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF
    if code == sqlite3.SQLITE_FULL:
        return StorageFullError(f"no room for the database while {doing}; make room")
    if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
        return LedgerBusyError(f"another process is writing while {doing}; try again")
    if code in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB):
        return DamagedError(f"the database is damaged ({error}) while {doing}; run verify")
    return StorageError(f"the database failed while {doing}: {error}")

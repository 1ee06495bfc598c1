"""Files that are wholly there or not at all, and errors of disk and database in words."""

import contextlib
import errno
import os
import sqlite3
import stat
from pathlib import Path

from vrchain.ledger.errors import DamagedError, LedgerBusyError, StorageError, StorageFullError

TEMPORARY = ".tmp"  # how the names of files end that are not whole yet
_NO_FILE = {errno.ELOOP, errno.ENXIO, errno.ENODEV}  # a link; a socket or device without a reader
_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}


def write_durably(path: str, data: bytes) -> None:
    """Write ``path`` under a temporary name, fsync, rename, fsync the folder. Raises OSError."""
    write_whole(path, data)
    sync_folder(os.path.dirname(path))


def write_whole(path: str, data: bytes) -> None:
    """As ``write_durably``, but for the folder: its ``sync_folder`` makes the name durable too."""
    folder, name = os.path.split(path)
    temporary = f"{folder}/.{name}.{os.getpid()}{TEMPORARY}"
    try:
        with contextlib.suppress(FileNotFoundError):
            os.unlink(temporary)  # what a killed process left, or a planted link
        with open(temporary, "xb", buffering=0) as file:
            rest = memoryview(data)
            while rest:  # a disk that fills up takes a part first
                rest = rest[file.write(rest) :]
            os.fsync(file.fileno())
        os.replace(temporary, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(temporary)
        raise


def read_plain(path: str, max_bytes: int) -> bytes:
    """What a plain file holds. DamagedError for another kind, or more bytes; OSError."""
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        if error.errno in _NO_FILE:
            raise DamagedError(f"expected a plain file: {path}") from None
        raise
    try:
        found = os.fstat(handle)
        if not stat.S_ISREG(found.st_mode) or found.st_size > max_bytes:
            raise DamagedError(f"expected a plain file of at most {max_bytes} bytes: {path}")
        return os.read(handle, found.st_size)
    finally:
        os.close(handle)


def sync_folder(folder: str | Path) -> None:
    """Make the names in ``folder`` durable."""
    handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


class storage_errors:  # a class, since a generator would take longer than a look-up
    """Turn what disk and database raise into StorageError and its kinds; ``doing`` says when."""

    __slots__ = ("_doing",)

    def __init__(self, doing: str) -> None:
        self._doing = doing

    def __enter__(self) -> None:
        return None

    def __exit__(self, kind: object, error: BaseException | None, traceback: object) -> None:
        if isinstance(error, OSError | sqlite3.Error | UnicodeError):
            raise _storage_error(self._doing, error) from error


def _storage_error(doing: str, error: OSError | sqlite3.Error | UnicodeError) -> StorageError:
    if isinstance(error, sqlite3.Error):
        return _database_error(doing, error)
    if isinstance(error, UnicodeError):  # SQLite quotes the garbage that it found
        return DamagedError(f"the database is damaged while {doing}; run verify")
    if error.errno in _FULL:
        return StorageFullError(f"no room on the disk while {doing}; make room")
    where = f": {error.filename}" if error.filename else ""
    return StorageError(f"{error.strerror or error} while {doing}{where}")


def _database_error(doing: str, error: sqlite3.Error) -> StorageError:
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF
    if code == sqlite3.SQLITE_FULL:
        return StorageFullError(f"no room for the database while {doing}; make room")
    if code in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
        return LedgerBusyError(f"another process is writing while {doing}; try again")
    if code in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_TOOBIG):
        return DamagedError(f"the database is damaged ({error}) while {doing}; run verify")
    return StorageError(f"the database failed while {doing}: {error}")

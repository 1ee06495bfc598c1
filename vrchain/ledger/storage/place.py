"""Where a ledger lies: its files are plain ones, and stay the same while it is open.

SQLite goes on writing into a file that was deleted or moved away, and what it writes there is gone.
"""

import os
import stat
from pathlib import Path

from vrchain.ledger.errors import DamagedError, NotALedgerError, ReplacedError
from vrchain.ledger.records.keys import DATABASE_NAME
from vrchain.ledger.storage.durable import storage_errors

BLOBS_NAME = "blobs"
OUTBOX_NAME = "outbox"  # of a folder that follows servers
QUEUE_NAME = "queue"  # an empty file, see ``turns``
_WORKING = ("-wal", "-shm")  # SQLite's, beside the database


def database_in(folder: str | os.PathLike[str]) -> Path:
    """The database file of the ledger in ``folder``, which may be a link; nothing is opened.

    Raises NotALedgerError where no plain file is, DamagedError for a link, pipe or device in the
    place of a file that belongs to it, StorageError.
    """
    path = Path(folder).absolute() / DATABASE_NAME
    with storage_errors(f"looking at {path}"):
        if _kind(path) != stat.S_IFREG:
            raise NotALedgerError(
                f"expected a ledger's folder with a plain file {DATABASE_NAME}: {folder}"
            )
        kinds = {f"{DATABASE_NAME}{end}": stat.S_IFREG for end in _WORKING}
        kinds |= {QUEUE_NAME: stat.S_IFREG, BLOBS_NAME: stat.S_IFDIR}
        for name, kind in kinds.items():
            if _kind(path.with_name(name)) not in (None, kind):
                raise DamagedError(f"expected plain files and folders in {folder}, not so {name}")
        if _kind(path.with_name(f"{DATABASE_NAME}-journal")) is not None:
            raise DamagedError(f"{path}-journal is no file of a ledger; SQLite would act on it")
    return path


class Place:
    """A ledger's folder and files, by device and inode. Make it before SQLite opens them."""

    def __init__(self, folder: Path) -> None:
        self._folder = os.path.abspath(folder)
        database = os.path.join(self._folder, DATABASE_NAME)
        self._paths = [self._folder, database, *(database + end for end in _WORKING)]
        self._known = self._look()

    def settle(self) -> None:
        """SQLite has made its working files now: hold to them too. ReplacedError."""
        before, self._known = self._known, self._look()
        if before[:2] != self._known[:2]:
            raise self._replaced()

    def check(self) -> None:
        """Raise ReplacedError unless all are there and what they were."""
        if self._look() != self._known or None in self._known:
            raise self._replaced()

    def _look(self) -> list[tuple[int, int] | None]:
        return [_identity(path) for path in self._paths]

    def _replaced(self) -> ReplacedError:
        return ReplacedError(
            f"{self._folder} or a file in it was replaced, moved or deleted since it was opened; "
            "open it again"
        )


def _kind(path: Path) -> int | None:
    """What has this name, a link not followed; None where nothing has."""
    try:
        return stat.S_IFMT(os.lstat(path).st_mode)
    except (FileNotFoundError, NotADirectoryError):
        return None


def _identity(path: str) -> tuple[int, int] | None:
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_dev, found.st_ino

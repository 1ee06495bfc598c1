"""Writers take turns in the order in which they came; SQLite's own lock goes to whoever is lucky.

Whoever waits locks one byte of an empty file, the one after all that are locked, and its turn has
come when none before its own is. The system lets go of a killed process's byte. All this is a
courtesy: it is SQLite's lock that keeps two from writing at once.
"""

import contextlib
import fcntl
import os
import struct
import time
from collections.abc import Iterator
from pathlib import Path

from vrchain.ledger.storage.closing import Closing
from vrchain.ledger.storage.place import QUEUE_NAME

_LOOK_S = 0.0005  # between two looks whether the turn has come
_LAST = 1 << 62  # byte that is used
_FLOCK = struct.Struct("hhqqi4x")  # as Linux has it: type, whence, start, length, no process
_HAS_QUEUE = hasattr(fcntl, "F_OFD_SETLK")  # locks of a handle, not of a process: of Linux only


class Turns(Closing):
    """A writer's place in the queue of the ledger in ``folder``. Raises OSError."""

    def __init__(self, folder: Path, writable: bool) -> None:
        self._file = -1
        if writable and _HAS_QUEUE:
            flags = os.O_RDONLY | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
            self._file = os.open(folder / QUEUE_NAME, flags, 0o666)

    def close(self) -> None:
        """Leave for good; closing twice does no harm."""
        file, self._file = self._file, -1
        if file >= 0:
            os.close(file)

    @contextlib.contextmanager
    def turn(self, wait_s: float) -> Iterator[bool]:
        """Wait behind who came before; the block is the turn. Given whether it came in time."""
        if self._file < 0:
            yield True
            return
        try:
            yield self._wait(wait_s)
        finally:
            self._lock(fcntl.F_UNLCK, 0, 0)

    def _wait(self, wait_s: float) -> bool:
        place = 1
        while place <= _LAST and (behind := self._behind(place, 0)):
            place = behind
        if place > _LAST:  # somebody locked the whole file: no queue to be had
            return True
        self._lock(fcntl.F_RDLCK, place, 1)
        until = time.monotonic() + wait_s
        while place > 1 and self._behind(1, place - 1):
            if time.monotonic() > until:
                return False
            time.sleep(_LOOK_S)
        return True

    def _lock(self, kind: int, start: int, length: int) -> None:
        fcntl.fcntl(self._file, fcntl.F_OFD_SETLK, _FLOCK.pack(kind, 0, start, length, 0))

    def _behind(self, start: int, length: int) -> int:
        """The byte behind one that another has locked among these, 0 if none is."""
        asked = _FLOCK.pack(fcntl.F_WRLCK, 0, start, length, 0)
        found = _FLOCK.unpack(fcntl.fcntl(self._file, fcntl.F_OFD_GETLK, asked))
        if found[0] == fcntl.F_UNLCK:
            return 0
        return found[2] + found[3] if found[3] else _LAST + 1

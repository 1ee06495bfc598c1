"""Where blocks are put in order for several folders: another folder, or servers (``stream``).

A log only orders and carries. What it gives is judged by whoever takes it in.
"""

import contextlib
from collections.abc import Iterator, Mapping
from itertools import islice
from pathlib import Path
from typing import Protocol, TypeAlias

from vrchain.ledger.errors import (
    GapError,
    InvalidError,
    LedgerBusyError,
    NotALedgerError,
    OvertakenError,
    UnavailableError,
    WrongLedgerError,
)
from vrchain.ledger.records.block import Entry
from vrchain.ledger.store import Ledger

Given: TypeAlias = tuple[Entry, dict[bytes, bytes]]  # a block with its records, blobs by digest


class Log(Protocol):
    """The newest block's height decides who may append: one of several succeeds."""

    def append(self, entry: Entry, blobs: Mapping[bytes, bytes], after: int) -> None:
        """Append a block to one of height ``after``, -1 for the first; durable then.

        Raises OvertakenError when the newest is another, UnavailableError when it is not known
        whether it was appended: follow, and see.
        """

    def follow(self, after: int, wait_s: float = 0.0) -> Iterator[Given]:
        """Every block above height ``after`` in its order, then new ones as they come.

        Ends when none has come for ``wait_s``. Raises GapError, UnavailableError.
        """

    def copies(self, height: int) -> Iterator[tuple[str, Given | None]]:
        """What each place says of one block, by the place's name; None: it lacks it."""

    def close(self) -> None:
        """Let go of it; closing twice does no harm."""


class FolderLog:
    """A ledger's folder as a log: a disk that several machines reach in turn, or a robot's own."""

    def __init__(self, folder: Path, writable: bool = True) -> None:
        self.folder, self._writable = folder, writable
        self._ledger: Ledger | None = None

    def append(self, entry: Entry, blobs: Mapping[bytes, bytes], after: int) -> None:
        """As ``Log``."""
        try:
            ledger = self._opened()
        except NotALedgerError:
            if after >= 0:
                raise OvertakenError(f"{self.folder} holds no block {after}") from None
            self._ledger = Ledger.adopt(self.folder, entry)
            return
        try:
            ledger.refresh()
            if ledger.head.height == after and ledger.take(entry, blobs):
                return
        except LedgerBusyError as error:
            raise UnavailableError(str(error)) from None
        except InvalidError:
            if ledger.head.height == after:
                raise
        raise OvertakenError(f"expected block {after} to be the newest, got {ledger.head}")

    def follow(self, after: int, wait_s: float = 0.0) -> Iterator[Given]:
        """As ``Log``."""
        ledger = self._opened()
        ledger.refresh()
        for entry in ledger.follow(after + 1, wait_s):
            yield entry, ledger.blobs_of(entry)

    def copies(self, height: int) -> Iterator[tuple[str, Given | None]]:
        """As ``Log``."""
        ledger = self._opened()
        ledger.refresh()
        if height > ledger.head.height:
            yield str(self.folder), None
        else:
            entry = ledger.entry(height)
            yield str(self.folder), (entry, ledger.blobs_of(entry))

    def close(self) -> None:
        """As ``Log``."""
        if self._ledger is not None:
            self._ledger.close()
            self._ledger = None

    def _opened(self) -> Ledger:
        if self._ledger is None:
            self._ledger = Ledger.open(self.folder, self._writable)
        return self._ledger


def put(ledger: Ledger, log: Log, height: int) -> int:
    """Append the ledger's blocks to a log whose newest is ``height``, -1 if none; how many.

    Raises as ``Log.append``, WrongLedgerError where the log has other ones, GapError where what
    comes after the ledger's is no block of its chain.
    """
    ledger.refresh()
    check_is_part_of(ledger, log, min(height, ledger.head.height))
    if height > ledger.head.height:
        try:
            for entry, _ in islice(log.follow(ledger.head.height), 1):
                ledger.check(entry.block, entry.records)
        except (GapError, InvalidError) as error:
            raise GapError(
                f"what the servers have after block {ledger.head.height} is no block of this chain "
                f"({error}): where no other folder has gone on, stop them, remove their stores, "
                "start them, and put the ledger again"
            ) from None
    for entry in ledger.entries(height + 1):
        log.append(entry, ledger.blobs_of(entry), entry.block.height - 1)
    return max(0, ledger.head.height - height)


def check_is_part_of(ledger: Ledger, log: Log, height: int) -> None:
    """WrongLedgerError where the log has another block than the ledger at a height, -1 for none.

    What is lost there, or damaged, tells nothing.
    """
    own = ledger.entry(height).block if height >= 0 else None
    with contextlib.suppress(GapError):
        given = next(log.follow(height - 1), None) if own else None
        if own and given and given[0].block.height == height and given[0].block.hash != own.hash:
            raise WrongLedgerError(
                f"{ledger.folder} has parted from the servers' chain: of its block {height}, by "
                f"{own.author}, they have another, by {given[0].block.author}: begin a new folder "
                "with vrchain ledger watch, and keep this one if it holds what the servers lack"
            )

"""What a robot has signed and nobody may have taken in yet: durable, in order, in its folder."""

import contextlib
import fcntl
import os
from pathlib import Path

from vrchain.ledger.errors import LedgerBusyError, StorageError
from vrchain.ledger.network.connection import token
from vrchain.ledger.network.message import pack_offer, unpack_offer
from vrchain.ledger.records.keys import DATABASE_NAME
from vrchain.ledger.records.transaction import Offer, Transaction
from vrchain.ledger.storage.closing import Closing
from vrchain.ledger.storage.durable import read_plain, storage_errors, sync_folder, write_durably
from vrchain.ledger.storage.place import OUTBOX_NAME

_SUFFIX = ".offer"
REFUSED_NAME = "refused"  # in the outbox: what never comes into the chain, and why
_WHY = ".why"
_PLACE = "place"  # says which folder this was when it was written
_MOST_BYTES = 1 << 26


class Outbox(Closing):
    """The outbox in a ledger's folder, of one process. LedgerBusyError if another has it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder.absolute() / OUTBOX_NAME
        with storage_errors(f"opening the outbox {self.folder}"):
            self.folder.mkdir(exist_ok=True)
            sync_folder(self.folder.parent)
            self._lock = os.open(self.folder / "lock", os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
            try:
                fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                os.close(self._lock)
                raise LedgerBusyError(
                    f"another process publishes from {folder}; give each robot a folder of its own"
                ) from None

    @property
    def is_moved(self) -> bool:
        """Whether this folder is not the one that was settled: new, copied, or from a backup."""
        try:
            return read_plain(str(self.folder / _PLACE), 100) != self._place()
        except OSError:
            return True

    def settle(self) -> None:
        """From here on the folder knows all that its robots have signed. StorageError."""
        with storage_errors(f"writing to {self.folder}"):
            write_durably(str(self.folder / _PLACE), self._place())

    def put(self, offer: Offer) -> Path:
        """Keep an offer, durably; its file. TooLargeError, StorageError kinds."""
        transaction, data = offer.transaction, pack_offer(offer)
        name = f"{token(transaction.robot)}.{transaction.sequence:020d}{_SUFFIX}"
        with storage_errors(f"writing to {self.folder}"):
            write_durably(str(self.folder / name), data)
        return self.folder / name

    def waiting(self) -> list[tuple[str, int, Path]]:
        """All that wait: robot, sequence and file, each robot's in its order."""
        parts = [(path.name.split("."), path) for path in self._paths()]
        return [(name.replace("=", "."), int(number), path) for (name, number, _), path in parts]

    def count(self) -> int:
        """How many wait."""
        return len(self._paths())

    def last(self, robot: str) -> Transaction | None:
        """The robot's last that waits. DamagedError, EncodingError, StorageError."""
        while own := [path for name, _, path in self.waiting() if name == robot]:
            try:
                return transaction_in(self.read(own[-1]))
            except StorageError:
                if own[-1].exists():  # else it has just come into the chain
                    raise
        return None

    def read(self, path: Path) -> bytes:
        """The message of an offer. StorageError."""
        with storage_errors(f"reading {path}"):
            return read_plain(str(path), _MOST_BYTES)

    def remove(self, path: Path) -> None:
        """It is in the chain. StorageError."""
        with storage_errors(f"removing {path}"):
            path.unlink(missing_ok=True)

    def refuse(self, path: Path, why: str) -> None:
        """Set an offer aside, with what was wrong: it is sent no more. StorageError."""
        aside = self.folder / REFUSED_NAME
        with storage_errors(f"writing to {aside}"):
            aside.mkdir(exist_ok=True)
            number = sum(1 for _ in aside.glob(f"*{_SUFFIX}"))  # several may have had one number
            kept = aside / f"{number:06d}.{path.name}"
            write_durably(str(kept.with_suffix(_WHY)), why.encode())
            path.rename(kept)
            sync_folder(aside)
            sync_folder(self.folder)

    def close(self) -> None:
        """Leave it to the next process; closing twice does no harm."""
        lock, self._lock = self._lock, -1
        if lock >= 0:
            os.close(lock)

    def _paths(self) -> list[Path]:
        return sorted(self.folder.glob(f"*{_SUFFIX}"))

    def _place(self) -> bytes:
        found = [path.stat() for path in (self.folder, self.folder.with_name(DATABASE_NAME))]
        numbers = " ".join(f"{each.st_dev} {each.st_ino}" for each in found)
        # a copy in its place may get the same numbers, but no copy sets when a file was made
        return f"{numbers} {os.fstat(self._lock).st_ctime_ns}".encode()


def refused_in(folder: Path) -> list[tuple[str, int, str]]:
    """What was set aside in a ledger's folder, in that order: robot, sequence and why."""
    found = []
    for path in sorted((folder / OUTBOX_NAME / REFUSED_NAME).glob(f"*{_SUFFIX}")):
        _, name, sequence, _ = path.name.split(".")
        why = ""
        with contextlib.suppress(FileNotFoundError):
            why = path.with_suffix(_WHY).read_text(errors="replace")
        found.append((name.replace("=", "."), int(sequence), why))
    return found


def waiting_in(folder: Path) -> int:
    """How many transactions wait in a ledger's folder."""
    return sum(1 for _ in (folder / OUTBOX_NAME).glob(f"*{_SUFFIX}"))


def transaction_in(data: bytes) -> Transaction:
    """The transaction in an offer's message. EncodingError, RecordError."""
    return Transaction.decode(unpack_offer(data)[0])


def offer_in(data: bytes) -> Offer:
    """The offer in a message. EncodingError, RecordError, PayloadDigestError."""
    record, *blobs = unpack_offer(data)
    return Offer(Transaction.decode(record), *blobs)

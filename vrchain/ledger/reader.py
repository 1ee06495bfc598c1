"""What any handle on a ledger's folder reads: its state, records and blobs, each checked."""

import contextlib
import time
from collections.abc import Iterator
from pathlib import Path

from vrchain.ledger.errors import DamagedError, DroppedError, InvalidError, NotFoundError
from vrchain.ledger.records.block import Entry
from vrchain.ledger.records.membership import Drop
from vrchain.ledger.records.proof import Proof
from vrchain.ledger.records.transaction import Transaction
from vrchain.ledger.rules.chain import Replica
from vrchain.ledger.storage.blobs import BlobStore
from vrchain.ledger.storage.closing import Closing
from vrchain.ledger.storage.database import (
    check_schema,
    connect,
    find_transaction,
    last_height,
    news,
    read_entries,
    read_record,
    read_records,
)
from vrchain.ledger.storage.durable import storage_errors
from vrchain.ledger.storage.place import BLOBS_NAME, Place
from vrchain.ledger.storage.resume import read_history, read_state, read_whole_entries
from vrchain.ledger.storage.retention import Retention, named_by


class Reader(Replica, Closing):
    """The half of ``Ledger`` that changes nothing in its folder."""

    def __init__(self, folder: Path, writable: bool, wait_s: float) -> None:
        self.folder = folder
        self._blobs = BlobStore(folder.absolute() / BLOBS_NAME)
        self._place = Place(folder)
        self._db = connect(folder, writable, wait_s)
        self._retained = -1, Retention()  # up to which height, and what
        try:
            self.state = read_state(self._db)
            self._place.settle()
        except BaseException:
            self._db.close()
            raise

    def close(self) -> None:
        """Let go of the folder; closing twice does no harm."""
        self._db.close()

    def history(self, robot: str) -> list[Transaction]:
        """The robot's transactions up to ``head``, oldest first; an expelled one's too.

        Raises UnknownMemberError, DamagedError.
        """
        state = self.state
        if robot not in state.newest and robot not in state.expelled:
            raise state.not_a_member(robot)
        found = read_history(self._db, robot, self.head.height)
        if robot in state.newest and found[-1:] != [t for t in [state.newest[robot]] if t]:
            raise DamagedError(f"the history of {robot} is not whole; run verify")
        return found

    def transaction(self, transaction_id: bytes) -> Transaction:
        """The transaction with this id. NotFoundError, DamagedError."""
        record = read_record(self._db, transaction_id)
        if not isinstance(record, Transaction):
            raise NotFoundError(f"{transaction_id.hex()} is no transaction but {record}")
        return record

    def holds(self, transaction_id: bytes) -> bool:
        """Whether the transaction with this id is in the chain. DamagedError."""
        with contextlib.suppress(NotFoundError):
            self.transaction(transaction_id)
            return True
        return False

    def payload(self, payload_digest: bytes) -> bytes:
        """The blob (panorama or landmark record) with this digest, checked.

        Raises NotFoundError, DroppedError if the operator let it go, DamagedError.
        """
        with storage_errors("reading a payload"):
            try:
                return self._blobs.get(payload_digest)
            except NotFoundError:
                if payload_digest not in self._retention().dropped:
                    raise
        raise DroppedError(f"the payload {payload_digest.hex()} was dropped by the operator")

    def blobs_of(self, entry: Entry) -> dict[bytes, bytes]:
        """All blobs that an entry names, by digest, as ``Ledger.take`` wants them.

        Where some were dropped, the operator's drops of them too. NotFoundError, DamagedError.
        """
        found, gone = dict[bytes, bytes](), set[bytes]()
        for blob in named_by(entry.records):
            try:
                found[blob] = self.payload(blob)
            except DroppedError:
                gone.add(blob)
        if gone:
            for record in read_records(self._db, "the drops", "robot IS NULL"):
                if isinstance(record, Drop) and gone & {*record.blobs}:
                    found[record.id] = record.record
        return found

    def _retention(self) -> Retention:
        """Of all that is stored by now, read once. DamagedError, StorageError."""
        last = last_height(self._db)
        if self._retained[0] != last:
            self._retained = last, Retention(read_records(self._db, "the records"))
        return self._retained[1]

    def entry(self, height: int) -> Entry:
        """The block at ``height`` and its records. NotFoundError, DamagedError."""
        if height not in range(self.head.height + 1):
            raise NotFoundError(
                f"block {height!r} is missing: expected a number from 0 to {self.head.height}"
            )
        return next(read_whole_entries(self._db, height, height + 1))

    def entries(self, from_height: int = 0) -> Iterator[Entry]:
        """Blocks with their records from ``from_height`` to ``head``. DamagedError."""
        return read_whole_entries(self._db, from_height, self.head.height + 1)

    def follow(self, from_height: int, wait_s: float, poll_s: float = 0.01) -> Iterator[Entry]:
        """As ``entries``, and then those that others append, each as it comes.

        Ends when nothing new has come for ``wait_s``; looks every ``poll_s``.
        """
        patience = round(wait_s / poll_s)
        looks = 0
        while looks <= patience:
            for entry in self.entries(from_height):
                from_height, looks = entry.block.height + 1, 0
                yield entry
            if self.refresh() == 0:
                looks += 1
                time.sleep(poll_s)

    def proof(self, transaction: Transaction) -> Proof:
        """What shows a robot that knows no more than ``head``'s hash that this is in its table.

        Raises NotFoundError unless the transaction is its robot's newest.
        """
        if self.latest(transaction.robot) != transaction:
            raise NotFoundError(
                f"expected the newest transaction of {transaction.robot} to prove, got "
                f"{transaction}; each names the one before it"
            )
        return Proof(self.head.record, self.state.table.path(transaction.robot))

    def refresh(self) -> int:
        """Take in what other processes appended, each block judged; how many there were.

        Raises DamagedError when what is stored does not go on from what this handle saw, and
        ReplacedError.
        """
        self._place.check()
        check_schema(self._db)
        head = self.head
        found = news(self._db, head.height)
        if found[:1] != [(head.height, head.hash)]:
            raise DamagedError(f"block {head.height} was {head.hash.hex()}; it is not there now")
        if len(found) == 1:
            return 0
        last = last_height(self._db)
        for block, records in read_entries(self._db, head.height + 1, last + 1):
            try:
                self.state = self.check(block, records)
            except InvalidError as error:
                raise DamagedError(f"block {block.height} is not valid: {error}") from None
        return last - head.height

    def _earlier(self, robot: str, sequence: int) -> Transaction | None:
        return find_transaction(self._db, robot, sequence)

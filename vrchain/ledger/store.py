"""The ledger on disk: records in SQLite, blobs in files, nothing acknowledged ever lost."""

import contextlib
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Self

from vrchain.ledger.errors import (
    DamagedError,
    DroppedError,
    InvalidError,
    NotFoundError,
    ReadOnlyError,
)
from vrchain.ledger.records.block import Block, Entry, Record
from vrchain.ledger.records.keys import PublicKey, SigningKey
from vrchain.ledger.records.membership import (
    MAX_DROPPED,
    OPERATOR,
    Drop,
    Enrolment,
    Expulsion,
    Genesis,
)
from vrchain.ledger.records.proof import Proof
from vrchain.ledger.records.transaction import Offer, Transaction, blob_digest
from vrchain.ledger.rules.chain import Chain, Lap, genesis_entry
from vrchain.ledger.rules.validity import State
from vrchain.ledger.storage.blobs import BlobStore
from vrchain.ledger.storage.closing import Closing
from vrchain.ledger.storage.database import (
    all_records,
    check_schema,
    connect,
    find_transaction,
    insert_entry,
    last_height,
    news,
    read_entries,
    read_record,
)
from vrchain.ledger.storage.durable import storage_errors
from vrchain.ledger.storage.folder import create_folder
from vrchain.ledger.storage.place import BLOBS_NAME, Place
from vrchain.ledger.storage.resume import read_history, read_state, read_whole_entries
from vrchain.ledger.storage.retention import is_dropped, old_blobs, stored_to_keep
from vrchain.ledger.storage.turns import Turns


class Ledger(Closing):
    """One process's handle on a ledger's folder, for one thread. Close it, or use ``with``.

    Any number of processes may read and write; writers take turns. What ``head`` and
    ``latest`` answer is what this handle last saw: its own writes, and ``refresh``.
    The ledger never reads a clock: timestamps are integer nanoseconds from the caller.
    """

    def __init__(self, folder: Path, writable: bool, wait_s: float) -> None:
        """Use ``open`` or ``create``."""
        self.folder = folder
        self.writable = writable
        self._wait_s = wait_s
        self._blobs = BlobStore(folder.absolute() / BLOBS_NAME)
        self._place = Place(folder)
        self._db = connect(folder, writable, wait_s)
        try:
            self._chain = Chain.at(read_state(self._db), self._find)
            self._place.settle()
            with storage_errors(f"queueing up for {folder}"):
                self._turns = Turns(folder, writable)
        except BaseException:
            self._db.close()
            raise
        self._newest = self._chain.state.newest  # beside the chain, so that ``latest`` is quick

    @classmethod
    def create(
        cls,
        folder: str | os.PathLike[str],
        members: Mapping[str, PublicKey],
        operator: SigningKey,
        *,
        timestamp_ns: int = 0,
        name: str = "",
        salt: bytes = b"",
    ) -> Self:
        """A new ledger in a folder that is missing or empty, opened for writing.

        Raises LedgerExistsError when something is there, RecordError on bad names,
        StorageError when it cannot be written; then nothing is left behind.
        """
        first = genesis_entry(members, operator, timestamp_ns, name, salt)
        create_folder(Path(folder), first)
        return cls.open(folder, writable=True)

    @classmethod
    def open(
        cls, folder: str | os.PathLike[str], writable: bool = False, wait_s: float = 5.0
    ) -> Self:
        """The ledger in ``folder``. A write waits up to ``wait_s`` for another process's.

        Only the head, the newest transactions and the operator's records are checked; ``verify``
        checks everything. From then on the handle refuses with ReplacedError to refresh or to
        write once another folder or file lies in the place of what it opened.
        Raises NotALedgerError, DamagedError, StorageError; creates nothing then.
        """
        return cls(Path(folder), writable, wait_s)

    def close(self) -> None:
        """Let go of the folder; closing twice does no harm."""
        self._turns.close()
        self._db.close()

    @property
    def genesis(self) -> Genesis:
        """The genesis record; its id is the ledger's id."""
        return self._chain.genesis

    @property
    def head(self) -> Block:
        """The newest block that this handle saw."""
        return self._chain.head

    @property
    def members(self) -> Mapping[str, PublicKey]:
        """Public keys by robot."""
        return self._chain.members

    @property
    def expelled(self) -> frozenset[str]:
        """Names that were members; none of them comes back."""
        return self._chain.state.expelled

    @property
    def robots(self) -> tuple[str, ...]:
        """The members' names, sorted."""
        return tuple(sorted(self._newest))

    def latest(self, robot: str) -> Transaction | None:
        """The robot's newest transaction that this handle saw, None before its first.

        Raises UnknownMemberError, ExpelledMemberError.
        """
        try:
            return self._newest[robot]
        except KeyError:
            raise self._chain.state.not_a_member(robot) from None

    def history(self, robot: str) -> list[Transaction]:
        """The robot's transactions up to ``head``, oldest first; an expelled one's too.

        Raises UnknownMemberError, DamagedError.
        """
        state = self._chain.state
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

    def payload(self, payload_digest: bytes) -> bytes:
        """The blob (panorama or landmark record) with this digest, checked.

        Raises NotFoundError, DroppedError if the operator let it go, DamagedError.
        """
        with storage_errors("reading a payload"):
            try:
                return self._blobs.get(payload_digest)
            except NotFoundError:
                if not is_dropped(self._db, payload_digest):
                    raise
        raise DroppedError(f"the payload {payload_digest.hex()} was dropped by the operator")

    def entry(self, height: int) -> Entry:
        """The block at ``height`` and its records. NotFoundError, DamagedError."""
        return next(read_whole_entries(self._db, height, height + 1))

    def entries(self, from_height: int = 0) -> Iterator[Entry]:
        """Blocks with their records from ``from_height`` to ``head``. DamagedError."""
        return read_whole_entries(self._db, from_height, self.head.height + 1)

    def blocks(self, from_height: int = 0) -> Iterator[Block]:
        """Blocks from ``from_height`` to ``head``. DamagedError."""
        return (entry.block for entry in self.entries(from_height))

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
        return Proof(self.head.record, self._chain.state.table.path(transaction.robot))

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
                self._go_to(self._chain.check(block, records))
            except InvalidError as error:
                raise DamagedError(f"block {block.height} is not valid: {error}") from None
        return last - head.height

    def publish(
        self,
        robot: str,
        key: SigningKey,
        payload: bytes,
        reason: str,
        timestamp_ns: int,
        lap: Lap = lambda stage: None,
        *,
        landmarks: bytes | None = None,
    ) -> Transaction:
        """Sign a transaction for ``payload``, append it in a block by ``robot``; durable then.

        ``landmarks``: the landmark record, stored beside the payload.
        ``lap(stage)`` is called after each stage (hash, encode, sign, validate,
        append_durable, append_memory; some come twice), for a stopwatch.
        Raises InvalidError kinds, RecordError, TooLargeError, StorageError kinds,
        ReadOnlyError, LedgerBusyError; then nothing has changed.
        """
        payload_digest, landmarks_digest = blob_digest(payload), blob_digest(landmarks)
        blobs = {payload_digest: payload}
        if landmarks is not None:
            blobs[landmarks_digest] = landmarks
        lap("hash")
        with self._writing():
            lap("append_durable")
            draft = self._chain.draft_transaction(
                robot, payload_digest, reason, timestamp_ns, landmarks_digest
            )
            assert draft.body
            lap("encode")
            transaction = draft.signed(key)
            lap("sign")
            self._append((transaction,), blobs, robot, key, lap)
        return transaction

    def draft_transaction(
        self,
        robot: str,
        payload: bytes,
        reason: str,
        timestamp_ns: int,
        landmarks: bytes | None = None,
    ) -> Transaction:
        """The robot's next transaction after ``head``, for it to sign: ``draft.signed(key)``."""
        digests = blob_digest(payload), blob_digest(landmarks)
        return self._chain.draft_transaction(robot, digests[0], reason, timestamp_ns, digests[1])

    def append(
        self,
        transaction: Transaction,
        payload: bytes,
        author: str,
        key: SigningKey,
        landmarks: bytes | None = None,
    ) -> Block:
        """Append a transaction that its robot signed elsewhere, in a block by ``author``.

        Raises as ``publish``, and PayloadDigestError for other blobs than it names.
        """
        return self.append_many([Offer(transaction, payload, landmarks)], author, key)

    def append_many(self, offers: Sequence[Offer], author: str, key: SigningKey) -> Block:
        """Append transactions that their robots signed, all in one block by ``author``.

        All or none. Raises as ``publish``.
        """
        blobs: dict[bytes, bytes] = {}
        for offer in offers:
            blobs |= offer.blobs
        with self._writing():
            self._append([offer.transaction for offer in offers], blobs, author, key)
        return self.head

    def enrol(
        self, name: str, public_key: PublicKey, operator: SigningKey, timestamp_ns: int
    ) -> Enrolment:
        """Take in a new member; only the operator's key can. Raises as ``publish``."""
        with self._writing():
            record = self._chain.draft_enrolment(name, public_key, timestamp_ns).signed(operator)
            self._append((record,), {}, OPERATOR, operator)
        return record

    def expel(self, name: str, operator: SigningKey, timestamp_ns: int) -> Expulsion:
        """End a membership for ever; only the operator's key can. Raises as ``publish``."""
        with self._writing():
            record = self._chain.draft_expulsion(name, timestamp_ns).signed(operator)
            self._append((record,), {}, OPERATOR, operator)
        return record

    def drop(self, blobs: Sequence[bytes], operator: SigningKey, timestamp_ns: int) -> Drop:
        """Let these blobs go: first the operator's record of it, then the files.

        Raises as ``publish``, DropError for a blob of some robot's newest transaction, and
        NotFoundError for one that is not kept (any more).
        """
        with self._writing():
            unknown = set(blobs) - stored_to_keep(self._db)
            if unknown:
                raise NotFoundError(f"the ledger keeps no blob {min(unknown).hex()} to drop")
            record = self._chain.draft_drop(blobs, timestamp_ns).signed(operator)
            self._append((record,), {}, OPERATOR, operator)
        self._remove_unneeded(record.blobs)
        return record

    def drop_old(self, keep: int, operator: SigningKey, timestamp_ns: int) -> list[Drop]:
        """Drop what none of any robot's ``keep`` (at least 1) newest transactions names.

        The records of it: none when nothing is old, several when much is. Raises as ``drop``.
        """
        old = old_blobs(all_records(self._db), max(keep, 1))
        parts = [old[start : start + MAX_DROPPED] for start in range(0, len(old), MAX_DROPPED)]
        return [self.drop(part, operator, timestamp_ns) for part in parts]

    def clean(self) -> int:
        """Remove blobs that no record needs, and files never finished; how many there were.

        A writer that is killed between blob and record leaves one transaction's. It holds the
        write lock, so that no other writer is between the two. Raises as ``publish``.
        """
        with self._writing(), storage_errors(f"cleaning {self.folder}"):
            kept = stored_to_keep(self._db)
            orphans = [path for path, blob in self._blobs.files() if blob not in kept]
            for path in orphans:
                path.unlink()
        return len(orphans)

    def _remove_unneeded(self, blobs: Sequence[bytes]) -> None:
        """Under the lock, since another writer may have published the same bytes again."""
        with self._writing():
            kept = stored_to_keep(self._db)
            for blob in blobs:
                if blob not in kept:
                    self._blobs.remove(blob)

    def _append(
        self,
        records: Sequence[Record],
        blobs: Mapping[bytes, bytes],
        author: str,
        key: SigningKey,
        lap: Lap = lambda stage: None,
    ) -> None:
        entry, after = self._chain.make(records, author, key, lap)
        self._write(entry, blobs)
        lap("append_durable")
        self._go_to(after)
        lap("append_memory")

    def _go_to(self, state: State) -> None:
        self._chain.state = state
        self._newest = state.newest

    def _find(self, robot: str, sequence: int) -> Transaction | None:
        return find_transaction(self._db, robot, sequence)

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        """Hold the write lock, with everything that others wrote taken in."""
        if not self.writable:
            raise ReadOnlyError(f"{self.folder} was opened for reading; open it writable=True")
        with self._turns.turn(self._wait_s) as has_come:
            with storage_errors(f"waiting to write to {self.folder}"):
                self._begin(self._wait_s if has_come else 0)
            try:
                self.refresh()
                yield
            finally:
                if self._db.in_transaction:
                    self._db.execute("ROLLBACK")

    def _begin(self, wait_s: float) -> None:
        """Take SQLite's write lock; the queue has used up the patience if ``wait_s`` is 0."""
        if not wait_s:
            self._db.execute("PRAGMA busy_timeout = 0")
        try:
            self._db.execute("BEGIN IMMEDIATE")
        finally:
            if not wait_s:
                self._db.execute(f"PRAGMA busy_timeout = {int(self._wait_s * 1000)}")

    def _write(self, entry: Entry, blobs: Mapping[bytes, bytes]) -> None:
        """Blobs first, then the records that name them, then commit."""
        written: list[bytes] = []
        with storage_errors(f"writing block {entry.block.height} to {self.folder}"):
            try:
                for blob, data in blobs.items():
                    if blob not in self._blobs:
                        written.append(blob)  # before it is, lest Ctrl-C comes in between
                    self._blobs.put(blob, data)
                insert_entry(self._db, entry)
            except BaseException:
                if self._db.in_transaction:  # a full disk may have ended it
                    self._db.execute("ROLLBACK")
                for blob in written:
                    self._blobs.remove(blob)
                raise
            # From here on blobs stay: another ledger's folder may be there, which needs them, or
            # a commit that fails may yet be on disk after a crash.
            self._place.check()
            self._db.execute("COMMIT")
            self._place.check()  # or it is in a file that is gone, and must not be acknowledged

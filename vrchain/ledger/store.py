"""The ledger on disk: records in SQLite, payloads in files, nothing acknowledged ever lost."""

import contextlib
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Self

from vrchain.ledger.blobs import BlobStore
from vrchain.ledger.block import Block, Entry
from vrchain.ledger.chain import Chain, genesis_entry
from vrchain.ledger.database import (
    checked_record,
    connect,
    hash_at,
    insert_entry,
    last_height,
    read_entry,
    read_record,
)
from vrchain.ledger.durable import storage_errors
from vrchain.ledger.encoding import check_payload, digest
from vrchain.ledger.errors import (
    DamagedError,
    InvalidError,
    NotFoundError,
    PayloadDigestError,
    ReadOnlyError,
)
from vrchain.ledger.folder import create_folder
from vrchain.ledger.keys import PublicKey, SigningKey
from vrchain.ledger.membership import OPERATOR, Enrolment, Genesis
from vrchain.ledger.resume import read_state
from vrchain.ledger.transaction import Transaction

BLOBS_NAME = "blobs"
Lap = Callable[[str], object]


class Ledger:
    """One process's handle on a ledger's folder, for one thread. Close it, or use ``with``.

    Any number of processes may read and write; writers take turns. What ``head`` and
    ``latest`` answer is what this handle last saw: its own writes, and ``refresh``.
    The ledger never reads a clock: timestamps are integer nanoseconds from the caller.
    """

    def __init__(self, folder: Path, writable: bool, wait_s: float) -> None:
        """Use ``open`` or ``create``."""
        self.folder = folder
        self.writable = writable
        self._blobs = BlobStore(folder / BLOBS_NAME)
        self._db = connect(folder, writable, wait_s)
        try:
            self._chain = Chain.at(read_state(self._db))
        except BaseException:
            self._db.close()
            raise

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

        Only the head and the newest records are checked; ``verify`` checks everything.
        Raises NotALedgerError, DamagedError, StorageError; creates nothing then.
        """
        return cls(Path(folder), writable, wait_s)

    def close(self) -> None:
        """Let go of the folder; closing twice does no harm."""
        self._db.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

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
    def robots(self) -> tuple[str, ...]:
        """The members' names, sorted."""
        return tuple(robot for robot, _ in self.head.newest)

    def latest(self, robot: str) -> Transaction | None:
        """The robot's newest transaction that this handle saw, None before its first.

        Raises UnknownMemberError.
        """
        return self._chain.latest(robot)

    def history(self, robot: str) -> list[Transaction]:
        """The robot's transactions up to ``head``, oldest first. UnknownMemberError."""
        last = self.latest(robot)
        count = last.sequence + 1 if last else 0
        query = "SELECT id, record FROM records WHERE robot = ? AND sequence < ? ORDER BY sequence"
        with storage_errors(f"reading the history of {robot}"):
            rows = self._db.execute(query, (robot, count)).fetchall()
        found = [checked_record(data, record_id) for record_id, data in rows]
        transactions = [record for record in found if isinstance(record, Transaction)]
        if [t.sequence for t in transactions if t.robot == robot] != list(range(count)):
            raise DamagedError(f"the history of {robot} is not whole; run verify")
        return transactions

    def transaction(self, transaction_id: bytes) -> Transaction:
        """The transaction with this id. NotFoundError, DamagedError."""
        record = read_record(self._db, transaction_id)
        if not isinstance(record, Transaction):
            raise NotFoundError(f"{transaction_id.hex()} is no transaction but {record}")
        return record

    def payload(self, payload_digest: bytes) -> bytes:
        """The payload with this digest, checked. NotFoundError, DamagedError."""
        with storage_errors("reading a payload"):
            return self._blobs.get(payload_digest)

    def entry(self, height: int) -> Entry:
        """The block at ``height`` and its records. NotFoundError, DamagedError."""
        return read_entry(self._db, height)

    def entries(self, from_height: int = 0) -> Iterator[Entry]:
        """Blocks with their records from ``from_height`` to ``head``. DamagedError."""
        return (self.entry(height) for height in range(from_height, self.head.height + 1))

    def blocks(self, from_height: int = 0) -> Iterator[Block]:
        """Blocks from ``from_height`` to ``head``. DamagedError."""
        return (entry.block for entry in self.entries(from_height))

    def refresh(self) -> int:
        """Take in what other processes appended, each block judged; how many there were.

        Raises DamagedError when what is stored does not go on from what this handle saw.
        """
        head = self.head
        last = last_height(self._db)
        if hash_at(self._db, head.height) != head.hash:
            raise DamagedError(f"block {head.height} was {head.hash.hex()}; it is not there now")
        for height in range(head.height + 1, last + 1):
            try:
                self._chain.append(*self.entry(height))
            except InvalidError as error:
                raise DamagedError(f"block {height} is not valid: {error}") from None
        return last - head.height

    def publish(
        self,
        robot: str,
        key: SigningKey,
        payload: bytes,
        reason: str,
        timestamp_ns: int,
        lap: Lap = lambda stage: None,
    ) -> Transaction:
        """Sign a transaction for ``payload``, append it in a block by ``robot``; durable then.

        ``lap(stage)`` is called after each stage (hash, encode, sign, validate,
        append_durable, append_memory; some come twice), for a stopwatch.
        Raises InvalidError kinds, RecordError, TooLargeError, StorageError kinds,
        ReadOnlyError, LedgerBusyError; then nothing has changed.
        """
        check_payload(payload)
        payload_digest = digest(payload)
        lap("hash")
        with self._writing():
            lap("append_durable")
            draft = self._chain.draft_transaction(robot, payload_digest, reason, timestamp_ns)
            assert draft.body
            lap("encode")
            transaction = draft.signed(key)
            lap("sign")
            self._append((transaction,), {payload_digest: payload}, robot, key, lap)
        return transaction

    def draft_transaction(
        self, robot: str, payload: bytes, reason: str, timestamp_ns: int
    ) -> Transaction:
        """The robot's next transaction after ``head``, for it to sign: ``draft.signed(key)``."""
        return self._chain.draft_transaction(robot, digest(payload), reason, timestamp_ns)

    def append(
        self, transaction: Transaction, payload: bytes, author: str, key: SigningKey
    ) -> Block:
        """Append a transaction that its robot signed elsewhere, in a block by ``author``.

        Raises as ``publish``, and PayloadDigestError for another payload than it names.
        """
        check_payload(payload)
        if digest(payload) != transaction.payload_digest:
            raise PayloadDigestError(f"the payload is not the one that {transaction} names")
        with self._writing():
            self._append((transaction,), {transaction.payload_digest: payload}, author, key)
        return self.head

    def enrol(
        self, name: str, public_key: PublicKey, operator: SigningKey, timestamp_ns: int
    ) -> Enrolment:
        """Take in a new member; only the operator's key can. Raises as ``publish``."""
        with self._writing():
            draft = self._chain.draft_enrolment(name, public_key, timestamp_ns)
            enrolment = draft.signed(operator)
            self._append((enrolment,), {}, OPERATOR, operator)
        return enrolment

    def _append(
        self,
        records: Sequence[Transaction | Enrolment],
        payloads: Mapping[bytes, bytes],
        author: str,
        key: SigningKey,
        lap: Lap = lambda stage: None,
    ) -> None:
        draft = self._chain.draft_block(records, author)
        assert draft.body
        lap("encode")
        block = draft.signed(key)
        lap("sign")
        state = self._chain.check(block, records)
        lap("validate")
        self._write(Entry(block, tuple(records)), payloads)
        lap("append_durable")
        self._chain.advance(state)
        lap("append_memory")

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        """Hold the write lock, with everything that others wrote taken in."""
        if not self.writable:
            raise ReadOnlyError(f"{self.folder} was opened for reading; open it writable=True")
        with storage_errors(f"waiting to write to {self.folder}"):
            self._db.execute("BEGIN IMMEDIATE")
        try:
            self.refresh()
            yield
        finally:
            if self._db.in_transaction:
                self._db.execute("ROLLBACK")

    def _write(self, entry: Entry, payloads: Mapping[bytes, bytes]) -> None:
        """Payloads first, then the records that name them, then commit."""
        written: list[bytes] = []
        with storage_errors(f"writing block {entry.block.height} to {self.folder}"):
            try:
                for payload_digest, payload in payloads.items():
                    if self._blobs.put(payload_digest, payload):
                        written.append(payload_digest)
                insert_entry(self._db, entry)
            except BaseException:
                if self._db.in_transaction:  # a full disk may have ended it
                    self._db.execute("ROLLBACK")
                for payload_digest in written:
                    self._blobs.remove(payload_digest)
                raise
            # A commit that fails may yet be on disk after a crash, so its payloads stay.
            self._db.execute("COMMIT")

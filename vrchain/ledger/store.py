"""The ledger on disk: records in SQLite, blobs in files, nothing acknowledged ever lost.

What is here writes; ``reader`` has what only reads.
"""

import contextlib
import os
from collections.abc import Iterator, Mapping, Sequence, Set
from pathlib import Path
from typing import Self

from vrchain.ledger.errors import (
    ClusterError,
    ForkError,
    NotFoundError,
    PayloadDigestError,
    ReadOnlyError,
)
from vrchain.ledger.reader import Reader
from vrchain.ledger.records.block import Block, Entry, Record
from vrchain.ledger.records.keys import PublicKey, SigningKey
from vrchain.ledger.records.membership import MAX_DROPPED, OPERATOR, Drop, Enrolment, Expulsion
from vrchain.ledger.records.transaction import Offer, Transaction, blob_digest
from vrchain.ledger.rules.chain import Lap, genesis_entry
from vrchain.ledger.rules.validity import begin
from vrchain.ledger.storage.database import insert_entry, operator_records, read_records
from vrchain.ledger.storage.durable import storage_errors
from vrchain.ledger.storage.folder import create_folder
from vrchain.ledger.storage.place import OUTBOX_NAME
from vrchain.ledger.storage.retention import dropped_by, named_by, old_blobs
from vrchain.ledger.storage.turns import Turns


class Ledger(Reader):
    """One process's handle on a ledger's folder, for one thread. Close it, or use ``with``.

    Any number of processes may read and write; writers take turns. What ``head`` and
    ``latest`` answer is what this handle last saw: its own writes, and ``refresh``.
    The ledger never reads a clock: timestamps are integer nanoseconds from the caller.
    """

    def __init__(self, folder: Path, writable: bool, wait_s: float) -> None:
        """Use ``open`` or ``create``."""
        super().__init__(folder, writable, wait_s)
        self.writable = writable
        self._wait_s = wait_s
        try:
            with storage_errors(f"queueing up for {folder}"):
                self._turns = Turns(folder, writable)
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

        Only the head, the newest transactions and the operator's records are checked; ``verify``
        checks everything. From then on the handle refuses with ReplacedError to refresh or to
        write once another folder or file lies in the place of what it opened.
        Raises NotALedgerError, DamagedError, StorageError; creates nothing then.
        """
        return cls(Path(folder), writable, wait_s)

    def close(self) -> None:
        """Let go of the folder; closing twice does no harm."""
        self._turns.close()
        super().close()

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
            draft = self.draft(robot, payload_digest, reason, timestamp_ns, landmarks_digest)
            assert draft.body
            lap("encode")
            transaction = draft.signed(key)
            lap("sign")
            self._append((transaction,), blobs, robot, key, lap)
        return transaction

    @classmethod
    def adopt(cls, folder: str | os.PathLike[str], first: Entry) -> Self:
        """Another's ledger in a new folder, opened for writing: its first entry, no more yet.

        Raises InvalidError kinds, and as ``create``.
        """
        begin(*first)
        create_folder(Path(folder), first)
        return cls.open(folder, writable=True)

    def take(self, entry: Entry, blobs: Mapping[bytes, bytes]) -> bool:
        """Append another's block, once it is judged, with its blobs; durable then.

        False if it is here already. ``blobs``: by digest, all that its transactions name; in place
        of those that were dropped since, the operator's record of that. Raises InvalidError kinds,
        ForkError for a second block of one height, PayloadDigestError, and StorageError kinds;
        then nothing has changed.
        """
        block, records = entry
        with self._turn():
            if block.height <= self.head.height:
                self._check_same(block)
                return False
            after = self.check(block, records)
            good = {blob for blob in named_by(records) if blob_digest(blobs.get(blob)) == blob}
            wrong = named_by(records) - good
            signed = self.state.operator_records
            if wrong and not wrong <= dropped_by(blobs.values(), self.genesis, signed):
                raise PayloadDigestError(
                    f"the blobs are not those that the records of {block} name"
                )
            self._write(entry, {blob: blobs[blob] for blob in good})
            self.state = after
        for record in records:
            if isinstance(record, Drop):
                self._remove_unneeded(record.blobs)
        return True

    def _check_same(self, block: Block) -> None:
        """ForkError unless this is the block of its height; any other error if it is forged."""
        own = self.entry(block.height).block
        if own.hash != block.hash:
            block.check_signature(block.author, self._ever_public_key(block.author))
            raise ForkError(
                f"{block.author} signed {'a second' if own.author == block.author else 'another'} "
                f"{block}: {own.hash.hex()} is in the ledger, by {own.author}, and this one is "
                f"{block.hash.hex()}",
                own,
                block,
            )

    def _ever_public_key(self, name: str) -> PublicKey:
        """The key of whoever is or was a member, or the operator's. UnknownMemberError."""
        if name not in self.state.expelled:
            return self.state.public_key(name)
        signed = operator_records(self._db, self.head.height)
        enrolled = {r.name: r.public_key for r in signed if isinstance(r, Enrolment)}
        return (dict(self.genesis.members) | enrolled)[name]

    def draft_transaction(
        self, robot: str, payload: bytes, reason: str, timestamp_ns: int
    ) -> Transaction:
        """The robot's next transaction after ``head``, for it to sign: ``draft.signed(key)``."""
        return self.draft(robot, blob_digest(payload), reason, timestamp_ns)

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
            draft = Enrolment(*self.operators_next(timestamp_ns), name, public_key)
            record = draft.signed(operator)
            self._append((record,), {}, OPERATOR, operator)
        return record

    def expel(self, name: str, operator: SigningKey, timestamp_ns: int) -> Expulsion:
        """End a membership for ever; only the operator's key can. Raises as ``publish``."""
        with self._writing():
            record = Expulsion(*self.operators_next(timestamp_ns), name).signed(operator)
            self._append((record,), {}, OPERATOR, operator)
        return record

    def drop(self, blobs: Sequence[bytes], operator: SigningKey, timestamp_ns: int) -> Drop:
        """Let these blobs go: first the operator's record of it, then the files.

        Raises as ``publish``, DropError for a blob of some robot's newest transaction, and
        NotFoundError for one that is not kept (any more).
        """
        with self._writing():
            unknown = set(blobs) - self._kept()
            if unknown:
                raise NotFoundError(f"the ledger keeps no blob {min(unknown).hex()} to drop")
            named = tuple(sorted(set(blobs)))
            record = Drop(*self.operators_next(timestamp_ns), named).signed(operator)
            self._append((record,), {}, OPERATOR, operator)
        self._remove_unneeded(record.blobs)
        return record

    def drop_old(self, keep: int, operator: SigningKey, timestamp_ns: int) -> list[Drop]:
        """Drop what none of any robot's ``keep`` (at least 1) newest transactions names.

        The records of it: none when nothing is old, several when much is. Raises as ``drop``.
        """
        old = old_blobs(read_records(self._db, "the records"), max(keep, 1))
        parts = [old[start : start + MAX_DROPPED] for start in range(0, len(old), MAX_DROPPED)]
        return [self.drop(part, operator, timestamp_ns) for part in parts]

    def clean(self) -> int:
        """Remove blobs that no record needs, and files never finished; how many there were.

        A writer that is killed between blob and record leaves one transaction's. It holds the
        write lock, so that no other writer is between the two. Raises as ``publish``.
        """
        with self._turn(), storage_errors(f"cleaning {self.folder}"):
            kept = self._kept()
            orphans = [path for path, blob in self._blobs.files() if blob not in kept]
            for path in orphans:
                path.unlink()
        return len(orphans)

    def _kept(self) -> Set[bytes]:
        """Digests of all blobs that must be there. DamagedError, StorageError."""
        return self._retention().kept.keys()

    def _remove_unneeded(self, blobs: Sequence[bytes]) -> None:
        """Under the lock, since another writer may have published the same bytes again."""
        with self._turn():
            kept = self._kept()
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
        if (self.folder / OUTBOX_NAME).exists():
            raise ClusterError(
                f"{self.folder} follows servers; what is written there alone would part from "
                "theirs: give --servers, or open it with open_ledger"
            )
        entry, after = self.make(records, author, key, lap)
        self._write(entry, blobs)
        lap("append_durable")
        self.state = after
        lap("append_memory")

    def follow_from_now(self) -> None:
        """Nobody writes in the folder alone any more: it follows servers. StorageError kinds."""
        with self._turn():
            (self.folder / OUTBOX_NAME).mkdir(exist_ok=True)

    def _writing(self) -> contextlib.AbstractContextManager[None]:
        """In which a block is made and appended, with everything that others wrote taken in."""
        return self._turn()

    @contextlib.contextmanager
    def _turn(self) -> Iterator[None]:
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
                if self._db.in_transaction:  # a full disk may have ended it
                    with storage_errors(f"taking back a write to {self.folder}"):
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
                if blobs:
                    self._blobs.sync()
                insert_entry(self._db, entry)
            except BaseException:
                for blob in written:  # still under the lock: no other writer needs them yet
                    self._blobs.remove(blob)
                raise
            # From here on blobs stay: another ledger's folder may be there, which needs them, or
            # a commit that fails may yet be on disk after a crash.
            self._place.check()
            self._db.execute("COMMIT")
            self._place.check()  # or it is in a file that is gone, and must not be acknowledged

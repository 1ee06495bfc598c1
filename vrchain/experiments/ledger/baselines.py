"""What the ledger is measured beside: what the machine can do at all, and two plainer layouts.

The layouts give the same promises as the ledger, so that only the layout differs: each update is
signed by its robot, checked, put into a signed block that names the hash of the block before, and
durable when ``publish`` returns. They have no more than the bench needs.
"""

import base64
import contextlib
import hashlib
import json
import os
import sqlite3
from abc import abstractmethod
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey, Ed25519PublicKey

from vrchain.errors import LedgerError
from vrchain.ledger import OPERATOR, Entry, SigningKey, Transaction
from vrchain.ledger.records.transaction import blob_digest
from vrchain.ledger.rules.chain import Chain, Lap
from vrchain.ledger.storage.blobs import BlobStore
from vrchain.ledger.storage.closing import Closing
from vrchain.ledger.storage.database import connect, insert_entry
from vrchain.ledger.storage.folder import create_folder
from vrchain.ledger.storage.place import BLOBS_NAME

_NOTHING = b""


class Turn(NamedTuple):
    """One update to make: ``robot`` publishes ``payload`` at ``timestamp_ns``."""

    robot: str
    key: SigningKey
    payload: bytes
    timestamp_ns: int


class Cryptography:
    """The limits of any update: one hash of the payload, a signature, a verification."""

    def __init__(self, message: bytes) -> None:
        """``message``: as long as what the ledger signs."""
        self._message = message
        self._private = Ed25519PrivateKey.from_private_bytes(bytes(range(32)))
        self._public = self._private.public_key()
        self._signature = self._private.sign(message)

    def hash(self, turn: Turn) -> None:
        """SHA-256 of the payload."""
        hashlib.sha256(turn.payload).digest()

    def sign(self, turn: Turn) -> None:
        """One Ed25519 signature."""
        self._private.sign(self._message)

    def verify(self, turn: Turn) -> None:
        """One Ed25519 verification."""
        self._public.verify(self._signature, self._message)


class Disk(Closing):
    """The limits of any durable update: a bare SQLite commit, a bare file. Use ``with``.

    ``rows`` stand in its one table, each a record of ``record_bytes``, keyed by number.
    """

    def __init__(self, folder: Path, rows: int, record_bytes: int) -> None:
        folder.mkdir()
        self._folder, self._rows, self._record = str(folder), rows, bytes(record_bytes)
        self._files = 0
        self._db = sqlite3.connect(folder / "bare.sqlite", isolation_level=None)
        self._db.execute("PRAGMA journal_mode = WAL")
        self._db.execute("PRAGMA synchronous = FULL")
        self._db.execute("CREATE TABLE bare (number INTEGER PRIMARY KEY, record BLOB NOT NULL)")
        self._db.execute("BEGIN")
        records = ((self._record,) for _ in range(rows))
        self._db.executemany("INSERT INTO bare (record) VALUES (?)", records)
        self._db.execute("COMMIT")

    def commit(self, turn: Turn) -> None:
        """One row, durable."""
        self._db.execute("INSERT INTO bare (record) VALUES (?)", (self._record,))

    def file(self, turn: Turn) -> None:
        """The payload in a file: written, fsynced, renamed, its folder fsynced."""
        self._files += 1
        path = f"{self._folder}/{self._files}"
        with open(path + ".tmp", "wb", buffering=0) as file:
            file.write(turn.payload)
            os.fsync(file.fileno())
        os.rename(path + ".tmp", path)
        handle = os.open(self._folder, os.O_RDONLY)
        os.fsync(handle)
        os.close(handle)

    def get(self) -> object:
        """One row by its key."""
        query = "SELECT record FROM bare WHERE number = ?"
        return self._db.execute(query, (self._rows,)).fetchone()

    def close(self) -> None:
        """Let go of the table."""
        self._db.close()


class MemoryLedger:
    """The ledger itself without its disk: the same chain, and the blobs by their digests."""

    def __init__(self, first: Entry) -> None:
        self.chain = Chain(first)
        self.entries = [first]
        self.blobs: dict[bytes, bytes] = {}

    def publish(self, turns: Sequence[Turn], lap: Lap = lambda stage: None) -> None:
        """One block of the last turn's robot: ``Ledger.publish`` with all stages but the disk's.

        No robot twice in ``turns``.
        """
        transactions = []
        for turn in turns:
            payload_digest = blob_digest(turn.payload)
            lap("hash")
            draft = self.chain.draft(turn.robot, payload_digest, "distance", turn.timestamp_ns)
            assert draft.body
            lap("encode")
            transactions.append(draft.signed(turn.key))
            lap("sign")
            self.blobs[payload_digest] = turn.payload
        entry, after = self.chain.make(transactions, turn.robot, turn.key, lap)
        self.entries.append(entry)
        self.chain.state = after
        lap("append_memory")

    def store(self, folder: Path) -> None:
        """Write it all to a new ledger in ``folder``, durable at the end only: for a quick start.

        Raises OSError, sqlite3.Error, StorageError.
        """
        create_folder(folder, self.entries[0])
        blobs = BlobStore(folder / BLOBS_NAME)
        blobs.folder.mkdir()
        for blob, data in self.blobs.items():
            with open(blobs.path(blob), "wb") as file:
                file.write(data)
        with contextlib.closing(connect(folder, writable=True, wait_s=5.0)) as db:
            db.execute("BEGIN")
            for entry in self.entries[1:]:
                insert_entry(db, entry)
            db.execute("COMMIT")
        os.sync()


class Layout(Closing):
    """Another way to lay out a ledger: a list of blocks, and the file ``path`` of them all."""

    def __init__(self, path: Path) -> None:
        self._file = open(path, "wb")  # noqa: SIM115, ``close`` closes it
        self.n_bytes = 0  # in the file

    @abstractmethod
    def publish(self, turn: Turn, sync: bool | None) -> None:
        """Append a block: in memory, and unless ``sync`` is None to the file, durably if true."""

    @abstractmethod
    def latest(self, robot: str) -> object:
        """What the robot published last, None before its first."""

    def close(self) -> None:
        """Let go of the file."""
        self._file.close()

    def _write(self, parts: Sequence[bytes], sync: bool | None) -> None:
        if sync is None:
            return
        self._file.writelines(parts)
        self.n_bytes += sum(map(len, parts))
        if sync:
            self._file.flush()
            os.fsync(self._file.fileno())


class InlineChain(Layout):
    """The paper's layout: every block holds every robot's newest panorama in full.

    In memory the blocks share the panoramas' bytes, as Python's lists do; a file cannot.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        # of each block: (what the robot signed with its signature, the panorama), by robot
        self.blocks: list[dict[str, tuple[bytes, bytes]]] = []
        self._head = bytes(32)

    def publish(self, turn: Turn, sync: bool | None) -> None:
        """As ``Layout`` has it."""
        digest = hashlib.sha256(turn.payload).hexdigest()
        said = f"{turn.robot} {len(self.blocks)} {turn.timestamp_ns} {digest}".encode()
        row = said + _checked_signature(turn.key, said), turn.payload
        newest = {**(self.blocks[-1] if self.blocks else {}), turn.robot: row}
        header = f"block {len(self.blocks)} {turn.timestamp_ns} ".encode()
        parts = [header, self._head, *(part for row in newest.values() for part in row)]
        hashed = hashlib.sha256()
        for part in parts:
            hashed.update(part)
        signature = turn.key.sign(hashed.digest())
        hashed.update(signature)
        self._write([*parts, signature], sync)
        self._head = hashed.digest()
        self.blocks.append(newest)

    def latest(self, robot: str) -> object:
        """As ``Layout`` has it."""
        return self.blocks[-1].get(robot)


class JsonChain(Layout):
    """A straightforward chain of blocks in JSON: one block a line, panoramas in base 64."""

    def __init__(self, path: Path) -> None:
        super().__init__(path)
        self.blocks: list[dict[str, Any]] = []
        self._head = ""

    def publish(self, turn: Turn, sync: bool | None) -> None:
        """As ``Layout`` has it."""
        transaction = {
            "robot": turn.robot,
            "sequence": len(self.blocks),
            "timestamp_ns": turn.timestamp_ns,
            "reason": "distance",
            "panorama": base64.b64encode(turn.payload).decode(),
        }
        transaction["signature"] = _checked_signature(turn.key, _json(transaction)).hex()
        block = {
            "height": len(self.blocks),
            "previous_hash": self._head,
            "timestamp_ns": turn.timestamp_ns,
            "author": turn.robot,
            "transactions": [transaction],
        }
        block["signature"] = turn.key.sign(_json(block)).hex()
        line = _json(block)
        self._write([line, b"\n"], sync)
        self._head = hashlib.sha256(line).hexdigest()
        self.blocks.append(block)

    def latest(self, robot: str) -> object:
        """As ``Layout`` has it: looked for from the end."""
        for block in reversed(self.blocks):
            for transaction in block["transactions"]:
                if transaction["robot"] == robot:
                    return transaction
        return None


def _checked_signature(key: SigningKey, said: bytes) -> bytes:
    """A robot's signature, verified as whoever takes it in must."""
    signature = key.sign(said)
    if not key.public.accepts(said, signature):
        raise LedgerError("a signature just made does not hold")
    return signature


def _json(value: object) -> bytes:
    return json.dumps(value, sort_keys=True, separators=(",", ":")).encode()


def verification_limit(ledger: MemoryLedger) -> Callable[[object], None]:
    """Does all hashes and signatures of a ledger: what verifying it cannot do without."""
    keys = {**ledger.chain.members, OPERATOR: ledger.chain.genesis.operator}
    public = {name: Ed25519PublicKey.from_public_bytes(key.raw) for name, key in keys.items()}
    signed = [
        (public[signer], record)
        for block, records in ledger.entries
        for signer, record in (
            (block.author, block),
            *((r.robot if isinstance(r, Transaction) else OPERATOR, r) for r in records),
        )
    ]
    checks = [(key.verify, record.signature, record.body) for key, record in signed]
    hashed = [*ledger.blobs.values(), *(record.record for _, record in signed)]

    def do_all(_: object) -> None:
        sha256 = hashlib.sha256
        for data in hashed:
            sha256(data).digest()
        for accept, signature, body in checks:
            accept(signature, body)

    return do_all

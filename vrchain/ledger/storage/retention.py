"""What has to be kept: every blob that a transaction names after the last drop that names it.

Panoramas are large and age fast, records are small and stay. The operator alone signs what may
go, in a ``Drop``: two robots may have published the same bytes, and one that turns against the
others must not take its own evidence away.
"""

import sqlite3
from collections.abc import Iterable

from vrchain.ledger.records.block import Record
from vrchain.ledger.records.membership import Drop
from vrchain.ledger.records.transaction import Transaction
from vrchain.ledger.storage.database import all_records


def blobs_to_keep(records: Iterable[Record]) -> set[bytes]:
    """Digests of all blobs that must be there after these records, in the chain's order."""
    kept: set[bytes] = set()
    for record in records:
        if isinstance(record, Transaction):
            kept.update(record.blobs)
        elif isinstance(record, Drop):
            kept.difference_update(record.blobs)
    return kept


def old_blobs(records: Iterable[Record], keep: int) -> list[bytes]:
    """Digests of the kept blobs that none of any robot's ``keep`` newest transactions names."""
    records = list(records)
    newest: dict[str, int] = {}
    for record in records:
        if isinstance(record, Transaction):
            newest[record.robot] = record.sequence
    wanted: set[bytes] = set()
    for record in records:
        if isinstance(record, Transaction) and record.sequence > newest[record.robot] - keep:
            wanted.update(record.blobs)
    return sorted(blobs_to_keep(records) - wanted)


def stored_to_keep(db: sqlite3.Connection) -> set[bytes]:
    """``blobs_to_keep`` of a stored ledger. DamagedError, StorageError."""
    return blobs_to_keep(all_records(db))


def is_dropped(db: sqlite3.Connection, blob: bytes) -> bool:
    """Whether a stored drop names the blob, and no transaction after it. As ``stored_to_keep``."""
    dropped = False
    for record in all_records(db):
        if isinstance(record, Transaction | Drop) and blob in record.blobs:
            dropped = isinstance(record, Drop)
    return dropped

"""What has to be kept: every blob that a transaction names after the last drop that names it.

Panoramas are large and age fast, records are small and stay. The operator alone signs what may
go, in a ``Drop``: two robots may have published the same bytes, and one that turns against the
others must not take its own evidence away.
"""

import contextlib
from collections.abc import Iterable

from vrchain.errors import LedgerError
from vrchain.ledger.records.block import Record
from vrchain.ledger.records.membership import OPERATOR, Drop, Genesis
from vrchain.ledger.records.transaction import Transaction


class Retention:
    """Which blobs must be there after some records in the chain's order, and which need not.

    ``kept``: the height of the block that first names it since its last drop, by digest.
    ``dropped``: digests of those that a drop names, and no transaction after it.
    """

    def __init__(self, records: Iterable[Record] = ()) -> None:
        self.kept: dict[bytes, int] = {}
        self.dropped: set[bytes] = set()
        for record in records:
            self.take(record)

    def take(self, record: Record, height: int = 0) -> None:
        """Go on with a record of the block at ``height``."""
        if isinstance(record, Transaction):
            for blob in record.blobs:
                self.kept.setdefault(blob, height)
            self.dropped.difference_update(record.blobs)
        elif isinstance(record, Drop):
            for blob in record.blobs:
                self.kept.pop(blob, None)
            self.dropped.update(record.blobs)


def named_by(records: Iterable[Record]) -> set[bytes]:
    """Digests of the blobs that these transactions name."""
    return {b for record in records if isinstance(record, Transaction) for b in record.blobs}


def dropped_by(blobs: Iterable[bytes], genesis: Genesis, after: int) -> set[bytes]:
    """Digests that are let go of by those of these bytes which are the operator's drops.

    after: how many records the operator had signed before what names the blobs; older drops do not
    count.
    """
    found: set[bytes] = set()
    for data in blobs:
        with contextlib.suppress(LedgerError):
            record = Drop.decode(data)
            record.check_signature(OPERATOR, genesis.operator)
            if record.ledger_id == genesis.id and record.sequence >= after:
                found.update(record.blobs)
    return found


def old_blobs(records: Iterable[Record], keep: int) -> list[bytes]:
    """Digests of the kept blobs that none of any robot's ``keep`` newest transactions names."""
    records = list(records)
    published = [record for record in records if isinstance(record, Transaction)]
    newest = {record.robot: record.sequence for record in published}
    wanted = {
        blob
        for record in published
        if record.sequence > newest[record.robot] - keep
        for blob in record.blobs
    }
    return sorted(Retention(records).kept.keys() - wanted)

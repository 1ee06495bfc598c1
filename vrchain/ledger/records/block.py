"""A block: one link of the chain.

Its hash covers height, previous hash, time, author, the roots of its records and of the table of
newest transactions, and the signature.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Annotated, ClassVar, NamedTuple, TypeAlias, cast

from vrchain.ledger.errors import NewestError, RecordError
from vrchain.ledger.records.encoding import NO_DIGEST, digest, encode, encode_fields
from vrchain.ledger.records.fields import (
    Checked,
    Timestamp,
    check_digest,
    check_integer,
    check_name,
)
from vrchain.ledger.records.membership import OPERATOR, Drop, Enrolment, Expulsion, Genesis
from vrchain.ledger.records.merkle import Tree
from vrchain.ledger.records.record import SignedRecord, decode_signed
from vrchain.ledger.records.table import Rows, Table
from vrchain.ledger.records.transaction import Transaction

Record: TypeAlias = Genesis | Enrolment | Expulsion | Drop | Transaction

NO_BLOCK = NO_DIGEST  # what the first block has for its previous hash
_DOMAIN = encode("vrchain/2/record")
_RECORD_KINDS: dict[str, type[SignedRecord]] = {
    kind.DOMAIN: kind for kind in (Genesis, Enrolment, Expulsion, Drop, Transaction)
}


def _check_author(what: str, author: str) -> None:
    if author != OPERATOR:
        check_name(what, author)


@dataclass(frozen=True)
class Block(SignedRecord):
    """The signed part is short, whatever the block brings in and however many robots there are.

    ``records_root``: of the ids of the records that it brings in, see ``records_root``.
    ``newest_root``: of the table of every robot's newest transaction, see ``Table``.
    ``author``: the member (or the operator) who made and signed the block.
    ``table``: that table, for a block that was made here, judged, or read from a ledger.
    """

    DOMAIN: ClassVar[str] = "vrchain/2/block"

    height: Annotated[int, Checked("height", check_integer)]
    previous_hash: Annotated[bytes, Checked("previous hash", check_digest)]
    timestamp_ns: Timestamp
    records_root: Annotated[bytes, Checked("root of the records", check_digest)]
    newest_root: Annotated[bytes, Checked("root of the newest", check_digest)]
    author: Annotated[str, Checked("author", _check_author)]
    table: Table | None = field(default=None, compare=False, repr=False)

    def __str__(self) -> str:
        return f"block {self.height}"

    @property
    def hash(self) -> bytes:
        """The block's id: SHA-256 of its canonical bytes, 32 bytes."""
        return self.id

    @property
    def newest(self) -> Rows:
        """(robot, id of its newest transaction) for all robots, carried over or new, sorted.

        Raises RecordError for a block whose ``table`` is not known.
        """
        if self.table is None:
            raise RecordError(f"{self} alone holds only the root of its table; ask a ledger for it")
        return self.table.rows

    def learn(self, table: Table) -> None:
        """Keep ``table`` with the block; NewestError unless it is the one that the root pins."""
        if table.root != self.newest_root:
            raise NewestError(
                f"{self} has another table of newest transactions than its records make"
            )
        self.__dict__["table"] = table


class Entry(NamedTuple):
    """A block and the records it brings in, in the block's order."""

    block: Block
    records: tuple[Record, ...]


def records_root(records: Sequence[Record]) -> bytes:
    """The root of the Merkle tree over the records' ids, each id hashed behind its domain."""
    return Tree([digest(_DOMAIN + encode_fields(record.id)) for record in records]).root


def decode_record(data: bytes) -> Record:
    """The record of one of the kinds above in exactly these canonical bytes.

    Raises EncodingError, RecordError or TooLargeError for anything else.
    """
    return cast(Record, decode_signed(data, _RECORD_KINDS))

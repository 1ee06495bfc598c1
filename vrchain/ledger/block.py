"""A block: one link of the chain, with every robot's newest transaction."""

from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Self, TypeAlias, cast

from vrchain.ledger.encoding import (
    DIGEST_BYTES,
    Field,
    check_integer,
    check_kinds,
    check_length,
    check_name,
)
from vrchain.ledger.errors import EncodingError
from vrchain.ledger.membership import OPERATOR, Enrolment, Genesis
from vrchain.ledger.record import SignedRecord, check_sorted_names, decode_signed
from vrchain.ledger.transaction import Transaction

Record: TypeAlias = Genesis | Enrolment | Transaction

NO_BLOCK = bytes(DIGEST_BYTES)  # what the first block has for its previous hash
NO_TRANSACTION = bytes(DIGEST_BYTES)  # newest of a robot that has not published yet
_RECORD_KINDS: dict[str, type[SignedRecord]] = {
    kind.DOMAIN: kind for kind in (Genesis, Enrolment, Transaction)
}


@dataclass(frozen=True)
class Block(SignedRecord):
    """``records``: ids of the records that this block brings in, in their order.

    ``newest``: (robot, id of its newest transaction), for all robots, carried over or new,
    sorted by robot. ``author`` is the member (or the operator) who made and signed the block.
    """

    DOMAIN: ClassVar[str] = "vrchain/1/block"

    height: int
    previous_hash: bytes
    timestamp_ns: int
    records: tuple[bytes, ...]
    newest: tuple[tuple[str, bytes], ...]
    author: str

    def __post_init__(self) -> None:
        check_integer("height", self.height)
        check_length("previous hash", self.previous_hash, DIGEST_BYTES)
        check_integer("timestamp_ns", self.timestamp_ns)
        for record_id in self.records:
            check_length("record id", record_id, DIGEST_BYTES)
        for robot, transaction_id in self.newest:
            check_name("robot", robot)
            check_length(f"newest transaction of {robot}", transaction_id, DIGEST_BYTES)
        check_sorted_names("newest", [robot for robot, _ in self.newest])
        if self.author != OPERATOR:
            check_name("author", self.author)

    def __str__(self) -> str:
        return f"block {self.height}"

    @property
    def hash(self) -> bytes:
        """The block's id: SHA-256 of its canonical bytes, 32 bytes."""
        return self.id

    def _fields(self) -> tuple[Field, ...]:
        return (
            self.height,
            self.previous_hash,
            self.timestamp_ns,
            self.records,
            self.newest,
            self.author,
        )

    @classmethod
    def _from_fields(cls, fields: tuple[Any, ...], signature: bytes) -> Self:
        kinds = (int, bytes, int, tuple, tuple, str)
        check_kinds("block", fields, *kinds)
        for row in fields[4]:
            if type(row) is not tuple:
                raise EncodingError(f"newest: expected tuples, got {type(row).__name__}")
            check_kinds("newest", row, str, bytes)
        return cls(*fields, signature=signature)


class Entry(NamedTuple):
    """A block and the records it brings in, in the block's order."""

    block: Block
    records: tuple[Record, ...]


def decode_record(data: bytes) -> Record:
    """The genesis record, enrolment or transaction of exactly these canonical bytes.

    Raises EncodingError, RecordError or TooLargeError for anything else.
    """
    return cast(Record, decode_signed(data, _RECORD_KINDS))

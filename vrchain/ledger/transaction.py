"""A transaction: one robot says, signed, that it took one panorama."""

from dataclasses import dataclass
from typing import Any, ClassVar, Self

from vrchain.ledger.encoding import (
    DIGEST_BYTES,
    Field,
    check_integer,
    check_kinds,
    check_length,
    check_name,
)
from vrchain.ledger.errors import RecordError
from vrchain.ledger.record import SignedRecord

REASONS = ("start", "distance", "view", "time")


@dataclass(frozen=True)
class Transaction(SignedRecord):
    """``sequence`` counts the robot's own transactions from 0; ``timestamp_ns`` is its clock's.

    ``ledger_id`` is the genesis record's id, so that no transaction passes in another ledger.
    ``payload_digest`` is the SHA-256 of the payload's bytes.
    """

    DOMAIN: ClassVar[str] = "vrchain/1/transaction"

    ledger_id: bytes
    robot: str
    sequence: int
    timestamp_ns: int
    reason: str
    payload_digest: bytes

    def __post_init__(self) -> None:
        check_length("ledger id", self.ledger_id, DIGEST_BYTES)
        check_name("robot", self.robot)
        check_integer("sequence", self.sequence)
        check_integer("timestamp_ns", self.timestamp_ns)
        if self.reason not in REASONS:
            raise RecordError(f"expected a reason of {', '.join(REASONS)}, got {self.reason!r:.80}")
        check_length("payload digest", self.payload_digest, DIGEST_BYTES)

    def __str__(self) -> str:
        return f"transaction {self.sequence} of {self.robot}"

    def _fields(self) -> tuple[Field, ...]:
        return (
            self.ledger_id,
            self.robot,
            self.sequence,
            self.timestamp_ns,
            self.reason,
            self.payload_digest,
        )

    @classmethod
    def _from_fields(cls, fields: tuple[Any, ...], signature: bytes) -> Self:
        kinds = (bytes, str, int, int, str, bytes)
        return cls(*check_kinds("transaction", fields, *kinds), signature=signature)

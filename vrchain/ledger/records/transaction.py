"""A transaction: one robot says, signed, that it took one panorama and saw its landmarks."""

from dataclasses import dataclass
from typing import Annotated, ClassVar

from vrchain.ledger.errors import PayloadDigestError, RecordError
from vrchain.ledger.records.encoding import MAX_PAYLOAD_BYTES, NO_DIGEST, digest, too_large
from vrchain.ledger.records.fields import (
    Checked,
    LedgerId,
    SequenceNumber,
    Timestamp,
    check_digest,
    check_name,
)
from vrchain.ledger.records.record import SignedRecord

REASONS = ("start", "distance", "view", "time")
NO_BLOB = NO_DIGEST  # the landmarks' digest of a publisher that has none yet
NO_TRANSACTION = NO_DIGEST  # what a robot's first transaction has for its previous one


def _check_reason(what: str, reason: str) -> None:
    if reason not in REASONS:
        raise RecordError(f"expected a {what} of {', '.join(REASONS)}, got {reason!r:.80}")


@dataclass(frozen=True)
class Transaction(SignedRecord):
    """``sequence`` counts the robot's own transactions from 0; ``timestamp_ns`` is its clock's.

    ``ledger_id`` is the genesis record's id, so that no transaction passes in another ledger.
    ``payload_digest`` is the SHA-256 of the panorama's bytes, ``landmarks_digest`` that of the
    landmark record's or NO_BLOB. ``previous`` is the id of the robot's transaction before this
    one, NO_TRANSACTION for its first, so that each robot's transactions are a chain as well.
    """

    DOMAIN: ClassVar[str] = "vrchain/2/transaction"

    ledger_id: LedgerId
    robot: Annotated[str, Checked("robot", check_name)]
    sequence: SequenceNumber
    timestamp_ns: Timestamp
    reason: Annotated[str, Checked("reason", _check_reason)]
    payload_digest: Annotated[bytes, Checked("payload digest", check_digest)]
    landmarks_digest: Annotated[bytes, Checked("landmarks digest", check_digest)] = NO_BLOB
    previous: Annotated[bytes, Checked("previous transaction", check_digest)] = NO_TRANSACTION

    def __str__(self) -> str:
        return f"transaction {self.sequence} of {self.robot}"

    @property
    def blobs(self) -> tuple[bytes, ...]:
        """Digests of the one or two blobs that it names."""
        if self.landmarks_digest == NO_BLOB:
            return (self.payload_digest,)
        return (self.payload_digest, self.landmarks_digest)


@dataclass(frozen=True)
class Offer:
    """A transaction with the bytes that it names: there is none with other bytes.

    ``landmarks`` is None exactly when the transaction names no landmark record. Making one
    with other bytes raises PayloadDigestError; RecordError or TooLargeError for what is no blob.
    """

    transaction: Transaction
    payload: bytes
    landmarks: bytes | None = None

    def __post_init__(self) -> None:
        named = (self.transaction.payload_digest, self.transaction.landmarks_digest)
        if (blob_digest(self.payload), blob_digest(self.landmarks)) != named:
            raise PayloadDigestError(f"the blobs are not those that {self.transaction} names")

    @property
    def size(self) -> int:
        """How many bytes its blobs have."""
        return len(self.payload) + len(self.landmarks or b"")

    @property
    def blobs(self) -> dict[bytes, bytes]:
        """The bytes by their digests."""
        given = (self.payload,) if self.landmarks is None else (self.payload, self.landmarks)
        return dict(zip(self.transaction.blobs, given, strict=True))


def blob_digest(blob: bytes | None) -> bytes:
    """SHA-256 of a blob, NO_BLOB of none. RecordError or TooLargeError for what is no blob."""
    if blob is None:
        return NO_BLOB
    if type(blob) is not bytes:
        raise RecordError(f"payload: expected bytes, got {type(blob).__name__}")
    if len(blob) > MAX_PAYLOAD_BYTES:
        raise too_large("payload", len(blob), MAX_PAYLOAD_BYTES)
    return digest(blob)

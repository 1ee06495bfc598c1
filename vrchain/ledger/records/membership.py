"""What only the operator signs: who may write, and what is no longer kept.

The genesis record names the first members; an enrolment adds one, an expulsion ends one's
membership for ever; a drop says which blobs need not be there any more.
"""

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, Self, TypeAlias

from vrchain.ledger.errors import EncodingError, RecordError
from vrchain.ledger.records.encoding import DIGEST_BYTES, Field, check_kinds
from vrchain.ledger.records.fields import (
    Checked,
    LedgerId,
    SequenceNumber,
    Timestamp,
    check_digest,
    check_name,
    check_sorted,
)
from vrchain.ledger.records.keys import PublicKey
from vrchain.ledger.records.record import SignedRecord

OPERATOR = "operator"  # who signs these records; no robot may be called so
MAX_DROPPED = 10_000  # blobs in one drop
_MAX_TEXT = 200


def check_member_name(name: str) -> None:
    """Refuse with RecordError what cannot name a member."""
    check_name("member", name)
    if name == OPERATOR:
        raise RecordError(f"expected a member's name, got {OPERATOR!r}, which is reserved")


def _check_text(what: str, text: str) -> None:
    if not isinstance(text, str) or len(text) > _MAX_TEXT:
        raise RecordError(f"{what}: expected text of at most {_MAX_TEXT} characters")


def _check_salt(what: str, salt: bytes) -> None:
    if type(salt) is not bytes or len(salt) > DIGEST_BYTES:
        raise RecordError(f"{what}: expected at most {DIGEST_BYTES} bytes")


def _check_dropped(what: str, blobs: tuple[bytes, ...]) -> None:
    if not 1 <= len(blobs) <= MAX_DROPPED:
        raise RecordError(f"drop: expected 1 to {MAX_DROPPED} blobs, got {len(blobs)}")
    for blob in blobs:
        check_digest("dropped blob", blob)
    check_sorted(what, blobs)


MemberName: TypeAlias = Annotated[str, Checked("member", lambda _, name: check_member_name(name))]


@dataclass(frozen=True)
class Genesis(SignedRecord):
    """The first record. Its id is the ledger's id.

    ``members``: (name, public key), sorted by name. ``salt`` tells apart two ledgers that
    are otherwise alike; simulations leave it empty.
    """

    DOMAIN: ClassVar[str] = "vrchain/2/genesis"

    name: Annotated[str, Checked("ledger name", _check_text)]
    salt: Annotated[bytes, Checked("salt", _check_salt)]
    timestamp_ns: Timestamp
    operator: PublicKey
    members: tuple[tuple[str, PublicKey], ...]

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, _ in self.members:
            check_member_name(name)
        check_sorted("members", [name for name, _ in self.members])

    def __str__(self) -> str:
        return "the genesis record"

    @property
    def insecure(self) -> bool:
        """Whether any first key is a simulated one, so that anyone could sign."""
        return self.operator.insecure or any(key.insecure for _, key in self.members)

    def _fields(self) -> tuple[Field, ...]:
        members = tuple((name, *_key_fields(key)) for name, key in self.members)
        return (*super()._fields(), _key_fields(self.operator), members)

    @classmethod
    def _from_fields(cls, fields: tuple[Any, ...], signature: bytes) -> Self:
        kinds = (str, bytes, int, tuple, tuple)
        name, salt, timestamp_ns, operator, rows = check_kinds("genesis", fields, *kinds)
        raw, insecure = check_kinds("operator key", operator, bytes, int)
        members = tuple(_member(row) for row in rows)
        return cls(name, salt, timestamp_ns, _key(raw, insecure), members, signature=signature)


@dataclass(frozen=True)
class OperatorRecord(SignedRecord):
    """Base of the operator's records after genesis; ``sequence`` counts them from 0."""

    ledger_id: LedgerId
    sequence: SequenceNumber
    timestamp_ns: Timestamp


@dataclass(frozen=True)
class Enrolment(OperatorRecord):
    """The operator takes in the robot ``name``."""

    DOMAIN: ClassVar[str] = "vrchain/2/enrolment"

    name: MemberName
    public_key: PublicKey

    def __str__(self) -> str:
        return f"the enrolment of {self.name}"

    def _fields(self) -> tuple[Field, ...]:
        return (*super()._fields(), *_key_fields(self.public_key))

    @classmethod
    def _from_fields(cls, fields: tuple[Any, ...], signature: bytes) -> Self:
        kinds = (bytes, int, int, str, bytes, int)
        ledger_id, number, time_ns, name, *key = check_kinds("enrolment", fields, *kinds)
        return cls(ledger_id, number, time_ns, name, _key(*key), signature=signature)


@dataclass(frozen=True)
class Expulsion(OperatorRecord):
    """The operator ends the membership of ``name``, whose row leaves the table of newest.

    What it published before stays in the chain. The name is used up.
    """

    DOMAIN: ClassVar[str] = "vrchain/2/expulsion"

    name: MemberName

    def __str__(self) -> str:
        return f"the expulsion of {self.name}"


@dataclass(frozen=True)
class Drop(OperatorRecord):
    """From here on the blobs with these digests (sorted) need not be there any more.

    A blob that a later transaction names again must be there again.
    """

    DOMAIN: ClassVar[str] = "vrchain/2/drop"

    blobs: Annotated[tuple[bytes, ...], Checked("dropped blobs", _check_dropped)]

    def __str__(self) -> str:
        return f"the drop of {len(self.blobs)} blobs"


def _key_fields(key: PublicKey) -> tuple[bytes, int]:
    return key.raw, int(key.insecure)


def _member(row: Any) -> tuple[str, PublicKey]:
    if type(row) is not tuple:
        raise EncodingError(f"member: expected a tuple, got {type(row).__name__}")
    name, raw, insecure = check_kinds("member", row, str, bytes, int)
    return name, _key(raw, insecure)


def _key(raw: bytes, insecure: int) -> PublicKey:
    if insecure not in (0, 1):
        raise EncodingError(f"insecure: expected 0 or 1, got {insecure}")
    return PublicKey(raw, bool(insecure))

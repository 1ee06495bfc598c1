"""Who may write: the genesis record names the first members, an enrolment adds one.

Both are signed by the operator, and by nobody else.
"""

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
from vrchain.ledger.errors import EncodingError, RecordError
from vrchain.ledger.keys import PublicKey
from vrchain.ledger.record import SignedRecord, check_sorted_names

OPERATOR = "operator"  # who signs genesis and enrolments; no robot may be called so
_MAX_TEXT = 200


@dataclass(frozen=True)
class Genesis(SignedRecord):
    """The first record. Its id is the ledger's id.

    ``members``: (name, public key), sorted by name. ``salt`` tells apart two ledgers that
    are otherwise alike; simulations leave it empty.
    """

    DOMAIN: ClassVar[str] = "vrchain/1/genesis"

    name: str
    salt: bytes
    timestamp_ns: int
    operator: PublicKey
    members: tuple[tuple[str, PublicKey], ...]

    def __post_init__(self) -> None:
        if not isinstance(self.name, str) or len(self.name) > _MAX_TEXT:
            raise RecordError(f"ledger name: expected text of at most {_MAX_TEXT} characters")
        if type(self.salt) is not bytes or len(self.salt) > DIGEST_BYTES:
            raise RecordError(f"salt: expected at most {DIGEST_BYTES} bytes")
        check_integer("timestamp_ns", self.timestamp_ns)
        for name, _ in self.members:
            check_member_name(name)
        check_sorted_names("members", [name for name, _ in self.members])

    def __str__(self) -> str:
        return "the genesis record"

    @property
    def insecure(self) -> bool:
        """Whether any first key is a simulated one, so that anyone could sign."""
        return self.operator.insecure or any(key.insecure for _, key in self.members)

    def _fields(self) -> tuple[Field, ...]:
        members = tuple((name, *_key_fields(key)) for name, key in self.members)
        return (self.name, self.salt, self.timestamp_ns, _key_fields(self.operator), members)

    @classmethod
    def _from_fields(cls, fields: tuple[Any, ...], signature: bytes) -> Self:
        kinds = (str, bytes, int, tuple, tuple)
        name, salt, timestamp_ns, operator, rows = check_kinds("genesis", fields, *kinds)
        raw, insecure = check_kinds("operator key", operator, bytes, int)
        members = tuple(_member(row) for row in rows)
        return cls(name, salt, timestamp_ns, _key(raw, insecure), members, signature=signature)


@dataclass(frozen=True)
class Enrolment(SignedRecord):
    """The operator takes in the robot ``name``. ``sequence`` counts the operator's records."""

    DOMAIN: ClassVar[str] = "vrchain/1/enrolment"

    ledger_id: bytes
    sequence: int
    timestamp_ns: int
    name: str
    public_key: PublicKey

    def __post_init__(self) -> None:
        check_length("ledger id", self.ledger_id, DIGEST_BYTES)
        check_integer("sequence", self.sequence)
        check_integer("timestamp_ns", self.timestamp_ns)
        check_member_name(self.name)

    def __str__(self) -> str:
        return f"the enrolment of {self.name}"

    def _fields(self) -> tuple[Field, ...]:
        key = _key_fields(self.public_key)
        return (self.ledger_id, self.sequence, self.timestamp_ns, self.name, *key)

    @classmethod
    def _from_fields(cls, fields: tuple[Any, ...], signature: bytes) -> Self:
        kinds = (bytes, int, int, str, bytes, int)
        ledger_id, sequence, timestamp_ns, name, raw, insecure = check_kinds(
            "enrolment", fields, *kinds
        )
        key = _key(raw, insecure)
        return cls(ledger_id, sequence, timestamp_ns, name, key, signature=signature)


def check_member_name(name: str) -> None:
    """Refuse with RecordError what cannot name a member."""
    check_name("member", name)
    if name == OPERATOR:
        raise RecordError(f"expected a member's name, got {OPERATOR!r}, which is reserved")


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

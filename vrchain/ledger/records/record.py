"""What every signed record has in common: fields, body, signature, canonical bytes, id.

The body is the domain and the fields that a class declares, in their order; the signature is over
it. The id is the SHA-256 of the whole record, signature included, so that a head hash pins every
stored byte. Nobody but the signer can make a second valid signature for a body; a signer who does
makes a second id for one sequence number, which the chain refuses as a replay.

Records never change, so each keeps its bytes once they are made or read, and the key for
which its signature was once found to hold.
"""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Annotated, Any, ClassVar, Self, get_args, get_origin, get_type_hints

from vrchain.ledger.errors import EncodingError, SignatureError
from vrchain.ledger.records.encoding import Field, check_kinds, decode, digest, encode, split
from vrchain.ledger.records.fields import Checked, check_length
from vrchain.ledger.records.keys import SIGNATURE_BYTES, PublicKey, SigningKey

SIGNED_DOMAIN = "vrchain/2/signed"


@dataclass(frozen=True)
class SignedRecord:
    """Base of the record kinds. An empty signature marks a draft, which has no canonical bytes."""

    DOMAIN: ClassVar[str]
    field_names: ClassVar[tuple[str, ...]]  # of what the body holds behind the domain, in its order
    _types: ClassVar[tuple[type, ...]]
    _checks: ClassVar[tuple[Checked, ...]]

    signature: bytes = field(default=b"", kw_only=True)

    def __init_subclass__(cls) -> None:
        """Look once which fields are annotated with ``Checked``: these are the body's."""
        hints = get_type_hints(cls, include_extras=True)
        declared = {name: get_args(h) for name, h in hints.items() if get_origin(h) is Annotated}
        cls.field_names = tuple(declared)
        cls._types = tuple([get_origin(kind) or kind for kind, _ in declared.values()])
        cls._checks = tuple([checked for _, checked in declared.values()])

    def __post_init__(self) -> None:
        for name, (what, check) in zip(self.field_names, self._checks, strict=True):
            check(what, getattr(self, name))

    @cached_property
    def body(self) -> bytes:
        """The bytes that are signed: every field but the signature."""
        return encode(self.DOMAIN, *self._fields())

    @cached_property
    def record(self) -> bytes:
        """The canonical bytes: body and signature."""
        check_length(f"signature of {self}", self.signature, SIGNATURE_BYTES)
        return encode(SIGNED_DOMAIN, self.body, self.signature)

    @cached_property
    def id(self) -> bytes:
        """SHA-256 of the canonical bytes, 32 bytes."""
        return digest(self.record)

    def signed(self, key: SigningKey) -> Self:
        """A copy that carries ``key``'s signature of the body."""
        copy = object.__new__(type(self))  # the same fields, checked already, and the same body
        copy.__dict__.update(self.__dict__, body=self.body, signature=key.sign(self.body))
        for name in ("record", "id", "_accepted_by"):
            copy.__dict__.pop(name, None)
        return copy

    def check_signature(self, signer: str, public: PublicKey) -> None:
        """Raise SignatureError unless the signature is that of ``signer``'s public key."""
        if self.__dict__.get("_accepted_by") == public.raw:
            return
        if not public.accepts(self.body, self.signature):
            raise SignatureError(f"{self} does not carry a valid signature by {signer}")
        self.__dict__["_accepted_by"] = public.raw

    @classmethod
    def decode(cls, data: bytes) -> Self:
        """The record of exactly these canonical bytes; EncodingError or RecordError otherwise."""
        record = decode_signed(data, {cls.DOMAIN: cls})
        assert isinstance(record, cls)
        return record

    def _fields(self) -> tuple[Field, ...]:
        return tuple([getattr(self, name) for name in self.field_names])

    @classmethod
    def _from_fields(cls, fields: tuple[Any, ...], signature: bytes) -> Self:
        return cls(*check_kinds(cls.__name__.lower(), fields, *cls._types), signature=signature)


def decode_signed(data: bytes, kinds: dict[str, type[SignedRecord]]) -> SignedRecord:
    """The record of one of ``kinds`` (by domain) in canonical bytes.

    Raises EncodingError, RecordError or TooLargeError for anything else.
    """
    fields = decode(data, SIGNED_DOMAIN)
    body, signature = check_kinds("signed record", fields, bytes, bytes)
    check_length("signature", signature, SIGNATURE_BYTES)
    domain, fields = split(body)
    if domain not in kinds:
        raise EncodingError(f"expected a record of {' or '.join(kinds)}, got {domain!r:.80}")
    record = kinds[domain]._from_fields(fields, signature)
    record.__dict__.update(body=body, record=data)  # what decodes is canonical
    return record

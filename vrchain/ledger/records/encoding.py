"""The one canonical encoding of everything that is hashed or signed.

A value is a sequence of typed, length-prefixed fields; the first is a domain string with
the format's version, so that bytes of one kind never pass for another. Every value has
exactly one encoding and ``decode`` takes no other bytes. docs/reference/ledger-format.md has
the rules.
"""

import hashlib
import struct
from typing import Any, TypeAlias

from vrchain.ledger.errors import EncodingError, TooLargeError

Field: TypeAlias = "int | str | bytes | tuple[Field, ...]"

DIGEST_BYTES = 32
NO_DIGEST = bytes(DIGEST_BYTES)  # stands for nothing: no earlier block or transaction, no blob
MAX_RECORD_BYTES = 1 << 20
MAX_PAYLOAD_BYTES = 1 << 26
MAX_INTEGER = (1 << 63) - 1  # also fits SQLite's signed integers
_MAX_DEPTH = 4
_HEAD = struct.Struct(">BI")  # one byte of tag, four of length
_BYTES, _TEXT, _INTEGER, _TUPLE = b"bsit"


def digest(data: bytes) -> bytes:
    """SHA-256 of ``data``, 32 bytes."""
    return hashlib.sha256(data).digest()


def encode(domain: str, *fields: Field) -> bytes:
    """Canonical bytes of ``fields`` under ``domain``, for instance ``"vrchain/2/transaction"``.

    Raises EncodingError for a value that has no encoding, TooLargeError over MAX_RECORD_BYTES.
    """
    data = encode_fields(domain, *fields)
    if len(data) > MAX_RECORD_BYTES:
        raise too_large("record", len(data), MAX_RECORD_BYTES)
    return data


def encode_fields(*fields: Field) -> bytes:
    """Fields without a domain of their own: part of what is encoded elsewhere. EncodingError."""
    return b"".join(map(_encode_field, fields))


def decode(data: bytes, domain: str) -> tuple[Any, ...]:
    """The fields that ``encode(domain, ...)`` made into ``data``.

    Raises EncodingError for every other input, TooLargeError over MAX_RECORD_BYTES.
    """
    found, fields = split(data)
    if found != domain:
        raise EncodingError(f"expected a record of domain {domain!r}, got {found!r:.80}")
    return fields


def split(data: bytes) -> tuple[str, tuple[Any, ...]]:
    """The domain and the fields of canonical bytes, whatever their domain; errors as ``decode``."""
    if type(data) is not bytes:
        raise EncodingError(f"expected bytes, got {type(data).__name__}")
    if len(data) > MAX_RECORD_BYTES:
        raise too_large("record", len(data), MAX_RECORD_BYTES)
    fields = decode_fields(data)
    if not fields or type(fields[0]) is not str:
        raise EncodingError("expected a record that begins with its domain; the bytes hold none")
    return fields[0], fields[1:]


def decode_fields(data: bytes) -> tuple[Any, ...]:
    """The fields that ``encode_fields`` made into ``data``; EncodingError for other bytes."""
    return _decode_fields(data, 0, len(data), depth=0)


def check_kinds(what: str, fields: tuple[Any, ...], *kinds: type) -> tuple[Any, ...]:
    """``fields`` again, once each is of its kind; otherwise EncodingError."""
    if tuple(map(type, fields)) != kinds:
        expected = ", ".join(kind.__name__ for kind in kinds)
        got = ", ".join(type(field).__name__ for field in fields[:12])
        raise EncodingError(f"{what}: expected fields ({expected}), got ({got})")
    return fields


def too_large(what: str, size: int, limit: int) -> TooLargeError:
    """The error for a record or payload of more bytes than are taken."""
    return TooLargeError(f"expected a {what} of at most {limit} bytes, got {size} bytes")


def _truncated(position: int) -> EncodingError:
    return EncodingError(f"expected a whole field at byte {position}, got a truncated one")


def _encode_field(value: Field) -> bytes:
    if type(value) is bytes:
        return _HEAD.pack(_BYTES, len(value)) + value
    if type(value) is int:
        if not 0 <= value <= MAX_INTEGER:
            raise EncodingError(f"expected an integer from 0 to 2**63 - 1, got {value}")
        return _HEAD.pack(_INTEGER, 8) + value.to_bytes(8, "big")
    if type(value) is str:
        try:
            text = value.encode()
        except UnicodeEncodeError as error:
            raise EncodingError(f"text that is not Unicode has no encoding: {error}") from None
        return _HEAD.pack(_TEXT, len(text)) + text
    if type(value) is tuple:
        inner = b"".join(map(_encode_field, value))
        return _HEAD.pack(_TUPLE, len(inner)) + inner
    raise EncodingError(f"expected int, str, bytes or tuple, got {type(value).__name__}")


def _decode_fields(data: bytes, position: int, end: int, depth: int) -> tuple[Any, ...]:
    """The fields in ``data[position:end]``. One loop: a ledger's verification runs it most."""
    if depth > _MAX_DEPTH:
        raise EncodingError(f"expected tuples nested at most {_MAX_DEPTH} deep")
    fields: list[Field] = []
    while position < end:
        start = position + _HEAD.size
        if start > end:
            raise _truncated(position)
        tag, length = _HEAD.unpack_from(data, position)
        if start + length > end:
            raise _truncated(position)
        if tag == _BYTES:
            fields.append(data[start : start + length])
        elif tag == _INTEGER:
            if length != 8 or data[start] > 127:
                raise EncodingError(
                    f"expected an integer of 8 bytes below 2**63 at byte {position}"
                )
            fields.append(int.from_bytes(data[start : start + 8], "big"))
        elif tag == _TEXT:
            try:
                fields.append(data[start : start + length].decode())
            except UnicodeDecodeError:
                raise EncodingError(f"expected UTF-8 text at byte {position}") from None
        elif tag == _TUPLE:
            fields.append(_decode_fields(data, start, start + length, depth + 1))
        else:
            raise EncodingError(f"expected a tag b, s, i or t at byte {position}, got byte {tag}")
        position = start + length
    return tuple(fields)

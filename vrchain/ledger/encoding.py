"""The one canonical encoding of everything that is hashed or signed.

A value is a sequence of typed, length-prefixed fields; the first is a domain string with
the format's version, so that bytes of one kind never pass for another. Every value has
exactly one encoding and ``decode`` takes no other bytes. docs/ledger-format.md has the rules.
"""

import hashlib
import re
from typing import Any, TypeAlias

from vrchain.ledger.errors import EncodingError, RecordError, TooLargeError

Field: TypeAlias = "int | str | bytes | tuple[Field, ...]"

DIGEST_BYTES = 32
MAX_RECORD_BYTES = 1 << 20
MAX_PAYLOAD_BYTES = 1 << 26
MAX_INTEGER = (1 << 63) - 1  # also fits SQLite's signed integers
_MAX_DEPTH = 4
_HEAD_BYTES = 5  # one tag, four of length
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")


def digest(data: bytes) -> bytes:
    """SHA-256 of ``data``, 32 bytes."""
    return hashlib.sha256(data).digest()


def encode(domain: str, *fields: Field) -> bytes:
    """Canonical bytes of ``fields`` under ``domain``, for instance ``"vrchain/1/transaction"``.

    Raises EncodingError for a value that has no encoding, TooLargeError over MAX_RECORD_BYTES.
    """
    data = b"".join([_encode_field(domain), *map(_encode_field, fields)])
    if len(data) > MAX_RECORD_BYTES:
        raise _too_large("record", len(data), MAX_RECORD_BYTES)
    return data


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
        raise _too_large("record", len(data), MAX_RECORD_BYTES)
    fields = _decode_fields(data, depth=0)
    if not fields or type(fields[0]) is not str:
        raise EncodingError("expected a record that begins with its domain; the bytes hold none")
    return fields[0], fields[1:]


def check_kinds(what: str, fields: tuple[Any, ...], *kinds: type) -> tuple[Any, ...]:
    """``fields`` again, once each is of its kind; otherwise EncodingError."""
    if tuple(map(type, fields)) != kinds:
        expected = ", ".join(kind.__name__ for kind in kinds)
        got = ", ".join(type(field).__name__ for field in fields[:12])
        raise EncodingError(f"{what}: expected fields ({expected}), got ({got})")
    return fields


def check_name(what: str, name: str) -> None:
    """Refuse with RecordError what is no name: 1 to 64 of A-Z a-z 0-9 . _ -, not first . _ -"""
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise RecordError(
            f"{what}: expected 1 to 64 letters, digits, '.', '_' or '-' "
            f"that begin with a letter or digit, got {name!r:.80}"
        )


def check_integer(what: str, value: int) -> None:
    """Refuse with RecordError what is no integer in 0 .. 2**63 - 1."""
    if type(value) is not int or not 0 <= value <= MAX_INTEGER:
        raise RecordError(f"{what}: expected an integer from 0 to 2**63 - 1, got {value!r:.80}")


def check_length(what: str, value: bytes, length: int) -> None:
    """Refuse with RecordError what is not exactly ``length`` bytes."""
    if type(value) is not bytes or len(value) != length:
        got = f"{len(value)} bytes" if isinstance(value, bytes) else type(value).__name__
        raise RecordError(f"{what}: expected {length} bytes, got {got}")


def check_payload(payload: bytes) -> None:
    """Refuse a payload that is not bytes (RecordError) or is too large (TooLargeError)."""
    if type(payload) is not bytes:
        raise RecordError(f"payload: expected bytes, got {type(payload).__name__}")
    if len(payload) > MAX_PAYLOAD_BYTES:
        raise _too_large("payload", len(payload), MAX_PAYLOAD_BYTES)


def _too_large(what: str, size: int, limit: int) -> TooLargeError:
    return TooLargeError(f"expected a {what} of at most {limit} bytes, got {size} bytes")


def _encode_field(value: Field) -> bytes:
    kind = type(value)
    if isinstance(value, bytes) and kind is bytes:
        tag, body = b"b", value
    elif isinstance(value, str) and kind is str:
        try:
            tag, body = b"s", value.encode()
        except UnicodeEncodeError as error:
            raise EncodingError(f"text that is not Unicode has no encoding: {error}") from None
    elif isinstance(value, int) and kind is int:
        if not 0 <= value <= MAX_INTEGER:
            raise EncodingError(f"expected an integer from 0 to 2**63 - 1, got {value}")
        tag, body = b"i", value.to_bytes(8, "big")
    elif isinstance(value, tuple) and kind is tuple:
        tag, body = b"t", b"".join(map(_encode_field, value))
    else:
        raise EncodingError(f"expected int, str, bytes or tuple, got {kind.__name__}")
    return tag + len(body).to_bytes(4, "big") + body


def _decode_fields(data: bytes, depth: int) -> tuple[Any, ...]:
    if depth > _MAX_DEPTH:
        raise EncodingError(f"expected tuples nested at most {_MAX_DEPTH} deep")
    fields: list[Field] = []
    position = 0
    while position < len(data):
        start = position + _HEAD_BYTES
        end = start + int.from_bytes(data[position + 1 : start], "big")
        if start > len(data) or end > len(data):
            raise EncodingError(f"expected a whole field at byte {position}, got a truncated one")
        fields.append(_decode_field(data[position], data[start:end], position, depth))
        position = end
    return tuple(fields)


def _decode_field(tag: int, body: bytes, position: int, depth: int) -> Field:
    if tag == ord("b"):
        return body
    if tag == ord("s"):
        try:
            return body.decode()
        except UnicodeDecodeError:
            raise EncodingError(f"expected UTF-8 text at byte {position}") from None
    if tag == ord("i"):
        if len(body) != 8 or body[0] > 127:
            raise EncodingError(f"expected an integer of 8 bytes below 2**63 at byte {position}")
        return int.from_bytes(body, "big")
    if tag == ord("t"):
        return _decode_fields(body, depth + 1)
    raise EncodingError(f"expected a tag b, s, i or t at byte {position}, got byte {tag}")

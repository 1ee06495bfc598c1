"""Which values the fields of records may have. A record's class declares them by annotations.

``Annotated[int, Checked("height", check_integer)]`` is a field that errors call "height" and that
``check_integer`` judges whenever a record is made or read.
"""

import re
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Annotated, Any, NamedTuple, TypeAlias

from vrchain.ledger.errors import RecordError
from vrchain.ledger.records.encoding import DIGEST_BYTES, MAX_INTEGER

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")


class Checked(NamedTuple):
    """What a field is called in errors, and what refuses its bad values by a RecordError."""

    what: str
    check: Callable[[str, Any], None]


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


def check_digest(what: str, value: bytes) -> None:
    """Refuse with RecordError what is not a digest's 32 bytes."""
    check_length(what, value, DIGEST_BYTES)


def check_sorted(what: str, values: Sequence[Any]) -> None:
    """Refuse with RecordError what is not sorted, or holds a value twice."""
    if any(first >= second for first, second in pairwise(values)):
        raise RecordError(f"{what}: expected them sorted, each once, got {values!r:.200}")


LedgerId: TypeAlias = Annotated[bytes, Checked("ledger id", check_digest)]
SequenceNumber: TypeAlias = Annotated[int, Checked("sequence", check_integer)]
Timestamp: TypeAlias = Annotated[int, Checked("timestamp_ns", check_integer)]

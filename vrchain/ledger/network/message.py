"""What travels between machines: a block with its records and blobs, or an offer.

Each is one message of canonical bytes, so that what it brings is judged without asking back.
"""

from collections.abc import Mapping
from typing import Any

from vrchain.ledger.errors import EncodingError
from vrchain.ledger.records.block import Block, Entry, decode_record
from vrchain.ledger.records.encoding import (
    check_kinds,
    decode_fields,
    digest,
    encode_fields,
    too_large,
)
from vrchain.ledger.records.transaction import Offer

MAX_MESSAGE_BYTES = 8_000_000  # servers take 8 MiB, headers included
_ENTRY, _OFFER = "vrchain/2/message/entry", "vrchain/2/message/offer"
_HEAD = "vrchain/2/message/head"


def pack_entry(entry: Entry, blobs: Mapping[bytes, bytes]) -> bytes:
    """The message of a block. ``blobs``: see ``Ledger.take``. TooLargeError."""
    records = tuple([record.record for record in entry.records])
    return _bounded(_ENTRY, entry.block.record, records, tuple(blobs.values()))


def unpack_entry(data: bytes) -> tuple[Entry, dict[bytes, bytes]]:
    """The block, its records, and the blobs by digest. EncodingError, RecordError."""
    block, records, blobs = _fields(data, _ENTRY, bytes, tuple, tuple)
    check_kinds("blobs", blobs, *[bytes] * len(blobs))
    entry = Entry(Block.decode(block), tuple([decode_record(record) for record in records]))
    return entry, {digest(blob): blob for blob in blobs}


def pack_offer(offer: Offer) -> bytes:
    """The message of an offer. TooLargeError over MAX_MESSAGE_BYTES."""
    blobs = (offer.payload,) if offer.landmarks is None else (offer.payload, offer.landmarks)
    return _bounded(_OFFER, offer.transaction.record, blobs)


def unpack_offer(data: bytes) -> tuple[bytes, ...]:
    """The transaction's canonical bytes, the payload, and landmarks if any: not judged yet.

    Raises EncodingError.
    """
    record, blobs = _fields(data, _OFFER, bytes, tuple)
    check_kinds("blobs", blobs, *[bytes] * min(max(len(blobs), 1), 2))
    return record, *blobs


def pack_head(block: Block, waiting: int) -> bytes:
    """What a robot says of itself: its newest block, which a member signed, and its outbox."""
    return encode_fields(_HEAD, block.record, waiting)


def unpack_head(data: bytes) -> tuple[Block, int]:
    """The block, and how many transactions wait. EncodingError, RecordError."""
    block, waiting = _fields(data, _HEAD, bytes, int)
    return Block.decode(block), waiting


def _bounded(domain: str, *fields: Any) -> bytes:
    data = encode_fields(domain, *fields)
    if len(data) > MAX_MESSAGE_BYTES:
        raise too_large("message", len(data), MAX_MESSAGE_BYTES)
    return data


def _fields(data: bytes, domain: str, *kinds: type) -> tuple[Any, ...]:
    found, *fields = decode_fields(data) or ("",)
    if found != domain:
        raise EncodingError(f"expected a message of {domain!r}, got {found!r:.80}")
    return check_kinds("message", tuple(fields), *kinds)

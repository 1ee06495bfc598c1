"""Blocks and records as JSON objects, digests in hexadecimal; payloads and keys stay behind."""

from typing import Any

from vrchain.ledger.records.block import Entry, Record
from vrchain.ledger.records.encoding import NO_DIGEST
from vrchain.ledger.records.keys import PublicKey
from vrchain.ledger.records.membership import Drop, Enrolment, Expulsion, Genesis
from vrchain.ledger.records.transaction import Transaction


def entry_json(entry: Entry) -> dict[str, Any]:
    """One block with its records."""
    block = entry.block
    return {
        "height": block.height,
        "hash": block.hash.hex(),
        "previous_hash": block.previous_hash.hex(),
        "timestamp_ns": block.timestamp_ns,
        "author": block.author,
        "newest_root": block.newest_root.hex(),
        "newest": {robot: _hex(transaction_id) for robot, transaction_id in block.newest},
        "records_root": block.records_root.hex(),
        "records": [record_json(record) for record in entry.records],
        "signature": block.signature.hex(),
    }


def record_json(record: Record) -> dict[str, Any]:
    """A record of any kind, told apart by ``kind``."""
    kind, fields = _kind(record)
    return {
        "kind": kind,
        "id": record.id.hex(),
        "timestamp_ns": record.timestamp_ns,
        **fields,
        "signature": record.signature.hex(),
    }


def _kind(record: Record) -> tuple[str, dict[str, Any]]:
    match record:
        case Transaction():
            return "transaction", {
                "robot": record.robot,
                "sequence": record.sequence,
                "reason": record.reason,
                "payload_digest": record.payload_digest.hex(),
                "landmarks_digest": _hex(record.landmarks_digest),
                "previous": _hex(record.previous),
            }
        case Enrolment():
            key = _key(record.public_key)
            return "enrolment", {"sequence": record.sequence, "name": record.name, **key}
        case Expulsion():
            return "expulsion", {"sequence": record.sequence, "name": record.name}
        case Drop():
            blobs = [blob.hex() for blob in record.blobs]
            return "drop", {"sequence": record.sequence, "blobs": blobs}
        case Genesis():
            return "genesis", _genesis(record)


def _hex(value: bytes) -> str | None:
    """Hexadecimal digits; None for the zeros that stand for nothing."""
    return None if value == NO_DIGEST else value.hex()


def _genesis(record: Genesis) -> dict[str, Any]:
    return {
        "name": record.name,
        "salt": record.salt.hex(),
        "operator": _key(record.operator),
        "members": {name: _key(key) for name, key in record.members},
    }


def _key(key: PublicKey) -> dict[str, Any]:
    return {"public_key": key.raw.hex(), "insecure": key.insecure}

"""Blocks and records as JSON objects, digests in hexadecimal; payloads and keys stay behind."""

from typing import Any

from vrchain.ledger.records.block import Entry, Record
from vrchain.ledger.records.encoding import NO_DIGEST
from vrchain.ledger.records.keys import PublicKey
from vrchain.ledger.records.membership import Enrolment, Genesis


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
    return {
        "kind": type(record).__name__.lower(),
        "id": record.id.hex(),
        "timestamp_ns": record.timestamp_ns,
        **(_genesis(record) if isinstance(record, Genesis) else _fields(record)),
        "signature": record.signature.hex(),
    }


def _fields(record: Record) -> dict[str, Any]:
    names = [name for name in record.field_names if name not in ("ledger_id", "timestamp_ns")]
    found = {name: _plain(getattr(record, name)) for name in names}
    return found | (_key(record.public_key) if isinstance(record, Enrolment) else {})


def _plain(value: Any) -> Any:
    match value:
        case bytes():
            return _hex(value)
        case tuple():
            return [blob.hex() for blob in value]
        case _:
            return value


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

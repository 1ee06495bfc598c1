"""Blocks and records as JSON objects, digests in hexadecimal; payloads and keys stay behind."""

from typing import Any

from vrchain.ledger.block import NO_TRANSACTION, Entry, Record
from vrchain.ledger.keys import PublicKey
from vrchain.ledger.membership import Enrolment, Genesis
from vrchain.ledger.transaction import Transaction


def entry_json(entry: Entry) -> dict[str, Any]:
    """One block with its records."""
    block = entry.block
    return {
        "height": block.height,
        "hash": block.hash.hex(),
        "previous_hash": block.previous_hash.hex(),
        "timestamp_ns": block.timestamp_ns,
        "author": block.author,
        "newest": {
            robot: None if transaction_id == NO_TRANSACTION else transaction_id.hex()
            for robot, transaction_id in block.newest
        },
        "records": [record_json(record) for record in entry.records],
        "signature": block.signature.hex(),
    }


def record_json(record: Record) -> dict[str, Any]:
    """A genesis record, enrolment or transaction, told apart by ``kind``."""
    common = {"id": record.id.hex(), "timestamp_ns": record.timestamp_ns}
    signature = {"signature": record.signature.hex()}
    if isinstance(record, Transaction):
        fields: dict[str, Any] = {
            "robot": record.robot,
            "sequence": record.sequence,
            "reason": record.reason,
            "payload_digest": record.payload_digest.hex(),
        }
        return {"kind": "transaction", **common, **fields, **signature}
    if isinstance(record, Enrolment):
        fields = {"sequence": record.sequence, "name": record.name, **_key(record.public_key)}
        return {"kind": "enrolment", **common, **fields, **signature}
    return {"kind": "genesis", **common, **_genesis(record), **signature}


def _genesis(record: Genesis) -> dict[str, Any]:
    return {
        "name": record.name,
        "salt": record.salt.hex(),
        "operator": _key(record.operator),
        "members": {name: _key(key) for name, key in record.members},
    }


def _key(key: PublicKey) -> dict[str, Any]:
    return {"public_key": key.raw.hex(), "insecure": key.insecure}

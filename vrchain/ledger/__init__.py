"""An append-only ledger of signed transactions. It knows nothing of vision.

    with Ledger.create(folder, {"R1": key.public}, operator) as ledger:
        transaction = ledger.publish("R1", key, payload, "distance", timestamp_ns)
        ledger.payload(transaction.payload_digest) == payload

A payload is bytes and their SHA-256; docs/reference/ledger-format.md says how everything is stored.

- ``store``, ``reader``: ``Ledger``, one process's handle on a folder: what it writes and reads.
- ``records/``: what is signed and hashed. ``block`` (what a block's hash covers), ``transaction``,
  ``membership`` (the operator's), ``proof``; ``record``, ``fields``, ``encoding`` (their bytes),
  ``table`` and ``merkle`` (the two roots in a block), ``keys``.
- ``rules/``: what is taken in. ``validity`` refuses for ever and everywhere, ``chain`` applies it
  to the newest state; ``admission`` and ``limits`` refuse here and now.
- ``storage/``: how it lies on the disk. ``database`` (SQLite rows), ``blobs`` and ``durable``
  (files), ``resume`` (the state from the rows), ``retention`` (what may go), ``turns`` (writers
  queue up), ``place`` (nobody swaps the files), ``folder`` (a new one).
- ``verify``: everything stored judged again. ``export``: as JSON. ``errors``: each refusal's kind.
- ``network/``: ``log`` orders blocks for several folders, ``stream`` is one on NATS servers
  (``connection``); ``replicated`` is a folder that follows one, ``robot`` one that offers what it
  publishes (``outbox``), ``maker`` makes blocks of offers, ``message`` is what travels;
  ``opening``: ``open_ledger``.
- ``cluster/``: servers on this machine, and the configuration of others.
"""

from vrchain.ledger.records.block import Block, Entry
from vrchain.ledger.records.keys import (
    PublicKey,
    SigningKey,
    load_key,
    random_key,
    save_key,
    simulated_key,
)
from vrchain.ledger.records.membership import OPERATOR, Drop, Enrolment, Expulsion, Genesis
from vrchain.ledger.records.proof import Proof, verify_proof
from vrchain.ledger.records.transaction import NO_BLOB, REASONS, Offer, Transaction
from vrchain.ledger.rules.admission import Admission
from vrchain.ledger.rules.chain import Chain
from vrchain.ledger.rules.limits import Limits
from vrchain.ledger.store import Ledger
from vrchain.ledger.verify import Verification, verify

__all__ = [
    "NO_BLOB",
    "OPERATOR",
    "REASONS",
    "Admission",
    "Block",
    "Chain",
    "Drop",
    "Enrolment",
    "Entry",
    "Expulsion",
    "Genesis",
    "Ledger",
    "Limits",
    "Offer",
    "Proof",
    "PublicKey",
    "SigningKey",
    "Transaction",
    "Verification",
    "load_key",
    "random_key",
    "save_key",
    "simulated_key",
    "verify",
    "verify_proof",
]

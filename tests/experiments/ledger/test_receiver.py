"""The other robot's process keeps a replica of its own and takes nothing on trust."""

import os
import signal
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from ledgers import KEYS, OPERATOR_KEY, new_chain, new_ledger, next_entry

from vrchain.errors import LedgerError
from vrchain.experiments.ledger.receiver import Receiver, accept
from vrchain.ledger import Chain, Ledger, errors
from vrchain.ledger.network.message import pack_entry
from vrchain.ledger.records.block import Entry, records_root
from vrchain.ledger.records.encoding import digest
from vrchain.ledger.records.table import Table


@pytest.fixture
def pair(tmp_path: Path) -> Iterator[tuple[Ledger, Receiver]]:
    with new_ledger(tmp_path / "ledger") as ledger, Receiver(ledger.entry(0)) as receiver:
        yield ledger, receiver


def blobs(*payloads: bytes) -> dict[bytes, bytes]:
    return {digest(payload): payload for payload in payloads}


def test_it_follows_and_answers_with_its_head(pair: tuple[Ledger, Receiver]) -> None:
    ledger, receiver = pair
    for time_ns, payload in enumerate([b"", b"x", os.urandom(500_000)]):
        transaction = ledger.publish("R1", KEYS["R1"], payload, "view", time_ns)
        assert receiver.send(Entry(ledger.head, (transaction,)), blobs(payload)) == ledger.head.hash
    ledger.publish("R1", KEYS["R1"], b"", "view", 3, landmarks=b"seen")
    newest = ledger.entry(ledger.head.height)
    assert receiver.send(newest, ledger.blobs_of(newest)) == ledger.head.hash
    ledger.enrol("R3", KEYS["R3"].public, OPERATOR_KEY, 3)
    assert receiver.send(ledger.entry(ledger.head.height), {}) == ledger.head.hash


def test_it_refuses_and_says_why(pair: tuple[Ledger, Receiver]) -> None:
    ledger, receiver = pair
    transaction = ledger.publish("R2", KEYS["R2"], b"payload", "view", 10)
    block, given = ledger.head, blobs(b"payload")
    forged = replace(transaction, timestamp_ns=9).signed(KEYS["R1"])
    newest = Table(dict(block.newest) | {"R2": forged.id}).root
    forged_block = replace(block, records_root=records_root((forged,)), newest_root=newest)
    forged_block = forged_block.signed(KEYS["R2"])
    for entry, sent, said in [
        (Entry(block, (transaction,)), blobs(b"another"), "PayloadDigestError"),
        (Entry(block, (transaction,)), {}, "PayloadDigestError"),
        (Entry(replace(block, timestamp_ns=11), (transaction,)), given, "SignatureError"),
        (Entry(forged_block, (forged,)), given, "SignatureError.*signature by R2"),
    ]:
        with pytest.raises(LedgerError, match=f"refused: {said}"):
            receiver.send(entry, sent)
    assert receiver.send(Entry(block, (transaction,)), given) == block.hash
    with pytest.raises(LedgerError, match="BrokenLinkError"):
        receiver.send(Entry(block, (transaction,)), given)


def test_a_refused_message_leaves_the_replica_as_before() -> None:
    chain = new_chain()
    replica = Chain(Entry(chain.head, (chain.genesis,)))
    entry = next_entry(chain)
    unsigned = Entry(replace(entry.block, signature=bytes(64)), entry.records)
    with pytest.raises(errors.SignatureError):
        accept(replica, pack_entry(unsigned, {}))
    with pytest.raises(errors.PayloadDigestError, match="not those"):
        accept(replica, pack_entry(entry, blobs(b"another")))
    assert replica.head == chain.head


def test_a_child_that_dies_is_an_error_and_not_a_hang() -> None:
    chain = new_chain()
    receiver = Receiver(Entry(chain.head, (chain.genesis,)))
    receiver._process.send_signal(signal.SIGKILL)
    receiver._process.wait()
    with pytest.raises(LedgerError, match="does not answer"):
        receiver.send(next_entry(chain), {})
    receiver.close()
    receiver.close()


def test_leaving_ends_the_child() -> None:
    chain = new_chain()
    with Receiver(Entry(chain.head, (chain.genesis,))) as receiver:
        assert receiver._process.poll() is None
    assert receiver._process.returncode == 0
    with pytest.raises(LedgerError, match="refused"):
        Receiver(next_entry(chain))  # no first block

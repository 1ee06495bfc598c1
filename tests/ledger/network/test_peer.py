"""The other robot's process keeps a replica of its own and takes nothing on trust."""

import os
import signal
from collections.abc import Iterator
from dataclasses import replace
from typing import Any
from unittest.mock import patch

import pytest
from ledgers import KEYS, OPERATOR_KEY, new_chain, new_ledger, next_entry

from vrchain.ledger import Chain, Ledger, errors
from vrchain.ledger.network import peer as peer_module
from vrchain.ledger.network.peer import MAX_FRAMES, MAX_MESSAGE_BYTES, PeerProcess, accept
from vrchain.ledger.network.wire import receive, send
from vrchain.ledger.records.block import Entry, records_root
from vrchain.ledger.records.table import Table


@pytest.fixture(scope="module")
def pair(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Ledger, PeerProcess]]:
    """A ledger and a peer that has all of it; each test leaves them alike."""
    with (
        new_ledger(tmp_path_factory.mktemp("peer") / "ledger") as ledger,
        PeerProcess(ledger.entry(0)) as peer,
    ):
        # tests may run in any order and number: each finds a peer that has followed so far
        first = ledger.publish("R1", KEYS["R1"], b"first", "view", 0)
        peer.send(ledger.head, (first,), b"first")
        yield ledger, peer


def genesis_of(chain: Chain) -> Entry:
    return Entry(chain.head, (chain.genesis,))


def test_the_peer_follows_and_answers_with_its_head(pair: tuple[Ledger, PeerProcess]) -> None:
    ledger, peer = pair
    for time_ns, payload in enumerate([b"", b"x", os.urandom(500_000)]):
        transaction = ledger.publish("R1", KEYS["R1"], payload, "view", time_ns)
        assert peer.send(ledger.head, (transaction,), payload) == ledger.head.hash
    transaction = ledger.publish("R1", KEYS["R1"], b"", "view", 3, landmarks=b"seen")
    assert peer.send(ledger.head, (transaction,), b"", b"seen") == ledger.head.hash
    ledger.enrol("R3", KEYS["R3"].public, OPERATOR_KEY, 3)
    assert peer.send(*ledger.entry(ledger.head.height)) == ledger.head.hash


def test_the_peer_refuses_and_says_why(pair: tuple[Ledger, PeerProcess]) -> None:
    ledger, peer = pair
    transaction = ledger.publish("R2", KEYS["R2"], b"payload", "view", 10)
    block = ledger.head
    forged = replace(transaction, timestamp_ns=9).signed(KEYS["R1"])
    newest = Table(dict(block.newest) | {"R2": forged.id}).root
    forged_block = replace(block, records_root=records_root((forged,)), newest_root=newest)
    forged_block = forged_block.signed(KEYS["R2"])
    messages: list[tuple[tuple[Any, ...], str]] = [
        ((block, (transaction,), b"another"), "PayloadDigestError"),
        ((block, (transaction,)), "PayloadDigestError"),
        ((replace(block, timestamp_ns=11), (transaction,), b"payload"), "SignatureError"),
        ((forged_block, (forged,), b"payload"), "SignatureError.*signature by R2"),
        ((ledger.entry(1).block, ledger.entry(1).records, b""), "BrokenLinkError"),
    ]
    for refused, said in messages:
        with pytest.raises(errors.PeerRefusedError, match=said):
            peer.send(*refused)
    assert peer.send(block, (transaction,), b"payload") == block.hash
    with pytest.raises(errors.PeerRefusedError, match="BrokenLinkError"):
        peer.send(block, (transaction,), b"payload")


def test_bytes_that_are_no_block_are_refused(pair: tuple[Ledger, PeerProcess]) -> None:
    _, peer = pair
    for frames in ([], [b""], [b"garbage", b"more"], [b"garbage", b"more", b""]):
        send(peer._socket, frames)
        assert receive(peer._socket, 1, 1 << 16)[0].startswith(b"!EncodingError")


def test_too_many_frames_end_the_peer_and_the_sender_is_told() -> None:
    chain = new_chain()
    with PeerProcess(genesis_of(chain)) as peer:
        peer._socket.sendall((MAX_FRAMES + 1).to_bytes(4, "big"))
        peer._process.wait(timeout=20)
        with pytest.raises(errors.PeerError, match="peer process"):
            peer.send(*next_entry(chain), b"")


def test_a_message_that_is_too_large_is_passed_over(pair: tuple[Ledger, PeerProcess]) -> None:
    ledger, peer = pair
    part = bytes(1 << 20)
    count = MAX_MESSAGE_BYTES // len(part) + 1
    peer._socket.sendall(b"\0\0\0\1" + (count * len(part)).to_bytes(4, "big"))
    for _ in range(count):
        peer._socket.sendall(part)
    assert receive(peer._socket, 1, 1 << 16)[0].startswith(b"!TooLargeError")
    transaction = ledger.publish("R1", KEYS["R1"], b"after", "view", 100)
    assert peer.send(ledger.head, (transaction,), b"after") == ledger.head.hash


def test_a_refused_message_costs_no_hashing_and_leaves_the_replica_as_before() -> None:
    chain = new_chain()
    replica = Chain(genesis_of(chain))
    block, (record,) = next_entry(chain)
    forged = replace(block, signature=bytes(64)).record
    with patch.object(peer_module, "digest", side_effect=AssertionError("hashed")):
        with pytest.raises(errors.SignatureError):
            accept(replica, [forged, record.record, b"", bytes(1000)])
        with pytest.raises(errors.PayloadDigestError, match="expected 1 blobs"):
            accept(replica, [block.record, record.record, b""])
    with pytest.raises(errors.PayloadDigestError, match="not those"):
        accept(replica, [block.record, record.record, b"", b"another"])
    assert replica.head == chain.head


def test_a_peer_that_dies_is_an_error_and_not_a_hang() -> None:
    chain = new_chain()
    peer = PeerProcess(genesis_of(chain))
    peer._process.send_signal(signal.SIGKILL)
    peer._process.wait()
    with pytest.raises(errors.PeerError, match="peer process"):
        peer.send(*next_entry(chain), b"")
    peer.close()
    peer.close()


def test_leaving_ends_the_child() -> None:
    chain = new_chain()
    with PeerProcess(genesis_of(chain)) as peer:
        assert peer._process.poll() is None
    assert peer._process.returncode == 0
    with pytest.raises(errors.PeerRefusedError, match="PayloadDigestError"):
        PeerProcess(next_entry(chain))  # without its blob, and no first block either

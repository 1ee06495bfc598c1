"""Attacks on the gate: each refused by its kind, charged to its connection, starving nobody."""

import socket
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import pytest
from ledgers import KEYS, OPERATOR_KEY, new_ledger

from vrchain.ledger import Ledger, Limits, Transaction, errors, verify
from vrchain.ledger.network.gate import MAX_FRAMES, Answer, Gate, answer_of, receive_answer
from vrchain.ledger.network.wire import pack

SECOND = 1_000_000_000
NOW_NS = 1000 * SECOND
AT_ONCE = Limits(block_delay_ns=0)
Connect = Callable[[], socket.socket]


class Rig:
    """A gate at a socket, by R2, and senders that connect to it. All in one thread: take turns."""

    def __init__(self, folder: Path, limits: Limits) -> None:
        self.ledger = new_ledger(folder / "ledger")
        self._address = str(folder / "gate")
        self._listener = socket.socket(socket.AF_UNIX)
        self._listener.bind(self._address)
        self._listener.listen()
        self.now_ns = NOW_NS
        self.gate = Gate(self._listener, self.ledger, "R2", KEYS["R2"], lambda: self.now_ns, limits)
        self._senders: list[socket.socket] = []

    def connect(self) -> socket.socket:
        sender = socket.socket(socket.AF_UNIX)
        sender.settimeout(5)
        sender.connect(self._address)
        self._senders.append(sender)
        self.gate.turn(0)  # which lets it in
        return sender

    def turns(self, number: int = 20) -> None:
        for _ in range(number):
            self.gate.turn(0)

    def serves(self, sender: socket.socket) -> bool:
        """Whether R1's next transaction is admitted when it comes by this connection."""
        return self.ask(sender, self.next_of().record, b"payload").reason == ""

    def ask(self, sender: socket.socket, *frames: bytes) -> Answer:
        """Send a message that fits into the socket and take turns; the answer."""
        sender.sendall(pack(frames))
        self.turns(3)
        return receive_answer(sender)

    def next_of(self, robot: str = "R1", **changes: object) -> Transaction:
        draft = self.ledger.draft_transaction(robot, b"payload", "view", NOW_NS)
        return replace(draft, **changes).signed(KEYS[robot])

    def close(self) -> None:
        self.gate.close()
        for opened in (*self._senders, self._listener):
            opened.close()
        self.ledger.close()


Start = Callable[..., Rig]


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Start]:
    rigs: list[Rig] = []

    def started(**limits: float) -> Rig:
        rigs.append(Rig(tmp_path, replace(AT_ONCE, **limits)))
        return rigs[-1]

    yield started
    for rig in rigs:
        rig.close()


def is_silent(sender: socket.socket) -> bool:
    """Whether there is no answer (yet)."""
    sender.setblocking(False)
    try:
        return sender.recv(1, socket.MSG_PEEK) == b"never"
    except BlockingIOError:
        return True
    finally:
        sender.settimeout(5)


def test_what_comes_is_durable_when_it_is_answered(start: Start) -> None:
    rig = start()
    sender = rig.connect()
    for number, frames in enumerate([(b"payload",), (b"payload", b"landmarks")]):
        draft = rig.ledger.draft_transaction("R1", frames[0], "view", NOW_NS, *frames[1:])
        sent = draft.signed(KEYS["R1"])
        answer = rig.ask(sender, sent.record, *frames)
        with Ledger.open(rig.ledger.folder) as other:
            assert other.latest("R1") == sent
            assert answer == (sent.id, other.head.hash, "")
            assert other.head.height == number + 1
    assert verify(rig.ledger.folder).ok


def test_transactions_of_one_round_share_a_block(start: Start) -> None:
    rig = start()
    sent = {rig.connect(): rig.next_of(robot) for robot in ("R1", "R2")}
    for sender, transaction in sent.items():
        sender.sendall(pack([transaction.record, b"payload"]))
    rig.turns(2)
    assert {receive_answer(sender).block_hash for sender in sent} == {rig.ledger.head.hash}
    assert rig.ledger.head.height == 1


def test_a_block_is_made_in_time_though_nothing_more_comes(start: Start) -> None:
    rig = start(block_delay_ns=SECOND)
    sender = rig.connect()
    sender.sendall(pack([rig.next_of().record, b"payload"]))
    rig.turns()
    assert is_silent(sender)
    rig.now_ns += SECOND
    rig.gate.turn(5.0)  # which does not wait
    assert receive_answer(sender).reason == ""


@pytest.mark.parametrize(
    ("frames", "kind"),
    [
        ([], "EncodingError"),
        ([b"alone"], "EncodingError"),
        ([b"garbage", b"payload"], "EncodingError"),
        ([bytes(3000), b"payload"], "InputLimitError"),
        ([b"", bytes(20_001)], "InputLimitError"),
        ([b"", bytes(15_000), bytes(10_000)], "InputLimitError"),
    ],
)
def test_what_is_no_transaction_or_too_large_is_refused(
    frames: list[bytes], kind: str, start: Start
) -> None:
    rig = start(blob_bytes=20_000)
    sender = rig.connect()
    assert rig.ask(sender, *frames).kind == kind
    assert rig.gate.counts == {kind: 1}
    rig.turns()
    assert rig.gate.counts == {kind: 1}


def test_too_many_frames_end_the_connection(start: Start) -> None:
    rig = start()
    sender = rig.connect()
    sender.sendall((MAX_FRAMES + 1).to_bytes(4, "big"))
    rig.turns(2)
    with pytest.raises(errors.PeerError, match="ended the connection"):
        receive_answer(sender)


def test_an_oversized_message_is_passed_over_and_not_kept(start: Start) -> None:
    rig = start(sender_burst_bytes=1 << 30, sender_bytes_per_s=1e12, sender_messages_per_s=1e6)
    sender = rig.connect()
    sender.sendall(b"\0\0\0\2" + (1 << 25).to_bytes(4, "big"))
    for _ in range(1 << 9):
        sender.sendall(bytes(1 << 16))
        rig.gate.turn(0)
        (caller,) = rig.gate._senders.values()
        assert len(caller.reader._part) <= 1 << 16
    sender.sendall(b"\0\0\0\1x")
    rig.turns(2)
    answer = receive_answer(sender)
    assert (answer.transaction_id, answer.kind) == (bytes(32), "InputLimitError")
    assert rig.serves(sender)  # it can go on


def test_a_forgery_in_anothers_name_is_charged_to_its_connection(start: Start) -> None:
    """A thousand forged transactions of R1 cost R1 nothing, and their sender its turn."""
    rig = start(burst=1, rate_per_s=1e-9)
    honest, forger = rig.connect(), rig.connect()
    forged = replace(rig.next_of(), signature=bytes(64))
    forger.setblocking(False)
    with pytest.raises(BlockingIOError):
        for _ in range(100_000):
            forger.send(pack([forged.record, b"payload"]))
    rig.turns(1000)
    assert 1 <= rig.gate.counts["SignatureError"] <= 5  # the rest is not listened to
    assert rig.serves(honest)
    answer = rig.ask(honest, rig.next_of().record, b"payload")
    assert answer.kind == "RateLimitError"


def test_bytes_are_charged_though_no_message_is_ever_whole(start: Start) -> None:
    rig = start(sender_bytes_per_s=1.0, blob_bytes=100_000, record_bytes=1000)
    sender = rig.connect()
    sender.setblocking(False)
    sender.sendall(b"\0\0\0\2" + b"\xff" * 4)
    taken = 0
    for _ in range(100):
        try:
            taken += sender.send(bytes(10_000))
        except BlockingIOError:
            rig.gate.turn(0)
    assert taken < 101_000 + 262_144 + 300_000  # its bucket, one turn, and what the socket holds


def test_what_is_admitted_costs_its_sender_nothing(start: Start) -> None:
    rig = start(sender_messages_per_s=1e-9, sender_bytes_per_s=1e-9, blob_bytes=1000, burst=100)
    sender = rig.connect()
    for _ in range(30):
        assert rig.serves(sender)
    assert rig.ask(sender, b"garbage", b"payload").kind == "EncodingError"
    sender.sendall(pack([rig.next_of().record, b"payload"]))  # it has used up its one message
    rig.turns()
    assert is_silent(sender)


def test_a_sender_that_comes_anew_each_time_gains_nothing(start: Start) -> None:
    rig = start(arrivals_per_s=1e-9, arrivals_burst=5)
    for _ in range(10):
        with rig.connect() as sender:
            sender.sendall(pack([b"garbage", b"x"]))
    rig.turns()
    assert rig.gate.counts == {"EncodingError": 5}  # one message each, and no more arrivals


def test_idle_connections_do_not_keep_others_out(start: Start) -> None:
    rig = start(senders=3, arrivals_per_s=1e9)
    honest = rig.connect()
    assert rig.serves(honest)
    idle = [rig.connect() for _ in range(5)]
    newcomer = rig.connect()
    assert rig.serves(newcomer)
    assert rig.serves(honest)
    assert [sender.recv(1) for sender in idle[:4]] == [b""] * 4


def test_the_one_place_is_an_idle_ones_until_another_comes(start: Start) -> None:
    """But one that has brought something stays, and the newcomer goes."""
    rig = start(senders=1, arrivals_per_s=1e9)
    first, honest = rig.connect(), rig.connect()
    assert first.recv(1) == b""
    assert rig.serves(honest)
    assert rig.connect().recv(1) == b""
    assert rig.serves(honest)


def test_a_sender_that_reads_no_answers_is_not_listened_to(start: Start) -> None:
    rig = start(sender_messages_per_s=1e9, sender_burst=1 << 30)
    deaf, honest = rig.connect(), rig.connect()
    deaf.setblocking(False)
    message = pack([b"garbage", b"x"])
    before = -1
    while rig.gate.counts["EncodingError"] > before:
        before = rig.gate.counts["EncodingError"]
        with pytest.raises(BlockingIOError):
            for _ in range(100_000):
                deaf.send(message)
        rig.turns(100)
    caller = next(iter(rig.gate._senders.values()))
    assert 0 < len(caller.unsent) < 1000
    assert rig.serves(honest)


def test_a_message_that_never_ends_ends_its_connection(start: Start) -> None:
    rig = start(message_ns=1)
    slow = rig.connect()
    slow.sendall(b"\0\0")
    rig.turns(3)
    assert slow.recv(1) == b""


def test_one_turn_hears_one_message_of_each(start: Start) -> None:
    """Ten at once by one sender, one by another: both have their first in the same round."""
    rig = start(sender_messages_per_s=1e9)
    pushy, honest = rig.connect(), rig.connect()
    pushy.sendall(pack([b"garbage", b"x"]) * 10)
    honest.sendall(pack([rig.next_of().record, b"payload"]))
    rig.gate.turn(0)
    assert rig.gate.counts == {"EncodingError": 1, "admitted": 1}


def test_a_sender_that_leaves_does_not_take_its_transaction_with_it(start: Start) -> None:
    rig = start()
    sender, other = rig.connect(), rig.connect()
    sender.sendall(pack([rig.next_of().record, b"payload"]))
    sender.close()
    rig.turns(3)
    assert rig.ledger.head.height == 1
    assert rig.serves(other)


def test_who_is_expelled_by_another_process_is_refused(start: Start) -> None:
    rig = start()
    sender, transaction = rig.connect(), rig.next_of()
    with Ledger.open(rig.ledger.folder, writable=True) as other:
        other.expel("R1", OPERATOR_KEY, 1)
    assert rig.ask(sender, transaction.record, b"payload").kind == "ExpelledMemberError"


def test_a_disk_that_fails_is_the_senders_news_and_not_the_gates_end(start: Start) -> None:
    rig = start()
    sender, transaction = rig.connect(), rig.next_of()
    with patch.object(Ledger, "append_many", side_effect=errors.StorageFullError("no room")):
        assert rig.ask(sender, transaction.record, b"payload").kind == "StorageFullError"
    assert rig.ask(sender, transaction.record, b"payload").reason == ""


@pytest.mark.parametrize("frames", [[], [b"="], [b"?", bytes(32)], [b"", b""], [b"=", b"", b""]])
def test_what_is_no_answer_is_refused(frames: list[bytes]) -> None:
    with pytest.raises(errors.WireError):
        answer_of(frames)

"""A robot takes in others' transactions over sockets and makes blocks of them; floods do no harm.

A message is a transaction's canonical bytes, its panorama, and its landmark record if it names
one: two or three frames, see ``wire``. Each is answered by a message of two: ``=`` and the hash of
the block that it is in, durably, or ``!`` and why it is refused; and the transaction's id (zeros
where no transaction could be read). Answers may come in another order.

Who a sender is, nobody has proved: it is a connection, and what came by it is charged to it,
whatever robot's name it carries. Four things keep one sender from crowding out the others:

- In a round each sender hands over some bytes and at most one message: they take turns.
- Messages and bytes empty the sender's own buckets until they are admitted; what is admitted is
  given back, and the robot pays that signed it. While a bucket is empty its sender is not listened
  to: it waits in its own ``send``, at no cost here.
- A message larger than is taken is passed over as it comes, and not kept.
- A sender that does not read its answers, or does not end its message, is not listened to either.
"""

import contextlib
import selectors
import socket
import time
from collections import Counter
from collections.abc import Callable
from typing import NamedTuple

from vrchain.errors import LedgerError
from vrchain.ledger.errors import EncodingError, InputLimitError, PeerError, WireError
from vrchain.ledger.network.wire import Reader, pack, receive
from vrchain.ledger.records.encoding import NO_DIGEST, digest
from vrchain.ledger.records.keys import SigningKey
from vrchain.ledger.records.transaction import Transaction
from vrchain.ledger.rules.admission import Admission
from vrchain.ledger.rules.limits import Bucket, Limits
from vrchain.ledger.storage.closing import Closing
from vrchain.ledger.store import Ledger

MAX_FRAMES = 3
_TURN_BYTES = 1 << 18  # that one sender hands over in one round
_MAX_ANSWER_BYTES = 1 << 12
_MAX_REASON_BYTES = 500
_ACCEPTED, _REFUSED = b"=", b"!"


class Answer(NamedTuple):
    """What the gate says to one message. ``reason`` is "" for what is accepted."""

    transaction_id: bytes
    block_hash: bytes
    reason: str

    @property
    def kind(self) -> str:
        """The name of the error, "" for what is accepted."""
        return self.reason.partition(":")[0]


def receive_answer(connection: socket.socket) -> Answer:
    """The next answer of a gate. PeerError when none comes; OSError."""
    frames = receive(connection, 2, _MAX_ANSWER_BYTES)
    if frames is None:
        raise PeerError("the gate has ended the connection")
    return answer_of(frames)


def answer_of(frames: list[bytes]) -> Answer:
    """The answer in a message's frames. WireError when it is none."""
    if len(frames) != 2 or frames[0][:1] not in (_ACCEPTED, _REFUSED):
        raise WireError(f"expected a gate's answer, got {len(frames)} frames")
    said, transaction_id = frames
    if said[:1] == _ACCEPTED:
        return Answer(transaction_id, said[1:], "")
    return Answer(transaction_id, b"", said[1:].decode(errors="replace"))


class Gate(Closing):
    """Takes transactions from senders that connect to ``listener`` into ``ledger``.

    ``author`` makes the blocks and signs them with ``key``. ``clock`` is the ledger's, which
    timestamps are held against. Call ``serve``, or ``turn`` again and again; use ``with``.
    ``counts``: messages by what became of them, ``admitted`` or the name of the error.
    """

    def __init__(
        self,
        listener: socket.socket,
        ledger: Ledger,
        author: str,
        key: SigningKey,
        clock: Callable[[], int] = time.time_ns,
        limits: Limits | None = None,
    ) -> None:
        self.limits = limits or Limits()
        self._ledger, self._author, self._key = ledger, author, key
        self.counts: Counter[str] = Counter()
        self._admission = Admission(ledger, clock, self.limits)
        self._listener = listener
        self._senders: dict[socket.socket, _Sender] = {}
        self._waiting: dict[bytes, _Sender] = {}  # by the id of the transaction that waits
        most = self.limits.arrivals_burst
        self._arrivals = Bucket(self.limits.arrivals_per_s, most, time.monotonic_ns(), most)
        self._selector = selectors.DefaultSelector()
        self._watched: dict[socket.socket, int] = {}
        listener.setblocking(False)

    def serve(self) -> None:
        """Take turns until the process ends. Raises StorageError kinds, and as ``make_block``."""
        while True:
            self.turn(1.0)

    def turn(self, wait_s: float) -> None:
        """One round: wait for something to do at most so long, and hear every sender once."""
        now_ns = time.monotonic_ns()
        self._end_stalled(now_ns)
        ready = self._select(wait_s, now_ns)
        now_ns = time.monotonic_ns()
        heard = [self._senders[c] for c in ready if c in self._senders]
        spoke = [sender for sender in heard if self._hear(sender, ready[sender.connection], now_ns)]
        if spoke:
            self._ledger.refresh()  # others may have enrolled, expelled or published
        for sender in spoke:
            self._judge(sender, now_ns)
        if self._admission.due():
            self._make_block()
        if self._listener in ready:
            self._welcome(now_ns)

    def close(self) -> None:
        """Let go of every sender; the listener and the ledger are the caller's."""
        for sender in list(self._senders.values()):
            self._end(sender)
        self._selector.close()

    def _select(self, wait_s: float, now_ns: int) -> dict[socket.socket, int]:
        """The sockets that something can be done with now, and what."""
        waits_s = [wait_s]
        if (due_s := self._admission.due_in_s()) is not None:
            waits_s.append(due_s)
        self._arrivals.fill(now_ns)
        paused_s = self._arrivals.wait_s(1)
        self._watch(self._listener, 0 if paused_s else selectors.EVENT_READ)
        waits_s += [paused_s] if paused_s else []
        for sender in self._senders.values():
            if sender.unsent:
                self._watch(sender.connection, selectors.EVENT_WRITE)
            elif paused_s := sender.paused_s(now_ns):
                self._watch(sender.connection, 0)
                waits_s.append(paused_s)
            else:
                self._watch(sender.connection, selectors.EVENT_READ)
        found = self._selector.select(min(waits_s))
        return {key.fileobj: mask for key, mask in found}  # type: ignore[misc]

    def _watch(self, connection: socket.socket, events: int) -> None:
        """Wait for ``events`` of the socket from now on."""
        before = self._watched.get(connection, 0)
        if events == before:
            return
        if not events:
            self._selector.unregister(connection)
        elif before:
            self._selector.modify(connection, events)
        else:
            self._selector.register(connection, events)
        self._watched[connection] = events

    def _welcome(self, now_ns: int) -> None:
        """Take one new sender in. If there are too many, the oldest goes that brought nothing."""
        try:
            connection, _ = self._listener.accept()
        except OSError:  # it is gone again
            return
        self._arrivals.take(1)
        if len(self._senders) >= self.limits.senders:
            idle = next((s for s in self._senders.values() if not s.has_brought), None)
            if idle is None:
                connection.close()
                return
            self._end(idle)
        connection.setblocking(False)
        self._senders[connection] = _Sender(connection, self.limits, now_ns)

    def _hear(self, sender: "_Sender", events: int, now_ns: int) -> bool:
        """Read from it, or write what it is owed; whether a whole message has come."""
        try:
            if events & selectors.EVENT_WRITE:
                sender.flush()
                return False
            return sender.hear(now_ns)
        except (OSError, WireError, EOFError):
            self._end(sender)
            return False

    def _judge(self, sender: "_Sender", now_ns: int) -> None:
        message = sender.reader.next()
        transaction_id = digest(message[0]) if message else NO_DIGEST
        try:
            if message is None:
                raise InputLimitError(f"expected at most {sender.max_bytes} bytes, got more")
            if len(message) < 2:
                raise EncodingError(f"expected 2 or 3 frames, got {len(message)}")
            transaction = self._admission.admit(*message)
        except LedgerError as error:
            sender.charge()
            self.counts[type(error).__name__] += 1
            self._answer(sender, _refusal(error), transaction_id)
            return
        self.counts["admitted"] += 1
        sender.has_brought = True
        sender.forgive()
        self._waiting[transaction.id] = sender
        if self._admission.full():  # there might be no room for the next sender's
            self._make_block()

    def _make_block(self) -> None:
        made = self._admission.make_block(self._author, self._key)
        accepted = _ACCEPTED + made.block.hash if made.block else b""
        answers: list[tuple[Transaction, bytes]] = [(t, accepted) for t in made.appended]
        answers += [(transaction, _refusal(error)) for transaction, error in made.refused]
        for transaction, said in answers:
            self._answer(self._waiting.pop(transaction.id), said, transaction.id)

    def _answer(self, sender: "_Sender", said: bytes, transaction_id: bytes) -> None:
        if sender.connection not in self._senders:
            return  # it did not wait for an answer
        sender.unsent += pack([said, transaction_id])
        try:
            sender.flush()
        except OSError:
            self._end(sender)

    def _end_stalled(self, now_ns: int) -> None:
        for sender in list(self._senders.values()):
            if sender.begun_ns and now_ns - sender.begun_ns > self.limits.message_ns:
                self._end(sender)

    def _end(self, sender: "_Sender") -> None:
        self._watch(sender.connection, 0)
        self._watched.pop(sender.connection, None)
        del self._senders[sender.connection]
        sender.connection.close()


class _Sender:
    """A connection: what it owes for what it has sent, and what it has not read yet."""

    def __init__(self, connection: socket.socket, limits: Limits, now_ns: int) -> None:
        self.connection = connection
        self.max_bytes = limits.record_bytes + limits.blob_bytes
        self.reader = Reader(MAX_FRAMES, self.max_bytes)
        self.unsent = bytearray()
        self.begun_ns = 0  # when the message began that is not whole yet
        self.has_brought = False  # whether anything of it was ever admitted
        self._spent_bytes = 0  # on the message that is not judged yet
        # A sender that comes anew each time gains nothing: it begins with one message.
        self._messages = Bucket(limits.sender_messages_per_s, limits.sender_burst, now_ns, 1)
        rate, most = limits.sender_bytes_per_s, limits.sender_burst_bytes
        self._bytes = Bucket(rate, most, now_ns, self.max_bytes)

    def paused_s(self, now_ns: int) -> float:
        """How long it is not listened to; 0 for one that is."""
        if self._messages.fill(now_ns) >= 1 and self._bytes.fill(now_ns) > 0:
            return 0
        return max(self._messages.wait_s(1), self._bytes.wait_s(1))

    def hear(self, now_ns: int) -> bool:
        """Read what there is, up to a turn's share; whether a message is whole.

        Raises EOFError at the connection's end, WireError, OSError.
        """
        left = _TURN_BYTES
        while left and not self.reader.whole:
            try:
                count = self.reader.read(self.connection, left)
            except BlockingIOError:
                break
            if not count:
                raise EOFError
            left -= count
        self._spent_bytes += _TURN_BYTES - left
        self._bytes.take(_TURN_BYTES - left)
        self.begun_ns = 0 if self.reader.whole else self.begun_ns or now_ns
        return self.reader.whole

    def charge(self) -> None:
        """For a message that came to nothing."""
        self._messages.take(1)
        self._spent_bytes = 0

    def forgive(self) -> None:
        """For a message that was admitted: its robot pays."""
        self._bytes.give(self._spent_bytes)
        self._spent_bytes = 0

    def flush(self) -> None:
        """Send what it takes of what it is owed. OSError."""
        with contextlib.suppress(BlockingIOError):
            del self.unsent[: self.connection.send(self.unsent)]


def _refusal(error: LedgerError) -> bytes:
    said = f"{type(error).__name__}: {error}"
    return _REFUSED + said.encode()[:_MAX_REASON_BYTES]

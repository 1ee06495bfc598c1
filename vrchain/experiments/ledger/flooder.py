"""One robot sends to a gate as fast as that lets it: good, forged or oversized transactions.

It knows the ledger as a member does, and takes heed of the gate's answers.
"""

import socket
import struct
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from select import select

from vrchain.ledger import Ledger, Limits, Transaction, simulated_key
from vrchain.ledger.network.gate import Answer, answer_of
from vrchain.ledger.network.wire import Reader, pack
from vrchain.ledger.records.transaction import blob_digest
from vrchain.seeding import generator

FLOODS = ("valid", "forged", "oversized", "reconnecting")
FLOODER = "F"

_NEWS_NS = 50_000_000  # how often the flooder looks at the ledger
_TENTH_OF_A_SECOND = struct.pack("@ll", 0, 100_000)


def following(first: Transaction, last: Transaction | None, payload: bytes) -> Transaction:
    """A robot's transaction after its ``last``, or its ``first``; not signed yet."""
    draft = replace(first, timestamp_ns=time.time_ns(), payload_digest=blob_digest(payload))
    return draft if last is None else replace(draft, sequence=last.sequence + 1, previous=last.id)


@dataclass
class Flooder:
    """A member that floods. ``robots``: the others, in whose names too it forges.

    ``flood``: one of ``FLOODS``. ``limits``: the gate's; what is oversized is larger than those.
    """

    flood: str
    address: str
    ledger: Ledger
    robots: Sequence[str]
    payload_bytes: int
    limits: Limits
    seed: int

    def __post_init__(self) -> None:
        self.sent = self.sent_bytes = 0
        self._key, self._nobody = (simulated_key(self.seed, name) for name in (FLOODER, "nobody"))
        self._payload = generator(self.seed, FLOODER).bytes(self.payload_bytes)
        self._messages: Iterator[bytes] = getattr(self, f"_{self.flood}")()
        self._chain: list[Transaction] = []  # that it has signed, admitted or not
        self._place = 0  # of the one to send next

    def run(self, until_ns: int) -> None:
        """Flood until then. A gate that ends the connection is called again."""
        while time.monotonic_ns() < until_ns:
            with suppress(OSError), socket.socket(socket.AF_UNIX) as connection:
                # It waits for room in the queue of arrivals; Python's timeouts would make it spin,
                # which only takes the processor from the robots that run on the same machine.
                connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, _TENTH_OF_A_SECOND)
                connection.connect(self.address)
                connection.setblocking(False)
                self._run(connection, until_ns)

    def _run(self, connection: socket.socket, until_ns: int) -> None:
        reader = Reader(2, 1 << 12)
        unsent = memoryview(b"")
        while time.monotonic_ns() < until_ns:
            if not unsent:
                unsent = memoryview(next(self._messages))
            readable, writable, _ = select([connection], [connection], [], 0.01)
            if readable:
                if not reader.read(connection, 1 << 12):
                    return
                if reader.whole:
                    self._heed(answer_of(reader.next() or []))
            if writable:
                count = connection.send(unsent)
                self.sent_bytes += count
                unsent = unsent[count:]
                self.sent += not unsent
                if not unsent and self.flood == "reconnecting":
                    return

    def _heed(self, answer: Answer) -> None:
        """Go back to a transaction of its own that was refused; for good ones there is more."""
        if answer.reason and answer.kind != "DuplicateError":
            ids = [transaction.id for transaction in self._chain]
            if answer.transaction_id in ids:
                place = ids.index(answer.transaction_id) - (answer.kind == "SequenceGapError")
                self._place = min(self._place, place)

    def _valid(self) -> Iterator[bytes]:
        """Good transactions, each after the one before, again from the first that is refused."""
        first = self.ledger.draft_transaction(FLOODER, b"", "time", 0)
        while True:
            if self._place == len(self._chain):
                last = self._chain[-1] if self._chain else None
                self._chain.append(following(first, last, self._payload).signed(self._key))
            self._place += 1
            yield pack([self._chain[self._place - 1].record, self._payload])

    def _forged(self) -> Iterator[bytes]:
        """What would be everybody's next transactions, its own too, but for the signatures."""
        while True:
            self.ledger.refresh()
            known_ns = time.monotonic_ns()
            while time.monotonic_ns() - known_ns < _NEWS_NS:
                for robot in (*self.robots, FLOODER):
                    draft = self.ledger.draft_transaction(robot, b"x", "time", time.time_ns())
                    yield pack([draft.signed(self._nobody).record, b"x"])

    _reconnecting = _forged

    def _oversized(self) -> Iterator[bytes]:
        """Good transactions with blobs that are too large, and records that are, in turn."""
        limits = self.limits
        blob = bytes(limits.blob_bytes + limits.record_bytes)
        draft = self.ledger.draft_transaction(FLOODER, blob, "time", time.time_ns())
        large_blob = pack([draft.signed(self._key).record, blob])
        large_record = pack([bytes(limits.record_bytes + 1), b"x"])
        while True:
            yield large_blob
            yield large_record

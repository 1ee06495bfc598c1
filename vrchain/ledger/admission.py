"""Admission: whether what may be valid is taken in here and now. Judged once, before append.

A robot that makes blocks for others holds the door: strangers hand it bytes, as many as they
like. What costs least is checked first, and a robot's rate is charged only after its signature
holds, so that nobody can use up another's. What comes through waits, bounded, for its block.
None of this is validity: replicas with other limits and clocks agree on the chain all the same.
"""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from vrchain.ledger.errors import (
    ClockSkewError,
    InputLimitError,
    QueueFullError,
    RateLimitError,
    WrongLedgerError,
)
from vrchain.ledger.store import Ledger
from vrchain.ledger.transaction import Offer, Transaction
from vrchain.ledger.validity import check_transaction


@dataclass(frozen=True)
class Limits:
    """What is taken in. A robot publishes every few seconds, 200 kB each."""

    record_bytes: int = 2048  # of a transaction that nobody has verified yet
    blob_bytes: int = 1 << 22  # of its panorama and landmark record together
    skew_ns: int = 60_000_000_000  # between a timestamp and the present time, either way
    rate_per_s: float = 1.0  # transactions of one robot, in the long run
    burst: int = 10  # transactions of one robot, at once
    queue_length: int = 256  # transactions that wait
    queue_bytes: int = 1 << 26  # their blobs
    block_length: int = 64  # transactions in one block
    block_delay_ns: int = 200_000_000  # how long the first one waits for others


class Admission:
    """The door of one ledger. ``clock`` gives the present time, integer nanoseconds.

    Call ``admit`` for each transaction that comes, and whenever ``due``,
    ``ledger.append_many(admission.take(), author, key)``.
    """

    def __init__(
        self, ledger: Ledger, clock: Callable[[], int], limits: Limits | None = None
    ) -> None:
        self._ledger, self._clock, self.limits = ledger, clock, limits or Limits()
        self._queue: deque[tuple[int, Offer]] = deque()  # (when it came, what)
        self._queued_bytes = 0
        self._buckets: dict[str, _Bucket] = {}  # members only: there are no more than members

    def admit(self, record: bytes, payload: bytes, landmarks: bytes | None = None) -> Transaction:
        """Let a transaction's canonical bytes and its blobs in, to wait for their block.

        Raises, in this order: InputLimitError, QueueFullError; EncodingError, RecordError;
        WrongLedgerError, UnknownMemberError; ClockSkewError, RateLimitError; the InvalidError
        kinds of a transaction that does not follow the robot's last one, waiting ones included;
        PayloadDigestError. Whatever is refused leaves nothing behind and charges nobody.
        """
        size = len(payload) + len(landmarks or b"")
        self._check_size(len(record), size)
        transaction = Transaction.decode(record)
        robot, members = transaction.robot, self._ledger.members
        if transaction.ledger_id != self._ledger.genesis.id:
            raise WrongLedgerError(f"{transaction} is for the ledger {transaction.ledger_id.hex()}")
        last = self._ledger.latest(robot)
        now_ns = self._clock()
        self._check_clock(transaction, now_ns)
        bucket = self._buckets.setdefault(robot, _Bucket(self.limits.burst, now_ns))
        bucket.refill(self.limits, now_ns)
        if bucket.tokens < 1:
            raise RateLimitError(
                f"expected at most {self.limits.rate_per_s:g} transactions a second of {robot} "
                f"({self.limits.burst} at once), got more; wait"
            )
        waiting = [offer.transaction for _, offer in self._queue]
        last = next((t for t in reversed(waiting) if t.robot == robot), last)
        check_transaction(transaction, members[robot], last)
        offer = Offer(transaction, payload, landmarks)
        bucket.tokens -= 1
        self._queue.append((now_ns, offer))
        self._queued_bytes += size
        return transaction

    def due(self) -> bool:
        """Whether a block should be made now: enough wait, or one has waited long enough."""
        if not self._queue:
            return False
        waited_ns = self._clock() - self._queue[0][0]
        return len(self._queue) >= self.limits.block_length or (
            waited_ns >= self.limits.block_delay_ns
        )

    def take(self) -> list[Offer]:
        """The next block's transactions, in the order in which they came; they wait no more."""
        count = min(len(self._queue), self.limits.block_length)
        taken = [self._queue.popleft()[1] for _ in range(count)]
        self._queued_bytes -= sum(len(o.payload) + len(o.landmarks or b"") for o in taken)
        return taken

    def _check_size(self, record_bytes: int, blob_bytes: int) -> None:
        limits = self.limits
        if record_bytes > limits.record_bytes or blob_bytes > limits.blob_bytes:
            raise InputLimitError(
                f"expected a record of at most {limits.record_bytes} bytes with blobs of at most "
                f"{limits.blob_bytes}, got {record_bytes} and {blob_bytes}"
            )
        full = self._queued_bytes + blob_bytes > limits.queue_bytes
        if full or len(self._queue) >= limits.queue_length:
            raise QueueFullError(
                f"{len(self._queue)} transactions with {self._queued_bytes} bytes wait already; "
                "try again"
            )

    def _check_clock(self, transaction: Transaction, now_ns: int) -> None:
        skew_ns = transaction.timestamp_ns - now_ns
        if abs(skew_ns) > self.limits.skew_ns:
            raise ClockSkewError(
                f"expected {transaction} within {self.limits.skew_ns} ns of the present time, "
                f"got one {abs(skew_ns)} ns {'ahead' if skew_ns > 0 else 'behind'}; set its clock"
            )


class _Bucket:
    """Fills at the limits' rate up to their burst; each transaction takes one token."""

    __slots__ = ("filled_ns", "tokens")

    def __init__(self, tokens: float, now_ns: int) -> None:
        self.tokens, self.filled_ns = tokens, now_ns

    def refill(self, limits: Limits, now_ns: int) -> None:
        if now_ns > self.filled_ns:  # a clock that was set back fills nothing
            earned = (now_ns - self.filled_ns) / 1e9 * limits.rate_per_s
            self.tokens = min(self.tokens + earned, limits.burst)
            self.filled_ns = now_ns

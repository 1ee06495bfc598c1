"""Admission: whether what may be valid is taken in here and now. Judged once, before append.

A robot that makes blocks for others holds the door: strangers hand it bytes, as many as they
like. What costs least is checked first, and a robot's rate is charged only after its signature
holds, so that nobody can use up another's. What comes through waits, bounded, for its block.
None of this is validity: replicas with other limits and clocks agree on the chain all the same.
A maker (``network/maker``) brings offers here; servers have told its senders apart by their keys.
"""

from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from vrchain.errors import LedgerError
from vrchain.ledger.errors import (
    ClockSkewError,
    DuplicateError,
    InputLimitError,
    InvalidError,
    QueueFullError,
    RateLimitError,
    StorageError,
    WrongLedgerError,
)
from vrchain.ledger.records.block import Block
from vrchain.ledger.records.keys import SigningKey
from vrchain.ledger.records.transaction import Offer, Transaction
from vrchain.ledger.rules.limits import Bucket, Limits
from vrchain.ledger.rules.validity import check_transaction
from vrchain.ledger.store import Ledger


class Made(NamedTuple):
    """What became of the transactions that waited. ``block`` is None when none was appended."""

    block: Block | None
    appended: list[Transaction]
    refused: list[tuple[Transaction, LedgerError]]


class Admission:
    """The door of one ledger. ``clock`` gives the present time, integer nanoseconds.

    Call ``admit`` for each transaction that comes, and then ``make_block``.
    """

    def __init__(
        self, ledger: Ledger, clock: Callable[[], int], limits: Limits | None = None
    ) -> None:
        self._ledger, self._clock, self.limits = ledger, clock, limits or Limits()
        self._queue: deque[Offer] = deque()
        self._queued_bytes = 0
        self._last: dict[str, Transaction] = {}  # of each robot, the last that waits
        self._buckets: dict[str, _Rate] = {}  # members only: there are no more than members

    def admit(self, record: bytes, payload: bytes, landmarks: bytes | None = None) -> Transaction:
        """Let a transaction's canonical bytes and its blobs in, to wait for their block.

        Raises, in this order: InputLimitError, QueueFullError; EncodingError, RecordError;
        WrongLedgerError, UnknownMemberError; DuplicateError, ClockSkewError, RateLimitError; the
        InvalidError kinds of a transaction that does not follow the robot's last one, waiting
        ones included, its signature last; PayloadDigestError. Whatever is refused leaves nothing
        behind and charges nobody.
        """
        size = len(payload) + len(landmarks or b"")
        self._check_size(len(record), size)
        transaction = Transaction.decode(record)
        robot, members = transaction.robot, self._ledger.members
        if transaction.ledger_id != self._ledger.genesis.id:
            raise WrongLedgerError(f"{transaction} is for the ledger {transaction.ledger_id.hex()}")
        last = self._ledger.latest(robot)  # a waiting one's robot may be a member no more
        last = self._last.get(robot, last)
        if last and transaction.sequence <= last.sequence and self._knows(transaction.id):
            raise DuplicateError(f"{transaction} is in, or waits for its block; nothing to do")
        now_ns = self._clock()
        self._check_clock(transaction, now_ns)
        rate = self._buckets.setdefault(robot, _Rate(self.limits, now_ns))
        rate.check(robot, now_ns)
        check_transaction(transaction, members[robot], last)
        offer = Offer(transaction, payload, landmarks)
        rate.charge(size)
        self._queue.append(offer)
        self._queued_bytes += size
        self._last[robot] = transaction
        return transaction

    def take(self) -> list[Offer]:
        """The next block's transactions, in the order in which they came; they wait no more."""
        taken, room = list[Offer](), self.limits.block_bytes
        while self._queue and len(taken) < self.limits.block_length:
            size = self._queue[0].size
            if taken and size > room:
                break
            room -= size
            self._queued_bytes -= size
            taken.append(self._queue.popleft())
        self._last = {offer.transaction.robot: offer.transaction for offer in self._queue}
        return taken

    def make_block(self, author: str, key: SigningKey) -> Made:
        """Append what waits, as much as one block takes; durable then.

        What follows no more, since others wrote to the ledger or its robot was expelled, is
        refused by itself and holds up nobody else. When the disk fails, everything taken is
        refused. Raises the InvalidError kinds that are the author's own fault.
        """
        offers, refused = self.take(), list[tuple[Transaction, LedgerError]]()
        while offers:
            try:
                block = self._ledger.append_many(offers, author, key)
            except InvalidError:
                offers, wrong = self._sort_out(offers)
                if not wrong:
                    raise
                refused += wrong
            except StorageError as error:
                refused += [(offer.transaction, error) for offer in offers]
                break
            else:
                return Made(block, [offer.transaction for offer in offers], refused)
        return Made(None, [], refused)

    def _knows(self, transaction_id: bytes) -> bool:
        queued = any(offer.transaction.id == transaction_id for offer in self._queue)
        return queued or self._ledger.holds(transaction_id)

    def _sort_out(
        self, offers: list[Offer]
    ) -> tuple[list[Offer], list[tuple[Transaction, LedgerError]]]:
        """Those that follow what the ledger holds now, and the others with what is wrong."""
        good, wrong = list[Offer](), list[tuple[Transaction, LedgerError]]()
        newest: dict[str, Transaction] = {}
        for offer in offers:
            transaction = offer.transaction
            robot = transaction.robot
            try:
                last = newest.get(robot) or self._ledger.latest(robot)
                check_transaction(transaction, self._ledger.members[robot], last)
            except InvalidError as error:
                wrong.append((transaction, error))
            else:
                good.append(offer)
                newest[robot] = transaction
        return good, wrong

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
        ahead_ns = transaction.timestamp_ns - now_ns
        if ahead_ns > self.limits.skew_ns:  # age is no fault: it may have been out of reach
            raise ClockSkewError(
                f"expected {transaction} at most {self.limits.skew_ns} ns ahead of the present "
                f"time, got one {ahead_ns} ns ahead; set its clock"
            )


class _Rate:
    """What one robot may publish: transactions, and the bytes of their blobs."""

    __slots__ = ("_bytes", "_limits", "_transactions")

    def __init__(self, limits: Limits, now_ns: int) -> None:
        self._limits = limits
        self._transactions = Bucket(limits.rate_per_s, limits.burst, now_ns, limits.burst)
        most = limits.burst_bytes
        self._bytes = Bucket(limits.rate_bytes_per_s, most, now_ns, most)

    def check(self, robot: str, now_ns: int) -> None:
        if self._transactions.fill(now_ns) < 1 or self._bytes.fill(now_ns) <= 0:
            limits = self._limits
            raise RateLimitError(
                f"expected at most {limits.rate_per_s:g} transactions a second of {robot} "
                f"({limits.burst} at once) and {limits.rate_bytes_per_s:g} bytes "
                f"({limits.burst_bytes} at once), got more; wait"
            )

    def charge(self, size: int) -> None:
        self._transactions.take(1)
        self._bytes.take(size)

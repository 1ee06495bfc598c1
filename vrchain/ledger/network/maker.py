"""Makes blocks of offers. Several may: of two that make the same block, one is overtaken.

A maker is a member like others: what it makes is judged by every folder, so it can hold back, but
neither forge nor take out. What may be taken in here and now is ``rules/admission``'s to say.
"""

import time
from collections import Counter
from collections.abc import Callable, Sequence

from vrchain.errors import LedgerError
from vrchain.ledger.errors import (
    ClockSkewError,
    DuplicateError,
    EncodingError,
    InputLimitError,
    InvalidError,
    LogError,
    QueueFullError,
    RateLimitError,
    RecordError,
    SequenceGapError,
    StorageError,
    UnknownMemberError,
)
from vrchain.ledger.network.message import unpack_offer
from vrchain.ledger.network.offers import Offers, Waiting
from vrchain.ledger.network.replicated import Replicated
from vrchain.ledger.records.keys import SigningKey
from vrchain.ledger.records.transaction import Transaction
from vrchain.ledger.rules.admission import Admission
from vrchain.ledger.rules.limits import Limits

_GAP_S, _GAP_TRIES = 0.1, 20  # what is left out comes soon, or may never come
_LATER_S = {SequenceGapError: _GAP_S, RateLimitError: 0.5, QueueFullError: 0.5, ClockSkewError: 5.0}
_LONGEST_S = 5.0  # each try costs the servers its bytes, so the next is later
_AROUND = 1024  # bytes of a message around what it holds
_MOST_TRIES = 600  # then it is let go, whatever it waits for: its robot sends it again
_FOR_GOOD = EncodingError, RecordError, InputLimitError, InvalidError


class Maker:
    """Call ``turn`` again and again. ``ledger`` is the maker's own folder, its log's follower.

    ``counts``: offers by what became of them, ``appended`` or the name of the error.
    """

    def __init__(
        self,
        ledger: Replicated,
        offers: Offers,
        author: str,
        key: SigningKey,
        clock: Callable[[], int] = time.time_ns,
        limits: Limits | None = None,
    ) -> None:
        self._ledger, self._offers, self._author, self._key = ledger, offers, author, key
        self.limits = limits or Limits()
        self._admission = Admission(ledger, clock, self.limits)
        self.counts: Counter[str] = Counter()

    def turn(self, wait_s: float) -> int:
        """Make blocks of what waits, or comes within ``wait_s``; how many offers are in them.

        Raises UnavailableError and the log's other errors, StorageError kinds, and the InvalidError
        kinds that are the maker's own fault; what it held then comes back, or goes to another.
        """
        taken = self._offers.take(self.limits.block_length, wait_s)
        if not taken:
            return 0
        held = {offer.message.reply: offer for offer in taken}
        try:
            self._ledger.catch_up()
            waiting = self._judge(taken, held)
            return self._make(waiting, held) if waiting else 0
        except (LogError, StorageError):
            while self._admission.take():
                pass
            self._offers.later(0.0, *held.values())
            raise

    def _judge(self, taken: Sequence[Waiting], held: dict[str, Waiting]) -> dict[bytes, Waiting]:
        """Those that are admitted, by the transaction's id; the others are answered for."""
        waiting, over, later = dict[bytes, Waiting](), list[Waiting](), dict[float, list[Waiting]]()
        for offer in taken:
            try:
                admitted = self._admit(offer)
                waiting[admitted.id] = offer
                continue
            except DuplicateError:
                over.append(offer)
            except StorageError:  # this maker's own disk is at fault
                raise
            except LedgerError as error:
                self.counts[type(error).__name__] += 1
                first_s = _LATER_S.get(type(error))
                tries = offer.message.metadata.num_delivered or 1
                most = _GAP_TRIES if isinstance(error, SequenceGapError) else _MOST_TRIES
                if first_s is None or tries > most:
                    if first_s is None and isinstance(error, _FOR_GOOD):
                        self._offers.refuse(str(error), offer)
                    over.append(offer)
                else:
                    delay_s = min(first_s * 2 ** (tries - 1), _LONGEST_S)
                    later.setdefault(delay_s, []).append(offer)
        if over:
            self._answered(over, held, None)
        for delay_s, offers in later.items():
            self._answered(offers, held, delay_s)
        return waiting

    def _admit(self, offer: Waiting) -> Transaction:
        most = self.limits.record_bytes + self.limits.blob_bytes + _AROUND
        if len(offer.data) > most:  # before it takes the time to read it
            raise InputLimitError(
                f"expected an offer of {most} bytes or less, got {len(offer.data)}"
            )
        record, payload, *landmarks = unpack_offer(offer.data)
        robot = Transaction.decode(record).robot
        if robot != offer.robot:
            raise UnknownMemberError(f"expected an offer of {offer.robot}, got one of {robot}")
        return self._admission.admit(record, payload, landmarks[0] if landmarks else None)

    def _make(self, waiting: dict[bytes, Waiting], held: dict[str, Waiting]) -> int:
        count = 0
        while waiting:
            made = self._admission.make_block(self._author, self._key)
            answered, later = [waiting.pop(t.id) for t in made.appended], list[Waiting]()
            for transaction, error in made.refused:
                self.counts[type(error).__name__] += 1
                if isinstance(error, StorageError):  # this maker's own disk is at fault
                    raise error
                offer = waiting.pop(transaction.id)
                if type(error) in _LATER_S:
                    later.append(offer)
                    continue
                # else another maker has made a block of it
                if not self._ledger.holds(transaction.id):
                    self._offers.refuse(str(error), offer)
                answered.append(offer)
            count += len(made.appended)
            self.counts["appended"] += len(made.appended)
            self._answered(answered, held, None)
            self._answered(later, held, _GAP_S)
        return count

    def _answered(
        self, offers: Sequence[Waiting], held: dict[str, Waiting], delay_s: float | None
    ) -> None:
        for offer in offers:
            held.pop(offer.message.reply)
        if delay_s is None:
            self._offers.done(*offers)
        else:
            self._offers.later(delay_s, *offers)

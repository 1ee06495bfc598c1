"""Hands on what waits in an outbox, and sets aside what never comes into the chain.

What follows one that was refused is signed anew, with the number that is free now.
"""

import contextlib
import logging
import threading
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Protocol

from vrchain.ledger.errors import (
    EncodingError,
    ExpelledMemberError,
    NotFoundError,
    PayloadDigestError,
    RecordError,
    RefusedError,
)
from vrchain.ledger.network.message import unpack_refusal
from vrchain.ledger.network.outbox import Outbox, offer_in, transaction_in
from vrchain.ledger.records.keys import SigningKey
from vrchain.ledger.records.transaction import NO_TRANSACTION, Transaction
from vrchain.ledger.store import Ledger

_LOG = logging.getLogger(__name__)
_FLYING = 16  # offers of a robot at once: fewer than the servers take
_AGAIN_S = 20.0  # after which an offer that has not come into a block is sent again
_NEVER = ExpelledMemberError, EncodingError, RecordError, PayloadDigestError, RefusedError


class Post(Protocol):
    """Takes offers to whoever makes blocks."""

    def offer(self, robot: str, offer_id: bytes, data: bytes) -> None:
        """Hand it on; durable then, elsewhere. UnavailableError, ClusterError."""

    def offers_of(self, robot: str) -> int:
        """How many of the robot's are on their way. UnavailableError."""

    def say(self, head: bytes) -> None:
        """Tell other members what this one holds. UnavailableError."""

    def heads(self) -> list[tuple[str, bytes]]:
        """What other members have said of themselves since."""

    def refusals(self) -> list[bytes]:
        """What makers have said of this robot's offers since."""


class Sender:
    """Of one outbox. ``signing`` is held while numbers are given out, ``keys`` by robot."""

    def __init__(self, outbox: Outbox, post: Post, ends: threading.Event) -> None:
        self._outbox, self._post, self._ends = outbox, post, ends
        self.signing = threading.Lock()
        self.keys: dict[str, SigningKey] = {}
        self._sent: dict[Path, float] = {}
        self._refused: dict[bytes, str] = {}  # by id: why it never comes into the chain
        self._untold: dict[bytes, Transaction] = {}  # of these, what nobody has asked for
        self._instead: dict[bytes, Transaction] = {}  # by id: what was signed anew

    def goes_out_as(self, transaction: Transaction) -> Transaction:
        """It, or what was signed instead of it. RefusedError if it never comes into the chain."""
        while transaction.id in self._instead:
            transaction = self._instead[transaction.id]
        if why := self._refused.get(transaction.id):
            self._untold.pop(transaction.id, None)
            raise RefusedError(f"{transaction} was refused: {why}")
        return transaction

    def check_refused(self) -> None:
        """RefusedError of what was refused and nobody was told of."""
        for transaction in list(self._untold.values()):
            self.goes_out_as(transaction)

    def hand_on(self, own: Ledger) -> None:
        """Forget what is in the chain, and send what is due, a few of each robot at once."""
        flying: Counter[str] = Counter()
        now_s, refusals = time.monotonic(), self._refusals()
        before: dict[str, tuple[int, Path]] = {}  # by robot: number and file
        waiting = self._outbox.waiting()
        own.refresh()  # afterwards: what waits was signed upon blocks that are in there
        for robot, sequence, path in waiting:
            try:
                last = own.latest(robot)
                if last is not None and last.sequence >= sequence:
                    self._check_in(own, path)
                    self._outbox.remove(path)
                    self._sent.pop(path, None)
                    continue
                if path in self._sent and refusals:
                    self._check_refused(path, refusals)
                number, earlier = before.get(robot, (last.sequence if last else -1, last))
                if sequence > number + 1:
                    path = self._sign_anew(path, number + 1, earlier)
                before[robot] = number + 1, path
                if flying[robot] < _FLYING and not self._ends.is_set():
                    flying[robot] += 1
                    if now_s - self._sent.get(path, -_AGAIN_S) >= _AGAIN_S:
                        there = self._post.offers_of(robot) if path in self._sent else 0
                        if there < flying[robot]:  # else it waits for a maker, and would twice
                            data = self._outbox.read(path)
                            self._post.offer(robot, transaction_in(data).id, data)
                        self._sent[path] = now_s
            except _NEVER as error:
                self._set_aside(robot, sequence, path, str(error))

    def _refusals(self) -> dict[str, str]:
        """What makers have refused, by the transaction's id in hex, and why."""
        found = {}
        for data in self._post.refusals():
            with contextlib.suppress(EncodingError):
                offer_id, why = unpack_refusal(data)
                found[offer_id] = why
        return found

    def _check_in(self, own: Ledger, path: Path) -> None:
        transaction = transaction_in(self._outbox.read(path))
        try:
            own.transaction(transaction.id)
        except NotFoundError:
            raise RefusedError("the chain has another transaction with its number") from None

    def _check_refused(self, path: Path, refusals: Mapping[str, str]) -> None:
        transaction = transaction_in(self._outbox.read(path))
        if why := refusals.get(transaction.id.hex()):
            raise RefusedError(why)

    def _sign_anew(self, path: Path, number: int, before: Transaction | Path | None) -> Path:
        """The file of an offer whose number is free, since the one before it was refused."""
        last = transaction_in(self._outbox.read(before)) if isinstance(before, Path) else before
        with self.signing:
            offer = offer_in(self._outbox.read(path))
            old = offer.transaction
            if old.robot not in self.keys:
                raise RefusedError("the one before it was; its key is not here to sign it anew")
            draft = replace(old, sequence=number, previous=last.id if last else NO_TRANSACTION)
            new = draft.signed(self.keys[old.robot])
            anew = self._outbox.put(replace(offer, transaction=new))
            self._instead[old.id] = new
            self._outbox.remove(path)
        for each in (path, anew):
            self._sent.pop(each, None)
        return anew

    def _set_aside(self, robot: str, sequence: int, path: Path, why: str) -> None:
        _LOG.warning("transaction %d of %s was refused for good: %s", sequence, robot, why)
        with contextlib.suppress(EncodingError, RecordError):
            refused = transaction_in(self._outbox.read(path))
            self._refused[refused.id], self._untold[refused.id] = why, refused
        with self.signing:
            self._outbox.refuse(path, why)
        self._sent.pop(path, None)

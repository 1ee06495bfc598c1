"""A robot's ledger over several machines: reads are its folder's, writes go out as offers.

One thread follows the log into the folder, another hands on what waits in the outbox. Both go on
by themselves when servers come and go; what cannot mend itself is in ``trouble``.
"""

import contextlib
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

from vrchain.errors import LedgerError
from vrchain.ledger.errors import (
    ClusterError,
    EncodingError,
    ForkError,
    NotSettledError,
    RecordError,
    SignatureError,
    TooLargeError,
    UnavailableError,
    UnknownMemberError,
)
from vrchain.ledger.network.log import Log
from vrchain.ledger.network.message import (
    Standing,
    pack_head,
    unpack_head,
)
from vrchain.ledger.network.outbox import Outbox, refused_in
from vrchain.ledger.network.replicated import Comes, Replicated
from vrchain.ledger.network.sender import Post, Sender
from vrchain.ledger.records.block import Entry
from vrchain.ledger.records.keys import SigningKey
from vrchain.ledger.records.transaction import Offer, Transaction, blob_digest
from vrchain.ledger.rules.chain import Lap
from vrchain.ledger.rules.validity import check_transaction
from vrchain.ledger.store import Ledger

_FOLLOW_S = 0.5  # for which a follower waits at once, and so long until it is told to end
_RETRY_S = 0.5
_LOOK_S = 0.01
# nobody said that:
_NO_HEAD = EncodingError, RecordError, TooLargeError, UnknownMemberError, SignatureError


class RobotLedger(Replicated):
    """Use ``open_ledger``. One process publishes from a folder; readers may have it open too."""

    post: Post

    def start(self, log: Log, post: Post, sources: Sequence[Log]) -> None:
        """Follow and send from now on, until ``close``. LedgerBusyError, StorageError."""
        self.log, self.post, self.sources = log, post, sources
        self.outbox = Outbox(self.folder)
        self.trouble: dict[str, LedgerError] = {}
        self._ends, self._wakes = threading.Event(), threading.Event()
        self._followed_s = 0.0  # when the folder had last all that the log has
        self._sender = Sender(self.outbox, post, self._ends)
        self._told = b""
        self.others: dict[str, tuple[int, Standing]] = {}  # by member: height, and how it stands
        self._threads = [
            threading.Thread(target=self._forever, args=(part,), daemon=True)
            for part in (self._follow, self._send)
        ]
        for thread in self._threads:
            thread.start()

    def publish(
        self,
        robot: str,
        key: SigningKey,
        payload: bytes,
        reason: str,
        timestamp_ns: int,
        lap: Lap = lambda stage: None,
        *,
        landmarks: bytes | None = None,
    ) -> Transaction:
        """Sign a transaction and put it into the outbox, durably; it goes out by itself.

        ``wait`` until it is in the chain. Raises as ``Ledger.publish``, NotSettledError in a
        folder from elsewhere that has not read the chain yet; then nothing has changed.
        """
        digests = blob_digest(payload), blob_digest(landmarks)
        lap("hash")
        self._check_settled(robot)
        with self._sender.signing:
            return self._sign(robot, key, digests, reason, timestamp_ns, lap, payload, landmarks)

    def _sign(
        self,
        robot: str,
        key: SigningKey,
        digests: tuple[bytes, bytes],
        reason: str,
        timestamp_ns: int,
        lap: Lap,
        payload: bytes,
        landmarks: bytes | None,
    ) -> Transaction:
        waiting = self.outbox.last(robot)  # before the chain is read: what leaves it is in there
        self.refresh()
        draft = self.draft(robot, digests[0], reason, timestamp_ns, digests[1])
        last = self.latest(robot)
        if waiting and waiting.sequence >= draft.sequence:
            last = waiting
            draft = replace(draft, sequence=waiting.sequence + 1, previous=waiting.id)
        assert draft.body
        lap("encode")
        transaction = draft.signed(key)
        lap("sign")
        check_transaction(transaction, self.members[robot], last)
        lap("validate")
        self.outbox.put(Offer(transaction, payload, landmarks))
        self._sender.keys[robot] = key
        lap("append_durable")
        self._wakes.set()
        return transaction

    def wait(self, transaction: Transaction | None = None, timeout_s: float = 30.0) -> None:
        """Until the transaction, or all that is in the outbox, is in the chain here.

        Raises UnavailableError when it is not in time, RefusedError when it never comes there, or
        what keeps it from there.
        """
        self._until(lambda: self._is_in(transaction), timeout_s)

    def wait_until_followed(self, timeout_s: float = 30.0) -> None:
        """Until the folder has all that the log has now. Raises as ``wait``."""
        asked_s = time.monotonic()
        self._until(lambda: self._followed_s >= asked_s, timeout_s)

    def raise_trouble(self, late: bool = False) -> None:
        """Raise what keeps it from its servers and does not mend itself; if late, whatever does."""
        for error in list(self.trouble.values()):
            if late or not isinstance(error, UnavailableError):
                raise error

    def _until(self, met: Callable[[], bool], timeout_s: float) -> None:
        until_s = time.monotonic() + timeout_s
        self.refresh()
        while not met():
            late = time.monotonic() > until_s
            self.raise_trouble(late)
            if late:
                raise UnavailableError(f"{self.outbox.count()} still wait in {self.outbox.folder}")
            time.sleep(_LOOK_S)
            self.refresh()
        self.refresh()  # what was followed meanwhile

    def close(self) -> None:
        """Stop following and sending; what waits in the outbox stays. Twice does no harm."""
        if hasattr(self, "_ends") and not self._ends.is_set():
            self._ends.set()
            self._wakes.set()
            for thread in self._threads:
                thread.join()
            self.outbox.close()
            self.log.close()
        super().close()

    def _writing(self) -> contextlib.AbstractContextManager[None]:
        """What is not offered but appended, the operator's, is made upon the log's newest."""
        self.wait_until_followed()
        return contextlib.nullcontext()

    def catch_up(self, wait_s: float = 0.0, comes: Comes = lambda entry: True) -> int:
        """Wait until the follower has done it; how many blocks it were."""
        before = self.head.height
        self.wait_until_followed()
        return self.head.height - before

    def _is_in(self, transaction: Transaction | None) -> bool:
        if transaction is None:
            if self.outbox.count():
                return False
            self._sender.check_refused()
            return True
        transaction = self._sender.goes_out_as(transaction)
        last = self.latest(transaction.robot)
        # another of its number may be there: then it is set aside, or signed anew
        counts = last is not None and last.sequence >= transaction.sequence
        return counts and self.holds(transaction.id)

    def _check_settled(self, robot: str) -> None:
        """A folder from a backup does not know what its robot signed after it was made."""
        if not self.outbox.is_moved:
            return
        try:
            if self.post.offers_of(robot):
                raise NotSettledError(
                    f"offers of {robot} wait that {self.folder} does not know; try again"
                )
            self.wait_until_followed()
        except (UnavailableError, ClusterError) as error:
            raise NotSettledError(
                f"{self.folder} is new here, or from a backup: {robot} may have signed more than "
                f"it knows, so it has to read the chain first, which fails: {error}"
            ) from None
        self.outbox.settle()

    def _forever(self, part: Callable[[], None]) -> None:
        while not self._ends.is_set():
            try:
                part()
            except Exception as error:  # of any kind, or it would end unsaid
                told = error if isinstance(error, LedgerError) else LedgerError(repr(error))
                self.trouble[part.__name__] = told
                self._ends.wait(_RETRY_S)

    def _follow(self) -> None:
        with contextlib.ExitStack() as stack:
            for source in self.sources:  # opened by this thread, if at all
                stack.callback(source.close)
            own = stack.enter_context(Replicated.join(self.folder, self.log, self.sources))
            own.alarms = self.alarms
            while not self._ends.is_set():
                asked_s = time.monotonic()
                own.catch_up()
                self._followed_s = asked_s
                self.trouble.pop("_follow", None)
                self._wakes.set()
                self._compare_heads(own)
                own.catch_up(_FOLLOW_S, self._comes)

    def _compare_heads(self, own: Replicated) -> None:
        """Tell others the newest block here, and hold theirs against the chain."""
        refused = len(refused_in(self.folder))
        standing = Standing(self.outbox.count(), refused, len(self.alarms))
        said = pack_head(own.head, standing)
        if said != self._told:
            self.post.say(said)
            self._told = said
        for name, data in self.post.heads():
            with contextlib.suppress(*_NO_HEAD, ForkError):  # a fork is an alarm, kept as evidence
                block, standing = unpack_head(data)
                self.others[name] = block.height, standing
                own.convict(block)

    def _comes(self, entry: Entry) -> bool:
        """Something new is in the folder: what waited may be in it. Whether to go on."""
        self._wakes.set()
        return time.monotonic() < self._followed_s + _FOLLOW_S and not self._ends.is_set()

    def _send(self) -> None:
        with Ledger.open(self.folder) as own:
            while not self._ends.is_set():
                self._wakes.wait(_FOLLOW_S)
                self._wakes.clear()
                self._sender.hand_on(own)
                self.trouble.pop("_send", None)

"""A ledger's folder that follows a log, and appends through it: what is here has been judged here.

The folder is the durable copy. A log that loses blocks, or gives others, is not believed: what it
gives is judged, block by block, and what it lacks is looked for elsewhere.
"""

import contextlib
import logging
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Self, TypeAlias

from vrchain.errors import LedgerError
from vrchain.ledger.errors import (
    ForkError,
    GapError,
    InvalidError,
    NotALedgerError,
    OvertakenError,
    PayloadDigestError,
    StorageError,
    UnavailableError,
    WrongLedgerError,
)
from vrchain.ledger.network.log import Given, Log, check_is_part_of
from vrchain.ledger.records.block import Block, Entry, Record
from vrchain.ledger.records.keys import DATABASE_NAME, SigningKey
from vrchain.ledger.rules.chain import Lap
from vrchain.ledger.storage.durable import storage_errors, write_durably
from vrchain.ledger.storage.place import OUTBOX_NAME
from vrchain.ledger.store import Ledger

_LOG = logging.getLogger(__name__)
EVIDENCE_NAME = "evidence"  # in the ledger's folder
_COMES_S = 30.0  # for a block that came first: longer than servers take to choose a leader
_LOOK_S = 0.005
_WAIT_S = 5.0  # for another process that writes to the folder
Comes: TypeAlias = Callable[[Entry], bool]


class Replicated(Ledger):
    """A folder and the log that it follows. ``sources``: where else to look for blocks.

    ``alarms``: what was wrong with the log, and where, though the block was found. What reads
    is as in any ``Ledger``, and asks the log nothing.
    """

    log: Log
    sources: Sequence[Log]
    alarms: list[str]
    _knows_log: bool  # that it begins as this ledger does

    @classmethod
    def join(cls, folder: Path, log: Log, sources: Sequence[Log] = ()) -> Self:
        """The ledger in ``folder``, which is begun with the log's first block if it is not there.

        Raises UnavailableError when it would have to be and no log answers; StorageError kinds.
        """
        if not (folder / DATABASE_NAME).exists():
            first = next(log.follow(-1), None)
            if first is None:
                raise NotALedgerError("the servers hold no block yet: vrchain cluster put LEDGER")
            Ledger.adopt(folder, first[0]).close()
        with storage_errors(f"writing to {folder}"):
            (folder / OUTBOX_NAME).mkdir(exist_ok=True)  # who sees it writes nothing here alone
        made = cls(folder, True, _WAIT_S)
        made.log, made.sources, made.alarms = log, sources, []
        made._knows_log = False
        return made

    def catch_up(self, wait_s: float = 0.0, comes: Comes = lambda entry: True) -> int:
        """Take in what the log has, then what comes, until nothing has for ``wait_s``; how many.

        ``comes(entry)`` is told of each block that is in the folder, and whether to go on.
        Raises GapError where no place has the next block, WrongLedgerError, ForkError with the
        evidence, UnavailableError, StorageError kinds; what came before is kept.
        """
        if not self._knows_log:
            self._check_log()
        count = 0
        self.refresh()
        while True:
            try:
                for given in self.log.follow(self.head.height, wait_s):
                    count += self._taken(given)
                    if not comes(given[0]):
                        break
                return count
            except GapError as error:
                self._mend(error)
                count += 1

    def convict(self, block: Block) -> None:
        """Hold a block that another has against the chain; one that is not known yet passes.

        Raises ForkError if it is a second one of its height, well signed; both are kept, in the
        folder ``evidence``. Raises SignatureError, UnknownMemberError for one that nobody signed.
        """
        if block.height <= self.head.height:
            with self._evidence():
                self._check_same(block)

    @contextlib.contextmanager
    def _evidence(self) -> Iterator[None]:
        try:
            yield
        except ForkError as error:
            kept = self.folder.absolute() / EVIDENCE_NAME
            said = f"{error.second.author} has signed a block beside this chain; it is in {kept}"
            if error.first.author != error.second.author:
                said += f", with that of {error.first.author}: one of the two chains is another's"
            if said not in self.alarms:  # one pair convicts; who signs many fills no disk
                with storage_errors(f"writing to {kept}"):
                    kept.mkdir(exist_ok=True)
                    for block in (error.first, error.second):
                        write_durably(f"{kept}/{block.height}-{block.hash.hex()}", block.record)
                self._warn([said])
            raise

    def _taken(self, given: Given) -> bool:
        try:
            with self._evidence():
                return self.take(*given)
        except ForkError:
            raise
        except (InvalidError, PayloadDigestError) as error:
            raise GapError(f"{given[0].block} of the log does not follow: {error}") from error

    def _mend(self, error: GapError) -> None:
        """Find the next block wherever it is, and note who has not got it. GapError: nobody has."""
        height, wrong = self.head.height + 1, list[str]()
        for log in (self.log, *self.sources):
            with contextlib.suppress(UnavailableError, StorageError):
                for place, given in log.copies(height):
                    try:
                        if given is None or given[0].block.height != height:
                            raise GapError("is missing")
                        self.take(*given)
                    except (GapError, InvalidError, PayloadDigestError) as found:
                        wrong.append(f"{place}: block {height} {_short(found)}")
                    else:
                        self._warn(wrong or [str(error)])
                        return
        for _, given in self.log.copies(self.head.height):
            if given is not None:
                self.convict(given[0].block)
        told = "; ".join(dict.fromkeys(wrong)) or "no place has it"
        raise GapError(
            f"{error}; {told}; give another robot's folder, or see docs/how-to/deployment.md"
        )

    def _warn(self, wrong: Sequence[str]) -> None:
        """Note what was wrong with the log, though the block was found; of each once."""
        for line in wrong:
            if line not in self.alarms:
                self.alarms.append(line)
                _LOG.warning("%s", line)

    def _check_log(self) -> None:
        """WrongLedgerError unless the log has this ledger's first block, and its newest."""
        own = self.entry(0).block.hash
        first = None
        with contextlib.suppress(GapError):  # what is lost there tells nothing
            first = next(self.log.follow(-1), None)
        if first is not None and first[0].block.hash != own:
            raise WrongLedgerError(
                f"the servers hold another ledger, {first[0].records[0].id.hex()}, than "
                f"{self.folder}, {self.genesis.id.hex()}: choose its servers or another folder"
            )
        if first is not None:
            check_is_part_of(self, self.log, self.head.height)
        self._knows_log = first is not None

    def _writing(self) -> contextlib.AbstractContextManager[None]:
        self.catch_up()
        return contextlib.nullcontext()

    def _append(
        self,
        records: Sequence[Record],
        blobs: Mapping[bytes, bytes],
        author: str,
        key: SigningKey,
        lap: Lap = lambda stage: None,
    ) -> None:
        """Append through the log, and make the block anew as often as others come first.

        Raises UnavailableError when it is not known whether the block was appended.
        """
        while True:
            after = self.head.height
            entry, _ = self.make(records, author, key, lap)
            try:
                self.log.append(entry, blobs, after)
            except (OvertakenError, UnavailableError) as error:
                self.catch_up()
                if isinstance(error, OvertakenError):
                    self._see_another(after)
                if self._holds(entry.block.height, entry.block.hash):
                    return
                if isinstance(error, UnavailableError):
                    raise
            else:
                lap("transmit")
                self.take(entry, blobs)
                lap("append_durable")
                return

    def _see_another(self, after: int) -> None:
        """Take in the block that came first, which may be on its way to the other servers still."""
        until_s = time.monotonic() + _COMES_S
        while self.head.height == after:
            if time.monotonic() > until_s:
                raise GapError(f"the log refuses to go on from block {after}, and shows none after")
            time.sleep(_LOOK_S)
            self.catch_up()

    def _holds(self, height: int, block_hash: bytes) -> bool:
        return height <= self.head.height and self.entry(height).block.hash == block_hash


def _short(error: LedgerError) -> str:
    return str(error).partition(";")[0][:200]

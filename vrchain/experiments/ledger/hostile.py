"""A hostile member, and a dishonest maker: what they try on a cluster, and what stops each.

A member has its own key, and may send the servers any bytes. Each attempt is made for real, and
the table says who refused it: the servers, the maker, or those who follow.
"""

import tempfile
import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from vrchain.errors import LedgerError
from vrchain.experiments.ledger.stores import create_ledger
from vrchain.ledger import Ledger, Offer, SigningKey, Transaction, simulated_key
from vrchain.ledger.cluster.config import Users
from vrchain.ledger.cluster.servers import Cluster
from vrchain.ledger.errors import UnavailableError
from vrchain.ledger.network.connection import API, Connection, Servers
from vrchain.ledger.network.log import put
from vrchain.ledger.network.maker import Maker
from vrchain.ledger.network.message import (
    MAX_MESSAGE_BYTES,
    Standing,
    pack_head,
    pack_offer,
    unpack_head,
)
from vrchain.ledger.network.offers import Offers
from vrchain.ledger.network.replicated import EVIDENCE_NAME, Replicated
from vrchain.ledger.network.stream import OFFERS_WAITING, Stream
from vrchain.ledger.records.block import Entry

HOSTILE, OTHER, MAKER = "R1", "R2", "M"
_TRY_S = 2.0
_BY = {
    "do not permit": "permission",
    "let nobody in": "key",
    "are full": "limit of offers that wait",
    "delete not permitted": "deny_delete",
}

# What a member sends to a subject that is not its own, by what that would do.
_FORBIDDEN = {
    "write a block itself": "block",
    "offer in another's place": f"offer.{OTHER}",
    "delete the chain": f"{API}.STREAM.DELETE.block",
    "delete one block": f"{API}.STREAM.MSG.DELETE.block",
    "empty the chain": f"{API}.STREAM.PURGE.block",
    "change how it is kept": f"{API}.STREAM.UPDATE.block",
    "depose the leader": f"{API}.STREAM.LEADER.STEPDOWN.block",
    "take away others' offers": f"{API}.CONSUMER.MSG.NEXT.offer.maker",
    "command the servers": "$SYS.REQ.SERVER.PING.CONFIG",
}

# What it may ask, and where it wants the servers' answer.
_ANSWERED = {
    "have an answer written as a block": (f"offer.{HOSTILE}", "block"),
    "have an answer offered in another's place": (f"{API}.DIRECT.GET.block", f"offer.{OTHER}"),
    "have an answer delete the chain": (f"{API}.DIRECT.GET.block", "$JS.API.STREAM.DELETE.block"),
}


@dataclass(frozen=True)
class Stage:
    """A cluster with a ledger, its maker and a follower, all in one thread: they take turns."""

    cluster: Cluster
    key: SigningKey
    operator: SigningKey
    of_maker: SigningKey
    connection: Connection
    stream: Stream
    maker: Maker
    by_maker: Replicated
    follower: Replicated

    def made_of(self, *messages: bytes) -> str:
        """What the maker does with offers of the hostile member: the name of its refusal."""
        before = self.maker.counts.copy()
        for number, message in enumerate(messages):
            self.stream.offer(HOSTILE, bytes([number]) + message[-31:], message)
        until_s = time.monotonic() + 30 * _TRY_S
        while sum((after := self.maker.counts - before).values()) < len(messages):
            if time.monotonic() > until_s:
                raise LedgerError(f"the maker has not judged {len(messages)} offers in time")
            self.maker.turn(0.1)
        refused = [name for name in after if name != "appended"]
        return f"maker: {refused[0]}" if refused else "nothing"


def attacks(seed: int = 0, nodes: int = 1) -> pd.DataFrame:
    """Try each on a cluster of its own. One row an attack: attack, stopped_by, said."""
    with tempfile.TemporaryDirectory() as scratch, ExitStack() as stack:
        stage = _stage(Path(scratch), seed, nodes, stack)
        rows = [_row(name, partial(_send, stage, to)) for name, to in _FORBIDDEN.items()]
        rows += [_row(name, partial(_answered, stage, *how)) for name, how in _ANSWERED.items()]
        rows += [
            _row("listen to another's answers", lambda: _listen(stage, f"_INBOX.{OTHER}.>")),
            _row("come in without a key", lambda: _enter(stage, None)),
            _row("come in with another key", lambda: _enter(stage, simulated_key(1, "X"))),
            _row("send what is too large", lambda: _oversized(stage)),
            _row("flood its own subject", lambda: _flood(stage)),
            _row("offer garbage", lambda: stage.made_of(b"garbage")),
            _row("sign in another's name", lambda: _forged(stage)),
            _row("sign two with one number", lambda: _two_with_one_number(stage)),
            _row("as operator of servers, delete a block", lambda: _delete(stage)),
            _row("as maker, a block that does not follow", lambda: _wrong_block(stage)),
            _row("as maker, two blocks at one height", lambda: _second_block(stage)),
        ]
    return pd.DataFrame(rows, columns=["attack", "stopped_by", "said"])


def _stage(scratch: Path, seed: int, nodes: int, stack: ExitStack) -> Stage:
    ledger, keys = create_ledger(scratch / "origin", (HOSTILE, OTHER, MAKER), seed)
    operator = simulated_key(seed, "operator")
    with ledger:
        for number, robot in enumerate((HOSTILE, OTHER)):
            ledger.publish(robot, keys[robot], robot.encode(), "start", number)
    members = {name: keys[name].public for name in (HOSTILE, OTHER, MAKER)}
    users = Users(operator.public, members, frozenset({MAKER}))
    cluster = Cluster.make(scratch / "servers", nodes, users)
    stack.enter_context(cluster.running(operator, "operator"))

    def joined(name: str, key: SigningKey) -> tuple[Stream, Connection]:
        connection = Connection(Servers.at(cluster.address, key=key, name=name))
        return stack.enter_context(closing(Stream(connection))), connection

    log, _ = joined("operator", operator)
    with Ledger.open(scratch / "origin") as origin:
        put(origin, log, -1)
    of_maker, maker_connection = joined(MAKER, keys[MAKER])
    by_maker = stack.enter_context(Replicated.join(scratch / MAKER, of_maker))
    of_other, _ = joined(OTHER, keys[OTHER])
    follower = stack.enter_context(Replicated.join(scratch / OTHER, of_other))
    maker = Maker(by_maker, Offers(maker_connection), MAKER, keys[MAKER], lambda: 1_000)
    stream, connection = joined(HOSTILE, keys[HOSTILE])
    by_maker.catch_up(), follower.catch_up()
    by_key = keys[HOSTILE], operator, keys[MAKER]
    return Stage(cluster, *by_key, connection, stream, maker, by_maker, follower)


def _row(attack: str, attempt: Callable[[], str]) -> tuple[str, str, str]:
    try:
        return attack, attempt(), ""
    except LedgerError as error:
        by = [short for part, short in _BY.items() if part in str(error)]
        return attack, f"servers: {(*by, type(error).__name__)[0]}", str(error)


def _send(stage: Stage, subject: str) -> str:
    connection = stage.connection

    async def send(client: Any) -> None:
        asked = client.request(subject, b"{}", timeout=_TRY_S)
        await connection.permitted(subject, asked)

    connection.run(send)
    return "nothing"


def _answered(stage: Stage, asked: str, to: str) -> str:
    """Stopped if streams are as before once the servers have answered, which no member sees."""

    def state() -> tuple[int, int] | None:
        try:
            return stage.stream.newest(), stage.stream.offers_of(OTHER)
        except LedgerError:
            return None

    async def send(client: Any) -> None:
        await client.publish(asked, b"{}", reply=to)
        await client.flush()

    before = state()
    stage.connection.run(send)
    until_s = time.monotonic() + _TRY_S
    while time.monotonic() < until_s:
        if state() != before:
            return "nothing"
        time.sleep(0.05)
    while stage.maker.turn(0.2):  # what it offered meanwhile
        pass
    return "servers: account of its own"


def _listen(stage: Stage, subject: str) -> str:
    async def listen(client: Any) -> None:
        await client.subscribe(subject)
        await client.flush()

    stage.connection.run(listen)
    until_s = time.monotonic() + 10 * _TRY_S
    while not any(subject.lower() in said.lower() for said in stage.connection.complaints):
        if time.monotonic() > until_s:
            return "nothing"
        time.sleep(0.01)
    return "servers: subscription not permitted"


def _enter(stage: Stage, key: SigningKey | None) -> str:
    servers = Servers.at(stage.cluster.address, key=key, name=OTHER, timeout_s=_TRY_S)
    until_s = time.monotonic() + 10 * _TRY_S
    while True:
        try:
            with Connection(servers) as connection:
                Stream(connection).newest()
            return "nothing"
        except UnavailableError:  # a server that hangs up may not have been heard
            if time.monotonic() > until_s:
                raise


def _oversized(stage: Stage) -> str:
    stage.stream.offer(HOSTILE, bytes(32), bytes(MAX_MESSAGE_BYTES + (1 << 20)))
    return "nothing"


def _flood(stage: Stage) -> str:
    try:
        for number in range(4 * OFFERS_WAITING):
            stage.stream.offer(HOSTILE, number.to_bytes(32, "big"), b"flood")
    finally:
        while stage.maker.turn(0.2) or stage.stream.offers_of(HOSTILE):
            pass
    return "nothing"


def _next(stage: Stage, payload: bytes, time_ns: int = 10) -> Transaction:
    stage.by_maker.catch_up()
    return stage.by_maker.draft_transaction(HOSTILE, payload, "view", time_ns)


def _forged(stage: Stage) -> str:
    draft = replace(_next(stage, b"forged"), robot=OTHER)
    return stage.made_of(pack_offer(Offer(draft.signed(stage.key), b"forged")))


def _two_with_one_number(stage: Stage) -> str:
    one, two = (_next(stage, payload).signed(stage.key) for payload in (b"one", b"two"))
    first = stage.made_of(pack_offer(Offer(one, b"one")))
    return first if first != "nothing" else stage.made_of(pack_offer(Offer(two, b"two")))


def _delete(stage: Stage) -> str:
    servers = Servers.at(stage.cluster.address, key=stage.operator, name="operator")

    async def delete(client: Any) -> bool:
        return await client.jetstream().delete_msg("block", 1)

    with Connection(servers) as connection:
        connection.run(delete)
    return "nothing"


def _wrong_block(stage: Stage) -> str:
    """It is taken off the log again by nobody: what follows it is for the operator to decide."""
    entry = _entry_of(stage, b"unlinked")
    log = _Given(replace(entry.block, previous_hash=bytes(32)).signed(stage.of_maker), entry)
    stage.follower.log, own = log, stage.follower.log
    try:
        stage.follower.catch_up()
    except LedgerError as error:
        return f"followers: {type(error).__name__}"
    finally:
        stage.follower.log = own
    return "nothing"


def _second_block(stage: Stage) -> str:
    first, second = (_entry_of(stage, payload) for payload in (b"first", b"second"))
    stage.follower.catch_up()
    blob = {r.payload_digest: b"first" for r in first.records if isinstance(r, Transaction)}
    stage.by_maker.log.append(first, blob, stage.by_maker.head.height)
    stage.follower.catch_up()
    told = pack_head(second.block, Standing(0))  # what another robot says that it was given
    try:
        stage.follower.convict(unpack_head(told)[0])
    except LedgerError as error:
        kept = len(list((stage.follower.folder / EVIDENCE_NAME).iterdir()))
        return f"followers: {type(error).__name__}, {kept} blocks kept as evidence"
    return "nothing"


def _entry_of(stage: Stage, payload: bytes) -> Entry:
    transaction = _next(stage, payload).signed(stage.key)
    return stage.by_maker.make([transaction], MAKER, stage.of_maker)[0]


class _Given:
    """A log of which the servers' operator has made what he likes: one block on top."""

    def __init__(self, block: Any, entry: Entry) -> None:
        self._entry = Entry(block, entry.records)

    def append(self, entry: Entry, blobs: Any, after: int) -> None:
        """Nobody does."""

    def follow(self, after: int, wait_s: float = 0.0) -> Any:
        """The one block."""
        yield self._entry, {}

    def copies(self, height: int) -> Any:
        """The same everywhere."""
        yield "every server", (self._entry, {})

    def close(self) -> None:
        """Nothing to do."""

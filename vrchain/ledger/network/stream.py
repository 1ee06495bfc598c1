"""The log on servers: NATS JetStream orders blocks and keeps them on several machines.

Block h is message h + 1 of the stream ``block``. What has been stored is said again under
``chain.block``, so that followers hear of it at once; what they missed they ask for by number.
Offers wait in the stream ``offer``, one subject a robot, until a maker has made a block of them.
"""

import asyncio
import contextlib
import json
import threading
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from vrchain.errors import LedgerError
from vrchain.ledger.errors import ClusterError, GapError, UnavailableError
from vrchain.ledger.network.connection import API, Connection, token
from vrchain.ledger.network.log import Given
from vrchain.ledger.network.message import pack_entry, unpack_entry
from vrchain.ledger.records.block import Entry

if TYPE_CHECKING:
    from nats.aio.client import Client
    from nats.aio.msg import Msg

BLOCKS, OFFERS, MAKER, SAID, HEADS = "block", "offer", "maker", "chain.block", "head"
REFUSED = "refused"  # what makers tell a robot of its offers
OFFERS_WAITING = 64  # of one robot, before the servers refuse the next
MAKERS = "makers"  # of which one at a time is given offers
_LOOK_S = 2.0  # between two questions for the newest, should what is said be missed
_LAGS_S = 2.0  # for which a replica may be behind
_ASKED = 4  # times by way of each server, for a block that some may lack
_SAID_KEPT, _SAID_BYTES = 200, 1 << 17  # of what members say of themselves, each at most
_AGAIN_S = 0.4  # until a stream that nobody answered for is asked once more
_KEPT = 8  # messages that came before those they follow


class Stream:
    """``Log`` on servers. One thread follows at a time; any may append."""

    def __init__(self, connection: Connection) -> None:
        self.connection = connection
        self._heard: dict[int, bytes] = {}
        self._newest = 0  # number of the newest message that is known
        self._news = threading.Condition()
        self._listener: Client | None = None  # that hears; a closed one is replaced
        self._said: list[tuple[str, bytes]] = []
        self._refused: list[bytes] = []

    def append(self, entry: Entry, blobs: Mapping[bytes, bytes], after: int) -> None:
        """As ``Log``. ClusterError when the servers refuse it."""
        data = pack_entry(entry, blobs)
        # By the id alone a second try is stored twice once the servers have forgotten the first.
        headers = {
            "Nats-Msg-Id": entry.block.hash.hex(),
            "Nats-Expected-Last-Sequence": str(after + 1),
        }
        self._publish(BLOCKS, data, headers)

    def follow(self, after: int, wait_s: float = 0.0) -> Iterator[Given]:
        """As ``Log``; GapError also where the servers know fewer blocks than ``after``."""
        self.connection.run(self._listen)
        self._ask_newest(after + 1)
        want, until_s = after + 2, time.monotonic() + wait_s
        while True:
            data = self._taken(want)
            if data is None and want <= self._newest:
                data = self._fetch(want)
            if data is not None:
                yield _read(data, want - 1)
                want, until_s = want + 1, time.monotonic() + wait_s
            elif not self._wait(want, until_s):
                return

    def copies(self, height: int) -> Iterator[tuple[str, Given | None]]:
        """As ``Log``, by way of each server, but for those that are only behind.

        Whichever has a replica may answer, whomever one asks: so each is asked several times, and
        which one lacks it only ``vrchain cluster status`` can say.
        """
        servers = self.connection.servers
        for address in servers.addresses:
            with (
                contextlib.suppress(UnavailableError),
                Connection(replace(servers, addresses=(address,))) as alone,
            ):
                for _ in range(_ASKED):
                    found = alone.run(lambda client: _direct(client, height + 1))
                    if found is not None and found[0] == height + 1:
                        break
                if found is not None:
                    number, data = found
                    yield (
                        f"by way of {alone.server}",
                        _readable(data, height) if number == height + 1 else None,
                    )

    def newest(self) -> int:
        """The height of the newest block, -1 if there is none. UnavailableError, ClusterError."""
        return self._state()["last_seq"] - 1

    @property
    def known(self) -> int:
        """The height of the newest block that it has heard of, while it follows; -1 if none."""
        return self._newest - 1

    def offer(self, robot: str, offer_id: bytes, data: bytes) -> None:
        """Hand an offer to the servers, on several machines then. FullError kinds as ``run``."""
        self._publish(f"{OFFERS}.{token(robot)}", data, {"Nats-Msg-Id": offer_id.hex()})

    def offers_of(self, robot: str) -> int:
        """How many offers of the robot wait for a maker."""
        return sum(self.waiting(f"{OFFERS}.{token(robot)}").values())

    def waiting(self, subject: str = f"{OFFERS}.*") -> dict[str, int]:
        """How many offers wait for a maker, by robot."""
        told = self.connection.run(lambda client: _info(client, OFFERS, subject))
        found = told["state"].get("subjects") or {}
        return {name.partition(".")[2].replace("=", "."): n for name, n in found.items()}

    def say(self, head: bytes) -> None:
        """Tell the other members what this one holds; whoever listens hears it."""
        subject = f"{HEADS}.{token(self.connection.servers.name)}"
        self.connection.run(lambda client: client.publish(subject, head))

    def heads(self) -> list[tuple[str, bytes]]:
        """What members have said since this was asked last: name and message."""
        self.connection.run(self._listen)
        with self._news:
            said, self._said = self._said, []
        return said

    def refusals(self) -> list[bytes]:
        """What makers have said of this member's offers, heard while it follows, since."""
        with self._news:
            refused, self._refused = self._refused, []
        return refused

    def close(self) -> None:
        """As ``Log``, and leave the servers."""
        self.connection.close()

    def _publish(self, subject: str, data: bytes, headers: dict[str, str]) -> None:
        from nats.js.errors import NoStreamResponseError

        timeout_s = self.connection.servers.timeout_s

        async def publish(client: "Client") -> None:
            stream, until_s = client.jetstream(timeout=timeout_s), time.monotonic() + timeout_s
            while True:
                sent = stream.publish(subject, data, timeout=timeout_s, headers=headers)
                try:
                    await self.connection.permitted(subject, sent)
                    return
                except NoStreamResponseError:  # nobody has it: no leader yet, of a new stream too
                    if time.monotonic() + 2 * _AGAIN_S > until_s:
                        raise
                    await asyncio.sleep(_AGAIN_S)

        self.connection.run(publish)

    async def _listen(self, client: "Client") -> None:
        if client is self._listener:
            return
        await client.subscribe(SAID, cb=self._hear)
        await client.subscribe(f"{HEADS}.*", cb=self._hear_head)
        servers = self.connection.servers  # that ask for no key tell nobody's offers apart
        own = "*" if servers.key is None else token(servers.name)
        await client.subscribe(f"{REFUSED}.{own}", cb=self._hear_refusal)
        await client.flush()
        self._listener = client

    async def _hear(self, message: "Msg") -> None:
        number = int((message.headers or {}).get("Nats-Sequence", 0))
        with self._news:
            self._heard[number] = message.data
            self._newest = max(self._newest, number)
            while len(self._heard) > _KEPT:  # they can be asked for again
                del self._heard[max(self._heard)]
            self._news.notify_all()

    async def _hear_head(self, message: "Msg") -> None:
        name = message.subject.partition(".")[2].replace("=", ".")
        if len(message.data) > _SAID_BYTES:
            return
        with self._news:
            self._said = [*self._said[-_SAID_KEPT:], (name, message.data)]

    async def _hear_refusal(self, message: "Msg") -> None:
        if len(message.data) > _SAID_BYTES:
            return
        with self._news:
            self._refused = [*self._refused[-_SAID_KEPT:], message.data]

    def _taken(self, want: int) -> bytes | None:
        with self._news:
            for number in [number for number in self._heard if number < want]:
                del self._heard[number]
            return self._heard.pop(want, None)

    def _wait(self, want: int, until_s: float) -> bool:
        """Whether the wanted one has come before the time is over."""
        while (left_s := until_s - time.monotonic()) > 0:
            with self._news:
                if self._news.wait_for(lambda: self._newest >= want, min(left_s, _LOOK_S)):
                    return True
            self._ask_newest(want - 1)
        return False

    def _ask_newest(self, known: int) -> None:
        """Learn how far the log goes. GapError if that is less than what came from it before."""
        until_s = time.monotonic() + _LAGS_S
        while (newest := self._state()["last_seq"]) < known:  # a leader that is one no more?
            if time.monotonic() > until_s:
                leader, _ = self.connection.run(_places)
                raise GapError(
                    f"the servers' log (leader: {leader}) ends at block {newest - 1}, this folder "
                    f"at block {known - 1}: vrchain cluster put gives it back what it lost"
                )
            time.sleep(0.1)
        with self._news:
            self._newest = max(self._newest, newest)

    def _state(self) -> dict[str, Any]:
        return self.connection.run(lambda client: _info(client, BLOCKS))["state"]

    def _fetch(self, number: int) -> bytes:
        """A message from a server that answers. GapError if that has a later one only, or none."""
        until_s = time.monotonic() + _LAGS_S
        while True:
            found = self.connection.run(lambda client: _direct(client, number))
            if found is not None and found[0] == number:
                return found[1]
            if found is not None:
                raise GapError(
                    f"a server lacks block {number - 1}, and goes on with block {found[0] - 1} "
                    f"(by way of {self.connection.server}): vrchain cluster status names it"
                )
            if time.monotonic() > until_s:
                raise GapError(f"the servers of {self.connection.server} lack block {number - 1}")
            time.sleep(0.05)


def _read(data: bytes, height: int) -> Given:
    try:
        given = unpack_entry(data)
    except LedgerError as error:
        raise GapError(f"block {height} of the log is none: {error}") from None
    return given


def _readable(data: bytes | None, height: int) -> Given | None:
    try:
        return None if data is None else _read(data, height)
    except GapError:
        return None


async def _info(client: "Client", stream: str, subject: str = "") -> dict[str, Any]:
    return await ask(
        client, f"STREAM.INFO.{stream}", {"subjects_filter": subject} if subject else {}
    )


async def ask(client: "Client", what: str, asked: dict[str, Any]) -> dict[str, Any]:
    """What JetStream answers to a request of its API. APIError."""
    from nats.js.errors import APIError

    answer = await client.request(f"{API}.{what}", json.dumps(asked).encode(), timeout=5)
    told = json.loads(answer.data)
    if "error" in told:
        APIError.from_error(told["error"])
    return told


async def _places(client: "Client") -> tuple[str, list[str]]:
    cluster = (await _info(client, BLOCKS)).get("cluster") or {}
    replicas = [replica["name"] for replica in cluster.get("replicas") or []]
    return cluster.get("leader", "unknown"), replicas


async def _direct(client: "Client", number: int) -> tuple[int, bytes] | None:
    """The message of that number or the next that there is, of any server that has a replica.

    None: it has not come so far. UnavailableError.
    """
    asked = json.dumps({"seq": number, "next_by_subj": BLOCKS}).encode()
    answer = await client.request(f"{API}.DIRECT.GET.{BLOCKS}", asked, timeout=5)
    headers = answer.headers or {}
    if headers.get("Status") == "404":
        return None
    if "Status" in headers:
        raise UnavailableError(f"the servers give no block just now: {headers['Status']}")
    found = int(headers.get("Nats-Sequence", 0))
    if found < number:
        raise ClusterError(f"asked the servers for block {number - 1}, got block {found - 1}")
    return found, answer.data

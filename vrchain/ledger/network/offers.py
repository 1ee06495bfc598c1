"""The offers that wait on servers, as makers take them: all to one of several, while it asks."""

import asyncio
import json
import threading
import time
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

from vrchain.ledger.network.connection import API, Connection, token
from vrchain.ledger.network.message import pack_refusal
from vrchain.ledger.network.stream import MAKER, MAKERS, OFFERS, REFUSED

if TYPE_CHECKING:
    from nats.aio.client import Client
    from nats.aio.msg import Msg

_PIN, _ANOTHER = "Nats-Pin-Id", "423"  # ADR 42 of NATS, pinned clients
_ASK_S = 2.0  # for which the servers answer one request for offers
_PAUSE_S = 0.005  # before the next one, should they refuse it at once


class Waiting(NamedTuple):
    """An offer that a maker has taken from the servers, to acknowledge or give back."""

    robot: str
    data: bytes
    message: "Msg"


class Offers:
    """What waits for makers. Of several that take from it one is given all, until it is gone."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._client: Client | None = None  # that listens to the inbox; a closed one is replaced
        self._inbox, self._pin = "", ""  # the servers' word for the maker that is given all
        self._came: list[Waiting] = []
        self._news = threading.Condition()
        self._open, self._until_s = 0, 0.0  # how many the servers may still send, and until when

    def take(self, most: int, wait_s: float) -> list[Waiting]:
        """Offers that nobody else holds, none if none has come for ``wait_s``."""
        until_s = time.monotonic() + wait_s
        while True:
            if self._open < most or time.monotonic() > self._until_s:
                self._connection.run(lambda client: self._ask(client, most))
            with self._news:  # a request that ends meanwhile is made anew, or what comes would wait
                left_s = until_s - time.monotonic()
                self._news.wait_for(lambda: self._came or not self._open, left_s)
                if self._came or time.monotonic() > until_s:
                    taken, self._came = self._came[:most], self._came[most:]
                    return taken
            time.sleep(_PAUSE_S)

    def done(self, *offers: Waiting) -> None:
        """They are in a block, or refused: the servers forget them."""
        self._connection.run(lambda client: _each(offer.message.ack() for offer in offers))

    def refuse(self, why: str, *offers: Waiting) -> None:
        """Tell their robots, those that listen: they never come into a block, and why."""
        for offer in offers:
            named = (offer.message.headers or {}).get("Nats-Msg-Id", "")
            told = pack_refusal(named, why)
            self._connection.run(
                partial(_say, subject=f"{REFUSED}.{token(offer.robot)}", told=told)
            )

    def later(self, delay_s: float, *offers: Waiting) -> None:
        """Give them back for a while."""
        self._connection.run(lambda client: _each(o.message.nak(delay=delay_s) for o in offers))

    async def _ask(self, client: "Client", most: int) -> None:
        if client is not self._client:
            self._inbox, self._open = client.new_inbox(), 0
            await client.subscribe(self._inbox, cb=self._hear)
            self._client = client
        asked: dict[str, Any] = {"batch": most, "expires": int(_ASK_S * 1e9), "group": MAKERS}
        if self._pin:
            asked["id"] = self._pin
        subject = f"{API}.CONSUMER.MSG.NEXT.{OFFERS}.{MAKER}"
        self._open, self._until_s = self._open + most, time.monotonic() + _ASK_S
        await client.publish(subject, json.dumps(asked).encode(), reply=self._inbox)
        await client.flush()

    async def _hear(self, message: "Msg") -> None:
        with self._news:
            if message.reply.startswith("$JS.ACK."):
                robot = message.subject.partition(".")[2].replace("=", ".")
                self._came.append(Waiting(robot, message.data, message))
                self._pin = (message.headers or {}).get(_PIN, self._pin)
                self._open -= 1
                self._news.notify_all()
            else:  # a request has ended
                self._open = 0
                self._news.notify_all()
                if (message.headers or {}).get("Status") == _ANOTHER:
                    self._pin = ""


async def _each(work: Any) -> None:
    await asyncio.gather(*work)


async def _say(client: "Client", subject: str, told: bytes) -> None:
    await client.publish(subject, told)

"""A stream that nobody answers for is asked again, and only then."""

import asyncio
from types import SimpleNamespace
from typing import Any

import pytest
from ledgers import new_chain, next_entry
from nats.js.errors import APIError, NoStreamResponseError

from vrchain.ledger.network import stream as stream_module
from vrchain.ledger.network.stream import Stream

BLOB = b"payload"


class Servers:
    """Connection and client in one: ``publish`` fails by these errors first."""

    def __init__(self, *errors: Exception) -> None:
        self.servers, self.errors, self.sent = SimpleNamespace(timeout_s=1.0), list(errors), []

    def jetstream(self, timeout: float) -> "Servers":
        return self

    async def publish(self, subject: str, data: bytes, **rest: Any) -> None:
        self.sent.append((subject, data, rest["headers"]))
        if self.errors:
            raise self.errors.pop(0)

    async def permitted(self, subject: str, sent: Any) -> Any:
        return await sent

    def run(self, work: Any) -> Any:
        return asyncio.run(work(self))


@pytest.fixture(autouse=True)
def no_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stream_module, "_AGAIN_S", 0.01)


def offered(servers: Servers) -> None:
    Stream(servers).offer("R1", b"id", BLOB)  # type: ignore[arg-type]


def test_what_nobody_answers_for_is_published_again_and_is_the_same() -> None:
    servers = Servers(NoStreamResponseError(), NoStreamResponseError())
    offered(servers)
    assert servers.sent == 3 * [("offer.R1", BLOB, {"Nats-Msg-Id": b"id".hex()})]


def test_a_block_goes_out_again_after_the_same_one() -> None:
    entry, servers = next_entry(new_chain()), Servers(NoStreamResponseError())
    Stream(servers).append(entry, {}, 0)  # type: ignore[arg-type]
    first, second = servers.sent
    assert first == second and first[2]["Nats-Expected-Last-Sequence"] == "1"


def test_what_was_refused_is_not_published_again() -> None:
    servers = Servers(APIError(code=400, description="no"))
    with pytest.raises(APIError):
        offered(servers)
    assert len(servers.sent) == 1


def test_it_ends_within_the_time_out() -> None:
    servers = Servers(*[NoStreamResponseError() for _ in range(1000)])
    with pytest.raises(NoStreamResponseError):
        offered(servers)
    assert servers.errors and len(servers.sent) > 2

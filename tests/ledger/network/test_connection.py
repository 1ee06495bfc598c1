"""What servers answer, as an error of ours: to wait, to go on from elsewhere, or to mend."""

import contextlib
import time
from pathlib import Path

import pytest
from clusters import pretended

from vrchain.ledger import errors
from vrchain.ledger.network import connection as module
from vrchain.ledger.network.connection import Connection, Servers
from vrchain.ledger.network.stream import Stream


@pytest.mark.parametrize(
    ("code", "number", "text", "kind", "told"),
    [
        (409, 10158, "duplicate message id is in process", errors.UnavailableError, "already"),
        (400, 10071, "wrong last sequence: 7", errors.OvertakenError, "another block"),
        (404, 10059, "stream not found", errors.ClusterError, "hold no ledger"),
        (404, 10014, "consumer not found", errors.ClusterError, "hold no ledger"),
        (500, 10023, "insufficient resources", errors.ClusterError, "are full"),
        (500, 10047, "insufficient storage resources available", errors.ClusterError, "make room"),
        (400, 10003, "bad request", errors.ClusterError, "refuse: bad request"),
        (503, 10008, "JetStream system temporarily unavailable", errors.UnavailableError, "answer"),
    ],
)
def test_answers(
    code: int, number: int, text: str, kind: type[errors.LedgerError], told: str
) -> None:
    """A message that servers are writing already is no refusal: whoever sends it waits."""
    js = pytest.importorskip("nats.js.errors")

    async def answered(client: object) -> None:
        js.APIError.from_error({"code": code, "err_code": number, "description": text})

    with contextlib.closing(Connection(Servers(("nats://127.0.0.1:1",)))) as connection:

        async def connected(within_s: float) -> object:
            return object()

        connection._connected = connected  # type: ignore[method-assign, assignment]
        with pytest.raises(kind, match=told):
            connection.run(answered)


@pytest.mark.parametrize("host", ["127.0.0.1:abc", "127.0.0.1:99999", "[::1", "a]b"])
def test_an_address_that_is_none_is_not_waited_for(host: str) -> None:
    with pytest.raises(errors.ClusterError, match="expected HOST or HOST:PORT, got"):
        Servers.at(f"nats://10.0.0.1,{host}")


@pytest.mark.parametrize("content", [None, "no certificate"])
def test_certificates_that_cannot_be_read_are_not_waited_for(
    content: str | None, tmp_path: Path
) -> None:
    pytest.importorskip("nats")
    if content is not None:
        (tmp_path / "ca.pem").write_text(content)
    servers = Servers.at("tls://127.0.0.1:1", ca=tmp_path / "ca.pem", timeout_s=1.0)
    with (
        contextlib.closing(Connection(servers)) as connection,
        pytest.raises(errors.ClusterError, match=r"cannot read certificates in .*ca\.pem"),
    ):
        connection.run(lambda client: client.flush())


def test_a_server_that_hangs_is_left_though_it_takes_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What is unsent would be waited for until TCP gives up, which it never does."""
    pytest.importorskip("nats")
    monkeypatch.setattr(module, "_PING_S", 0.3)
    with pretended({}, hangs=True) as hung, pretended({}) as good:
        hosts = f"{hung},{good.removeprefix('nats://')}"
        stream = Stream(Connection(Servers.at(hosts, timeout_s=1.0, in_order=True)))
        try:
            until_s = time.monotonic() + 30
            while not good.endswith(stream.connection.server):
                with contextlib.suppress(errors.UnavailableError):
                    stream.offer("R1", bytes(32), bytes(4_000_000))
                assert time.monotonic() < until_s, stream.connection.server
        finally:
            stream.close()


def test_it_leaves_a_server_that_hangs() -> None:
    pytest.importorskip("nats")
    with pretended({}, hangs=True) as address:
        stream = Stream(Connection(Servers.at(address, timeout_s=0.5)))
        with pytest.raises(errors.UnavailableError):
            stream.offer("R1", bytes(32), bytes(4_000_000))
        stream.close()
    assert not stream.connection._thread.is_alive()

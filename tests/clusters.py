"""Servers for the tests, makers in a thread, and a way to be cut off from the network."""

import contextlib
import importlib.util
import json
import socket
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import pytest
from ledgers import KEYS

from vrchain.errors import VRChainError
from vrchain.ledger import Limits, SigningKey
from vrchain.ledger.cluster.servers import Cluster, find_server
from vrchain.ledger.errors import LogError
from vrchain.ledger.network.connection import Connection, Servers
from vrchain.ledger.network.maker import Maker
from vrchain.ledger.network.offers import Offers
from vrchain.ledger.network.opening import follow_servers
from vrchain.ledger.network.stream import BLOCKS, OFFERS
from vrchain.ledger.rules.limits import UNLIMITED

PATIENCE_S = 60.0  # for what takes a second on a machine with nothing else to do


def skip_without_servers() -> None:
    """Skip the test where the extra ``cluster`` is not installed."""
    if importlib.util.find_spec("nats") is None:
        pytest.skip("the extra `cluster` is not installed: nats-py")
    try:
        find_server()
    except VRChainError as error:
        pytest.skip(str(error))


def eventually(met: Callable[[], object], what: str = "", timeout_s: float = PATIENCE_S) -> None:
    """Until it is so; what it was to be, if it never is."""
    until_s = time.monotonic() + timeout_s
    while not met():
        assert time.monotonic() < until_s, what or met
        time.sleep(0.01)


def emptied(cluster: Cluster, key: SigningKey | None = None) -> None:
    """The ledger's streams made anew, with nothing in them."""

    async def delete(client: object) -> None:
        stream = client.jetstream()  # type: ignore[attr-defined]
        for name in (BLOCKS, OFFERS):
            with contextlib.suppress(Exception):
                await stream.delete_stream(name)

    with Connection(Servers.at(cluster.address, key=key, name="operator")) as connection:
        connection.run(delete, 20)
    cluster.set_up(key, "operator")


@contextlib.contextmanager
def pretended(greeting: Mapping[str, object], hangs: bool = False) -> Iterator[str]:
    """The address of what greets as a server does, and answers pings alone.

    hangs: after the first it takes nothing more, and its machine acknowledges that.
    """
    usual = {"version": "2.15.1", "headers": True, "max_payload": 8 << 20, "jetstream": True}
    with contextlib.ExitStack() as stack:
        listener = stack.enter_context(socket.create_server(("127.0.0.1", 0)))

        def serve() -> None:
            with contextlib.suppress(OSError):
                while True:
                    connection = stack.enter_context(listener.accept()[0])
                    connection.sendall(f"INFO {json.dumps({**usual, **greeting})}\r\n".encode())
                    threading.Thread(target=answer, args=(connection,), daemon=True).start()

        def answer(connection: socket.socket) -> None:
            with contextlib.suppress(OSError):
                while data := connection.recv(1 << 12):
                    if b"PING" in data:
                        connection.sendall(b"PONG\r\n")
                        if hangs:
                            return

        threading.Thread(target=serve, daemon=True).start()
        yield f"nats://127.0.0.1:{listener.getsockname()[1]}"


@contextlib.contextmanager
def making(
    address: str, folder: Path, author: str = "R2", limits: Limits = UNLIMITED, signs: bool = False
) -> Iterator[Maker]:
    """A maker at work in a thread, with its own folder."""
    key = KEYS[author]
    servers = Servers.at(address, key=key if signs else None, name=author)
    ends = threading.Event()
    ready: list[Maker] = []

    def work() -> None:
        ledger, stream = follow_servers(servers, folder)
        with ledger, contextlib.closing(stream):
            ready.append(Maker(ledger, Offers(stream.connection), author, key, limits=limits))
            while not ends.is_set():
                with contextlib.suppress(LogError):
                    ready[0].turn(0.1)

    thread = threading.Thread(target=work)
    thread.start()
    try:
        eventually(lambda: ready or not thread.is_alive())
        yield ready[0]
    finally:
        ends.set()
        thread.join()


class Proxy:
    """Stands between a robot and one server; ``cut`` ends what goes through, until ``mend``."""

    def __init__(self, address: str) -> None:
        host, _, port = address.rpartition("//")[2].rpartition(":")
        self._there = host, int(port)
        self._is_cut = False
        self._pairs: list[tuple[socket.socket, socket.socket]] = []
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"nats://127.0.0.1:{self._listener.getsockname()[1]}"
        threading.Thread(target=self._welcome, daemon=True).start()

    def cut(self) -> None:
        self._is_cut = True
        for pair in self._pairs:
            for each in pair:
                with contextlib.suppress(OSError):
                    each.shutdown(socket.SHUT_RDWR)
        self._pairs.clear()

    def mend(self) -> None:
        self._is_cut = False

    def close(self) -> None:
        self.cut()
        self._listener.close()

    def _welcome(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                here, _ = self._listener.accept()
                if self._is_cut:
                    here.close()
                    continue
                there = socket.create_connection(self._there)
                self._pairs.append((here, there))
                for a, b in ((here, there), (there, here)):
                    threading.Thread(target=self._carry, args=(a, b), daemon=True).start()

    def _carry(self, source: socket.socket, sink: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(1 << 16):
                sink.sendall(data)
        for each in (source, sink):
            with contextlib.suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)

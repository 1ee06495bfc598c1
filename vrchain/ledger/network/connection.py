"""A connection to NATS servers, for callers without an event loop; its errors in words.

A robot shows who it is with the key that it signs transactions with. The servers' challenge is
short text without control bytes, and anything else is not signed: no record is such text.
"""

import asyncio
import base64
import binascii
import re
import ssl
import threading
from collections.abc import Awaitable, Callable, Coroutine, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar
from urllib.parse import urlsplit

from vrchain.extras import require
from vrchain.ledger.errors import (
    ClusterError,
    OvertakenError,
    SignatureError,
    TooLargeError,
    UnavailableError,
)
from vrchain.ledger.records.keys import PublicKey, SigningKey
from vrchain.ledger.storage.closing import Closing

if TYPE_CHECKING:
    from nats.aio.client import Client

OLDEST_SERVER = (2, 12, 0)
API = "vrchain.API"  # NATS's own, $JS.API, means the streams of who asks, and members have none
_USER = 20 << 3  # what the 'U' before a user's key stands for
_CHALLENGE = re.compile(r"[A-Za-z0-9_=-]{1,64}")
_PENDING_BYTES = 1 << 25
_COMPLAINTS = 20
_PING_S = 5.0  # two without an answer, and a server is gone
_SLACK_S = 5.0  # for the loop's own doings, beyond what an operation may take

# The servers' error codes: https://github.com/nats-io/nats-server, server/errors.json.
_WRONG_LAST, _NO_STREAM, _NO_CONSUMER, _IN_PROCESS = 10071, 10059, 10014, 10158
_FULL = {10023, 10028, 10047, 10077}

T = TypeVar("T")


@dataclass(frozen=True)
class Servers:
    """Where a team's servers are, and how one shows who it is.

    ``key``, ``name``: of the member or operator; without, they have to let in anyone. ``ca``: a
    file of certificates to trust, for ``tls://`` addresses; the system's if none is given.
    ``in_order``: the first address is tried first, else any, so that robots spread.
    """

    addresses: tuple[str, ...]
    key: SigningKey | None = None
    name: str = "anyone"
    ca: Path | None = None
    timeout_s: float = 5.0
    in_order: bool = False

    @classmethod
    def at(cls, address: str, **rest: Any) -> "Servers":
        """Of ``nats://host,host:port``; ``tls://`` for encrypted ones. ClusterError."""
        scheme, _, hosts = address.partition("://")
        found = [host.strip() for host in hosts.split(",")]
        if scheme not in ("nats", "tls") or not all(
            re.fullmatch(r"[\w.\[\]:-]+", h) for h in found
        ):
            raise ClusterError(f"expected nats://HOST,HOST,HOST or tls://..., got {address!r:.200}")
        for host in found:
            try:
                _ = urlsplit(f"{scheme}://{host}").port
            except ValueError as error:
                raise ClusterError(f"expected HOST or HOST:PORT, got {host!r}: {error}") from None
        return cls(tuple(f"{scheme}://{host}" for host in found), **rest)


def token(name: str) -> str:
    """A member's name within a subject, whose parts end at a dot."""
    return name.replace(".", "=")


def nkey(key: PublicKey) -> str:
    """The public key as NATS writes a user's."""
    raw = bytes([_USER]) + key.raw
    raw += binascii.crc_hqx(raw, 0).to_bytes(2, "little")  # CRC-16/XMODEM
    return base64.b32encode(raw).decode().rstrip("=")


class Connection(Closing):
    """To whichever server answers; it finds another when that one is gone. Use ``with``.

    Nothing is asked of the network before the first ``run``.
    """

    def __init__(self, servers: Servers) -> None:
        require("nats", what="nats://", error=ClusterError)
        self.servers = servers
        self.complaints: list[str] = []  # the servers' newest, of what they do not permit too
        self._client: Client | None = None
        self._refused: dict[str, asyncio.Future[None]] = {}
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self._lock = asyncio.Lock()

    @property
    def server(self) -> str:
        """The address of the one that it is connected to, "none" if it is to none."""
        client = self._client
        url = client.connected_url if client is not None and client.is_connected else None
        return url.netloc if url is not None else "none"

    def run(
        self, work: Callable[["Client"], Coroutine[Any, Any, T]], timeout_s: float | None = None
    ) -> T:
        """What ``work`` gives, which is awaited with the connected client in the loop's thread.

        Raises UnavailableError, ClusterError, OvertakenError.
        """
        import nats.errors

        within_s = self.servers.timeout_s if timeout_s is None else timeout_s
        if self._loop.is_closed():
            raise UnavailableError("the connection is closed")
        task = asyncio.run_coroutine_threadsafe(self._within(work, within_s), self._loop)
        try:
            return task.result(2 * within_s + _SLACK_S)
        except (nats.errors.Error, OSError, TimeoutError) as error:
            raise self._said(error) from None
        finally:
            task.cancel()

    async def permitted(self, subject: str, work: Awaitable[T]) -> T:
        """What ``work``, which publishes to ``subject``, gives; ClusterError if that is refused."""
        refused = self._refused.setdefault(subject, self._loop.create_future())
        answer = asyncio.ensure_future(work)
        try:
            either: set[asyncio.Future[Any]] = {answer, refused}
            await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
            if not answer.done():
                raise ClusterError(
                    f"the servers do not permit {self.servers.name} to publish to {subject}; "
                    "vrchain cluster config writes who may do what"
                )
            return answer.result()
        finally:
            answer.cancel()
            self._refused.pop(subject, None)

    def close(self) -> None:
        """Leave; closing twice does no harm."""
        if self._loop.is_closed():
            return
        asyncio.run_coroutine_threadsafe(self._leave(), self._loop).result(_SLACK_S)
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    async def _leave(self) -> None:
        others = asyncio.all_tasks() - {asyncio.current_task()}
        if self._client is not None:
            closing = asyncio.ensure_future(self._client.close())
            while not (await asyncio.wait([closing], timeout=0.2))[0]:
                _let_go(self._client)
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)

    async def _within(
        self, work: Callable[["Client"], Coroutine[Any, Any, T]], within_s: float
    ) -> T:
        client = await self._connected(within_s)
        return await asyncio.wait_for(work(client), within_s)

    async def _connected(self, within_s: float) -> "Client":
        async with self._lock:
            if self._client is None or self._client.is_closed:
                self._client = await self._connect(within_s)
        until = self._loop.time() + within_s
        while not self._client.is_connected:  # what is sent meanwhile would be kept and sent later
            if self._loop.time() > until:
                raise TimeoutError
            _let_go(self._client)
            await asyncio.sleep(0.02)
        return self._client

    async def _connect(self, within_s: float) -> "Client":
        from nats.aio.client import Client

        servers, client, last = self.servers, Client(), list[Exception]()

        async def heard(error: Exception) -> None:
            if not any("authorization" in str(known).lower() for known in last):
                last[:] = [error]  # who is not let in is hung up on, and tries again
            self.complaints = [*self.complaints[-_COMPLAINTS:], str(error)]
            for subject, refused in self._refused.items():
                if f'publish to "{subject}"'.lower() in str(error).lower() and not refused.done():
                    refused.set_result(None)

        options: dict[str, Any] = {}
        if servers.key is not None:
            key = servers.key
            options["signature_cb"] = lambda challenge: _signed(key, challenge)
            client._public_nkey = nkey(key.public)  # its own way wants one more library
        if servers.addresses[0].startswith("tls:"):
            try:
                options["tls"] = ssl.create_default_context(cafile=servers.ca)
            except OSError as error:
                raise ClusterError(f"cannot read certificates in {servers.ca}: {error}") from None
        connecting = client.connect(
            list(servers.addresses),
            error_cb=heard,
            dont_randomize=servers.in_order,
            name=servers.name,
            connect_timeout=max(1, round(within_s)),
            reconnect_time_wait=0.2,  # type: ignore[arg-type]
            max_reconnect_attempts=-1,
            ping_interval=_PING_S,  # type: ignore[arg-type]
            max_outstanding_pings=2,
            inbox_prefix=f"_INBOX.{token(servers.name)}",
            pending_size=_PENDING_BYTES,
            **options,
        )
        try:
            await asyncio.wait_for(connecting, within_s)
        except TimeoutError:
            await client.close()
            raise (last[-1] if last else TimeoutError()) from None
        version = client.connected_server_version
        if (version.major, version.minor, version.patch) < OLDEST_SERVER:
            await client.close()
            raise ClusterError(
                f"expected NATS servers of version {_dotted(OLDEST_SERVER)} or later, got "
                f"{_dotted((version.major, version.minor, version.patch))} at "
                f"{', '.join(servers.addresses)}: install a newer one; a distribution's may be old"
            )
        if not client._server_info.get("jetstream"):  # its own way asks more than members may
            await client.close()
            raise ClusterError(
                f"expected servers with JetStream at {', '.join(servers.addresses)}, got some "
                "without: vrchain cluster config writes their configuration"
            )
        return client

    def _said(self, error: Exception) -> Exception:
        """The error of ours for one of theirs."""
        import nats.errors
        import nats.js.errors as js

        where, code = ", ".join(self.servers.addresses), getattr(error, "err_code", None)
        told = str(error).lower()
        if isinstance(error, nats.errors.AuthorizationError) or "authorization" in told:
            return ClusterError(
                f"{where} let nobody in as {self.servers.name}: give the key of a member that "
                "vrchain cluster config has written down"
            )
        if isinstance(error, nats.errors.MaxPayloadError):
            return TooLargeError(f"{where} take less at once: set max_payload to 8MB")
        if code == _WRONG_LAST:
            return OvertakenError("another block was appended first")
        if code in (_NO_STREAM, _NO_CONSUMER):
            return ClusterError(f"{where} hold no ledger: vrchain cluster put LEDGER {where}")
        if code in _FULL:
            return ClusterError(
                f"{where} are full ({getattr(error, 'description', '')}): make room"
            )
        if code == _IN_PROCESS:  # an earlier try is not through yet
            return UnavailableError(f"{where}: the same is being written already")
        if isinstance(error, js.APIError) and getattr(error, "code", 503) not in (503, None):
            return ClusterError(f"{where} refuse: {getattr(error, 'description', error)}")
        if isinstance(error, nats.errors.NoRespondersError | js.NoStreamResponseError):
            return UnavailableError(f"{where}: no ledger, or no majority of the servers just now")
        why = f" ({error})" if isinstance(error, OSError) and str(error) else ""
        return UnavailableError(
            f"no answer from {where}{why}; what waits goes out once there is one"
        )


def _signed(key: SigningKey, challenge: str) -> bytes:
    if not _CHALLENGE.fullmatch(challenge):
        raise SignatureError(f"expected a server's challenge, got {challenge!r:.80}")
    return base64.b64encode(key.sign(challenge.encode()))


def _dotted(version: Sequence[int]) -> str:
    return ".".join(map(str, version))


def _let_go(client: "Client") -> None:
    """A connection that is closing ends at once: a server that hangs never takes what is unsent."""
    writer = getattr(client._transport, "_io_writer", None)
    if writer is not None and writer.is_closing():
        writer.transport.abort()

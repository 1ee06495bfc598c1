"""Opens a ledger wherever it is: a folder, or servers that a folder of one's own follows."""

import os
from collections.abc import Sequence
from pathlib import Path

from vrchain.ledger.errors import ClusterError
from vrchain.ledger.network.connection import Connection, Servers
from vrchain.ledger.network.log import FolderLog
from vrchain.ledger.network.replicated import Replicated
from vrchain.ledger.network.robot import RobotLedger
from vrchain.ledger.network.stream import Stream
from vrchain.ledger.records.keys import SigningKey
from vrchain.ledger.store import Ledger


def is_servers(address: str | os.PathLike[str]) -> bool:
    """Whether it names servers rather than a folder."""
    return str(address).startswith(("nats:", "tls:"))


def open_ledger(
    address: str | os.PathLike[str],
    folder: str | os.PathLike[str] | None = None,
    *,
    writable: bool = True,
    key: SigningKey | None = None,
    name: str = "anyone",
    ca: Path | None = None,
    others: Sequence[str | os.PathLike[str]] = (),
    timeout_s: float = 5.0,
) -> Ledger:
    """The ledger in a folder, or for ``nats://HOST,HOST,HOST`` a ``RobotLedger`` in ``folder``.

    ``folder``: this machine's own copy, made if it is not there; no other process publishes from
    it. ``key``, ``name``: of the member, where servers ask. ``others``: folders to look in for
    blocks that the servers have lost. Without servers the folder is opened all the same, and what
    is published waits; only a new folder needs them.

    Raises ClusterError, UnavailableError, and as ``Ledger.open``.
    """
    if not is_servers(address):
        return Ledger.open(address, writable)
    if folder is None:
        raise ClusterError("expected the folder of this machine's copy beside nats://, got none")
    servers = Servers.at(str(address), key=key, name=name, ca=ca, timeout_s=timeout_s)
    stream = Stream(Connection(servers))
    sources = [FolderLog(Path(other), writable=False) for other in others]
    try:
        made = RobotLedger.join(Path(folder), stream, sources)
        try:
            made.start(stream, stream, sources)
        except BaseException:
            made.close()
            raise
    except BaseException:
        stream.connection.close()
        raise
    return made


def follow_servers(servers: Servers, folder: Path) -> tuple[Replicated, Stream]:
    """A folder that follows servers when it is told to, and their log; close both after use."""
    stream = Stream(Connection(servers))
    try:
        return Replicated.join(folder, stream), stream
    except BaseException:
        stream.connection.close()
        raise

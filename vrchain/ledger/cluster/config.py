"""The configuration of the servers that carry a team's ledger: what they hold to, who may do what.

Each setting is explained in docs/how-to/deployment.md.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vrchain.ledger.network.connection import nkey, token
from vrchain.ledger.network.stream import BLOCKS, HEADS, MAKER, OFFERS, SAID
from vrchain.ledger.records.keys import PublicKey

CLUSTER_NAME = "vrchain"
_READS = (f"$JS.API.DIRECT.GET.{BLOCKS}", f"$JS.API.STREAM.INFO.{BLOCKS}")


@dataclass(frozen=True)
class Node:
    """One server: where clients, the other servers and the monitor's readers find it."""

    name: str
    host: str
    port: int
    route_port: int
    monitor_port: int

    @property
    def address(self) -> str:
        """For clients."""
        return f"{self.host}:{self.port}"


@dataclass(frozen=True)
class Tls:
    """Files of a server's certificate and key, and of the authority that signed it."""

    certificate: Path
    key: Path
    authority: Path


@dataclass(frozen=True)
class Users:
    """Who is let in: the operator, members, and those of them that make blocks."""

    operator: PublicKey
    members: Mapping[str, PublicKey]
    makers: frozenset[str]

    def permissions(self) -> list[dict[str, Any]]:
        """The users as the servers' configuration has them."""
        found = [{"nkey": nkey(self.operator), "permissions": {"publish": ">", "subscribe": ">"}}]
        for name, key in sorted(self.members.items()):
            found.append(
                {"nkey": nkey(key), "permissions": _permissions(name, name in self.makers)}
            )
        return found


def _permissions(name: str, makes: bool) -> dict[str, Any]:
    own = token(name)
    publish = [
        f"{OFFERS}.{own}",
        f"{HEADS}.{own}",
        *_READS,
        f"$JS.API.STREAM.MSG.GET.{BLOCKS}",
        f"$JS.API.STREAM.INFO.{OFFERS}",
    ]
    if makes:
        publish += [BLOCKS, f"$JS.API.CONSUMER.MSG.NEXT.{OFFERS}.{MAKER}"]
        publish += [f"$JS.ACK.{OFFERS}.{MAKER}.>"]
    subscribe = [f"_INBOX.{own}.>", SAID, f"{HEADS}.*"]
    return {"publish": {"allow": publish}, "subscribe": {"allow": subscribe}}


def server_config(
    node: Node,
    nodes: Sequence[Node],
    store: Path,
    users: Users | None = None,
    tls: Tls | None = None,
) -> str:
    """The configuration file of one of several servers.

    Without ``users`` anyone who reaches it may do anything: for one machine and tests.
    """
    config: dict[str, Any] = {
        "server_name": node.name,
        "listen": node.address,
        "http": f"{node.host if tls is None else '127.0.0.1'}:{node.monitor_port}",
        "max_payload": 8 << 20,
        "write_deadline": "10s",
        "jetstream": {"store_dir": str(store), "sync_interval": "always"},
    }
    if len(nodes) > 1:
        config["cluster"] = {
            "name": CLUSTER_NAME,
            "listen": f"{node.host}:{node.route_port}",
            "no_advertise": True,  # robots use the addresses that they are given
            "routes": [f"nats://{other.host}:{other.route_port}" for other in nodes],
        }
    if users is not None:
        config["authorization"] = {"users": users.permissions()}
    if tls is not None:
        files = {"cert_file": str(tls.certificate), "key_file": str(tls.key)}
        files["ca_file"] = str(tls.authority)
        config["tls"] = files
        if len(nodes) > 1:  # servers show theirs to each other
            config["cluster"]["tls"] = {**files, "verify": True}
    return json.dumps(config, indent=2) + "\n"  # which the servers read too

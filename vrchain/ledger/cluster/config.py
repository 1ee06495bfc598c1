"""The configuration of the servers that carry a team's ledger: what they hold to, who may do what.

Each setting is explained in docs/how-to/deployment.md.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from vrchain.ledger.network.connection import API, nkey, token
from vrchain.ledger.network.stream import BLOCKS, HEADS, MAKER, OFFERS, REFUSED, SAID
from vrchain.ledger.records.keys import PublicKey

CLUSTER_NAME, _SERVER = "vrchain", "server"
_MAPPINGS = {f"{API}.>": "$JS.API.>"}
_LEDGER = "ledger"  # the account that holds the streams
_ASKED = (
    f"{API}.DIRECT.GET.{BLOCKS}",
    f"{API}.STREAM.MSG.GET.{BLOCKS}",
    f"{API}.STREAM.INFO.{BLOCKS}",
    f"{API}.STREAM.INFO.{OFFERS}",
)
_TAKEN = f"{API}.CONSUMER.MSG.NEXT.{OFFERS}.{MAKER}"  # a request that has several answers
_MADE = (BLOCKS, f"$JS.ACK.{OFFERS}.{MAKER}.>", _TAKEN)


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

    @classmethod
    def of(cls, folder: Path, name: str) -> "Tls":
        """Those of a server in a folder of NAME.crt, NAME.key and ca.crt."""
        return cls(folder / f"{name}.crt", folder / f"{name}.key", folder / "ca.crt")


@dataclass(frozen=True)
class Users:
    """Who is let in: the operator, members, and those of them that make blocks."""

    operator: PublicKey
    members: Mapping[str, PublicKey]
    makers: frozenset[str]

    def accounts(self) -> dict[str, Any]:
        """The servers' accounts: one of the streams and the operator, and one of each member.

        A member reaches the streams by what its account imports, and in no other way: an answer
        that it has sent to a stream's subject ends in its own account, where no stream is.
        """
        everything = {"publish": ">", "subscribe": ">"}
        services = [{"service": subject} for subject in (f"{OFFERS}.*", *_ASKED, *_MADE[:-1])]
        services.append({"service": _TAKEN, "response_type": "stream"})
        found: dict[str, Any] = {
            _LEDGER: {
                "jetstream": "enabled",
                "mappings": _MAPPINGS,
                "users": [{"nkey": nkey(self.operator), "permissions": everything}],
                "exports": [*services, {"stream": SAID}],
            }
        }
        for name, key in sorted(self.members.items()):
            found[_account(name)] = self._member(name, nkey(key))
        return found

    def _member(self, name: str, nkey: str) -> dict[str, Any]:
        own, makes = token(name), name in self.makers
        asks = [f"{OFFERS}.{own}", *_ASKED, *(_MADE if makes else ())]
        tells = [f"{HEADS}.{own}", *([f"{REFUSED}.*"] if makes else [])]
        hears = [SAID, f"{HEADS}.*", f"{REFUSED}.{own}"]
        others = [(f"{HEADS}.{token(other)}", other) for other in self.members if other != name]
        others += [(f"{REFUSED}.{own}", maker) for maker in self.makers if maker != name]
        allowed = {
            "publish": {"allow": [*asks, *tells]},
            "subscribe": {"allow": [f"_INBOX.{own}.>", *hears]},
        }
        return {
            "users": [{"nkey": nkey, "permissions": allowed}],
            "exports": [{"stream": subject} for subject in tells],
            "imports": [
                *({"service": {"account": _LEDGER, "subject": subject}} for subject in asks),
                {"stream": {"account": _LEDGER, "subject": SAID}},
                *(
                    {"stream": {"account": _account(of), "subject": subject}}
                    for subject, of in sorted(others)
                ),
            ],
        }


def _account(member: str) -> str:
    return f"robot-{token(member)}"


def server_config(
    node: Node,
    nodes: Sequence[Node],
    store: Path,
    users: Users | None = None,
    tls: Tls | None = None,
    secret: str = "",
) -> str:
    """The configuration file of one of several servers.

    Without ``users`` anyone who reaches it may do anything: for one machine and tests. ``secret``:
    by which servers know each other where they have no certificates, of letters and digits.
    """
    config: dict[str, Any] = {
        "server_name": node.name,
        "listen": node.address,
        "http" if tls is None else "https": f"{node.host}:{node.monitor_port}",
        "max_payload": 8 << 20,
        "write_deadline": "10s",
        "jetstream": {"store_dir": str(store), "sync_interval": "always"},
    }
    if len(nodes) > 1:
        own = f"{_SERVER}:{secret}@" if secret and tls is None else ""
        config["cluster"] = {
            "name": CLUSTER_NAME,
            "listen": f"{node.host}:{node.route_port}",
            "no_advertise": True,  # robots use the addresses that they are given
            "routes": [f"nats://{own}{other.host}:{other.route_port}" for other in nodes],
        }
        if own:  # or whoever reaches this port is a server, and a server may do anything
            config["cluster"]["authorization"] = {"user": _SERVER, "password": secret}
    config |= {"mappings": _MAPPINGS} if users is None else {"accounts": users.accounts()}
    if tls is not None:
        files = {"cert_file": str(tls.certificate), "key_file": str(tls.key)}
        files["ca_file"] = str(tls.authority)
        config["tls"] = files
        if len(nodes) > 1:  # servers show theirs to each other
            config["cluster"]["tls"] = {**files, "verify": True}
    return json.dumps(config, indent=2) + "\n"  # which the servers read too

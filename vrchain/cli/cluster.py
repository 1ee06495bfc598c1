"""The command ``vrchain cluster``: servers that carry a team's ledger; ``ledger watch``."""

import contextlib
import json
import secrets
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from vrchain.cli.ledger_keys import member_key, signer
from vrchain.cli.options import Folder, Json, doing
from vrchain.files import check_output_folder, output_folder
from vrchain.ledger import OPERATOR, Ledger
from vrchain.ledger.cluster.config import Node, Tls, Users, server_config
from vrchain.ledger.cluster.servers import CONFIGURED, MARKER, Cluster
from vrchain.ledger.errors import ClusterError, GapError, OvertakenError, UnavailableError
from vrchain.ledger.export import entry_json
from vrchain.ledger.network.connection import Connection, Servers
from vrchain.ledger.network.log import check_is_part_of
from vrchain.ledger.network.log import put as put_blocks
from vrchain.ledger.network.maker import Maker
from vrchain.ledger.network.offers import Offers
from vrchain.ledger.network.opening import follow_servers, open_ledger
from vrchain.ledger.network.robot import RobotLedger
from vrchain.ledger.network.set_up import MOST_REPLICAS, set_up
from vrchain.ledger.network.stream import Stream
from vrchain.ledger.network.watching import watched
from vrchain.ledger.records.fields import check_name
from vrchain.ledger.rules.limits import UNLIMITED, Limits

app = typer.Typer(no_args_is_help=True, help="Servers that carry a team's ledger.")

T = TypeVar("T")

_PORT, _ROUTE_PORT, _MONITOR_PORT = 4222, 6222, 8222
_COUNTS = (1, 3, 5)  # of machines: one more than an odd number bears no more failures

Home = Annotated[Path, typer.Option("-o", "--output", metavar="DIR", help="The cluster's folder.")]
Address = Annotated[
    str, typer.Argument(metavar="SERVERS", help="nats://HOST,HOST,HOST or tls://...")
]
OfLedger = Annotated[
    Path | None, typer.Option("--ledger", metavar="LEDGER", help="Let in its members alone.")
]
Makers = Annotated[
    list[str] | None,
    typer.Option("--maker", metavar="NAME", help="A member that makes blocks; one for each."),
]
Keys = Annotated[Path | None, typer.Option(help="Folder of the signing keys.")]
Simulated = Annotated[
    int | None, typer.Option(metavar="SEED", help="Sign with the keys of a simulation.")
]
Authority = Annotated[
    Path | None, typer.Option("--ca", metavar="FILE", help="Certificates to trust, for tls://.")
]
Anonymous = Annotated[
    bool, typer.Option("--anonymous", help="Show no key: the servers let in anyone.")
]


@app.command()
def up(
    output: Home,
    nodes: Annotated[int | None, typer.Option(min=1, max=9, help="How many servers [3].")] = None,
    ledger: OfLedger = None,
    maker: Makers = None,
    keys: Keys = None,
    simulated: Simulated = None,
    host: Annotated[str | None, typer.Option(help="That they listen on [127.0.0.1].")] = None,
    as_json: Json = False,
) -> None:
    """Start servers on this machine, of which everything is in DIR; a cluster there goes on.

    They let in anyone on this machine, or the members of a ledger alone: those that it has now, and
    these makers. They run on until `vrchain cluster down`.
    """
    if maker and ledger is None:
        raise ClusterError("--maker needs --ledger: without, servers let anyone make blocks")
    there = Cluster.load(output) if (output / MARKER).exists() else None
    users, key, ledger_id = None, None, ""
    with contextlib.nullcontext() if ledger is None else Ledger.open(ledger) as opened:
        if opened is not None:
            ledger_id = opened.genesis.id.hex()
        if there is not None:
            _check_same(there, output, nodes, host, ledger_id)
        if opened is not None:
            users, key = _users(opened, maker), signer(opened, keys, OPERATOR, simulated)
    if there is not None and users is not None and not there.lets_in(users):
        there.let_in(users)
    cluster = there or Cluster.make(output, nodes or 3, users, host or "127.0.0.1", ledger_id)
    before = {node.name for node in cluster.nodes if cluster.process(node.name)}
    try:
        with doing(f"starting {len(cluster.nodes)} servers"):
            cluster.start()
            cluster.wait_ready()
            cluster.set_up(key, OPERATOR)
    except BaseException:
        cluster.stop(*({node.name for node in cluster.nodes} - before or {""}))
        raise
    result = {"address": cluster.address, "folder": str(output), "nodes": len(cluster.nodes)}
    _say(as_json, result, f"{len(cluster.nodes)} servers run: {cluster.address}")


@app.command()
def status(output: Home, ca: Authority = None, as_json: Json = False) -> None:
    """What each server says of the ledger; exit status 1 when one is down or has lost blocks."""
    cluster = Cluster.load(output, CONFIGURED if (output / CONFIGURED).exists() else MARKER)
    cluster.ca = str(ca) if ca else cluster.ca
    rows = cluster.status()
    newest = max((row.get("block_last", 0) for row in rows), default=0)
    alarms = []
    for row in rows:
        name = row["server"]
        if not row["runs"]:
            alarms.append(f"{name} does not answer")
        elif row.get("block_deleted") or row.get("block_messages", 0) != row.get("block_last", 0):
            lost = row["block_last"] - row["block_messages"]
            alarms.append(f"{name} has lost {lost} blocks: stop it, remove its store, start it")
    if as_json:
        print(json.dumps({"servers": rows, "alarms": alarms}))
    else:
        for row in rows:
            print(_line(row, newest))
    if alarms:
        raise ClusterError("; ".join(alarms))


@app.command()
def down(output: Home, as_json: Json = False) -> None:
    """End the servers of DIR; what they hold stays there."""
    cluster = Cluster.load(output)
    names = [node.name for node in cluster.nodes if cluster.process(node.name)]
    cluster.stop()
    _say(as_json, {"ended": names}, f"ended {len(names)} servers; {output} keeps what they hold")


@app.command()
def config(
    output: Folder,
    server: Annotated[
        list[str], typer.Option(metavar="NAME=HOST", help="A machine: three, five, or one to try.")
    ],
    ledger: Annotated[Path, typer.Option(metavar="LEDGER", help="Whose members are let in.")],
    store: Annotated[Path, typer.Option(help="Folder on each machine for what it holds.")] = Path(
        "/var/lib/vrchain"
    ),
    maker: Makers = None,
    certificates: Annotated[
        Path | None,
        typer.Option(help="Folder of NAME.crt, NAME.key and ca.crt, on each machine: TLS."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Write a configuration for each of several machines: keys, permissions, limits, TLS.

    Write it again, and reload the servers twice, when the operator has enrolled or expelled one.
    """
    named = [part.partition("=")[::2] for part in server]
    if not all(name and host for name, host in named) or len(dict(named)) != len(named):
        raise ClusterError(f"expected --server NAME=HOST, each name once, got {' '.join(server)}")
    for name, _ in named:
        check_name("--server", name)  # it names a file too
    if len(named) not in _COUNTS:
        raise ClusterError(f"expected three or five --server, or one to try, got {len(named)}")
    nodes = [Node(n, h, _PORT, _ROUTE_PORT, _MONITOR_PORT) for n, h in named]
    if (output / MARKER).exists():
        raise ClusterError(
            f"{output} holds the servers that vrchain cluster up made, which would be lost: "
            "choose another -o"
        )
    check_output_folder(output, CONFIGURED)
    if lost := {p.name for p in output.glob("*") if p.suffix != ".conf"} - {CONFIGURED}:
        raise ClusterError(
            f"{output} holds {', '.join(sorted(lost))}, which would be lost: choose another -o"
        )
    with Ledger.open(ledger) as opened:
        users = _users(opened, maker)
    known = Cluster.load(output, CONFIGURED).secret if (output / CONFIGURED).exists() else ""
    secret = known or secrets.token_hex(16)
    with output_folder(output, CONFIGURED) as folder:
        for node in nodes:
            tls = Tls.of(certificates, node.name) if certificates else None
            text = server_config(node, nodes, store, users, tls, secret)
            (folder / f"{node.name}.conf").write_text(text)
        told: dict[str, Any] = {"nodes": [vars(node) for node in nodes], "secret": secret}
        told |= {"ca": str(certificates / "ca.crt")} if certificates else {}
        (folder / CONFIGURED).write_text(json.dumps(told, indent=2) + "\n")
        for file in folder.iterdir():
            file.chmod(0o600)  # they hold what servers know each other by
    scheme = "tls" if certificates else "nats"
    address = f"{scheme}://{','.join(node.address for node in nodes)}"
    result = {"address": address, "folder": str(output), "members": sorted(users.members)}
    _say(as_json, result, f"wrote {len(nodes)} configurations to {output}; address: {address}")


@app.command()
def put(
    ledger: Annotated[Path, typer.Argument(metavar="LEDGER", help="A ledger's folder.")],
    address: Address,
    replicas: Annotated[
        int | None, typer.Option(min=1, max=MOST_REPLICAS, help="Servers that keep each block.")
    ] = None,
    max_gb: Annotated[
        float | None, typer.Option(min=0.01, max=1e6, help="For blocks on each server's disk.")
    ] = None,
    keys: Keys = None,
    simulated: Simulated = None,
    anonymous: Anonymous = False,
    ca: Authority = None,
    as_json: Json = False,
) -> None:
    """Put a ledger's blocks on servers, those that they lack: at first, or when they lost them."""
    with Ledger.open(ledger, writable=True) as opened:
        key = None if anonymous else signer(opened, keys, OPERATOR, simulated)
        servers = Servers.at(address, key=key, name=OPERATOR, ca=ca)
        with contextlib.closing(Stream(Connection(servers))) as stream, doing("putting blocks"):
            set_up(stream.connection, replicas, int(max_gb * 1e9) if max_gb else None)
            height = stream.newest()
            # before the folder is bound to these servers, which may carry another ledger
            check_is_part_of(opened, stream, min(height, opened.head.height))
            opened.follow_from_now()
            count = put_blocks(opened, stream, height)
        result = {"blocks": count, "height": opened.head.height, "head": opened.head.hash.hex()}
    _say(as_json, result, f"put {count} blocks on {address}; they hold up to {result['height']}")


@app.command()
def make(
    address: Address,
    folder: Annotated[Path, typer.Option(metavar="DIR", help="The maker's own copy.")],
    robot: Annotated[str, typer.Option(metavar="NAME", help="The member that makes blocks.")],
    seconds: Annotated[
        float | None, typer.Option(min=0.1, help="For so long; else until ended.")
    ] = None,
    no_limits: Annotated[
        bool, typer.Option("--no-limits", help="Take in offers at any rate, to measure.")
    ] = False,
    keys: Keys = None,
    simulated: Simulated = None,
    anonymous: Anonymous = False,
    ca: Authority = None,
    as_json: Json = False,
) -> None:
    """Make blocks of what robots offer, until it is ended. Several may, for when one fails."""
    key = member_key(folder, keys, robot, simulated)
    servers = Servers.at(address, key=None if anonymous else key, name=robot, ca=ca)
    until_s = time.monotonic() + (seconds or float("inf"))
    ledger, stream = _patiently(lambda: follow_servers(servers, folder), until_s)
    with ledger, contextlib.closing(stream):
        limits = UNLIMITED if no_limits else Limits()
        maker = Maker(ledger, Offers(stream.connection), robot, key, limits=limits)
        if not as_json:
            print(f"making blocks for {address} as {robot}", flush=True)
        while (left_s := until_s - time.monotonic()) > 0:
            _patiently(partial(maker.turn, min(1.0, left_s)), until_s)
        result = {"counts": dict(maker.counts), "height": ledger.head.height}
    _say(as_json, result, f"offers by what became of them: {dict(maker.counts)}")


def _patiently(work: Callable[[], T], until_s: float) -> T:
    """Again and again, while servers do not answer, or choose who leads; each is told."""
    while True:
        try:
            return work()
        except (UnavailableError, OvertakenError, GapError) as error:
            print(f"vrchain: {error}", file=sys.stderr, flush=True)
            if time.monotonic() > until_s:
                raise
            time.sleep(0.5)


def watch(
    ledger: Annotated[str, typer.Argument(metavar="LEDGER", help="A folder, or nats://HOST,...")],
    folder: Annotated[
        Path | None, typer.Option(metavar="DIR", help="This machine's copy, for nats://.")
    ] = None,
    seconds: Annotated[float, typer.Option(min=0.0, help="For so long.")] = 60.0,
    robot: Annotated[
        str | None, typer.Option(metavar="NAME", help="Whose key is shown to the servers.")
    ] = None,
    keys: Keys = None,
    simulated: Simulated = None,
    as_json: Json = False,
) -> None:
    """Tell blocks as they come, who is behind, what waits in whose outbox, and what is wrong."""
    key = member_key(folder, keys, robot, simulated) if robot and folder else None
    with open_ledger(ledger, folder, writable=False, key=key, name=robot or "anyone") as opened:
        told = set[str]()
        for entries, news in watched(opened, seconds):
            for entry in entries:
                records = ", ".join(map(str, entry.records))
                line = f"{entry.block} by {entry.block.author}: {records}"
                _say(as_json, entry_json(entry), line)
            for result, line in news:
                if line not in told:
                    _say(as_json, result, line)
                    told.add(line)
        if isinstance(opened, RobotLedger):
            opened.raise_trouble()


def _check_same(
    there: Cluster, output: Path, nodes: int | None, host: str | None, ledger_id: str
) -> None:
    """Refuse what cannot be asked of a cluster that is there."""
    others = {
        "--ledger": ledger_id != there.ledger_id,
        "--nodes": nodes not in (None, len(there.nodes)),
        "--host": host not in (None, there.nodes[0].host),
    }
    if options := [option for option, is_other in others.items() if is_other]:
        raise ClusterError(
            f"{output} holds a cluster that was made with other {', '.join(options)}: go on with "
            "it as it is, or end it with vrchain cluster down and choose another -o"
        )


def _users(ledger: Ledger, makers: list[str] | None) -> Users:
    for name in makers or []:
        ledger.latest(name)  # UnknownMemberError
    if not makers:
        raise ClusterError(
            f"expected --maker, a member that makes blocks: {', '.join(ledger.robots)}"
        )
    return Users(ledger.genesis.operator, ledger.members, frozenset(makers))


def _line(row: dict[str, Any], newest: int) -> str:
    if not row["runs"]:
        return f"{row['server']:4} {row['address']:22} does not answer"
    last = row.get("block_last", 0)
    behind = f"{newest - last} behind" if last < newest else "up to date"
    leads = "leads" if row.get("block_leads") else ""
    return (
        f"{row['server']:4} {row['address']:22} block {last - 1}, {row.get('block_mb', 0):.1f} MB, "
        f"{behind}, {row.get('offer_messages', 0)} offers wait {leads}"
    ).rstrip()


def _say(as_json: bool, result: dict[str, Any], line: str) -> None:
    print(json.dumps(result) if as_json else line, flush=True)

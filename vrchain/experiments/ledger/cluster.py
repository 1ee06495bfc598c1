"""A team's ledger over servers, measured: ``vrchain bench cluster``.

Three servers on this machine, a maker in a process of its own, and robots that each have a folder.
Payloads are random bytes of a panorama's size. What a ratio compares is measured in turns.
"""

import json
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from vrchain.errors import LedgerError
from vrchain.experiments.ledger.child import python
from vrchain.experiments.ledger.stores import create_ledger
from vrchain.ledger import Ledger, Offer, SigningKey, Transaction, simulated_key, verify
from vrchain.ledger.cluster.servers import Cluster
from vrchain.ledger.errors import UnavailableError
from vrchain.ledger.network.connection import Connection, Servers
from vrchain.ledger.network.log import put
from vrchain.ledger.network.message import pack_offer
from vrchain.ledger.network.opening import open_ledger
from vrchain.ledger.network.robot import RobotLedger
from vrchain.ledger.network.stream import Stream
from vrchain.ledger.records.transaction import blob_digest
from vrchain.seeding import generator

MAKER = "M"
PAYLOAD_BYTES = 200_000
BARE = "bare"  # a stream that is as the offers', which nobody reads
_ELECTION_S = 20.0  # servers that are busy may need several
_SHOWN = ("bare", "offer", "folder", "publish", "validated", "beyond", "read_folder", "read")
PATIENCE_S = 120.0

# What a robot's process does: publish one after another, each when the one before is in the chain.
ROBOT_CODE = """
import json, sys
from vrchain.experiments.ledger.cluster import publish_flat_out
address, folder, robot, seed, seconds = sys.argv[1:]
print(json.dumps(publish_flat_out(address, folder, robot, int(seed), float(seconds))))
"""


@dataclass
class Team:
    """Servers, a ledger on them, a maker's process, and where the robots' folders are."""

    folder: Path
    cluster: Cluster
    keys: dict[str, SigningKey]
    robots: tuple[str, ...]
    seed: int
    maker: "subprocess.Popen[bytes] | None" = None

    def start_maker(self) -> None:
        """A new process that makes blocks; the one before, if any, has to be gone."""
        words = ["cluster", "make", self.cluster.address, "--folder", str(self.folder / MAKER)]
        words += ["--robot", MAKER, "--simulated", str(self.seed), "--anonymous", "--json"]
        words += ["--no-limits"]
        self.maker = python("-m", "vrchain", *words, stdout=subprocess.DEVNULL, quiet=True)

    def kill_maker(self) -> None:
        """As a power failure does."""
        if self.maker is not None:
            self.maker.kill()
            self.maker.wait()

    def open(self, robot: str) -> RobotLedger:
        """The robot's ledger, in a folder of its own."""
        return _opened(self.cluster.address, self.folder / robot)

    def stream(self, first: str = "") -> Stream:
        """A connection of its own to the servers, of which it asks the one named first."""
        nodes = sorted(self.cluster.nodes, key=lambda node: node.name != first)
        address = f"nats://{','.join(node.address for node in nodes)}"
        return Stream(Connection(Servers.at(address, in_order=bool(first), timeout_s=_ELECTION_S)))


def _opened(address: str, folder: str | Path) -> RobotLedger:
    """Servers may choose a leader meanwhile, and new ones do not all answer at once."""
    until_s = time.monotonic() + _ELECTION_S
    while True:
        try:
            opened = open_ledger(address, folder)
        except UnavailableError:
            if time.monotonic() > until_s:
                raise
            time.sleep(0.1)
        else:
            assert isinstance(opened, RobotLedger)
            return opened


@contextmanager
def team(robots: int, seed: int, nodes: int = 3) -> Iterator[Team]:
    """A new one in the system's folder of temporary files; all of it ends with the block."""
    names = tuple(f"R{number + 1}" for number in range(robots))
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        ledger, keys = create_ledger(folder / "origin", (*names, MAKER), seed)
        cluster = Cluster.make(folder / "servers", nodes)
        made = Team(folder, cluster, keys, names, seed)
        with ledger, cluster.running():
            with closing(made.stream()) as stream:
                put(ledger, stream, -1)
            made.start_maker()
            try:
                yield made
            finally:
                made.kill_maker()


def at_rest(updates: int = 100, robots: int = 3, *, seed: int = 0) -> pd.DataFrame:
    """One robot publishes, one update after another; the others follow. Times in ms.

    Rows: bare (a JetStream publish of the same bytes to as many servers), offer (one that the
    servers acknowledge), publish (signed and in the outbox, durable here), validated (durable in
    every folder), beyond (that, without the offer), folder (an update of a folder alone), and
    read, read_folder (each payload from a robot's folder, which goes on to follow the servers, and
    from a folder's ledger, in turns once nothing new comes: three robots share this process).
    Columns: name, n, median_ms, p99_ms, ratio (to the row it is measured in turns with), bar.
    """
    times: dict[str, list[float]] = {}
    draws = generator(seed, "cluster", "payloads")

    def lap(name: str, work: Callable[[], Any]) -> Any:
        start_ns = time.perf_counter_ns()
        given = work()
        times.setdefault(name, []).append((time.perf_counter_ns() - start_ns) / 1e6)
        return given

    with team(robots, seed) as made, ExitStack() as stack:
        alone, keys = create_ledger(made.folder / "alone", made.robots, seed)
        stack.enter_context(alone)
        ledgers = [stack.enter_context(made.open(robot)) for robot in made.robots]
        robot, key, own = made.robots[0], made.keys[made.robots[0]], ledgers[0]
        own.publish(robot, key, b"warm", "start", 0)
        own.wait(timeout_s=PATIENCE_S)
        stream = stack.enter_context(closing(made.stream()))
        stream.connection.run(lambda client: _add_bare(client, len(made.cluster.nodes)))
        for number in range(updates):
            payload = draws.bytes(PAYLOAD_BYTES)
            lap("folder", partial(alone.publish, robot, keys[robot], payload, "view", number))
            start_ns = time.perf_counter_ns()
            sent = lap("publish", partial(own.publish, robot, key, payload, "view", number))
            for ledger in ledgers:
                _await(ledger, sent)
            times.setdefault("validated", []).append((time.perf_counter_ns() - start_ns) / 1e6)
            data = pack_offer(Offer(sent, payload))
            pairs: list[tuple[str, Callable[[], Any]]] = [
                ("bare", partial(stream.connection.run, partial(_publish, data=data))),
                ("offer", partial(stream.offer, "X", number.to_bytes(32, "big"), data)),
            ]
            for name, work in pairs[:: (-1) ** number]:  # neither always comes first
                lap(name, work)
        for number, sent in enumerate(own.history(robot)[1:]):
            reads: list[tuple[str, Ledger]] = [("read", own), ("read_folder", alone)]
            for name, held in reads[:: (-1) ** number]:
                lap(name, partial(held.payload, sent.payload_digest))
    times["beyond"] = list(np.subtract(times["validated"], times["offer"]))
    over = {"offer": "bare", "read": "read_folder", "validated": "folder"}
    bars = {"offer": 1.5, "read": 1.0}
    rows = []
    for name in _SHOWN:
        own_ms = np.array(times[name])
        base = float(np.median(times[over[name]])) if name in over else float("nan")
        median_ms = float(np.median(own_ms))
        row = (name, len(own_ms), median_ms, float(np.quantile(own_ms, 0.99)))
        rows.append((*row, median_ms / base, bars.get(name, float("nan"))))
    return pd.DataFrame(rows, columns=["name", "n", "median_ms", "p99_ms", "ratio", "bar"])


def update_over_servers(payloads: Sequence[bytes], *, seed: int = 0) -> pd.DataFrame:
    """As ``latency.update_latency`` by R1 and R2, over servers: what a team of machines waits.

    One row an update: ledger_position (from 1), robot, payload_bytes, publish_us (signed, and
    durable in its own outbox) and total_us, until the block is judged and durable in both robots'
    folders.
    """
    rows = []
    with team(2, seed) as made, ExitStack() as stack:
        ledgers = {robot: stack.enter_context(made.open(robot)) for robot in made.robots}
        first = ledgers["R1"].publish("R1", made.keys["R1"], b"warm", "start", 0)
        for ledger in ledgers.values():
            _await(ledger, first)
        for number, payload in enumerate(payloads):
            robot = made.robots[number % len(ledgers)]
            start_ns = time.perf_counter_ns()
            sent = ledgers[robot].publish(robot, made.keys[robot], payload, "distance", number)
            publish_us = (time.perf_counter_ns() - start_ns) / 1e3
            for ledger in ledgers.values():
                _await(ledger, sent)
            total_us = (time.perf_counter_ns() - start_ns) / 1e3
            rows.append((number + 1, robot, len(payload), publish_us, total_us))
    columns = ["ledger_position", "robot", "payload_bytes", "publish_us", "total_us"]
    return pd.DataFrame(rows, columns=columns)


def flat_out(seconds: float = 10.0, robots: int = 5, *, seed: int = 0) -> pd.DataFrame:
    """Robots, a process each, publish as fast as their transactions come into the chain.

    One row a robot: robot, n, per_s, median_ms, p99_ms, longest_ms (from publishing until it is in
    the robot's own folder). LedgerError if a folder does not verify afterwards, or heads differ.
    """
    with team(robots, seed) as made:
        waits = waits_ms(made, seconds)
        check_same(made)
    rows = [
        (name, len(ms), len(ms) / seconds, np.median(ms), np.quantile(ms, 0.99), max(ms))
        for name, ms in waits.items()
    ]
    columns = ["robot", "n", "per_s", "median_ms", "p99_ms", "longest_ms"]
    return pd.DataFrame(rows, columns=columns)


def publish_flat_out(
    address: str, folder: str, robot: str, seed: int, seconds: float
) -> list[float]:
    """What a robot's process does in ``flat_out``: how long each took, in ms."""
    key, draws, waits_ms = simulated_key(seed, robot), generator(seed, "flat out", robot), []
    with _opened(address, folder) as ledger:
        ledger.wait_until_followed(PATIENCE_S)  # a new folder reads a long chain first
        first = ledger.publish(robot, key, b"warm", "start", time.time_ns())
        ledger.wait(first, PATIENCE_S)
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s:
            payload, start_ns = draws.bytes(PAYLOAD_BYTES), time.perf_counter_ns()
            sent = ledger.publish(robot, key, payload, "view", time.time_ns())
            ledger.wait(sent, PATIENCE_S)
            waits_ms.append((time.perf_counter_ns() - start_ns) / 1e6)
    return waits_ms


def backlog(
    robots: int = 50, period_s: float = 10.0, seconds: float = 60.0, *, seed: int = 0
) -> pd.DataFrame:
    """Many robots, a panorama in a while each; does what waits for the maker grow?

    One row a tenth of the time: time_s, offered, waiting (on the servers, the most in that time),
    in_chain. All offers come by one connection; one folder follows.
    """
    with team(robots, seed) as made, closing(made.stream()) as stream:
        last: dict[str, Transaction] = {}
        draws = generator(seed, "cluster", "backlog")
        due = sorted((float(draws.uniform(0, period_s)), robot) for robot in made.robots)
        rounds = int(np.ceil(seconds / period_s))
        plan = [(at + k * period_s, robot) for k in range(rounds) for at, robot in due]
        with Ledger.open(made.folder / "origin") as origin:
            drafts = {r: origin.draft_transaction(r, b"", "view", 0) for r in made.robots}
        rows: list[tuple[float, int, int, int]] = []
        most, start_s = 0, time.monotonic()
        for number, (at_s, robot) in enumerate(plan):
            time.sleep(max(0.0, start_s + at_s - time.monotonic()))
            payload = draws.bytes(PAYLOAD_BYTES)
            transaction = _following(drafts[robot], last.get(robot), payload).signed(
                made.keys[robot]
            )
            stream.offer(robot, transaction.id, pack_offer(Offer(transaction, payload)))
            last[robot] = transaction
            if number % 5 == 0:
                most = max(most, sum(stream.waiting().values()))
            if (number + 1) % max(1, len(plan) // 10) == 0:
                waiting = sum(stream.waiting().values())
                rows.append((time.monotonic() - start_s, number + 1, max(most, waiting), waiting))
                most = 0
    return pd.DataFrame(rows, columns=["time_s", "offered", "most_waiting", "waiting"])


def _following(draft: Transaction, last: Transaction | None, payload: bytes) -> Transaction:
    changes: dict[str, Any] = {"payload_digest": blob_digest(payload), "timestamp_ns": 0}
    if last is not None:
        changes |= {"sequence": last.sequence + 1, "previous": last.id}
    return replace(draft, **changes)


def waits_ms(made: Team, seconds: float, robots: Sequence[str] = ()) -> dict[str, list[float]]:
    """How long each transaction of each robot took, as they publish flat out, a process each."""
    children = {
        robot: python(
            "-c", ROBOT_CODE, made.cluster.address, str(made.folder / robot), robot,
            str(made.seed), str(seconds), stdout=subprocess.PIPE,
        )
        for robot in robots or made.robots
    }  # fmt: skip
    waits = {}
    try:
        for robot, child in children.items():
            out, _ = child.communicate(timeout=seconds + 3 * PATIENCE_S)
            if child.returncode:
                raise LedgerError(f"the process of {robot} has failed")
            waits[robot] = json.loads(out)
    finally:
        for child in children.values():
            child.kill()
            child.wait()
    return waits


def check_same(made: Team) -> tuple[int, bool]:
    """How many different heads the robots' folders have, and whether all verify; LedgerError."""
    heads, good = set(), True
    for robot in made.robots:
        with made.open(robot) as ledger:
            ledger.wait_until_followed(PATIENCE_S)
            heads.add(ledger.head.hash)
        good = good and verify(made.folder / robot).ok
    if len(heads) != 1 or not good:
        raise LedgerError(f"expected one head and good folders, got {len(heads)} heads, {good}")
    return len(heads), good


def _await(ledger: Ledger, sent: Transaction) -> None:
    """Until it is in the ledger's folder. LedgerError after a while."""
    until_s = time.monotonic() + PATIENCE_S
    while ledger.latest(sent.robot) != sent:
        if time.monotonic() > until_s:
            raise LedgerError(f"{sent} has not come into {ledger.folder}")
        time.sleep(0.0005)
        ledger.refresh()


async def _add_bare(client: Any, replicas: int) -> None:
    await client.jetstream(timeout=10).add_stream(
        name=BARE, subjects=[BARE], num_replicas=replicas, storage="file"
    )


async def _publish(client: Any, data: bytes) -> None:
    await client.jetstream(timeout=10).publish(BARE, data)

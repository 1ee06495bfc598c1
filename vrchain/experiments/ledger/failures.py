"""What fails, and what is lost by it: servers, makers and robots killed, a bit flipped in a store.

Measured on a team of its own: see ``cluster``.
"""

import shutil
import signal
import subprocess
import time
from collections.abc import Callable
from contextlib import ExitStack, closing
from functools import partial
from typing import Any

import pandas as pd

from vrchain.errors import LedgerError
from vrchain.experiments.ledger.child import python
from vrchain.experiments.ledger.cluster import (
    PATIENCE_S,
    PAYLOAD_BYTES,
    ROBOT_CODE,
    Team,
    check_same,
    team,
)
from vrchain.ledger import Ledger, Offer, Transaction, verify
from vrchain.ledger.errors import UnavailableError
from vrchain.ledger.network.replicated import Replicated
from vrchain.seeding import generator


def kills(times: int = 2, all_at_once: int = 1, *, seed: int = 0) -> pd.DataFrame:
    """Kill servers, the maker and each robot under load, as a power failure does; what is lost?

    One row a kind: killed, times, stalled_s (the longest that no block came), then of the whole run
    acknowledged (transactions that ``publish`` gave), in_chain, lost, doubled, verified, heads.
    """
    stalls: dict[str, list[float]] = {}
    with team(3, seed) as made, ExitStack() as stack:
        acknowledged: list[Transaction] = []
        ledgers = {r: stack.enter_context(made.open(r)) for r in made.robots[:2]}
        draws = generator(seed, "cluster", "kills")

        def publish(count: int) -> None:
            for _ in range(count):
                for robot, ledger in ledgers.items():
                    payload, key = draws.bytes(PAYLOAD_BYTES // 4), made.keys[robot]
                    sent = ledger.publish(robot, key, payload, "view", time.time_ns())
                    acknowledged.append(sent)

        def endure(kind: str, kill: Callable[[], None], restart: Callable[[], None]) -> None:
            publish(3)
            kill()
            start_s = time.monotonic()
            publish(3)
            restart()
            for ledger in ledgers.values():
                _patiently(partial(ledger.wait, timeout_s=PATIENCE_S))
            stalls.setdefault(kind, []).append(time.monotonic() - start_s)

        for ledger in ledgers.values():
            ledger.wait_until_followed(PATIENCE_S)
        publish(2)
        for number in range(times):
            leader = _leader(made)
            others = [node.name for node in made.cluster.nodes if node.name != leader]
            for kind, name in (("leader", leader), ("other", others[number % len(others)])):
                kill = partial(made.cluster.stop, name, number=signal.SIGKILL)
                endure(kind, kill, partial(made.cluster.restart, name))
            endure("maker", made.kill_maker, made.start_maker)
        for _ in range(all_at_once):
            kill = partial(made.cluster.stop, number=signal.SIGKILL)
            endure("all servers", kill, made.cluster.restart)
        for ledger in ledgers.values():
            ledger.close()
        found: set[bytes] = set()
        for robot in made.robots:
            found |= _killed_robot(made, robot)
            stalls.setdefault("robot", []).append(float("nan"))
        heads, verified = check_same(made)
        with Ledger.open(made.folder / "R1") as copy:
            records = [record for entry in copy.entries() for record in entry.records]
        chain = [record.id for record in records if isinstance(record, Transaction)]
    ids = {t.id for t in acknowledged} | found
    rest = (len(ids), len(chain), len(ids - {*chain}), len(chain) - len({*chain}), verified, heads)
    rows = [(kind, len(s), max(s), *rest) for kind, s in stalls.items()]
    columns = ["killed", "times", "stalled_s", "acknowledged", "in_chain", "lost", "doubled"]
    return pd.DataFrame(rows, columns=[*columns, "verified", "heads"])


def flipped_bit(blocks: int = 120, *, seed: int = 0) -> pd.DataFrame:
    """Flip one bit in a stopped server's store; is it noticed, named, mended?

    One row: server, messages, lost_there (of them, once it is back, as ``Cluster.status`` says of
    it), follower_blocks (that a new folder gets from the servers as they are then), alarms (how
    many it gave: whichever server answers, most have the block), after_cure (messages once its
    store was wiped), verified.
    """
    with team(2, seed) as made:
        made.kill_maker()
        draws, key = generator(seed, "cluster", "bit"), made.keys["R1"]
        with closing(made.stream()) as stream, Replicated.join(made.folder / "R1", stream) as own:
            for number in range(blocks):  # enough that the server has several files of them
                payload = draws.bytes(PAYLOAD_BYTES)
                draft = own.draft_transaction("R1", payload, "view", number)
                own.append_many([Offer(draft.signed(key), payload)], "R1", key)
            height = own.head.height
        server = _leader(made)
        made.cluster.stop(server)
        store = made.cluster.folder / server
        file = min(store.rglob("streams/block/msgs/*.blk"), key=lambda path: int(path.stem))
        data = bytearray(file.read_bytes())
        data[len(data) // 3] ^= 1
        file.write_bytes(data)
        for index in file.parent.glob("index.db"):
            index.unlink()  # as after a power failure: the server reads its blocks again
        made.cluster.restart(server)
        row = _settled(made, server, height + 1)
        lost = row.get("block_last", 0) - row.get("block_messages", 0)
        with (
            closing(made.stream(first=server)) as stream,
            Replicated.join(made.folder / "R2", stream) as follower,
        ):
            follower.catch_up()
            alarms, got = follower.alarms, follower.head.height
        made.cluster.stop(server)
        shutil.rmtree(store)
        made.cluster.restart(server)
        cured = _settled(made, server, height + 1).get("block_messages", 0)
        with made.open("R2") as follower:
            follower.wait_until_followed(PATIENCE_S)
            ok = follower.head.height == height
        ok = ok and verify(made.folder / "R2").ok
    return pd.DataFrame(
        [
            {
                "server": server,
                "messages": height + 1,
                "lost_there": lost,
                "follower_blocks": got + 1,
                "alarms": len(alarms),
                "after_cure": cured,
                "verified": ok,
            }
        ]
    )


def _killed_robot(made: Team, robot: str) -> set[bytes]:
    """Its process is killed as it publishes; what it had signed goes out when it is back."""
    child = python(
        "-c", ROBOT_CODE, made.cluster.address, str(made.folder / robot), robot, str(made.seed),
        "60", stdout=subprocess.DEVNULL,
    )  # fmt: skip
    try:
        with made.open("watch") as watch:
            watch.wait_until_followed(PATIENCE_S)
            until_s, before = time.monotonic() + 2 * PATIENCE_S, watch.latest(robot)
            known = before.sequence if before else -1
            while (last := watch.latest(robot)) is None or last.sequence < known + 3:
                if time.monotonic() > until_s:
                    raise LedgerError(f"{robot} has published nothing")
                time.sleep(0.05)
                watch.refresh()
    finally:
        child.kill()
        child.wait()
    with made.open(robot) as again:
        waiting = {r: n for r, n, _ in again.outbox.waiting()}
        again.wait(timeout_s=PATIENCE_S)
        again.wait_until_followed(PATIENCE_S)
        history = again.history(robot)
        if waiting and history[-1].sequence < waiting[robot]:
            raise LedgerError(f"what {robot} had signed is not in the chain")
        return {transaction.id for transaction in history}


def _leader(made: Team) -> str:
    until_s = time.monotonic() + PATIENCE_S
    while True:
        for row in made.cluster.status():
            if row.get("block_leads"):
                return str(row["server"])
        if time.monotonic() > until_s:
            raise UnavailableError("no server leads")
        time.sleep(0.1)


def _settled(made: Team, server: str, messages: int) -> dict[str, Any]:
    """The server's row once it says how far it has come; it may never have all."""
    until_s, row = time.monotonic() + 30.0, dict[str, Any]()
    while time.monotonic() < until_s:
        row = next(row for row in made.cluster.status() if row["server"] == server)
        if row.get("block_last") == messages and row.get("block_messages") == messages:
            return row
        time.sleep(0.2)
    return row


def _patiently(work: Callable[[], None]) -> None:
    """Again, as long as servers choose who leads."""
    until_s = time.monotonic() + PATIENCE_S
    while True:
        try:
            return work()
        except UnavailableError:
            if time.monotonic() > until_s:
                raise

"""One robot floods a gate while others work: what becomes of their latency, and of the flood.

Three processes: a gate that appends to a ledger on disk, the honest robots (a thread each), and
the flooder, which sends as fast as the gate lets it. Each phase has a new ledger and gate; phases
without and with each kind of flood take turns, so that all see the same machine.
"""

import multiprocessing
import signal
import socket
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from itertools import count
from multiprocessing.connection import Connection
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from tqdm.auto import tqdm

from vrchain.errors import LedgerError
from vrchain.experiments.intervals import interval, resampled
from vrchain.experiments.ledger.flooder import FLOODER, FLOODS, Flooder, following
from vrchain.experiments.ledger.stores import create_ledger
from vrchain.ledger import Ledger, Limits, Transaction, simulated_key, verify
from vrchain.ledger.network.gate import Gate, receive_answer
from vrchain.ledger.network.wire import send
from vrchain.seeding import generator

QUIET = "quiet"
UNLIMITED = ("valid, no limits", "forged, no limits")  # what the limits are good for
CONDITIONS = (*FLOODS, *UNLIMITED)
BAR = 2.0  # times the quiet p99, which that of the honest robots should not exceed under a flood
GATE = "G"

_NO_LIMIT = 1 << 40


@dataclass(frozen=True)
class FloodConfig:
    """How many work, how fast, and for how long."""

    robots: int = 8  # honest ones
    rate_per_s: float = 3.0  # of each honest robot, on the average
    payload_bytes: int = 200_000
    phase_s: float = 3.0
    rounds: int = 10  # phases of each condition
    seed: int = 3000
    # Blocks are made at once: to wait for others would hide what a flood adds.
    limits: Limits = field(
        default_factory=lambda: Limits(rate_per_s=6.0, rate_bytes_per_s=2e6, block_delay_ns=0)
    )

    @property
    def names(self) -> list[str]:
        """The honest robots'."""
        return [f"R{number + 1}" for number in range(self.robots)]

    def limits_in(self, condition: str) -> Limits:
        """Those of a gate in a phase."""
        if condition not in UNLIMITED:
            return self.limits
        rates = ("rate_per_s", "rate_bytes_per_s", "sender_messages_per_s", "sender_bytes_per_s")
        bursts = ("burst", "burst_bytes", "sender_burst", "sender_burst_bytes")
        return replace(self.limits, **dict.fromkeys((*rates, *bursts), _NO_LIMIT))


class Measured(NamedTuple):
    """What ``flood`` measured.

    ``work``: one row a transaction of an honest robot: condition, round, robot, latency_us (from
    when it was to be sent until its robot knew that it was durable), refused (the kind of error, ""
    for none, whose latency_us is NaN). ``floods``: one row a phase: condition, round, sent,
    sent_bytes (by the flooder), gate_busy (share of the time that the gate's process computed) and,
    for each thing that became of the flooder's messages, how many.
    """

    work: pd.DataFrame
    floods: pd.DataFrame


def flood(config: FloodConfig, conditions: Sequence[str] = CONDITIONS) -> Measured:
    """Phases without a flood and with each kind, in an order that is drawn anew in each round.

    The ledgers are made, and removed, in the system's folder of temporary files. Raises LedgerError
    for an unknown condition or if a ledger does not verify afterwards.
    """
    if unknown := [condition for condition in conditions if condition not in CONDITIONS]:
        raise LedgerError(f"expected a flood of {'; '.join(CONDITIONS)}; got {unknown[0]!r}")
    if config.rounds < 1 or config.robots < 1:
        raise LedgerError(
            f"expected 1 round and 1 robot or more, got {config.rounds} and {config.robots}"
        )
    if not 1 <= config.phase_s * config.rate_per_s < np.inf:
        raise LedgerError(
            f"expected a phase of {1 / config.rate_per_s:.2g} s or more, in which every robot "
            f"publishes, got {config.phase_s:g} s"
        )
    draws = generator(config.seed, "flood", "order")
    works, floods = list[pd.DataFrame](), list[dict[str, object]]()
    phases = [
        (turn, str(condition))
        for turn in range(config.rounds)
        for condition in draws.permutation([QUIET, *conditions])
    ]
    with _child(_run_gate) as gate, _child(_run_flooder) as flooder:
        for turn, condition in tqdm(phases, desc="phases", unit="", disable=None):
            with tempfile.TemporaryDirectory() as scratch:
                work, counts = _phase(config, condition, turn, Path(scratch), gate, flooder)
            works.append(work.assign(condition=condition, round=turn))
            floods.append({"condition": condition, "round": turn, **counts})
    return Measured(pd.concat(works, ignore_index=True), pd.DataFrame(floods).fillna(0))


def summarise(measured: Measured, *, seed: int) -> pd.DataFrame:
    """One row a condition, quiet first.

    name, positions (transactions of honest robots), median_us, p99_us (the 99th percentile of a
    phase, median over rounds: a disk that stands still in one of them decides nothing), p99_all_us
    (of all phases together, which it does), reference_us (the quiet p99_us), ratio (of p99_us to
    that) with its 95 % interval ratio_low, ratio_high (bootstrap over rounds), bar (NaN where
    limits were lifted), refused (honest transactions).
    """
    work = measured.work
    p99_us = work.groupby(["round", "condition"]).latency_us.quantile(0.99).unstack()
    chosen = resampled(len(p99_us), seed, "flood")
    quiet_us = p99_us[QUIET]
    quiet_medians_us = np.median(quiet_us.to_numpy()[chosen], axis=1)
    rows = []
    for condition in [name for name in (QUIET, *CONDITIONS) if name in p99_us]:
        own = work[work.condition == condition]
        medians_us = np.median(p99_us[condition].to_numpy()[chosen], axis=1)
        low, high = interval(medians_us / quiet_medians_us, len(p99_us))
        rows.append(
            {
                "name": condition,
                "positions": len(own),
                "median_us": own.latency_us.median(),
                "p99_us": p99_us[condition].median(),
                "p99_all_us": own.latency_us.quantile(0.99),
                "reference_us": quiet_us.median(),
                "ratio": p99_us[condition].median() / quiet_us.median(),
                "ratio_low": low,
                "ratio_high": high,
                "bar": BAR if condition in FLOODS else float("nan"),
                "refused": int((own.refused != "").sum()),
            }
        )
    return pd.DataFrame(rows)


def outcomes(measured: Measured) -> pd.DataFrame:
    """One row a condition, quiet first: what became of the flooder's messages.

    name, sent, sent_mb, gate_busy (mean), unheard (sent, but not taken from the connection in
    time), admitted, and each kind of refusal.
    """
    rows = measured.floods.drop(columns="round").groupby("condition")
    sums = rows.sum().drop(columns=["sent_bytes", "gate_busy"])
    unheard = (2 * sums["sent"] - sums.sum(axis="columns")).clip(lower=0)
    sums.insert(1, "sent_mb", rows.sent_bytes.sum() / 1e6)
    sums.insert(2, "gate_busy", rows.gate_busy.mean())
    sums.insert(3, "unheard", unheard)
    order = [name for name in (QUIET, *CONDITIONS) if name in sums.index]
    return sums.loc[order].rename_axis("name").reset_index()


def _phase(
    config: FloodConfig,
    condition: str,
    turn: int,
    scratch: Path,
    gate: Connection,
    flooder: Connection,
) -> tuple[pd.DataFrame, dict[str, object]]:
    """The honest robots' rows, and the flood's counts."""
    folder, address = scratch / "ledger", str(scratch / "gate")
    ledger, _ = create_ledger(folder, (*config.names, GATE, FLOODER), config.seed)
    ledger.close()
    gate.send((folder, address, config, condition))
    gate.recv()
    with ExitStack() as stack, ThreadPoolExecutor(config.robots) as pool:
        connections = [stack.enter_context(socket.socket(socket.AF_UNIX)) for _ in config.names]
        for connection in connections:
            connection.settimeout(30.0)
            connection.connect(address)
        start_ns = time.monotonic_ns() + 50_000_000
        until_ns = start_ns + round(config.phase_s * 1e9)
        flooder.send((folder, address, config, condition, until_ns))
        works = [
            pool.submit(_work, config, name, connection, folder, turn, start_ns, until_ns)
            for name, connection in zip(config.names, connections, strict=True)
        ]
        rows = [row for work in works for row in work.result()]
        sent = flooder.recv()
        gate.send(None)
        heard, busy_s = gate.recv()
    work = pd.DataFrame(rows)
    heard -= Counter(kind or "admitted" for kind in work.refused)  # the rest is the flooder's
    if not verify(folder).ok:
        raise LedgerError("the ledger does not verify after a flood")
    return work, {**sent, "gate_busy": busy_s / config.phase_s, **heard}


def _work(
    config: FloodConfig,
    robot: str,
    connection: socket.socket,
    folder: Path,
    turn: int,
    start_ns: int,
    until_ns: int,
) -> list[dict[str, object]]:
    """Publish at times that are drawn beforehand, one after another; a row each."""
    key = simulated_key(config.seed, robot)
    draws = generator(config.seed, "flood", robot, turn)
    with Ledger.open(folder) as ledger:
        first = ledger.draft_transaction(robot, b"", "time", 0)
    last: Transaction | None = None
    rows: list[dict[str, object]] = []
    for number in count():
        due_ns = start_ns + round((number + draws.random()) / config.rate_per_s * 1e9)
        if due_ns >= until_ns:
            return rows
        payload = draws.bytes(config.payload_bytes)
        transaction = following(first, last, payload).signed(key)
        time.sleep(max(0, due_ns - time.monotonic_ns()) / 1e9)
        send(connection, [transaction.record, payload])
        answer = receive_answer(connection)
        done_ns = time.monotonic_ns()
        latency_us = float("nan") if answer.reason else (done_ns - due_ns) / 1e3
        last = last if answer.reason else transaction
        rows.append({"robot": robot, "latency_us": latency_us, "refused": answer.kind})
    raise AssertionError


def _run_gate(pipe: Connection) -> None:
    """A process's whole life: a gate a job, until the next message."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's, which ends this
    while job := pipe.recv():
        folder, address, config, condition = job
        with (
            socket.socket(socket.AF_UNIX) as listener,
            Ledger.open(folder, writable=True) as ledger,
        ):
            listener.bind(address)
            listener.listen()
            key = simulated_key(config.seed, GATE)
            with Gate(listener, ledger, GATE, key, limits=config.limits_in(condition)) as gate:
                pipe.send("ready")
                busy_s = time.process_time()
                while not pipe.poll():
                    gate.turn(0.01)
                pipe.recv()
                pipe.send((gate.counts, time.process_time() - busy_s))


def _run_flooder(pipe: Connection) -> None:
    """A process's whole life: a flood a job, none in a quiet phase."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the parent's, which ends this
    while job := pipe.recv():
        folder, address, config, condition, until_ns = job
        sent = {"sent": 0, "sent_bytes": 0}
        if condition != QUIET:
            with Ledger.open(folder) as ledger:
                flooder = Flooder(
                    condition.partition(",")[0], address, ledger, config.names,
                    config.payload_bytes, config.limits, config.seed,
                )  # fmt: skip
                flooder.run(until_ns)
                sent = {"sent": flooder.sent, "sent_bytes": flooder.sent_bytes}
        pipe.send(sent)


@contextmanager
def _child(target: Callable[[Connection], None]) -> Iterator[Connection]:
    """A process that runs ``target``, by its pipe. LedgerError if it, or its socket, fails."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=target, args=(theirs,), daemon=True)
    process.start()
    theirs.close()  # so that a child that dies ends our waiting
    try:
        yield ours
        ours.send(None)
        process.join(10)
    except (EOFError, OSError) as error:
        raise LedgerError(f"a process of the flood has failed: {error!r}") from error
    finally:
        process.kill()
        process.join()
        ours.close()

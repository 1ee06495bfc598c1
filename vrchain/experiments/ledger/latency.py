"""How long the ledger takes: updates by stage, retrieval three ways, throughput.

Durations come from ``perf_counter_ns`` and never enter a ledger. Rendering, image coding and
landmark extraction are no part of an update: payloads come in as bytes.
"""

import itertools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from time import perf_counter_ns

import numpy as np
import pandas as pd
from tqdm.auto import tqdm

from vrchain.errors import LedgerError
from vrchain.experiments.ledger.receiver import Receiver
from vrchain.experiments.ledger.stores import create_ledger
from vrchain.experiments.stopwatch import Stopwatch, elapsed_us, sample_us
from vrchain.ledger import Entry, Ledger, Transaction

STAGES = ("encode", "hash", "sign", "validate", "append_memory", "append_durable", "transmit")
RETRIEVALS = ("newest_transaction", "panorama", "common_landmark")
STEP_NS = 1_000_000_000  # the simulated time between two positions

CommonLandmark = Callable[[bytes, bytes], object]


def update_latency(
    payloads: Sequence[bytes],
    folder: str | Path,
    robots: Sequence[str] = ("R1", "R2"),
    seed: int = 0,
) -> pd.DataFrame:
    """Publish the payloads in turn by the robots to a new ledger in ``folder``; time each update.

    Payload k is robot k % len(robots)'s at its position k // len(robots): for n positions
    give n * len(robots) payloads, all different (the same bytes are stored once).
    An update is one ``Ledger.publish``, durable when it returns, and the same block sent to
    another robot's process over a local socket until that has validated and acknowledged it.

    One row per (position, robot): position, robot, payload_bytes, one column ``STAGE_us`` for
    each of STAGES, and total_us. ``hash`` is the payload's SHA-256; the small hashes of the
    records count as ``encode``. ``validate`` is the publisher's check of the transaction and of
    whose key signs the block; the receiver's, with both signatures, is in ``transmit``.
    ``append_durable`` has the lock, the file, its fsyncs and the commit. total_us is read from
    the clock before and after everything, apart from the stages, so that their sum may differ
    slightly. Raises LedgerError kinds.
    """
    rows = []
    stopwatch = Stopwatch()
    made, keys = create_ledger(Path(folder), robots, seed)
    with made as ledger, Receiver(ledger.entry(0)) as receiver:
        for number, payload in enumerate(tqdm(payloads, desc="updates", unit="", disable=None)):
            position, turn = divmod(number, len(robots))
            robot = robots[turn]
            start_ns = perf_counter_ns()
            stopwatch.restart()
            transaction = ledger.publish(
                robot, keys[robot], payload, "distance", position * STEP_NS, stopwatch.lap
            )
            entry = Entry(ledger.head, (transaction,))
            acknowledged = receiver.send(entry, {transaction.payload_digest: payload})
            stopwatch.lap("transmit")
            total_us = (perf_counter_ns() - start_ns) / 1e3
            if acknowledged != ledger.head.hash:
                raise LedgerError("the other robot's process came to another head than the ledger")
            stages_us = map(stopwatch.us, STAGES)
            rows.append((position, robot, len(payload), *stages_us, total_us))
    columns = ["position", "robot", "payload_bytes", *(f"{s}_us" for s in STAGES), "total_us"]
    return pd.DataFrame(rows, columns=columns)


def stage_quartiles(updates: Mapping[int, pd.DataFrame]) -> pd.DataFrame:
    """Of ``update_latency`` by number of positions: positions, quantile, each stage, total_us."""
    columns = [*(f"{stage}_us" for stage in STAGES), "total_us"]
    quartiles = {n: table[columns].quantile([0.25, 0.5, 0.75]) for n, table in updates.items()}
    return pd.concat(quartiles, names=["positions", "quantile"]).reset_index()


def retrieval_latency(
    ledger: Ledger,
    robots: Sequence[str],
    common_landmark: CommonLandmark | None = None,
    n_landmarks: int = 10,
) -> pd.DataFrame:
    """Time three ways to retrieve, over the positions that the robots have published.

    - newest_transaction: ``ledger.latest`` of the position's robot; too short for the clock, so
      that a time is the mean of 1000 calls;
    - panorama: ``ledger.payload`` of the position, read from its file (in the page cache if just
      written) and checked against its digest;
    - common_landmark: ``common_landmark(payload, other's payload)`` with the nearest position of
      another robot, timed whole: reading and checking of both panoramas included. At
      ``n_landmarks`` positions at most, spread evenly.

    One row per (way, position), after one retrieval to warm up: way, robot, position (in the
    ledger, from 1) and time_us. Raises LedgerError when a robot has published nothing.
    """
    published = [
        record
        for entry in ledger.entries()
        for record in entry.records
        if isinstance(record, Transaction) and record.robot in robots
    ]
    if silent := set(robots) - {transaction.robot for transaction in published}:
        raise LedgerError(f"expected every robot to have published, but {min(silent)} has not")
    every = range(len(published))
    ways: dict[str, tuple[Callable[[int], Callable[[], object]], int, Sequence[int]]] = {
        "newest_transaction": (lambda k: _newest(ledger, published[k].robot), 1000, every),
        "panorama": (lambda k: _panoramas(ledger, [published[k]]), 1, every),
    }
    if common_landmark and len(robots) > 1:
        some = np.linspace(0, every[-1], min(n_landmarks, len(published))).round().astype(int)
        ways["common_landmark"] = (
            lambda k: _landmark(ledger, published, k, common_landmark), 1, some.tolist()
        )  # fmt: skip
    rows = []
    for way, (retrieval, calls, positions) in ways.items():
        retrieval(positions[-1])()
        for k in positions:
            rows.append((way, published[k].robot, k + 1, elapsed_us(retrieval(k), calls)))
    return pd.DataFrame(rows, columns=["way", "robot", "position", "time_us"])


def throughput(
    payloads: Sequence[bytes],
    folder: str | Path,
    robots: Sequence[str] = ("R1", "R2"),
    seed: int = 0,
    n_retrievals: int = 1000,
) -> pd.DataFrame:
    """Durable updates a second and retrievals a second by one process, each timed as one run.

    A new ledger is written in ``folder`` (no other process takes part). One row: n_updates,
    payload_bytes (mean), updates_per_s, n_retrievals, newest_transactions_per_s,
    panoramas_per_s (read and checked).
    """
    if not payloads:
        raise LedgerError("expected at least one payload to measure throughput, got none")
    turns = list(zip(payloads, itertools.cycle(robots), strict=False))
    made, keys = create_ledger(Path(folder), robots, seed)
    with made as ledger:
        start_ns = perf_counter_ns()
        for number, (payload, robot) in enumerate(turns):
            ledger.publish(robot, keys[robot], payload, "distance", number * STEP_NS)
        updates_s = (perf_counter_ns() - start_ns) / 1e9
        history = ledger.history(robots[0])
        (newest_us,) = sample_us(_newest(ledger, robots[0]), n_retrievals, 1)
        (panorama_us,) = sample_us(_panoramas(ledger, history), n_retrievals, 1)
    row = {
        "n_updates": len(turns),
        "payload_bytes": float(np.mean([len(payload) for payload in payloads])),
        "updates_per_s": len(turns) / updates_s,
        "n_retrievals": n_retrievals,
        "newest_transactions_per_s": 1e6 / newest_us,
        "panoramas_per_s": 1e6 / panorama_us,
    }
    return pd.DataFrame([row])


def _newest(ledger: Ledger, robot: str) -> Callable[[], object]:
    return lambda: ledger.latest(robot)


def _panoramas(ledger: Ledger, history: Sequence[Transaction]) -> Callable[[], object]:
    """Each call reads the history's next panorama."""
    digests = itertools.cycle([transaction.payload_digest for transaction in history])
    return lambda: ledger.payload(next(digests))


def _landmark(
    ledger: Ledger, published: Sequence[Transaction], k: int, common_landmark: CommonLandmark
) -> Callable[[], object]:
    """With the nearest position of another robot, the earlier of two."""
    others = (i for i, other in enumerate(published) if other.robot != published[k].robot)
    own, other = (published[i].payload_digest for i in (k, min(others, key=lambda i: abs(i - k))))
    return lambda: common_landmark(ledger.payload(own), ledger.payload(other))

"""How long the ledger takes: updates by stage, retrieval three ways, throughput, the paper's table.

Durations come from ``perf_counter_ns`` and never enter a ledger. Rendering, image coding and
landmark extraction are no part of an update: payloads come in as bytes.
"""

import contextlib
import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter_ns

import numpy as np
import pandas as pd
from tqdm.auto import tqdm

from vrchain.errors import LedgerError
from vrchain.experiments.stopwatch import Stopwatch, sample_us
from vrchain.ledger import Ledger, SigningKey, Transaction, simulated_key
from vrchain.ledger.membership import OPERATOR
from vrchain.ledger.peer import PeerProcess

STAGES = (
    "encode",
    "hash",
    "sign",
    "validate",
    "append_memory",
    "append_durable",
    "transmit",
)
RETRIEVALS = ("newest_transaction", "panorama", "common_landmark")
STEP_NS = 1_000_000_000  # the simulated time between two positions

CommonLandmark = Callable[[bytes, bytes], object]


@dataclass(frozen=True)
class PaperValues:
    """What the paper prints for its ledger, as far as it is known here.

    The columns are labelled milliseconds. 1.79e-5 ms is 18 ns, which its timer cannot see
    (``time.time()`` steps by 238 ns); read as seconds, 0.83 ms and 18 us, the columns are
    plausible. Both readings are given, neither is claimed. Which row of its table (40, 200
    or 500 positions) a value belongs to is not known here.
    """

    update_printed: float = 8.3e-4
    retrieval_printed: float = 1.79e-5
    landmark_quality_printed: tuple[float, float] = (3.35, 3.41)  # unit and formula not public

    def rows(self) -> list[dict[str, object]]:
        """One row a reading, in milliseconds, for ``summary_table``."""
        low, high = self.landmark_quality_printed
        note = f"which row is not known; landmark quality {low}-{high}, unit not public"
        readings = {"as printed, milliseconds": 1.0, "read as seconds": 1000.0}
        return [
            {
                "source": f"paper, {reading}",
                "mean_update_ms": self.update_printed * to_ms,
                "mean_retrieval_ms": self.retrieval_printed * to_ms,
                "note": note,
            }
            for reading, to_ms in readings.items()
        ]


PAPER = PaperValues()


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
    with (
        _new_ledger(folder, robots, seed) as (ledger, keys),
        PeerProcess(ledger.entry(0)) as peer,
    ):
        for number, payload in enumerate(tqdm(payloads, desc="updates", unit="", disable=None)):
            position, turn = divmod(number, len(robots))
            robot = robots[turn]
            start_ns = perf_counter_ns()
            stopwatch.restart()
            transaction = ledger.publish(
                robot, keys[robot], payload, "distance", position * STEP_NS, stopwatch.lap
            )
            acknowledged = peer.send(ledger.head, (transaction,), payload)
            stopwatch.lap("transmit")
            total_us = (perf_counter_ns() - start_ns) / 1e3
            if acknowledged != ledger.head.hash:
                raise LedgerError("the other robot's process came to another head than the ledger")
            stages = {f"{stage}_us": stopwatch.us(stage) for stage in STAGES}
            row = {"position": position, "robot": robot, "payload_bytes": len(payload)}
            rows.append({**row, **stages, "total_us": total_us})
    columns = ["position", "robot", "payload_bytes", *(f"{s}_us" for s in STAGES), "total_us"]
    return pd.DataFrame(rows, columns=columns)


def retrieval_latency(
    ledger: Ledger,
    robots: Sequence[str],
    n_repeats: int = 30,
    common_landmark: CommonLandmark | None = None,
    n_landmark_repeats: int = 3,
) -> pd.DataFrame:
    """Time three ways to retrieve, for each robot.

    - newest_transaction: ``ledger.latest``, so short that a sample is 1000 calls;
    - panorama: ``ledger.payload``, read from its file (in the page cache if just written) and
      checked against its digest, over the robot's history in turn;
    - common_landmark: ``common_landmark(own payload, other's payload)`` with the next robot
      of ``robots``, timed whole: look-up, reading and checking of both panoramas included.

    One row per (way, robot): way, robot, positions (that the robot has published),
    calls_per_sample, n_samples, median_us and mean_us of one call. Raises LedgerError when a
    robot has published nothing.
    """
    histories = {robot: ledger.history(robot) for robot in robots}
    for robot, history in histories.items():
        if not history:
            raise LedgerError(f"expected every robot to have published, but {robot} has not")
    rows = []
    for robot, other in zip(robots, [*robots[1:], robots[0]], strict=True):
        history = histories[robot]
        ways: dict[str, tuple[Callable[[], object], int, int]] = {
            "newest_transaction": (_newest(ledger, robot), 1000, n_repeats),
            "panorama": (_panoramas(ledger, history), 1, n_repeats),
        }
        if common_landmark and other != robot:
            call = _landmark(ledger, robot, other, common_landmark)
            ways["common_landmark"] = (call, 1, n_landmark_repeats)
        for way, (call, calls, samples) in ways.items():
            times_us = sample_us(call, calls, samples)
            rows.append(
                {
                    "way": way,
                    "robot": robot,
                    "positions": len(history),
                    "calls_per_sample": calls,
                    "n_samples": samples,
                    "median_us": float(np.median(times_us)),
                    "mean_us": float(np.mean(times_us)),
                }
            )
    return pd.DataFrame(rows)


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
    with _new_ledger(folder, robots, seed) as (ledger, keys):
        start_ns = perf_counter_ns()
        for number, (payload, robot) in enumerate(turns):
            ledger.publish(robot, keys[robot], payload, "distance", number * STEP_NS)
        updates_s = (perf_counter_ns() - start_ns) / 1e9
        history = ledger.history(robots[0])
        newest_us = sample_us(_newest(ledger, robots[0]), n_retrievals, 1)[0]
        panorama_us = sample_us(_panoramas(ledger, history), n_retrievals, 1)[0]
    row = {
        "n_updates": len(turns),
        "payload_bytes": float(np.mean([len(payload) for payload in payloads])),
        "updates_per_s": len(turns) / updates_s,
        "n_retrievals": n_retrievals,
        "newest_transactions_per_s": 1e6 / newest_us,
        "panoramas_per_s": 1e6 / panorama_us,
    }
    return pd.DataFrame([row])


def summary_table(
    updates: Mapping[int, pd.DataFrame],
    retrievals: Mapping[int, pd.DataFrame],
    landmark_quality_m: Mapping[int, float] | None = None,
) -> pd.DataFrame:
    """The paper's table, measured here, with the paper's own values in rows of their own below.

    Each mapping goes from a number of positions to what was measured with it:
    ``update_latency``, ``retrieval_latency``, mean landmark quality. Columns: source,
    positions, mean_update_ms, mean_newest_transaction_ms, mean_panorama_ms,
    mean_common_landmark_ms, mean_landmark_quality_m, mean_retrieval_ms (the paper's only: which
    of the three ways it is, is not known) and note. What was not measured is NaN.
    """
    quality = landmark_quality_m or {}
    rows: list[dict[str, object]] = []
    for positions in sorted({*updates, *retrievals, *quality}):
        row: dict[str, object] = {"source": "measured here", "positions": positions, "note": ""}
        if positions in updates:
            row["mean_update_ms"] = updates[positions]["total_us"].mean() / 1e3
        if positions in retrievals:
            means_us = retrievals[positions].groupby("way")["mean_us"].mean()
            row.update({f"mean_{way}_ms": us / 1e3 for way, us in means_us.items()})
        if positions in quality:
            row["mean_landmark_quality_m"] = quality[positions]
        rows.append(row)
    columns = ["source", "positions", "mean_update_ms"]
    columns += [f"mean_{way}_ms" for way in RETRIEVALS]
    columns += ["mean_landmark_quality_m", "mean_retrieval_ms", "note"]
    table = pd.DataFrame([*rows, *PAPER.rows()], columns=columns)
    return table.astype({"positions": "Int64"})


@contextlib.contextmanager
def _new_ledger(
    folder: str | Path, robots: Sequence[str], seed: int
) -> Iterator[tuple[Ledger, dict[str, SigningKey]]]:
    keys = {robot: simulated_key(seed, robot) for robot in robots}
    members = {robot: key.public for robot, key in keys.items()}
    with Ledger.create(folder, members, simulated_key(seed, OPERATOR)) as ledger:
        yield ledger, keys


def _newest(ledger: Ledger, robot: str) -> Callable[[], object]:
    return lambda: ledger.latest(robot)


def _panoramas(ledger: Ledger, history: Sequence[Transaction]) -> Callable[[], object]:
    """Each call reads the history's next panorama."""
    digests = itertools.cycle([transaction.payload_digest for transaction in history])
    return lambda: ledger.payload(next(digests))


def _landmark(
    ledger: Ledger, robot: str, other: str, common_landmark: CommonLandmark
) -> Callable[[], object]:
    def newest_payload(name: str) -> bytes:
        transaction = ledger.latest(name)
        assert transaction is not None
        return ledger.payload(transaction.payload_digest)

    return lambda: common_landmark(newest_payload(robot), newest_payload(other))

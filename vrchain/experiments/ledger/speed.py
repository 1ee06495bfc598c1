"""How long the ledger takes beside what hashing, signing and the disk take at least.

Everything is measured in one run, and what is compared in turns, so that noise meets both alike.
"""

import contextlib
import gc
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from time import process_time_ns
from timeit import Timer
from typing import NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from vrchain.errors import LedgerError
from vrchain.experiments.ledger.baselines import (
    Cryptography,
    Disk,
    InlineChain,
    JsonChain,
    Layout,
    MemoryLedger,
    Turn,
    verification_limit,
)
from vrchain.experiments.ledger.stores import (
    SMALL,
    Site,
    Size,
    built,
    bytes_on_disk,
    grown,
    scratch_folder,
    size_of,
)
from vrchain.experiments.stopwatch import COLUMNS, Stopwatch, race_us
from vrchain.ledger import Ledger, verify

SIZE_COLUMNS = ["layout", "positions", "payload_bytes", "n_bytes", "ratio", "computed"]
POSITIONS = (40, 200, 500, 10_000, 100_000)
ROBOTS = 10
MANY_ROBOTS = 1000

MEMORY_BAR, DURABLE_BAR = 1.3, 1.5
LATEST_BAR, SAME_BAR, REFRESH_BAR = 4.0, 1.2, 5.0
VERIFY_BAR = 1 / 0.7
SIZE_BAR = 1.02

_VERIFIED = 5_000  # positions: smaller ledgers are verified several times
_STAGES = ("hash", "encode", "sign", "validate", "append_memory", "append_durable")
_LIMITS = {
    "hash": "SHA-256",
    "sign": "signature",
    "verify": "verification",
    "commit": "SQLite commit",
    "file": "file",
}

Times = NDArray[np.float64]


class Row(NamedTuple):
    """One thing timed, beside what it is held against; None where that does not apply."""

    name: str
    positions: int
    median_us: float | None = None
    reference_us: float | None = None
    ratio: float | None = None
    bar: float | None = None


@dataclass(frozen=True)
class Bench:
    """``rows`` has ``COLUMNS``: times in microseconds, ``bar`` what ``ratio`` should not exceed.

    ``sizes`` has SIZE_COLUMNS, ``computed`` where a layout is too large to be written out.
    """

    rows: pd.DataFrame
    sizes: pd.DataFrame


def bench_ledger(
    positions: Sequence[int], folder: Path, *, seed: int = 0, rounds: int = 100
) -> Bench:
    """Time updates, retrieval and verification of ledgers with so many positions, by ROBOTS robots.

    A position is one panorama of one robot. A ledger is built up first: to 500 positions and for
    MANY_ROBOTS one transaction a block, above one of each robot a block. It is verified, and
    ``rounds`` single updates are timed on top. All that lies in a new folder inside ``folder``,
    which is removed again. Raises LedgerError without positions, OutputError when it cannot write.
    """
    counts = sorted(set(positions))
    if not counts or counts[0] < 1:
        got = counts[0] if counts else "none"
        raise LedgerError(f"expected at least 1 position in each ledger to measure, got {got}")
    rows: list[Row] = []
    sizes: list[Size] = []
    with scratch_folder(folder) as scratch, contextlib.ExitStack() as stack:
        stack.callback(gc.unfreeze)
        sites = []
        for count in counts:
            site = Site(scratch / str(count), count, ROBOTS, seed)
            sites.append(site)
            memory = built(site, 1 if site.large else ROBOTS)
            sizes.append(size_of(site, "the ledger", bytes_on_disk(site.ledger)))
            rows.append(_verification(site, memory))
            with (
                Ledger.open(site.ledger, writable=True) as ledger,
                Disk(site.folder / "bare", count, _bytes_of_an_update(memory)) as disk,
                InlineChain(site.folder / "inline") as inline,
                JsonChain(site.folder / "json") as chain,
            ):
                layouts: dict[str, Layout] = {"inline": inline, "JSON": chain}
                sizes += [grown(site, name, layout) for name, layout in layouts.items()]
                gc.freeze()
                rows += _updates(site, memory, ledger, layouts, disk, rounds)
                rows += _retrieval(site, ledger, layouts, disk, rounds)
        if len(sites) > 1:
            rows.append(_same_at_both(sites[0], sites[-1], rounds))
        crowd = Site(scratch / "crowd", 2 * MANY_ROBOTS, MANY_ROBOTS, seed)
        rows.append(_verification(crowd, built(crowd, 1)))
    rows += [_size_row(size) for size in sizes]
    return Bench(pd.DataFrame(rows, columns=COLUMNS), pd.DataFrame(sizes, columns=SIZE_COLUMNS))


def as_text(bench: Bench) -> str:
    """The rows with a bar, then all others, ratios first; what verifying makes a second; sizes."""
    rows = bench.rows.assign(met=np.where(bench.rows.ratio <= bench.rows.bar, "yes", "NO"))
    verified = rows[rows.name.str.startswith("verification")][COLUMNS]
    rows = rows[["name", "positions", "ratio", "bar", "met", "median_us", "reference_us"]].round(3)
    barred = rows[rows.bar.notna()]
    sizes = bench.sizes.assign(MB=bench.sizes.n_bytes / 1e6).drop(columns="n_bytes").round(3)
    parts = [
        barred.to_string(index=False, na_rep="-"),
        rows[rows.bar.isna()].drop(columns=["bar", "met"]).to_string(index=False, na_rep="-"),
        "\n".join(
            f"{name}, {positions} positions: {1e6 / median_us:,.0f} a second, "
            f"{1 / ratio:.2f} of what SHA-256 and Ed25519 alone allow"
            for name, positions, median_us, _, ratio, _ in verified.to_numpy()
        ),
        f"on disk; ratio: over the distinct panoramas\n{sizes.to_string(index=False)}",
    ]
    return "\n\n".join(parts)


def _size_row(size: Size) -> Row:
    large = size.payload_bytes != SMALL
    bar = SIZE_BAR if large and size.layout == "the ledger" else None
    name = f"bytes of {size.layout}, {size.payload_bytes // 1000} KB"
    name += " (computed)" if size.computed else ""
    return Row(name, size.positions, ratio=size.ratio, bar=bar)


def _bytes_of_an_update(ledger: MemoryLedger) -> int:
    """What an update puts into the database: two records and their ids."""
    block, records = ledger.entries[1]
    return sum(len(record.record) + len(record.id) for record in (block, records[0]))


def _verification(site: Site, ledger: MemoryLedger) -> Row:
    """A position's share of verifying the whole ledger, beside its hashes and signatures alone.

    Of the processor's time: whole runs are long, and nothing waits for the disk, its files being
    in the page cache.
    """

    def check(_: int) -> None:
        found = verify(site.ledger)
        if not found.ok:
            raise LedgerError(f"the bench's own ledger is not good: {found.reason}")

    repeats = min(max(_VERIFIED // site.positions, 1), 15)
    times_us = race_us(
        {"limit": verification_limit(ledger), "verify": check},
        range(repeats), site.order, process_time_ns,
    )  # fmt: skip
    name = f"verification a position, {len(site.robots)} robots, {site.size}"
    whole_us, limit_us = (times_us[which] / site.positions for which in ("verify", "limit"))
    return _row(name, site.positions, whole_us, limit_us, VERIFY_BAR)


def _updates(
    site: Site,
    memory: MemoryLedger,
    ledger: Ledger,
    layouts: Mapping[str, Layout],
    disk: Disk,
    rounds: int,
) -> list[Row]:
    """Single updates on top, in memory and durable apart: waiting for a disk cools the caches.

    So do the other layouts, which race the same limits by themselves.
    """
    limits = Cryptography(bytes(len(memory.entries[1].records[0].body)))
    watches: list[Stopwatch] = []

    def update_in_memory(turn: Turn) -> None:
        watches.append(Stopwatch())
        memory.publish([turn], watches[-1].lap)

    def update(turn: Turn) -> None:
        watches.append(Stopwatch())
        robot, key, payload, timestamp_ns = turn
        ledger.publish(robot, key, payload, "distance", timestamp_ns, watches[-1].lap)

    rows = []
    for way, runner, sync, beside in (
        ("in memory", update_in_memory, None, {}),
        ("durable", update, True, {"commit": disk.commit, "file": disk.file}),
    ):
        bare = {"hash": limits.hash, "sign": limits.sign, "verify": limits.verify, **beside}
        watches.clear()
        ours = race_us({**bare, "update": runner}, list(site.turns(rounds)), site.order)
        rows += _update_rows(site, way, ours, watches)
        others = {name: partial(layout.publish, sync=sync) for name, layout in layouts.items()}
        theirs = race_us({**bare, **others}, list(site.turns(rounds // 2)), site.order)
        limit_us = np.sum([*_limits(theirs).values()], axis=0)
        rows += [
            _row(f"update {way}, {name}, {site.size}", site.positions, theirs[name], limit_us)
            for name in layouts
        ]
    rows += [
        _row(f"limit: {limit}, {site.size}", site.positions, ours[name])
        for name, limit in _LIMITS.items()
    ]
    return rows


def _limits(times_us: Mapping[str, Times]) -> dict[str, Times]:
    """What each stage of an update takes at least, (rounds,) by stage."""
    hash_us, sign_us, verify_us = (times_us[name] for name in ("hash", "sign", "verify"))
    limits = {"hash": hash_us, "sign": 2 * sign_us, "validate": verify_us}
    if "commit" in times_us:
        limits["append_durable"] = times_us["commit"] + times_us["file"]
    return limits


def _update_rows(
    site: Site, way: str, times_us: Mapping[str, Times], watches: Sequence[Stopwatch]
) -> list[Row]:
    """Whole updates beside the sum of the limits, and each stage beside its own."""
    limits = _limits(times_us)
    bar = DURABLE_BAR if way == "durable" else MEMORY_BAR if site.large else None
    name = f"update {way}, {site.size}"
    whole_us = np.sum([*limits.values()], axis=0)
    rows = [_row(name, site.positions, times_us["update"], whole_us, bar)]
    for stage in _STAGES if way == "durable" else _STAGES[:-1]:
        stage_us = np.array([watch.us(stage) for watch in watches])
        rows.append(_row(f"{name}: {stage}", site.positions, stage_us, limits.get(stage)))
    return rows


def _retrieval(
    site: Site, ledger: Ledger, layouts: Mapping[str, Layout], disk: Disk, rounds: int
) -> list[Row]:
    """What a robot asks of a ledger at its head, beside a dict, SQLite, and a hash."""
    robot = site.robots[0]
    newest = {name: ledger.latest(name) for name in site.robots}
    last = newest[robot]
    assert last is not None
    names = {
        "robot": robot,
        "newest": newest,
        "latest": ledger.latest,
        "inline": layouts["inline"].latest,
        "JSON": layouts["JSON"].latest,
        "get": disk.get,
        "refresh": ledger.refresh,
        "id": last.id,
        "transaction": ledger.transaction,
        "sha256": hashlib.sha256,
        "data": ledger.payload(last.payload_digest),
        "blob": last.payload_digest,
        "payload": ledger.payload,
    }
    lookup, get, sha256 = "newest[robot]", "get()", "sha256(data).digest()"
    us = {
        **_calls_us((lookup, "latest(robot)", "inline(robot)", "JSON(robot)"), names, 5000, rounds),
        **_calls_us((get, "refresh()", "transaction(id)"), names, 200, rounds),
        **_calls_us((sha256, "payload(blob)"), names, 5, rounds),
    }
    at = site.positions
    return [
        _row("latest(robot)", at, us["latest(robot)"], us[lookup], LATEST_BAR),
        _row("latest(robot), inline", at, us["inline(robot)"], us[lookup]),
        _row("latest(robot), JSON", at, us["JSON(robot)"], us[lookup]),
        _row("refresh()", at, us["refresh()"], us[get], REFRESH_BAR),
        _row("transaction(id)", at, us["transaction(id)"], us[get]),
        _row(f"payload(digest), {site.size}", at, us["payload(blob)"], us[sha256]),
        _row("limit: dict look-up", at, us[lookup]),
        _row("limit: SQLite get", at, us[get]),
    ]


def _same_at_both(small: Site, large: Site, rounds: int) -> Row:
    """``latest`` of the largest ledger beside that of the smallest."""
    with Ledger.open(small.ledger) as few, Ledger.open(large.ledger) as many:
        names = {"few": few.latest, "many": many.latest, "robot": small.robots[0]}
        times_us = _calls_us(("few(robot)", "many(robot)"), names, 5000, rounds)
    name = f"latest(robot), beside the one at {small.positions} positions"
    return _row(name, large.positions, times_us["many(robot)"], times_us["few(robot)"], SAME_BAR)


def _calls_us(
    calls: Sequence[str], names: Mapping[str, object], count: int, rounds: int
) -> dict[str, Times]:
    """Microseconds of each call, (rounds,): ``count`` times in a row, one after the other."""
    timers = {call: Timer(call, globals=dict(names)) for call in calls}
    times_us = {call: np.zeros(rounds) for call in calls}
    for number in range(rounds):
        for call, timer in timers.items():
            times_us[call][number] = timer.timeit(count) / count * 1e6
    return times_us


def _row(
    name: str,
    positions: int,
    times_us: Times,
    reference_us: Times | None = None,
    bar: float | None = None,
) -> Row:
    """The ratio is that of the medians."""
    median_us = float(np.median(times_us))
    if reference_us is None:
        return Row(name, positions, median_us)
    limit_us = float(np.median(reference_us))
    return Row(name, positions, median_us, limit_us, median_us / limit_us, bar)

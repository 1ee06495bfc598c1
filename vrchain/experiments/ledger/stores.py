"""Ledgers of so many positions, built up to be measured, and what they take on the disk."""

import contextlib
import gc
import shutil
import sqlite3
import tempfile
from collections.abc import Iterable, Iterator
from itertools import islice
from pathlib import Path
from typing import NamedTuple

from tqdm.auto import tqdm

from vrchain.errors import OutputError
from vrchain.experiments.ledger.baselines import Layout, MemoryLedger, Turn
from vrchain.ledger import OPERATOR, Ledger, SigningKey, simulated_key
from vrchain.ledger.rules.chain import genesis_entry
from vrchain.seeding import generator

SMALL, _LARGE = 1_000, 200_000  # bytes of a payload
_LARGE_UP_TO = 500  # positions
_COMPUTED_OVER = 2_000_000_000  # bytes of a layout that is not written out any more
_STEP_NS = 1_000_000_000  # the simulated time between two positions


def create_ledger(
    folder: Path, robots: Iterable[str], seed: int
) -> tuple[Ledger, dict[str, SigningKey]]:
    """A new ledger of simulated robots, to be closed; their keys, and the operator's."""
    keys = {name: simulated_key(seed, name) for name in (*robots, OPERATOR)}
    members = {name: key.public for name, key in keys.items() if name != OPERATOR}
    return Ledger.create(folder, members, keys[OPERATOR]), keys


class Size(NamedTuple):
    """What a layout takes on disk; ``ratio`` over the distinct panoramas themselves."""

    layout: str
    positions: int
    payload_bytes: int
    n_bytes: int
    ratio: float
    computed: bool


class Site:
    """Where a ledger of so many positions lies, by robots that take turns.

    Up to some hundred positions payloads are as large as panoramas.
    """

    def __init__(self, folder: Path, positions: int, n_robots: int, seed: int) -> None:
        folder.mkdir()
        self.folder, self.positions = folder, positions
        self.large = positions <= _LARGE_UP_TO
        self.payload_bytes = _LARGE if self.large else SMALL
        self.robots = [f"R{number}" for number in range(1, n_robots + 1)]
        self.keys = {robot: simulated_key(seed, robot) for robot in self.robots}
        self.operator = simulated_key(seed, OPERATOR)
        self.order = generator(seed, "bench", "ledger", "order")
        self._payloads = generator(seed, "bench", "ledger", "payloads", positions, n_robots)
        self._done = 0

    @property
    def ledger(self) -> Path:
        """The ledger's folder."""
        return self.folder / "ledger"

    @property
    def size(self) -> str:
        """Of the payloads, for the rows' names."""
        return f"{self.payload_bytes // 1000} KB"

    def turns(self, count: int, what: str = "") -> Iterator[Turn]:
        """The next turns, each with a payload of its own; ``what`` is said to who waits."""
        progress = tqdm(total=count, desc=f"{self.positions} positions: {what}", leave=False,
                        disable=None if what else True, unit="")  # fmt: skip
        with progress:
            for _ in range(count):
                robot = self.robots[self._done % len(self.robots)]
                payload = self._payloads.bytes(self.payload_bytes)
                yield Turn(robot, self.keys[robot], payload, self._done * _STEP_NS)
                self._done += 1
                progress.update()


@contextlib.contextmanager
def scratch_folder(folder: Path) -> Iterator[Path]:
    """A new folder inside ``folder``, removed at the end, with ``folder`` if that was made here."""
    is_new = not folder.exists()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix="bench-ledger-", dir=folder))
        try:
            yield scratch
        finally:
            shutil.rmtree(scratch, ignore_errors=True)
            if is_new:
                folder.rmdir()
    except (OSError, sqlite3.Error) as error:
        raise OutputError(
            f"cannot work in {folder}: {error}; make room or choose another folder"
        ) from error


def built(site: Site, block_length: int) -> MemoryLedger:
    """The ledger with all its positions, in memory and in the site's folder."""
    members = {robot: key.public for robot, key in site.keys.items()}
    ledger = MemoryLedger(genesis_entry(members, site.operator, 0))
    turns = site.turns(site.positions, "the ledger")
    while block := list(islice(turns, block_length)):
        ledger.publish(block)
    ledger.store(site.ledger)
    gc.freeze()  # what the bench holds would be gone through again and again while it measures
    return ledger


def grown(site: Site, name: str, layout: Layout) -> Size:
    """Bring a layout to all positions, or if it gets too large, to where its blocks are full."""
    full = min(len(site.robots) + 1, site.positions)
    for turn in site.turns(full, name):
        before = layout.n_bytes
        layout.publish(turn, sync=False)
    rest = site.positions - full
    n_bytes = layout.n_bytes + rest * (layout.n_bytes - before)
    if n_bytes > _COMPUTED_OVER:
        return size_of(site, name, n_bytes, computed=True)
    for turn in site.turns(rest, name):
        layout.publish(turn, sync=False)
    return size_of(site, name, layout.n_bytes)


def size_of(site: Site, name: str, n_bytes: int, computed: bool = False) -> Size:
    """What a layout with all of a site's positions takes."""
    ratio = n_bytes / (site.positions * site.payload_bytes)
    return Size(name, site.positions, site.payload_bytes, n_bytes, ratio, computed)


def bytes_on_disk(folder: Path) -> int:
    """What the folder takes of the disk, its files' last blocks and the folders included."""
    stats = [path.stat() for path in (folder, *folder.rglob("*"))]
    return sum(max(stat.st_size, stat.st_blocks * 512) for stat in stats)

"""How large a ledger grows with positions and robots, beside the paper's inline layout.

In the paper's layout every block carries the newest panorama of every robot, so that each panorama
is stored again by every block until its robot's next one. Sizes are those of real files, closed; an
inline layout over ``LIMIT_BYTES`` is added up from its records' lengths and never written.
"""

import tempfile
from collections.abc import Iterator, Sequence
from itertools import accumulate, islice, pairwise
from pathlib import Path

import pandas as pd

from vrchain.experiments.ledger.stores import create_ledger
from vrchain.ledger import OPERATOR, Ledger, Offer, Transaction
from vrchain.seeding import generator

LIMIT_BYTES = 2_000_000_000
TEAM = 10  # robots of the ledgers with several transactions a block, and with retention
TOGETHER = 10  # transactions in one block
KEEP = 5  # newest panoramas of each robot that retention leaves
LAYOUTS = {
    "inline": "the paper's: every robot's newest panorama in every block",
    "one a block": "ours: each panorama once, one transaction a block",
    "several a block": f"ours, {TOGETHER} transactions a block",
    "retention": f"ours, each robot's newest {KEEP} panoramas kept",
}
COLUMNS = ["layout", "robots", "positions", "panorama_bytes", "size_bytes", "computed"]


def ledger_sizes(
    positions: Sequence[int],
    robots: Sequence[int],
    payload_bytes: int,
    limit_bytes: int = LIMIT_BYTES,
) -> pd.DataFrame:
    """Sizes at each number of positions, published by the robots in turn; one row a ledger.

    positions: rising. robots: how many, for ``inline`` and ``one a block``; the other LAYOUTS are
    for TEAM robots. Each position's panorama is ``payload_bytes`` random bytes. Columns: COLUMNS;
    panorama_bytes is what the panoramas that the layout holds have when each is counted once,
    size_bytes all that it has in files, computed whether these were added up instead of written.
    """
    rows: list[tuple[object, ...]] = []
    with tempfile.TemporaryDirectory(prefix="vrchain-sizes-") as name:
        folder = Path(name)
        for n_robots in robots:
            own = folder / f"robots {n_robots}"
            grown = _grow(own, positions, n_robots, payload_bytes)
            rows += [("one a block", n_robots, *row, False) for row in grown]
            inline = _inline(own, positions, payload_bytes, folder / "inline", limit_bytes)
            rows += [("inline", n_robots, *row) for row in inline]
        for layout, together, keep in (("several a block", TOGETHER, 0), ("retention", 1, KEEP)):
            grown = _grow(folder / layout, positions, TEAM, payload_bytes, together, keep)
            rows += [(layout, TEAM, *row, False) for row in grown]
    return pd.DataFrame(rows, columns=COLUMNS)


def _grow(
    folder: Path,
    positions: Sequence[int],
    n_robots: int,
    payload_bytes: int,
    together: int = 1,
    keep: int = 0,
) -> Iterator[tuple[int, int, int]]:
    """Positions, bytes of the panoramas in store, and bytes in all, as a ledger grows.

    ``together``: transactions in a block. ``keep``: panoramas a robot that a drop leaves after
    each round of the robots, 0 for no drops.
    """
    robots = [f"R{number}" for number in range(1, n_robots + 1)]
    ledger, keys = create_ledger(folder, robots, 0)
    ledger.close()
    draws = generator(0, "bloat")
    for done, stop in pairwise((0, *positions)):
        with Ledger.open(folder, writable=True) as ledger:
            for start in range(done, stop, together):
                numbers = range(start, min(start + together, stop))
                offers = []
                for number in numbers:
                    robot, payload = robots[number % n_robots], draws.bytes(payload_bytes)
                    draft = ledger.draft_transaction(robot, payload, "distance", number)
                    offers.append(Offer(draft.signed(keys[robot]), payload))
                author = offers[0].transaction.robot
                ledger.append_many(offers, author, keys[author])
                if keep and numbers[-1] % n_robots == n_robots - 1:
                    ledger.drop_old(keep, keys[OPERATOR], numbers[-1])
        stored = sum(path.stat().st_size for path in (folder / "blobs").iterdir())
        size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
        yield stop, stored, size


def _inline(
    folder: Path, positions: Sequence[int], payload_bytes: int, path: Path, limit_bytes: int
) -> Iterator[tuple[int, int, int, bool]]:
    """The same blocks in the paper's layout, one after another in the file ``path``.

    Positions, bytes of the panoramas counted once, bytes in all, and whether these are computed.
    """
    with Ledger.open(folder) as ledger, open(path, "wb") as file:
        sizes = accumulate(sum(map(len, parts)) for parts in _inline_blocks(ledger))
        expected = dict(enumerate(sizes))
        written = [n for n in positions if expected[n] <= limit_bytes]
        blocks = islice(_inline_blocks(ledger), max(written, default=-1) + 1)
        for height, parts in enumerate(blocks):
            file.writelines(parts)
            if height in written:
                file.flush()
                expected[height] = path.stat().st_size
    for n in positions:
        yield n, n * payload_bytes, expected[n], n not in written
    path.unlink()


def _inline_blocks(ledger: Ledger) -> Iterator[list[bytes]]:
    """What each block holds in the paper's layout: its record, everybody's newest with panorama."""
    newest: dict[str, bytes] = {}
    for block, records in ledger.entries():
        for record in records:
            if isinstance(record, Transaction):
                newest[record.robot] = record.record + ledger.payload(record.payload_digest)
        yield [block.record, *newest.values()]

"""What a team sends, by how many robots it has: bytes and messages on the wire.

Each robot has taken one panorama, and in the end everyone can have everyone's. The published
argument counts the panoramas that robots send each other, which grow with the square of their
number, against one that each sends to a ledger. A ledger that every robot has a copy of delivers
everything to everyone all the same: what is saved is what a robot sends, not what is received.

Messages are those of a real ledger, encoded as they travel; payloads are random bytes, as many as
a panorama has. ``over_servers`` measures on three servers what ``transmission`` counts.
"""

import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack, closing
from pathlib import Path

import pandas as pd

from vrchain.errors import LedgerError
from vrchain.experiments.ledger.cluster import PATIENCE_S, PAYLOAD_BYTES, team
from vrchain.experiments.ledger.stores import create_ledger
from vrchain.ledger import Ledger, Offer
from vrchain.ledger.network.message import pack_entry, pack_offer
from vrchain.seeding import generator

ROBOTS = (2, 5, 10, 20, 50)
SERVERS = 3
WAYS = {
    "everyone": "everyone to everyone",
    "blobs": "ledger, all panoramas to all",
    "fetched": "ledger, records to all, panoramas fetched",
}
COLUMNS = ["way", "robots", "messages", "bytes", "sent_bytes", "measured"]
_REQUEST_BYTES = 32  # a panorama's digest


def transmission(
    robots: Sequence[int] = ROBOTS,
    payload_bytes: int = PAYLOAD_BYTES,
    fetches: int = 1,
    *,
    seed: int = 0,
) -> pd.DataFrame:
    """One row for each of WAYS and number of robots. Columns: COLUMNS.

    messages, bytes: of all, each counted as often as it is sent. sent_bytes: what one robot sends.
    With a ledger a robot sends an offer to one of SERVERS servers, these copy it to each other and
    hand it to a maker, whose block they copy and hand to every robot. ``fetched``, which is counted
    though the ledger has no such way yet: offers and blocks without panoramas, and each robot
    fetches ``fetches`` of them from the robots that took them.
    """
    rows = []
    for count in robots:
        whole, bare = message_sizes(count, payload_bytes, seed)
        others = count - 1
        (offer, block), (small_offer, small_block) = whole, bare
        fetched = min(fetches, others)
        panorama = payload_bytes + _REQUEST_BYTES
        ledger = count * (2 * SERVERS + 1 + count)  # offer to servers and maker, block to all
        rows += [
            ("everyone", count, count * others, offer * others * count, offer * others),
            ("blobs", count, ledger, _carried(offer, block, count), offer),
            (
                "fetched", count, ledger + 2 * count * fetched,
                _carried(small_offer, small_block, count) + count * fetched * panorama,
                small_offer + fetched * panorama,
            ),
        ]  # fmt: skip
    return pd.DataFrame([(*row, False) for row in rows], columns=COLUMNS)


def over_servers(
    robots: Sequence[int] = ROBOTS, payload_bytes: int = PAYLOAD_BYTES, *, seed: int = 0
) -> pd.DataFrame:
    """What servers count as robots offer one panorama each and hear every block. As above.

    With it are the servers' own words: acknowledgements, elections, and what one server passes on
    to another for robots that are connected there.
    """
    rows = [("blobs", count, *_measured(count, payload_bytes, seed), True) for count in robots]
    return pd.DataFrame(rows, columns=COLUMNS)


def message_sizes(
    count: int, payload_bytes: int, seed: int
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Mean bytes of an offer and a block of one transaction; and of both without panoramas."""
    with tempfile.TemporaryDirectory() as scratch:
        offers, blocks = 0, 0
        with _panoramas(Path(scratch) / "ledger", count, payload_bytes, seed) as ledger:
            for entry in ledger.entries(1):
                blobs = ledger.blobs_of(entry)
                (payload,) = blobs.values()
                offers += len(pack_offer(Offer(entry.records[0], payload)))  # type: ignore[arg-type]
                blocks += len(pack_entry(entry, blobs))
    offer, block = offers / count, blocks / count
    return (offer, block), (offer - payload_bytes, block - payload_bytes)


def _panoramas(folder: Path, count: int, payload_bytes: int, seed: int) -> Ledger:
    """A new ledger in which each robot has published one."""
    names = [f"R{number + 1}" for number in range(count)]
    ledger, keys = create_ledger(folder, names, seed)
    draws = generator(seed, "transmission")
    for number, name in enumerate(names):
        ledger.publish(name, keys[name], draws.bytes(payload_bytes), "view", number)
    return ledger


def _carried(offer: float, block: float, count: int) -> float:
    return count * (offer * (SERVERS + 1) + block * (SERVERS + count))


def _measured(count: int, payload_bytes: int, seed: int) -> tuple[int, int, int]:
    """Messages and bytes on all wires, and those that one robot sent."""
    draws = generator(seed, "transmission")
    with team(count, seed, SERVERS) as made, ExitStack() as stack:
        streams = [stack.enter_context(closing(made.stream())) for _ in made.robots]
        for stream in streams:
            list(stream.follow(0))
        with Ledger.open(made.folder / "origin") as origin:
            offers = []
            for robot in made.robots:
                payload = draws.bytes(payload_bytes)
                draft = origin.draft_transaction(robot, payload, "view", 0)
                offers.append(Offer(draft.signed(made.keys[robot]), payload))
        before = made.cluster.traffic()
        for stream, offer in zip(streams, offers, strict=True):
            transaction = offer.transaction
            stream.offer(transaction.robot, transaction.id, pack_offer(offer))
        until_s = time.monotonic() + PATIENCE_S
        while sum(streams[0].waiting().values()) or not all(
            stream.known >= newest for newest in [streams[0].newest()] for stream in streams
        ):
            if time.monotonic() > until_s:
                raise LedgerError(f"{count} panoramas have not come to every robot in time")
            time.sleep(0.05)
        messages, size = (b - a for a, b in zip(before, made.cluster.traffic(), strict=True))
    return messages, size, len(pack_offer(offers[0]))

"""How servers keep a ledger: its streams of blocks and offers, made, or brought up to date."""

from typing import TYPE_CHECKING

from vrchain.ledger.network.connection import API, Connection
from vrchain.ledger.network.message import MAX_MESSAGE_BYTES
from vrchain.ledger.network.stream import (
    BLOCKS,
    MAKER,
    MAKERS,
    OFFERS,
    OFFERS_WAITING,
    SAID,
    ask,
)

if TYPE_CHECKING:
    from nats.aio.client import Client

MOST_REPLICAS, _REPLICAS = 5, 3  # that servers take, and usually
_OFFERS_BYTES = 1 << 30  # of all robots
_ACK_WAIT_S = 5.0  # after which an offer that a maker took is given out again
_PINNED_S = 5.0  # for which the maker that is given all has asked for none, until another is
_DUPLICATES_S = 120.0  # for which servers know a message that they have stored


def set_up(
    connection: Connection, replicas: int | None = None, max_bytes: int | None = None
) -> None:
    """Make the streams of a ledger, or bring what is there up to date. ClusterError.

    ``replicas``: on how many servers each message is kept, 3 of several without; ``max_bytes``:
    that the blocks may take on each server's disk, all of it without. What is there keeps its own.
    """
    from nats.js import api
    from nats.js.errors import NotFoundError

    # Before all else: no block is ever deleted, and when there is no room no old one goes.
    blocks = api.StreamConfig(
        name=BLOCKS, subjects=[BLOCKS], storage=api.StorageType.FILE,
        retention=api.RetentionPolicy.LIMITS, discard=api.DiscardPolicy.NEW, max_bytes=max_bytes,
        deny_delete=True, deny_purge=True, allow_direct=True, duplicate_window=_DUPLICATES_S,
        republish=api.RePublish(src=BLOCKS, dest=SAID),
    )  # fmt: skip
    offers = api.StreamConfig(
        name=OFFERS, subjects=[f"{OFFERS}.*"], storage=api.StorageType.FILE,
        retention=api.RetentionPolicy.WORK_QUEUE, discard=api.DiscardPolicy.NEW,
        max_msgs_per_subject=OFFERS_WAITING, discard_new_per_subject=True,
        max_bytes=_OFFERS_BYTES, max_msg_size=MAX_MESSAGE_BYTES, duplicate_window=_DUPLICATES_S,
    )  # fmt: skip
    maker = api.ConsumerConfig(
        durable_name=MAKER, ack_policy=api.AckPolicy.EXPLICIT, ack_wait=_ACK_WAIT_S,
        max_ack_pending=-1,  # what waits is bounded; or a few members' would keep others' out
    )  # fmt: skip

    # A robot's offers are in order: two makers that got every second one would wait for each other.
    pinned = {
        "priority_groups": [MAKERS], "priority_policy": "pinned_client",
        "priority_timeout": int(_PINNED_S * 1e9),
    }  # fmt: skip
    asked = {"stream_name": OFFERS, "config": maker.as_dict() | pinned}

    async def add(client: "Client") -> None:
        stream = client.jetstream(prefix=API, timeout=connection.servers.timeout_s)
        several = "cluster" in client._server_info
        for config in (blocks, offers):
            try:
                there = (await stream.stream_info(str(config.name))).config
                n, most = there.num_replicas, there.max_bytes
                does, make = "UPDATE", stream.update_stream
            except NotFoundError:
                n, most = _REPLICAS if several else 1, -1
                does, make = "CREATE", stream.add_stream
            wanted = config.evolve(num_replicas=replicas or n, max_bytes=config.max_bytes or most)
            await connection.permitted(f"{API}.STREAM.{does}.{config.name}", make(wanted))
        await ask(client, f"CONSUMER.DURABLE.CREATE.{OFFERS}.{MAKER}", asked)

    connection.run(add, 3 * connection.servers.timeout_s)

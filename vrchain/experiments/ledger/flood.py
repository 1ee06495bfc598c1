"""What robots at work notice of a member that floods the servers."""

import itertools
import signal
import subprocess
import sys
from contextlib import closing

import numpy as np
import pandas as pd

from vrchain.experiments.ledger.child import python
from vrchain.experiments.ledger.cluster import PATIENCE_S, PAYLOAD_BYTES, team, waits_ms
from vrchain.ledger.errors import ClusterError, UnavailableError
from vrchain.ledger.network.connection import Connection, Servers
from vrchain.ledger.network.stream import Stream

_CODE = """
import sys
from vrchain.experiments.ledger.flood import flood_offers
flood_offers(*sys.argv[1:])
"""


def flooded(seconds: float = 10.0, *, seed: int = 0) -> pd.DataFrame:
    """Two robots at work, quiet and while a third offers rubbish as fast as servers take it.

    One row each: name, n, median_ms, p99_ms, longest_ms, ratio (of the p99 to the quiet one), and
    of the flood: taken (offers of 200 KB that the servers took), refused (those over its limit).
    """
    with team(3, seed) as made:
        phases = {"quiet": waits_ms(made, seconds, made.robots[:2])}
        words = ("-c", _CODE, made.cluster.address, made.robots[2])
        flood = python(*words, stdout=subprocess.PIPE)
        try:
            phases["flooded"] = waits_ms(made, seconds, made.robots[:2])
            flood.terminate()
            taken, refused = map(int, flood.communicate(timeout=PATIENCE_S)[0].split())
        finally:
            flood.kill()
            flood.wait()
    rows = []
    for name, waits in phases.items():
        ms = np.concatenate([np.array(own) for own in waits.values()])
        p99_ms = float(np.quantile(ms, 0.99))
        counts = (taken, refused) if name == "flooded" else (0, 0)
        rows.append((name, len(ms), np.median(ms), p99_ms, ms.max(), p99_ms, *counts))
    columns = ["name", "n", "median_ms", "p99_ms", "longest_ms", "ratio", "taken", "refused"]
    table = pd.DataFrame(rows, columns=columns)
    return table.assign(ratio=table.ratio / table.ratio.iloc[0])


def flood_offers(address: str, robot: str) -> None:
    """What a hostile member's process does in ``flooded``, until it is ended."""
    counts, rubbish = [0, 0], bytes(PAYLOAD_BYTES)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(print(*counts)))
    with closing(Stream(Connection(Servers.at(address)))) as stream:
        for number in itertools.count():
            try:
                stream.offer(robot, number.to_bytes(32, "big"), rubbish)
                counts[0] += 1
            except ClusterError:
                counts[1] += 1
            except UnavailableError:  # they have too much to do, as is meant
                continue

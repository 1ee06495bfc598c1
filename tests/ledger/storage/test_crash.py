"""Writers that are killed, and several at once: nothing acknowledged is lost."""

import signal
import subprocess
import time
from pathlib import Path

import pytest
from ledgers import KEYS, child, new_ledger

from vrchain.ledger import Ledger, verify
from vrchain.seeding import generator

# Publishes for ever, or a given number of times; says each id once it is acknowledged.
WRITER = """
import sys
from ledgers import KEYS
from vrchain.ledger import Ledger
folder, robot, count, size = sys.argv[1], sys.argv[2], int(sys.argv[3]), int(sys.argv[4])
with Ledger.open(folder, writable=True, wait_s=30) as ledger:
    for number in range(count):
        ledger.refresh()
        last = ledger.latest(robot)
        sequence = last.sequence + 1 if last else 0
        payload = b"%s %d " % (robot.encode(), sequence) + bytes(size)
        transaction = ledger.publish(robot, KEYS[robot], payload, "time", ledger.head.timestamp_ns)
        print(transaction.id.hex(), flush=True)
"""


def writer(folder: Path, robot: str, count: int, size: int) -> subprocess.Popen[str]:
    return child(WRITER, folder, robot, count, size)


def acknowledged(output: str) -> list[bytes]:
    """The ids of all whole lines."""
    return [bytes.fromhex(line) for line in output.split("\n")[:-1]]


@pytest.mark.timeout(1800)
@pytest.mark.parametrize("kills", [5, pytest.param(200, marks=pytest.mark.slow)])
def test_a_killed_writer_loses_nothing_acknowledged(
    tmp_path: Path, kills: int, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "ledger"
    new_ledger(folder).close()
    source = generator(0, "kills", kills)
    known: list[bytes] = []
    counts = {"acknowledged": 0, "durable, not yet acknowledged": 0, "orphans cleaned": 0}
    for _ in range(kills):
        process = writer(folder, "R1", count=10**9, size=50_000)
        assert process.stdout is not None
        first = process.stdout.readline()
        time.sleep(source.uniform(0, 0.1))
        process.send_signal(signal.SIGKILL)
        said = acknowledged(first + process.communicate()[0])
        known += said
        found = verify(folder)
        assert found.ok, found.reason
        with Ledger.open(folder, writable=True) as ledger:
            history = ledger.history("R1")
            orphans = {p.name for p in (folder / "blobs").iterdir()}
            orphans -= {transaction.payload_digest.hex() for transaction in history}
            assert ledger.clean() == len(orphans) <= 1
        stored = [transaction.id for transaction in history]
        # At most the one that was being acknowledged is there beside the known ones.
        assert set(known) <= set(stored)
        assert len(stored) - len(known) <= 1
        counts["acknowledged"] += len(said)
        counts["durable, not yet acknowledged"] += len(stored) - len(known)
        counts["orphans cleaned"] += len(orphans)
        known = stored
    assert len(known) > 2 * kills
    with capsys.disabled():
        print(f"\nkilled {kills} times: {counts}")


KILLED_AT = """
import os, signal, sys
from ledgers import KEYS
from vrchain.ledger import Ledger, store
from vrchain.ledger.storage import durable

def die(*given):
    os.kill(os.getpid(), signal.SIGKILL)

place = {"the blob's rename": (durable.os, "replace"), "the record": (store, "insert_entry")}
setattr(*place[sys.argv[2]], die)
with Ledger.open(sys.argv[1], writable=True) as ledger:
    ledger.publish("R1", KEYS["R1"], b"second", "time", 2)
"""


@pytest.mark.parametrize("moment", ["the blob's rename", "the record"])
def test_killed_before_the_record_leaves_one_orphan_that_is_cleaned(
    ledger: Ledger, moment: str
) -> None:
    folder = ledger.folder
    first = ledger.publish("R1", KEYS["R1"], b"first", "start", 1)
    died = child(KILLED_AT, folder, moment)
    assert died.wait(timeout=60) == -signal.SIGKILL
    (orphan,) = {p.name for p in (folder / "blobs").iterdir()} - {first.payload_digest.hex()}
    assert orphan.endswith(".tmp") == (moment == "the blob's rename")
    assert verify(folder).blocks == 2
    assert ledger.clean() == 1
    assert ledger.history("R1") == [first]
    assert ledger.publish("R1", KEYS["R1"], b"second", "time", 2).sequence == 1
    assert verify(folder).blocks == 3


FOLLOWER = """
import sys
from vrchain.ledger import Ledger
with Ledger.open(sys.argv[1]) as ledger:
    for entry in ledger.follow(0, wait_s=20):
        for record in entry.records[:entry.block.height]:
            ledger.payload(record.payload_digest)
        if entry.block.height == 60:
            print(entry.block.hash.hex())
            break
"""


def test_writers_readers_and_a_cleaner_at_once(ledger: Ledger) -> None:
    """The cleaner holds the same lock, and takes nothing that a writer needs."""
    followers = [child(FOLLOWER, ledger.folder) for _ in range(3)]
    writers = {robot: writer(ledger.folder, robot, 30, size=1000) for robot in ("R1", "R2")}
    while any(process.poll() is None for process in writers.values()):
        assert ledger.clean() == 0
        time.sleep(0.005)  # let the writers have the lock
    assert ledger.head.height == 60
    for robot, process in writers.items():
        said = acknowledged(process.communicate()[0])
        assert [transaction.id for transaction in ledger.history(robot)] == said
    head = ledger.head.hash.hex()
    assert [follower.communicate(timeout=60)[0].strip() for follower in followers] == [head] * 3
    assert verify(ledger.folder).blocks == 61

"""Writers take turns: who came first writes first, and nobody who is gone holds up the others."""

import signal
import time
from pathlib import Path
from subprocess import PIPE

import pytest
from ledgers import KEYS, child

from vrchain.ledger import Ledger, verify
from vrchain.ledger.storage.turns import Turns

WRITERS = """
import sys, time
from ledgers import KEYS
from vrchain.ledger import Ledger
with Ledger.open(sys.argv[1], writable=True) as ledger:
    print("ready", flush=True)
    sys.stdin.readline()
    until, count = time.monotonic() + 2, 0
    while time.monotonic() < until:
        ledger.publish(sys.argv[2], KEYS[sys.argv[2]], bytes(200_000), "time", 60)
        count += 1
print(count)
"""

WAITER = """
import sys
from pathlib import Path
from vrchain.ledger.storage.turns import Turns
turns = Turns(Path(sys.argv[1]), True)
turns._lock(0, 1, 1)
print("waits", flush=True)
sys.stdin.readline()
"""


def test_writers_that_write_again_and_again_take_turns(folder: Path) -> None:
    writers = [child(WRITERS, folder, robot, stdin=PIPE) for robot in ("R1", "R2") * 2]
    for writer in writers:
        assert writer.stdout.readline() == "ready\n"
    for writer in writers:
        writer.stdin.write("go\n")
        writer.stdin.flush()
    counts = [int(writer.communicate(timeout=60)[0]) for writer in writers]
    assert min(counts) >= 0.7 * max(counts) - 3
    assert verify(folder).blocks == 6 + sum(counts)


def test_the_first_to_come_is_the_first_to_go(tmp_path: Path) -> None:
    turns = [Turns(tmp_path, writable=True) for _ in range(4)]
    first = turns[0].turn(0.0)
    assert first.__enter__()
    waiting = []
    for other in turns[1:3]:
        waiting.append(other.turn(0.0))
        assert not waiting[-1].__enter__()  # it stays in the queue for as long as its block lasts
    first.__exit__(None, None, None)
    with turns[3].turn(0.0) as has_come:
        assert not has_come
    with turns[0].turn(0.0) as has_come:  # who has just written comes behind
        assert not has_come
    for other in waiting:
        other.__exit__(None, None, None)
    with turns[0].turn(0.0) as has_come:
        assert has_come
    for each in turns:
        each.close()
        each.close()


def test_who_was_killed_or_stopped_while_waiting_holds_up_nobody(folder: Path) -> None:
    waiter = child(WAITER, folder, stdin=PIPE)
    assert waiter.stdout.readline() == "waits\n"
    with Ledger.open(folder, writable=True, wait_s=0.2) as ledger:
        began = time.monotonic()
        ledger.publish("R1", KEYS["R1"], b"x", "time", 60)  # it waits, and goes ahead then
        assert time.monotonic() - began >= 0.2
        assert ledger._db.execute("PRAGMA busy_timeout").fetchone() == (200,)
        waiter.send_signal(signal.SIGKILL)
        waiter.wait()
    with Ledger.open(folder, writable=True, wait_s=3600) as ledger:
        ledger.publish("R1", KEYS["R1"], b"x", "time", 60)


@pytest.mark.parametrize("last", [0, (1 << 63) - 1])
def test_a_lock_on_the_whole_file_is_no_queue(tmp_path: Path, last: int) -> None:
    mine, other = Turns(tmp_path, True), Turns(tmp_path, True)
    other._lock(0, 1, last)
    with mine.turn(3600) as has_come:
        assert has_come
    mine.close()
    other.close()

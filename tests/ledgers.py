"""Small ledgers for the tests, and other processes that use them."""

import os
import random
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import vrchain
from vrchain.ledger import Ledger, Offer, simulated_key
from vrchain.ledger.records.block import Block, Entry, Record, records_root
from vrchain.ledger.records.membership import Enrolment, Expulsion
from vrchain.ledger.records.table import Table
from vrchain.ledger.records.transaction import NO_TRANSACTION, Transaction
from vrchain.ledger.rules.chain import Chain, genesis_entry

ROOT = Path(vrchain.__file__).parent.parent
OPERATOR_KEY = simulated_key(0, "operator")
KEYS = {robot: simulated_key(0, robot) for robot in ("R1", "R2", "R3")}
PUBLIC = {robot: KEYS[robot].public for robot in ("R1", "R2")}


def new_ledger(folder: Path) -> Ledger:
    return Ledger.create(folder, PUBLIC, OPERATOR_KEY, name="test")


def small_ledger(folder: Path) -> bytes:
    """A closed ledger: genesis, R1, R2, the enrolment of R3, R3, R1. Its head hash."""
    with new_ledger(folder) as ledger:
        ledger.publish("R1", KEYS["R1"], b"first of R1", "start", 10)
        ledger.publish("R2", KEYS["R2"], b"first of R2", "start", 20)
        ledger.enrol("R3", KEYS["R3"].public, OPERATOR_KEY, 30)
        ledger.publish("R3", KEYS["R3"], b"first of R3", "start", 40)
        ledger.publish("R1", KEYS["R1"], b"second of R1", "distance", 50)
        return ledger.head.hash


def files(folder: Path) -> dict[str, bytes]:
    """Everything in a folder but SQLite's own working files."""
    found = [path for path in sorted(folder.rglob("*")) if path.is_file()]
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in found
        if not path.name.endswith(("-wal", "-shm"))
    }


def new_chain() -> Chain:
    return Chain(genesis_entry(PUBLIC, OPERATOR_KEY, 0, "test"))


def next_entry(
    chain: Chain, robot: str = "R1", timestamp_ns: int = 10, author: str = "R1"
) -> Entry:
    """A valid entry with one transaction."""
    draft = chain.draft(robot, bytes(32), "view", timestamp_ns)
    return entry_of(chain, draft.signed(KEYS[robot]), author=author)


def entry_of(chain: Chain, *records: Record, author: str = "R1") -> Entry:
    """These records, valid or not, in a block that goes with them and is itself signed well."""
    head = chain.head
    newest = dict(head.newest)
    for record in records:
        if isinstance(record, Transaction):
            newest[record.robot] = record.id
        elif isinstance(record, Enrolment):
            newest[record.name] = NO_TRANSACTION
        elif isinstance(record, Expulsion):
            newest.pop(record.name, None)
    times_ns = [head.timestamp_ns, *(record.timestamp_ns for record in records)]
    table = Table(newest)
    root = records_root(records)
    block = Block(head.height + 1, head.hash, max(times_ns), root, table.root, author, table)
    return Entry(block.signed(KEYS.get(author, OPERATOR_KEY)), records)


def child(
    code: str, *arguments: object, hash_seed: str = "0", stdin: int | None = None
) -> subprocess.Popen[str]:
    """Code in a fresh interpreter, which finds this module.

    With one pipe only, ``communicate`` has all that ``readline`` left, and loses no line.
    """
    paths = {"PYTHONPATH": f"{ROOT}:{ROOT / 'tests'}", "PYTHONHASHSEED": hash_seed}
    return subprocess.Popen(
        [sys.executable, "-c", code, *map(str, arguments)],
        stdin=stdin,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, **paths},
    )


def said_by(code: str, *arguments: object, hash_seed: str = "0") -> str:
    """What code prints in a fresh interpreter, which ends without an error."""
    process = child(code, *arguments, hash_seed=hash_seed)
    said = process.communicate(timeout=60)[0]
    assert process.returncode == 0  # its complaint is on stderr
    return said


def garbage(draws: int, good: Sequence[bytes]) -> list[bytes]:
    """Random bytes, and good ones with some bytes changed, cut out, put in or repeated."""
    source = random.Random(0)
    found = [source.randbytes(source.randrange(300)) for _ in range(draws // 10)]
    for number in range(draws):
        data = bytearray(good[number % len(good)])
        for _ in range(source.randint(1, 3)):
            start = source.randrange(len(data) + 1)
            end = min(len(data), start + source.choice([0, 1, 1, 1, 4, 40]))
            data[start:end] = source.choice(
                [b"", b"\0", b"\xff", source.randbytes(end - start), bytes(data[start:end]) * 2]
            )
        found.append(bytes(data))
    return found


def long_ledger(folder: Path) -> bytes:
    """A closed ledger with records of every kind, some blobs dropped. Its head hash."""
    small_ledger(folder)
    with Ledger.open(folder, writable=True) as ledger:
        ledger.publish("R2", KEYS["R2"], b"second of R2", "view", 60, landmarks=b"seen by R2")
        ledger.publish("R2", KEYS["R2"], b"third of R2", "time", 70, landmarks=b"seen by R2")
        ledger.expel("R3", OPERATOR_KEY, 80)
        ledger.drop_old(1, OPERATOR_KEY, 90)
        ledger.publish("R1", KEYS["R1"], b"first of R1", "time", 100)  # dropped, and here again
        drafts = [ledger.draft_transaction(r, r.encode(), "view", 110) for r in ("R1", "R2")]
        offers = [Offer(t.signed(KEYS[t.robot]), t.robot.encode()) for t in drafts]
        ledger.append_many(offers, "R2", KEYS["R2"])
        return ledger.head.hash

"""Small ledgers for the tests."""

import subprocess
import sys
from pathlib import Path

import vrchain
from vrchain.ledger import Ledger, simulated_key
from vrchain.ledger.block import Entry
from vrchain.ledger.chain import Chain, genesis_entry
from vrchain.ledger.transaction import Transaction

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


def next_entry(chain: Chain, robot: str = "R1", timestamp_ns: int = 10) -> Entry:
    """A valid entry with one transaction."""
    draft = chain.draft_transaction(robot, bytes(32), "view", timestamp_ns)
    return entry_of(chain, draft.signed(KEYS[robot]))


def entry_of(chain: Chain, *records: Transaction, author: str = "R1") -> Entry:
    """These records, valid or not, in a block that is itself signed well."""
    key = KEYS.get(author, OPERATOR_KEY)
    return Entry(chain.draft_block(records, author).signed(key), records)


def in_child(code: str, *arguments: str, hash_seed: str = "0") -> subprocess.CompletedProcess[str]:
    """Run code in a fresh interpreter."""
    return subprocess.run(
        [sys.executable, "-c", code, *arguments],
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
        env={"PYTHONPATH": f"{ROOT}:{ROOT / 'tests' / 'ledger'}", "PYTHONHASHSEED": hash_seed},
    )

"""A verifier made from the documentation alone comes to the same verdict.

``test_verify`` asks it about every ledger that is spoilt there.
"""

import ast
import subprocess
import sys
from pathlib import Path

from ledgers import ROOT, long_ledger, new_ledger, small_ledger

from vrchain.ledger import verify

VERIFIER = ROOT / "tests" / "independent_verifier.py"


def independently(folder: Path, *arguments: str) -> str:
    """What it says, "good ..." or "bad: ..."; run as a program, apart from this process."""
    done = subprocess.run(
        [sys.executable, str(VERIFIER), str(folder), *arguments],
        capture_output=True, text=True, check=False, timeout=60,
    )  # fmt: skip
    said = done.stdout if done.returncode == 0 else done.stderr
    assert "Traceback" not in said
    return said.strip()


def test_it_is_short_and_knows_nothing_of_vrchain() -> None:
    source = VERIFIER.read_text()
    assert len(source.splitlines()) <= 150
    nodes = list(ast.walk(ast.parse(source)))
    names = {name.name for node in nodes if isinstance(node, ast.Import) for name in node.names}
    names |= {node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)}
    assert {name.partition(".")[0] for name in names} == {
        "cryptography", "hashlib", "pathlib", "sqlite3", "sys"
    }  # fmt: skip


def test_good_ledgers_and_an_unknown_head(tmp_path: Path) -> None:
    head = small_ledger(tmp_path / "small")
    assert independently(tmp_path / "small") == f"good {head.hex()} dropped 0"
    assert independently(tmp_path / "small", bytes(32).hex()).startswith("bad: ")
    head = long_ledger(tmp_path / "long")
    dropped = verify(tmp_path / "long").dropped
    assert independently(tmp_path / "long", head.hex()) == f"good {head.hex()} dropped {dropped}"
    assert dropped > 0
    new_ledger(tmp_path / "new").close()
    assert independently(tmp_path / "new").startswith("good ")

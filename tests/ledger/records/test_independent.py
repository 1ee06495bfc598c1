"""A verifier made from the documentation alone comes to the same verdict."""

import ast
import shutil
import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import independent_verifier as independent
import pytest
from ledgers import ROOT, long_ledger, new_ledger, small_ledger

from vrchain.ledger import verify
from vrchain.ledger.records.keys import DATABASE_NAME

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
    imported = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.Import)]
    names = {alias.name for node in imported for alias in node.names}
    found = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.ImportFrom)]
    names |= {node.module or "" for node in found}
    assert {name.partition(".")[0] for name in names} == {
        "cryptography", "hashlib", "pathlib", "sqlite3", "sys"
    }  # fmt: skip


def test_good_ledgers(tmp_path: Path) -> None:
    head = small_ledger(tmp_path / "small")
    assert independently(tmp_path / "small") == f"good {head.hex()} dropped 0"
    head = long_ledger(tmp_path / "long")
    dropped = verify(tmp_path / "long").dropped
    assert independently(tmp_path / "long") == f"good {head.hex()} dropped {dropped}"
    assert dropped > 0
    new_ledger(tmp_path / "new").close()
    assert independently(tmp_path / "new").startswith("good ")


@pytest.mark.parametrize("kind", ["record", "blob", "lost blob", "tail", "swapped"])
def test_tampered_ledgers(tmp_path: Path, kind: str) -> None:
    folder = tmp_path / "ledger"
    head = long_ledger(folder)
    with closing(sqlite3.connect(folder / DATABASE_NAME, isolation_level=None)) as db:
        if kind == "record":
            record = bytearray(
                db.execute("SELECT record FROM records WHERE height = 3").fetchone()[0]
            )
            record[-1] ^= 1
            db.execute("UPDATE records SET record = ? WHERE height = 3", (bytes(record),))
        elif kind == "tail":
            for table in ("blocks", "records"):
                db.execute(f"DELETE FROM {table} WHERE height = (SELECT max(height) FROM {table})")
        elif kind == "swapped":
            db.execute("UPDATE records SET height = 99 WHERE height = 1")
            db.execute("UPDATE records SET height = 1 WHERE height = 2")
            db.execute("UPDATE records SET height = 2 WHERE height = 99")
    blob = sorted((folder / "blobs").iterdir())[0]
    if kind == "blob":
        blob.write_bytes(blob.read_bytes()[:-1] + b"!")
    elif kind == "lost blob":
        blob.unlink()
    assert not verify(folder, expected_head=head).ok
    assert independently(folder, head.hex()).startswith("bad: ")


def test_every_byte_of_every_record(tmp_path: Path) -> None:
    """In this process, since there are thousands; each byte's change is found."""
    folder = tmp_path / "ledger"
    small_ledger(folder)
    tried = 0
    with closing(sqlite3.connect(folder / DATABASE_NAME, isolation_level=None)) as db:
        db.execute("PRAGMA synchronous = OFF")
        for table in ("blocks", "records"):
            for height, good in db.execute(f"SELECT height, record FROM {table}").fetchall():
                update = f"UPDATE {table} SET record = ? WHERE height = ?"
                for position in range(0, len(good), 5):
                    bad = bytearray(good)
                    bad[position] ^= 1 << position % 8
                    db.execute(update, (bytes(bad), height))
                    with pytest.raises(Exception):  # noqa: B017 - any refusal will do
                        independent.verify(folder)
                    tried += 1
                db.execute(update, (good, height))
    assert tried > 500
    assert independent.verify(shutil.copytree(folder, tmp_path / "copy"))

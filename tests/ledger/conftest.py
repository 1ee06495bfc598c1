"""Ledgers that the tests of a folder share."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from ledgers import new_ledger, small_ledger

from vrchain.ledger import Ledger


@pytest.fixture
def ledger(tmp_path: Path) -> Iterator[Ledger]:
    """A new ledger of R1 and R2, open for writing."""
    with new_ledger(tmp_path / "ledger") as made:
        yield made


@pytest.fixture(scope="session")
def pristine(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``small_ledger``; only to be copied."""
    folder = tmp_path_factory.mktemp("pristine") / "ledger"
    small_ledger(folder)
    return folder


@pytest.fixture
def folder(pristine: Path, tmp_path: Path) -> Path:
    """A copy of ``small_ledger``, closed, to go on with or to spoil."""
    return shutil.copytree(pristine, tmp_path / "ledger")

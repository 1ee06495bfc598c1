"""Ledgers that the tests of a folder share."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from clusters import emptied, skip_without_servers
from ledgers import new_ledger, small_ledger

from vrchain.ledger import Ledger
from vrchain.ledger.cluster.servers import Cluster


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


@pytest.fixture(scope="session")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    """Three servers on this machine, which let in anyone."""
    skip_without_servers()
    cluster = Cluster.make(tmp_path_factory.mktemp("cluster") / "servers")
    with cluster.running():
        yield cluster


@pytest.fixture
def servers(running: Cluster) -> Cluster:
    """The three servers, with no ledger on them."""
    running.start()  # a test may have left one dead
    running.wait_ready()
    emptied(running)
    return running

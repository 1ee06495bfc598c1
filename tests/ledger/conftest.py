"""Ledgers that the tests of a folder share."""

import importlib.util
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from clusters import emptied
from ledgers import new_ledger, small_ledger

from vrchain.errors import VRChainError
from vrchain.ledger import Ledger
from vrchain.ledger.cluster.servers import Cluster, find_server


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


def skip_without_servers() -> None:
    """Skip the test where the extra ``cluster`` is not installed."""
    if importlib.util.find_spec("nats") is None:
        pytest.skip("the extra `cluster` is not installed: nats-py")
    try:
        find_server()
    except VRChainError as error:
        pytest.skip(str(error))

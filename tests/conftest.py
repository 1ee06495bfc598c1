"""What every test shares."""

import fcntl
import os
import tempfile

import pytest
from hypothesis import settings

# Draw without a display; has to be set before pyrender is first imported.
os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
# What this checkout has made is nothing to the tests.
os.environ["VRCHAIN_BUILD"] = f"{tempfile.gettempdir()}/vrchain-tests-{os.getpid()}"

from vrchain.experiments.workers import ONE_THREAD

# Before libraries start their threads, which else hold up the other processes that test.
if int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1")) > 1:
    os.environ.update(ONE_THREAD)

from vrchain.allocator import keep_freed_memory
from vrchain.experiments.reproduction.results import PROFILES, Results
from vrchain.experiments.reproduction.stages import reproduce

settings.register_profile("quick", max_examples=50, derandomize=True, deadline=None)
settings.register_profile("full", max_examples=1000, deadline=None)
settings.load_profile("quick")  # `make test-all` asks for "full"

keep_freed_memory()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What needs the shared results comes first, all for one process: no other waits for them."""
    items.sort(key=lambda item: "smoke_results" not in getattr(item, "fixturenames", ()))


SAID = "said.txt"  # what the reproduction told, a line each


@pytest.fixture(scope="session")
def smoke_results(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Results:
    """The measuring stages of the profile smoke, made once by the first process that needs them."""
    mine = tmp_path_factory.getbasetemp()
    build = (mine if worker_id == "master" else mine.parent) / "smoke"
    build.mkdir(exist_ok=True)
    results = Results(PROFILES["smoke"], build)
    with (build / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (build / SAID).exists():
            said: list[str] = []
            reproduce(results, tell=said.append)
            (build / SAID).write_text("\n".join(said), encoding="utf-8")
    return results

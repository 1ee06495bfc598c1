"""The reproduction at its smallest, made once for all tests of a process."""

import atexit
import shutil
import tempfile
from functools import cache
from pathlib import Path

from vrchain.experiments.reproduction import reproduce
from vrchain.experiments.results import PROFILES, Results

SAID: list[str] = []


@cache
def smoke_results() -> Results:
    """The measuring stages of the profile smoke, in a folder of their own."""
    build = Path(tempfile.mkdtemp(prefix="vrchain-smoke-"))
    atexit.register(shutil.rmtree, build, ignore_errors=True)
    results = Results(PROFILES["smoke"], build)
    reproduce(results, tell=SAID.append)
    return results

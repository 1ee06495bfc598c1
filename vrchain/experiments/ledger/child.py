"""A Python process of our own."""

import os
import subprocess
import sys
from collections.abc import Sequence

from vrchain.paths import ROOT


def python(
    *words: str, stdout: int | None = None, quiet: bool = False, keep: Sequence[int] = ()
) -> "subprocess.Popen[bytes]":
    """Started with these words, it finds this package; Ctrl-C is its parent's.

    ``quiet``: without its standard error. ``keep``: file descriptors that it has too.
    """
    paths = os.pathsep.join(filter(None, (str(ROOT), os.environ.get("PYTHONPATH"))))
    return subprocess.Popen(
        [sys.executable, *words], pass_fds=keep,
        stdin=subprocess.DEVNULL, stdout=stdout, stderr=subprocess.DEVNULL if quiet else None,
        env={**os.environ, "PYTHONPATH": paths}, start_new_session=True,
    )  # fmt: skip

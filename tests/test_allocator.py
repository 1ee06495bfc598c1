"""Memory that is freed stays, where the C library can keep it."""

import ctypes
import subprocess
import sys

import pytest

CODE = """
import ctypes, resource, sys
from vrchain.allocator import keep_freed_memory
if sys.argv[1] == "kept":
    keep_freed_memory()
c = ctypes.CDLL(None)
c.malloc.restype, c.malloc.argtypes, c.free.argtypes = ctypes.c_void_p, [ctypes.c_size_t], [ctypes.c_void_p]
def use():
    at = c.malloc(60_000_000)
    ctypes.memset(at, 1, 60_000_000)
    c.free(at)
use()
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(10):
    use()
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""  # noqa: E501


def new_pages(how: str) -> int:
    """How often a fresh process was given a page, in ten times that it used 60 MB."""
    done = subprocess.run(
        [sys.executable, "-c", CODE, how], capture_output=True, text=True, check=True
    )
    return int(done.stdout)


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "mallopt"), reason="no mallopt here")
def test_what_was_freed_is_used_again() -> None:
    assert new_pages("kept") < 100 < 1000 < new_pages("given back")

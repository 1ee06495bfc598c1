"""Worlds that took long to build, kept for the next command in the user's cache folder.

What is kept holds as long as all that was looked at for it is the same: the package and its
libraries, the folders searched, every file's bytes, and what was not there. A kept world is a
pickle, which is only read with the digest it was written with; anything amiss, and the world is
built again.
"""

import contextlib
import hashlib
import json
import os
import pickle
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from vrchain.errors import SpecError
from vrchain.files import code_digest, name_of
from vrchain.world.gazebo.files import Watched, watching

LEAST_S = 5.0  # of building, from which on a world is kept
MOST_BYTES = 2 << 30  # of all that is kept; what was not used for longest goes first
_SUFFIX = ".world"
_HEAD = 65  # bytes of a digest and a line's end
_FAULTS = (
    OSError, ValueError, EOFError, pickle.PickleError, AttributeError, ImportError, SpecError
)  # fmt: skip


def folder() -> Path:
    """Where worlds are kept: ``vrchain/worlds`` in the user's cache folder."""
    base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(base) / "vrchain" / "worlds"


def kept(asked: list[str], build: Callable[[], Any]) -> Any:
    """What ``build`` makes of files that are named by ``asked``, or made before of the same."""
    try:
        place = folder() / f"{name_of([code_digest(), *asked])}{_SUFFIX}"
    except (OSError, RuntimeError):  # a user without a home
        return build()
    with contextlib.suppress(*_FAULTS):
        found = _read(place)
        with contextlib.suppress(OSError):
            os.utime(place)
        return found
    start_s = time.process_time()
    with watching() as seen:
        made = build()
    if time.process_time() - start_s >= LEAST_S:
        with contextlib.suppress(*_FAULTS):
            _write(place, seen, made)
    return made


def _read(place: Path) -> Any:
    """What is kept at a place. Raises one of ``_FAULTS`` if nothing is that still holds."""
    with place.open("rb") as file:
        if os.fstat(file.fileno()).st_uid != os.getuid():
            raise ValueError("somebody else wrote it")
        digest = file.readline(_HEAD).decode().strip()
        if hashlib.file_digest(file, "sha256").hexdigest() != digest:
            raise ValueError("it is damaged")
        file.seek(_HEAD)
        if not Watched(dict.fromkeys(map(tuple, json.loads(file.readline())))).still_holds():
            raise ValueError("a file has changed")
        return pickle.load(file)


def _write(place: Path, seen: Watched, made: Any) -> None:
    place.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    with tempfile.NamedTemporaryFile(dir=place.parent, delete=False) as file:
        scratch = Path(file.name)
        try:
            file.write(b"0" * (_HEAD - 1) + b"\n")
            file.write(json.dumps([*seen.found]).encode() + b"\n")
            pickle.dump(made, file, protocol=5)
            if file.tell() > MOST_BYTES // 2:
                return
            file.seek(_HEAD)
            told = hashlib.file_digest(file, "sha256").hexdigest()
            file.seek(0)
            file.write(told.encode())
            file.close()
            scratch.replace(place)
        finally:
            scratch.unlink(missing_ok=True)
    worlds = sorted(place.parent.glob(f"*{_SUFFIX}"), key=lambda f: -f.stat().st_mtime)
    total = 0
    for world in worlds:
        total += world.stat().st_size
        if total > MOST_BYTES:
            world.unlink(missing_ok=True)

"""Results that are kept in files as they come, so that a run broken off goes on with the next."""

import json
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from vrchain.experiments.scenes import Scenes
from vrchain.experiments.workers import each
from vrchain.files import code_digest, name_of, write_file


def folder_of(folder: Path, scenes: Scenes, *asked: object) -> Path:
    """Where results of just this are kept: made by this code and libraries, in these scenes."""
    return folder / name_of([code_digest(), scenes.digest, *asked])


def kept(file: Path, find: Callable[[], Any]) -> Any:
    """What the file holds; if there is none yet, what is found: plain values, as JSON has them."""
    if not file.exists():
        write_file(file, json.dumps(find()).encode())
    return json.loads(file.read_bytes())


def kept_each(
    find: Callable[[int], Any], files: Sequence[Path], jobs: int | None, what: str
) -> list[Any]:
    """``kept`` of each file, by its number; ``jobs`` and ``what`` as ``workers.each`` has them."""
    left = [k for k, file in enumerate(files) if not file.exists()]
    each(partial(_keep, find, files), left, jobs, what)
    return [json.loads(file.read_bytes()) for file in files]


def _keep(find: Callable[[int], Any], files: Sequence[Path], k: int) -> None:
    kept(files[k], partial(find, k))

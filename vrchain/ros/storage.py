"""A bag's files, whole, damaged or compressed, as one stream of messages in the order of time."""

import re
import struct
import tempfile
from collections.abc import Callable, Iterable, Iterator
from heapq import merge
from itertools import chain
from pathlib import Path
from typing import IO

from vrchain.errors import BagError
from vrchain.extras import require
from vrchain.ros.formats import (
    MOST_BYTES,
    ZSTD,
    Damage,
    Message,
    Tell,
    mcap_messages,
    ros1_messages,
    sqlite_messages,
)

_SUFFIXES = (".bag", ".mcap", ".db3", ".zstd", ".zst")
_UNFINISHED = ".active"  # what ROS 1's recorder calls a bag until it is closed
_MOST_TIMES = 100  # that a file which is compressed as a whole grows


def files_of(bag: str | Path) -> list[Path]:
    """The storage files of one bag, a file or a folder, in the order of their numbers. BagError."""
    path = Path(bag)
    if path.is_file():
        return [path]
    if not path.is_dir():
        raise BagError(f"expected a bag, a file or a folder, got {path}, which is not there")
    found = [p for p in path.iterdir() if p.suffix in (*_SUFFIXES, _UNFINISHED) and p.is_file()]
    if not found:
        raise BagError(f"{path} is no bag: it holds no file that ends in {', '.join(_SUFFIXES)}")
    return sorted(found, key=lambda p: ([int(n) for n in re.findall(r"\d+", p.name)], p.name))


def messages(bags: Iterable[str | Path], tell: Tell = lambda line: None) -> Iterator[Message]:
    """The messages of several bags, by when they were received.

    tell: is given a line for each file that is damaged; what comes before the damage is read.
    BagError: a file is no bag. All of them: how those of two bags follow one another rests on each.
    """
    require("rosbags", "mcap", what="reading bags", error=BagError)
    files = [files_of(bag) for bag in bags]
    yield from merge(
        *(chain.from_iterable(_messages_of(p, tell) for p in each) for each in files),
        key=lambda m: m.received_ns,
    )


def _messages_of(path: Path, tell: Tell) -> Iterator[Message]:
    count = 0
    try:
        with path.open("rb") as file:
            for message in _reader_of(path, file)(lambda line: tell(f"{path}: {line}")):
                count += 1
                yield message
    except OSError as error:
        raise BagError(f"cannot read {path}: {error.strerror or error}") from error
    except (Damage, struct.error) as damage:
        tell(f"{path}: {damage}; used are {count} messages before that")


def _reader_of(path: Path, file: IO[bytes]) -> Callable[[Tell], Iterator[Message]]:
    start = file.read(16)
    file.seek(0)
    if start.startswith(b"#ROSBAG V2.0"):
        return lambda tell: ros1_messages(file, tell)
    if start.startswith(b"\x89MCAP0\r\n"):
        return lambda tell: mcap_messages(file, tell)
    if start.startswith(b"SQLite format 3\0"):
        return lambda tell: sqlite_messages(path, tell)
    if start.startswith(ZSTD):
        return lambda tell: _unpacked(path, file, tell)
    if start.startswith(b"version https://"):
        raise BagError(f"{path}: expected a bag, got a Git LFS pointer to it: run `git lfs pull`")
    came = "an empty file" if not start else f"one that begins with {start[:12]!r}"
    raise BagError(f"{path} is no bag: expected a ROS 1 bag of version 2.0, MCAP or SQLite, {came}")


def _unpacked(path: Path, file: IO[bytes], tell: Tell) -> Iterator[Message]:
    """Of a file that was compressed as a whole."""
    import zstandard

    with tempfile.TemporaryDirectory() as folder:
        plain = Path(folder) / path.stem
        with plain.open("wb") as target, zstandard.ZstdDecompressor().stream_reader(file) as source:
            left = MOST_BYTES + _MOST_TIMES * path.stat().st_size
            try:
                while left > 0 and (part := source.read(1 << 20)):
                    left -= target.write(part)
            except zstandard.ZstdError as error:
                tell(str(error))
            if left <= 0:
                tell(f"it unpacks to more than {_MOST_TIMES} times its size: cut there")
        with plain.open("rb") as unpacked:
            yield from _reader_of(plain, unpacked)(tell)

"""A bag's files, read from their beginning: ROS 1 bags, MCAP and SQLite, whole or damaged.

Neither an index nor ``metadata.yaml`` is asked, which are missing or wrong where a recorder was
killed. At most one chunk is in memory. Formats: wiki.ros.org/Bags/Format/2.0, mcap.dev/spec,
rosbag2_storage_sqlite3.
"""

import bz2
import io
import re
import sqlite3
import struct
import tempfile
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing
from dataclasses import dataclass
from heapq import merge
from pathlib import Path
from shutil import copyfileobj
from typing import IO, Any

from vrchain.errors import BagError
from vrchain.extras import require

SUFFIXES = (".bag", ".mcap", ".db3", ".zstd", ".zst")
_MOST_BYTES = 1 << 30  # of a chunk or message; a length beyond is a lie
_ZSTD = b"\x28\xb5\x2f\xfd"
_UNFINISHED = ".active"  # what ROS 1's recorder calls a bag until it is closed
_READ = {"cdr": False, "ros1": True}  # encodings of messages, and whether they are ROS 1's


@dataclass(frozen=True, slots=True)
class Message:
    """A message as it was recorded. type: as ROS 2 has it, ``sensor_msgs/msg/Image``."""

    topic: str
    type: str
    ros1: bool
    received_ns: int
    data: bytes


class Damage(Exception):
    """Ends the reading of one file; the text says what is wrong there."""


Tell = Callable[[str], None]
Wanted = Callable[[str], bool]


def files_of(bag: str | Path) -> list[Path]:
    """The storage files of one bag, a file or a folder, in the order of their numbers. BagError."""
    path = Path(bag)
    if path.is_file():
        return [path]
    if not path.is_dir():
        raise BagError(f"expected a bag, a file or a folder, got {path}, which is not there")
    found = [p for p in path.iterdir() if p.suffix in (*SUFFIXES, _UNFINISHED) and p.is_file()]
    if not found:
        raise BagError(f"{path} is no bag: it holds no file that ends in {', '.join(SUFFIXES)}")
    return sorted(found, key=lambda p: ([int(n) for n in re.findall(r"\d+", p.name)], p.name))


def messages(
    bags: Iterable[str | Path], wanted: Wanted = lambda topic: True, tell: Tell = lambda line: None
) -> Iterator[Message]:
    """The messages of several bags, by when they were received.

    tell: is given a line for each file that is damaged; what comes before the damage is read.
    BagError: a file is no bag. wanted: of which topics.
    """
    require("rosbags", "mcap", what="reading bags", error=BagError)
    files = [files_of(bag) for bag in bags]
    yield from merge(
        *(_one_after_another(each, wanted, tell) for each in files), key=lambda m: m.received_ns
    )


def _one_after_another(files: list[Path], wanted: Wanted, tell: Tell) -> Iterator[Message]:
    for path in files:
        count = 0
        try:
            with path.open("rb") as file:
                for message in _reader_of(path, file)(wanted, tell):
                    count += 1
                    yield message
        except OSError as error:
            raise BagError(f"cannot read {path}: {error.strerror or error}") from error
        except Damage as damage:
            tell(f"{path}: {damage}; used are {count} messages before that")


def _reader_of(path: Path, file: IO[bytes]) -> Callable[[Wanted, Tell], Iterator[Message]]:
    start = file.read(16)
    file.seek(0)
    if start.startswith(b"#ROSBAG V2.0"):
        return lambda wanted, tell: _ros1_messages(file, wanted)
    if start.startswith(b"\x89MCAP0\r\n"):
        return lambda wanted, tell: _mcap_messages(file, wanted, lambda s: tell(f"{path}: {s}"))
    if start.startswith(b"SQLite format 3\0"):
        return lambda wanted, tell: _sqlite_messages(path, wanted)
    if start.startswith(_ZSTD):
        return lambda wanted, tell: _unpacked(path, file, wanted, tell)
    came = "an empty file" if not start else f"one that begins with {start[:12]!r}"
    raise BagError(f"{path} is no bag: expected a ROS 1 bag of version 2.0, MCAP or SQLite, {came}")


def _unpacked(path: Path, file: IO[bytes], wanted: Wanted, tell: Tell) -> Iterator[Message]:
    """Of a file that was compressed as a whole."""
    import zstandard

    with tempfile.TemporaryDirectory() as folder:
        plain = Path(folder) / path.stem
        with plain.open("wb") as target, zstandard.ZstdDecompressor().stream_reader(file) as source:
            try:
                copyfileobj(source, target)
            except zstandard.ZstdError as error:
                tell(f"{path}: {error}")
        with plain.open("rb") as unpacked:
            yield from _reader_of(plain, unpacked)(wanted, tell)


def _exactly(stream: IO[bytes], n: int) -> bytes:
    if n > _MOST_BYTES:
        raise Damage(f"a record claims {n} bytes")
    data = stream.read(n)
    if len(data) < n:
        raise Damage("it ends in the middle of a record")
    return data


# ROS 1


def _ros1_messages(file: IO[bytes], wanted: Wanted) -> Iterator[Message]:
    file.readline()
    yield from _ros1_records(file, {}, wanted)


def _ros1_records(
    stream: IO[bytes], connections: dict[bytes, tuple[str, str]], wanted: Wanted
) -> Iterator[Message]:
    while length := stream.read(4):
        if len(length) < 4:
            raise Damage("it ends in the middle of a record")
        fields = _ros1_fields(_exactly(stream, *struct.unpack("<I", length)))
        (size,) = struct.unpack("<I", _exactly(stream, 4))
        kind = fields.get(b"op")
        if kind == b"\x05":
            if size > _MOST_BYTES:
                raise Damage(f"a record claims {size} bytes")
            packed = stream.read(size)
            plain = io.BytesIO(_ros1_chunk(fields, packed))
            yield from _ros1_records(plain, connections, wanted)
            if len(packed) < size:
                raise Damage("it ends in the middle of a chunk")
            continue
        data = _exactly(stream, size)
        if kind == b"\x07":
            type_ = _ros1_fields(data).get(b"type", b"").decode(errors="replace")
            topic = fields.get(b"topic", b"").decode(errors="replace")
            connections[fields.get(b"conn", b"")] = topic, type_named(type_)
        elif kind == b"\x02":
            known = connections.get(fields.get(b"conn", b""))
            if known is not None and wanted(known[0]):
                seconds, rest = struct.unpack("<II", fields.get(b"time", bytes(8))[:8])
                yield Message(*known, True, seconds * 1_000_000_000 + rest, data)


def _ros1_fields(header: bytes) -> dict[bytes, bytes]:
    fields, at = {}, 0
    while at + 4 <= len(header):
        (size,) = struct.unpack_from("<I", header, at)
        name, _, value = header[at + 4 : at + 4 + size].partition(b"=")
        fields[name] = value
        at += 4 + size
    if at != len(header):
        raise Damage("a record's header is broken")
    return fields


def _ros1_chunk(fields: dict[bytes, bytes], packed: bytes) -> bytes:
    compression = fields.get(b"compression", b"none")
    (size,) = struct.unpack("<I", fields.get(b"size", bytes(4)))
    try:
        if compression == b"bz2":
            return bz2.BZ2Decompressor().decompress(packed, size)
        if compression == b"lz4":
            return _lz4(packed, size)
    except (OSError, EOFError, RuntimeError) as error:
        raise Damage(f"a chunk cannot be decompressed ({error})") from error
    if compression != b"none":
        raise Damage(f"a chunk is compressed as {compression!r}; expected none, bz2 or lz4")
    return packed


def _lz4(packed: bytes, size: int) -> bytes:
    from lz4.frame import LZ4FrameDecompressor

    return LZ4FrameDecompressor().decompress(packed, size)


def type_named(name: str) -> str:
    """The name that ROS 2 has for a type; ROS 1 says ``sensor_msgs/Image`` and ``tf/tfMessage``."""
    package, *_, last = name.split("/") if "/" in name else ("", name)
    return "tf2_msgs/msg/TFMessage" if last == "tfMessage" else f"{package}/msg/{last}"


# MCAP


def _mcap_messages(file: IO[bytes], wanted: Wanted, tell: Tell) -> Iterator[Message]:
    from mcap.exceptions import McapError
    from mcap.records import Channel, Chunk, Schema
    from mcap.records import Message as Recorded
    from mcap.stream_reader import StreamReader

    schemas: dict[int, str] = {}
    channels: dict[int, tuple[str, str, bool] | None] = {}

    def taken_in(record: Any) -> Message | None:
        if isinstance(record, Schema):
            schemas[record.id] = type_named(record.name)
        elif isinstance(record, Channel) and record.id not in channels:
            ros1 = _READ.get(record.message_encoding)
            if ros1 is None and wanted(record.topic):
                tell(f"{record.topic} is encoded as {record.message_encoding!r}: left out")
            known = (record.topic, schemas.get(record.schema_id, ""), bool(ros1))
            channels[record.id] = None if ros1 is None else known
        elif isinstance(record, Recorded):
            channel = channels.get(record.channel_id)
            if channel is not None and wanted(channel[0]):
                return Message(*channel, record.log_time, _message(record.data))
        return None

    try:
        reader = StreamReader(file, emit_chunks=True, record_size_limit=_MOST_BYTES)
        for record in reader.records:
            parts = _mcap_chunk(record, tell) if isinstance(record, Chunk) else (record,)
            for part in parts:
                if message := taken_in(part):
                    yield message
    except (McapError, struct.error, UnicodeDecodeError, ValueError) as error:
        raise Damage(f"it ends in the middle of a record or is broken there ({error!r})") from error


def _mcap_chunk(chunk: Any, tell: Tell) -> Iterator[Any]:
    """Its records, as many as are whole."""
    from mcap.data_stream import ReadDataStream
    from mcap.opcode import Opcode
    from mcap.records import Channel, Schema
    from mcap.records import Message as Recorded

    size = min(chunk.uncompressed_size, _MOST_BYTES)
    try:
        if chunk.compression == "zstd":
            import zstandard

            source = zstandard.ZstdDecompressor().stream_reader(io.BytesIO(chunk.data))
            data = source.read(size)
        else:
            data = _lz4(chunk.data, size) if chunk.compression == "lz4" else chunk.data
    except Exception as error:  # the two libraries' own kinds
        return tell(f"a chunk cannot be decompressed ({error}): left out")
    if len(data) < size:
        tell("a chunk is cut: what is whole of it is used")
    elif chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        return tell("a chunk's checksum is wrong: left out")
    at = 0
    while at + 9 <= len(data):
        kind, length = struct.unpack_from("<BQ", data, at)
        body, at = data[at + 9 : at + 9 + length], at + 9 + length
        if at > len(data):
            return None
        stream = ReadDataStream(io.BytesIO(body))
        if kind == Opcode.MESSAGE:
            yield Recorded.read(stream, length)
        elif kind in (Opcode.CHANNEL, Opcode.SCHEMA):
            yield (Channel if kind == Opcode.CHANNEL else Schema).read(stream)
    return None


def _message(data: bytes) -> bytes:
    """Its bytes, unpacked if the recorder compressed message by message."""
    if not data.startswith(_ZSTD):
        return data
    import zstandard

    try:
        return zstandard.ZstdDecompressor().stream_reader(io.BytesIO(data)).read(_MOST_BYTES)
    except zstandard.ZstdError as error:
        raise Damage(f"a message cannot be decompressed ({error})") from error


# SQLite


def _sqlite_messages(path: Path, wanted: Wanted) -> Iterator[Message]:
    uri = f"file:{path.resolve().as_posix().replace('?', '%3f').replace('#', '%23')}?mode=ro"
    try:
        with closing(sqlite3.connect(uri, uri=True)) as database:
            database.execute("PRAGMA writable_schema = ON")  # else one that was cut is refused
            database.text_factory = lambda text: text.decode(errors="replace")
            rows = database.execute("SELECT id, name, type, serialization_format FROM topics")
            topics = {
                k: (str(name), type_named(str(t))) for k, name, t, form in rows if form == "cdr"
            }
            kept = {k: topic for k, topic in topics.items() if wanted(topic[0])}
            asked = "topic_id, CAST(timestamp AS INTEGER), CAST(data AS BLOB)"
            where = f"FROM messages WHERE topic_id IN {_in(kept)} ORDER BY id"
            for number, received_ns, data in database.execute(f"SELECT {asked} {where}"):
                yield Message(*kept[number], False, received_ns or 0, _message(data or b""))
    except (sqlite3.Error, UnicodeDecodeError) as error:
        raise Damage(f"the database is broken there ({error})") from error


def _in(numbers: Iterable[int]) -> str:
    return "(" + ", ".join(map(str, numbers)) + ")"

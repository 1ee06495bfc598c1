"""The three formats of bags, each read from its beginning: ROS 1, MCAP and SQLite.

Neither an index nor ``metadata.yaml`` is asked, which are missing or wrong where a recorder was
killed. At most one chunk is in memory. Formats: wiki.ros.org/Bags/Format/2.0, mcap.dev/spec,
rosbag2_storage_sqlite3.
"""

import bz2
import io
import sqlite3
import struct
import zlib
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

MOST_BYTES = 1 << 28  # of a chunk or message; a length beyond is a lie
ZSTD = b"\x28\xb5\x2f\xfd"
_LATEST_NS = 1 << 62  # a time beyond is a lie, too
_READ = {"cdr": False, "ros1": True}  # encodings of messages, and whether they are ROS 1's


@dataclass(frozen=True, slots=True)
class Message:
    """A message as it was recorded. topic: with a leading slash. type: as ROS 2 has it,
    ``sensor_msgs/msg/Image``.
    """

    topic: str
    type: str
    ros1: bool
    received_ns: int
    data: bytes


class Damage(Exception):
    """Ends the reading of one file; the text says what is wrong there."""


Tell = Callable[[str], None]


def _exactly(stream: IO[bytes], n: int) -> bytes:
    if n > MOST_BYTES:
        raise Damage(f"a record claims {n} bytes")
    data = stream.read(n)
    if len(data) < n:
        raise Damage("it ends in the middle of a record")
    return data


# ROS 1


def ros1_messages(file: IO[bytes], tell: Tell) -> Iterator[Message]:
    """Of a ROS 1 bag. A chunk that is broken costs its own messages alone."""
    file.readline()
    connections: dict[bytes, tuple[str, str]] = {}
    for kind, fields, data in _ros1_records(file):
        if kind != b"\x05":
            yield from _ros1_message(kind, fields, data, connections)
            continue
        try:
            for inner in _ros1_records(io.BytesIO(_ros1_chunk(fields, data))):
                yield from _ros1_message(*inner, connections)
        except (Damage, struct.error) as damage:
            tell(f"a chunk is broken ({damage}): what is whole of it is used")


def _ros1_records(stream: IO[bytes]) -> Iterator[tuple[bytes, dict[bytes, bytes], bytes]]:
    """Each record's kind, the fields of its header, and its data."""
    while length := stream.read(4):
        if len(length) < 4:
            raise Damage("it ends in the middle of a record")
        fields = _ros1_fields(_exactly(stream, *struct.unpack("<I", length)))
        if b"op" not in fields:
            raise Damage("a record tells no kind")
        (size,) = struct.unpack("<I", _exactly(stream, 4))
        cut = fields[b"op"] == b"\x05" and size <= MOST_BYTES  # a chunk, of which the start serves
        yield fields[b"op"], fields, stream.read(size) if cut else _exactly(stream, size)


def _ros1_message(
    kind: bytes,
    fields: dict[bytes, bytes],
    data: bytes,
    connections: dict[bytes, tuple[str, str]],
) -> Iterator[Message]:
    """The message that a record is, if it is one; connections are kept."""
    number = fields.get(b"conn", b"")
    if kind == b"\x07":
        type_ = _ros1_fields(data).get(b"type", b"").decode(errors="replace")
        topic = fields.get(b"topic", b"").decode(errors="replace")
        connections[number] = topic_named(topic), type_named(type_)
    elif kind == b"\x02" and number in connections:
        seconds, rest = struct.unpack("<II", fields.get(b"time", b""))
        yield Message(*connections[number], True, seconds * 1_000_000_000 + rest, data)


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
    size = min(size, MOST_BYTES)
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


def topic_named(name: str) -> str:
    """A topic's name with a leading slash, on one line."""
    return "/" + _printable(name).lstrip("/")


def type_named(name: str) -> str:
    """The name that ROS 2 has for a type; ROS 1 says ``sensor_msgs/Image`` and ``tf/tfMessage``."""
    package, *kind, last = _printable(name).split("/") if "/" in name else ("", _printable(name))
    return (
        "tf2_msgs/msg/TFMessage"
        if last == "tfMessage"
        else "/".join((package, *(kind or ["msg"]), last))
    )


def _printable(name: str) -> str:
    return "".join(c if c.isprintable() else "?" for c in name)


# MCAP


def mcap_messages(file: IO[bytes], tell: Tell) -> Iterator[Message]:
    """Of an MCAP file."""
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
            ros1, topic = _READ.get(record.message_encoding), topic_named(record.topic)
            if ros1 is None:
                tell(f"{topic} is encoded as {record.message_encoding!r}: left out")
            known = (topic, schemas.get(record.schema_id, ""), bool(ros1))
            channels[record.id] = None if ros1 is None else known
        elif isinstance(record, Recorded):
            channel = channels.get(record.channel_id)
            if channel is not None:
                time_ns = min(record.log_time, _LATEST_NS)
                return Message(*channel, time_ns, _message(record.data))
        return None

    try:
        reader = StreamReader(file, emit_chunks=True, record_size_limit=MOST_BYTES)
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
    from mcap.exceptions import McapError
    from mcap.opcode import Opcode
    from mcap.records import Channel, Schema
    from mcap.records import Message as Recorded

    size = min(chunk.uncompressed_size, MOST_BYTES)
    try:
        if chunk.compression == "zstd":
            import zstandard

            source = zstandard.ZstdDecompressor().stream_reader(io.BytesIO(chunk.data))
            data = source.read(size)
        else:
            data = _lz4(chunk.data, size) if chunk.compression == "lz4" else chunk.data
    except Exception as error:  # the two libraries' own kinds
        return tell(f"a chunk cannot be decompressed ({error}): left out")
    if len(data) == size and chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
        return tell("a chunk's checksum is wrong: left out")
    at = 0
    while at + 9 <= len(data):
        kind, length = struct.unpack_from("<BQ", data, at)
        body, at = data[at + 9 : at + 9 + length], at + 9 + length
        if at > len(data) or kind == 0:  # no kind of record
            return tell("a chunk is broken: what is whole of it is used")
        stream = ReadDataStream(io.BytesIO(body))
        try:
            if kind == Opcode.MESSAGE:
                yield Recorded.read(stream, length)
            elif kind in (Opcode.CHANNEL, Opcode.SCHEMA):
                yield (Channel if kind == Opcode.CHANNEL else Schema).read(stream)
        except (McapError, struct.error, UnicodeDecodeError, ValueError):
            return tell("a chunk is broken: what is whole of it is used")
    if at < len(data) or len(data) < size:
        tell("a chunk is cut: what is whole of it is used")
    return None


def _message(data: bytes) -> bytes:
    """Its bytes, unpacked if the recorder compressed message by message."""
    if not data.startswith(ZSTD):
        return data
    import zstandard

    try:
        return zstandard.ZstdDecompressor().stream_reader(io.BytesIO(data)).read(MOST_BYTES)
    except zstandard.ZstdError as error:
        raise Damage(f"a message cannot be decompressed ({error})") from error


# SQLite


def sqlite_messages(path: Path, tell: Tell) -> Iterator[Message]:
    """Of a rosbag2 database."""
    uri = f"file:{path.resolve().as_posix().replace('?', '%3f').replace('#', '%23')}?mode=ro"
    try:
        with closing(sqlite3.connect(uri, uri=True)) as database:
            database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MOST_BYTES)
            database.execute("PRAGMA writable_schema = ON")  # else one that was cut is refused
            database.text_factory = lambda text: text.decode(errors="replace")
            views = "SELECT count(*) FROM sqlite_master WHERE type = 'view'"
            if database.execute(views).fetchone()[0]:
                raise Damage("it holds views, which no recorder makes")
            asked = "CAST(id AS INTEGER), name, type, serialization_format"
            kept = {}
            for number, name, type_, form in database.execute(f"SELECT {asked} FROM topics"):
                topic = topic_named(str(name))
                if form == "cdr":
                    kept[number] = topic, type_named(str(type_))
                else:
                    tell(f"{topic} is encoded as {form!r}: left out")
            ours = ", ".join(map(str, kept))
            asked = "CAST(topic_id AS INTEGER) AS t, CAST(timestamp AS INTEGER), CAST(data AS BLOB)"
            where = f"FROM messages WHERE t IN ({ours}) ORDER BY id"
            for number, received_ns, data in database.execute(f"SELECT {asked} {where}"):
                time_ns = max(-_LATEST_NS, min(received_ns or 0, _LATEST_NS))
                yield Message(*kept[number], False, time_ns, _message(data or b""))
    except (sqlite3.Error, UnicodeDecodeError) as error:
        raise Damage(f"the database is broken there ({error})") from error

"""Bags made to mislead: claimed lengths, bombs, nesting, names, times; bounded, and one line."""

import sqlite3
import struct
from io import BytesIO
from pathlib import Path

import pytest

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

import zstandard
from mcap.writer import CompressionType, Writer
from recordings import START_NS, changed, fields, published, recording, write
from test_bag_damage import bag, file_of
from test_bag_troubles import outcome_of, refused, same

from vrchain.errors import BagError
from vrchain.ros.contents import contents_of
from vrchain.ros.robots import robot_in
from vrchain.ros.storage import messages


def ros1_record(data: bytes, **header: bytes) -> bytes:
    told = b"".join(
        struct.pack("<I", len(name) + 1 + len(value)) + name.encode() + b"=" + value
        for name, value in header.items()
    )
    return struct.pack("<I", len(told)) + told + struct.pack("<I", len(data)) + data


def chunk(data: bytes, size: int | None = None) -> bytes:
    told = struct.pack("<I", len(data) if size is None else size)
    return ros1_record(data, op=b"\x05", compression=b"none", size=told)


CONNECTION = ros1_record(
    ros1_record(b"", type=b"std_msgs/String")[4:-4], op=b"\x07", conn=bytes(4), topic=b"/x"
)
MESSAGE = ros1_record(bytes(4), op=b"\x02", conn=bytes(4), time=struct.pack("<II", 5, 0))


def read(path: Path, content: bytes) -> tuple[int, list[str]]:
    """How many messages there are, and what was said."""
    path.write_bytes(content)
    said: list[str] = []
    return sum(1 for _ in messages([path], tell=said.append)), said


def test_a_broken_chunk_costs_its_own_messages_alone(tmp_path: Path) -> None:
    good = chunk(CONNECTION + MESSAGE)
    for broken in (
        ros1_record(b"no bz2", op=b"\x05", compression=b"bz2", size=bytes(4)),
        ros1_record(b"", op=b"\x05", compression=b"none", size=b"\x01"),
        chunk(MESSAGE + ros1_record(bytes(4), op=b"\x02", conn=bytes(4), time=b"\x01")),
        chunk(bytes(80)),
    ):
        count, said = read(tmp_path / "x.bag", b"#ROSBAG V2.0\n" + good + broken + good)
        assert count in (2, 3) and len(said) == 1 and "chunk" in said[0]


def test_chunks_in_chunks_are_not_opened(tmp_path: Path) -> None:
    nested = CONNECTION + MESSAGE
    for _ in range(3000):
        nested = chunk(nested)
    assert read(tmp_path / "x.bag", b"#ROSBAG V2.0\n" + nested)[0] == 0


@pytest.mark.parametrize("length", [1 << 29, 0xFFFFFFFF])
def test_lengths_that_are_claimed(length: int, tmp_path: Path) -> None:
    told = struct.pack("<I", length)
    for content in (told, MESSAGE[:-8] + told, chunk(b"")[:-4] + told):
        count, said = read(tmp_path / "x.bag", b"#ROSBAG V2.0\n" + content + bytes(100))
        assert count == 0 and len(said) == 1
    mcap = b"\x89MCAP0\r\n\x05" + struct.pack("<Q", length << 20) + bytes(100)
    count, said = read(tmp_path / "x.mcap", mcap)
    assert count == 0 and len(said) == 1


def test_a_file_that_unpacks_to_more_than_any_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from vrchain.ros import storage

    monkeypatch.setattr(storage, "MOST_BYTES", 1 << 20)
    bomb = b"#ROSBAG V2.0\n" + chunk(CONNECTION + MESSAGE) + bytes(50_000_000)
    count, said = read(tmp_path / "x.bag.zstd", zstandard.compress(bomb))
    assert count == 1 and any("unpacks to more than" in line for line in said)


def mcap_of(topic: str, times_ns: list[int], encoding: str = "cdr") -> bytes:
    target = BytesIO()
    writer = Writer(target, compression=CompressionType.ZSTD)
    writer.start()
    schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"")
    channel = writer.register_channel(topic, encoding, schema)
    for time_ns in times_ns:
        writer.add_message(channel, time_ns, b"\0\1\0\0\0\0\0\0", time_ns)
    writer.finish()
    return target.getvalue()


def test_times_beyond_all_time(tmp_path: Path) -> None:
    (tmp_path / "x.mcap").write_bytes(mcap_of("/odd", [0, (1 << 64) - 1]))
    assert contents_of([tmp_path / "x.mcap"]).topics["/odd"].count == 2


def test_names_of_topics(tmp_path: Path) -> None:
    """ROS 2's own players also take names without a slash; what is no name is shown harmlessly."""
    for name, shown in {"plain": "/plain", "/a\nb\x1b[2J/../c": "/a?b?[2J/../c", "": "/"}.items():
        (tmp_path / "x.mcap").write_bytes(mcap_of(name, [1]))
        contents = contents_of([tmp_path / "x.mcap"])
        assert list(contents.topics) == [shown]
        with pytest.raises(BagError, match=r"R1: no topic begins with /R1/; there are /"):
            robot_in(contents, "R1", "/R1", {}, 0.05)


@pytest.mark.parametrize("form", ["mcap", "sqlite3"])
def test_what_is_encoded_otherwise_is_left_out_and_told(form: str, tmp_path: Path) -> None:
    if form == "mcap":
        file = tmp_path / "x.mcap"
        file.write_bytes(mcap_of("/x", [1, 2], "json"))
    else:
        file = file_of(bag(tmp_path, form))
        with sqlite3.connect(file) as database:
            database.execute("UPDATE topics SET serialization_format = 'json'")
    said: list[str] = []
    with pytest.raises(BagError, match="no message was read"):
        contents_of([file], said.append)
    assert said and all("is encoded as 'json': left out" in line for line in said)


def test_a_database_that_makes_its_messages_up(tmp_path: Path) -> None:
    file = file_of(bag(tmp_path, "sqlite3"))
    endless = "WITH RECURSIVE n(k) AS (SELECT 1 UNION ALL SELECT k + 1 FROM n)"
    with sqlite3.connect(file) as database:
        database.execute("DROP TABLE messages")
        database.execute(
            f"CREATE VIEW messages AS {endless} "
            "SELECT k AS id, 1 AS topic_id, k AS timestamp, zeroblob(9) AS data FROM n"
        )
    said: list[str] = []
    assert list(messages([file], tell=said.append)) == []
    assert "views" in said[0] and len(said) == 1


def test_types_of_services_keep_their_kind() -> None:
    from vrchain.ros.formats import type_named

    assert type_named("std_srvs/srv/Empty_Event") == "std_srvs/srv/Empty_Event"
    assert type_named("sensor_msgs/Image") == "sensor_msgs/msg/Image"


def test_transforms_in_a_circle(tmp_path: Path) -> None:
    def bent(row):  # type: ignore[no-untyped-def]
        first, *others = row.message.transforms
        around = fields(first, header__frame_id="b", child_frame_id="a")
        back = fields(first, header__frame_id="a", child_frame_id="b")
        lost = fields(first, header__frame_id="a")
        changed_row = fields(row.message, transforms=[around, back, lost, *others])
        return type(row)(row.topic, changed_row, row.received_ns)

    line = refused(changed(recording(), "/tf_static", bent), tmp_path)
    assert "no transform leads from R1/camera_0_optical" in line


def test_two_robots_of_one_namespace(tmp_path: Path) -> None:
    made = write(recording(), tmp_path / "bag")
    for k, other in enumerate(("/R1", "/R1/", "/")):
        with pytest.raises(BagError, match=r"R1 and R2.*namespaces apart"):
            published([made], tmp_path / f"ledger_{k}", robots={"R1": "/R1", "R2": other})


def test_frames_that_are_not_named(tmp_path: Path) -> None:
    def unnamed(row):  # type: ignore[no-untyped-def]
        return type(row)(row.topic, fields(row.message, header__frame_id=""), row.received_ns)

    line = refused(changed(recording(), "camera_3", unnamed), tmp_path)
    assert "camera_3" in line and "its unnamed frame" in line


def test_places_beyond_all_places(tmp_path: Path) -> None:
    def far(row):  # type: ignore[no-untyped-def]
        odd = (row.received_ns - START_NS) // 100_000_000 % 3 == 1
        told = fields(row.message, pose__pose__position__x=1e300 if odd else 0.0)
        return type(row)(row.topic, told, row.received_ns)

    found = outcome_of(changed(recording(), "odom", far), tmp_path)
    assert not same(found) and any("set anew" in line for line in found.said)


def test_a_million_messages_without_content(tmp_path: Path) -> None:
    """By hand: the writers take longer than reading does."""
    n = 1_000_000
    many = chunk(CONNECTION + MESSAGE * (n // 10)) * 10
    (tmp_path / "x.bag").write_bytes(b"#ROSBAG V2.0\n" + many)
    assert contents_of([tmp_path / "x.bag"]).topics["/x"].count == n

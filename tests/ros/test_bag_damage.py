"""Files that are cut, unindexed, compressed, mislabelled, or no bags at all."""

import bz2
import shutil
import struct
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from recordings import published, recording, write
from worlds import ROOT

from vrchain.errors import BagError
from vrchain.ros.storage import messages

FORMS = ("mcap", "sqlite3", "ros1")


def bag(folder: Path, form: str) -> Path:
    return write(recording(form == "ros1"), folder / ("bag.bag" if form == "ros1" else "bag"), form)


def file_of(path: Path) -> Path:
    return path if path.is_file() else next(p for p in path.iterdir() if p.suffix != ".yaml")


@pytest.mark.parametrize("form", FORMS)
def test_a_bag_that_is_cut_is_read_as_far_as_it_goes(form: str, tmp_path: Path) -> None:
    made = bag(tmp_path, form)
    whole = published([made], tmp_path / "whole")
    whole_count = sum(1 for _ in messages([made]))
    file = file_of(made)
    file.write_bytes(file.read_bytes()[: int(0.6 * file.stat().st_size)])
    said: list[str] = []
    count = sum(1 for _ in messages([made], tell=said.append))
    assert 0.5 * whole_count < count < 0.65 * whole_count
    (line,) = said
    assert str(file) in line and "\n" not in line
    found = published([made], tmp_path / "cut")
    assert found.digests == whole.digests[: len(found.digests)] and len(found.digests) == 2


def test_an_mcap_without_its_summary(tmp_path: Path) -> None:
    made = bag(tmp_path, "mcap")
    whole = published([made], tmp_path / "whole")
    content = file_of(made).read_bytes()
    end = content.rindex(b"\x0f" + struct.pack("<Q", 4))  # the data's end
    file_of(made).write_bytes(content[:end])
    assert published([made], tmp_path / "again").digests == whole.digests


def test_a_broken_record_in_an_mcap_costs_its_chunk_alone(tmp_path: Path) -> None:
    from mcap.writer import CompressionType, Writer

    file = tmp_path / "x.mcap"
    with file.open("wb") as stream:
        writer = Writer(stream, 150, CompressionType.NONE, enable_crcs=False)
        writer.start()
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", b"string data")
        channel = writer.register_channel("/x", "cdr", schema)
        for k in range(12):
            writer.add_message(channel, k, bytes(64), k)
        writer.finish()
    content = bytearray(file.read_bytes())
    length = b"\x05" + struct.pack("<Q", 2 + 4 + 8 + 8 + 64)
    assert content.count(length) == 12
    at = content.index(length, content.index(length) + 1)
    content[at : at + 9] = b"\x05" + struct.pack("<Q", 8)
    file.write_bytes(content)
    said: list[str] = []
    count = sum(1 for _ in messages([file], tell=said.append))
    assert 9 <= count <= 11 and len(said) == 1 and "chunk" in said[0]


def test_a_ros_1_bag_without_its_index(tmp_path: Path) -> None:
    made = bag(tmp_path, "ros1")
    whole = published([made], tmp_path / "whole")
    content = made.read_bytes()
    (at,) = struct.unpack("<Q", content[content.index(b"index_pos=") + 10 :][:8])
    made.rename(tmp_path / "bag.bag.active")
    (tmp_path / "bag.bag.active").write_bytes(content[:at].replace(
        b"index_pos=" + struct.pack("<Q", at), b"index_pos=" + bytes(8)))  # fmt: skip
    found = published([tmp_path / "bag.bag.active"], tmp_path / "again")
    assert (found.digests, found.said) == (whole.digests, ())


@pytest.mark.parametrize("form", ["mcap", "sqlite3"])
@pytest.mark.parametrize("text", [None, "no yaml: [", "rosbag2_bagfile_information: {version: 99}"])
def test_metadata_is_not_asked(form: str, text: str | None, tmp_path: Path) -> None:
    made = bag(tmp_path, form)
    whole = published([made], tmp_path / "whole")
    if text is None:
        (made / "metadata.yaml").unlink()
    else:
        (made / "metadata.yaml").write_text(text)
    assert published([made], tmp_path / "again").digests == whole.digests


def test_metadata_with_another_qos(tmp_path: Path) -> None:
    made = bag(tmp_path, "mcap")
    whole = published([made], tmp_path / "whole")
    told = (made / "metadata.yaml").read_text()
    assert "reliability: reliable" in told
    (made / "metadata.yaml").write_text(
        told.replace("reliability: reliable", "reliability: best_effort")
    )
    assert published([made], tmp_path / "again").digests == whole.digests


@pytest.mark.parametrize("compression", ["BZ2", "LZ4"])
def test_compressed_chunks_of_ros_1(compression: str, tmp_path: Path) -> None:
    from rosbags.rosbag1 import Reader, Writer

    made = bag(tmp_path, "ros1")
    packed = Writer(tmp_path / "packed.bag")
    packed.set_compression(Writer.CompressionFormat[compression])
    with Reader(made) as reader, packed:
        known = {
            c.id: packed.add_connection(c.topic, c.msgtype, msgdef=c.msgdef.data, md5sum=c.digest)
            for c in reader.connections
        }
        for connection, time_ns, data in reader.messages():
            packed.write(known[connection.id], time_ns, data)
    plain, other = (list(messages([p])) for p in (made, tmp_path / "packed.bag"))
    key = lambda m: (m.received_ns, m.topic)  # noqa: E731
    assert sorted(plain, key=key) == sorted(other, key=key)


@pytest.mark.parametrize("form", ["mcap", "sqlite3"])
def test_files_compressed_as_a_whole(form: str, tmp_path: Path) -> None:
    import zstandard

    made = bag(tmp_path, form)
    plain, file = list(messages([made])), file_of(made)
    packed = file.with_name(file.name + ".zstd")
    packed.write_bytes(zstandard.compress(file.read_bytes()))
    file.unlink()
    assert list(messages([made])) == plain


def test_parts_of_one_bag_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    folder = tmp_path / "parts"
    folder.mkdir()
    rows = recording()
    for k in range(12):
        part = write(rows[k * len(rows) // 12 : (k + 1) * len(rows) // 12], tmp_path / f"p{k}")
        shutil.move(file_of(part), folder / f"run_{k}.mcap")
    times = [m.received_ns for m in messages([folder])]
    assert times == sorted(times) and len(times) == len(rows)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"", "an empty file"),
        (b"hello, no bag", "begins with b'hello"),
        (b"#ROSBAG V1.2\n", "version 2.0"),
        (b"version https://git-lfs.github.com/spec/v1\n", "run `git lfs pull`"),
    ],
)
def test_what_is_no_bag(content: bytes, said: str, tmp_path: Path) -> None:
    (tmp_path / "x.bag").write_bytes(content)
    with pytest.raises(BagError, match=r"expected a (ROS 1 )?bag") as told:
        list(messages([tmp_path / "x.bag"]))
    assert said in str(told.value)
    with pytest.raises(BagError, match="not there"):
        list(messages([tmp_path / "y.bag"]))
    (tmp_path / "empty").mkdir()
    with pytest.raises(BagError, match="holds no file"):
        list(messages([tmp_path / "empty"]))


@pytest.mark.parametrize("form", FORMS)
def test_any_byte_may_be_another(form: str, tmp_path: Path) -> None:
    """Whatever is read of damaged bytes, it ends in a line, not in a traceback."""
    import numpy as np

    from vrchain.ros.contents import contents_of
    from vrchain.seeding import generator

    rows = [row for row in recording(form == "ros1") if "camera" not in row.topic]
    made = write(rows, tmp_path / "b.bag" if form == "ros1" else tmp_path / "b", form)
    file, draws = file_of(made), generator(0, "damage", form)
    whole = np.frombuffer(file.read_bytes(), np.uint8)
    for _ in range(30):
        content = whole.copy()
        content[draws.integers(13, len(content), 20)] = draws.integers(0, 256, 20)
        file.write_bytes(content.tobytes())
        try:
            contents_of([made])
        except BagError as error:
            assert "\n" not in str(error)


def test_a_chunk_that_claims_more_than_it_holds(tmp_path: Path) -> None:
    packed = bz2.compress(bytes(50_000_000))
    fields = b"".join(
        struct.pack("<I", len(f)) + f
        for f in (b"op=\x05", b"compression=bz2", b"size=" + struct.pack("<I", 1000))
    )
    header = struct.pack("<I", len(fields)) + fields + struct.pack("<I", len(packed))
    (tmp_path / "x.bag").write_bytes(b"#ROSBAG V2.0\n" + header + packed)
    assert list(messages([tmp_path / "x.bag"], tell=lambda line: None)) == []


_MEASURED = """
import resource, sys
from pathlib import Path
sys.path.insert(0, "tests")
from recordings import published
def peak():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
folder = Path(sys.argv[1])
published([folder / "small"], folder / "one")
before = peak()
published([folder / "large"], folder / "two")
print(peak() - before)
"""


@pytest.mark.slow
@pytest.mark.parametrize("form", FORMS)
def test_memory_does_not_grow_with_the_bag(form: str, tmp_path: Path) -> None:
    from dataclasses import replace

    from recordings import SECONDS, stamped

    rows = recording(form == "ros1")
    write(rows, tmp_path / "small", form)
    large = [
        stamped(replace(row, received_ns=time_ns), time_ns)
        for lap in range(8)
        for row in rows
        for time_ns in [row.received_ns + lap * SECONDS * 1_000_000_000]
    ]
    made = write(large, tmp_path / "large", form)
    assert file_of(made).stat().st_size > 150e6
    told = subprocess.run(
        [sys.executable, "-c", _MEASURED, str(tmp_path)], cwd=ROOT, capture_output=True, text=True
    )
    assert told.returncode == 0, told.stderr
    assert float(told.stdout) < 40

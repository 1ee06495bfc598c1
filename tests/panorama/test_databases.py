import json
import math
from pathlib import Path

import numpy as np
import pytest

from vrchain.errors import ImageError
from vrchain.geometry import Pose
from vrchain.panorama import CameraRig, Panorama, read_image
from vrchain.panorama.databases import (
    ENTRIES,
    METADATA,
    TOUR,
    DatabaseEntry,
    panorama_of,
    read_database,
    write_database,
)
from vrchain.panorama.sources import Source
from vrchain.seeding import generator

HEAD = "X [mm], Y [mm], Z [mm], Heading [degrees], Filename"


def brains_on_board(folder: Path, rows: str, metadata: str | None = None) -> Path:
    (folder / ENTRIES).write_text(rows)
    if metadata is not None:
        (folder / METADATA).write_text(f"%YAML:1.0\n---\nmetadata:\n{metadata}")
    return folder


def plain(folder: Path, rows: str) -> Path:
    (folder / "poses.csv").write_text("filename,x_m,y_m,heading_deg\n" + rows)
    return folder


def near(pose: Pose, x_m: float, y_m: float, yaw_deg: float) -> bool:
    got = (pose.x_m, pose.y_m, math.degrees(pose.yaw_rad))
    return got == pytest.approx((x_m, y_m, yaw_deg), abs=1e-6)


def test_a_plain_table(tmp_path: Path) -> None:
    plain(tmp_path, "a.jpg,1.5,-2,90\n\nsub/b.jpg, 0 ,0,370\n")
    a, b = read_database(tmp_path)
    assert a.file == tmp_path / "a.jpg" and near(a.pose, 1.5, -2.0, 90.0)
    assert b.file == tmp_path / "sub" / "b.jpg" and near(b.pose, 0.0, 0.0, 10.0)
    assert a.height_m is None and a.source == Source() and a.pitch_rad is None


def test_a_grid_of_brains_on_board(tmp_path: Path) -> None:
    rows = (
        f"{HEAD}, Pitch [degrees], Roll [degrees], Grid X, Grid Y, Grid Z, Timestamp [ms]\n"
        "1000, 2000, 300, 0, a.png, 5, nan, 1, 2, 0, 17\n"
        "0, 0, 0, -90, b.png, , -3, 0, 0, 0, 18\n"
    )
    a, b = read_database(brains_on_board(tmp_path, rows, "   type: grid\n   needsUnwrapping: 1\n"))
    assert near(a.pose, 1.0, 2.0, 0.0) and near(b.pose, 0.0, 0.0, -90.0)
    assert (a.height_m, b.height_m) == (0.3, None)
    assert a.pitch_rad == pytest.approx(math.radians(5)) and a.roll_rad is None
    assert b.pitch_rad is None and b.roll_rad == pytest.approx(math.radians(-3))
    assert (a.grid, b.grid) == ((1, 2, 0), (0, 0, 0))
    assert a.source.model == "mirror" and dict(a.more) == {"Timestamp [ms]": "17"}


@pytest.mark.parametrize(
    ("metadata", "headings", "yaw_deg"),
    [
        ("   type: grid\n", None, 30.0),
        ("   camera:\n      name: opengl\n", None, 60.0),  # the ant world
        ("   camera:\n      name: opengl\n", "math", 30.0),
        ("   headings: compass\n", None, 60.0),
        (None, "compass", 60.0),
    ],
)
def test_how_headings_count(
    tmp_path: Path, metadata: str | None, headings: str | None, yaw_deg: float
) -> None:
    brains_on_board(tmp_path, f"{HEAD}\n0,0,0,30,a.png\n", metadata)
    (entry,) = read_database(tmp_path, headings)
    assert near(entry.pose, 0.0, 0.0, yaw_deg)


@pytest.mark.parametrize("heading_deg", [219.97, 230.03])
def test_a_routes_headings_look_along_its_way(tmp_path: Path, heading_deg: float) -> None:
    """Both ways of counting are in use; which one it is shows on the way."""
    rows = "".join(f"{k}.png,{-0.642 * k},{-0.766 * k},{heading_deg}\n" for k in range(3))
    yaw_deg = math.degrees(read_database(plain(tmp_path, rows))[0].pose.yaw_rad)
    assert yaw_deg == pytest.approx(230.03 - 360, abs=0.1)


def zind(folder: Path, **changed: object) -> Path:
    panorama = {
        "floor_plan_transformation": {"translation": [1.0, 2.0], "rotation": 30.0, "scale": 1.1},
        "camera_height": 1.0,
        "image_path": "panos/a.jpg",
    }
    told = {
        "merger": {"floor_01": {"room_01": {"partial_room_01": {"pano_1": panorama | changed}}}},
        "scale_meters_per_coordinate": {"floor_01": 2.0},
    }
    (folder / TOUR).write_text(json.dumps(told))
    return folder


def test_a_tour_of_zind(tmp_path: Path) -> None:
    (entry,) = read_database(zind(tmp_path))
    assert near(entry.pose, -2.0, 4.0, 60.0)
    assert entry.height_m == pytest.approx(2.2)
    assert (entry.floor, entry.source.model) == ("floor_01", "equirectangular")


@pytest.mark.parametrize("name", ["../a.png", "/etc/passwd", "", "C:/a.png", "a/../../b.png"])
def test_names_do_not_leave_the_folder(tmp_path: Path, name: str) -> None:
    plain(tmp_path, f"{name},0,0,0\n")
    with pytest.raises(ImageError, match=r"poses\.csv, line 2: expected a file's name within"):
        read_database(tmp_path)
    (tmp_path / "poses.csv").unlink()
    with pytest.raises(ImageError, match="within the folder"):
        read_database(zind(tmp_path, image_path=name))


@pytest.mark.parametrize(
    ("rows", "word"),
    [
        ("a.png,nan,0,0\n", "line 2: expected a number as x_m, got nothing"),
        ("a.png,0,0,0\nb.png,0,,0\n", "line 3: expected a number as y_m"),
        ("a.png,0,0,north\n", "heading_deg, got 'north'"),
        ("a.png,inf,0,0\n", "x_m, got 'inf'"),
        ("a.png,0,0\n", "line 2: expected 4 cells, got 3"),
        ("", "found none"),
    ],
)
def test_bad_rows_are_named(tmp_path: Path, rows: str, word: str) -> None:
    with pytest.raises(ImageError) as refused:
        read_database(plain(tmp_path, rows))
    assert word in str(refused.value) and str(tmp_path) in str(refused.value)


@pytest.mark.parametrize(
    ("rows", "metadata", "word"),
    [
        ("X [mm], Y [mm], Filename\n", None, "found no Heading [degrees] among X [mm]"),
        ("", None, "among none"),
        (f"{HEAD}\n", "   videoFile: a.mp4\n", "in the video a.mp4"),
        (f"{HEAD}\n", "  - : [\n", "expected a table in YAML"),
        (f"{HEAD}\n", "   3\n", "expected Brains on Board's layout"),
        (f"{HEAD}\n0,0,0,0,a.png\n", "   headings: north\n", "math or compass, got 'north'"),
        ("version https://git-lfs.github.com/spec/v1\n", None, "Git LFS pointer"),
    ],
)
def test_what_is_wrong_with_brains_on_boards_files(
    tmp_path: Path, rows: str, metadata: str | None, word: str
) -> None:
    with pytest.raises(ImageError) as refused:
        read_database(brains_on_board(tmp_path, rows, metadata))
    assert word in str(refused.value)


def test_other_folders_are_none(tmp_path: Path) -> None:
    with pytest.raises(ImageError, match="found 0 CSV files"):
        read_database(tmp_path)
    with pytest.raises(ImageError, match="got 'left'"):
        read_database(tmp_path, "left")
    (tmp_path / "a.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ImageError, match="UTF-8"):
        read_database(tmp_path)
    (tmp_path / TOUR).write_text("[" * 100_000)
    with pytest.raises(ImageError, match="JSON"):
        read_database(tmp_path)


def noise(seed: int) -> Panorama:
    rig = CameraRig(6, 40, 30, 70.0, 0.4)
    pixels = generator(seed, "pixels").integers(0, 256, (6, 30, 40, 3), dtype="uint8")
    return Panorama(rig, pixels)


@pytest.mark.parametrize("cells", [None, ((0, 0, 0), (1, 0, 0))])
def test_what_is_written_is_read_again(tmp_path: Path, cells: tuple | None) -> None:
    """Both formats; the panoramas come back as they were, and others find their cylinders."""
    poses = Pose(-3.25, 1e-3, -3.0), Pose(0.1, 2.0, 0.7)
    panoramas = noise(1), noise(2)
    entries = [
        DatabaseEntry(Path(f"at {k}.jpg"), pose, grid=cells[k] if cells else None)
        for k, pose in enumerate(poses)
    ]
    write_database(tmp_path, zip(entries, panoramas, strict=True))
    for entry, again, panorama in zip(entries, read_database(tmp_path), panoramas, strict=True):
        assert near(again.pose, *entry.pose.xy_m, math.degrees(entry.pose.yaw_rad))
        assert (again.height_m, again.grid) == (0.4, entry.grid)
        found = panorama_of(again)
        assert found.rig == panorama.rig and np.array_equal(found.views, panorama.views)
    (tmp_path / ENTRIES).unlink()
    for entry, again, panorama in zip(entries, read_database(tmp_path), panoramas, strict=True):
        assert near(again.pose, *entry.pose.xy_m, math.degrees(entry.pose.yaw_rad))
        assert np.array_equal(read_image(again.file), panorama.cylinder)

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vrchain.errors import ImageError
from vrchain.geometry import Pose
from vrchain.panorama import CameraRig, Panorama, encode_png, read_image
from vrchain.panorama.databases import (
    ENTRIES,
    METADATA,
    TOUR,
    DatabaseEntry,
    entry_of,
    height_of,
    on_floor,
    opened,
    panorama_of,
    read_database,
    source_of,
    write_database,
)
from vrchain.panorama.models import Mirror
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


def test_a_plain_table_may_tell_more(tmp_path: Path) -> None:
    rows = "filename,x_m,y_m,heading_deg,height_m,pitch_deg,roll_deg,when\na.jpg,1,2,3,0.4,5,,17\n"
    (tmp_path / "poses.csv").write_text(rows)
    (entry,) = read_database(tmp_path)
    assert (entry.height_m, entry.roll_rad, dict(entry.more)) == (0.4, None, {"when": "17"})
    assert entry.pitch_rad == pytest.approx(math.radians(5))


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


RING = "{ centre: [0.5, 0.4], inner: 0.1, outer: 0.4, offsetDegrees: -90, flip: 1 }"


@pytest.mark.parametrize("beside", [False, True])
def test_mirrors_parameters_are_in_the_metadata_or_beside_them(
    tmp_path: Path, beside: bool
) -> None:
    metadata = "   needsUnwrapping: 1\n   camera: { name: see3cam }\n"
    metadata += "" if beside else f"   unwrapper: {RING}\n"
    told = f"%YAML:1.0\n---\nunwrapper: {RING}\n" if beside else "{}"
    (tmp_path / "see3cam.yaml").write_text(told)
    (entry,) = read_database(brains_on_board(tmp_path, f"{HEAD}\n0,0,0,30,a.png\n", metadata))
    assert entry.source == Source("mirror", mirror=Mirror((0.5, 0.4), 0.1, 0.4, -90.0, True))
    (tmp_path / "see3cam.yaml").write_text("unwrapper: {centre: 3}")
    if beside:
        with pytest.raises(ImageError, match="expected an unwrapper's centre"):
            read_database(tmp_path)


@pytest.mark.parametrize(
    ("camera", "elevations_deg"),
    [
        ("{ name: opengl }", (-15, 60)),
        ("{ resolution: [360, 90] }", (-45, 45)),
        ("{ resolution: [360, 180] }", (-90, 90)),
        ("{ resolution: 3 }", None),
        ("3", None),
    ],
)
def test_unwrapped_pictures_are_a_turn_wide(
    tmp_path: Path, camera: str, elevations_deg: tuple[int, int] | None
) -> None:
    metadata = f"   needsUnwrapping: 0\n   camera: {camera}\n"
    (entry,) = read_database(brains_on_board(tmp_path, f"{HEAD}\n0,0,0,30,a.png\n", metadata))
    assert entry.source == Source("equirectangular", elevations_deg=elevations_deg)


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
    rows = "".join(f"{-642 * k},{-766 * k},0,{heading_deg},{k}.png\n" for k in range(3))
    entries = read_database(brains_on_board(tmp_path, f"{HEAD}\n{rows}", None))
    yaw_deg = math.degrees(entries[0].pose.yaw_rad)
    assert yaw_deg == pytest.approx(230.03 - 360, abs=0.1)


def test_headings_of_a_plain_table_are_never_guessed(tmp_path: Path) -> None:
    rows = "".join(f"{k}.png,{-0.642 * k},{-0.766 * k},219.97\n" for k in range(3))
    yaw_deg = math.degrees(read_database(plain(tmp_path, rows))[0].pose.yaw_rad)
    assert yaw_deg == pytest.approx(219.97 - 360)


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


def test_one_floor_has_one_frame(tmp_path: Path) -> None:
    (low,) = read_database(zind(tmp_path))
    high = replace(low, floor="floor_02")
    assert on_floor([low], None) == on_floor([low, high], "floor_01") == [low]
    with pytest.raises(ImageError, match=r"several floors.* --floor, of floor_01, floor_02"):
        on_floor([low, high], None)
    with pytest.raises(ImageError, match="no floor attic: choose one"):
        on_floor([low, high], "attic")


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


@pytest.mark.parametrize(
    "cells", [None, ((0, 0, 0), (1, 0, 0)), ((0, 0, 0), None), (None, (1, 0, 0))]
)
def test_what_is_written_is_read_again(tmp_path: Path, cells: tuple | None) -> None:
    """Both formats; the panoramas come back as they were, and others find their cylinders."""
    poses = Pose(-3.25, 1e-3, -3.0), Pose(0.1, 2.0, 0.7)
    panoramas = noise(1), noise(2)
    entries = [
        DatabaseEntry(
            Path(f"at {k}.jpg"), pose, floor="upper", room=k, grid=cells[k] if cells else None
        )
        for k, pose in enumerate(poses)
    ]
    write_database(tmp_path, zip(entries, panoramas, strict=True))
    for entry, again, panorama in zip(entries, read_database(tmp_path), panoramas, strict=True):
        assert near(again.pose, *entry.pose.xy_m, math.degrees(entry.pose.yaw_rad))
        assert (again.height_m, again.grid) == (0.4, entry.grid)
        assert (again.floor, again.room, dict(again.more)) == ("upper", entry.room, {})
        found = panorama_of(again)
        assert found.rig == panorama.rig and np.array_equal(found.views, panorama.views)
    (tmp_path / ENTRIES).unlink()
    for entry, again, panorama in zip(entries, read_database(tmp_path), panoramas, strict=True):
        assert near(again.pose, *entry.pose.xy_m, math.degrees(entry.pose.yaw_rad))
        assert np.array_equal(read_image(again.file), panorama.cylinder)


def test_pictures_of_one_name_lie_in_folders_of_their_own(tmp_path: Path) -> None:
    files = [Path(name) for name in ("a.jpg", "a_.jpg", "x/a.jpg", "y/a.jpg")]
    entries = [DatabaseEntry(file, Pose(float(k), 0.0)) for k, file in enumerate(files)]
    write_database(tmp_path, [(entry, noise(k)) for k, entry in enumerate(entries)])
    again = [panorama_of(entry) for entry in read_database(tmp_path)]
    assert all(np.array_equal(p.views, noise(k).views) for k, p in enumerate(again))


@pytest.mark.parametrize(
    ("camera", "model"),
    [("resolution: [.inf, 400]", "equirectangular"), ("resolution: [400, .inf]", "equirectangular"),
     (f"isPanoramic: 1\n      name: {'x' * 400}", "mirror")],
)  # fmt: skip
def test_what_no_camera_is_tells_nothing(tmp_path: Path, camera: str, model: str) -> None:
    told = f"{HEAD}\n0,0,0,0,a.png\n", f"   camera:\n      {camera}\n"
    (entry,) = read_database(brains_on_board(tmp_path, *told))
    assert entry.source.model == model


def test_one_rig_for_all_and_options_before_what_is_told(tmp_path: Path) -> None:
    """Pictures of two sizes; a tilt in a row is corrected unless an option says another."""
    rows = f"{HEAD}, Pitch [degrees]\n0,0,700,0,a.png,3\n0,0,900,0,b.png,nan\n"
    brains_on_board(tmp_path, rows, "   needsUnwrapping: 0\n")
    for name, width_px in (("a", 512), ("b", 800)):
        picture = np.full((width_px // 2, width_px, 3), 9, dtype=np.uint8)
        (tmp_path / f"{name}.png").write_bytes(encode_png(picture))
    entries = read_database(tmp_path)
    assert height_of(entries) == pytest.approx(0.8)
    upsampled: list[float] = []
    a, b = (p.rig for _, p in opened(entries, Source(camera_height_m=0.8), upsampled))
    assert a == b and a.camera_height_m == 0.8
    assert upsampled == [pytest.approx(1, abs=0.02), pytest.approx(512 / 800, abs=0.02)]
    taller = source_of(entries[0], Source("equirectangular"))
    assert taller.camera_height_m == 0.7  # as the database says
    written = tmp_path / "written"
    written.mkdir()
    write_database(written, opened(entries, Source("equirectangular", pitch_deg=5.0)))
    about = json.loads((written / "a/panorama.json").read_text())
    assert about["tilt_corrected"] and about["pitch_deg"] == 5.0
    (again, _) = next(opened(read_database(written)))
    assert again.about["pitch_deg"] == 5.0
    with pytest.raises(ImageError, match="is a panorama already"):
        list(opened(read_database(written), Source(pitch_deg=1.0)))
    told = source_of(entries[0])
    assert (told.pitch_deg, told.camera_height_m) == (pytest.approx(3), 0.7)
    assert source_of(entries[0], Source(pitch_deg=1.0)).pitch_deg == 1.0
    assert panorama_of(entries[0]).rig.camera_height_m == 0.7


@pytest.mark.parametrize(
    ("content", "word"),
    [(None, "No such file"), (b"", "expected an image"), (b"\xff\xd8\xff", "expected an image"),
     (b"version https://git-lfs.github.com/spec/v1\n", "Git LFS pointer")],
)  # fmt: skip
def test_a_picture_that_cannot_be_read_is_named(
    tmp_path: Path, content: bytes | None, word: str
) -> None:
    plain(tmp_path, "a.png,0,0,0\n")
    if content is not None:
        (tmp_path / "a.png").write_bytes(content)
    with pytest.raises(ImageError) as refused:
        list(opened(read_database(tmp_path), Source("equirectangular")))
    assert word in str(refused.value) and "a.png" in str(refused.value)


@pytest.mark.parametrize(
    "told",
    ["{}", '{"pose": 3}', '{"pose": {"x_m": 1, "y_m": NaN}}', "{",
     f'{{"pose": {{"x_m": 1{"0" * 400}, "y_m": 0, "yaw_rad": 0}}}}'],
)  # fmt: skip
def test_a_panorama_without_a_position_is_no_entry(tmp_path: Path, told: str) -> None:
    (tmp_path / "panorama.json").write_text(told)
    with pytest.raises(ImageError, match=r"panorama\.json: expected a"):
        entry_of(tmp_path)

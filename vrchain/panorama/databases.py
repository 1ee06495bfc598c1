"""Image databases: pictures with the poses that they were taken from, in three formats and back.

Read are Brains on Board's (``database_entries.csv``, ``database_metadata.yaml``), that of ZInD
(Cruz et al., "Zillow Indoor Dataset", 2021; ``zind_data.json``), and a plain CSV of the columns
``filename,x_m,y_m,heading_deg``. World frame: x east, y north; yaw anticlockwise from x.
"""

import csv
import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict
from itertools import pairwise
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from vrchain.errors import ImageError
from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.panorama.entries import (
    DatabaseEntry,
    entry_of,
    height_of,
    on_floor,
    opened,
    panorama_of,
    source_of,
)
from vrchain.panorama.models import Mirror
from vrchain.panorama.panorama import Panorama
from vrchain.panorama.sources import Source
from vrchain.panorama.tables import inside, maybe, number, read_json, read_yaml, rows_of

__all__ = [
    "ENTRIES", "HEADINGS", "METADATA", "TOUR", "DatabaseEntry", "entry_of", "height_of", "on_floor",
    "opened", "panorama_of", "read_database", "read_metadata", "source_of", "write_database",
]  # fmt: skip

ENTRIES, METADATA = "database_entries.csv", "database_metadata.yaml"  # Brains on Board
MADE = "vrchain-database.txt"  # marks a database as ours, which may be replaced
TOUR = "zind_data.json"
_PLAIN = ("filename", "x_m", "y_m", "heading_deg")
_BOB = ("Filename", "X [mm]", "Y [mm]", "Heading [degrees]")
_OWN = "Panorama"  # a column of ours: the folder of the panorama that the picture was made of
_PLACE = ("Floor", "Room")  # of ours
_GRID = ("Grid X", "Grid Y", "Grid Z")
HEADINGS = "math", "compass"  # anticlockwise from x, or clockwise from y
_ANT_WORLD_DEG = (-15.0, 60.0)  # the elevations that its pictures show
_ALIKE_RAD = math.radians(20.0)  # headings that fit the way taken as well as that look along it


def read_database(folder: str | Path, headings: str | None = None) -> list[DatabaseEntry]:
    """The entries of an image database, in its order; the pictures themselves are not read.

    headings: how a CSV's headings count, one of ``HEADINGS``. None: of the plain CSV anticlockwise
    from x; else as the metadata say; without, as a route's headings fit its way. ImageError, which
    names file and row: no database, a column or number is missing, a name that leaves the folder.
    """
    folder = Path(folder)
    if headings not in (None, *HEADINGS):
        raise ImageError(f"expected headings of {' or '.join(HEADINGS)}, got {headings!r}")
    if (folder / ENTRIES).is_file():
        entries = _brains_on_board(folder, headings)
    elif (folder / TOUR).is_file():
        entries = _zind(folder)
    else:
        tables = sorted(folder.glob("*.csv"))
        if len(tables) != 1:
            raise ImageError(
                f"{folder}: expected an image database, a folder with {ENTRIES}, {TOUR} or one "
                f"CSV file of the columns {','.join(_PLAIN)}; found {len(tables)} CSV files"
            )
        entries = _plain(tables[0], headings)
    if not entries:
        raise ImageError(f"{folder}: expected pictures with positions, found none")
    return entries


def write_database(folder: Path, taken: Iterable[tuple[DatabaseEntry, Panorama]]) -> None:
    """Write panoramas with their poses as a database of Brains on Board's, and as a plain CSV.

    Into an existing, empty folder; an entry's panorama lies whole in a folder of the name of its
    file, without ending; others find the joined cylinder there. ``read_database`` reads both.
    """
    rows: list[list[Any]] = []
    size_px, names = (0, 0), set()
    for entry, panorama in taken:
        name = entry.file.resolve().name if entry.own else entry.file.stem
        while name in names:
            name += "_"
        names.add(name)
        (folder / name).mkdir()
        panorama.save(folder / name, {**entry.about, "pose": asdict(entry.pose)})
        size_px = panorama.cylinder.shape[1::-1]
        heading_deg = math.degrees(entry.pose.yaw_rad)
        mm = [1e3 * v for v in (*entry.pose.xy_m.tolist(), panorama.rig.camera_height_m)]
        where = [entry.floor, entry.room or "", *(entry.grid or ("", "", ""))]
        rows.append([*mm, heading_deg, f"{name}/cylinder.png", name, *where])
    columns = [_BOB[1], _BOB[2], "Z [mm]", _BOB[3], _BOB[0], _OWN, *_PLACE, *_GRID]
    unsure = {k for k, name in enumerate(columns) if name in (*_PLACE, *_GRID)}
    told = [k for k in range(len(columns)) if k not in unsure or any(row[k] != "" for row in rows)]
    on_grid = columns[told[-1]] == _GRID[-1]
    with (folder / ENTRIES).open("w", newline="") as file:
        table = [[row[k] for k in told] for row in (columns, *rows)]
        csv.writer(file, lineterminator="\n").writerows(table)
    with (folder / "poses.csv").open("w", newline="") as file:
        plain = [[row[4], row[0] / 1e3, row[1] / 1e3, row[3]] for row in rows]
        csv.writer(file, lineterminator="\n").writerows([_PLAIN, *plain])
    (folder / MADE).write_text("Written by vrchain: to be replaced as a whole.\n")
    (folder / METADATA).write_text(
        "%YAML:1.0\n---\nmetadata:\n"
        f"   type: {'grid' if on_grid else 'route'}\n"
        "   camera:\n      name: vrchain\n"
        f"      resolution: [ {size_px[0]}, {size_px[1]} ]\n      isPanoramic: 0\n"
        f"   needsUnwrapping: 0\n   isGreyscale: 0\n   headings: {HEADINGS[0]}\n"
    )


def _plain(table: Path, headings: str | None) -> list[DatabaseEntry]:
    """height_m, pitch_deg and roll_deg may be told too."""
    rows = list(rows_of(table, _PLAIN))
    yaws = [number(row, "heading_deg", where) for row, where in rows]
    places = [[number(row, c, where) for c in ("x_m", "y_m")] for row, where in rows]
    told = headings or HEADINGS[0]
    known = (*_PLAIN, "height_m", "pitch_deg", "roll_deg")
    return [
        DatabaseEntry(
            inside(table.parent, row["filename"], where),
            Pose(xy[0], xy[1], _yaw_rad(yaw, told)),
            maybe(row, "height_m", where),
            _rad(maybe(row, "pitch_deg", where)),
            _rad(maybe(row, "roll_deg", where)),
            more={k: v for k, v in row.items() if k not in known},
        )
        for (row, where), xy, yaw in zip(rows, places, yaws, strict=True)
    ]


def _rad(angle_deg: float | None) -> float | None:
    return None if angle_deg is None else math.radians(angle_deg)


def _brains_on_board(folder: Path, headings: str | None) -> list[DatabaseEntry]:
    """Z is the camera's height if it is above 0; ours has its panoramas beside the pictures."""
    metadata = read_metadata(folder)
    if metadata.get("videoFile"):
        raise ImageError(
            f"{folder / METADATA}: expected a database of pictures, but they are in the video "
            f"{metadata['videoFile']}: write its frames as pictures, with a column Filename"
        )
    rows = list(rows_of(folder / ENTRIES, _BOB))
    places = [[number(row, c, where) / 1e3 for c in _BOB[1:3]] for row, where in rows]
    yaws = [number(row, _BOB[3], where) for row, where in rows]
    told = headings or metadata.get("headings") or _headings_of(metadata, places, yaws)
    if told not in HEADINGS:
        raise ImageError(
            f"{folder / METADATA}: expected headings of {' or '.join(HEADINGS)}, got {told!r}"
        )
    source = _source_of_all(folder, metadata)
    known = {*_BOB, *_PLACE, *_GRID, _OWN, "Z [mm]", "Pitch [degrees]", "Roll [degrees]"}
    entries = []
    for (row, where), xy, yaw in zip(rows, places, yaws, strict=True):
        own = row.get(_OWN)
        up_m = (maybe(row, "Z [mm]", where) or 0.0) / 1e3
        pitch, roll = (maybe(row, f"{n} [degrees]", where) for n in ("Pitch", "Roll"))
        grid = [int(n) for n in (maybe(row, name, where) for name in _GRID) if n is not None]
        entries.append(
            DatabaseEntry(
                inside(folder, own or row["Filename"], where),
                Pose(xy[0], xy[1], _yaw_rad(yaw, told)),
                up_m if up_m > 0 else None,
                _rad(pitch),
                _rad(roll),
                source,
                bool(own),
                row.get("Floor", ""),
                int(maybe(row, "Room", where) or 0),
                (grid[0], grid[1], grid[2]) if len(grid) == 3 else None,
                more={k: v for k, v in row.items() if k not in known},
            )
        )
    return entries


def read_metadata(folder: Path) -> dict[str, Any]:
    """What ``database_metadata.yaml`` says under ``metadata``; empty if there is no such file.

    ImageError if it is no YAML of that layout.
    """
    file = folder / METADATA
    if not file.is_file():
        return {}
    metadata = read_yaml(file).get("metadata")
    if not isinstance(metadata, dict):
        raise ImageError(f"{file}: expected Brains on Board's layout, a table `metadata`")
    return metadata


def _source_of_all(folder: Path, metadata: Mapping[str, Any]) -> Source:
    """Mirrors' parameters are in the metadata, or in a file of the camera's name beside them.

    Unwrapped pictures are a turn wide, their rows elevations; the ant world's are 75 degrees high.
    """
    given = metadata.get("camera")
    camera = given if isinstance(given, dict) else {}
    name = str(camera.get("name", ""))
    if metadata.get("needsUnwrapping", camera.get("isPanoramic", 0)):
        beside = folder / f"{PurePosixPath(name).name}.yaml"
        ring = metadata.get("unwrapper")
        if ring is None and 0 < len(name.encode()) < 200 and beside.is_file():
            ring = read_yaml(beside).get("unwrapper")
        return Source("mirror", mirror=None if ring is None else mirror_of(ring, str(folder)))
    if name == "opengl":
        return Source("equirectangular", elevations_deg=_ANT_WORLD_DEG)
    try:
        width_px, height_px = map(int, camera["resolution"])
        half_deg = min(180 * height_px / width_px, 90.0)
    except (KeyError, TypeError, ValueError, OverflowError, ZeroDivisionError):
        return Source("equirectangular")
    return Source("equirectangular", elevations_deg=(-half_deg, half_deg))


def mirror_of(told: Any, what: str) -> Mirror:
    """A mirror by a table of the unwrapper's: centre, inner, outer, offsetDegrees, flip."""
    try:
        x, y = map(float, told["centre"])
        inner, outer, offset = (float(told[n]) for n in ("inner", "outer", "offsetDegrees"))
        return Mirror((x, y), inner, outer, offset, bool(int(told["flip"])))
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise ImageError(
            f"{what}: expected an unwrapper's centre, inner, outer, offsetDegrees, flip ({error})"
        ) from error


def _headings_of(metadata: Mapping[str, Any], places: list[list[float]], yaws: list[float]) -> str:
    """Pictures that Brains on Board's ant world drew count clockwise from y."""
    camera = metadata.get("camera")
    if isinstance(camera, dict) and camera.get("name") == "opengl":
        return "compass"
    return _headings_of_a_way(places, yaws)


def _headings_of_a_way(places: list[list[float]], yaws_deg: list[float]) -> str:
    """ "compass" if headings so read look along the way taken, and not so if they are read else."""
    steps = [
        (math.atan2(b[1] - a[1], b[0] - a[0]), yaw)
        for (a, b), yaw in zip(pairwise(places), yaws_deg, strict=False)
        if a != b
    ]
    if not steps:
        return HEADINGS[0]
    off_rad = [
        float(np.median([abs(wrap_angle_rad(way - _yaw_rad(yaw, told))) for way, yaw in steps]))
        for told in HEADINGS
    ]
    return HEADINGS[off_rad[1] < min(_ALIKE_RAD, off_rad[0] / 2)]


def _yaw_rad(heading_deg: float, told: str) -> float:
    turned_deg = 90 - heading_deg if told == "compass" else heading_deg
    return float(wrap_angle_rad(math.radians(turned_deg % 360)))


def _zind(folder: Path) -> list[DatabaseEntry]:
    """Panoramas of the floors whose scale is known; a room is what ZInD calls a complete room."""
    told = read_json(folder / TOUR)
    try:
        rooms = [
            (floor, scale_m, partial_rooms)
            for floor, complete in told["merger"].items()
            if (scale_m := told["scale_meters_per_coordinate"][floor])
            for partial_rooms in complete.values()
        ]
        return [
            _located(folder, room, floor, scale_m, panorama)
            for room, (floor, scale_m, partial_rooms) in enumerate(rooms)
            for panoramas in partial_rooms.values()
            for panorama in panoramas.values()
        ]
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        why = f"{type(error).__name__}: {error}"
        raise ImageError(f"{folder / TOUR}: expected a tour in ZInD's layout ({why})") from error


def _located(
    folder: Path, room: int, floor: str, scale_m: float, told: dict[str, Any]
) -> DatabaseEntry:
    """The floor plan is a mirror image, and the picture's middle looks along its y axis."""
    placed = told["floor_plan_transformation"]
    x, y = placed["translation"]
    yaw_rad = wrap_angle_rad(np.pi / 2 - np.radians(placed["rotation"]))
    pose = Pose(-float(x) * scale_m, float(y) * scale_m, float(yaw_rad))
    height_m = float(told["camera_height"]) * placed["scale"] * scale_m
    if not np.isfinite([*pose.xy_m, pose.yaw_rad, height_m]).all():
        raise ValueError(f"{told['image_path']}: a number that is none")
    file = inside(folder, told["image_path"], str(folder / TOUR))
    return DatabaseEntry(
        file, pose, height_m, source=Source("equirectangular"), floor=floor, room=room
    )

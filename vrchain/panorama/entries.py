"""An entry of an image database: a picture, its pose, and the panorama that is made of it."""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from vrchain.errors import ImageError
from vrchain.geometry import Pose
from vrchain.panorama.panorama import MARKER, Panorama
from vrchain.panorama.rig import CameraRig
from vrchain.panorama.sources import Source, import_panorama
from vrchain.panorama.tables import read_json


@dataclass(frozen=True)
class DatabaseEntry:
    """A picture, and from where it was taken.

    file: the picture, or the folder of a panorama of ours where ``own``. pose: of
    the camera in the world; its yaw is where the picture's middle looks. height_m: above the
    ground. pitch_rad (middle looks up), roll_rad (right side goes down): None where not told.
    source: how the picture is to be read, as far as the database tells. floor, room:
    only positions on one floor have one frame. grid: the cell, where the positions are a grid.
    more: what else its row says; about: what is known of its panorama, as ``Imported`` has it.
    """

    file: Path
    pose: Pose
    height_m: float | None = None
    pitch_rad: float | None = None
    roll_rad: float | None = None
    source: Source = Source()  # noqa: RUF009
    own: bool = False
    floor: str = ""
    room: int = 0
    grid: tuple[int, int, int] | None = None
    more: Mapping[str, str] = field(default_factory=dict)
    about: Mapping[str, object] = field(default_factory=dict)


def panorama_of(
    entry: DatabaseEntry, source: Source | None = None, rig: CameraRig | None = None
) -> Panorama:
    """The panorama in an entry's picture. ImageError: it is not what its source says.

    source: how to read the pictures, instead of what the entry tells; its height is of all of them.
    rig: of the panoramas that it is to be compared with: those need one, and one height.
    """
    if entry.own:
        return Panorama.load(entry.file)
    return import_panorama(entry.file, source_of(entry, source), rig).panorama


def source_of(entry: DatabaseEntry, asked: Source | None = None) -> Source:
    """How an entry's picture is to be read: what is asked for, and else what the entry tells.

    ImageError for a panorama of ours of which something is asked: it is as it is.
    """
    if entry.own and asked not in (None, Source()):
        raise ImageError(
            f"{entry.file}: is a panorama already, which is taken as it is: leave out how pictures "
            "are to be read"
        )
    tilt: dict[str, Any] = {
        f"{name}_deg": math.degrees(rad)
        for name, rad in (("pitch", entry.pitch_rad), ("roll", entry.roll_rad))
        if rad is not None
    }
    same = asked is None or asked.model in (Source.model, entry.source.model)
    told = replace(entry.source if same else Source(), camera_height_m=entry.height_m, **tilt)
    if asked is None:
        return told
    default = Source()
    chosen = {f.name: getattr(asked, f.name) for f in fields(Source)}
    said = {name: v for name, v in chosen.items() if v != getattr(default, name)}
    return replace(told, **said)


def opened(
    entries: Iterable[DatabaseEntry],
    source: Source | None = None,
    upsampled: list[float] | None = None,
) -> Iterator[tuple[DatabaseEntry, Panorama]]:
    """Entries with their panoramas, all in the rig of the first. upsampled: gets each one's.

    ImageError as ``source_of``.
    """
    rig = None
    for entry in entries:
        read_so = source_of(entry, source)
        if entry.own:
            panorama, about = Panorama.load(entry.file), read_json(entry.file / MARKER)
        else:
            imported = import_panorama(entry.file, read_so, rig)
            panorama, about = imported.panorama, imported.about
            if upsampled is not None:
                upsampled.append(imported.upsampled)
        rig = rig or panorama.rig
        yield replace(entry, about=about), panorama


def on_floor(entries: Sequence[DatabaseEntry], floor: str | None) -> list[DatabaseEntry]:
    """Entries that share one frame. ImageError: there are several floors, and none is chosen."""
    floors = sorted({entry.floor for entry in entries})
    if floor is None and len(floors) == 1:
        floor = floors[0]
    if floor not in floors:
        told = "several floors, each of its own frame" if floor is None else f"no floor {floor}"
        raise ImageError(f"{told}: choose one by --floor, of {', '.join(floors) or 'none'}")
    return [entry for entry in entries if entry.floor == floor]


def height_of(entries: Iterable[DatabaseEntry]) -> float:
    """The camera's height of all: the median of those told, as far as a rig can stand so high."""
    told = [e.height_m for e in entries if e.height_m is not None and 0.05 <= e.height_m <= 10]
    return float(np.median(told)) if told else CameraRig.camera_height_m


def entry_of(folder: Path) -> DatabaseEntry:
    """The entry of a panorama's folder whose position is known; ImageError: it is not."""
    panorama = read_json(folder / MARKER)
    try:
        told = panorama["pose"]
        pose = Pose(*(float(told[name]) for name in ("x_m", "y_m", "yaw_rad")))
        if not np.isfinite([*pose.xy_m, pose.yaw_rad]).all():
            raise ValueError("a number that is none")
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise ImageError(
            f"{folder / MARKER}: expected a `pose` of x_m, y_m and yaw_rad, as panoramas have that "
            f"were drawn or imported with a database ({error})"
        ) from error
    return DatabaseEntry(folder, pose, own=True)

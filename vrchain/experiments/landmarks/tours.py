"""Real panoramas whose poses are known: a tour of a house, and other places beside it.

The layout is that of ZInD (Cruz et al., "Zillow Indoor Dataset", 2021): ``zind_data.json``, and the
equirectangular pictures that it names. Of other places a folder of pictures is enough.
"""

import hashlib
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from itertools import combinations, count
from pathlib import Path
from time import perf_counter
from typing import Any

import cv2
import numpy as np
import pandas as pd

from vrchain.errors import ImageError
from vrchain.experiments.intervals import Bootstrap, or_none, shown
from vrchain.experiments.kept import kept_each
from vrchain.experiments.landmarks.precision import looks_of, makers
from vrchain.files import code_digest, name_of
from vrchain.geometry import Pose
from vrchain.landmarks.matching.variants import Variant
from vrchain.landmarks.quality import POSE_RIGHT_DEG, pose_errors_deg
from vrchain.panorama import read_image
from vrchain.panorama.databases import TOUR, read_database
from vrchain.panorama.sources import from_equirectangular

NEAR_M = 2.5
BANDS = NEAR, FAR, OTHER_ROOMS, ELSEWHERE = (
    f"same room, up to {NEAR_M:g} m", "same room, beyond", "other rooms", "different places",
)  # fmt: skip
_SUFFIXES = (".jpg", ".jpeg", ".png")


@dataclass(frozen=True)
class Taken:
    """A panorama's picture: in which place, floor and room, and, if known, from which pose.

    room: a number, the panorama's own where rooms are not told. height_m: of the camera.
    """

    file: Path
    place: int
    room: int
    floor: str = ""
    pose: Pose | None = None
    height_m: float | None = None


def read_places(folders: Sequence[Path]) -> list[Taken]:
    """The panoramas of a tour, and of other tours or folders of pictures behind it.

    ImageError if the first is no tour, or one holds no pictures.
    """
    rooms = count()
    taken: list[Taken] = []
    for place, folder in enumerate(folders):
        told = (folder / TOUR).is_file()
        if not told and not place:
            raise ImageError(f"{folder}: expected a tour, a folder that holds {TOUR}")
        own = _tour(folder, place, rooms) if told else _pictures(folder, place, rooms)
        if not own:
            raise ImageError(f"{folder}: expected panoramas ({', '.join(_SUFFIXES)}), found none")
        taken += own
    return taken


def _pictures(folder: Path, place: int, rooms: "count[int]") -> list[Taken]:
    files = sorted(f for f in folder.glob("*") if f.suffix.lower() in _SUFFIXES)
    return [Taken(file, place, next(rooms)) for file in files]


def _tour(folder: Path, place: int, rooms: "count[int]") -> list[Taken]:
    room: defaultdict[int, int] = defaultdict(rooms.__next__)
    return [
        Taken(e.file, place, room[e.room], e.floor, e.pose, e.height_m)
        for e in read_database(folder)
    ]


def band_of(a: Taken, b: Taken) -> str | None:
    """The band that a pair belongs to; None: of one place, but how they lie is not known."""
    if a.place != b.place:
        return ELSEWHERE
    if a.pose is None or b.pose is None or a.floor != b.floor:
        return None
    if a.room != b.room:
        return OTHER_ROOMS
    return NEAR if a.pose.distance_to_m(b.pose.xy_m) <= NEAR_M else FAR


def evaluate(
    folders: Sequence[Path],
    variants: Sequence[Variant],
    *,
    folder: Path,
    height_m: float | None = None,
) -> pd.DataFrame:
    """Every pair of panoramas of a tour, and across places: one row a pair and variant.

    height_m: of all cameras, instead of the median that the tour tells. Columns: a, b (files),
    band, room (a's), variant, spacing_m, claims, right (something is claimed, under a right pose),
    direction_error_deg and heading_error_deg (where something is claimed), ms. What was found
    already under ``folder`` is read from there.
    """
    taken = read_places(folders)
    if not any(band_of(a, b) for a, b in combinations(taken, 2)):
        raise ImageError(f"{folders[0]}: expected two panoramas or more on one floor, found none")
    if height_m is None:
        height_m = float(np.median([t.height_m for t in taken if t.height_m is not None]))
    asked = [code_digest(), [*map(_told, taken)], height_m, makers(variants)]
    columns = read_image(taken[0].file).shape[1]
    look = cache(partial(_looks, taken, variants, height_m, columns))
    own = folder / name_of(asked)
    files = [own / f"panorama_{k:04d}.json" for k in range(len(taken))]
    found = kept_each(partial(_beside_later, taken, variants, look), files, 1, "panoramas")
    return pd.DataFrame([row for rows in found for row in rows])


def _told(taken: Taken) -> list[object]:
    """A panorama by what is in it, wherever it lies."""
    try:
        content = hashlib.sha256(taken.file.read_bytes()).hexdigest()
    except OSError as error:
        raise ImageError(f"cannot read {taken.file}: {error.strerror or error}") from error
    pose = taken.pose and [*map(float, taken.pose.xy_m), taken.pose.yaw_rad]
    return [content, taken.place, taken.room, taken.floor, pose]


def _looks(
    taken: Sequence[Taken], variants: Sequence[Variant], height_m: float, columns: int, k: int
) -> dict[Any, Any]:
    """What is kept of a panorama, as large as the first: only those of one rig are compared."""
    file = taken[k].file
    picture = read_image(file)
    if picture.shape[1] != columns and picture.shape[1] == 2 * picture.shape[0]:
        area = cv2.INTER_AREA if picture.shape[1] > columns else cv2.INTER_LINEAR
        picture = cv2.resize(picture, (columns, columns // 2), interpolation=area).astype(np.uint8)
    return looks_of(from_equirectangular(picture, height_m, what=str(file)), variants)


def _beside_later(
    taken: Sequence[Taken],
    variants: Sequence[Variant],
    look: Callable[[int], dict[Any, Any]],
    k: int,
) -> list[dict[str, object]]:
    """Rows of a panorama's pairs with those behind it."""
    rows: list[dict[str, object]] = []
    a = taken[k]
    for n, b in enumerate(taken[k + 1 :], k + 1):
        band = band_of(a, b)
        if band is None:
            continue
        pair = {"a": a.file.name, "b": b.file.name, "band": band, "room": a.room}
        for variant in variants:
            looks = look(k)[variant.look], look(n)[variant.look]
            start = perf_counter()
            found = variant.compare(*looks)
            ms = (perf_counter() - start) * 1e3
            rows.append(
                pair
                | {"variant": variant.name, "claims": len(found.common)}
                | _judged(found, a.pose, b.pose if band != ELSEWHERE else None)
                | {"ms": ms}
            )
    return rows


def _judged(found: Any, a: Pose | None, b: Pose | None) -> dict[str, object]:
    """What truth says of the pose, if one is to be relied on."""
    told: dict[str, object] = {
        "spacing_m": a.distance_to_m(b.xy_m) if a and b else None,
        "right": False,
        "direction_error_deg": None,
        "heading_error_deg": None,
    }
    pose = found.relative_pose
    if pose is None or a is None or b is None:
        return told
    off_deg = pose_errors_deg(pose, a, b)
    right = all(off <= most for off, most in zip(off_deg, POSE_RIGHT_DEG, strict=True))
    names = ("direction_error_deg", "heading_error_deg")
    return told | {"right": right} | dict(zip(names, off_deg, strict=True))


def summarise(found: pd.DataFrame) -> pd.DataFrame:
    """Of ``evaluate``: how many pairs of each band are claimed, by variant.

    Columns: band, variant, pairs, claimed, right, wrong (pairs claimed under a right and a wrong
    pose), right_share and wrong_share with 95 % intervals (bootstrap over rooms), the medians
    direction_error_deg and heading_error_deg (of pairs claimed), and ms_per_pair.
    """
    rows: list[dict[str, object]] = []
    for band in BANDS:
        for variant, own in found[found.band == band].groupby("variant", sort=False):
            claimed, right = own.claims > 0, own.right.astype(bool)
            told = Bootstrap(own.room, "tour")
            errors = {f"{n}_error_deg": own[f"{n}_error_deg"] for n in ("direction", "heading")}
            rows.append(
                {
                    "band": band,
                    "variant": variant,
                    "pairs": len(own),
                    "claimed": int(claimed.sum()),
                    "right": int(right.sum()),
                    "wrong": int((claimed & ~right).sum()),
                    **told.share("right_share", right, own.room),
                    **told.share("wrong_share", claimed & ~right, own.room),
                    **{n: or_none(e.astype(float).median()) for n, e in errors.items()},
                    "ms_per_pair": float(own.ms.median()),
                }
            )
    table = pd.DataFrame(rows).astype(object)
    return table.where(table.notna(), None)


def as_text(rows: pd.DataFrame) -> str:
    """The table of ``summarise`` to read, intervals in brackets."""
    names = [name for name in rows.columns if not name.endswith("_ci")]
    table = [{n: shown(dict(row), n, ".2f") for n in names} for _, row in rows.iterrows()]
    return pd.DataFrame(table).to_string(index=False)

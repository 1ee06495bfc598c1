"""How well homing works between the pictures of a database, whose positions are known.

*Pairs.* Every picture is a home, and every other one of its floor and room, so far away, a start.
Where there are more pairs than asked for, homes are drawn until there are enough. The angular error
is that of the home vector at the start; no answer counts as 90 degrees. An arrival declared farther
than 0.3 m from home is false.

*Return*, where the positions form a grid, is that of ``homing``: the robot goes on by the home
vectors of the nearest pictures, and fails where there are none. On a coarse grid it has returned
where home's picture is the nearest.

*Tilt.* Every picture is tilted by one angle about a horizontal axis of its own before it is looked
at; what comes into view at its upper and lower edge repeats the edge. *Compass.* The true heading
with a normal error; a row of each deviation.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, partial
from itertools import pairwise

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from vrchain.errors import ImageError, MissionError
from vrchain.experiments.homing import COMPASS, RETURNED_M, Free, Grid, judged, returned
from vrchain.experiments.intervals import Bootstrap, or_none, table_of
from vrchain.experiments.landmarks.degradations import tilted
from vrchain.geometry import wrap_angle_rad
from vrchain.homing import METHODS, Method, Snapshot, Views, method_named, snapshot
from vrchain.panorama.databases import DatabaseEntry, height_of, panorama_of
from vrchain.seeding import generator

SPACING_M = 1.0, 5.0
BANDS = 3  # of the distance, equally wide
SURE_DEG, WRONG_DEG = 20.0, 45.0  # an answer whose deviation is below, though it is farther off
_CELL = 0.71  # from a cell's middle to its corner, in its sides
_LEAST_GRID, _EVEN, _MOST = 9, 0.1, 0.8  # positions of a grid; how even it is, and how many are


def evaluate(
    entries: Sequence[DatabaseEntry],
    methods: Sequence[str] = tuple(METHODS),
    *,
    seed: int,
    most_pairs: int = 200,
    spacing_m: tuple[float, float] = SPACING_M,
    tilts_deg: Sequence[float] = (0.0,),
    compass_errors_deg: Sequence[float] = (0.0,),
) -> pd.DataFrame:
    """Home vectors of pairs of pictures, one row a pair, method, tilt and compass.

    Columns: home (its number), start, x_m, y_m (of the start, from home), range_m, method (the
    row's name), answered, course_rad, error_deg, std_rad, arrived, remoteness, n_matches, returned
    (None where positions form no grid). MissionError: a method that there is not, or no pairs.
    """
    named = {name: method_named(name) for name in methods}
    asked = tilts_deg, compass_errors_deg
    tilts_deg, compass_errors_deg = (list(dict.fromkeys(degrees)) for degrees in asked)
    spacing = grid_spacing_m(entries)
    near_m = spacing_m[0] if spacing is None else 0.0  # a robot that returns comes nearer
    homes = _homes(entries, spacing_m, near_m, most_pairs, generator(seed, "homes"))
    height_m = height_of(entries)
    found = []
    for tilt_deg in tilts_deg:
        look = cache(partial(_look, entries, height_m, tilt_deg, seed))
        for home, pairs in homes.items():
            rows = [
                row
                for start in pairs
                for row in _from(entries, look, start, home, named, compass_errors_deg, seed)
            ]
            found.append(_with_returns(pd.DataFrame(rows), spacing))
            if tilt_deg or len(tilts_deg) > 1:
                found[-1]["method"] += f", tilt {tilt_deg:g}"
    table = pd.concat(found, ignore_index=True)
    low, high = spacing_m
    return table[(table.range_m > 0) & (table.range_m >= low) & (table.range_m <= high)]


def grid_spacing_m(entries: Sequence[DatabaseEntry]) -> float | None:
    """The spacing of the grid that the positions form; None if they form none."""
    points = np.unique([entry.pose.xy_m.round(3) for entry in entries], axis=0)
    if len(points) < _LEAST_GRID:
        return None
    nearest_m = np.sort(cKDTree(points).query(points, k=min(5, len(points)))[0][:, 1:])
    spacing_m = float(np.median(nearest_m[:, 0]))
    even = np.abs(nearest_m[:, :2] - spacing_m) <= _EVEN * spacing_m
    return spacing_m if even.mean() >= _MOST else None


def _homes(
    entries: Sequence[DatabaseEntry],
    spacing_m: tuple[float, float],
    near_m: float,
    most_pairs: int,
    draws: np.random.Generator,
) -> dict[int, list[int]]:
    """Starts of each home, those from near_m on, even if nearer than asked for."""
    low, high = spacing_m
    homes: dict[int, list[int]] = {}
    n_pairs, ranges_m = 0, [np.inf]
    for home in draws.permutation(len(entries)).tolist():
        at = entries[home]
        fellows = [
            (k, at.pose.distance_to_m(entry.pose.xy_m))
            for k, entry in enumerate(entries)
            if (entry.floor, entry.room) == (at.floor, at.room)
        ]
        asked = sum(range_m > 0 and low <= range_m <= high for _, range_m in fellows)
        ranges_m += [range_m for k, range_m in fellows if k != home]
        if n_pairs and n_pairs + asked > most_pairs:
            break  # to go on with smaller rooms alone would favour them
        if asked:
            homes[home] = [k for k, range_m in fellows if near_m <= range_m <= high]
            n_pairs += asked
    if not homes:
        nearest_m = min(ranges_m)
        why = "no room has two"
        if np.isfinite(nearest_m):
            why = f"the nearest two are {nearest_m:.2g} m apart: give another --spacing"
        raise MissionError(
            f"expected two pictures of one room {low:g} to {high:g} m apart, found none among "
            f"{len(entries)}: {why}"
        )
    return homes


def _look(
    entries: Sequence[DatabaseEntry], height_m: float, tilt_deg: float, seed: int, k: int
) -> Snapshot:
    """The snapshot of a picture, tilted."""
    panorama = panorama_of(replace(entries[k], height_m=height_m))
    if not panorama.rig.closed:
        raise ImageError(f"{entries[k].file}: expected a panorama all around, got a view")
    axis_rad = generator(seed, "tilt", k).uniform(-np.pi, np.pi)
    return snapshot(tilted(panorama, np.radians(tilt_deg), axis_rad) if tilt_deg else panorama)


def _from(
    entries: Sequence[DatabaseEntry],
    look: Callable[[int], Snapshot],
    start: int,
    home: int,
    methods: Mapping[str, Method],
    compass_errors_deg: Sequence[float],
    seed: int,
) -> list[dict[str, object]]:
    """What every method says at a start, with each compass and without."""
    here, there = entries[start].pose, entries[home].pose
    offset_m = here.xy_m - there.xy_m
    error = generator(seed, "compass", start, home).normal()
    views = Views(look(start), look(home))
    rows: list[dict[str, object]] = []
    for name, method in methods.items():
        for error_deg in (None, *compass_errors_deg):
            told = None
            if error_deg is not None:
                turned_rad = there.yaw_rad - here.yaw_rad + error * np.radians(error_deg)
                told = float(wrap_angle_rad(turned_rad))
            row = name if error_deg is None else f"{name}{COMPASS} {error_deg:g}"
            vector = method(views, told)
            rows.append(
                {"home": home, "start": start, "x_m": float(offset_m[0]), "y_m": float(offset_m[1])}
                | {"range_m": float(np.hypot(*offset_m)), "method": row}
                | judged(vector, here.yaw_rad, offset_m)
            )
    return rows


def _with_returns(rows: pd.DataFrame, spacing_m: float | None) -> pd.DataFrame:
    """Rows of one home with ``returned``; a robot can stand where a picture is near."""
    if spacing_m is None:
        return rows.assign(returned=None)
    tree = cKDTree(rows[["x_m", "y_m"]].to_numpy())
    free: Free = lambda at: tree.query(at)[0] <= spacing_m  # noqa: E731
    range_m = rows.range_m[rows.range_m > 0].min()
    within_m = max(RETURNED_M, _CELL * float(range_m))
    for _, own in rows.groupby("method"):
        rows.loc[own.index, "returned"] = returned(own, free, Grid(spacing_m), within_m)
    return rows


def summarise(
    found: pd.DataFrame,
    spacing_m: tuple[float, float] = SPACING_M,
    position_error_m: float = 0.0,
) -> dict[str, dict[str, object]]:
    """The figures of each row's name; 95 % intervals under NAME_ci by bootstrap over homes.

    n_pairs; answered; median_deg, of answers; angular_error_deg, no answer counted as 90; the same
    within bands of the distance; within_1_std, within_2_std: shares of answers whose error is up to
    so many of the deviations stated; sure_wrong, answers more than 45 degrees off with a deviation
    below 20; false_arrivals; return_ratio. position_error_m: the deviation of each coordinate in
    the database; what that puts the true direction off is added to the deviations stated.
    """
    edges_m = np.linspace(*spacing_m, BANDS + 1)
    return {
        str(method): _summary(own, edges_m, position_error_m)
        for method, own in found.groupby("method", sort=False)
    }


def _summary(
    own: pd.DataFrame, edges_m: NDArray[np.float64], position_error_m: float
) -> dict[str, object]:
    told = Bootstrap(own.home, "homing database")
    answers = own[own.answered]
    std_deg = np.degrees(answers.std_rad)
    with_truth_deg = np.hypot(std_deg, np.degrees(np.sqrt(2) * position_error_m / answers.range_m))
    banded = own.error_deg.groupby(np.searchsorted(edges_m[1:-1], own.range_m)).mean()
    back = own.returned.dropna()
    return {
        "n_pairs": len(own),
        "answered": len(answers),
        "median_deg": or_none(answers.error_deg.median()),
        **told.mean("angular_error_deg", own.error_deg, own.home),
        **{
            f"error_{low:.2g}_{high:.2g}_m_deg": or_none(banded.get(k, np.nan))
            for k, (low, high) in enumerate(pairwise(edges_m))
        },
        "within_1_std": or_none((answers.error_deg <= 1 * with_truth_deg).mean()),
        "within_2_std": or_none((answers.error_deg <= 2 * with_truth_deg).mean()),
        "sure_wrong": int(((answers.error_deg > WRONG_DEG) & (std_deg < SURE_DEG)).sum()),
        "false_arrivals": int((own.arrived & (own.range_m > RETURNED_M)).sum()),
        "return_ratio": float(back.astype(float).mean()) if len(back) else None,
    }


def as_table(summary: Mapping[str, Mapping[str, object]]) -> pd.DataFrame:
    """The figures to read: one row a method, intervals in brackets."""
    first = next(iter(summary.values()))
    return table_of(summary, [n for n in first if not n.endswith("_ci")], "method", ".2f")

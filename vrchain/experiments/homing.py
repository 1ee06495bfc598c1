"""How well homing works from all around a place: angular error, return ratio and catchment.

*Starts.* The points of a 0.5 m grid, 0.5 to 5 m from a place, where a robot can stand; from each a
panorama, every one with a heading of its own. The angular error is that of the home vector there;
no answer counts as 90 degrees.

*Return.* From every start whose straight way home is free the robot goes on in steps of 0.1 m, each
along the home vector of the nearest point at which one is known, the grid's or near home those of a
finer one, 0.1 m up to 0.4 m away. Without an answer it keeps its course. It has returned when it
declares so, within 0.3 m in truth, before it has gone three times the distance; it fails where it
bumps into something, leaves the grid, declares elsewhere, or has no answer at the start. No method
steers around things, so that starts whose way is blocked would measure something else: they are
counted, and count for the angular error.

*Catchment.* The largest distance up to which 95 % of these starts return, the mean over places.

Places are uniform in free space, two in each suburb; what is found at one is saved as it ends, so
that a run broken off goes on with the next.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from vrchain.errors import MissionError
from vrchain.experiments.intervals import Bootstrap, table_of
from vrchain.experiments.kept import folder_of, kept_each
from vrchain.experiments.scenes import Scenes
from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.homing import METHODS, HomeVector, Views, maker_of, method_named, snapshot
from vrchain.panorama import CameraRig
from vrchain.seeding import generator
from vrchain.world.model import Scene
from vrchain.world.render import Renderer

Array = NDArray[np.float64]
Free = Callable[[Array], NDArray[np.bool_]]

PLACES_A_SUBURB = 2
RIG = CameraRig(n_views=8, width_px=320, height_px=240)  # homing needs no more, and it is quick
COMPASS = ", compass"  # ends the name of a row whose method is told the true heading
ROWS = tuple(name + compass for name in METHODS for compass in ("", COMPASS))
STEP_M = 0.1
RETURNED_M = 0.3
MOST_WAY = 3.0  # distances from the start
CATCHMENT_SHARE = 0.95
_MEASURED = ("course_rad", "error_deg", "std_rad", "remoteness")


@dataclass(frozen=True)
class Grid:
    """Where a place is homed to from. near_m: spacing of the finer grid, up to near_reach_m."""

    spacing_m: float = 0.5
    reach_m: float = 5.0
    near_m: float = 0.1
    near_reach_m: float = 0.4

    def points_m(self) -> Array:
        """Offsets from the place, (n, 2) float, those of the finer grid first."""
        near = _disc(self.near_m, 0.0, self.near_reach_m)
        return np.concatenate([near, _disc(self.spacing_m, self.spacing_m, self.reach_m)])


GRID = Grid()


def _disc(spacing_m: float, low_m: float, high_m: float) -> Array:
    """Points of a square grid, (n, 2), from low_m to high_m from its middle."""
    line = np.arange(-int(high_m / spacing_m + 1e-6), int(high_m / spacing_m + 1e-6) + 1)
    points = spacing_m * np.stack(np.meshgrid(line, line), axis=-1).reshape(-1, 2)
    range_m = np.hypot(*points.T)
    return np.asarray(points[(range_m >= low_m - 1e-6) & (range_m <= high_m + 1e-6)])


def draw_place(scene: Scene, draws: np.random.Generator) -> Pose:
    """A pose uniform in free space; MissionError if there is none."""
    half = np.array(scene.extent_m) / 2
    for _ in range(10_000):
        x_m, y_m, yaw_rad = map(float, (*draws.uniform(-half, half), draws.uniform(-np.pi, np.pi)))
        if scene.is_free([(x_m, y_m)]).all():
            return Pose(x_m, y_m, yaw_rad)
    raise MissionError(f"found no free place in {scene.name} to home to: choose another scene")


def answers(
    renderer: Renderer,
    home: Pose,
    draws: np.random.Generator,
    rows: Sequence[str] = ROWS,
    *,
    grid: Grid = GRID,
    rig: CameraRig = RIG,
) -> pd.DataFrame:
    """Home vectors from all around one place: ``evaluate``'s table but for suburb and place.

    draws: gives the headings.
    """
    scene, points = renderer.scene, grid.points_m()
    methods = {row: method_named(row.removesuffix(COMPASS)) for row in rows}
    then = snapshot(renderer.render(home, rig))
    yaws = draws.uniform(-np.pi, np.pi, len(points))
    free = scene.is_free(home.xy_m + points)
    found: list[dict[str, object]] = []
    for offset_m, yaw_rad in zip(points[free], yaws[free], strict=True):
        pose = Pose(*map(float, (*(home.xy_m + offset_m), yaw_rad)))
        steps = max(2, int(np.hypot(*offset_m) / STEP_M) + 2)
        way = home.xy_m + np.linspace(0, 1, steps)[:, None] * offset_m
        views = Views(snapshot(renderer.render(pose, rig)), then)
        heading_rad = float(wrap_angle_rad(home.yaw_rad - pose.yaw_rad))
        start = {
            "x_m": round(float(offset_m[0]), 3),
            "y_m": round(float(offset_m[1]), 3),
            "clear": bool(scene.is_free(way).all()),
        }
        for row in rows:
            vector = methods[row](views, heading_rad if row.endswith(COMPASS) else None)
            found.append({**start, "method": row, **judged(vector, pose.yaw_rad, offset_m)})
    table = pd.DataFrame(found)
    for row in rows:
        own = table.method == row
        home_from = returned(table[own], lambda at: scene.is_free(home.xy_m + at), grid)
        table.loc[own, "home"] = home_from
    return table.astype({"home": bool})


def judged(vector: HomeVector | None, yaw_rad: float, offset_m: Array) -> dict[str, object]:
    """What a home vector says, given at a heading and some metres from home."""
    if vector is None:
        return {"answered": False, "course_rad": np.nan, "error_deg": 90.0, "std_rad": np.nan,
                "arrived": False, "remoteness": np.nan, "n_matches": 0}  # fmt: skip
    course = float(wrap_angle_rad(yaw_rad + vector.bearing_rad))
    error = course - np.arctan2(-offset_m[1], -offset_m[0]) if offset_m.any() else 0.0
    return {
        "answered": True,
        "course_rad": course,
        "error_deg": float(np.degrees(abs(wrap_angle_rad(error)))),
        "std_rad": vector.std_rad,
        "arrived": vector.arrived,
        "remoteness": vector.remoteness,
        "n_matches": vector.n_matches,
    }


def evaluate(
    scenes: Scenes,
    n_places: int,
    rows: Sequence[str] = ROWS,
    *,
    seed: int,
    folder: Path,
    grid: Grid = GRID,
    rig: CameraRig = RIG,
    jobs: int | None = 1,
) -> pd.DataFrame:
    """Home vectors around ``n_places`` random places, one row a point and method.

    Columns: suburb, place, x_m, y_m (the point, from home), clear (the straight way home is free),
    method, answered, course_rad (of the home vector, in the world; NaN: no answer), error_deg,
    std_rad, arrived, remoteness, n_matches, home (whether it leads there from the point). What was
    found already under ``folder`` is read. jobs: see ``workers.each``.
    """
    rows = list(dict.fromkeys(rows))
    if n_places < 1:
        raise MissionError(f"expected 1 place or more to home to, got {n_places}")
    made_by = {row: maker_of(row.removesuffix(COMPASS)) for row in rows}
    own = folder_of(folder, scenes, made_by, seed, asdict(grid), asdict(rig))
    files = [own / f"place_{place:04d}.json" for place in range(n_places)]
    tables = kept_each(partial(_home_to, scenes, rows, seed, grid, rig), files, jobs, "places")
    _drawn_suburb.cache_clear()
    found: list[pd.DataFrame] = []
    for place, made in enumerate(tables):
        table = pd.DataFrame(made).astype(dict.fromkeys(_MEASURED, float))
        table.insert(0, "suburb", place // PLACES_A_SUBURB if scenes.varied else place)
        table.insert(1, "place", place)
        found.append(table)
    return pd.concat(found, ignore_index=True)


def _home_to(
    scenes: Scenes, rows: Sequence[str], seed: int, grid: Grid, rig: CameraRig, place: int
) -> list[dict[str, object]]:
    """Home vectors around one place, a row each."""
    k, number = divmod(place, PLACES_A_SUBURB)
    renderer = _drawn_suburb(scenes, seed, k if scenes.varied else 0)
    home = draw_place(renderer.scene, generator(seed, "home", k, number))
    draws = generator(seed, "homing", k, number)
    made = answers(renderer, home, draws, rows, grid=grid, rig=rig)
    found: list[dict[str, object]] = json.loads(made.to_json(orient="records", double_precision=15))
    return found


@lru_cache(maxsize=1)
def _drawn_suburb(scenes: Scenes, seed: int, k: int) -> Renderer:
    """The one at work."""
    return Renderer(scenes.scene(seed, k))


def returned(
    around: pd.DataFrame, free: Free, grid: Grid, within_m: float = RETURNED_M
) -> NDArray[np.bool_]:
    """From which points of one place and method, rows of ``answers``, it comes home: (n,) bool.

    The module says by what rules. free: where a robot can stand, offsets from home, (n, 2) -> (n,).
    """
    points_m = around[["x_m", "y_m"]].to_numpy(dtype=float)
    courses = around.course_rad.to_numpy(dtype=float)
    declares = around.arrived.to_numpy(dtype=bool)
    tree = cKDTree(points_m)
    at_m, course = points_m.copy(), np.full(len(points_m), np.nan)
    steps_left = (MOST_WAY * np.hypot(*points_m.T) / STEP_M + 1e-6).astype(int)
    home = np.zeros(len(points_m), dtype=bool)
    going = np.arange(len(points_m))
    while len(going):
        away_m, nearest = tree.query(at_m[going])
        inside = (away_m <= grid.spacing_m) & free(at_m[going])
        there = inside & declares[nearest]
        home[going[there]] = np.hypot(*at_m[going[there]].T) <= within_m + 1e-6
        told = courses[nearest]
        course[going] = np.where(np.isnan(told), course[going], told)
        going = going[inside & ~there & ~np.isnan(course[going]) & (steps_left[going] > 0)]
        at_m[going] += STEP_M * np.stack([np.cos(course[going]), np.sin(course[going])], axis=1)
        steps_left[going] -= 1
    return home


def starts(found: pd.DataFrame, grid: Grid = GRID) -> pd.DataFrame:
    """Rows of ``evaluate``'s table that are starts, with range_m, how far home is."""
    range_m = np.hypot(found.x_m, found.y_m)
    return found.assign(range_m=range_m)[range_m >= grid.spacing_m - 1e-6]


def summarise(found: pd.DataFrame, grid: Grid = GRID) -> dict[str, dict[str, object]]:
    """The figures of each method, with 95 % intervals under NAME_ci: bootstrap over suburbs.

    angular_error_deg, its median, no_answer, false_arrivals (taken for home): over n_starts;
    return_ratio: over the n_clear of them whose straight way is free; catchment_m: over those of
    the n_places that have such starts.
    """
    made = starts(found, grid)
    return {str(method): _summary(own) for method, own in made.groupby("method", sort=False)}


def _summary(made: pd.DataFrame) -> dict[str, object]:
    clear = made[made.clear]
    caught = [(k, _catchment_m(own)) for (k, _), own in clear.groupby(["suburb", "place"])]
    places = pd.DataFrame(caught, columns=["suburb", "catchment_m"])
    told = Bootstrap(made.suburb, "homing")
    return {
        "n_places": len(made[["suburb", "place"]].drop_duplicates()),
        "n_starts": len(made),
        "n_clear": len(clear),
        **told.mean("angular_error_deg", made.error_deg, made.suburb),
        **told.mean("return_ratio", clear.home, clear.suburb, 1.0),
        **told.mean("catchment_m", places.catchment_m, places.suburb),
        **told.mean("no_answer", ~made.answered, made.suburb, 1.0),
        **told.mean("false_arrivals", made.arrived, made.suburb, 1.0),
        "angular_error_deg_median": float(made.error_deg.median()),
    }


def _catchment_m(around: pd.DataFrame) -> float:
    """The largest distance up to which nearly all starts return; 0 if there is none."""
    ordered = around.sort_values("range_m", kind="stable")
    share = ordered.home.astype(float).expanding().mean().groupby(ordered.range_m).last()
    held = share.index[share >= CATCHMENT_SHARE]
    return float(held.max()) if len(held) else 0.0


def as_table(summary: Mapping[str, Mapping[str, object]]) -> pd.DataFrame:
    """The figures to read: one row a method, intervals in brackets."""
    names = (
        "n_places", "n_starts", "n_clear", "angular_error_deg", "return_ratio", "catchment_m",
        "no_answer", "false_arrivals",
    )  # fmt: skip
    return table_of(summary, names, "method")

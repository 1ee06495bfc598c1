"""Choosing the parameters of every homing method: as many trials of each, on the same places.

The first trial of a method is as it is, the others are drawn from ``VALUES``; the angular error
without compass chooses. Then as many values of what arrival is judged by are tried with the best,
and the return ratio chooses.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from tqdm.auto import tqdm

from vrchain.errors import MissionError
from vrchain.experiments.homing.evaluation import (
    PLACES_A_SUBURB,
    RIG,
    Free,
    Grid,
    Sight,
    answer_row,
    draw_place,
    free_around,
    returned,
    sights,
    starts,
)
from vrchain.experiments.scenes import Scenes
from vrchain.homing import METHODS, HomeVector
from vrchain.panorama import CameraRig
from vrchain.seeding import generator
from vrchain.world.render import Renderer

GRID = Grid(spacing_m=1.0)
_SWINGS_RAD = (0.15, 0.3, 0.5, 0.8, 1.2, 3.2)

VALUES: Mapping[str, Mapping[str, Sequence[Any]]] = {
    "epipolar": {
        "tolerance_rad": (0.002, 0.003, 0.004, 0.005, 0.007, 0.01),
        "min_inliers": (5, 6, 8, 10, 12),
    },
    "scale": {
        "least_change": (0.0, 0.03, 0.06, 0.1, 0.15, 0.2, 0.3),
        "most_swing_rad": _SWINGS_RAD,
        "apart": (False, True),
    },
    "average landmark vector": {
        "common": (True, False),
        "most_swing_rad": _SWINGS_RAD,
        "lowest_slope": (-0.5, -0.2, -0.1, -0.03, 0.0),
    },
    "warping": {
        "farthest": (0.1, 0.15, 0.25, 0.4, 0.6, 0.8),
        "lengths": (4, 8, 12),
        "smooth_rad": (0.0, 0.03, 0.06, 0.1, 0.2),
    },
}
ARRIVAL = {
    "epipolar": "arrived_m",
    "scale": "arrived_rad",
    "average landmark vector": "arrived_rad",
    "warping": "arrived_change",
}


def trials(
    scenes: Scenes,
    n_places: int,
    n_trials: int,
    *,
    seed: int,
    grid: Grid | None = None,
    rig: CameraRig | None = None,
    methods: Sequence[str] = tuple(METHODS),
) -> pd.DataFrame:
    """One row a trial: method, chosen_by, parameters (JSON), value (the figure that chooses).

    chosen_by: "angular_error_deg", and then "return_ratio" with the best parameters by that.
    """
    grid, rig = grid or GRID, rig or RIG
    if min(n_places, n_trials) < 1:
        raise MissionError(
            f"expected 1 place and 1 trial or more, got {n_places} and {n_trials}: ask for more"
        )
    around: list[tuple[list[Sight], Free]] = []
    for place in tqdm(range(n_places), desc="places", unit="", disable=None):
        k, number = divmod(place, PLACES_A_SUBURB)
        if number == 0:
            renderer = Renderer(scenes.scene(seed, k))
        home = draw_place(renderer.scene, generator(seed, "home", k, number))
        draws = generator(seed, "homing", k, number)
        seen = list(sights(renderer, home, draws, grid, rig))
        around.append((seen, free_around(renderer.scene, home)))
    rows: list[dict[str, object]] = []
    for method in methods:
        rows += _of_method(method, around, n_trials, seed, grid)
    return pd.DataFrame(rows)


def _of_method(
    method: str, around: list[tuple[list[Sight], Free]], n_trials: int, seed: int, grid: Grid
) -> list[dict[str, object]]:
    rows: list[dict[str, object]] = []
    best, least_error = METHODS[method], np.inf
    for number in tqdm(range(n_trials), desc=method, unit="", disable=None):
        draws = generator(seed, "homing trial", method, number)
        values = {name: v[int(draws.integers(len(v)))] for name, v in VALUES[method].items()}
        tried: Any = METHODS[method]
        if number > 0:
            tried = replace(tried, **values)
        errors = [
            float(str(answer_row(sight, method, tried(sight.views, None))["error_deg"]))
            for place, _ in around
            for sight in place
            if np.hypot(*sight.offset_m) >= grid.spacing_m - 1e-6
        ]
        error = float(np.mean(errors))
        if error < least_error:
            best, least_error = tried, error
        rows.append(_row(method, "angular_error_deg", tried, list(VALUES[method]), error))
    found = [[best(sight.views, None) for sight in place] for place, _ in around]
    seen = np.array([v.remoteness for vectors in found for v in vectors if v is not None])
    low, high = (max(float(np.quantile(seen, share)), 1e-4) for share in (0.005, 0.5))
    for value in np.geomspace(low, high, n_trials):
        most = float(f"{value:.2g}")
        tried = replace(best, **{ARRIVAL[method]: most})  # type: ignore[type-var]
        ended: list[bool] = []
        for (place, free), vectors in zip(around, found, strict=True):
            made = [
                answer_row(s, method, _judged(v, most)) for s, v in zip(place, vectors, strict=True)
            ]
            table = pd.DataFrame(made)
            table["home"] = returned(table, free, grid)
            ended += list(starts(table[table.clear], grid).home)
        ratio = float(np.mean(ended))
        rows.append(_row(method, "return_ratio", tried, [*VALUES[method], ARRIVAL[method]], ratio))
    return rows


def _judged(vector: HomeVector | None, most: float) -> HomeVector | None:
    """The same, arrival declared up to another remoteness."""
    return vector and replace(vector, arrived=vector.remoteness <= most)


def _row(
    method: str, chosen_by: str, tried: Any, names: Sequence[str], value: float
) -> dict[str, object]:
    parameters = json.dumps({name: getattr(tried, name) for name in names})
    return {"method": method, "chosen_by": chosen_by, "parameters": parameters, "value": value}


def best(table: pd.DataFrame, n: int = 5) -> pd.DataFrame:
    """The best trials of each method and each choice, the best first."""
    goodness = table.value.where(table.chosen_by == "return_ratio", -table.value)
    ordered = table.assign(goodness=goodness).sort_values(
        "goodness", ascending=False, kind="stable"
    )
    chosen = ordered.groupby(["method", "chosen_by"], sort=False).head(n)
    return chosen.sort_values(["method", "chosen_by"], kind="stable").drop(columns="goodness")

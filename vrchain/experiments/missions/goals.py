"""Is it the goal? Each goal, and every other house, looked at from six sides and from two ranges.

What arrival rests on: how much is seen of the goal, from how many sides it is sure, and whether
anything that is not the goal ever is.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, fields
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import shapely

from vrchain.errors import MissionError
from vrchain.experiments.intervals import Bootstrap, or_none, table_of
from vrchain.experiments.kept import folder_of, kept_each
from vrchain.experiments.scenes import Scenes, seed_of
from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.landmarks.extraction.record import maker_of
from vrchain.navigation.driving.estimates import Estimate
from vrchain.navigation.goal.candidates import EVEN, Candidate
from vrchain.navigation.goal.recognition import GoalSight, goal_from
from vrchain.navigation.perception import Look, learned_perception
from vrchain.navigation.settings import MissionConfig
from vrchain.panorama import CameraRig
from vrchain.seeding import generator
from vrchain.simulation.goals import (
    GOAL_PICTURES,
    goal_ids,
    goal_pictures,
    goal_poses,
    pictured_share,
)
from vrchain.simulation.simulator import Simulator
from vrchain.world.render import Renderer
from vrchain.world.truth import GroundTruth

SIDES, RANGES_M = 6, (11.0, 6.5)
_AZIMUTHS_RAD = np.arange(SIDES) * 2 * np.pi / SIDES
_MORE_SIDES = (0, 1, 2, 3)  # looked at besides the first
_WINDOW_RAD = 0.3  # around the middle of the house that is looked at
_STEP_M = 0.25
_NOTHING = GoalSight(0.0, 0.0, 0.0, 0.0, 0, 0.0, 0.0)  # where nothing is proposed


@dataclass(frozen=True, eq=False)
class _Seen:
    """A look at a house from one of its sides; shows: objects of which it shows a pixel or more."""

    house: int
    side: int
    range_m: float
    look: Look
    shows: frozenset[int]


def evaluate(
    scenes: Scenes, n_suburbs: int, n_goals: int, *, seed: int, folder: Path, jobs: int | None = 1
) -> pd.DataFrame:
    """One row a goal and look; what is under ``folder`` is read.

    n_goals: of each suburb, at most. Columns: suburb, goal, share (its own), house (that is looked
    at), own (whether it is the goal; else the look does not show the goal at all), side, from_m,
    and those of ``GoalSight``. A world that stays as it is is one suburb; its goals are numbered as
    suburbs are, so that intervals are over them. MissionError if nothing is asked for, or no goal
    is seen.
    """
    return by_suburb(_rows, scenes, n_suburbs, n_goals, seed, folder, jobs)


def by_suburb(
    find: Callable[[Scenes, int, int, int], list[dict]], scenes: Scenes, n_suburbs: int,
    n_goals: int, seed: int, folder: Path, jobs: int | None,
) -> pd.DataFrame:  # fmt: skip
    """What is found of so many goals, at most, of each suburb, and kept; see ``evaluate``."""
    if min(n_suburbs, n_goals) < 1:
        raise MissionError(f"expected 1 suburb and goal or more, got {n_suburbs} and {n_goals}")
    own = folder_of(folder, scenes, find.__module__, n_goals, seed, maker_of())
    files = [own / f"suburb_{k:02d}.json" for k in range(n_suburbs if scenes.varied else 1)]
    suburbs = kept_each(partial(find, scenes, seed, n_goals), files, jobs, "suburbs")
    rows = [{"suburb": k, **row} for k, suburb in enumerate(suburbs) for row in suburb]
    if not rows:
        raise MissionError("no goal can be pictured and seen here: take more suburbs or goals")
    found = pd.DataFrame(rows)
    return found if scenes.varied else found.assign(suburb=pd.factorize(found.goal)[0])


def summarise(found: pd.DataFrame) -> dict[str, dict]:
    """By "goal" and "another house": how many goals, houses and looks, and what is seen in them.

    likely: share of looks by which it may be the goal. keypoints: in the median, in 99 % of looks,
    and at most. sure, sure_1, sure_2, sure_3: of sides from which it is likely, the share from
    which it is sure, or is with so many sides more, one after the other; intervals: 95 %, over
    suburbs. houses_sure: of how many houses all looks together make sure.
    """
    config, summary = MissionConfig(), {}
    for name, looks in (("goal", found[found.own]), ("another house", found[~found.own])):
        houses = looks.groupby(["suburb", "goal", "house"])
        tried = pd.DataFrame([row for _, h in houses for row in _from_sides(h, config)])
        summary[name] = {
            "goals": len(looks.groupby(["suburb", "goal"])),
            "houses": len(houses),
            "looks": len(looks),
            "likely": or_none((looks.chance >= EVEN).mean()),
            **{
                f"keypoints_{part}": or_none(looks.n_matches.quantile(q))
                for part, q in (("median", 0.5), ("99", 0.99), ("most", 1.0))
            },
            "sides_likely": len(tried),
            **_shares(tried),
            "houses_sure": sum(_is_sure(_sights(h), h, config) for _, h in houses),
        }
    return summary


def as_table(summary: dict[str, dict]) -> pd.DataFrame:
    """The figures to read: one column a kind of house, intervals in brackets."""
    names = [n for n in summary["goal"] if not n.endswith("_ci")]
    return table_of(summary, names, "looked at", ".4g").T.rename_axis(columns=None)


def _shares(tried: pd.DataFrame) -> dict[str, object]:
    """sure, sure_1, ... and their intervals."""
    found: dict[str, object] = {}
    if len(tried):
        told = Bootstrap(tried.suburb, "goal sights")
        for name in map(_sure, _MORE_SIDES):
            found |= told.share(name, tried[name], tried.suburb, tried.house.nunique())
    return found


def _from_sides(house: pd.DataFrame, config: MissionConfig) -> list[dict[str, object]]:
    """From each side from which it is likely: whether it is sure, with 0, 1, ... sides more."""
    sights = [_sights(house[house.side == side]) for side in range(SIDES)]
    rows = []
    for side in range(SIDES):
        seen = list(sights[side])
        if max((s.chance for s in seen), default=0.0) < EVEN:
            continue
        suburb, name = house[["suburb", "house"]].iloc[0]
        row: dict[str, object] = {"suburb": suburb, "house": f"{suburb} {name}"}
        for n in _MORE_SIDES:
            if n:
                seen += sights[(side + n) % SIDES][-1:]
            row[_sure(n)] = row.get(_sure(n - 1), False) or _is_sure(seen, house, config)
        rows.append(row)
    return rows


def _sure(n: int) -> str:
    return f"sure_{n}" if n else "sure"


def _sights(rows: pd.DataFrame) -> list[GoalSight]:
    """Those from farther first."""
    ordered = rows.sort_values("from_m", ascending=False)[[f.name for f in fields(GoalSight)]]
    return [
        GoalSight(**{str(name): value for name, value in row.items()})
        for row in ordered.to_dict(orient="records")
    ]


def _is_sure(sights: Sequence[GoalSight], house: pd.DataFrame, config: MissionConfig) -> bool:
    """Whether arrival may be claimed by those of them that a robot would keep."""
    kept = [s for s in sights if s.chance >= config.least_chance]
    own = tuple((Pose(float(k), 0.0), s) for k, s in enumerate(kept))
    candidate = Candidate(Estimate(np.zeros(2), np.eye(2)), 0.0, own)
    return candidate.is_sure(config, float(house.share.iloc[0]))


def _rows(scenes: Scenes, seed: int, n_goals: int, k: int) -> list[dict]:
    scene, rig = scenes.scene(seed, k), CameraRig()
    renderer, truth = Renderer(scene), GroundTruth(scene)
    perception, draws = learned_perception(), generator(seed, "goal sights", k)
    looks: list[_Seen] = []
    houses = goal_ids(scene, None)
    for house in houses:
        footprint = scene.objects[house].footprint
        centre = np.array(footprint.centroid.coords[0])
        for side, azimuth in enumerate(draws.uniform(-np.pi, np.pi) + _AZIMUTHS_RAD):
            ray = centre + np.outer(np.arange(0, 80, _STEP_M), [np.cos(azimuth), np.sin(azimuth)])
            off_m = shapely.distance(footprint, shapely.points(ray))
            for range_m in RANGES_M:
                xy_m = ray[np.argmax(off_m >= range_m)]
                towards_rad = float(wrap_angle_rad(azimuth + np.pi))
                pose = Pose(float(xy_m[0]), float(xy_m[1]), towards_rad)
                if scene.is_free([pose.xy_m])[0] and truth.sees(house, pose, rig):
                    simulator = Simulator(scene, {"R1": pose}, seed=seed, rig=rig)
                    simulator.truth, simulator.renderer = truth, renderer
                    look = perception.examine(simulator.observe("R1", towards_rad=0.0))
                    shows = frozenset(truth.visibility(pose, rig).index)
                    looks.append(_Seen(house, side, range_m, look, shows))
    rows: list[dict] = []
    pictured = 0
    for goal in map(int, draws.permutation(houses)):
        if pictured == n_goals:
            break
        poses = goal_poses(scene, truth, goal, seed_of(seed, k))
        if len(poses) < GOAL_PICTURES:
            continue
        pictured += 1
        name = scene.objects[goal].name
        pictures = goal_pictures(scene, renderer, name, poses, rig)
        known = goal_from(pictures, share=pictured_share(scene, name, poses))
        for seen in looks:
            if seen.house == goal or goal not in seen.shows:
                rows.append(
                    {
                        "goal": name,
                        "share": known.share,
                        "house": scene.objects[seen.house].name,
                        "own": seen.house == goal,
                        "side": seen.side,
                        "from_m": seen.range_m,
                        **asdict(known.find(seen.look, 0.0, _WINDOW_RAD) or _NOTHING),
                    }
                )
    return rows

"""Who sees my goal? One goal looked up in hundreds of panoramas, beside matching them all by SIFT.

Every goal is looked up twice: where some panoramas show it, and, those left out, where none does.
"""

from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from time import perf_counter

import numpy as np
import pandas as pd
from tqdm.auto import tqdm

from vrchain.errors import MissionError
from vrchain.experiments.intervals import ratio, resampled, share
from vrchain.experiments.kept import folder_of, kept_each
from vrchain.experiments.landmarks.pairs import draw_poses
from vrchain.experiments.scenes import Scenes, seed_of
from vrchain.geometry import Pose
from vrchain.landmarks.extraction.record import (
    LandmarkRecord,
    decode_record,
    encode_record,
    examine,
    maker_of,
)
from vrchain.landmarks.extraction.sift import Features, extract
from vrchain.landmarks.retrieval.gallery import gallery_of, named, who_sees
from vrchain.landmarks.retrieval.query import query_of
from vrchain.landmarks.retrieval.template import find_goal, goal_of
from vrchain.panorama import CameraRig, Panorama
from vrchain.seeding import generator
from vrchain.simulation.goals import GOAL_PICTURES, goal_ids, goal_pictures, goal_poses
from vrchain.world.render import Renderer
from vrchain.world.truth import GroundTruth

WAYS = ("gallery", "sift")


@dataclass(frozen=True)
class SearchConfig:
    """panoramas, goals: of each scene; by_sift: how many goals are looked up by SIFT as well."""

    panoramas: int = 500
    goals: int = 20
    by_sift: int = 2


def evaluate(
    scenes: Scenes, n_scenes: int, config: SearchConfig, *, seed: int, folder: Path
) -> pd.DataFrame:
    """One row a goal and way to look it up; what was found already under ``folder`` is read.

    Columns: scene, goal, way, showing (panoramas that show it), present (whether they were left
    in), answered, right (the first answer shows it; or, they being left out, there is no answer),
    found (panoramas answered that show it), s. A world that stays as it is is one scene.
    MissionError if nothing is asked for, or no goal is seen.
    """
    if min(config.panoramas, config.goals, n_scenes) < 1:
        raise MissionError(f"expected 1 panorama, goal and scene or more, got {config}")
    own = folder_of(folder, scenes, asdict(config), seed, maker_of())
    files = [own / f"scene_{k:02d}.json" for k in range(n_scenes if scenes.varied else 1)]
    found = kept_each(partial(_search_in, scenes, config, seed), files, 1, "scenes")
    rows = [{**row, "scene": k} for k, scene in enumerate(found) for row in scene]
    if not rows:
        raise MissionError("no panorama shows a goal that can be pictured: ask for more panoramas")
    return pd.DataFrame(rows)


def summarise(found: pd.DataFrame) -> dict[str, dict]:
    """By way: first_right, nobody_right, precision and recall, ms a goal, and how many goals.

    precision and recall: of the panoramas answered; precision is None where none was. Intervals:
    95 %, bootstrap over goals. "side by side": how many times faster than SIFT, and recall of both,
    of the goals that SIFT looked up as well.
    """
    summary = {}
    for way in WAYS:
        own = found[found.way == way]
        if own.empty:
            continue
        there, gone = own[own.present], own[~own.present]
        again, n_goals = resampled(len(there), 0, "search"), np.ones(len(there))
        counts = there[["found", "answered", "showing"]].to_numpy(dtype=float).T
        found_in, answered, showing = counts
        summary[way] = {
            "n": len(there),
            **share("first_right", there.right.to_numpy(dtype=float), n_goals, again),
            **share("nobody_right", gone.right.to_numpy(dtype=float), n_goals, again),
            **ratio("precision", found_in, answered, again, 1.0),
            **ratio("recall", found_in, showing, again, 1.0),
            "ms_per_goal": float(own.s.median() * 1e3),
        }
    both = found[found.groupby(["scene", "goal"]).way.transform("nunique") == len(WAYS)]
    if len(both):
        seconds = both.groupby("way").s.median()
        there = both[both.present]
        recall = there.groupby("way").found.sum() / there.groupby("way").showing.sum()
        summary["side by side"] = {
            "n": len(there) // len(WAYS),
            "times_faster": float(seconds["sift"] / seconds["gallery"]),
            "recall_gallery": float(recall["gallery"]),
            "recall_sift": float(recall["sift"]),
        }
    return summary


def as_text(summary: dict[str, dict]) -> str:
    """The figures to read, one a line below the name of their way."""
    lines: list[str] = []
    for way, figures in summary.items():
        lines += [way, *(f"  {name}: {_rounded(value)}" for name, value in figures.items())]
    return "\n".join(lines)


def _rounded(value: float | list[float] | None) -> float | list[float] | str:
    if isinstance(value, list):
        return [round(v, 3) for v in value]
    return "-" if value is None else round(value, 3)


@dataclass(frozen=True, eq=False)
class _Taken:
    """A panorama taken: its record, all its keypoints, and the objects it shows.

    hints: objects of which it shows a pixel or more.
    """

    record: LandmarkRecord
    features: Features
    shows: frozenset[int]
    hints: frozenset[int]


def _search_in(scenes: Scenes, config: SearchConfig, seed: int, k: int) -> list[dict[str, object]]:
    scene, rig = scenes.scene(seed, k), CameraRig()
    renderer, truth = Renderer(scene), GroundTruth(scene)
    draws = generator(seed, "search", k)
    poses = draw_poses(scene, config.panoramas, draws)
    taken = [
        _take(renderer.render(pose, rig), truth, pose)
        for pose in tqdm(poses, desc="panoramas", disable=None)
    ]
    rows: list[dict[str, object]] = []
    looked_up = 0
    for goal in map(int, draws.permutation(goal_ids(scene, None))):
        if looked_up == config.goals:
            break
        showing = {n for n, t in enumerate(taken) if goal in t.shows}
        pictured = goal_poses(scene, truth, goal, seed_of(seed, k))
        if not showing or len(pictured) < GOAL_PICTURES:
            continue
        name = scene.objects[goal].name
        pictures = goal_pictures(scene, renderer, name, pictured, rig)
        ways = {"gallery": _by_gallery, "sift": _by_sift}
        if looked_up >= config.by_sift:
            del ways["sift"]
        for present in (True, False):
            among = {n: t for n, t in enumerate(taken) if present or goal not in t.hints}
            for way, look_up in ways.items():
                start = perf_counter()
                answers = look_up(among, pictures)
                seconds = perf_counter() - start
                right = answers[:1] and answers[0] in showing if present else not answers
                rows.append(
                    {
                        "goal": name,
                        "way": way,
                        "showing": len(showing),
                        "present": present,
                        "answered": len(answers),
                        "right": bool(right),
                        "found": len(showing & set(answers)),
                        "s": seconds,
                    }
                )
        looked_up += 1
    return rows


def _take(panorama: Panorama, truth: GroundTruth, pose: Pose) -> _Taken:
    features = extract(panorama)
    seen = truth.visibility(pose, panorama.rig)
    record = decode_record(encode_record(examine(panorama, features=features)))  # as published
    return _Taken(
        record, features, frozenset(seen.index[seen.visible]), frozenset(seen.index)
    )  # fmt: skip


def _by_gallery(among: dict[int, _Taken], pictures: list[Panorama]) -> list[int]:
    what = query_of([examine(p) for p in pictures])
    gallery = gallery_of({n: t.record for n, t in among.items()})
    return named(who_sees(what, gallery))


def _by_sift(among: dict[int, _Taken], pictures: list[Panorama]) -> list[int]:
    goal, found = goal_of(pictures), []
    for n, taken in among.items():
        sighting = find_goal(goal, taken.features)
        if sighting is not None:
            found.append((-sighting.n_matches, n))
    return [n for _, n in sorted(found)]

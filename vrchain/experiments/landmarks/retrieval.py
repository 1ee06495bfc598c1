"""Who sees my goal? One goal looked up in hundreds of panoramas, beside matching them all by SIFT.

Every goal is looked up twice: where some panoramas show it, and, those left out, where none does.
"""

import json
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from time import perf_counter

import numpy as np
import pandas as pd
from tqdm.auto import tqdm

from vrchain.errors import MissionError
from vrchain.experiments.intervals import ratio, resampled, share
from vrchain.experiments.landmarks.pairs import draw_poses
from vrchain.experiments.scenes import Scenes
from vrchain.files import code_digest, name_of, write_file
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
from vrchain.landmarks.retrieval.lookup import sought
from vrchain.landmarks.retrieval.recognition import find_goal, goal_of
from vrchain.panorama import CameraRig, Panorama
from vrchain.seeding import generator
from vrchain.simulation.task import GOAL_PICTURES, goal_ids, goal_pictures, goal_poses
from vrchain.world.model import Scene
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
    asked = [code_digest(), scenes.digest, asdict(config), seed, maker_of()]
    own = folder / name_of(asked)
    tables = []
    for k in range(n_scenes if scenes.varied else 1):
        file = own / f"scene_{k:02d}.json"
        if not file.exists():
            found = _search_in(scenes.scene(seed, k), config, seed, k)
            write_file(file, found.to_json(orient="records").encode())
        rows = json.loads(file.read_text())
        tables += [pd.DataFrame(rows).assign(scene=k)] if rows else []
    if not tables:
        raise MissionError("no panorama shows a goal that can be pictured: ask for more panoramas")
    return pd.concat(tables, ignore_index=True)


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
        summary[way] = {
            "n": len(there),
            **_right("first_right", there.right),
            **_right("nobody_right", gone.right),
            **_over("precision", there.found, there.answered),
            **_over("recall", there.found, there.showing),
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


def _over(name: str, part: pd.Series, whole: pd.Series) -> dict[str, object]:
    """NAME and NAME_ci: panoramas over panoramas, a value a goal; None: of nothing."""
    top, bottom = part.to_numpy(dtype=float), whole.to_numpy(dtype=float)
    return ratio(name, top, bottom, resampled(len(top), 0, "search"))


def _right(name: str, right: pd.Series) -> dict[str, object]:
    """NAME and NAME_ci: of goals, the share whose answer is right."""
    hits = right.to_numpy(dtype=float)
    return share(name, hits, np.ones(len(hits)), resampled(len(hits), 0, "search"))


@dataclass(frozen=True, eq=False)
class _Taken:
    """A panorama taken: its record, all its keypoints, and the objects it shows.

    hints: objects of which it shows a pixel or more.
    """

    record: LandmarkRecord
    features: Features
    shows: frozenset[int]
    hints: frozenset[int]


def _search_in(scene: Scene, config: SearchConfig, seed: int, k: int) -> pd.DataFrame:
    renderer, truth, rig = Renderer(scene), GroundTruth(scene), CameraRig()
    draws = generator(seed, "search", k)
    poses = draw_poses(scene, config.panoramas, draws)
    taken = [
        _take(renderer.render(pose, rig), truth, pose)
        for pose in tqdm(poses, desc="panoramas", disable=None)
    ]
    rows: list[dict] = []
    looked_up = 0
    for goal in map(int, draws.permutation(goal_ids(scene, None))):
        showing = {n for n, t in enumerate(taken) if goal in t.shows}
        pictured = goal_poses(scene, truth, goal, seed)
        if not showing or len(pictured) < GOAL_PICTURES:
            continue
        name = scene.objects[goal].name
        pictures = goal_pictures(scene, renderer, name, pictured, rig)
        ways = {"gallery": _by_gallery}
        if looked_up < config.by_sift:
            ways["sift"] = _by_sift
        for present in (True, False):
            among = [n for n, t in enumerate(taken) if present or goal not in t.hints]
            for way, look_up in ways.items():
                answer = partial(look_up, {n: taken[n] for n in among})
                start = perf_counter()
                answers = answer(pictures)
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
        if looked_up == config.goals:
            break
    return pd.DataFrame(rows)


def _take(panorama: Panorama, truth: GroundTruth, pose: Pose) -> _Taken:
    features = extract(panorama)
    seen = truth.visibility(pose, panorama.rig)
    record = decode_record(encode_record(examine(panorama, features=features)))  # as published
    return _Taken(
        record, features, frozenset(seen.index[seen.visible]), frozenset(seen.index)
    )  # fmt: skip


def _by_gallery(among: dict[int, _Taken], pictures: list[Panorama]) -> list[int]:
    what = sought([examine(p) for p in pictures])
    gallery = gallery_of({n: t.record for n, t in among.items()})
    return named(who_sees(what, gallery))


def _by_sift(among: dict[int, _Taken], pictures: list[Panorama]) -> list[int]:
    goal, found = goal_of(pictures), []
    for n, taken in among.items():
        sighting = find_goal(goal, taken.features)
        if sighting is not None:
            found.append((-sighting.n_matches, n))
    return [n for _, n in sorted(found)]

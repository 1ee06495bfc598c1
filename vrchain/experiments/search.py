"""Who sees my goal? One goal looked up in hundreds of panoramas, beside matching them all by SIFT.

Every goal is looked up twice: where some panoramas show it, and, those left out, where none does.
"""

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter

import numpy as np
import pandas as pd
from tqdm.auto import tqdm

from vrchain.errors import MissionError
from vrchain.experiments.scenes import Scenes
from vrchain.experiments.team import GOAL_PICTURES, goal_ids, goal_pictures, goal_poses
from vrchain.files import write_file
from vrchain.geometry import Pose
from vrchain.landmarks.gallery import gallery_of, sought, who_sees
from vrchain.landmarks.recognition import find_goal, goal_of
from vrchain.landmarks.record import LandmarkRecord, decode_record, encode_record, examine, maker_of
from vrchain.landmarks.sift import Features, extract
from vrchain.panorama import CameraRig, Panorama
from vrchain.render import Renderer
from vrchain.scene.model import Scene
from vrchain.seeding import generator
from vrchain.truth import GroundTruth

FORMAT = 1
_TRIES = 1000


@dataclass(frozen=True)
class SearchConfig:
    """panoramas, goals: of each scene; by_sift: how many goals are looked up by SIFT as well."""

    panoramas: int = 500
    goals: int = 20
    by_sift: int = 2


def search(
    scenes: Scenes, config: SearchConfig, n_scenes: int, *, seed: int, folder: Path
) -> pd.DataFrame:
    """One row a goal and way to look it up; what was found already under ``folder`` is read.

    Columns: scene, goal, way, showing (panoramas that show it), present (whether they were left
    in), answered, right (the first answer shows it), found (panoramas answered that show it), s.
    """
    if min(config.panoramas, config.goals, n_scenes) < 1:
        raise MissionError(f"expected 1 panorama, goal and scene or more, got {config}")
    asked = [FORMAT, scenes.digest, asdict(config), seed, maker_of()]
    own = folder / hashlib.sha256(json.dumps(asked, sort_keys=True).encode()).hexdigest()[:12]
    tables = []
    for k in range(n_scenes):
        file = own / f"scene_{k:02d}.json"
        if not file.exists():
            found = _search_in(scenes.scene(seed, k), config, seed, k)
            write_file(file, found.to_json(orient="records").encode())
        tables.append(pd.DataFrame(json.loads(file.read_text())).assign(scene=k))
    return pd.concat(tables, ignore_index=True)


@dataclass(frozen=True, eq=False)
class _Taken:
    """A panorama taken: its record, all keypoints where wanted, and the objects it shows.

    hints: objects of which it shows a pixel or more.
    """

    record: LandmarkRecord
    features: Features | None
    shows: frozenset[int]
    hints: frozenset[int]


def _search_in(scene: Scene, config: SearchConfig, seed: int, k: int) -> pd.DataFrame:
    renderer, truth, rig = Renderer(scene), GroundTruth(scene), CameraRig()
    draws = generator(seed, "search", k)
    taken = []
    for pose in tqdm(_places(scene, config.panoramas, draws), desc="panoramas", disable=None):
        taken.append(_take(renderer.render(pose, rig), truth, pose, config.by_sift > 0))
    goals = draws.permutation(goal_ids(scene, None))
    rows: list[dict] = []
    looked_up = 0
    for goal in map(int, goals):
        showing = [n for n, t in enumerate(taken) if goal in t.shows]
        poses = goal_poses(scene, truth, goal, seed)
        if not showing or len(poses) < GOAL_PICTURES:
            continue
        pictures = goal_pictures(scene, renderer, scene.objects[goal].name, poses, rig)
        without = [n for n, t in enumerate(taken) if goal not in t.hints]
        for present, among in ((True, range(len(taken))), (False, without)):
            ways = [("gallery", _by_gallery)]
            if looked_up < config.by_sift:
                ways.append(("sift", _by_sift))
            for way, look_up in ways:
                start = perf_counter()
                answers = look_up(pictures, taken, list(among))
                rows.append(
                    {
                        "goal": scene.objects[goal].name,
                        "way": way,
                        "showing": len(showing),
                        "present": present,
                        "answered": len(answers),
                        "right": bool(answers) and answers[0] in showing,
                        "found": len(set(answers) & set(showing)),
                        "s": perf_counter() - start,
                    }
                )
        looked_up += 1
        if looked_up == config.goals:
            break
    return pd.DataFrame(rows)


def _places(scene: Scene, n: int, draws: np.random.Generator) -> list[Pose]:
    """Free poses, uniform."""
    half, found = np.array(scene.extent_m) / 2, list[Pose]()
    for _ in range(_TRIES * n):
        place = draws.uniform(-half, half)
        if scene.is_free([place]).all():
            found.append(Pose(*map(float, (*place, draws.uniform(-np.pi, np.pi)))))
        if len(found) == n:
            return found
    raise MissionError(f"found only {len(found)} of {n} free places in {scene.name!r}")


def _take(panorama: Panorama, truth: GroundTruth, pose: Pose, whole: bool) -> _Taken:
    features = extract(panorama)
    seen = truth.visibility(pose, panorama.rig)
    record = decode_record(encode_record(examine(panorama, features=features)))  # as published
    return _Taken(
        record, features if whole else None, frozenset(seen.index[seen.visible]),
        frozenset(seen.index),
    )  # fmt: skip


def _by_gallery(pictures: list[Panorama], taken: list[_Taken], among: list[int]) -> list[int]:
    what = sought([examine(p) for p in pictures])
    gallery = gallery_of({n: taken[n].record for n in among})
    return [seen.key for seen in who_sees(what, gallery)]


def _by_sift(pictures: list[Panorama], taken: list[_Taken], among: list[int]) -> list[int]:
    goal, found = goal_of(pictures), []
    for n in among:
        features = taken[n].features
        assert features is not None
        sighting = find_goal(goal, features)
        if sighting is not None:
            found.append((-sighting.n_matches, n))
    return [n for _, n in sorted(found)]

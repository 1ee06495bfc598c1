import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import worlds

from vrchain.experiments.landmarks import degraded
from vrchain.experiments.landmarks.degradations import tilted, unchanged
from vrchain.experiments.landmarks.degraded import WAYS, Way, as_text, evaluate_ways
from vrchain.experiments.landmarks.precision import Second, _upright
from vrchain.experiments.scenes import Scenes
from vrchain.geometry import Pose
from vrchain.landmarks.extraction.sift import extract, mutual_matches
from vrchain.landmarks.matching.common import CommonLandmark, Comparison, Region
from vrchain.landmarks.matching.variants import at_half_resolution, sift
from vrchain.landmarks.quality import judge
from vrchain.panorama import Panorama
from vrchain.world import Scene
from vrchain.world.render import Renderer
from vrchain.world.truth import GroundTruth


def blackened(panorama: Panorama, draws: np.random.Generator) -> Panorama:
    return replace(panorama, views=np.zeros_like(panorama.views))


def test_ways_are_told_apart_on_the_same_pairs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing done changes nothing, black claims nothing, and rigs that differ are refused.

    A scene is built once for all ways.
    """
    built: list[int] = []

    def yard(seed: int, k: int) -> Scene:
        built.append(k)
        return worlds.yard()

    ways = [
        Way("none"),
        Way("nothing done", Second("nothing done", unchanged)),
        Way("black", Second("black", blackened)),
        Way("half", both=at_half_resolution),
        Way("low", height_m=0.5),
        Way("higher", Second("higher", rise_m=0.5)),
    ]
    asked = {"seed": 3000, "folder": tmp_path, "rig": worlds.SMALL_RIG, "ways": ways}
    scenes = Scenes(yard, "yard")
    table = evaluate_ways(scenes, 3, (1.0, 2.0), [sift()], **asked)
    assert built == [0]
    rows = table.set_index("way")
    figures = ["n_pairs", *degraded.FIGURES]
    assert rows.loc["none", figures].tolist() == rows.loc["nothing done", figures].tolist()
    assert rows.recall["none"] > 0
    assert (rows.recall["black"], rows.precision["black"]) == (0.0, None)
    assert rows.recall["half"] < rows.recall["none"] != rows.recall["low"]
    assert rows.refused.tolist() == [False] * 5 + [True]
    assert set(rows.variant) == {"sift"}
    assert rows.loc["higher", figures].tolist() == [0, None, None, None, None]
    json.dumps(table.to_dict(orient="records"), allow_nan=False)
    assert as_text(table).count("refused") == 5
    assert evaluate_ways(scenes, 3, (1.0, 2.0), [sift()], **asked).equals(table)
    monkeypatch.setattr(degraded, "check_comparable", lambda a, b: None)
    higher = evaluate_ways(scenes, 3, (1.0, 2.0), [sift()], **asked).iloc[-1]
    assert (higher.refused, higher.n_pairs) == (False, 3)


def test_every_way_has_a_name_of_its_own() -> None:
    names = [way.name for way in WAYS]
    seconds = [way.second.name for way in WAYS if way.second is not degraded.AS_DRAWN]
    assert len({*names}) == len(names) and len({*seconds}) == len(seconds)


def test_what_a_tilted_camera_sees_is_judged_where_it_is() -> None:
    scene = worlds.yard()
    truth, poses = GroundTruth(scene), (Pose(-2.0, 0.0, 0.3), Pose(-2.0, 1.5, -0.4))
    a, b = (Renderer(scene).render(pose, worlds.SMALL_RIG) for pose in poses)
    tilt_rad = np.radians(6.0) * np.array([np.cos(0.7), np.sin(0.7)])
    features = extract(a), extract(tilted(b, np.radians(6.0), 0.7))
    i, j = mutual_matches(features[0].descriptors, features[1].descriptors, 0.7)
    whole = Region(0, (0.0, 0.0, 1.0, 1.0), 0.0, 0.1)
    claims = tuple(CommonLandmark(1.0, whole, whole, i[[k]], j[[k]]) for k in range(len(i)))
    found = Comparison(claims, None)
    as_seen = judge(found, truth, poses, features, worlds.SMALL_RIG)
    righted = judge(*_as_upright(found, features, tilt_rad, truth, poses))
    assert len(i) > 20
    assert np.mean([v.right for v in righted]) > np.mean([v.right for v in as_seen]) + 0.1
    masked = replace(found, common=tuple(
        replace(c, mask_b=features[1].take(c.support_b).directions) for c in claims
    ))  # fmt: skip
    again = judge(*_as_upright(masked, features, tilt_rad, truth, poses))
    assert [v.right for v in again] == [v.right for v in righted]


def _as_upright(
    found: Comparison, features: Any, tilt_rad: np.ndarray, truth: GroundTruth, poses: Any
) -> Any:
    righted, seen = _upright(found, features, tilt_rad)
    return righted, truth, poses, seen, worlds.SMALL_RIG

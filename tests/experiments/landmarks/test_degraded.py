import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import worlds

from vrchain.experiments.landmarks import degraded
from vrchain.experiments.landmarks.degradations import unchanged
from vrchain.experiments.landmarks.degraded import WAYS, Way, as_text, evaluate_ways
from vrchain.experiments.landmarks.precision import Second
from vrchain.experiments.scenes import Scenes
from vrchain.landmarks.matching.variants import at_half_resolution, sift
from vrchain.panorama import Panorama
from vrchain.world import Scene


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

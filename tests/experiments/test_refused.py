"""What cannot be measured is refused, and said plainly, before a scene is built or a file made."""

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from worlds import SMALL_RIG

from vrchain.errors import MissionError
from vrchain.experiments import homing
from vrchain.experiments.landmarks import precision, retrieval
from vrchain.experiments.landmarks.over_distance import over_distance
from vrchain.experiments.landmarks.precision import row
from vrchain.experiments.landmarks.strangers import strangers
from vrchain.experiments.missions import goals, success
from vrchain.experiments.missions.drive import Conditions
from vrchain.experiments.planning.lost_segments import blocked_drives
from vrchain.experiments.planning.published_drives import one_drive
from vrchain.experiments.planning.speed import bench_planner
from vrchain.experiments.rendering import bench_render
from vrchain.experiments.scenes import Scenes
from vrchain.world.model import Scene


def unbuilt(seed: int, k: int) -> Scene:
    raise AssertionError("refused before a scene is built")


MANY, WORLD = Scenes(unbuilt, "many"), Scenes(unbuilt, "world", varied=False)
TWICE, BAND_M = [row("sift"), row("sift")], (1.0, 2.0)


def landmarks(n_pairs: int, *spacing_m: float, rows: list = TWICE[:1]) -> Callable[..., object]:
    return partial(precision.evaluate, MANY, n_pairs, spacing_m, rows)


def missions(n: int = 1, robots: int = 4, arms: tuple = ("oracle",), **asked: Any) -> Callable:
    def evaluate(**usual: Any) -> object:
        conditions = Conditions(**asked.pop("conditions", {}))
        return success.evaluate(MANY, n, robots, arms, conditions=conditions, **asked, **usual)

    return evaluate


@pytest.mark.parametrize(
    ("evaluate", "refusal"),
    [
        (landmarks(0, 1.0, 2.0), "1 pair or more"),
        (landmarks(1, 3.0, 2.0), "MIN <= MAX"),
        (landmarks(1, 0.0, 2.0), "0 < MIN"),
        (landmarks(1, 1.0, 2.0, rows=TWICE), "variants of different names, got sift, sift"),
        (partial(over_distance, MANY, 1, [(3.0, 2.0)], rig=SMALL_RIG), "MIN <= MAX"),
        (partial(strangers, MANY, 1, TWICE), "variants of different names"),
        (partial(strangers, MANY, 0, TWICE), "1 pair or more, got 0"),
        (partial(strangers, WORLD, 4, TWICE), "expected the spec of a suburb"),
        (partial(retrieval.evaluate, MANY, 1, retrieval.SearchConfig(0)), "1 panorama, goal and"),
        (partial(retrieval.evaluate, MANY, 1, retrieval.SearchConfig(1, 0)), "1 panorama, goal"),
        (partial(homing.evaluate, MANY, 0), "1 place or more to home to, got 0"),
        (
            partial(homing.evaluate, MANY, 1, ["snapshot"]),
            "method 'snapshot': there are epipolar, s",
        ),
        (partial(goals.evaluate, MANY, 1, 0), "1 suburb and goal or more, got 1 and 0"),
        (missions(0), "expected 1 mission or more"),
        (missions(arms=("magic",)), "and arms of ledger, alone, oracle, got 1 and magic"),
        (missions(arms=()), "and arms of ledger, alone, oracle, got 1 and "),
        (missions(robots=1), "expected 2 to 20 robots, got 1"),
        (missions(landmarks=-1), "chains of 0 landmarks or more, got -1"),
        (missions(conditions={"wrong_edges": 1.1}), "wrong edges from 0 to 1, got 1.1"),
        (missions(conditions={"barred": float("nan")}), "barred legs from 0 to 1, got nan"),
        (missions(conditions={"patrol_s": -1.0}), "seconds of patrol, 0 or more, got -1.0"),
    ],
)
def test_what_cannot_be_asked(
    evaluate: Callable[..., object], refusal: str, tmp_path: Path
) -> None:
    with pytest.raises(MissionError, match=refusal):
        evaluate(seed=3000, folder=tmp_path)
    assert not any(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("measure", "refusal"),
    [
        (partial(blocked_drives, 0, 5), "expected 1 world and task or more"),
        (partial(blocked_drives, 5, 0), "expected 1 world and task or more"),
        (partial(one_drive, 0, 5), "expected 1 world and task or more"),
        (partial(one_drive, 5, 0), "expected 1 world and task or more"),
        (partial(bench_planner, 0), "1 task or more"),
        (partial(bench_render, "none.yaml", 0), "1 position or more"),
    ],
)
def test_nothing_to_measure(measure: Callable[..., object], refusal: str) -> None:
    with pytest.raises(MissionError, match=refusal):
        measure(seed=3000)

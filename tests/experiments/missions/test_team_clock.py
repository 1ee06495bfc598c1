"""A whole team at once: what it has to do, and what is told of how it did."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from blind import Nowhere, blind
from hamlet import the_hamlet
from sights import RIG

from vrchain import reader
from vrchain.errors import MissionError
from vrchain.experiments.missions import draw as drawing
from vrchain.experiments.missions import team_clock
from vrchain.experiments.missions.draw import Ground
from vrchain.experiments.missions.team_clock import as_table, draw, evaluate, summarise
from vrchain.experiments.scenes import Scenes
from vrchain.world.truth import GroundTruth

HAMLET = Scenes(the_hamlet, "hamlet", varied=False)


@pytest.fixture(autouse=True)
def _short_ways(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(drawing, "WAY_M", (8.0, 60.0))


def test_every_robot_has_a_goal_of_its_own_that_it_does_not_see() -> None:
    scene = the_hamlet(3, 0)
    truth = GroundTruth(scene)
    ground = Ground(scene, truth, RIG)
    errands, again = (draw(ground, 3, 0, 1, 3) for _ in range(2))
    assert errands == again and set(errands) == {"R1", "R2", "R3"}
    assert len({e.goal for e in errands.values()}) == 3
    for errand in errands.values():
        target = scene.index_of(errand.goal)
        assert len(truth.visibility(errand.pose, RIG, of=target)) == 0
        assert len(errand.goal_poses) == 4 and errand.way_m >= 8.0
    with pytest.raises(MissionError, match="goals of their own for 20 robots"):
        draw(ground, 3, 0, 1, 20)


def test_all_drive_at_once_and_are_told_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(team_clock, "learned_perception", blind)
    monkeypatch.setattr(team_clock, "CameraRig", lambda: RIG)
    monkeypatch.setattr(team_clock, "goal_from", lambda pictures, **share: Nowhere())
    asked: dict[str, Any] = {"seed": 3, "folder": tmp_path, "limit_s": 12.0}
    table = evaluate(HAMLET, 1, 3, **asked)
    assert list(table.robot) == ["R1", "R2", "R3"] and not table.success.any()
    assert table.reason.str.contains("out of time").all()
    assert all(log[-1]["what"] == "gave up" for log in table.log)
    assert table.seconds.between(12.0, 13.0).all() and (table.driven_m > 2.0).all()
    assert (table.published >= 3).all() and (table.nearest_m > 0).all()
    assert (table.collisions == 0).all()
    monkeypatch.setattr(team_clock, "Simulator", None)  # nothing is left to do
    pd.testing.assert_frame_equal(table, evaluate(HAMLET, 1, 3, **asked))


@pytest.mark.parametrize("patrol_s", [0.0, 6.0])
def test_each_has_an_index_and_a_memory_of_its_own_and_ways_count_from_where_it_set_out(
    patrol_s: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What one compares is none of another's budget."""
    monkeypatch.setattr(team_clock, "learned_perception", blind)
    monkeypatch.setattr(team_clock, "CameraRig", lambda: RIG)
    monkeypatch.setattr(team_clock, "goal_from", lambda pictures, **share: Nowhere())
    indices: list[object] = []
    remembered: list[bool] = []

    def index_of(*asked: Any) -> Any:
        indices.append(reader.index_of(*asked))
        return indices[-1]

    def published_of(*asked: Any, memory: bool) -> Any:
        remembered.append(memory)
        return reader.published_of(*asked, memory=memory)

    monkeypatch.setattr(team_clock, "index_of", index_of)
    monkeypatch.setattr(team_clock, "published_of", published_of)
    table = evaluate(HAMLET, 1, 3, seed=3, folder=tmp_path, limit_s=3.0, patrol_s=patrol_s)
    assert len(set(map(id, indices))) == 3 and remembered == [patrol_s > 0] * 3
    scene = the_hamlet(3, 0)
    drawn = draw(Ground(scene, GroundTruth(scene), RIG), 3, 0, 0, 3)
    ways_m = [drawn[name].way_m for name in table.robot]
    assert (list(table.way_m) == pytest.approx(ways_m)) == (patrol_s == 0)


def test_near_misses_are_counted_once_each() -> None:
    still = np.zeros((9, 2))
    passing = np.column_stack([np.linspace(-4.0, 4.0, 9), np.full(9, 1.0)])
    nearest_m, near = team_clock._nearness([still, passing, still + 50.0])
    apart_m = 1.0 - 2 * team_clock.ROBOT_RADIUS_M
    assert nearest_m == pytest.approx(apart_m) and near == int(apart_m < team_clock.NEAR_M)
    back = np.concatenate([passing, passing[::-1]])
    closer = back - [0.0, 0.25]
    assert team_clock._nearness([np.zeros((18, 2)), closer])[1] == 2


def rows(run: int, success: list[bool], seconds: list[float]) -> list[dict[str, Any]]:
    return [
        {
            "suburb": run, "run": run, "robot": f"R{n}", "arrived": True, "success": good,
            "reason": "", "seconds": s, "driven_m": 60.0, "way_m": 50.0, "collisions": 0,
            "near_misses": 2, "nearest_m": 0.2 + run, "published": 40, "wall_s": 9.0,
        }
        for n, (good, s) in enumerate(zip(success, seconds, strict=True), 1)
    ]  # fmt: skip


def test_the_last_to_arrive_stops_the_clock() -> None:
    table = pd.DataFrame(rows(0, [True, True], [90, 200]) + rows(1, [True, False], [50, 600]))
    late = summarise(pd.concat([table, pd.DataFrame(rows(2, [True, True], [90, 610]))]))["team"]
    assert late["all_arrived"] == pytest.approx(2 / 3) and late["all_600s"] == pytest.approx(1 / 3)
    team = summarise(table)["team"]
    assert (team["runs"], team["robots"], team["all_arrived"], team["all_s"]) == (2, 2, 0.5, 200)
    assert team["success"] == 0.75 and team["false_arrivals"] == 1
    assert team["seconds"] == pytest.approx(340 / 3) and team["nearest_m"] == 0.2
    assert team["near_misses"] == 2 and "all_arrived" in as_table({"team": team})


def test_what_cannot_be_asked_for(tmp_path: Path) -> None:
    for runs, robots, patrol_s in ((0, 3, 0.0), (1, 0, 0.0), (1, 3, -1.0), (1, 3, np.inf)):
        with pytest.raises(MissionError):
            evaluate(HAMLET, runs, robots, seed=3, folder=tmp_path, patrol_s=patrol_s)
    for limit_s in (0.0, np.inf, np.nan):
        with pytest.raises(MissionError, match="more than 0 seconds"):
            evaluate(HAMLET, 1, 3, seed=3, folder=tmp_path, limit_s=limit_s)

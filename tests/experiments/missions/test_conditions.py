"""What missions are driven under: an old or thin ledger, another season, a raised goal."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import worlds
from blind import Nowhere, blind
from hamlet import the_hamlet
from sights import RIG

from vrchain.errors import VRChainError
from vrchain.experiments.missions import draw, drive
from vrchain.experiments.missions.drive import Conditions
from vrchain.experiments.missions.success import evaluate
from vrchain.experiments.scenes import Scenes
from vrchain.navigation.goal.place import GoalPlace
from vrchain.navigation.settings import MissionConfig
from vrchain.panorama import CameraRig
from vrchain.world.render import Renderer
from vrchain.world.spec import SceneSpec

HAMLET = Scenes(the_hamlet, "hamlet", varied=False, spec=SceneSpec())
PATROL_S, MISSION_S = 20.0, 12.0


class Drawn(Renderer):
    """Notes what it draws: the height of the camera, and of whom it is a view."""

    def __init__(self) -> None:
        super().__init__(the_hamlet(0, 0))
        self.rigs: list[CameraRig] = []

    def render(self, pose: Any, rig: CameraRig, *rest: Any, **options: Any) -> Any:
        self.rigs.append(rig)
        return super().render(pose, rig, *rest, **options)


def driven(
    folder: Path, monkeypatch: pytest.MonkeyPatch, **given: Any
) -> tuple[int, list[np.ndarray], Drawn, Drawn]:
    """Transactions of the others, all paths after the patrol, and what was drawn then and now."""
    simulators, then, now = [], Drawn(), Drawn()

    def simulator(*args: Any, **options: Any) -> Any:
        simulators.append(Simulator(*args, **options))
        return simulators[-1]

    Simulator = drive.Simulator
    monkeypatch.setattr(draw, "WAY_M", (12.0, 60.0))
    with monkeypatch.context() as patched:
        patched.setattr(drive, "Simulator", simulator)
        renderers = iter([now, then])
        patched.setattr(drive, "Renderer", lambda scene: next(renderers))
        patched.setattr(drive, "learned_perception", blind)
        nowhere = Nowhere()
        patched.setattr(drive, "goal_from", lambda pictures, share: nowhere)
        conditions = Conditions(PATROL_S, config=MissionConfig(limit_s=MISSION_S), **given)
        table, _ = evaluate(
            HAMLET, 1, 4, ["ledger"], seed=3, folder=folder, rig=RIG, conditions=conditions
        )
    (world,) = simulators
    set_out = PATROL_S + given.get("quiet_s", 0.0)
    paths_m = [world.path_xy_m(name)[world.times_s > set_out] for name in world.robots]
    assert table.seconds_simulated.between(MISSION_S, MISSION_S + 1).all()
    return int(table.published[0]), paths_m, then, now


def spied_missions(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, set[str], float]]:
    """Of every mission that a robot is sent on its goal, what it knows first, and its limit."""
    asked, drive_mission = [], drive.drive_mission

    def spied(*given: Any) -> Any:
        asked.append((given[4], set(given[2]()), given[6].limit_s))
        return drive_mission(*given)

    monkeypatch.setattr(drive, "drive_mission", spied)
    return asked


def test_who_has_stopped_stands_and_says_nothing_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    going, paths_m, *_ = driven(tmp_path / "a", monkeypatch)
    quiet, stood_m, *_ = driven(tmp_path / "b", monkeypatch, quiet_s=3600.0)
    moved = [[np.ptp(path_m, axis=0).max() > 1.0 for path_m in p] for p in (paths_m, stood_m)]
    assert moved == [[True] * 4, [True, False, False, False]]
    assert quiet == 3 < going


def test_what_was_not_kept_is_not_planned_by(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    published_of, known = drive.published_of, list[set[str]]()

    def spied(*asked: Any, **memory: bool) -> Any:
        published = published_of(*asked, **memory)
        return lambda: known.append(set(published())) or published()

    monkeypatch.setattr(drive, "published_of", spied)
    driven(tmp_path, monkeypatch, keep=1)
    assert known and all(names <= {"R2", "R3", "R4"} for names in known)


def test_rarer_rules_publish_less(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    often, rarely = (
        driven(tmp_path / f"{rarer}", monkeypatch, rarer=rarer)[0] for rarer in (1.0, 50.0)
    )
    assert rarely == 3 < often  # each as it started


def test_the_ledger_and_the_goal_are_of_another_season_and_what_is_seen_is_of_today(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    *_, then, now = driven(tmp_path / "a", monkeypatch, season="winter", quiet_s=1.0)
    views = sorted(rig.n_views for rig in then.rigs)
    assert views == [1] * 4 + [RIG.n_views] * 3  # the goal's, and those of the others' patrol
    assert now.rigs and all(rig == RIG for rig in now.rigs)
    *_, then, now = driven(tmp_path / "b", monkeypatch)
    assert not then.rigs and len(now.rigs) > 4


def test_a_goal_is_pictured_from_higher(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    *_, now = driven(tmp_path, monkeypatch, goal_rise_m=0.5)
    raised = [rig for rig in now.rigs if rig.camera_height_m == RIG.camera_height_m + 0.5]
    assert len(raised) == 4 and all(rig.n_views == 1 for rig in raised)


def test_who_is_to_return_has_patrolled_and_remembers_what_it_saw(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = spied_missions(monkeypatch)
    _, (path_m, *_), *_ = driven(tmp_path, monkeypatch, task="return")
    ((goal, known, limit_s),) = asked
    assert isinstance(goal, GoalPlace) and limit_s == MISSION_S
    assert {"R1 before", "R2"} <= known and "R1" not in known
    row = json.loads(next(tmp_path.rglob("*_ledger.json")).read_text())
    start = json.loads(next(tmp_path.rglob("mission_0000.json")).read_text())["poses"]["R1"]
    away_m = np.hypot(*(path_m[0] - [start["x_m"], start["y_m"]]))
    assert row["way_m"] >= away_m - 2.0 and away_m > 2.0 and row["chain"] == 0


def test_another_goal_is_asked_for_on_the_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked, named = spied_missions(monkeypatch), list[str]()
    pictured = drive.goal_pictures
    monkeypatch.setattr(
        drive, "goal_pictures", lambda *given: named.append(given[2]) or pictured(*given)
    )
    driven(tmp_path, monkeypatch, task="change")
    assert [limit_s for *_, limit_s in asked] == [60.0, MISSION_S]
    assert len(named) == len(set(named)) == 2
    before, now = (known for _, known, _ in asked)
    assert "R1 before" in now and "R1 before" not in before


def test_a_ledger_of_another_world_is_given_up_in_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The others' panoramas show what is nowhere here."""
    corners = [(x_m, y_m) for x_m in (-20.0, 20.0) for y_m in (-20.0, 20.0)]
    houses = [
        worlds.box(f"h {c}", c, (4, 4, 4), worlds.blotches(f"h {c}"), solid=False) for c in corners
    ]
    elsewhere = Renderer(worlds.world(*houses, extent_m=(48.0, 48.0)))
    monkeypatch.setattr(draw, "WAY_M", (12.0, 60.0))
    pictured = drive.Suburb._goal
    monkeypatch.setattr(drive.Suburb, "_before", lambda *given: elsewhere)
    monkeypatch.setattr(
        drive.Suburb,
        "_goal",
        lambda own, mission, _, *asked: pictured(own, mission, own.renderer, *asked),
    )
    conditions = Conditions(PATROL_S, config=MissionConfig(limit_s=2 * MISSION_S))
    table, _ = evaluate(
        HAMLET, 1, 4, ["ledger"], seed=3, folder=tmp_path, rig=RIG, conditions=conditions
    )
    assert table.published[0] >= 3 and not table.arrived[0]
    assert table.reason[0] == f"out of time after {2 * MISSION_S:.0f} s"
    assert not table.routes[0]  # nothing there leads anywhere here


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"keep": 0}, "1 panorama of each robot or more, got 0"),
        ({"rarer": 0.0}, "above 0, got 0.0"),
        ({"rarer": np.inf}, "above 0, got inf"),
        ({"quiet_s": -1.0}, "seconds of silence, 0 or more, got -1.0"),
        ({"goal_rise_m": np.nan}, "metres of rise, got nan"),
        ({"goal_rise_m": -1.5}, "camera_height_m"),
        ({"task": "home"}, "a task of goal, return, change, got home"),
        ({"season": "monsoon"}, "season: expected one of summer, .*got 'monsoon'"),
        ({"time": "night"}, "light.time: expected one of noon, .*got 'night'"),
    ],
)
def test_conditions_that_cannot_be(given: dict[str, Any], told: str, tmp_path: Path) -> None:
    with pytest.raises(VRChainError, match=told):
        evaluate(HAMLET, 1, 4, seed=3, folder=tmp_path, rig=RIG, conditions=Conditions(**given))
    assert not any(tmp_path.iterdir())


def test_a_gazebo_world_has_one_season(tmp_path: Path) -> None:
    world = Scenes(the_hamlet, "hamlet", varied=False)
    with pytest.raises(VRChainError, match="Gazebo world has no seasons"):
        evaluate(world, 1, 4, seed=3, folder=tmp_path, conditions=Conditions(season="winter"))

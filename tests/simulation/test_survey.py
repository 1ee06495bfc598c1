import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import worlds
from hamlet import hamlet

from vrchain.errors import LedgerError, MissionError
from vrchain.ledger import Ledger, verify
from vrchain.panorama import Panorama
from vrchain.robot import UpdateRules
from vrchain.simulation.survey import start_poses, survey

RULES = UpdateRules(distance_m=2.0)


def small(folder: Path, n: int = 6, **options: object) -> pd.DataFrame:
    settings = {"seed": 4, "rig": worlds.SMALL_RIG, "rules": RULES} | options
    return survey(hamlet(), folder, n, **settings)


@pytest.fixture(scope="module")
def surveyed(tmp_path_factory: pytest.TempPathFactory) -> tuple[pd.DataFrame, Path]:
    folder = tmp_path_factory.mktemp("survey") / "ledger"
    return small(folder), folder


def test_every_position_is_in_the_ledger(surveyed: tuple[pd.DataFrame, Path]) -> None:
    table, folder = surveyed
    assert len(table) == 6
    assert table.robot.value_counts().to_dict() == {"R1": 3, "R2": 3}
    checked = verify(folder)
    assert checked.ok and checked.blocks == 7
    with Ledger.open(folder) as ledger:
        for robot, rows in table.groupby("robot"):
            history = list(ledger.history(robot))
            assert [t.payload_digest.hex() for t in history] == list(rows.digest)
            assert [t.reason for t in history] == list(rows.rule)
            assert [t.timestamp_ns / 1e9 for t in history] == list(rows.time_s)
            for t, size in zip(history, rows.payload_bytes, strict=True):
                blob = ledger.payload(t.payload_digest)
                assert len(blob) == size
                assert Panorama.decode(blob).rig == worlds.SMALL_RIG


def test_positions_are_new_places(surveyed: tuple[pd.DataFrame, Path]) -> None:
    table, _ = surveyed
    assert table.time_s.is_monotonic_increasing
    for _, rows in table.groupby("robot"):
        assert rows.rule.iloc[0] == "start"
        moved = np.hypot(rows.x_m.diff(), rows.y_m.diff()).dropna()
        by_distance = rows.rule.iloc[1:] == "distance"
        assert (moved[by_distance.to_numpy()] < 8).all()
    assert (hamlet().clearance_m(table[["x_m", "y_m"]]) >= 0.39).all()


def test_each_position_tells_where_the_other_robot_stood(
    surveyed: tuple[pd.DataFrame, Path],
) -> None:
    """At the start both publish at once; each is where the other's row says."""
    table, _ = surveyed
    others = [json.loads(text) for text in table.others]
    assert [set(o) for o in others] == [{"R2" if r == "R1" else "R1"} for r in table.robot]
    first = table.drop_duplicates("robot").set_index("robot")
    for name, other in (("R1", "R2"), ("R2", "R1")):
        pose = json.loads(first.others[name])[other]
        assert pose == list(first.loc[other, ["x_m", "y_m", "yaw_rad"]])


def test_the_same_survey_is_the_same_bytes(
    surveyed: tuple[pd.DataFrame, Path], tmp_path: Path
) -> None:
    table, folder = surveyed
    again = small(tmp_path / "again")
    pd.testing.assert_frame_equal(again, table)
    with Ledger.open(folder) as first, Ledger.open(tmp_path / "again") as second:
        assert first.head.hash == second.head.hash
        digests = [bytes.fromhex(told) for told in table.digest]
        assert all(first.payload(d) == second.payload(d) for d in digests)


def test_another_seed_is_another_survey(
    surveyed: tuple[pd.DataFrame, Path], tmp_path: Path
) -> None:
    other = small(tmp_path / "other", 2, seed=5)
    assert set(other.digest).isdisjoint(surveyed[0].digest)


PAIR = ("R1", "R2")


@pytest.mark.parametrize(
    ("n", "robots", "error", "words"),
    [
        *((n, PAIR, MissionError, "cannot be shared out") for n in (5, 0, -2, 1)),
        (4, (), MissionError, "expected names of robots, each once, got none"),
        (4, ("R1", "R1"), MissionError, "each once, got R1, R1"),
        (2, ("R1", "no\nname"), LedgerError, "."),  # a name must fit the ledger
    ],
)
def test_a_survey_that_cannot_be_is_refused(
    n: int, robots: tuple[str, ...], error: type[Exception], words: str, tmp_path: Path
) -> None:
    with pytest.raises(error, match=words):
        small(tmp_path / "ledger", n, robots=robots)
    assert error is LedgerError or not (tmp_path / "ledger").exists()


def test_robots_that_get_nowhere_are_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vrchain.simulation.survey._MAX_TICKS_A_POSITION", 20)
    rules = UpdateRules(distance_m=1e6, view_change=1e6, max_age_s=1e6)
    with pytest.raises(MissionError, match="only 2 of 4 positions"):
        small(tmp_path / "ledger", 4, rules=rules)


def test_a_team_starts_within_sight_of_each_other() -> None:
    for seed in range(5):
        poses = start_poses(hamlet(), ("R1", "R2", "R3"), seed)
        assert list(poses) == ["R1", "R2", "R3"]
        first = poses["R1"]
        for name, pose in poses.items():
            hamlet().check_pose(pose)
            assert hamlet().clearance_m([pose.xy_m])[0] > 2.0
            for other, second in poses.items():
                assert name == other or pose.distance_to_m(second.xy_m) >= 8.0
            assert pose.distance_to_m(first.xy_m) <= 20.0
    assert start_poses(hamlet(), ("R1", "R2"), 0) == start_poses(hamlet(), ("R1", "R2"), 0)


def test_no_room_for_a_team_is_said_plainly() -> None:
    tiny = worlds.world(extent_m=(6.0, 6.0))
    with pytest.raises(MissionError, match="no room for 2 robots"):
        start_poses(tiny, ("R1", "R2"), 0)
    assert len(start_poses(worlds.world(extent_m=(6.0, 6.0)), ("R1",), 0)) == 1
    with pytest.raises(MissionError, match="no room for 1"):
        start_poses(worlds.world(extent_m=(3.0, 3.0)), ("R1",), 0)

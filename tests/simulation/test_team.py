from dataclasses import astuple
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import worlds
from hamlet import GOAL, hamlet, hamlet_truth
from sights import RIG

from vrchain.geometry import Pose, relative
from vrchain.landmarks.extraction.proposer import nothing
from vrchain.landmarks.extraction.record import LandmarkRecord, decode_record
from vrchain.landmarks.extraction.sift import NO_FEATURES
from vrchain.ledger import Ledger, verify
from vrchain.ledger.records.transaction import NO_BLOB
from vrchain.panorama import Panorama
from vrchain.robot import Drive, UpdateRules
from vrchain.simulation.simulator import Simulator
from vrchain.simulation.task import Task, draw_task
from vrchain.simulation.team import PublishingRobot, assemble, drive_to_places, team_ledger

RULES = UpdateRules(distance_m=3.0, view_change=5.0, max_age_s=20.0)


def one_robot(folder: Path, rules: UpdateRules = RULES) -> tuple[PublishingRobot, Ledger]:
    simulator = Simulator(worlds.yard(), {"R1": Pose(0, 0)}, seed=3, rig=worlds.SMALL_RIG)
    ledger = team_ledger(folder / "ledger", simulator.robots, 3)
    return assemble(simulator, ledger, 3, rules)["R1"], ledger


def test_a_robot_publishes_by_the_rules(tmp_path: Path) -> None:
    robot, ledger = one_robot(tmp_path)
    with ledger:
        assert robot.observe().panorama is None
        assert robot.publications == []  # nothing to publish without a look
        robot.observe(look=True)
        assert [p.rule for p in robot.publications] == ["start"]
        robot.observe(look=True)
        assert len(robot.publications) == 1  # the same view again is no news
        for _ in range(10):
            robot.drive(Drive(0.5), 1.0)
            robot.observe(look=True)
        assert [p.rule for p in robot.publications] == ["start", "distance"]
        robot.body.simulator.step({}, 20.0)
        robot.observe(look=True)
        assert [p.rule for p in robot.publications][2] == "time"
        newest, told = ledger.latest("R1"), robot.publications[-1]
        assert newest.reason == "time" and newest.payload_digest.hex() == told.digest
        assert newest.timestamp_ns == robot.body.simulator.clock_ns
        times = [p.time_s for p in robot.publications]
        assert times == sorted(times)
        blob = ledger.payload(newest.payload_digest)
        assert Panorama.decode(blob).rig == worlds.SMALL_RIG
        assert told.payload_bytes == len(blob)
        assert told.x_m == robot.body.simulator.pose("R1").x_m
    assert verify(tmp_path / "ledger").ok


def test_landmarks_and_the_way_driven_are_published_where_they_are_asked_for(
    tmp_path: Path,
) -> None:
    simulator = Simulator(worlds.yard(), {"R1": Pose(0, 0), "R2": Pose(2, 2)}, seed=1, rig=RIG)
    shown = LandmarkRecord(RIG, "ab" * 32, nothing(), NO_FEATURES)
    with team_ledger(tmp_path / "ledger", simulator.robots, 1) as ledger:
        described = assemble(simulator, ledger, 1, RULES, lambda seen: shown)["R1"]
        plain = assemble(simulator, ledger, 1)["R2"]
        stood = [described.observe(look=True).odometry]
        plain.observe(look=True)
        assert ledger.latest("R2").landmarks_digest == NO_BLOB
        glance = described.observe(towards_rad=0.8)
        assert glance.panorama.rig.n_views == 1 and glance.view_rad == pytest.approx(np.pi / 4)
        assert len(described.publications) == 1  # a glance is not published
        for _ in range(14):
            described.drive(Drive(0.5, 0.1), 0.5)
            seen = described.observe(look=True)
            if len(described.publications) > len(stood):
                stood.append(seen.odometry)
        assert len(stood) >= 2
        told = [
            decode_record(ledger.payload(t.landmarks_digest)).moved for t in ledger.history("R1")
        ]
        assert told[0] is None
        for way, (a, b) in zip(told[1:], pairwise(stood), strict=True):
            assert astuple(way) == pytest.approx(astuple(relative(a, b)), abs=2**-10)


def test_a_new_view_is_published(tmp_path: Path) -> None:
    robot, ledger = one_robot(tmp_path, UpdateRules(distance_m=99, view_change=0.2, max_age_s=999))
    with ledger:
        robot.observe(look=True)
        for _ in range(8):  # turning on the spot shows nothing new
            robot.drive(Drive(0.0, 0.7), 1.0)
            robot.observe(look=True)
        assert [p.rule for p in robot.publications] == ["start"]
        for _ in range(12):
            robot.drive(Drive(0.5), 1.0)
            robot.observe(look=True)
        assert {p.rule for p in robot.publications[1:]} == {"view"}


def test_watching_looks_only_now_and_then(tmp_path: Path) -> None:
    robot, ledger = one_robot(tmp_path)
    with ledger:
        looks = [robot.watch().panorama is not None]
        for _ in range(10):
            robot.drive(Drive(0.45), 1.0)
            looks.append(robot.watch().panorama is not None)
        assert looks[0] and sum(looks) == 2  # at the start, and after 2.5 m
        assert robot.publisher.monitor.travelled_m < 5
        robot.body.simulator.step({}, 21.0)
        assert robot.watch().panorama is not None
        assert robot.publications[-1].rule in ("time", "distance")


def test_a_team_drives_to_its_places_and_publishes_there(tmp_path: Path) -> None:
    task = draw_task(hamlet(), hamlet_truth(), RIG, 1, 3, goal=GOAL)
    simulator = Simulator(hamlet(), task.starts, seed=1, rig=worlds.SMALL_RIG)
    with team_ledger(tmp_path / "ledger", simulator.robots, 1) as ledger:
        robots = assemble(simulator, ledger, 1)
        drive_to_places(simulator, robots, task)
        for name, robot in robots.items():
            assert simulator.pose(name).distance_to_m(task.places[name].xy_m) < 0.6
            assert robot.publications[0].rule == "start"
            assert robot.publications[-1].rule == "time"
            last = ledger.latest(name)
            assert last.payload_digest.hex() == robot.publications[-1].digest
            there = Pose(robot.publications[-1].x_m, robot.publications[-1].y_m)
            assert there.distance_to_m(simulator.pose(name).xy_m) < 1e-9
        assert simulator.clock_ns <= 130e9
    assert verify(tmp_path / "ledger").ok


def test_a_place_that_cannot_be_reached_does_not_hold_up_the_team(tmp_path: Path) -> None:
    start = Pose(-3.0, 0.0)
    scene = worlds.walled(3.0)
    task = Task({"R1": Pose(12.0, 0.0)}, {"R1": start}, "wall", ())
    simulator = Simulator(scene, task.starts, seed=0, rig=worlds.SMALL_RIG)
    with team_ledger(tmp_path / "ledger", simulator.robots, 0) as ledger:
        robots = assemble(simulator, ledger, 0)
        drive_to_places(simulator, robots, task)
        assert ledger.latest("R1") is not None
    assert simulator.clock_ns <= 125e9
    assert simulator.pose("R1").x_m < 3

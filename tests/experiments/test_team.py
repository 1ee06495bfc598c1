from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
import worlds
from hamlet import GOAL, hamlet, hamlet_truth
from sights import RIG

from vrchain.errors import MissionError, SpecError
from vrchain.experiments.team import (
    GOAL_PICTURES,
    GOAL_RANGE_M,
    SPACING_M,
    PublishingRobot,
    Task,
    assemble,
    draw_task,
    drive_to_places,
    goal_pictures,
    goal_poses,
    robot_names,
)
from vrchain.geometry import Pose
from vrchain.landmarks.quality import co_visible
from vrchain.ledger import Ledger, simulated_key, verify
from vrchain.ledger.transaction import NO_BLOB
from vrchain.panorama import CameraRig, Panorama
from vrchain.render import Renderer
from vrchain.robot import Drive, UpdateRules
from vrchain.simulator import Simulator

FULL = CameraRig()


@pytest.fixture(scope="module", params=[(0, 2), (1, 3), (2, 4)], ids=lambda p: f"{p[1]} robots")
def task(request: pytest.FixtureRequest) -> Task:
    seed, n_robots = request.param
    return draw_task(hamlet(), hamlet_truth(), RIG, seed, n_robots, goal=GOAL)


def test_a_task_is_as_it_is_defined(task: Task) -> None:
    scene, truth = hamlet(), hamlet_truth()
    places = list(task.places.values())
    target = scene.index_of(task.goal)
    assert task.goal == GOAL
    assert list(task.places) == list(task.starts) == [f"R{i + 1}" for i in range(len(places))]
    for a, b in pairwise(places):
        assert SPACING_M[0] <= a.distance_to_m(b.xy_m) <= SPACING_M[1]
        assert co_visible(truth, a, b, RIG)
    assert scene.is_free([p.xy_m for p in places], 1.0).all()
    assert truth.visibility(places[-1], RIG).visible[target]
    object_id, _ = truth.look(places[0], FULL)
    assert not (object_id == target).any()  # not one pixel


def test_every_robot_reaches_its_place_straight_ahead(task: Task) -> None:
    scene = hamlet()
    for name, place in task.places.items():
        start = task.starts[name]
        assert start.bearing_to_rad(place.xy_m) == pytest.approx(0, abs=1e-6)
        way = start.xy_m + np.linspace(0, 1, 25)[:, None] * (place.xy_m - start.xy_m)
        assert scene.is_free(way).all()
        assert start.distance_to_m(place.xy_m) > 3


def test_the_goals_pictures_show_the_goal_and_little_else(task: Task) -> None:
    scene, truth = hamlet(), hamlet_truth()
    target = scene.index_of(task.goal)
    pictures = goal_pictures(scene, Renderer(scene), task.goal, task.goal_poses, RIG)
    assert len(pictures) == len(task.goal_poses) == GOAL_PICTURES
    for pose, picture in zip(task.goal_poses, pictures, strict=True):
        low, high = GOAL_RANGE_M
        range_m = scene.objects[target].footprint.distance(shapely.Point(*pose.xy_m))
        assert low - 2 <= range_m <= high + 1 and scene.is_free([pose.xy_m])[0]
        object_id, _ = truth.look(pose, picture.rig)
        share = (object_id == target).mean()
        assert share > 0.2
        assert object_id[0, picture.rig.height_px // 2, picture.rig.width_px // 2] == target
        assert picture.rig.focal_px == pytest.approx(RIG.focal_px, rel=0.05)
        assert picture.rig.n_views == 1


def test_the_same_seed_draws_the_same_task_and_another_draws_another() -> None:
    drawn = [
        draw_task(hamlet(), hamlet_truth(), RIG, seed, 2, goal=goal)
        for seed, goal in ((5, GOAL), (5, GOAL), (6, GOAL))
    ]
    assert drawn[0] == drawn[1]
    assert drawn[0] != drawn[2]


def test_a_goal_is_drawn_among_houses() -> None:
    task = draw_task(hamlet(), hamlet_truth(), RIG, 0, 2, "R2")
    assert task.goal.startswith("house")
    assert list(task.places) == ["R2", "R1"]


def test_what_cannot_be_drawn_is_refused() -> None:
    cases = [
        ({"goal": "house 99"}, "no object 'house 99'"),
        ({"goal": "ground"}, "no landmark"),
        ({"robot": "R9"}, "no robot 'R9'"),
        ({"robot": ""}, "no robot ''"),
        ({"n_robots": 1}, "expected 2 to 20 robots, got 1"),
        ({"n_robots": 21}, "expected 2 to 20 robots, got 21"),
        ({"n_robots": -3}, "expected 2 to 20"),
    ]
    for options, message in cases:
        with pytest.raises(MissionError, match=message):
            draw_task(hamlet(), hamlet_truth(), RIG, 0, **options)


def test_a_scene_without_houses_needs_a_named_goal() -> None:
    from vrchain.truth import GroundTruth

    scene = worlds.yard()
    with pytest.raises(MissionError, match="name a --goal"):
        draw_task(scene, GroundTruth(scene), RIG, 0)


@pytest.fixture
def _few_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("vrchain.experiments.team._BATCHES", 1)
    monkeypatch.setattr("vrchain.experiments.team._BATCH", 4000)


@pytest.mark.usefixtures("_few_draws")
def test_too_many_robots_for_the_place_is_said_plainly() -> None:
    """A chain of twenty needs more room than there is."""
    with pytest.raises(MissionError, match=r"20 robots.*try another goal"):
        draw_task(hamlet(), hamlet_truth(), RIG, 0, 20, goal=GOAL)


@pytest.mark.usefixtures("_few_draws")
def test_a_goal_in_plain_view_of_everywhere_is_said_plainly() -> None:
    from vrchain.truth import GroundTruth

    tower = worlds.box("tower", (0, 0), (2, 2, 3), worlds.blotches("tower"))
    scene = worlds.world(tower)
    with pytest.raises(MissionError, match="'tower'"):
        draw_task(scene, GroundTruth(scene), RIG, 0, goal="tower")


@pytest.mark.usefixtures("_few_draws")
def test_a_goal_that_is_shut_in_has_no_pictures() -> None:
    from vrchain.truth import GroundTruth

    goal = worlds.box("goal", (0, 0), (1, 1, 1), worlds.blotches("goal"))
    sides = [
        ((0, 4), (9, 0.2, 4)),
        ((0, -4), (9, 0.2, 4)),
        ((4, 0), (0.2, 9, 4)),
        ((-4, 0), (0.2, 9, 4)),
    ]
    walls = [worlds.box(f"w{k}", c, s, worlds.plain(worlds.RED)) for k, (c, s) in enumerate(sides)]
    scene = worlds.world(goal, *walls)
    truth = GroundTruth(scene)
    assert goal_poses(scene, truth, scene.index_of("goal"), 0) == []
    with pytest.raises(MissionError):
        draw_task(scene, truth, RIG, 0, goal="goal")


def test_robot_names_begin_with_the_one_that_drives() -> None:
    assert robot_names(3) == ["R1", "R2", "R3"]
    assert robot_names(3, "R2") == ["R2", "R1", "R3"]
    assert robot_names(20, "R20")[0] == "R20"


# --- publishing ---

RULES = UpdateRules(distance_m=3.0, view_change=5.0, max_age_s=20.0)


def one_robot(folder: Path, rules: UpdateRules = RULES) -> tuple[PublishingRobot, Ledger]:
    simulator = Simulator(worlds.yard(), {"R1": Pose(0, 0)}, seed=3, rig=worlds.SMALL_RIG)
    ledger = Ledger.create(
        folder / "ledger", {"R1": simulated_key(3, "R1").public}, simulated_key(3, "operator")
    )
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
        robot.simulator.step({}, 20.0)
        robot.observe(look=True)
        assert [p.rule for p in robot.publications][2] == "time"
        newest = ledger.latest("R1")
        assert (
            newest.reason == "time" and newest.payload_digest.hex() == robot.publications[-1].digest
        )
        assert newest.timestamp_ns == robot.simulator.clock_ns
        times = [p.time_s for p in robot.publications]
        assert times == sorted(times)
        stored = Panorama.decode(ledger.payload(newest.payload_digest))
        assert stored.rig == worlds.SMALL_RIG
        assert robot.publications[-1].payload_bytes == len(ledger.payload(newest.payload_digest))
        assert robot.publications[-1].x_m == robot.simulator.pose("R1").x_m
    assert verify(tmp_path / "ledger").ok


def test_landmarks_are_published_beside_the_panorama_where_they_are_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("vrchain.experiments.team.encode_record", lambda record: record)
    simulator = Simulator(worlds.yard(), {"R1": Pose(0, 0), "R2": Pose(2, 2)}, seed=1, rig=RIG)
    members = {name: simulated_key(1, name).public for name in simulator.robots}
    with Ledger.create(tmp_path / "ledger", members, simulated_key(1, "operator")) as ledger:
        described = assemble(simulator, ledger, 1, examine=lambda seen: b"what it shows")["R1"]
        plain = assemble(simulator, ledger, 1)["R2"]
        described.observe(look=True), plain.observe(look=True)
        newest = {name: ledger.latest(name) for name in ("R1", "R2")}
        assert ledger.payload(newest["R1"].landmarks_digest) == b"what it shows"
        assert newest["R2"].landmarks_digest == NO_BLOB
        glance = described.observe(towards_rad=0.8)
        assert glance.panorama.rig.n_views == 1 and glance.view_rad == pytest.approx(np.pi / 4)
        assert len(described.publications) == 1  # a glance is not published


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
        assert robot.monitor.travelled_m < 5
        robot.simulator.step({}, 21.0)
        assert robot.watch().panorama is not None
        assert robot.publications[-1].rule in ("time", "distance")


def test_a_team_drives_to_its_places_and_publishes_there(tmp_path: Path) -> None:
    task = draw_task(hamlet(), hamlet_truth(), RIG, 1, 3, goal=GOAL)
    simulator = Simulator(hamlet(), task.starts, seed=1, rig=worlds.SMALL_RIG)
    members = {name: simulated_key(1, name).public for name in task.starts}
    with Ledger.create(tmp_path / "ledger", members, simulated_key(1, "operator")) as ledger:
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
    members = {"R1": simulated_key(0, "R1").public}
    with Ledger.create(tmp_path / "ledger", members, simulated_key(0, "operator")) as ledger:
        robots = assemble(simulator, ledger, 0)
        drive_to_places(simulator, robots, task)
        assert ledger.latest("R1") is not None
    assert simulator.clock_ns <= 125e9
    assert simulator.pose("R1").x_m < 3


def test_rules_that_are_none_are_refused() -> None:
    with pytest.raises(SpecError):
        UpdateRules(distance_m=0)

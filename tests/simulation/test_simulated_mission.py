import hashlib
import json
import math
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
import worlds
from blind import Nowhere, blind
from hamlet import GOAL, hamlet, moved, on_grid
from sights import RIG

from vrchain.errors import LedgerError, MissionError
from vrchain.geometry import Pose, rotation_z
from vrchain.landmarks.retrieval.index import LandmarkIndex
from vrchain.ledger import Ledger, simulated_key, verify
from vrchain.navigation.goal.recognition import goal_from
from vrchain.navigation.mission import MissionResult, drive_mission
from vrchain.navigation.perception import learned_perception
from vrchain.navigation.settings import MissionConfig, Published
from vrchain.panorama import CameraRig
from vrchain.paths import SCENES
from vrchain.robot import MAX_SPEED_M_S
from vrchain.simulation import mission
from vrchain.simulation.mission import MARKER, MissionRun, save_log
from vrchain.simulation.simulator import Simulator
from vrchain.simulation.task import SUCCESS_RANGE_M
from vrchain.simulation.team import assemble, team_ledger
from vrchain.world import load_scene
from vrchain.world.model import Scene
from vrchain.world.truth import GroundTruth

SHORT = MissionConfig(limit_s=240.0)


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> tuple[MissionRun, Path]:
    folder = tmp_path_factory.mktemp("mission") / "ledger"
    # a short way, driven alike on every processor
    run = mission.run_mission(
        hamlet(), folder, seed=2, n_robots=2, goal=GOAL, rig=RIG, config=SHORT
    )
    return run, folder


def check_run(run: MissionRun) -> None:
    """What it claims and what is true are told apart."""
    target = run.scene.objects[run.scene.index_of(run.task.goal)]
    true_m = target.footprint.distance(shapely.Point(*run.final_pose.xy_m))
    assert run.range_m == pytest.approx(true_m)
    assert run.result.reason
    assert run.success == run.result.arrived  # no wrong arrival is claimed
    assert true_m <= SUCCESS_RANGE_M or not run.success
    path = run.paths_xy_m[run.robot]
    assert np.allclose(path[-1], run.final_pose.xy_m)
    assert run.scene.is_free(path, 0.399).all()  # nobody went through a wall


def test_a_small_mission_ends_at_its_goal(driven: tuple[MissionRun, Path]) -> None:
    run, folder = driven
    check_run(run)
    assert run.success and run.collisions == 0, run.summary()
    assert verify(folder).ok
    with Ledger.open(folder) as ledger:
        assert ledger.head.hash.hex() == run.head
        assert set(ledger.robots) == {"R1", "R2"}


def test_the_log_can_be_stored(driven: tuple[MissionRun, Path], tmp_path: Path) -> None:
    run, _ = driven
    save_log(run, tmp_path)
    summary = json.loads((tmp_path / MARKER).read_text())
    assert summary == run.summary()
    assert summary["goal"] == GOAL and summary["robot"] == "R1" and summary["head"] == run.head
    lines = (tmp_path / "decisions.jsonl").read_text().splitlines()
    assert [json.loads(line)["what"] for line in lines] == [d.what for d in run.result.decisions]
    table = run.log()
    assert list(table.what) == [d.what for d in run.result.decisions]
    assert table.time_s.is_monotonic_increasing
    places = zip(run.times_s, run.paths_xy_m["R1"], strict=True)
    since_s = run.times_s[-1] - run.seconds - 0.01
    way_m = sum(math.dist(a, b) for a, b in pairwise(xy for t, xy in places if t >= since_s))
    assert summary["driven_m"] == pytest.approx(way_m, abs=0.01)
    assert way_m > run.task.places["R1"].distance_to_m(run.final_pose.xy_m) > 1.0
    assert way_m <= MAX_SPEED_M_S * run.seconds + 0.01
    mission_s = table.time_s.iloc[-1] - table.time_s.iloc[0]
    assert mission_s <= summary["simulated_s"] + 0.1 <= SHORT.limit_s + 1
    truth, odometry = (np.loadtxt(tmp_path / f"R1_{of}.tum") for of in ("truth", "odometry"))
    assert np.allclose(truth[:, 0], run.times_s) and np.allclose(odometry[:, 0], run.times_s)
    assert np.allclose(truth[:, 1:3], run.paths_xy_m["R1"])
    assert np.allclose(2 * np.arctan2(*truth[-1, 6:]), run.final_pose.yaw_rad)
    assert np.ptp(odometry - truth, axis=0)[:3].max() > 0  # it is noisy
    assert len(list(tmp_path.glob("*.tum"))) == 2 * len(run.task.places)


def test_a_member_may_have_appended_anything(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its newest is no panorama: that leads nobody, and ends nobody's mission."""
    monkeypatch.setattr(mission, "goal_from", lambda *given: Nowhere())
    outset = mission.set_out(hamlet(), 2, 2, "R1", GOAL, RIG)
    with team_ledger(tmp_path / "ledger", ["R1", "R2", "X"], 1) as ledger:
        ledger.publish("X", simulated_key(1, "X"), b"hello", "start", 0)
        robots = assemble(outset[0], ledger, 1, examine=blind().record)
        robots["R2"].observe(look=True)
        config = MissionConfig(limit_s=2.0)
        run = mission.send("R1", robots["R1"], outset, ledger, blind(), config)
    assert not run.result.arrived and [*run.panoramas] == ["R2"]


@pytest.mark.parametrize(
    ("x_m", "at_goal", "range_m"), [(8.5, True, 1.5), (10.5, False, 3.5), (3.0, False, 2.0)],
    ids=["near", "far", "behind a wall"],
)  # fmt: skip
def test_only_who_is_near_and_in_sight_of_the_goal_is_there(
    x_m: float, at_goal: bool, range_m: float
) -> None:
    goal = worlds.box("goal", (6.0, 0.0), (2.0, 2.0, 2.0), worlds.plain(worlds.RED))
    wall = worlds.box("wall", (4.0, 0.0), (0.2, 12.0, 3.0), worlds.plain(worlds.BLUE))
    scene = worlds.world(goal, wall)
    found = mission.is_at(scene, GroundTruth(scene), "goal", Pose(x_m, 0.0), RIG)
    assert found == (at_goal, pytest.approx(range_m))


def test_the_robot_is_not_told_the_goals_name(driven: tuple[MissionRun, Path]) -> None:
    run, folder = driven
    text = json.dumps([[d.what, d.why, dict(d.values)] for d in run.result.decisions])
    assert not any(o.name in text for o in run.scene.objects)
    for path in folder.rglob("*"):
        if path.is_file():
            assert GOAL.encode() not in path.read_bytes()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"goal": "nothing"}, "no object 'nothing'"),
        ({"robot": "R7"}, "no robot 'R7'"),
        ({"n_robots": 1}, "expected 2 to 20"),
    ],
)
def test_a_mission_that_cannot_be_leaves_nothing(
    options: dict, message: str, tmp_path: Path
) -> None:
    with pytest.raises(MissionError, match=message):
        mission.run_mission(hamlet(), tmp_path / "ledger", rig=RIG, **options)
    assert list(tmp_path.iterdir()) == []


def test_an_existing_ledger_is_not_driven_into(driven: tuple[MissionRun, Path]) -> None:
    _, folder = driven
    before = digest_of(folder)
    with pytest.raises(LedgerError):
        mission.run_mission(hamlet(), folder, seed=1, n_robots=2, goal=GOAL, rig=RIG, config=SHORT)
    assert digest_of(folder) == before


def digest_of(folder: Path) -> str:
    total = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.is_file() and not path.name.endswith(("-wal", "-shm")):
            total.update(path.name.encode() + path.read_bytes())
    return total.hexdigest()


# --- what a robot may know ---


SINGLE = CameraRig(n_views=1, width_px=320, height_px=240, field_of_view_deg=60.0)
SEEN_FROM = [Pose(-10.0, 0.0, 0.2), Pose(-5.0, 9.5, -1.5)]
HIDDEN, IN_VIEW = Pose(-2.0, -6.0, 0.3), Pose(-10.5, 0.5, 0.6)
STRAIGHT = Pose(-12.0, 9.0, 0.0)  # it arrives in half a minute


def mover(angle_rad: float, offset_xy_m: tuple[float, float]) -> Callable[[Pose], Pose]:
    """Where a pose lies when the world is turned and shifted."""

    def there(pose: Pose) -> Pose:
        x_m, y_m = rotation_z(angle_rad)[:2, :2] @ pose.xy_m + offset_xy_m
        return Pose(float(x_m), float(y_m), pose.yaw_rad + angle_rad)

    return there


def drive_from(
    scene: Scene, place: Callable[[Pose], Pose], start: Pose, limit_s: float
) -> tuple[MissionResult, Pose]:
    """R1 seeks what R2 sees; ``place`` says where the hamlet's poses lie in this scene."""
    simulator = Simulator(scene, {"R1": place(start)}, seed=3, rig=RIG)
    renderer = simulator.renderer
    blobs = {b"R2": renderer.render(place(Pose(0.0, 6.0, 2.0)), RIG).encode()}
    perception = learned_perception()
    result = drive_mission(
        "R1",
        worlds.Body(simulator),
        lambda: {"R2": Published(b"R2")},
        LandmarkIndex(
            blobs.__getitem__, lambda digest: None, perception.stored, perception.compare
        ),
        goal_from([renderer.render(place(p), SINGLE) for p in SEEN_FROM]),
        perception,
        MissionConfig(limit_s=limit_s),
    )
    return result, simulator.pose("R1")


@pytest.mark.parametrize("shift_m", [(0.0, 0.0), (64.0, -32.0)], ids=["turned", "moved"])
@pytest.mark.parametrize(
    ("start", "limit_s"),
    [(HIDDEN, 8.0), (IN_VIEW, 30.0), (STRAIGHT, 60.0)],
    ids=["goal hidden", "goal in view", "arrives"],
)
def test_names_and_the_worlds_frame_are_nothing_to_a_robot(
    start: Pose, limit_s: float, shift_m: tuple[float, float]
) -> None:
    """The scene is turned, shifted, and all its objects are renamed: the log stays as it is.

    A turn by a right angle changes not one pixel, but last bits of range readings: in view of the
    goal two ways have parted after 44 s, between two that were as good. A shift changes the last
    bit of coordinates, so a few pixels in a thousand, by little: what is decided first stays.
    """
    here = on_grid(hamlet(), 400.0)  # so wide that its edge is not felt
    elsewhere = moved(here, np.pi / 2, shift_m)
    there = mover(np.pi / 2, shift_m)
    assert {o.name for o in here.objects}.isdisjoint(o.name for o in elsewhere.objects)
    first, stayed = drive_from(here, lambda pose: pose, start, limit_s)
    second, went = drive_from(elsewhere, there, start, limit_s)
    assert {r.decisions[-1].what for r in (first, second)} <= {"arrived", "gave up"}
    exact = shift_m == (0.0, 0.0)
    compared = slice(None) if exact else slice(1)
    own, others = first.decisions[compared], second.decisions[compared]
    assert [(d.what, d.why, d.look) for d in own] == [(d.what, d.why, d.look) for d in others]
    if not exact:
        return
    for a, b in zip(own, others, strict=True):
        assert b.time_s == pytest.approx(a.time_s, abs=1e-9)
        assert a.values.keys() == b.values.keys()
        for key, value in a.values.items():
            assert b.values[key] == (
                value if isinstance(value, str) else pytest.approx(value, abs=0.11)
            )
    assert went.distance_to_m(there(stayed).xy_m) < 0.02


# --- in the suburb, and at the barn ---


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_the_barn_is_reached_from_every_start(seed: int, tmp_path: Path) -> None:
    run = mission.run_mission(load_scene(SCENES / "barn.yaml"), tmp_path / "ledger", seed=seed)
    check_run(run)
    assert run.success and run.collisions == 0, run.summary()


@pytest.mark.slow
def test_a_mission_in_the_suburb_is_true_or_given_up_and_the_same_twice(tmp_path: Path) -> None:
    scene = load_scene(SCENES / "suburb.yaml")
    first, second, other = (
        mission.run_mission(scene, tmp_path / f"ledger {k}", seed=seed)
        for k, seed in enumerate((1, 1, 0))
    )
    for run in (first, other):
        check_run(run)
        assert run.collisions == 0 and run.seconds <= MissionConfig().limit_s + 5
    assert first.result.decisions == second.result.decisions
    assert first.head == second.head
    assert np.array_equal(first.paths_xy_m["R1"], second.paths_xy_m["R1"])
    assert first.summary() == second.summary()

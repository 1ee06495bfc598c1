import numpy as np
import pytest
import worlds

from vrchain.errors import MissionError, PoseError
from vrchain.experiments.reproduction.results import suburb
from vrchain.geometry import Pose
from vrchain.robot import MAX_TURN_RAD_S, Drive, Wander, wander
from vrchain.seeding import generator
from vrchain.simulation.sensors import SensorNoise
from vrchain.simulation.simulator import Simulator
from vrchain.world.model import ROBOT_RADIUS_M, Scene, SceneObject, place
from vrchain.world.truth import GroundTruth

EXACT = SensorNoise(0.0, 0.0, 0.0, 0.0, 0.0)
GREY = worlds.plain((120, 120, 120))
EMPTY = worlds.world(extent_m=(100.0, 100.0))


@pytest.mark.parametrize("speed_m_s", [0.05, 0.7, 1000.0])
@pytest.mark.parametrize("duration_s", [0.05, 1.0, 240.0])
@pytest.mark.parametrize("yaw_rad", [0.0, 0.9, np.pi])
def test_a_wall_is_never_passed(speed_m_s: float, duration_s: float, yaw_rad: float) -> None:
    """Neither ahead nor backwards."""
    simulator = Simulator(worlds.walled(), {"R1": Pose(4.2, 0, yaw_rad)}, seed=0)
    backwards = abs(yaw_rad) > np.pi / 2
    for _ in range(max(2, min(300, int(240 / duration_s)))):
        simulator.step({"R1": Drive(-speed_m_s if backwards else speed_m_s)}, duration_s)
    path = simulator.path_xy_m("R1")
    assert simulator.scene.is_free(path).all()
    gap_m = 5.0 - ROBOT_RADIUS_M - path[:, 0].max()
    if duration_s * speed_m_s >= 0.05:  # it had the time to get there
        assert 0 < gap_m < 0.02
        assert simulator.collisions("R1") == 1


@pytest.mark.parametrize(
    ("thing", "x_m"),
    [
        (worlds.box("post", (3, 0.2), (0.05, 0.05, 1.0), GREY), (2.5, 3.0)),
        (worlds.box("roof", (3, 0), (2, 2, 0.5), GREY, base_m=2.2), (6.999, 7.001)),
    ],
    ids=["a thin post", "what hangs above it"],
)
def test_what_is_in_the_way_stops_a_robot(thing: SceneObject, x_m: tuple[float, float]) -> None:
    simulator = Simulator(worlds.world(thing), {"R1": Pose(0, 0)}, seed=0)
    simulator.step({"R1": Drive(0.7)}, 10.0)
    assert x_m[0] < simulator.pose("R1").x_m < x_m[1]
    assert simulator.collisions("R1") == (thing.name == "post")


def test_only_what_is_low_enough_stops_the_robot() -> None:
    """A ramp that rises from 1 m at x = 0 to 5 m at x = 4 is in the way up to x = 0.6."""
    corners = [(0.0, -1.0, 1.0), (0.0, 1.0, 1.0), (4.0, 1.0, 5.0), (4.0, -1.0, 5.0)]
    surface = worlds.quad(corners, GREY)
    ramp = place("ramp", "ramp", "ramp", [surface], Pose(0, 0), landmark=False)
    simulator = Simulator(worlds.world(ramp), {"R1": Pose(3, 0, np.pi)}, seed=0)
    assert simulator.true_ranges_m("R1")[0] == pytest.approx(2.4, abs=1e-4)
    simulator.step({"R1": Drive(0.7)}, 10.0)
    assert simulator.pose("R1").x_m == pytest.approx(0.6 + ROBOT_RADIUS_M, abs=0.02)


@pytest.mark.parametrize("yaw_rad", [0.0, 1.0, 2.5, -2.0])
def test_the_edge_of_the_map_is_a_wall(yaw_rad: float) -> None:
    simulator = Simulator(worlds.world(), {"R1": Pose(17, -15, yaw_rad)}, seed=0)
    simulator.step({"R1": Drive(0.7)}, 90.0)
    assert np.abs(simulator.path_xy_m("R1")).max() < 20 - ROBOT_RADIUS_M
    assert simulator.collisions("R1") == 1


def test_a_collision_is_counted_once_a_contact() -> None:
    simulator = Simulator(worlds.walled(), {"R1": Pose(4.0, 0)}, seed=0)
    assert not simulator.observe("R1").bumped
    for _ in range(10):  # run into it, and go on pushing, a little askew
        simulator.step({"R1": Drive(0.5, 0.05)}, 0.5)
    assert simulator.collisions("R1") == 1
    assert simulator.observe("R1").bumped
    simulator.step({"R1": Drive(0.0, 0.5)}, 0.5)  # turning is no contact, nor does it end one
    assert not simulator.observe("R1").bumped
    simulator.step({"R1": Drive(0.2, -0.5)}, 0.5)
    assert simulator.collisions("R1") == 1
    simulator.step({"R1": Drive(-0.5)}, 1.0)  # away, and into it again
    assert simulator.collisions("R1") == 1
    simulator.step({"R1": Drive(0.5)}, 2.0)
    assert simulator.collisions("R1") == 2


@pytest.mark.parametrize("offset_m", [0.0, 0.5])
def test_two_robots_never_overlap(offset_m: float) -> None:
    poses = {"R1": Pose(0, 0), "R2": Pose(5, offset_m, np.pi), "R3": Pose(9, 9)}
    simulator = Simulator(EMPTY, poses, seed=0)
    for _ in range(20):
        simulator.step({"R1": Drive(0.7), "R2": Drive(0.4)}, 1.0)
        assert simulator.pose("R1").distance_to_m(simulator.pose("R2").xy_m) > 2 * ROBOT_RADIUS_M
    assert simulator.collisions("R1") == simulator.collisions("R2") == 1
    assert simulator.collisions("R3") == 0
    assert simulator.pose("R3") == Pose(9, 9)


def test_commands_beyond_the_limits_are_cut() -> None:
    simulator = Simulator(EMPTY, {"R1": Pose(0, 0), "R2": Pose(5, 5)}, seed=0)
    simulator.step({"R1": Drive(9.0, 0.0), "R2": Drive(0.0, -99.0)}, 0.5)
    assert simulator.pose("R1").x_m == pytest.approx(0.35)
    assert simulator.pose("R2").yaw_rad == pytest.approx(-MAX_TURN_RAD_S / 2)
    assert np.degrees(MAX_TURN_RAD_S) == pytest.approx(140)


def test_a_circle_ends_where_it_began() -> None:
    simulator = Simulator(EMPTY, {"R1": Pose(1, 2, 0.3)}, seed=0, noise=EXACT)
    assert simulator.robots == ("R1",) and simulator.observe("R1").time_ns == 0
    for _ in range(100):
        simulator.step({"R1": Drive(0.5, 0.25)}, 2 * np.pi / 0.25 / 100)
    assert simulator.clock_ns == simulator.observe("R1").time_ns  # nanoseconds
    assert simulator.clock_ns == pytest.approx(2 * np.pi / 0.25 * 1e9, abs=100)
    assert simulator.times_s[-1] == simulator.clock_ns / 1e9
    pose, path = simulator.pose("R1"), simulator.path_xy_m("R1")
    assert pose.distance_to_m([1, 2]) < 1e-6
    assert pose.yaw_rad == pytest.approx(0.3)
    assert path.shape == (101, 2)
    assert np.linalg.norm(path[50] - path[0]) == pytest.approx(4.0, rel=1e-3)  # its diameter


@pytest.mark.parametrize(
    ("pose", "message"),
    [
        (Pose(5.01, 0), "'wall'"),
        (Pose(4.7, 3), "'wall'"),
        (Pose(19.9, 19.9), "off the map"),
        (Pose(-500, 0), "off the map"),
        (Pose(float("nan"), 0), "finite"),
        (Pose(0, 0, float("inf")), "finite"),
        (Pose(0.5, 0.5), "apart"),
    ],
)
def test_robots_start_only_where_they_can_stand(pose: Pose, message: str) -> None:
    with pytest.raises(PoseError, match=message):
        Simulator(worlds.walled(), {"R1": Pose(0, 0), "R2": pose}, seed=0)


def test_refused_commands_move_nobody() -> None:
    simulator = Simulator(EMPTY, {"R1": Pose(0, 0)}, seed=0)
    with pytest.raises(MissionError, match="no robot 'R7'; the robots are 'R1'"):
        simulator.step({"R1": Drive(0.5), "R7": Drive(0.5)}, 1.0)
    with pytest.raises(ValueError, match="finite"):
        simulator.step({"R1": Drive(float("nan"))}, 1.0)
    for duration_s in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(ValueError, match="duration"):
            simulator.step({"R1": Drive(0.5)}, duration_s)
    for ask in (simulator.observe, simulator.pose, simulator.collisions, simulator.path_xy_m):
        with pytest.raises(MissionError, match="no robot"):
            ask("R7")
    assert simulator.pose("R1") == Pose(0, 0)
    assert simulator.clock_ns == 0
    assert len(simulator.path_xy_m("R1")) == 1


def test_two_processes_drive_the_same_way() -> None:
    code = """
import hashlib, json, sys, worlds
from vrchain.geometry import Pose
from vrchain.robot import Wander, wander
from vrchain.seeding import generator
from vrchain.simulation.simulator import Simulator
simulator = Simulator(worlds.maze(), {"R1": Pose(0, 0), "R2": Pose(-3, 1, 2.0)}, seed=5)
lazy = "open3d" not in sys.modules and "pyrender" not in sys.modules
draws = {r: generator(5, "wander", r) for r in simulator.robots}
states = {r: Wander() for r in simulator.robots}
digest = hashlib.sha256()
for _ in range(50):
    commands = {}
    for r in simulator.robots:
        seen = simulator.observe(r)
        digest.update(seen.range_ring_m.tobytes() + repr((seen.odometry, seen.bumped)).encode())
        commands[r], states[r] = wander(seen, draws[r], states[r])
    simulator.step(commands, 0.25)
poses = [repr(simulator.pose(r)) for r in simulator.robots]
print(json.dumps({"digest": digest.hexdigest(), "poses": poses, "lazy": lazy}))
"""
    first, second = worlds.in_two_processes(code)
    assert first == second
    assert first["lazy"]


def wander_about(minutes: float, seed: int, scene: Scene, starts: dict[str, Pose]) -> Simulator:
    simulator = Simulator(scene, starts, seed=seed)
    draws = {r: generator(seed, "wander", r) for r in simulator.robots}
    states = {r: Wander() for r in simulator.robots}
    for _ in range(int(minutes * 60 / 0.25)):
        commands = {}
        for r in simulator.robots:
            commands[r], states[r] = wander(simulator.observe(r), draws[r], states[r])
        simulator.step(commands, 0.25)
    return simulator


def crossings(truth: GroundTruth, path_xy_m: np.ndarray) -> int:
    """How many rays along and across a robot's way meet anything, by ray casting alone.

    At four heights: from place to place on the middle line and on both sides, and, at every place,
    straight across the robot.
    """
    step = np.diff(path_xy_m, axis=0)
    moved = np.linalg.norm(step, axis=1) > 1e-9
    start, step = path_xy_m[:-1][moved], step[moved]
    left = 0.25 * step[:, ::-1] * (-1, 1) / np.linalg.norm(step, axis=1, keepdims=True)
    ways = [(start + side * left, step) for side in (-1, 0, 1)] + [(start - left, 2 * left)]
    met = 0
    for height_m in (0.1, 0.3, 0.6, 1.0):
        for origin, direction in ways:
            origins = np.insert(origin, 2, height_m, axis=1)
            _, share = truth.cast(origins, np.insert(direction, 2, 0.0, axis=1))
            met += int((share <= 1).sum())
    return met


@pytest.mark.parametrize("scene", [worlds.walled(), worlds.maze()])
def test_crossings_are_counted(scene: Scene) -> None:
    """A straight way that heeds nothing meets the wall at each height; in the maze, something."""
    path = np.stack([np.linspace(-9, 9, 200), np.full(200, 0.3)], axis=1)
    assert crossings(GroundTruth(scene), path) >= 12
    assert crossings(GroundTruth(scene), path[:20]) == 0


def check_wandering(simulator: Simulator, minutes: float) -> None:
    for robot in simulator.robots:
        path = simulator.path_xy_m(robot)
        assert simulator.scene.is_free(path).all()
        assert crossings(simulator.truth, path) == 0
        way_m = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
        print(f"{robot}: {way_m:.0f} m, {simulator.collisions(robot)} collisions, no crossing")
        assert way_m > 15 * minutes  # it does not hang about
        assert simulator.collisions(robot) <= 0.5 * minutes


IN_MAZE = {"R1": Pose(0, 0), "R2": Pose(-3, 1, 2.0), "R3": Pose(6, -5)}


def test_wandering_in_a_maze() -> None:
    check_wandering(wander_about(1.0, 0, worlds.maze(), IN_MAZE), 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(5))
def test_wandering_in_a_maze_for_long(seed: int) -> None:
    check_wandering(wander_about(10.0, seed, worlds.maze(), IN_MAZE), 10.0)


def wander_about_the_suburb(minutes: float, seed: int) -> Simulator:
    """Two robots from free places."""
    places = generator(seed, "starts").uniform(-0.5, 0.5, (200, 2)) * suburb().extent_m
    first, *others = places[suburb().is_free(places, 1.0)]
    second = next(xy for xy in others if np.linalg.norm(xy - first) > 2)
    return wander_about(minutes, seed, suburb(), {"R1": Pose(*first), "R2": Pose(*second)})


def test_wandering_in_the_suburb() -> None:
    check_wandering(wander_about_the_suburb(1.0, 0), 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_wandering_in_the_suburb_for_long(seed: int) -> None:
    check_wandering(wander_about_the_suburb(10.0, seed), 10.0)

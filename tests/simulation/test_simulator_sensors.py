"""What the simulator lets a robot sense."""

import numpy as np
import pytest
import worlds

from vrchain.errors import MissionError
from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.robot import Drive
from vrchain.seeding import generator
from vrchain.simulation.sensors import N_BEAMS, RANGE_MAX_M, SensorNoise
from vrchain.simulation.simulator import Simulator
from vrchain.world.model import ROBOT_RADIUS_M

EXACT = SensorNoise(0.0, 0.0, 0.0, 0.0, 0.0)
GREY = worlds.plain((120, 120, 120))
EMPTY = worlds.world(extent_m=(100.0, 100.0))


def beam(bearing_rad: float) -> int:
    return round(bearing_rad / (2 * np.pi) * N_BEAMS) % N_BEAMS


def test_the_ring_shows_all_that_could_stop_the_robot() -> None:
    """Overhangs that rays at the scanner's height pass under, too."""
    table = worlds.box("table", (3, 0), (2, 2, 0.1), GREY, base_m=0.7)
    shelf = worlds.box("shelf", (0, 3), (2, 2, 0.1), GREY, base_m=2.0)
    simulator = Simulator(worlds.world(table, shelf), {"R1": Pose(0, 0)}, seed=0)
    ring = simulator.true_ranges_m("R1")
    assert ring[beam(0)] == pytest.approx(2.0, abs=1e-4)
    assert (ring[[beam(np.radians(a)) for a in (40, 90, 180, -40)]] == RANGE_MAX_M).all()
    simulator.step({"R1": Drive(0.7)}, 10.0)
    assert simulator.collisions("R1") == 1
    assert simulator.true_ranges_m("R1").min() == pytest.approx(ROBOT_RADIUS_M, abs=0.02)


def test_without_noise_odometry_is_the_truth_in_the_robots_own_frame() -> None:
    start = Pose(3, -2, 2.0)
    simulator = Simulator(EMPTY, {"R1": start}, seed=0, noise=EXACT)
    draws = generator(0, "drive")
    for _ in range(50):
        simulator.step({"R1": Drive(draws.uniform(-0.7, 0.7), draws.uniform(-2, 2))}, 0.4)
    pose, odometry = simulator.pose("R1"), simulator.observe("R1").odometry
    c, s = np.cos(start.yaw_rad), np.sin(start.yaw_rad)
    expected = np.array([[c, s], [-s, c]]) @ (pose.xy_m - start.xy_m)
    assert np.allclose(odometry.xy_m, expected, atol=1e-9)
    assert odometry.yaw_rad == pytest.approx(wrap_angle_rad(pose.yaw_rad - start.yaw_rad))


def test_odometry_errs_as_much_as_it_says() -> None:
    noise = SensorNoise(scale=0.02, veer_rad_m=0.01, distance_m=0.03, turn_rad=0.05)
    straight, turned = [], []
    for seed in range(150):
        simulator = Simulator(EMPTY, {"a": Pose(0, 0), "b": Pose(9, 9)}, seed=seed, noise=noise)
        simulator.step({"a": Drive(0.7), "b": Drive(0.0, 1.0)}, 2.0)
        straight.append(simulator.observe("a").odometry)
        turned.append(simulator.observe("b").odometry)
    along_m = np.array([o.x_m for o in straight])
    yaw_rad = np.array([o.yaw_rad for o in straight])
    twist_rad = np.array([o.yaw_rad for o in turned])
    assert along_m.mean() == pytest.approx(1.4, abs=0.01)
    assert along_m.std() == pytest.approx(np.hypot(0.02 * 1.4, 0.03 * np.sqrt(1.4)), rel=0.15)
    assert yaw_rad.std() == pytest.approx(0.01 * 1.4, rel=0.15)
    assert twist_rad.mean() == pytest.approx(2.0, abs=0.02)
    assert twist_rad.std() == pytest.approx(0.05 * np.sqrt(2), rel=0.15)


def test_odometry_does_not_drift_at_rest_nor_move_when_turning() -> None:
    simulator = Simulator(EMPTY, {"R1": Pose(0, 0)}, seed=0)
    simulator.step({"R1": Drive(0.5, 0.3)}, 2.0)
    before = simulator.observe("R1").odometry
    simulator.step({}, 600.0)
    simulator.step({"R1": Drive()}, 600.0)
    assert simulator.observe("R1").odometry == before
    simulator.step({"R1": Drive(0.0, 1.0)}, 10.0)
    after = simulator.observe("R1").odometry
    assert (after.x_m, after.y_m) == (before.x_m, before.y_m)
    assert after.yaw_rad != before.yaw_rad
    blocked = Simulator(worlds.walled(), {"R1": Pose(4.59, 0)}, seed=0)
    blocked.step({"R1": Drive(0.7)}, 20.0)
    assert blocked.observe("R1").odometry.x_m < 0.03


@pytest.mark.parametrize("yaw_rad", [0.0, 0.5, -2.0])
def test_the_range_ring_measures_a_wall(yaw_rad: float) -> None:
    simulator = Simulator(worlds.walled(), {"R1": Pose(1.1, 0, yaw_rad)}, seed=0)
    bearing = 2 * np.pi * np.arange(N_BEAMS) / N_BEAMS
    with np.errstate(divide="ignore"):
        wall_m = 3.9 / np.cos(bearing + yaw_rad)
    expected = np.where((wall_m > 0) & (wall_m < RANGE_MAX_M), wall_m, RANGE_MAX_M)
    assert np.allclose(simulator.true_ranges_m("R1"), expected, atol=1e-4)
    errors = []
    for _ in range(40):
        simulator.step({}, 0.1)
        ring = simulator.observe("R1").range_ring_m
        assert ring.shape == (N_BEAMS,)
        assert (ring[expected == RANGE_MAX_M] == RANGE_MAX_M).all()
        errors.append((ring - expected)[expected < RANGE_MAX_M - 0.2])
    assert np.std(errors) == pytest.approx(0.02, rel=0.1)
    assert abs(np.mean(errors)) < 0.002


def test_the_range_ring_sees_other_robots_and_the_edge() -> None:
    """Left of it is left in the ring, and the edge, at x = 20, is right."""
    poses = {"R1": Pose(15, 0, np.pi / 2), "R2": Pose(15, 4), "R3": Pose(11, 0)}
    simulator = Simulator(worlds.world(), poses, seed=0)
    ring = simulator.true_ranges_m("R1")
    assert ring[beam(0)] == pytest.approx(4 - ROBOT_RADIUS_M)
    assert ring[beam(np.pi / 2)] == pytest.approx(4 - ROBOT_RADIUS_M)
    assert ring[beam(-np.pi / 2)] == pytest.approx(5.0)
    assert ring[beam(np.pi)] == RANGE_MAX_M
    assert ring[beam(np.radians(10))] == RANGE_MAX_M  # past R2


def test_observing_changes_nothing() -> None:
    simulator = Simulator(worlds.yard(), {"R1": Pose(0, 0)}, seed=0)
    first, second = simulator.observe("R1"), simulator.observe("R1")
    assert first.range_ring_m.tobytes() == second.range_ring_m.tobytes()
    simulator.step({}, 0.1)
    assert first.range_ring_m.tobytes() != simulator.observe("R1").range_ring_m.tobytes()


def test_looking_gives_the_panorama_of_where_the_robot_is() -> None:
    start = Pose(0, 0, 0.3)
    simulator = Simulator(worlds.yard(), {"R1": start}, seed=0, rig=worlds.SMALL_RIG)
    assert simulator.observe("R1").panorama is None
    simulator.step({"R1": Drive(0.7, 0.2)}, 3.0)
    seen = simulator.observe("R1", look=True).panorama
    assert seen is not None
    expected = simulator.renderer.render(simulator.pose("R1"), worlds.SMALL_RIG)
    assert np.array_equal(seen.views, expected.views)
    assert not np.array_equal(seen.views, simulator.renderer.render(start, seen.rig).views)


def test_robots_see_each_other_but_not_themselves() -> None:
    poses = {"R1": Pose(0, 0), "R2": Pose(4, 0, 1.0), "R3": Pose(0, 3, 2.0)}
    simulator = Simulator(worlds.yard(), poses, seed=0, rig=worlds.SMALL_RIG)
    assert simulator.others("R2") == {"R1": poses["R1"], "R3": poses["R3"]}
    seen = simulator.observe("R1", look=True).panorama
    alone = simulator.renderer.render(poses["R1"], worlds.SMALL_RIG)
    changed = (seen.views != alone.views).any(axis=-1)
    ids, _ = simulator.truth.look(poses["R1"], worlds.SMALL_RIG, simulator.others("R1"))
    assert set(np.unique(ids[ids < -1])) == {-2, -3}
    assert changed[ids < -1].mean() > 0.9
    assert changed[ids >= -1].mean() < 0.001
    assert not changed[4].any()  # behind it is nobody, nor its own body
    with pytest.raises(MissionError, match="no robot 'R7'"):
        simulator.others("R7")


def test_one_robots_noise_does_not_depend_on_who_else_is_there() -> None:
    rings = []
    for others in ({}, {"R0": Pose(30, 30)}, {"R9": Pose(-30, 30)}):
        poses = {**others, "R1": Pose(0, 0)} if "R0" in others else {"R1": Pose(0, 0), **others}
        simulator = Simulator(EMPTY, poses, seed=4)
        simulator.step({name: Drive(0.6, 0.1) for name in poses}, 3.0)
        rings.append(simulator.observe("R1"))
    assert rings[0].odometry == rings[1].odometry == rings[2].odometry
    assert (rings[0].range_ring_m == rings[2].range_ring_m).all()


def test_a_robot_cannot_tell_where_in_the_world_it_is() -> None:
    """The same yard, shifted and turned: the same odometry and the same ranges."""
    shift, angle = np.array([30.0, -20.0]), 0.7
    observations = []
    for moved in (False, True):
        turn, offset = (angle, shift) if moved else (0.0, np.zeros(2))
        c, s = np.cos(turn), np.sin(turn)
        boxes = []
        for i in range(5):
            centre = np.array([[c, -s], [s, c]]) @ (4 * np.cos(i), 4 * np.sin(i)) + offset
            boxes.append(worlds.box(f"b{i}", tuple(centre), (1, 1.5, 1), GREY, yaw_rad=i + turn))
        scene = worlds.world(*boxes, extent_m=(200.0, 200.0))
        simulator = Simulator(scene, {"R1": Pose(*offset, turn)}, seed=0)
        simulator.step({"R1": Drive(0.5, 0.4)}, 3.0)
        observations.append(simulator.observe("R1"))
    assert np.allclose(observations[0].range_ring_m, observations[1].range_ring_m, atol=1e-3)
    assert np.allclose(observations[0].odometry.xy_m, observations[1].odometry.xy_m)

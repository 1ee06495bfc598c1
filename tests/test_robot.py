import dataclasses

import numpy as np
import pytest
import worlds
from hypothesis import given
from hypothesis import strategies as st

from vrchain.errors import SpecError
from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.panorama import Panorama
from vrchain.robot import (
    MAX_SPEED_M_S,
    MAX_TURN_RAD_S,
    UNSEEN_M,
    Drive,
    Observation,
    UpdateMonitor,
    UpdateRules,
    Wander,
    free_bearing_rad,
    free_distances_m,
    newcomer_m,
    steer,
    wander,
)
from vrchain.seeding import generator
from vrchain.simulation.simulator import Simulator
from vrchain.world.model import ROBOT_RADIUS_M
from vrchain.world.render import Renderer

OPEN_RING = np.full(72, 8.0)
BEAMS = 2 * np.pi * np.arange(72) / 72
GREY = worlds.plain((120, 120, 120))


def seen(
    t_s: float = 0.0,
    pose: Pose | None = None,
    ring: np.ndarray = OPEN_RING,
    bumped: bool = False,
    panorama: Panorama | None = None,
) -> Observation:
    return Observation(round(t_s * 1e9), pose or Pose(0, 0), ring, bumped, panorama)


def wall_ring(distance_m: float, bearing_rad: float = 0.0) -> np.ndarray:
    """The ring beside one endless wall."""
    with np.errstate(divide="ignore"):
        wall_m = distance_m / np.cos(wrap_angle_rad(BEAMS - bearing_rad))
    return np.where((wall_m > 0) & (wall_m < 8), wall_m, 8.0)


# --- when to publish ---


def test_the_first_look_is_published_then_the_way_driven_counts() -> None:
    monitor = UpdateMonitor(UpdateRules(distance_m=5.0, max_age_s=1e6))
    assert monitor.due(seen()) == monitor.due(seen(5.0)) == "start"  # until it is
    monitor.published(seen())
    for i in range(1, 50):  # to and fro: a long way, but never far
        observation = seen(i, Pose(0.1 * (i % 2), 0))
        assert monitor.due(observation) is None
        assert monitor.due(observation) is None  # asking twice adds nothing
    assert monitor.travelled_m == pytest.approx(4.9)
    assert monitor.due(seen(50, Pose(0.0, 0.11))) == "distance"
    monitor.published(seen(50, Pose(0.0, 0.11)))
    assert monitor.due(seen(51, Pose(0.0, 5.10))) is None
    assert monitor.due(seen(52, Pose(0.0, 5.12))) == "distance"


def test_the_time_rule_counts_from_the_last_publication() -> None:
    monitor = UpdateMonitor(UpdateRules(max_age_s=60.0))
    monitor.published(seen(100.0))
    due = [(159.999, None), (160.0, "time"), (161.0, "time")]  # until it is obeyed
    assert [(t_s, monitor.due(seen(t_s))) for t_s, _ in due] == due
    monitor.published(seen(161.0))
    assert monitor.due(seen(220.0)) is None


def views_at(renderer: Renderer, pose: Pose) -> Observation:
    panorama = renderer.render(pose, worlds.SMALL_RIG)
    return seen(0.0, Pose(0.01 * pose.x_m, 0), panorama=panorama)  # odometry that hardly moves


def test_the_view_rule_fires_on_a_new_view_only() -> None:
    renderer = Renderer(worlds.yard())
    monitor = UpdateMonitor(UpdateRules(view_change=0.25))
    monitor.published(views_at(renderer, Pose(0, 0)))
    for yaw_rad in np.linspace(0, 2 * np.pi, 13):
        assert monitor.due(views_at(renderer, Pose(0, 0, yaw_rad))) is None
    assert monitor.due(views_at(renderer, Pose(0.2, 0, 2.0))) is None
    assert monitor.due(views_at(renderer, Pose(4, 2, 2.0))) == "view"
    assert monitor.due(seen()) is None  # without looking it cannot know
    monitor.published(seen())  # of nothing: no view is new against it
    assert monitor.due(views_at(renderer, Pose(0, 0))) is None
    monitor.published(views_at(renderer, Pose(4, 2)))
    assert monitor.due(views_at(renderer, Pose(4, 2, 1.0))) is None
    assert monitor.due(views_at(renderer, Pose(0, 0))) == "view"


def test_turning_on_the_spot_never_publishes() -> None:
    """Default rules, a real robot with its noise, five turns within the age limit."""
    simulator = Simulator(worlds.yard(), {"R1": Pose(0, 0)}, seed=1, rig=worlds.SMALL_RIG)
    monitor = UpdateMonitor()
    monitor.published(simulator.observe("R1", look=True))
    for _ in range(25):
        simulator.step({"R1": Drive(0.0, 0.7)}, 2.1)
        assert monitor.due(simulator.observe("R1", look=True)) is None
    assert monitor.travelled_m == 0


@pytest.mark.parametrize("key", [f.name for f in dataclasses.fields(UpdateRules)])
@pytest.mark.parametrize("value", [0, -1.0, float("nan"), "5", None])
def test_impossible_rules_are_refused(key: str, value: object) -> None:
    with pytest.raises(SpecError, match=f"{key} must be a number above 0"):
        UpdateRules(**{key: value})


# --- how to drive ---


def test_free_distances_of_a_wall() -> None:
    free_m = free_distances_m(wall_ring(3.0), [0.0, np.pi, np.pi / 2], radius_m=0.5)
    assert free_m[0] == pytest.approx(2.5, abs=0.02)
    assert free_m[1:] == pytest.approx([7.5, 7.5], abs=0.01)


def test_a_disc_does_not_fit_through_a_gap_narrower_than_itself() -> None:
    for gap_m, fits in [(0.8, False), (1.4, True)]:
        half_rad = np.arctan2(gap_m / 2, 1.0)
        ring = wall_ring(1.0)
        ring[np.abs(wrap_angle_rad(BEAMS)) < half_rad] = 8.0
        assert (free_distances_m(ring, 0.0, 0.5)[0] > 2) == fits


def test_in_the_open_the_robot_goes_where_it_wants() -> None:
    for bearing_rad in np.linspace(-3.1, 3.1, 40):
        chosen = free_bearing_rad(bearing_rad, OPEN_RING)
        assert chosen == pytest.approx(bearing_rad)
    assert steer(0.0, OPEN_RING) == Drive(MAX_SPEED_M_S, 0.0)
    left, right = steer(0.4, OPEN_RING), steer(-0.4, OPEN_RING)
    assert left.turn_rad_s > 0 > right.turn_rad_s
    assert 0 < left.speed_m_s < MAX_SPEED_M_S
    back = steer(3.0, OPEN_RING)
    assert back.speed_m_s == 0 and back.turn_rad_s > 1.0


@pytest.mark.parametrize("gap_rad", [-1.2, -0.6, 0.6, 1.0])
def test_the_robot_finds_the_gap(gap_rad: float) -> None:
    ring = np.full(72, 0.8)
    ring[np.abs(wrap_angle_rad(BEAMS - gap_rad)) < 0.75] = 8.0
    for desired_rad in (0.0, gap_rad, 3.0, -2.0):
        assert abs(free_bearing_rad(desired_rad, ring) - gap_rad) < 0.25


def test_the_nearer_way_round_is_taken() -> None:
    ring = OPEN_RING.copy()
    ring[np.abs(wrap_angle_rad(BEAMS - 0.2)) < 0.5] = 1.2  # mostly to the left
    assert free_bearing_rad(0.0, ring) < 0
    assert free_bearing_rad(0.0, ring[-np.arange(72)]) > 0  # mirrored


def test_shut_in_it_turns_on_the_spot() -> None:
    ring = np.full(72, 0.6)
    assert free_bearing_rad(0.0, ring) is None
    drive = steer(0.0, ring)
    assert drive.speed_m_s == 0
    assert drive.turn_rad_s != 0


def test_it_stops_before_a_wall_that_it_is_sent_against() -> None:
    ends = [worlds.box(f"end {y}", (5, y), (4, 0.2, 2), GREY) for y in (-1.5, 1.5)]
    back = worlds.box("back", (7, 0), (0.2, 3, 2), GREY)
    simulator = Simulator(worlds.world(back, *ends), {"R1": Pose(0, 0)}, seed=0)
    speeds = []
    for _ in range(200):  # sent into a dead end
        drive = steer(0.0, simulator.observe("R1").range_ring_m)
        speeds.append(drive.speed_m_s)
        simulator.step({"R1": drive}, 0.25)
    assert speeds[0] == MAX_SPEED_M_S and min(speeds) == 0
    assert simulator.collisions("R1") == 0
    assert steer(0.0, wall_ring(0.5)).speed_m_s == 0


@given(
    st.lists(st.floats(0, 8), min_size=72, max_size=72),
    st.floats(-10, 10),
)
def test_steering_keeps_the_limits(ring: list[float], desired: float) -> None:
    drive = steer(desired, ring)
    assert 0 <= drive.speed_m_s <= MAX_SPEED_M_S
    assert abs(drive.turn_rad_s) <= MAX_TURN_RAD_S
    ahead_m = free_distances_m(ring, 0.0, ROBOT_RADIUS_M)[0]
    assert drive.speed_m_s * 1.0 <= ahead_m  # a second's way is free


@pytest.mark.parametrize("duration_s", [0.1, 0.5])
def test_it_stops_before_walls_and_rounds_a_house(duration_s: float) -> None:
    """Always towards the same far point behind a house 6 m wide, off its middle."""
    house = worlds.box("house", (6, 0.7), (4, 6, 3), GREY)
    scene = worlds.world(house)
    simulator = Simulator(scene, {"R1": Pose(0, 0)}, seed=0)
    for _ in range(int(60 / duration_s)):
        bearing = simulator.pose("R1").bearing_to_rad([15, 0.5])
        simulator.step({"R1": steer(bearing, simulator.observe("R1").range_ring_m)}, duration_s)
        if simulator.pose("R1").distance_to_m([15, 0.5]) < 0.5:
            break
    else:
        pytest.fail(f"never arrived: {simulator.pose('R1')}")
    assert simulator.collisions("R1") == 0


# --- wandering ---


def test_wandering_keeps_a_heading_until_it_is_over() -> None:
    draws = generator(0, "wander")
    first, state = wander(seen(0.0), draws)
    assert wander(seen(0.0), generator(0, "wander")) == (first, state)
    assert 8e9 <= state.until_ns <= 25e9
    _, later = wander(seen(7.9), draws, state)
    assert later == state
    _, later = wander(seen(25.1), draws, state)
    assert later != state


def test_wandering_turns_away_from_what_it_bumped_into() -> None:
    """Even where the ring shows nothing."""
    for i in range(50):
        draws = generator(i, "wander")
        drive, state = wander(seen(1.0, Pose(0, 0, 0.4), bumped=True), draws, Wander(0.4, 10**12))
        assert abs(wrap_angle_rad(state.heading_rad - 0.4)) > np.pi / 2 - 1e-9
        assert drive.speed_m_s == 0


def test_wandering_prefers_where_there_is_room() -> None:
    ring = np.full(72, 1.0)
    ring[np.abs(wrap_angle_rad(BEAMS - 2.0)) < 0.6] = 8.0
    headings = [wander(seen(ring=ring), generator(i, "w"))[1].heading_rad for i in range(40)]
    assert np.mean(np.abs(wrap_angle_rad(np.array(headings) - 2.0)) < 0.7) > 0.9


def test_wandering_prefers_where_it_has_not_been() -> None:
    been = np.array([[15.0, 0.0], [13.0, 5.0], [13.0, -5.0], [10.0, 0.0], [0.0, 0.0]])

    def back_again(been_xy_m: np.ndarray | None) -> float:
        draws = [generator(i, "w") for i in range(100)]
        minds = [wander(seen(), d, been_xy_m=been_xy_m)[1] for d in draws]
        return float(np.mean([np.cos(mind.heading_rad) > 0.7 for mind in minds]))

    assert back_again(been) < 0.05 < 0.15 < back_again(None)


# --- who comes ---


def beside(bearing_deg: float, range_m: float) -> Pose:
    bearing = np.radians(bearing_deg)
    return Pose(range_m * np.cos(bearing), range_m * np.sin(bearing), bearing + np.pi)


@pytest.mark.parametrize("bearing_deg", [0, 45, 90, -85])
def test_who_comes_nearer_is_noticed_and_who_goes_or_stands_is_not(bearing_deg: float) -> None:
    start = {"R1": Pose(0, 0), "R2": beside(bearing_deg, 1.6)}
    simulator = Simulator(worlds.world(), start, seed=0)
    before = simulator.observe("R1")
    assert newcomer_m(before, before) == np.inf
    blind = dataclasses.replace(before, range_ring_m=np.full(len(before.range_ring_m), UNSEEN_M))
    assert newcomer_m(before, blind) == np.inf  # no sensor looks, nothing came
    simulator.step({"R2": Drive(0.6)}, 0.3)
    now = simulator.observe("R1")
    assert newcomer_m(before, now) == pytest.approx(1.6 - 0.18 - ROBOT_RADIUS_M, abs=0.08)
    assert newcomer_m(now, before) > 2.0  # it goes; the time matters to nobody


def test_who_comes_from_behind_has_to_mind_itself() -> None:
    simulator = Simulator(worlds.world(), {"R1": Pose(0, 0), "R2": beside(180, 1.6)}, seed=0)
    before = simulator.observe("R1")
    simulator.step({"R2": Drive(0.6)}, 0.3)
    assert newcomer_m(before, simulator.observe("R1")) == np.inf


@pytest.mark.parametrize("seed", range(3))
def test_nothing_comes_where_everything_stands(seed: int) -> None:
    """Along walls, round corners, past a gap that opens."""
    boxes = [
        worlds.box(f"box {i}", (2.0 * i - 6.0, (-1) ** i * 1.3), (1.0, 0.8, 2.0), GREY)
        for i in range(6)
    ]
    simulator = Simulator(worlds.world(*boxes), {"R1": Pose(-9, 0)}, seed=seed)
    before, draws = simulator.observe("R1"), generator(seed, "drives")
    for _ in range(60):
        simulator.step({"R1": Drive(0.7, float(draws.normal(0.0, 0.3)))}, 0.3)
        now = simulator.observe("R1")
        assert newcomer_m(before, now) > 1.2
        before = now

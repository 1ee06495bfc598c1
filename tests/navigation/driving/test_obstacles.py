import numpy as np
import pytest
from numpy.typing import NDArray

from vrchain.geometry import Pose, placed, wrap_angle_rad
from vrchain.navigation.driving.obstacles import ObstacleMap
from vrchain.navigation.settings import GaveUp
from vrchain.robot import UNSEEN_M, beams_rad, steer

BEAMS = beams_rad(72)
HERE = Pose(0.0, 0.0)


def ring_before(x_m: float, y_m: tuple[float, float], here: Pose = HERE) -> NDArray[np.float64]:
    """The range ring before a thin wall across the x axis from y to y."""
    course = here.yaw_rad + BEAMS
    with np.errstate(divide="ignore", invalid="ignore"):
        range_m = (x_m - here.x_m) / np.cos(course)
        hits_m = here.y_m + range_m * np.sin(course)
    hit = (hits_m >= y_m[0]) & (hits_m <= y_m[1]) & (range_m > 0) & (range_m < 8)
    return np.where(hit, range_m, 8.0)


def test_the_unknown_is_taken_for_free_but_not_where_there_was_no_headway() -> None:
    met = ObstacleMap()
    assert met.course_rad(HERE, np.array([20.0, 20.0]), 1.0) == pytest.approx(np.pi / 4, abs=0.1)
    path = met.path_m(HERE, np.array([20.0, 0.0]), 1.0)
    assert np.hypot(*(path[-1] - [20.0, 0.0])) <= 1.0 and np.hypot(*path[0]) < 0.5
    assert met.course_rad(HERE, np.array([0.5, 0.0]), 1.0) is None  # there, nothing is left
    met.block(HERE, 0.0)
    assert abs(met.course_rad(HERE, np.array([6.0, 0.0]), 1.0)) > 0.2


def test_a_path_leads_around_a_wall_that_was_met_at_its_nearer_end() -> None:
    met = ObstacleMap()
    met.note(HERE, ring_before(3.0, (-6.0, 2.0)))
    path = met.path_m(HERE, np.array([8.0, 0.0]), 1.0)
    assert np.hypot(*(path[-1] - [8.0, 0.0])) <= 1.0
    crossing = path[np.abs(path[:, 0] - 3.0).argmin()]
    assert crossing[1] > 2.3  # room for the robot
    assert met.course_rad(HERE, np.array([8.0, 0.0]), 1.0) > 0.2
    straight, around = ObstacleMap().lengths_m(HERE, np.array([[8.0, 0.0]])), met.lengths_m(
        HERE, np.array([[8.0, 0.0]])
    )  # fmt: skip
    assert around[0] > straight[0] + 0.5


def test_where_no_sensor_looks_nothing_was_met() -> None:
    met, other = ObstacleMap(), ObstacleMap()
    ring = ring_before(3.0, (-6.0, 2.0))
    met.note(HERE, ring)
    other.note(HERE, np.where(np.cos(BEAMS) < 0, UNSEEN_M, ring))
    target = np.array([8.0, 0.0])
    assert np.array_equal(met.path_m(HERE, target, 1.0), other.path_m(HERE, target, 1.0))
    assert other.course_rad(HERE, np.array([-8.0, 0.0]), 1.0) == pytest.approx(np.pi, abs=0.1)


def test_what_is_gone_is_forgotten_when_a_beam_goes_through_or_long_after() -> None:
    target = np.array([6.0, 0.0])
    met = ObstacleMap()
    met.note(HERE, ring_before(2.0, (-4.0, 4.0)))
    assert abs(met.course_rad(HERE, target, 1.0)) > 0.5
    met.note(HERE, np.full(72, 8.0))
    met.note(Pose(0.0, 0.05), np.full(72, 8.0))
    assert abs(met.course_rad(HERE, target, 1.0)) < 0.3
    met.note(HERE, ring_before(4.0, (-6.0, 6.0)))
    met.driven_m += 200.0
    assert abs(met.course_rad(HERE, target, 1.0)) < 0.2


def test_shut_in_the_path_ends_before_what_shuts_in() -> None:
    met = ObstacleMap()
    met.note(HERE, np.full(72, 1.2))
    assert len(met.path_m(HERE, np.array([10.0, 0.0]), 1.0)) >= 1
    nearest = met.path_m(HERE, np.array([10.0, 0.0]), 1.0)[-1]
    assert np.hypot(*nearest) < 1.2
    assert np.isinf(met.lengths_m(HERE, np.array([[10.0, 0.0]]))).all()


def test_out_of_a_nook_there_is_a_path() -> None:
    """A wall that is nearer than paths may come to one."""
    met = ObstacleMap()
    met.note(HERE, ring_before(0.42, (-3.0, 3.0)))
    path = met.path_m(HERE, np.array([-10.0, 0.0]), 1.0)
    assert np.hypot(*(path[-1] - [-10.0, 0.0])) <= 1.0


def test_what_the_ring_sees_through_is_no_path_until_the_robot_has_been_elsewhere() -> None:
    """As between two posts, where steering does not go."""
    met, target, nothing = ObstacleMap(), np.array([6.0, 0.0]), np.full(len(BEAMS), 8.0)
    met.note(HERE, nothing)
    met.block(HERE, 0.0)
    met.note(HERE, nothing)
    assert abs(met.course_rad(HERE, target, 1.0)) > 0.2
    for x_m in (-3.5, 0.0):
        met.note(Pose(x_m, 0.0), nothing)
    assert abs(met.course_rad(HERE, target, 1.0)) < 0.1


def test_memory_begins_where_the_robot_does_and_has_an_end() -> None:
    met, far, nothing = ObstacleMap(), Pose(5000.0, -5000.0, 0.0), np.full(len(BEAMS), 8.0)
    assert np.isfinite(met.lengths_m(far, far.xy_m + np.array([[10.0, 0.0]]))).all()  # nothing met
    met.note(far, nothing)
    assert abs(met.course_rad(far, far.xy_m + np.array([1e9, 0.0]), 1.0)) < 0.1
    assert met.lengths_m(far, far.xy_m + np.array([[10.0, 0.0]]))[0] == pytest.approx(10.0, abs=0.5)
    met.note(Pose(5301.0, -5000.0), nothing)
    with pytest.raises(GaveUp, match="more than 300 m from where it began"):
        met.course_rad(Pose(5301.0, -5000.0), far.xy_m, 1.0)


def driven(here: Pose, target: NDArray[np.float64], half_m: float) -> tuple[Pose, float]:
    """Where it ends that drives there past such a wall, and after how many metres."""
    met, way_m, tick_s = ObstacleMap(), 0.0, 0.3
    for _ in range(150):
        ring = ring_before(0.0, (-half_m, half_m), here)
        met.note(here, ring)
        course = met.course_rad(here, target, 0.7)
        if course is None:
            break
        drive = steer(float(wrap_angle_rad(course - here.yaw_rad)), ring)
        way_m += drive.speed_m_s * tick_s
        here = placed(here, Pose(drive.speed_m_s * tick_s, 0.0, drive.turn_rad_s * tick_s))
    return here, way_m


@pytest.mark.parametrize("y_m", [-1.0, 0.0, 1.0])
@pytest.mark.parametrize("behind_m", [1.7, 2.5, 5.0])
def test_what_is_right_behind_a_wall_is_driven_to_round_its_end(
    y_m: float, behind_m: float
) -> None:
    """The path's end is nearer than the wall's: who steers there steers at the wall, for ever."""
    target = np.array([behind_m, y_m])
    here, _ = driven(Pose(-1.1, y_m), target, 4.0)
    assert here.distance_to_m(target) <= 1.0


@pytest.mark.parametrize("bearing_deg", [0, 11, 22, 33])
def test_on_open_ground_it_drives_straight_though_the_grid_does_not(bearing_deg: float) -> None:
    target = 20.0 * np.array([np.cos(np.radians(bearing_deg)), np.sin(np.radians(bearing_deg))])
    here, way_m = driven(HERE, target, 0.0)
    assert here.distance_to_m(target) <= 1.0
    assert way_m <= 1.01 * here.distance_to_m(HERE.xy_m) + 0.1

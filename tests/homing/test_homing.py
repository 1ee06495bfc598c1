import numpy as np
import pytest
import sights
from sights import RIG, descriptors, directions, features_of, sight

from vrchain.geometry import Pose, placed, wrap_angle_rad
from vrchain.homing import home_vector
from vrchain.landmarks.extraction.sift import Features
from vrchain.seeding import generator

HOME = Pose(0.5, -0.3, 1.0)


def starts(n: int, low_m: float, high_m: float) -> list[Pose]:
    """Places around home, with random headings."""
    draws = generator(0, "homing", str(low_m))
    made = []
    for _ in range(n):
        range_m, angle, yaw = draws.uniform(low_m, high_m), *draws.uniform(-np.pi, np.pi, 2)
        x_m, y_m = HOME.xy_m + range_m * np.array([np.cos(angle), np.sin(angle)])
        made.append(Pose(float(x_m), float(y_m), float(yaw)))
    return made


@pytest.mark.parametrize(("low_m", "high_m", "median_deg"), [(0.6, 2.0, 2.0), (2.0, 5.0, 1.0)])
def test_home_lies_where_it_says(low_m: float, high_m: float, median_deg: float) -> None:
    off, sure = [], []
    for here in starts(6, low_m, high_m):
        vector = home_vector(sight(here), sight(HOME), arrived_m=0.25)
        assert vector is not None and not vector.arrived and vector.n_matches >= 8
        astray = wrap_angle_rad(vector.bearing_rad - here.bearing_to_rad(HOME.xy_m))
        off.append(np.degrees(abs(astray)))
        sure.append(np.degrees(vector.std_rad))
    assert np.median(off) < median_deg and max(off) < 10 and np.median(sure) < 2


@pytest.mark.parametrize("turn_rad", [0.0, 2.0, -3.1])
def test_home_is_known_whichever_way_the_robot_faces(turn_rad: float) -> None:
    for here in (HOME, Pose(HOME.x_m + 0.05, HOME.y_m, HOME.yaw_rad)):
        turned = Pose(here.x_m, here.y_m, float(wrap_angle_rad(here.yaw_rad + turn_rad)))
        vector = home_vector(sight(turned), sight(HOME), arrived_m=0.2)
        assert vector is not None and vector.arrived
        assert vector.n_matches > 50
    far = Pose(HOME.x_m + 2, HOME.y_m, float(wrap_angle_rad(HOME.yaw_rad + turn_rad)))
    assert not home_vector(sight(far), sight(HOME)).arrived


def test_arrival_is_declared_within_the_distance_asked_for() -> None:
    near = Pose(HOME.x_m + 0.6, HOME.y_m, 0.3)
    assert not home_vector(sight(near), sight(HOME), arrived_m=0.3).arrived
    assert home_vector(sight(near), sight(HOME), arrived_m=1.2).arrived


def test_following_the_vector_leads_home() -> None:
    here = Pose(3.5, 2.0, -2.0)
    for _ in range(12):
        vector = home_vector(sight(here), sight(HOME), arrived_m=0.25)
        assert vector is not None
        if vector.arrived:
            break
        step_m, course_rad = min(1.0, vector.remoteness), vector.bearing_rad
        step = Pose(step_m * np.cos(course_rad), step_m * np.sin(course_rad), course_rad)
        here = placed(here, step)
    assert vector.arrived and here.distance_to_m(HOME.xy_m) < 0.3


def test_nothing_in_common_is_no_vector() -> None:
    other = sight(Pose(0, 0, 0), RIG, sights.boxes("nothing in common"))
    assert all(home_vector(sight(here), other) is None for here in starts(4, 0.5, 5.0))


@pytest.mark.parametrize("n", [0, 1, 2, 7])
def test_hardly_any_features_are_no_vector(n: int) -> None:
    few = sight(HOME).take(np.arange(n))
    for pair in ((few, sight(HOME)), (sight(HOME), few), (few, few)):
        assert home_vector(*pair) is None


def far_away(here: Pose, n_near: int = 0) -> Features:
    """A hundred things 150 to 400 m away, and some keypoints of the ground 3 to 7 m from home."""
    draws = generator(0, "far away")
    angle, range_m = draws.uniform(-np.pi, np.pi, 120), draws.uniform(150.0, 400.0, 120)
    high_m = draws.uniform(5.0, 60.0, 120)
    range_m[100:], high_m[100:] = draws.uniform(3.0, 7.0, 20), 0.0
    points_m = np.column_stack([range_m * np.cos(angle), range_m * np.sin(angle), high_m])
    seen = features_of(*directions(here, points_m), descriptors(120, "far away"))
    return seen.take(np.arange(100 + n_near))


@pytest.mark.parametrize("n_near", [0, 2, 5])
def test_what_is_far_away_does_not_tell_that_it_is_home(n_near: int) -> None:
    """By what hardly moves 1.5 m and 0.05 m are the same, so the ground must tell."""
    then = far_away(Pose(0, 0), n_near)
    off = home_vector(far_away(Pose(1.5, 0, 0.5), n_near), then, arrived_m=0.15)
    near = home_vector(far_away(Pose(0.05, 0, 0.5), n_near), then, arrived_m=0.15)
    assert not off.arrived
    assert abs(wrap_angle_rad(off.bearing_rad - np.pi + 0.5)) < 2 * off.std_rad
    assert (off.std_rad > 0.5) == (n_near < 5)  # by the far ones alone home is here or there
    assert near.arrived == (n_near == 5)


def test_tiles_that_repeat_do_not_tell_that_it_is_home() -> None:
    """A third of the ground is taken for that one tile farther on, where nothing has moved."""
    then = far_away(Pose(0, 0), 20)
    now = far_away(Pose(1.0, 0, 0.5), 20)
    tiles = np.arange(100, 107)  # they look from 1 m off as they did from home
    now.bearing_rad[tiles] = wrap_angle_rad(then.bearing_rad[tiles] - 0.5)
    now.slope[tiles] = then.slope[tiles]
    off = home_vector(now, then, arrived_m=0.15)
    assert not off.arrived and 0.6 < off.remoteness < 1.1

import numpy as np
import pytest

from vrchain.geometry import Pose
from vrchain.navigation.driving.estimates import Estimate, sighted


def test_a_sight_lies_along_its_bearing() -> None:
    here = Pose(3.0, -2.0, 0.7)
    place = sighted(here, 0.4, 20.0)
    assert place.range_m(here) == pytest.approx(20.0)
    assert place.bearing_rad(here) == pytest.approx(0.4)
    along, across = np.array([np.cos(1.1), np.sin(1.1)]), np.array([-np.sin(1.1), np.cos(1.1)])
    assert along @ place.covariance @ along > 9 * (across @ place.covariance @ across)


def test_two_sights_from_the_side_fix_a_place() -> None:
    """Both ranges are wrong, the bearings are right."""
    at = np.array([10.0, 10.0])
    first, second = Pose(0.0, 0.0), Pose(20.0, 0.0, 1.0)
    one = sighted(first, first.bearing_to_rad(at), 1.2 * first.distance_to_m(at))
    two = sighted(second, second.bearing_to_rad(at), 1.2 * second.distance_to_m(at))
    both = one.with_sight(two)
    assert np.hypot(*(both.xy_m - at)) < 1.0 < np.hypot(*(one.xy_m - at))
    assert both.std_m < min(one.std_m, two.std_m)
    assert one.astray(two) < 3.0 < one.astray(sighted(first, -1.0, 14.0))


def test_driving_makes_a_belief_less_sure_and_moves_nothing() -> None:
    place = Estimate(np.array([1.0, 2.0]), np.eye(2))
    later = place.after(10.0)
    assert np.array_equal(later.xy_m, place.xy_m) and later.std_m > place.std_m
    assert place.unsure(0.0).std_m == pytest.approx(place.std_m)

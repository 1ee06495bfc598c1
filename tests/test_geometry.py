import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vrchain.geometry import Pose, circular_mean_rad, placed, relative, rotation_z, wrap_angle_rad

ANGLES = st.floats(-1000, 1000)


@given(ANGLES)
def test_a_wrapped_angle_is_the_same_direction(angle: float) -> None:
    wrapped = float(wrap_angle_rad(angle))
    assert -np.pi <= wrapped < np.pi
    assert np.cos(wrapped) == pytest.approx(np.cos(angle), abs=1e-9)
    assert np.sin(wrapped) == pytest.approx(np.sin(angle), abs=1e-9)
    assert float(wrap_angle_rad(wrapped)) == pytest.approx(wrapped, abs=1e-15)


def test_half_a_turn_is_minus_pi_and_shapes_are_kept() -> None:
    for turns in (-3, -1, 0, 1, 2):
        assert float(wrap_angle_rad(0.5 + 2 * np.pi * turns)) == pytest.approx(0.5)
    for bound in (np.pi, -np.pi, 3 * np.pi, -3 * np.pi):
        for near in (np.nextafter(bound, -10), bound, np.nextafter(bound, 10)):
            assert -np.pi <= float(wrap_angle_rad(near)) < np.pi
    assert wrap_angle_rad([np.pi, -np.pi]).tolist() == [-np.pi, -np.pi]
    for shape in ((), (0,), (3,), (2, 3)):
        assert wrap_angle_rad(np.zeros(shape)).shape == shape


@given(st.floats(-50, 50), st.floats(-50, 50), ANGLES, st.floats(0.01, 100), ANGLES)
def test_bearing_and_distance_lead_back_to_the_point(
    x_m: float, y_m: float, yaw: float, range_m: float, bearing: float
) -> None:
    pose = Pose(x_m, y_m, yaw)
    point = pose.xy_m + range_m * np.array([np.cos(yaw + bearing), np.sin(yaw + bearing)])
    assert pose.distance_to_m(point) == pytest.approx(range_m, rel=1e-6)
    off = wrap_angle_rad(pose.bearing_to_rad(point) - bearing)
    assert abs(off) < 1e-6 or abs(abs(off) - 2 * np.pi) < 1e-6


def test_bearings_grow_to_the_left() -> None:
    pose = Pose(1.0, 2.0, np.pi / 2)  # facing north
    assert pose.bearing_to_rad((1, 5)) == pytest.approx(0)
    assert pose.bearing_to_rad((0, 2)) == pytest.approx(np.pi / 2)  # west is left
    assert pose.bearing_to_rad((5, 2)) == pytest.approx(-np.pi / 2)
    assert pose.bearing_to_rad((1, 5, 9)) == pytest.approx(0)  # a height is no matter
    assert pose.distance_to_m((4, 6)) == 5
    assert pose.xy_m.tolist() == [1, 2]


@given(ANGLES, ANGLES)
def test_rotations_add_up_and_keep_lengths(a: float, b: float) -> None:
    assert np.allclose(rotation_z(a) @ rotation_z(b), rotation_z(a + b), atol=1e-9)
    assert np.allclose(rotation_z(a) @ rotation_z(a).T, np.eye(3), atol=1e-12)
    assert np.allclose(rotation_z(a) @ [0, 0, 1], [0, 0, 1])
    assert np.allclose(rotation_z(np.pi / 2) @ [1, 0, 0], [0, 1, 0])  # east to north


@given(st.floats(-np.pi, np.pi), st.floats(0.01, 1.5))
def test_the_mean_of_two_directions_lies_between(middle: float, apart: float) -> None:
    mean = circular_mean_rad([middle - apart, middle + apart])
    assert wrap_angle_rad(mean - middle) == pytest.approx(0, abs=1e-9)
    assert abs(circular_mean_rad([3.0, -3.0])) == pytest.approx(np.pi)
    assert circular_mean_rad([0.7]) == pytest.approx(0.7)


POSES = st.builds(Pose, st.floats(-50, 50), st.floats(-50, 50), st.floats(-3, 3))


@given(POSES, POSES)
def test_a_place_told_in_another_frame_is_the_same_place(a: Pose, b: Pose) -> None:
    told = relative(a, b)
    assert a.distance_to_m(b.xy_m) == pytest.approx(np.hypot(*told.xy_m))
    if np.hypot(*told.xy_m) > 0.01:
        ahead = float(np.arctan2(told.y_m, told.x_m))
        assert np.cos(a.bearing_to_rad(b.xy_m) - ahead) == pytest.approx(1.0)
    again = placed(a, told)
    assert again.xy_m == pytest.approx(b.xy_m, abs=1e-9)
    assert np.cos(again.yaw_rad - b.yaw_rad) == pytest.approx(1.0)

import json

import numpy as np
import pytest
import worlds
from hypothesis import given
from hypothesis import strategies as st
from sights import TwoViews, directions, two_views

from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.landmarks.matching.epipolar import PlanarGeometry, estimate
from vrchain.seeding import generator

POSES_B = [Pose(5, 0, 0), Pose(3, 4, 2.5), Pose(-6, 2, -1), Pose(0, -8, np.pi), Pose(1, 0.5, 0.1)]


def errors_deg(geometry: PlanarGeometry | None, views: TwoViews) -> tuple[float, float]:
    """How far off the direction and the heading are."""
    assert geometry is not None
    off = wrap_angle_rad(
        [
            geometry.direction_rad - views.direction_rad,
            geometry.heading_rad - views.pose_b.yaw_rad,
        ]
    )
    return tuple(np.degrees(np.abs(off)))


@pytest.mark.parametrize("pose_b", POSES_B)
def test_exact_directions_give_the_exact_pose(pose_b: Pose) -> None:
    views = two_views(pose_b)
    geometry = estimate(*views.matches)
    assert max(errors_deg(geometry, views)) < 1e-4
    assert geometry.inliers.all() and geometry.inliers.dtype == bool
    back = pose_b.bearing_to_rad((0, 0))
    assert wrap_angle_rad(geometry.back_rad - back) == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("pose_b", POSES_B)
@pytest.mark.parametrize("outliers", [0.0, 0.5])
def test_noise_and_wrong_matches_cost_little(pose_b: Pose, outliers: float) -> None:
    views = two_views(pose_b, 200, noise_rad=0.001, outliers=outliers)
    geometry = estimate(*views.matches)
    direction_deg, heading_deg = errors_deg(geometry, views)
    assert direction_deg < 1.5 and heading_deg < 0.3
    assert geometry.inliers[views.good].mean() > 0.95
    assert geometry.inliers[~views.good].sum() <= 0.1 * max(1, (~views.good).sum())


@given(
    distance_m=st.floats(2, 12),
    bearing=st.floats(-np.pi, np.pi, exclude_max=True),
    yaw=st.floats(-np.pi, np.pi, exclude_max=True),
    seed=st.integers(0, 10_000),
)
def test_any_pose_is_found(distance_m: float, bearing: float, yaw: float, seed: int) -> None:
    b = Pose(distance_m * np.cos(bearing), distance_m * np.sin(bearing), yaw)
    views = two_views(b, 60, outliers=0.3, seed=seed)
    geometry = estimate(*views.matches)
    direction_deg, heading_deg = errors_deg(geometry, views)
    assert direction_deg < 1.5 and heading_deg < 0.5
    assert geometry.inliers[views.good].all()
    assert -np.pi <= geometry.direction_rad < np.pi and -np.pi <= geometry.back_rad < np.pi


@pytest.mark.parametrize("noise_rad", [0.0003, 0.001])
@pytest.mark.parametrize("distance_m", [2.0, 6.0])
def test_the_stated_deviation_is_the_true_one(noise_rad: float, distance_m: float) -> None:
    off, stated = [], []
    for seed in range(60):
        angle = generator(seed, "course").uniform(-np.pi, np.pi)
        b = Pose(distance_m * np.cos(angle), distance_m * np.sin(angle), 1.0)
        views = two_views(b, 80, noise_rad, outliers=0.2, seed=seed)
        geometry = estimate(*views.matches)
        off.append(wrap_angle_rad(geometry.direction_rad - views.direction_rad))
        stated.append(geometry.direction_std_rad)
    z = np.array(off) / np.array(stated)
    assert 0.5 < np.sqrt(np.mean(z**2)) < 2.0
    assert np.mean(np.abs(z) < 3) > 0.9


def test_ranges_are_true_in_baselines() -> None:
    views = two_views(Pose(3, -4, 1.2))
    geometry = estimate(*views.matches)
    baseline_m = 5.0
    compared = 0
    for point, a, b in zip(views.points_m, views.bearing_a, views.bearing_b, strict=True):
        true_a = np.hypot(*point[:2]) / baseline_m
        true_b = np.hypot(*(point[:2] - views.pose_b.xy_m)) / baseline_m
        found = geometry.ranges(a, b)
        parallax = wrap_angle_rad(b + views.pose_b.yaw_rad - a)
        if 0.02 < abs(parallax) < np.pi - 0.02:
            assert found == pytest.approx((true_a, true_b), rel=1e-3)
            compared += 1
    assert compared > 80


def test_rays_that_do_not_meet_are_infinitely_far() -> None:
    geometry = PlanarGeometry(0.0, 0.0, np.ones(8, bool), 0.0)
    assert geometry.ranges(0.7, 0.7) == (np.inf, np.inf)
    assert geometry.ranges(0.0, 0.0) == (np.inf, np.inf)  # straight on: no parallax either
    assert geometry.ranges(np.pi / 4, np.pi / 2) == pytest.approx((np.sqrt(2), 1.0))


@pytest.mark.parametrize("n", [8, 30, 200])
def test_mere_chance_has_few_inliers(n: int) -> None:
    for seed in range(15):
        views = two_views(Pose(4, 0, 0), n, outliers=1.0, seed=seed)
        geometry = estimate(*views.matches)
        assert geometry is None or geometry.inliers.sum() <= max(8, 0.17 * n)


def test_too_few_matches_tell_nothing() -> None:
    assert estimate(*two_views(Pose(4, 0, 0), 7).matches) is None
    assert estimate(*two_views(Pose(4, 0, 0), 0).matches) is None
    assert estimate(*two_views(Pose(4, 0, 0), 11).matches, 12) is None
    assert estimate(*two_views(Pose(4, 0, 0), 12).matches, 12) is not None


def test_no_matches_and_no_demand_is_no_pose() -> None:
    empty = np.empty(0)
    assert estimate(empty, empty, empty, empty, min_inliers=0) is None
    one = np.array([0.3])
    assert estimate(one, one, one, one, min_inliers=1) is None


def check_finite(geometry: PlanarGeometry | None) -> None:
    """None, or angles in range and a deviation that is no NaN."""
    if geometry is not None:
        angles = [geometry.direction_rad, geometry.heading_rad, geometry.back_rad]
        assert np.isfinite(angles).all() and (np.abs(angles) <= np.pi).all()
        assert not np.isnan(geometry.direction_std_rad) and geometry.direction_std_rad >= 0


@pytest.mark.parametrize("noise_rad", [0.0, 1e-9, 1e-3])
def test_directions_that_say_nothing_do_no_harm(noise_rad: float) -> None:
    draws = generator(0, "degenerate")
    n = 50
    bearing = draws.uniform(-np.pi, np.pi, n)
    slope = draws.uniform(-0.3, 0.3, n)
    zero, same = np.zeros(n), np.full(n, 0.4)
    cases = [
        (bearing, zero, bearing[::-1], zero),  # all at the horizon
        (same, same, same, same),  # one point only, again and again
        (bearing, slope, bearing, slope),  # the same place
        (bearing, slope, wrap_angle_rad(bearing + 2), slope),  # the same place, turned
        (bearing, zero + 0.1, bearing, zero - 0.1),  # above in one, below in the other
        (zero, slope, zero, slope),  # a mast straight ahead
        (zero, zero, zero, zero),
    ]
    for case in cases:
        noisy = [v + noise_rad * draws.normal(size=n) for v in case]
        check_finite(estimate(*noisy))


def test_at_one_place_the_heading_is_right() -> None:
    points = two_views(Pose(0, 5, 0), 100).points_m
    for seed in range(5):
        draws = generator(seed, "one place")
        views = [*directions(Pose(0, 0), points), *directions(Pose(0, 0, 1.5), points)]
        geometry = estimate(*(v + draws.normal(0, 0.001, 100) for v in views))
        check_finite(geometry)
        assert geometry is not None
        assert np.degrees(abs(wrap_angle_rad(geometry.heading_rad - 1.5))) < 0.2


def test_what_lies_behind_does_not_count_as_in_front() -> None:
    views = two_views(Pose(5, 0, 0), 100)
    behind = np.arange(100) < 30  # a mirrored ray obeys the same equation
    bearing_b = np.where(behind, wrap_angle_rad(views.bearing_b + np.pi), views.bearing_b)
    slope_b = np.where(behind, -views.slope_b, views.slope_b)
    geometry = estimate(views.bearing_a, views.slope_a, bearing_b, slope_b)
    assert not geometry.inliers[behind].any()
    assert geometry.inliers[~behind].all()


def test_swapping_the_two_inverts_the_pose() -> None:
    views = two_views(Pose(4, 3, 0.8), 150, noise_rad=0.0005, outliers=0.2)
    there = estimate(*views.matches)
    back = estimate(views.bearing_b, views.slope_b, views.bearing_a, views.slope_a)
    assert wrap_angle_rad(back.direction_rad - there.back_rad) == pytest.approx(0, abs=0.01)
    assert wrap_angle_rad(back.heading_rad + there.heading_rad) == pytest.approx(0, abs=0.003)
    assert (back.inliers == there.inliers).mean() > 0.95


def test_turning_a_robot_turns_the_answer_and_nothing_else() -> None:
    views = two_views(Pose(4, 3, 0.8), 100, noise_rad=0.001, outliers=0.3)
    plain = estimate(*views.matches)
    turned = estimate(
        wrap_angle_rad(views.bearing_a - 0.9), views.slope_a, views.bearing_b, views.slope_b
    )
    assert wrap_angle_rad(turned.direction_rad - plain.direction_rad + 0.9) == pytest.approx(
        0, abs=1e-3
    )
    assert turned.back_rad == pytest.approx(plain.back_rad, abs=1e-3)


def test_the_same_matches_give_the_same_answer_in_two_processes() -> None:
    code = """
import json
from sights import two_views
from vrchain.geometry import Pose
from vrchain.landmarks.matching.epipolar import estimate
g = estimate(*two_views(Pose(3, 4, 1), 120, 0.002, 0.4).matches)
values = [g.direction_rad, g.heading_rad, g.direction_std_rad]
print(json.dumps([[v.hex() for v in map(float, values)], g.inliers.tolist()]))
"""
    first, second = worlds.in_two_processes(code)
    assert first == second and json.dumps(first) == json.dumps(second)


@pytest.mark.parametrize("height_m", [0.5, 1.0])
def test_the_ground_tells_how_far_apart_the_cameras_are(height_m: float) -> None:
    """In camera heights: the lowest points matched are on the ground."""
    draws = np.random.default_rng(5)
    points = np.column_stack([draws.uniform(-15, 15, (300, 2)), draws.uniform(0, 5, 300)])
    points[:60, 2] = 0.0
    a, b = np.zeros(2), np.array([6.0, 2.0])
    seen = []
    for place in (a, b):
        offset = points[:, :2] - place
        slope = (points[:, 2] - height_m) / np.hypot(*offset.T)
        seen += [np.arctan2(offset[:, 1], offset[:, 0]), slope]
    found = estimate(*seen)
    assert found is not None
    assert found.baseline_heights * height_m == pytest.approx(np.hypot(*b), rel=0.02)
    high = points[:, 2] > height_m
    assert np.isnan(estimate(*(x[high] for x in seen)).baseline_heights)

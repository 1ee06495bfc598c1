from functools import cache

import numpy as np
import pytest
import sights
import worlds
from hypothesis import given
from hypothesis import strategies as st
from sights import descriptors, features_of, sight

from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.landmarks.extraction.sift import Features
from vrchain.landmarks.retrieval.template import (
    GOAL_MATCHES,
    LOWEST_SLOPE,
    Goal,
    Sighting,
    Template,
    find_goal,
    goal_of,
    locate,
    template_around,
)
from vrchain.panorama import CameraRig, Panorama
from vrchain.seeding import generator
from vrchain.world.model import Scene

N = 40


def stored(seed: int = 0) -> Template:
    """A landmark 0.3 rad wide."""
    draws = generator(seed, "stored")
    offset, slope = draws.uniform(-0.15, 0.15, N), draws.uniform(-0.1, 0.3, N)
    return Template(features_of(offset, slope, descriptors(N, "landmark")), 0.15)


def seen_again(
    template: Template,
    middle_rad: float,
    scale: float,
    squeeze: float = 1.0,
    noise_rad: float = 0.0,
    clutter: int = 0,
    wrong: float = 0.0,
) -> Features:
    """The landmark from nearer by: slopes grow by ``scale``, offsets by ``scale * squeeze``."""
    draws = generator(0, "again")
    own = template.features
    n = len(own)
    bearing = middle_rad + scale * squeeze * own.bearing_rad + draws.normal(0, noise_rad, n)
    slope = scale * own.slope + draws.normal(0, noise_rad, n)
    lost = draws.permutation(n) < round(wrong * n)
    bearing = np.where(lost, draws.uniform(-np.pi, np.pi, n), bearing)
    slope = np.where(lost, draws.uniform(-0.4, 0.4, n), slope)
    bearing = np.append(bearing, draws.uniform(-np.pi, np.pi, clutter))
    slope = np.append(slope, draws.uniform(-0.4, 0.4, clutter))
    coded = np.concatenate([own.descriptors, descriptors(clutter, "clutter")])
    return features_of(wrap_angle_rad(bearing), slope, coded)


@given(
    middle=st.floats(-np.pi, np.pi, exclude_max=True),
    scale=st.floats(0.3, 4),
    squeeze=st.floats(0.5, 1.6),
    seed=st.integers(0, 1000),
)
def test_bearing_scale_and_width_are_found(
    middle: float, scale: float, squeeze: float, seed: int
) -> None:
    template = stored(seed)
    seen = locate(template, seen_again(template, middle, scale, squeeze, clutter=60))
    assert seen is not None and seen.n_matches == N
    assert wrap_angle_rad(seen.bearing_rad - middle) == pytest.approx(0, abs=1e-6)
    assert seen.scale == pytest.approx(scale, rel=1e-6)
    assert seen.half_width_rad == pytest.approx(0.15 * scale * squeeze, rel=1e-6)
    assert -np.pi <= seen.bearing_rad < np.pi


@pytest.mark.parametrize("middle", [0.0, 2.0, 3.1, -3.13])
@pytest.mark.parametrize("scale", [0.5, 1.0, 2.5])
def test_noise_and_wrong_matches_cost_little(middle: float, scale: float) -> None:
    template = stored()
    now = seen_again(template, middle, scale, 0.9, noise_rad=0.002, clutter=100, wrong=0.5)
    seen = locate(template, now)
    assert seen is not None and 0.35 * N <= seen.n_matches <= 0.65 * N
    assert np.degrees(abs(wrap_angle_rad(seen.bearing_rad - middle))) < 0.3
    assert seen.scale == pytest.approx(scale, rel=0.05)


def test_a_landmark_at_the_horizon_has_the_scale_of_its_width() -> None:
    template = stored()
    flat = Template(
        features_of(template.features.bearing_rad, np.zeros(N), template.features.descriptors), 0.15
    )
    seen = locate(flat, seen_again(flat, 1.0, 2.0))
    assert seen is not None
    assert (seen.bearing_rad, seen.scale) == pytest.approx((1.0, 2.0), abs=1e-6)


def test_what_is_not_there_is_not_found() -> None:
    template = stored()
    clutter = seen_again(template, 0, 1, clutter=300).take(np.arange(N, N + 300))
    assert locate(template, clutter) is None
    for wrong in range(8):  # its descriptors are there, its shape is not
        draws = generator(wrong, "scattered")
        coded = template.features.descriptors[:12]
        now = features_of(draws.uniform(-np.pi, np.pi, 12), draws.uniform(-0.4, 0.4, 12), coded)
        assert locate(template, now, min_matches=8) is None


@pytest.mark.parametrize("squeeze", [0.1, 3.5, -1.0])
def test_what_no_landmark_could_look_like_is_not_taken_for_it(squeeze: float) -> None:
    """Squeezed to a tenth, drawn out, mirrored, or upside down: all agree, and none is fair."""
    template = stored()
    assert locate(template, seen_again(template, 0.5, 1.0, squeeze), min_matches=15) is None
    own = template.features
    assert locate(template, features_of(own.bearing_rad, -own.slope, own.descriptors)) is None


def test_the_search_can_be_limited_to_a_window() -> None:
    template = stored()
    now = seen_again(template, 3.0, 1.0)
    assert locate(template, now, near_rad=0.0, window_rad=0.5) is None
    assert locate(template, now, near_rad=-3.1, window_rad=0.6) is not None  # across the seam
    assert locate(template, now, near_rad=3.0, window_rad=0.2, min_matches=N).n_matches == N
    assert locate(template, now, min_matches=N + 1) is None


@pytest.mark.parametrize("n", [0, 1, 2, 4])
def test_too_few_keypoints_are_no_sighting(n: int) -> None:
    template, now = stored(), seen_again(stored(), 0, 1)
    few = Template(template.features.take(np.arange(n)), 0.15)
    assert locate(few, now) is locate(template, now.take(np.arange(n))) is None
    assert locate(few, now.take(np.arange(n)), near_rad=0.0) is None


def test_a_landmark_of_one_column_or_one_point_does_no_harm() -> None:
    coded = descriptors(N, "landmark")
    for offset, slope in (
        (np.zeros(N), np.linspace(-0.1, 0.3, N)),
        (np.full(N, 0.05), np.full(N, 0.1)),
        (np.linspace(-0.1, 0.1, N), np.zeros(N)),
    ):
        template = Template(features_of(offset, slope, coded), 0.15)
        seen = locate(template, features_of(offset + 1, slope, coded))
        if seen is not None:
            assert np.isfinite([seen.bearing_rad, seen.scale, seen.half_width_rad]).all()
            assert seen.bearing_rad == pytest.approx(1.0, abs=0.02)
            assert seen.scale > 0 and seen.half_width_rad > 0


def test_a_template_is_what_lies_around_a_bearing() -> None:
    bearing = np.array([3.0, 3.1, -3.1, -3.0, 0.0])
    slope = np.array([0.1, -0.5, 0.2, 0.3, 0.1])
    found = features_of(bearing, slope, descriptors(5))
    template = template_around(found, np.pi, 0.1)
    assert len(template.features) == 2 and template.half_width_rad == 0.1
    assert template.features.bearing_rad == pytest.approx([3.1 - np.pi, np.pi - 3.1])
    standing = template_around(found, np.pi, 0.2, (LOWEST_SLOPE, 0.25))
    assert np.array_equal(standing.features.slope, [0.1, 0.2])
    assert np.array_equal(standing.features.descriptors, found.descriptors[[0, 2]])
    assert len(template_around(found, 1.5, 0.1).features) == 0


# --- on pictures ---

START, UPRIGHT = Pose(0, 0, 0), (LOWEST_SLOPE, np.inf)
MIDDLE_M = np.array([15.0, 1.0])


@cache
def road() -> Scene:
    """A box ahead, others beside the way to it."""
    target = worlds.box("target", (15, 1), (3, 3, 3), worlds.blotches("target", 256), yaw_rad=0.2)
    sides = [
        worlds.box(f"side {k}", (3.0 * k, 7 * (-1) ** k), (2, 2, 2), worlds.blotches(f"side {k}"))
        for k in range(6)
    ]
    return worlds.world(target, *sides)


def on_road(pose: Pose) -> Features:
    return sight(pose, sights.RIG, road())


def elsewhere(k: int) -> Features:
    return sight(Pose(0, 0, k), sights.RIG, sights.boxes(f"elsewhere {k}"))


def front_m(pose: Pose) -> float:
    """To the target's front."""
    return pose.distance_to_m(MIDDLE_M) - 1.5


def off_deg(seen: Sighting | None, pose: Pose) -> float:
    assert seen is not None
    return np.degrees(abs(wrap_angle_rad(seen.bearing_rad - pose.bearing_to_rad(MIDDLE_M))))


def test_driving_towards_a_landmark_its_bearing_and_nearness_are_known() -> None:
    half_width = float(np.arctan(1.8 / front_m(START)))
    template = template_around(on_road(START), START.bearing_to_rad(MIDDLE_M), half_width, UPRIGHT)
    assert all(locate(template, elsewhere(k), min_matches=8) is None for k in range(4))
    for pose in (Pose(2, 0.5, 0.4), Pose(4, -0.5, -2), Pose(6, 0.3, 3.0), Pose(8, 0.5, 1)):
        seen = locate(template, on_road(pose))
        assert off_deg(seen, pose) < 1.0 and seen.n_matches >= 10
        assert seen.scale == pytest.approx(front_m(START) / front_m(pose), rel=0.15)


@cache
def goal() -> Goal:
    """By two framed pictures of the target."""
    rig = CameraRig(n_views=1, width_px=160, height_px=160, field_of_view_deg=32.2)
    poses = [Pose(p.x_m, p.y_m, p.bearing_to_rad(MIDDLE_M)) for p in (Pose(7, 0), Pose(8, 4))]
    return goal_of([sights.look(pose, rig, road()) for pose in poses])


def test_a_goal_is_found_where_it_is_and_not_where_it_is_not() -> None:
    assert len(goal().templates) == 2
    assert all(t.features.slope.min() >= LOWEST_SLOPE for t in goal().templates)
    for pose in (Pose(4, 0, 1), Pose(6, 2, -2.5), Pose(3, 1, 3.0)):
        seen = find_goal(goal(), on_road(pose))
        assert off_deg(seen, pose) < 4.0  # the pictures were taken from another side
        assert seen.n_matches >= GOAL_MATCHES
    assert all(find_goal(goal(), elsewhere(k)) is None for k in range(4))
    assert find_goal(goal(), sight(START)) is None


def test_the_picture_that_agrees_best_counts() -> None:
    now = on_road(Pose(4, 0, 1))
    single = [find_goal(Goal((t,)), now, min_matches=5) for t in goal().templates]
    best = max((s for s in single if s), key=lambda s: s.n_matches)
    assert find_goal(goal(), now, min_matches=5) == best
    assert find_goal(goal(), now, min_matches=best.n_matches + 1) is None


def test_no_picture_or_an_empty_one_is_a_goal_never_found() -> None:
    blank = Panorama(CameraRig(n_views=1), np.zeros((1, 480, 640, 3), np.uint8))
    assert find_goal(goal_of([]), sight(START)) is find_goal(goal_of([blank]), sight(START)) is None

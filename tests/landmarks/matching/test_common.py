from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import sights
import worlds
from sights import RIG, boxes, look, sight

from vrchain.errors import ImageError
from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.landmarks.matching.common import (
    CommonLandmark,
    Comparison,
    MatchConfig,
    Region,
    check_not_blank,
    common_landmarks,
    compare,
    group_by_nearness,
    panorama_region,
    support_score,
)
from vrchain.landmarks.matching.epipolar import PlanarGeometry
from vrchain.landmarks.quality import judge
from vrchain.panorama import CameraRig, Panorama
from vrchain.seeding import generator

PAIRS = [
    (Pose(0, 0, 0.3), Pose(3, 1, -2.0)),
    (Pose(-2, 1, 3.1), Pose(1, -2, 0.0)),
    (Pose(1, 3, 1.0), Pose(-4, 0, 1.2)),
]
each_pair = pytest.mark.parametrize(("a", "b"), PAIRS)


@cache
def comparison(a: Pose, b: Pose) -> Comparison:
    return compare(sight(a), sight(b), RIG)


@each_pair
def test_claims_are_right_and_so_is_the_relative_pose(a: Pose, b: Pose) -> None:
    found = comparison(a, b)
    verdicts = judge(found, sights.yard_truth(), (a, b), (sight(a), sight(b)), RIG)
    assert len(verdicts) >= 10 and verdicts[0].right
    assert np.mean([v.right for v in verdicts]) > 0.97
    assert len({v.object_a for v in verdicts if v.right}) >= 4
    assert np.median([v.quality_m for v in verdicts]) < 0.1
    assert not any(v.object_a in ("ground", "sky") for v in verdicts)
    geometry = found.geometry
    direction_off = wrap_angle_rad(geometry.direction_rad - a.bearing_to_rad(b.xy_m))
    back_off = wrap_angle_rad(geometry.back_rad - b.bearing_to_rad(a.xy_m))
    heading_off = wrap_angle_rad(geometry.heading_rad - (b.yaw_rad - a.yaw_rad))
    assert np.degrees(np.abs([direction_off, back_off])).max() < 1.0
    assert np.degrees(abs(heading_off)) < 0.3
    assert np.median(ranges_off(found, a, b)) < 0.03
    assert np.quantile(ranges_off(found, a, b), 0.9) < 0.15


@each_pair
def test_claims_are_well_formed(a: Pose, b: Pose) -> None:
    found = comparison(a, b).common
    scores = [c.score for c in found]
    assert scores == sorted(scores, reverse=True)
    for side in ("support_a", "support_b"):  # no keypoint supports two claims
        used = np.concatenate([getattr(c, side) for c in found])
        assert len(used) == len(set(used))
    for claim in found:
        assert 0.5 <= claim.score == support_score(len(claim.support_a)) <= 1
        assert len(claim.support_a) == len(claim.support_b) >= MatchConfig().min_support
        assert min(claim.ranges) > 0 and max(claim.ranges) <= MatchConfig().max_range
        check_region(claim.a, sight(a).take(claim.support_a))
        check_region(claim.b, sight(b).take(claim.support_b))


def check_region(region, support) -> None:
    """The box lies in its view and holds its keypoints; the angles are theirs."""
    x0, y0, x1, y1 = region.box_px
    assert 0 <= x0 < x1 <= RIG.width_px and 0 <= y0 < y1 <= RIG.height_px
    assert 0 <= region.view < RIG.n_views
    assert -np.pi <= region.bearing_rad < np.pi and 0 < region.angular_size_rad < np.pi
    off_axis = wrap_angle_rad(region.bearing_rad - RIG.azimuths_rad[region.view])
    assert abs(off_axis) <= np.pi / RIG.n_views + 1e-9
    off = np.abs(wrap_angle_rad(support.bearing_rad - region.bearing_rad))
    assert off.max() <= region.angular_size_rad / 2 + 1e-9
    x_px, y_px = RIG.project(region.view, support.bearing_rad, support.slope)
    inside = (x_px > -0.5) & (x_px < RIG.width_px) & (y_px > -0.5) & (y_px < RIG.height_px)
    inside &= np.abs(wrap_angle_rad(support.bearing_rad - RIG.azimuths_rad[region.view])) < 1
    assert inside.any()
    assert (x_px[inside] >= x0 - 1.5).all() and (x_px[inside] <= x1 + 1.5).all()
    assert (y_px[inside] >= y0 - 1.5).all() and (y_px[inside] <= y1 + 1.5).all()


def ranges_off(found: Comparison, *poses: Pose) -> list[float]:
    """By how much the ranges of claims are wrong, as shares of the true ones."""
    off = []
    for claim in found.common:
        supports = claim.support_a, claim.support_b
        for pose, support, told in zip(poses, supports, claim.ranges, strict=True):
            own = sight(pose).take(support)
            _, points = sights.yard_truth().look_along(pose, own.bearing_rad, own.slope, RIG)
            true_m = pose.distance_to_m(np.nanmedian(points, axis=0))
            off.append(abs(told * poses[0].distance_to_m(poses[1].xy_m) / true_m - 1))
    return off


def test_ranges_in_metres_are_told_where_the_way_between_is() -> None:
    pose = PlanarGeometry(0.0, 0.0, np.ones(9, dtype=bool), 0.0, 3.0)
    none = np.empty(0, dtype=np.int64)
    region = Region(0, (0.0, 0.0, 9.0, 9.0), 0.0, 0.1)
    near, far, untold = (
        CommonLandmark(0.9, region, region, none, none, ranges)
        for ranges in ((2.0, 1.5), (2.0, 40.0), None)
    )
    found, nothing = Comparison((near, far, untold), pose), Comparison((), pose)
    assert found.relative_pose is pose and nothing.relative_pose is None
    assert found.distance_m(RIG) == pytest.approx(3.0 * RIG.camera_height_m)
    assert nothing.distance_m(RIG) is None
    assert found.ranges_m(near, RIG) == pytest.approx((6.0, 4.5))
    assert found.ranges_m(far, RIG) is found.ranges_m(untold, RIG) is None
    for heights in (0.4, np.nan):  # at one place; no ground was matched
        unsure = Comparison((near,), replace(pose, baseline_heights=heights))
        assert unsure.ranges_m(near, RIG) is None


@each_pair
def test_exchanging_the_two_exchanges_the_claims(a: Pose, b: Pose) -> None:
    there, back = comparison(a, b), comparison(b, a)
    pairs_there = {p for c in there.common for p in zip(c.support_a, c.support_b, strict=True)}
    pairs_back = {p for c in back.common for p in zip(c.support_b, c.support_a, strict=True)}
    assert len(pairs_there & pairs_back) > 0.9 * len(pairs_there | pairs_back)
    off = wrap_angle_rad(there.geometry.back_rad - back.geometry.direction_rad)
    assert abs(off) < np.radians(0.5)


@pytest.mark.parametrize("b", [Pose(0, 0, 0.3), Pose(0.02, 0.0, 2.5)])
def test_at_one_place_everything_is_common_and_no_range_is_told(b: Pose) -> None:
    claims = common_landmarks(look(Pose(0, 0, 0.3)), look(b))
    assert len(claims) >= 10
    for claim in claims:
        turn = wrap_angle_rad(claim.a.bearing_rad - claim.b.bearing_rad)
        assert turn == pytest.approx(b.yaw_rad - 0.3, abs=0.05)
        if b.yaw_rad == 0.3:  # the very same panorama: there is no baseline to measure in
            assert np.array_equal(claim.support_a, claim.support_b)
            assert claim.a == claim.b and claim.ranges is None


def test_unrelated_worlds_have_nothing_in_common() -> None:
    apart = (sights.yard(), *(boxes(f"unrelated {k}") for k in range(5)))
    seen = [
        sight(Pose(*generator(0, "unrelated", k).uniform(-3, 3, 3)), RIG, scene)
        for k, scene in enumerate(apart)
    ]
    claims = [len(compare(a, b, RIG).common) for k, a in enumerate(seen) for b in seen[k + 1 :]]
    assert claims == [0] * 15


def test_regions_behind_the_robot_are_whole() -> None:
    """A sign across the seam is one region in the view that looks back, from either side."""
    sign = worlds.box("sign", (-8, 0), (0.2, 2.4, 2.4), worlds.blotches("sign"))
    others = [
        worlds.box(f"side {k}", (x, y), (2, 2, 3), worlds.blotches(f"side {k}"))
        for k, (x, y) in enumerate([(0, 8), (0, -8), (8, 3)])
    ]
    scene = worlds.world(sign, *others)
    poses = Pose(0, 0, 0), Pose(-2.0, 0.5, 0.05)
    features = [sight(pose, RIG, scene) for pose in poses]
    found = compare(*features, RIG, MatchConfig(group_rad=0.1)).common
    bearings = [(c, features[0].bearing_rad[c.support_a]) for c in found]
    behind = [(c, b) for c, b in bearings if np.abs(wrap_angle_rad(b - np.pi)).max() < 0.2]
    assert any((bearing > 3).any() and (bearing < -3).any() for _, bearing in behind)
    for claim, _ in behind:
        sides = (claim.a, claim.support_a), (claim.b, claim.support_b)
        for (region, support), pose, seen in zip(sides, poses, features, strict=True):
            assert region.view == 4 and region.angular_size_rad < 0.5
            bearing = pose.bearing_to_rad((-7.9, 0))
            assert abs(wrap_angle_rad(region.bearing_rad - bearing)) < 0.16
            check_region(region, seen.take(support))


def test_a_region_of_one_keypoint_lies_around_it() -> None:
    for bearing in np.linspace(-np.pi, np.pi, 41, endpoint=False):
        point = sights.features_of(np.array([bearing]), np.array([0.1]), sights.descriptors(1))
        region = panorama_region(point, RIG)
        assert wrap_angle_rad(region.bearing_rad - bearing) == pytest.approx(0, abs=1e-9)
        assert region.angular_size_rad == pytest.approx(0.01)
        check_region(region, point)


def test_a_region_as_wide_as_half_the_horizon_stays_in_its_view() -> None:
    wide = sights.features_of(np.linspace(-1.5, 1.5, 9), np.full(9, 0.1), sights.descriptors(9))
    region = panorama_region(wide, RIG)
    x0, y0, x1, y1 = region.box_px
    assert x0 == 0 and x1 > RIG.width_px - 1 and 0 <= y0 < y1 <= RIG.height_px
    assert region.angular_size_rad == pytest.approx(3.01, abs=0.01)


def test_the_ground_is_no_landmark() -> None:
    corners = [(-9, -9, 0.01), (9, -9, 0.01), (9, 9, 0.01), (-9, 9, 0.01)]
    carpet = worlds.place(
        "carpet", "ground", "carpet", [worlds.quad(corners, worlds.blotches("carpet", 512, 64))],
        Pose(0, 0), landmark=False, solid=False,
    )  # fmt: skip
    scene = worlds.Scene("carpet", (40.0, 40.0), (worlds.ground((40, 40)), carpet))
    a, b = sight(Pose(0, 0, 0), RIG, scene), sight(Pose(1, 0.5, 0.4), RIG, scene)
    found = compare(a, b, RIG)
    assert found.geometry is not None  # the two do know where they stand
    assert found.common == ()


def test_scenery_is_no_landmark() -> None:
    """What is many baselines away cannot be driven to; a larger limit lets it through."""
    middles = [(18 * np.cos(k), 18 * np.sin(k)) for k in range(6)]
    scene = worlds.world(
        *(
            worlds.box(f"far {k}", m, (4, 4, 6), worlds.blotches(f"f{k}"))
            for k, m in enumerate(middles)
        )
    )
    a, b = sight(Pose(0, 0, 0), RIG, scene), sight(Pose(0.9, 0, 0.2), RIG, scene)
    near, far = (compare(a, b, RIG, MatchConfig(max_range=r)) for r in (8.0, 40.0))
    assert near.common == () and len(far.common) > 5
    assert all(8 < max(c.ranges) <= 40 for c in far.common)


@pytest.mark.parametrize("limit", [{"min_score": 0.7}, {"min_support": 9}, {"min_slope": 0.1}])
def test_thresholds_only_ever_remove_claims(limit: dict) -> None:
    a, b = PAIRS[0]
    known = {tuple(c.support_a) for c in comparison(a, b).common}
    fewer = compare(sight(a), sight(b), RIG, MatchConfig(**limit)).common
    assert {tuple(c.support_a) for c in fewer} < known
    assert compare(sight(a), sight(b), RIG, MatchConfig(min_score=1.1)).common == ()


@pytest.mark.parametrize("n", [0, 1, 5])
def test_hardly_any_features_are_no_claim(n: int) -> None:
    few, many = sight(PAIRS[0][0]).take(np.arange(n)), sight(PAIRS[0][1])
    for a, b in ((few, many), (many, few), (few, few)):
        found = compare(a, b, RIG)
        assert found.common == () and found.geometry is None


def test_blank_panoramas_and_two_rigs_are_refused() -> None:
    a, b = (look(pose) for pose in PAIRS[0])
    blank = Panorama(RIG, np.full_like(a.views, 128))
    for pair, complaint in (
        ((blank, b), "the first panorama is blank"),
        ((a, blank), "the second panorama is blank"),
        ((a, look(PAIRS[0][1], CameraRig(8, 160, 120))), "one camera rig"),
    ):
        with pytest.raises(ImageError, match=complaint):
            common_landmarks(*pair)


def test_an_image_is_blank_or_it_is_not() -> None:
    check_not_blank(worlds.blotches("seen"), "this")
    noise = generator(0, "n").integers(0, 3, (40, 40, 3), np.uint8)
    for image in (np.zeros((1, 1, 3), np.uint8), np.full((9, 9, 3), 255, np.uint8), 100 + noise):
        with pytest.raises(ImageError, match="this is blank"):
            check_not_blank(image, "this")


def test_the_score_grows_with_support() -> None:
    scores = [support_score(n) for n in range(0, 400)]
    assert scores[0] == 0 and scores[5] == pytest.approx(0.5)
    assert support_score(16) == pytest.approx(0.9, abs=0.01)
    assert all(0 <= s <= 1 for s in scores) and scores == sorted(scores)


def test_groups_are_near_in_both_images() -> None:
    a = np.array([[0, 0], [0.01, 0], [0, 0.01], [1, 1], [1.01, 1.0], [0, 0.005]], dtype=float)
    b = a.copy()
    b[5] = (3, 3)  # near the first three in A only
    assert {tuple(g) for g in group_by_nearness(a, b, 0.05)} == {(0, 1, 2), (3, 4), (5,)}
    assert [len(g) for g in group_by_nearness(a[:1], b[:1], 0.05)] == [1]
    assert sum(len(g) for g in group_by_nearness(a[:0], b[:0], 0.05)) == 0


def test_groups_do_not_creep() -> None:
    street = np.column_stack([np.arange(100) * 0.02, np.zeros(100)])
    groups = group_by_nearness(street, street, 0.03)
    assert len(groups) > 10 and max(np.ptp(street[g, 0]) for g in groups) < 0.3
    assert sorted(np.concatenate(groups)) == list(range(100))

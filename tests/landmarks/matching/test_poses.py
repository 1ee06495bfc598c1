"""Relative poses of two records made of known points, some of which repeat."""

from dataclasses import replace

import numpy as np
import pytest
from sights import TwoViews, descriptors, two_views

from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.landmarks.extraction.proposer import nothing
from vrchain.landmarks.extraction.record import LandmarkRecord
from vrchain.landmarks.extraction.sift import NO_FEATURES, Features
from vrchain.landmarks.matching.poses import (
    SIGNS,
    PoseHypothesis,
    matches_of,
    pose_hypotheses,
)
from vrchain.panorama import CameraRig
from vrchain.seeding import generator

THERE = Pose(4.0, 3.0, 0.8)
OVER_OTHERS = SIGNS.index("evidence over the best other pose")
OVER_CHANCE = SIGNS.index("keypoints over chance")
SIZED = SIGNS.index("keypoints of the right size")


def record(features: Features) -> LandmarkRecord:
    return LandmarkRecord(CameraRig(), "made up", nothing(), features)


def records(
    views: TwoViews, sizes: bool = True, name: str = "points"
) -> tuple[LandmarkRecord, LandmarkRecord]:
    """sizes: keypoints look as large as their ranges say, all things being 0.3 m wide."""
    known = descriptors(len(views.a), name)
    made = []
    for pose, seen in ((Pose(0, 0), views.a), (views.pose_b, views.b)):
        range_m = np.hypot(*(views.points_m[:, :2] - pose.xy_m).T)
        size_rad = 0.3 / range_m if sizes else np.full(len(seen), 0.02)
        made.append(record(Features(seen[:, 0], seen[:, 1], size_rad, known)))
    return made[0], made[1]


def joined(*parts: LandmarkRecord) -> LandmarkRecord:
    """One record with the keypoints of all."""
    columns = zip(*(vars(p.features).values() for p in parts), strict=True)
    return record(Features(*(np.concatenate(column) for column in columns)))


def posed(a: LandmarkRecord, b: LandmarkRecord) -> list[PoseHypothesis]:
    found = pose_hypotheses(a, b, matches_of(a, b, sift=True, spots=False))
    return sorted(found, key=lambda p: -len(p.keypoints[0]))


def is_at(found: PoseHypothesis, pose: Pose) -> bool:
    off = (
        found.geometry.direction_rad - Pose(0, 0).bearing_to_rad(pose.xy_m),
        found.geometry.heading_rad - pose.yaw_rad,
    )
    return bool(np.abs(wrap_angle_rad(np.array(off))).max() < 0.02)


def test_the_pose_is_found_and_much_speaks_for_it() -> None:
    a, b = records(two_views(THERE, 60))
    best = posed(a, b)[0]
    assert is_at(best, THERE)
    assert len(best.keypoints[0]) == 60 and best.signs.shape == (len(SIGNS),)
    assert best.signs[OVER_CHANCE] > 2.0 and best.signs[OVER_OTHERS] > 1.0


def test_a_pose_that_fewer_obey_is_told_too() -> None:
    """Of two thirds of all points there is a twin elsewhere: the truth is not the first answer."""
    elsewhere = Pose(-6.0, 1.0, -2.0)
    few, many = (
        records(two_views(THERE, 30)),
        records(two_views(elsewhere, 60, seed=3), name="twin"),
    )
    found = posed(joined(few[0], many[0]), joined(few[1], many[1]))
    assert is_at(found[0], elsewhere)
    assert any(is_at(other, THERE) for other in found[1:])
    assert not any(
        one.geometry.near(other.geometry) for k, one in enumerate(found) for other in found[:k]
    )


def test_a_few_clear_matches_outweigh_many_unclear_ones() -> None:
    """Descriptors of the many have near twins in B, so their ratios are close to the test's."""
    elsewhere = Pose(-6.0, 1.0, -2.0)
    few, many = records(two_views(THERE, 40)), records(two_views(elsewhere, 60), name="twin")
    spread = generator(0, "unclear").integers(-9, 10, (2, *many[0].features.descriptors.shape))
    near, nearer = (
        (many[0].features.descriptors + step * share).clip(0, 255).astype(np.uint8)
        for step, share in zip(spread, (3, 2), strict=True)
    )
    twins = replace(many[1], features=replace(many[1].features, descriptors=near))
    unclear = replace(many[1], features=replace(many[1].features, descriptors=nearer))
    # the twins stand elsewhere still, and match nothing under any pose
    turned = replace(twins.features, bearing_rad=wrap_angle_rad(twins.features.bearing_rad + 2.0))
    a = joined(few[0], many[0])
    b = joined(few[1], unclear, replace(twins, features=turned))
    of_few, of_many = (
        next(p for p in posed(a, b) if is_at(p, pose)) for pose in (THERE, elsewhere)
    )
    assert len(of_many.keypoints[0]) > len(of_few.keypoints[0])
    assert of_few.signs[OVER_OTHERS] > 0 > of_many.signs[OVER_OTHERS]


def test_keypoints_that_do_not_look_as_large_as_their_ranges_say_count_for_nothing() -> None:
    views = two_views(Pose(7.0, 0.0, 0.3), 80)
    true, flat = (posed(*records(views, sizes))[0] for sizes in (True, False))
    assert is_at(true, views.pose_b) and is_at(flat, views.pose_b)
    assert true.signs[SIZED] == pytest.approx(0.0, abs=0.03)
    assert flat.signs[SIZED] < -0.1 and flat.signs[OVER_CHANCE] < true.signs[OVER_CHANCE]


def test_it_does_not_matter_which_way_the_robots_face() -> None:
    a, b = records(two_views(THERE, 60))
    turned = replace(b.features, bearing_rad=wrap_angle_rad(b.features.bearing_rad + 1.5))
    before, after = posed(a, b)[0], posed(a, replace(b, features=turned))[0]
    assert after.geometry.direction_rad == pytest.approx(before.geometry.direction_rad, abs=1e-6)
    turn = after.geometry.heading_rad - before.geometry.heading_rad
    assert wrap_angle_rad(turn + 1.5) == pytest.approx(0, abs=1e-6)


def test_where_nothing_matches_there_is_no_pose() -> None:
    a, _ = records(two_views(THERE, 60))
    other, _ = records(two_views(THERE, 60), name="others")
    for one in (record(NO_FEATURES), record(a.features.take([0]))):
        assert posed(a, one) == [] and posed(one, a) == []
    assert all(len(p.keypoints[0]) < 20 for p in posed(a, other))

"""Of what looks alike, only what may be one point matches."""

from dataclasses import replace

import numpy as np
from sights import descriptors, two_views

from vrchain.geometry import Pose
from vrchain.landmarks.extraction.sift import Features
from vrchain.landmarks.matching.epipolar import PlanarGeometry
from vrchain.landmarks.matching.guided import keypoints_under, matched_under, mutual

B = Pose(6.0, 2.0, 1.1)
VIEWS = two_views(B, 60)
TRUE = PlanarGeometry(VIEWS.direction_rad, 1.1, np.ones(0, dtype=bool), 0.0)
ALL = np.arange(60)


def matched(geometry: PlanarGeometry, inside: list, looks: np.ndarray, least: float = 0.0) -> list:
    return matched_under(
        geometry, *VIEWS.matches, inside,
        lambda ia, ib: looks[np.ix_(ia, ib)], least, 0.002,
    )  # fmt: skip


def test_each_is_matched_with_its_own_where_another_looks_more_alike() -> None:
    looks = np.eye(60, dtype=np.float32) + 0.1
    looks[ALL, (ALL + 7) % 60] = 1.5  # more alike, but cannot be the same point
    ((ia, ib, alike),) = matched(TRUE, [(ALL, ALL)], looks)
    assert (ia == ib).mean() > 0.9 and len(ia) > 50
    assert (alike[ia == ib] == np.float32(1.1)).all()


def test_regions_keep_to_themselves() -> None:
    looks = np.eye(60, dtype=np.float32)
    halves = [(ALL[:30], ALL[:30]), (ALL[30:], ALL[30:]), (ALL[:30], ALL[30:]), (ALL[:0], ALL)]
    first, second, crossed, empty = matched(TRUE, halves, looks, 0.5)
    for found, own in ((first, ALL[:30]), (second, ALL[30:])):
        assert np.array_equal(found[0], own) and np.array_equal(found[1], own)
    assert [len(side) for side in crossed] == [0, 0, 0] == [len(side) for side in empty]


def test_of_many_that_look_the_same_one_is_matched() -> None:
    row, column = mutual(np.ones((50, 40), dtype=np.float32))
    assert row.tolist() == column.tolist() == [0]


def test_what_is_no_more_alike_than_the_least_and_what_no_pose_allows_does_not_match() -> None:
    wrong = PlanarGeometry(TRUE.direction_rad, TRUE.heading_rad + 0.5, TRUE.inliers, 0.0)
    looks = np.eye(60, dtype=np.float32)
    assert len(matched(wrong, [(ALL, ALL)], looks, 0.5)[0][0]) < 6
    assert len(matched(TRUE, [(ALL, ALL)], looks, 1.0)[0][0]) == 0


def test_under_a_pose_keypoints_match_that_others_outdo_elsewhere() -> None:
    known = descriptors(60)
    range_m = (np.hypot(*(VIEWS.points_m[:, :2] - xy).T) for xy in (np.zeros(2), B.xy_m))
    a, b = (
        Features(seen[:, 0], seen[:, 1], 0.3 / away, known)
        for seen, away in zip((VIEWS.a, VIEWS.b), range_m, strict=True)
    )
    ia, ib = keypoints_under(a, b, TRUE)
    assert len(ia) > 50 and (ia == ib).all()
    shifted = replace(TRUE, heading_rad=TRUE.heading_rad + 0.5)
    assert len(keypoints_under(a, b, shifted)[0]) < 10
    larger = replace(b, size_rad=b.size_rad * 2)  # nothing grows in B alone
    assert len(keypoints_under(a, larger, TRUE)[0]) < 10

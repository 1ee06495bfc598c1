"""Groups of keypoints that agree on a pose, where nothing is proposed."""

from dataclasses import replace

import numpy as np
import pytest
from sights import TwoViews, descriptors, directions

from vrchain.geometry import Pose
from vrchain.landmarks.extraction.proposer import nothing
from vrchain.landmarks.extraction.raster import CELL_PX, ROWS, columns_of
from vrchain.landmarks.extraction.record import LandmarkRecord
from vrchain.landmarks.extraction.sift import Features
from vrchain.landmarks.matching.claims import (
    Candidates,
    claims_of_groups,
    group_signs,
    grouped,
)
from vrchain.landmarks.matching.epipolar import PlanarGeometry
from vrchain.panorama import CameraRig
from vrchain.seeding import generator

A, B = Pose(0.0, 0.0), Pose(2.0, 0.0, 0.4)


def cluster(xyz_m: tuple[float, float, float], n: int = 6, span_m: float = 0.2) -> np.ndarray:
    around = generator(0, "cluster", *map(str, xyz_m)).uniform(-span_m, span_m, (n, 3))
    return np.array(xyz_m) + around * (1, 1, 0.3)


def agreed(*clusters: np.ndarray) -> tuple[LandmarkRecord, LandmarkRecord, Candidates]:
    """Points that all agree on the true pose; cameras are 1 m high."""
    points_m = np.concatenate(clusters)
    views = TwoViews(B, points_m, np.ones(len(points_m), bool), *(
        np.column_stack(directions(pose, points_m)) for pose in (A, B)
    ))  # fmt: skip
    a, b = (
        LandmarkRecord(CameraRig(), "made up", nothing(), Features(
            seen[:, 0], seen[:, 1], np.full(len(seen), 0.02), descriptors(len(seen), "points")
        ))
        for seen in views.matches
    )  # fmt: skip
    n = len(points_m)
    geometry = PlanarGeometry(0.0, 0.4, np.ones(n, dtype=bool), 0.001, 2.0)
    none = np.empty((0, 2), dtype=np.int64), np.empty((0, 16))
    own = np.arange(n), np.arange(n)
    return a, b, Candidates(*none, [], [], geometry, 3.0, own)


FLOOR = tuple(cluster((x, y, 0.0), 4, 0.05) for x, y in ((1, 2), (1.5, -2), (-1, 1.5), (3, 2.5)))
TABLE = cluster((1.0, 3.0, 0.6))  # lower than the cameras


def test_what_stands_on_the_ground_is_claimed_and_the_ground_is_not() -> None:
    a, b, found = agreed(TABLE, *FLOOR)
    (group,) = grouped(a, b, found, [])
    assert sorted(group.keypoints[0]) == list(range(len(TABLE)))
    assert group.heights == pytest.approx(np.hypot(1, 3), rel=0.2)
    (claim,) = claims_of_groups(a, b, [group], np.array([0.8]), 0.75)
    assert claim.score == 0.8 and claim.ranges is not None
    assert claim.ranges[0] * 2.0 == pytest.approx(np.hypot(1, 3), rel=0.1)


def test_where_no_ground_is_seen_only_what_reaches_the_horizon_is_claimed() -> None:
    a, b, found = agreed(TABLE, cluster((2.0, -3.0, 1.4)), cluster((-3.0, 2.0, 1.3), 2))
    (group,) = grouped(a, b, found, [])  # two keypoints alone are no group
    assert min(group.keypoints[0]) == len(TABLE)


def test_what_lies_in_a_claimed_proposal_is_not_claimed_again() -> None:
    a, b, found = agreed(TABLE, *FLOOR)
    cells = np.arange(ROWS // CELL_PX * (columns_of(a.rig) // CELL_PX))
    everything = replace(nothing(), cell=cells, owner=np.zeros_like(cells))
    proposed = replace(a, proposals=everything)
    pair = replace(found, pairs=np.zeros((1, 2), dtype=np.int64))
    assert len(grouped(proposed, b, pair, [])) == 1  # proposed, but not claimed
    assert grouped(proposed, b, pair, [0]) == []


def test_unlikely_groups_are_not_claimed() -> None:
    a, b, found = agreed(TABLE, *FLOOR)
    groups = grouped(a, b, found, [])
    assert claims_of_groups(a, b, groups, np.array([0.7]), 0.75) == []
    signs = [group_signs(groups, chance) for chance in (0.0, 0.5, 1.0)]
    assert np.isfinite(signs).all() and signs[0][0, -1] < signs[1][0, -1] < signs[2][0, -1]
    assert group_signs([], 0.5).shape == (0, signs[0].shape[1])

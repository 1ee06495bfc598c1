"""Spots of made-up things, described as a network would that is never wrong."""

from functools import cache

import answers
import numpy as np
import pytest

from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.landmarks.extraction.proposer import Proposals, nothing
from vrchain.landmarks.extraction.spots import (
    EACH,
    NO_SPOTS,
    ONE,
    Spots,
    described,
)
from vrchain.landmarks.matching.epipolar import PlanarGeometry, estimate
from vrchain.landmarks.matching.guided import spots_anywhere, spots_within

CENTRES_M = np.array([[7.0, 0.0], [0.0, 9.0], [-8.0, 1.0], [4.0, -10.0], [-7.0, -7.0]])
A, B = Pose(0.0, 0.0, 0.3), Pose(1.5, 1.0, -0.8)
DIRECTION_RAD = A.bearing_to_rad(B.xy_m)
HEADING_RAD = B.yaw_rad - A.yaw_rad
TRUE = PlanarGeometry(DIRECTION_RAD, HEADING_RAD, np.ones(0, dtype=bool), 0.0)


@cache
def seen(pose: Pose) -> tuple[Proposals, Spots]:
    found = answers.record(pose, CENTRES_M)
    return found.proposals, found.spots


def of_one_thing() -> np.ndarray:
    """Pairs of proposals of A and of B, (n, 2)."""
    alike = seen(A)[0].embedding @ seen(B)[0].embedding.T
    return np.stack([np.arange(len(alike)), alike.argmax(axis=1)], axis=1)


def test_large_things_give_a_sample_small_ones_all_their_cells() -> None:
    proposals, spots = seen(A)
    cells, held = (np.bincount(owner) for owner in (proposals.owner, spots.owner))
    assert cells.max() > 2 * EACH and held.max() <= EACH
    assert (held[cells <= EACH] == cells[cells <= EACH]).all() and held.min() > EACH / 4
    length = np.linalg.norm(spots.descriptors.astype(float), axis=1)
    assert np.abs(length - ONE).max() < 4


def test_spots_lie_where_their_things_are_seen() -> None:
    proposals, spots = seen(A)
    right, left, low, high = proposals.box[spots.owner].T
    aside = wrap_angle_rad(spots.bearing_rad - (right + left) / 2)
    assert (np.abs(aside) <= (left - right) / 2 + 0.01).all()
    assert ((spots.slope >= low - 0.01) & (spots.slope <= high + 0.01)).all()


def test_matched_spots_are_of_one_thing_and_say_where_b_stands() -> None:
    (_, a), (_, b) = seen(A), seen(B)
    ia, ib = spots_anywhere(a, b)
    assert len(ia) > 100 and len(set(ia)) == len(ia) and len(set(ib)) == len(ib)
    same = dict(of_one_thing().tolist())
    right = [same[i] == j for i, j in zip(a.owner[ia], b.owner[ib], strict=True)]
    assert np.mean(right) > 0.9
    found = estimate(a.directions[ia], b.directions[ib], 8, 0.012)
    assert found is not None
    assert abs(wrap_angle_rad(found.direction_rad - DIRECTION_RAD)) < np.radians(5)
    assert abs(wrap_angle_rad(found.heading_rad - HEADING_RAD)) < np.radians(2)


def test_within_pairs_only_what_the_pose_lets_is_matched() -> None:
    (_, a), (_, b) = seen(A), seen(B)
    pairs = of_one_thing()
    found = spots_within(a, b, pairs, TRUE)
    for (i, j), (ia, ib, alike) in zip(pairs, found, strict=True):
        assert len(ia) > 5 and (a.owner[ia] == i).all() and (b.owner[ib] == j).all()
        assert ((alike > 0.3) & (alike < 1.02)).all()
        assert TRUE.obeyed(a.directions[ia], b.directions[ib], 0.013).all()
    wrong = PlanarGeometry(DIRECTION_RAD, HEADING_RAD + 1.0, np.ones(0, dtype=bool), 0.0)
    lost = spots_within(a, b, pairs, wrong)
    assert sum(len(f[0]) for f in lost) < 0.2 * sum(len(f[0]) for f in found)


@pytest.mark.parametrize("other", [NO_SPOTS, seen(A)[1]])
def test_where_there_is_nothing_nothing_matches(other: Spots) -> None:
    assert [len(side) for side in spots_anywhere(NO_SPOTS, other)] == [0, 0]
    ((ia, ib, alike),) = spots_within(NO_SPOTS, other, np.array([[0, 0]]), TRUE)
    assert len(ia) == len(ib) == len(alike) == 0
    assert len(described(nothing())) == 0

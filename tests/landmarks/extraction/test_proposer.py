import answers
import numpy as np
import pytest

from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.landmarks.extraction.proposer import from_answers, nothing, overlaps, propose
from vrchain.panorama import Panorama
from vrchain.seeding import generator

CENTRES_M = np.array([[10.0, 0.0], [0.0, 14.0], [-9.0, 1.0], [4.0, -20.0], [-15.0, -15.0]])
HERE = Pose(0, 0, 0)


@pytest.mark.parametrize("yaw_rad", [0.0, 1.0, 3.0, -3.1])
def test_what_a_perfect_network_says_is_what_is_proposed(yaw_rad: float) -> None:
    """Whatever the heading: a thing across the seam is one proposal like any other."""
    pose = Pose(0.5, -0.3, yaw_rad)
    cells = answers.posts(pose, CENTRES_M)
    found = from_answers(answers.said(pose, CENTRES_M), answers.RIG)
    which = (found.embedding @ answers.looks(len(CENTRES_M)).T).argmax(axis=1)
    assert sorted(which) == list(range(len(CENTRES_M)))
    away = CENTRES_M[which] - pose.xy_m
    bearing = np.arctan2(away[:, 1], away[:, 0]) - yaw_rad
    assert np.abs(wrap_angle_rad(found.bearing_rad - bearing)).max() < 1e-5
    assert np.abs(found.range_m / np.hypot(*away.T) - 1).max() < 1e-5
    assert (found.kind == which).all()
    for i, thing in enumerate(which):
        own = found.cell[found.owner == i]
        assert set(own) == set(np.flatnonzero(cells.ravel() == thing))
        right, left, low, high = found.box[i]
        middle = wrap_angle_rad((left + right) / 2 - bearing[i])
        assert right < left and low < high and abs(middle) < 0.02


def test_surest_first() -> None:
    answered = answers.said(HERE, CENTRES_M)
    answered["fit"][0][answers.posts(HERE, CENTRES_M) == 3] -= 3.0
    found = from_answers(answered, answers.RIG)
    assert (np.diff(found.score) <= 0).all() and found.kind[-1] == 3


def test_nothing_is_proposed_where_nothing_is_said() -> None:
    answered = answers.said(HERE, np.empty((0, 2)))
    assert len(from_answers(answered, answers.RIG)) == len(nothing()) == 0


def test_answers_without_sense_give_proposals_that_make_sense() -> None:
    draws = generator(1, "noise")
    answered = {  # half a turn, stretched to a whole one: enough for more than are kept
        name: draws.normal(scale=3, size=(*a.shape[:2], a.shape[2] // 2)).astype(np.float32)
        for name, a in answers.said(HERE, CENTRES_M).items()
    }
    found = from_answers(answered, answers.RIG)
    assert len(found) == 160
    assert np.isfinite(found.xy_m).all() and np.isfinite(found.box).all()
    assert np.allclose(np.linalg.norm(found.embedding, axis=1), 1, atol=1e-5)
    assert set(found.owner) == set(range(len(found)))


def test_take_keeps_each_proposal_with_its_cells() -> None:
    found = from_answers(answers.said(HERE, CENTRES_M), answers.RIG)
    chosen = found.take([3, 1])
    for new, old in ((0, 3), (1, 1)):
        assert (chosen.embedding[new] == found.embedding[old]).all()
        assert set(chosen.cell[chosen.owner == new]) == set(found.cell[found.owner == old])


def test_boxes_overlap_across_the_seam() -> None:
    a = np.array([[535.0, 10.0, 545.0, 20.0]])
    b = np.array([[-5.0, 10.0, 5.0, 20.0], [5.0, 10.0, 15.0, 20.0], [0.0, 10.0, 10.0, 20.0]])
    assert np.allclose(overlaps(a, b, 540), [[1.0, 0.0, 1 / 3]])
    assert np.allclose(overlaps(a, b), 0.0)


def test_nothing_is_proposed_where_no_camera_looks() -> None:
    """Whatever the network says of it: it sees black there."""
    draws = generator(2, "views")
    views = draws.integers(0, 256, (8, 480, 640, 3), dtype=np.uint8)
    views = np.kron(views[:, ::8, ::8], np.ones((1, 8, 8, 1), dtype=np.uint8))
    seen = np.ones(views.shape[:3], dtype=bool)
    seen[3:6] = False

    def network(picture: np.ndarray) -> dict[str, np.ndarray]:
        return answers.said(HERE, CENTRES_M)

    everywhere, _ = propose(Panorama(answers.RIG, views), network)
    found, _ = propose(Panorama(answers.RIG, views, seen), network)
    ahead = np.abs(everywhere.bearing_rad) < np.radians(112.5)
    assert 0 < len(found) == ahead.sum() < len(everywhere)
    assert set(found.kind) == set(everywhere.kind[ahead])

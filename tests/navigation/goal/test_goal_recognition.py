from dataclasses import replace

import answers
import numpy as np
import pytest
from plains import CALIBRATION, Plain, Thing

from vrchain.geometry import Pose
from vrchain.landmarks.extraction.proposer import from_answers, nothing
from vrchain.landmarks.extraction.record import LandmarkRecord
from vrchain.landmarks.extraction.sift import NO_FEATURES, Features
from vrchain.landmarks.extraction.spots import NO_SPOTS
from vrchain.landmarks.retrieval.query import query_of
from vrchain.landmarks.retrieval.template import Goal, Sighting, Template, locate
from vrchain.navigation.goal import recognition
from vrchain.navigation.goal.recognition import GoalPictures, GoalSight, _of_subject, _taken_m

HERE = Pose(0.0, 0.0, 0.3)
PLAIN = Plain(
    (
        Thing("goal", (12.0, 3.0)),
        Thing("other", (10.0, -6.0)),
        Thing("double", (-9.0, 5.0), looks="goal", share=0.2),
    )
)
GOAL = PLAIN.goal("goal", 3.4, 1.8, -2.0, 0.2)


def test_the_goal_is_found_where_it_is() -> None:
    sight = GOAL.find(PLAIN.look(HERE))
    assert sight is not None and sight.chance > 0.95 and sight.n_matches > 30
    assert sight.bearing_rad == pytest.approx(HERE.bearing_to_rad((12.0, 3.0)), abs=0.03)
    assert sight.range_m == pytest.approx(HERE.distance_to_m((12.0, 3.0)), abs=0.1)
    assert sight.surface_m == pytest.approx(sight.range_m, rel=0.15)


def test_a_double_and_what_looks_otherwise_are_less_likely() -> None:
    true = GOAL.find(PLAIN.look(HERE))
    double = GOAL.find(PLAIN.look(HERE), HERE.bearing_to_rad((-9.0, 5.0)), 0.2)
    other = GOAL.find(PLAIN.look(HERE), HERE.bearing_to_rad((10.0, -6.0)), 0.2)
    assert true and double and other
    assert true.chance > double.chance > other.chance
    assert other.chance < 0.05


def test_behind_what_is_known_to_be_no_goal_another_is_found() -> None:
    look = PLAIN.look(HERE)
    best = GOAL.find(look)
    second = GOAL.find(look, fair=lambda sight: sight != best)
    assert best and second and second.chance < best.chance
    assert second.bearing_rad == pytest.approx(HERE.bearing_to_rad((-9.0, 5.0)), abs=0.03)
    assert GOAL.find(look, fair=lambda sight: False) is None


def test_behind_many_that_are_known_to_be_no_goal_it_is_found() -> None:
    things = [Thing(f"double {k}", (9.0, 8.0 - 4 * k), looks="goal") for k in range(5)]
    look, refuted = Plain(tuple(things)).look(HERE), list[GoalSight]()
    while sight := GOAL.find(look, fair=lambda sight: sight not in refuted):
        refuted.append(sight)
    assert len({sight.bearing_rad for sight in refuted}) == 5


def test_each_proposal_of_a_look_is_searched_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keypoints are costly, and a look is asked for the goal again and again."""
    searched: list[Features] = []

    def counted(template: Template, features: Features, **limits: int) -> Sighting | None:
        searched.append(features)
        return locate(template, features, **limits)

    monkeypatch.setattr(recognition, "locate", counted)
    goal, look = replace(GOAL), PLAIN.look(HERE)
    best = goal.find(look)
    once = len(searched)
    assert once and goal.find(look) is best and goal.find(look, 0.2, 3.0) is best
    assert len(searched) == once
    assert goal.find(PLAIN.look(Pose(2.0, 0.0))) != best and len(searched) > once


def test_nothing_is_found_where_nothing_is_or_by_no_picture() -> None:
    look = PLAIN.look(HERE)
    assert GOAL.find(look, HERE.bearing_to_rad((0.0, -10.0)), 0.1) is None
    empty = Plain((Thing("gone", (5.0, 0.0), visible_from=lambda pose: False),)).look(HERE)
    assert GOAL.find(empty) is None
    assert GoalPictures(query_of([]), Goal(()), CALIBRATION, ()).find(look) is None


def test_without_spots_and_keypoints_looks_alone_prove_nothing() -> None:
    look = replace(PLAIN.look(HERE), spots=NO_SPOTS)
    bare = replace(GOAL, keypoints=Goal(()))
    sight = bare.find(look)
    assert sight is not None and sight.n_matches == 0 and sight.chance < 0.1


def test_how_far_the_goal_is_by_how_large_it_looks() -> None:
    for x_m, range_m in ((0.0, 12.0), (4.0, 8.0)):
        sight = GOAL.find(PLAIN.look(Pose(x_m, 3.0)))
        assert sight and sight.sized and sight.surface_m == pytest.approx(range_m, rel=0.2)
    assert not replace(GOAL, keypoints=Goal(())).find(PLAIN.look(HERE)).sized


def test_what_stands_beside_a_pictures_subject_is_not_of_it() -> None:
    centres_m = np.array([[10.0, 0.0], [8.0, 6.0]])
    said = answers.perfect(
        answers.posts(Pose(0, 0), centres_m), Pose(0, 0), centres_m, answers.looks(2)
    )
    found = from_answers(said, answers.RIG)
    picture = LandmarkRecord(answers.RIG, "ab" * 32, found, NO_FEATURES)
    bearing = np.array([0.0, np.arctan2(6.0, 8.0), 2.0])  # the subject, what is beside it, nothing
    keypoints = Features(
        bearing, np.full(3, 0.05), np.full(3, 0.01), np.zeros((3, 128), dtype=np.uint8)
    )
    kept, foot_m = _of_subject(Template(keypoints, 0.5), picture)
    assert foot_m == pytest.approx(10.0, rel=0.06), "from where its subject stands"
    assert kept.features.bearing_rad.tolist() == [0.0] and kept.half_width_rad == 0.5
    unknown = replace(picture, proposals=nothing())
    of_all, nowhere_m = _of_subject(Template(keypoints, 0.5), unknown)
    assert len(of_all.features) == 3 and nowhere_m == np.inf


def test_how_far_a_picture_was_taken_is_told_by_the_ground_or_by_other_pictures() -> None:
    def shown(range_m: float) -> Template:
        place = Pose(12.0 - range_m, 3.0)
        return Template(PLAIN.look(place).features_near(0.0, 0.3), 0.3)

    both = [shown(8.0), shown(12.0)]
    assert _taken_m(both, [8.0, 12.0], 1.0) == (8.0, 12.0)
    assert _taken_m(both, [8.0, 5.5], 1.0) == (8.0, 6.0), "the nearest that is usual"
    for hovers_m in (np.inf, 30.0, 3.0):
        assert _taken_m(both, [8.0, hovers_m], 1.0) == pytest.approx((8.0, 12.0), rel=0.1)
    usual_m = 90**0.5
    assert _taken_m(both, [np.inf, np.inf], 1.0) == pytest.approx((usual_m, usual_m))
    assert _taken_m(both, [np.inf, np.inf], 0.5) == pytest.approx((usual_m / 2, usual_m / 2))
    assert _taken_m([], [], 1.0) == ()

from typing import Any

import numpy as np
import pandas as pd
import pytest
import sights
import worlds
from sights import RIG

from vrchain.errors import MissionError
from vrchain.experiments.landmarks import pairs as landmark_pairs
from vrchain.experiments.landmarks.pairs import Look, claims_of, draw_pairs, draw_poses
from vrchain.experiments.landmarks.precision import summarise_survey
from vrchain.geometry import Pose
from vrchain.landmarks.matching.common import Comparison, MatchConfig, compare
from vrchain.seeding import generator


def test_poses_are_free_and_seeded() -> None:
    scene = sights.yard()
    poses = draw_poses(scene, 5, generator(0, "poses"))
    assert scene.is_free([p.xy_m for p in poses]).all() and len(set(poses)) == 5
    assert poses == draw_poses(scene, 6, generator(0, "poses"))[:5]
    full = worlds.world(worlds.box("all", (0, 0), (40.0, 40.0, 2.0), worlds.plain(worlds.RED)))
    with pytest.raises(MissionError, match="found only 0 of 2 free places"):
        draw_poses(full, 2, generator(0, "poses"))


def test_pairs_are_free_and_in_the_band() -> None:
    scene = sights.yard()
    pairs = list(draw_pairs(scene, 30, (4.0, 9.0), 1))
    assert len(pairs) == 30
    spacing = [a.distance_to_m(b.xy_m) for a, b in pairs]
    assert 4 <= min(spacing) < 5 and 8 < max(spacing) <= 9
    for a, b in pairs:
        scene.check_pose(a)
        scene.check_pose(b)
    turns = [a.yaw_rad - b.yaw_rad for a, b in pairs]
    assert np.std(turns) > 1
    assert pairs == list(draw_pairs(scene, 30, (4.0, 9.0), 1))
    assert pairs != list(draw_pairs(scene, 30, (4.0, 9.0), 2))
    assert pairs[:10] == list(draw_pairs(scene, 10, (4.0, 9.0), 1))  # more pairs add, not change


def test_pairs_that_cannot_be_are_said_plainly() -> None:
    with pytest.raises(MissionError, match="found only 0 of 2 pairs"):
        list(draw_pairs(worlds.world(extent_m=(4.0, 4.0)), 2, (30.0, 40.0), 0))


@pytest.mark.parametrize("spacing_m", [5.0, (), (9.0, 4.0), ("near", "far"), (-1.0, 2.0), None])
def test_a_spacing_that_is_none_is_refused(spacing_m: Any) -> None:
    with pytest.raises(MissionError, match="expected a spacing from low to high"):
        next(draw_pairs(sights.yard(), 1, spacing_m, 0))


def measure() -> pd.DataFrame:
    pairs = draw_pairs(sights.yard(), 4, (3.0, 6.0), 2)
    looks = ((Look(a, sights.sight(a)), Look(b, sights.sight(b))) for a, b in pairs)
    return claims_of(looks, sights.yard_truth(), RIG)


@pytest.fixture(scope="module")
def measured() -> pd.DataFrame:
    return measure()


def test_claims_in_the_yard(measured: pd.DataFrame) -> None:
    assert set(measured.pair) == {0, 1, 2, 3}
    pd.testing.assert_frame_equal(measure(), measured)  # the same seed, the same table
    made = measured[measured.score.notna()]
    assert len(made) > 10
    found = summarise_survey(measured)
    assert found["precision"] > 0.9 and found["pair_success"] >= 0.75
    assert 0 < found["recall"] <= 1
    assert (measured.co_visible >= 4).all() and measured.spacing_m.between(3, 6).all()
    assert (made.support >= MatchConfig().min_support).all() and made.score.between(0.5, 1).all()
    names = {o.name for o in sights.yard().objects} | {"sky"}
    assert set(made.object) <= names
    first = ~made.duplicated(["pair", "object"])
    assert (
        made.duplicate.astype(bool)[made.right.astype(bool)] == ~first[made.right.astype(bool)]
    ).all()


def test_a_pair_without_a_claim_keeps_its_row(monkeypatch: pytest.MonkeyPatch) -> None:
    answers = iter([lambda *asked: Comparison((), None), compare])
    monkeypatch.setattr(landmark_pairs, "compare", lambda *asked: next(answers)(*asked))
    a, b = Pose(0, 0, 0.3), Pose(3, 1, -2.0)
    looks = [(Look(a, sights.sight(a)), Look(b, sights.sight(b)))] * 2
    mixed = claims_of(looks, sights.yard_truth(), RIG)
    silent = mixed[mixed.pair == 0]
    assert len(silent) == 1 and silent.score.isna().all() and (silent.co_visible > 0).all()
    assert set(mixed.pair) == {0, 1} and mixed[mixed.pair == 1].score.notna().all()
    assert summarise_survey(mixed)["n_pairs"] == 2

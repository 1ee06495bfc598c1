from dataclasses import replace

import numpy as np
import pytest
from plains import Plain, Thing

from vrchain.geometry import Pose
from vrchain.landmarks.matching.common import CommonLandmark, Comparison, Region
from vrchain.landmarks.matching.epipolar import PlanarGeometry
from vrchain.navigation.perception import chance_joined, surface_m, trust, turned

HERE = Pose(0.0, 0.0)
STREET = Plain(tuple(Thing(f"t{i}", (12 * np.cos(i), 12 * np.sin(i))) for i in range(6)))


def test_what_one_camera_sees_is_told_from_the_robots_heading() -> None:
    look = STREET.look(HERE)
    told = turned(look, 0.7)
    for before, after in (
        (look.proposals.bearing_rad, told.proposals.bearing_rad),
        (look.features.bearing_rad, told.features.bearing_rad),
        (look.spots.bearing_rad, told.spots.bearing_rad),
    ):
        assert np.exp(1j * after) == pytest.approx(np.exp(1j * (before + 0.7)))
    assert told.proposals.box[:, :2] == pytest.approx(look.proposals.box[:, :2] + 0.7)


def found(n: int, score: float = 0.9, way_m: float = np.inf) -> Comparison:
    """So many claims, of places so far apart: infinite, if nothing tells."""
    region, none = Region(0, (0.0, 0.0, 1.0, 1.0), 0.0, 0.1), np.empty(0, dtype=np.int64)
    heights = way_m / STREET.look(HERE).rig.camera_height_m
    geometry = PlanarGeometry(0.0, 0.0, np.ones(n, dtype=bool), 0.0, heights)
    return Comparison((CommonLandmark(score, region, region, none, none),) * n, geometry)


def test_a_relative_pose_is_trusted_more_the_more_speaks_for_it() -> None:
    crowd = (Thing(f"t{i}", (30 * np.cos(i), 30 * np.sin(i))) for i in range(60))
    look = Plain(tuple(crowd)).look(HERE)
    by_claims = [trust(look, look, found(n, way_m=15.0)) for n in range(6)]
    assert by_claims[0] == 0.0 and (np.diff(by_claims) > 0).all() and by_claims[-1] < 1.0
    by_score = [trust(look, look, found(2, score, 15.0)) for score in (0.75, 0.85, 0.95)]
    assert (np.diff(by_score) > 0).all()
    # what looks alike by chance seems to be near
    by_way = [trust(look, look, found(2, way_m=way_m)) for way_m in (5.0, 10.0, 20.0)]
    assert (np.diff(by_way) > 0).all()
    assert trust(look, look, found(0)) == 0.0 < trust(look, look, found(2)) < 1.0


def test_a_things_side_is_where_it_stands_on_the_ground() -> None:
    look = STREET.look(HERE)
    assert surface_m(look, 0) == pytest.approx(12.0 - 1.5)
    floating = look.proposals.box.copy()
    floating[0, 2] = 0.1  # its foot is hidden
    hidden = replace(look, proposals=replace(look.proposals, box=floating))
    assert surface_m(hidden, 0) == pytest.approx(12.0)


def at(heights: float) -> PlanarGeometry:
    return PlanarGeometry(0.0, 0.0, np.ones(5, dtype=bool), 0.0, heights)


def test_more_and_surer_claims_are_trusted_more_and_near_ones_less() -> None:
    chance = [chance_joined([0.9] * n, 40, at(30.0)) for n in range(6)]
    assert chance[0] == 0.0 and chance == sorted(set(chance)) and chance[-1] < 1.0
    assert chance_joined([0.5] * 2, 40, at(30.0)) < chance[2]
    assert chance_joined([0.9] * 2, 40, at(2.0)) < chance[2]
    for nothing_told in (None, at(np.nan)):
        assert chance_joined([0.9] * 2, 40, nothing_told) == chance[2]


def test_where_much_is_proposed_few_claims_say_little_and_none_say_nothing() -> None:
    assert chance_joined([0.9] * 3, 100, None) < 0.3 < 0.95 < chance_joined([0.9] * 3, 20, None)
    assert [chance_joined([], n, at(5.0)) for n in (0, 1, 1000)] == [0.0] * 3

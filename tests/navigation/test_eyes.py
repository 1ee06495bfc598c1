from dataclasses import replace

import numpy as np
import pytest

from navigation.plains import RIG, Plain, Thing
from vrchain.geometry import Pose
from vrchain.landmarks.common import CommonLandmark, Comparison, Region
from vrchain.landmarks.epipolar import PlanarGeometry
from vrchain.navigation.eyes import in_robots_frame, surface_m, trusted
from vrchain.robot import Observation

HERE = Pose(0.0, 0.0)
STREET = Plain(tuple(Thing(f"t{i}", (12 * np.cos(i), 12 * np.sin(i))) for i in range(6)))
REGION = Region(0, (0.0, 0.0, 10.0, 10.0), 0.1, 0.2)
NONE = np.empty(0, dtype=np.int64)


def joined(n: int, apart_m: float, score: float = 0.9) -> Comparison:
    geometry = PlanarGeometry(0.0, 0.0, np.ones(n, dtype=bool), 0.0, apart_m / RIG.camera_height_m)
    return Comparison((CommonLandmark(score, REGION, REGION, NONE, NONE),) * n, geometry)


def test_more_and_surer_claims_are_trusted_more_and_near_ones_less() -> None:
    look = STREET.look(HERE)
    chance = [trusted(look, look, joined(n, 30.0)) for n in range(6)]
    assert chance[0] == 0.0 and chance == sorted(set(chance)) and chance[-1] < 1.0
    assert trusted(look, look, joined(2, 30.0, 0.5)) < chance[2]
    assert trusted(look, look, joined(2, 2.0)) < chance[2]
    assert trusted(look, look, replace(joined(2, 2.0), geometry=None)) == chance[2]


def test_where_much_is_proposed_few_claims_say_little() -> None:
    crowded = Plain(tuple(Thing(f"t{i}", (20 * np.cos(i), 20 * np.sin(i))) for i in range(40)))
    much, little = crowded.look(HERE), STREET.look(HERE)
    assert trusted(much, much, joined(3, 30.0)) < trusted(little, little, joined(3, 30.0))


def test_what_one_camera_sees_is_told_from_the_robots_heading() -> None:
    look = STREET.look(HERE)
    seen = Observation(0, HERE, np.full(72, 8.0), view_rad=0.7)
    turned = in_robots_frame(look, seen)
    for before, after in (
        (look.proposals.bearing_rad, turned.proposals.bearing_rad),
        (look.features.bearing_rad, turned.features.bearing_rad),
        (look.spots.bearing_rad, turned.spots.bearing_rad),
    ):
        assert np.exp(1j * after) == pytest.approx(np.exp(1j * (before + 0.7)))
    assert turned.proposals.box[:, :2] == pytest.approx(look.proposals.box[:, :2] + 0.7)
    assert in_robots_frame(look, replace(seen, view_rad=None)) is look


def test_a_things_side_is_where_it_stands_on_the_ground() -> None:
    look = STREET.look(HERE)
    assert surface_m(look, 0) == pytest.approx(12.0 - 1.5)
    floating = look.proposals.box.copy()
    floating[0, 2] = 0.1  # its foot is hidden
    hidden = replace(look, proposals=replace(look.proposals, box=floating))
    assert surface_m(hidden, 0) == pytest.approx(12.0)

from dataclasses import replace

import numpy as np
import pytest

from navigation.plains import Plain, Thing
from vrchain.geometry import Pose
from vrchain.navigation.eyes import in_robots_frame, surface_m
from vrchain.robot import Observation

HERE = Pose(0.0, 0.0)
STREET = Plain(tuple(Thing(f"t{i}", (12 * np.cos(i), 12 * np.sin(i))) for i in range(6)))


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

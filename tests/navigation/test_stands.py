from dataclasses import replace

import numpy as np
import pytest

from navigation.plains import RIG
from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.landmarks.common import Comparison
from vrchain.landmarks.epipolar import PlanarGeometry
from vrchain.navigation.stands import Stands, baseline_m, stand_of

THERE = Pose(20.0, 5.0, 2.0)


def seen_from(here: Pose, there: Pose = THERE) -> Comparison:
    """What truly lies between two panoramas."""
    turn = float(wrap_angle_rad(there.yaw_rad - here.yaw_rad))
    heights = here.distance_to_m(there.xy_m) / RIG.camera_height_m
    direction = here.bearing_to_rad(there.xy_m)
    return Comparison((), PlanarGeometry(direction, turn, np.ones(3, dtype=bool), 0.0, heights))


def test_where_the_other_panorama_was_taken() -> None:
    here = Pose(2.0, -3.0, 0.7)
    found = seen_from(here)
    assert baseline_m(found, RIG) == pytest.approx(here.distance_to_m(THERE.xy_m))
    stand = stand_of(here, found, RIG)
    assert stand is not None and stand.xy_m == pytest.approx(THERE.xy_m)
    assert stand.yaw_rad == pytest.approx(THERE.yaw_rad)
    back = stand_of(THERE, found, RIG, back=True)
    assert back is not None and back.xy_m == pytest.approx(here.xy_m)
    assert back.yaw_rad == pytest.approx(here.yaw_rad)


def test_no_pose_no_stand() -> None:
    nothing = Comparison((), None)
    bare = seen_from(Pose(0, 0))
    assert bare.geometry is not None
    unsized = Comparison((), replace(bare.geometry, baseline_heights=np.nan))
    for found in (nothing, unsized):
        assert stand_of(Pose(0, 0), found, RIG) is None
        assert not Stands().agree(Pose(0, 0), b"R2", found, RIG)


def test_looks_from_two_places_agree_on_what_is_so_and_on_nothing_else() -> None:
    one, two = Pose(0.0, 0.0), Pose(8.0, -4.0, 1.0)
    stands = Stands()
    assert not stands.agree(one, b"R2", seen_from(one), RIG)  # nobody else has told yet
    assert not stands.agree(one, b"R2", seen_from(one), RIG)  # the same place says nothing new
    assert stands.agree(two, b"R2", seen_from(two), RIG)
    assert not stands.agree(two, b"R3", seen_from(two), RIG)  # of another panorama

    stands = Stands()
    stands.agree(one, b"R2", seen_from(one), RIG)
    elsewhere = seen_from(two, Pose(20.0, -9.0, 2.0))
    turned = seen_from(two, replace(THERE, yaw_rad=1.2))
    assert not stands.agree(two, b"R2", elsewhere, RIG)
    assert not stands.agree(two, b"R2", turned, RIG)

"""When a robot may claim that it has arrived."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from vrchain.geometry import Pose
from vrchain.navigation.arrival import Arrival, Suspect
from vrchain.navigation.goal import GoalSight
from vrchain.navigation.places import Place
from vrchain.navigation.terms import MissionConfig


def is_sure(*sights: tuple[float, int, float, float]) -> bool:
    """x_m of the robot, keypoints, range of the goal's side and looks of each sight."""
    seen = tuple(
        (Pose(x_m, 0.0), GoalSight(0.0, range_m, range_m, 0.2, keypoints, looks, 0.9))
        for x_m, keypoints, range_m, looks in sights
    )
    pilot = cast(Any, SimpleNamespace(config=MissionConfig()))
    suspect = Suspect(Place(np.zeros(2), np.eye(2)), 0.9, seen)
    return Arrival(pilot, cast(Any, None), lambda *args, **values: None)._is_sure(suspect)


def test_sights_from_several_places_add_up() -> None:
    assert is_sure((0, 20, 15, 3), (3, 24, 12, 3))
    assert not is_sure((0, 20, 15, 3))


@pytest.mark.parametrize(
    "second",
    [(1, 24, 12, 3), (3, 24, 4, 3)],
    ids=["from the same place", "from too near"],
)
def test_what_does_not_add(second: tuple[float, int, float, float]) -> None:
    assert not is_sure((0, 20, 15, 3), second)


def test_a_house_like_the_goal_is_not_the_goal() -> None:
    """As it was met in a suburb: what agrees are windows and doors of the same make."""
    assert not is_sure((0, 11, 29, 3.1), (3, 13, 22, 2.8), (6, 9, 15, 3.3))


def test_keypoints_without_its_looks_are_not_the_goal() -> None:
    assert not is_sure((0, 40, 15, 2.0), (3, 40, 12, 2.0))


def test_never_seen_is_never_sure() -> None:
    assert not is_sure()

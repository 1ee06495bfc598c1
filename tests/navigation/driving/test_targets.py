"""What a route is driven to: its landmarks, and what lies nearer than they do."""

import numpy as np
import pytest
from plains import CALIBRATION, Plain, Thing

from vrchain.geometry import Pose, relative
from vrchain.landmarks.matching.common import CommonLandmark, Region
from vrchain.navigation.driving.estimates import Estimate
from vrchain.navigation.driving.targets import targets
from vrchain.navigation.driving.tracker import Tracker
from vrchain.navigation.goal.recognition import GoalSight
from vrchain.navigation.planning.relative_poses import RelativePose, RelativePoses
from vrchain.navigation.planning.route import Leg, Route

HERE, NEXT = Pose(0.0, 0.0, 0.0), Pose(12.0, 0.0, 1.0)
NONE = np.empty(0, dtype=np.int64)
SIGHT = GoalSight(-0.9, 10.0, 9.0, 0.2, 40, 2.0, 0.9)
EMPTY = Plain((Thing("behind", (-90.0, 0.0)),)).look(HERE)


def region(pose: Pose, xy_m: tuple[float, float]) -> Region:
    return Region(0, (0.0, 0.0, 9.0, 9.0), pose.bearing_to_rad(xy_m), 0.1)


def driven_to(
    xy_m: tuple[float, float], joined: bool = True
) -> tuple[list[Tracker], Estimate | None, Tracker | None]:
    """By which R1 gets on, at the origin, where R2, 12 m ahead, sees this landmark and the goal."""
    apart_m = HERE.distance_to_m(NEXT.xy_m)
    ranges = HERE.distance_to_m(xy_m) / apart_m, NEXT.distance_to_m(xy_m) / apart_m
    landmark = CommonLandmark(0.9, region(HERE, xy_m), region(NEXT, xy_m), NONE, NONE, ranges)
    route = Route((Leg("R1", "R2", landmark, (b"", b"R2", 0), "N1"),), "R2", SIGHT, 0.8)
    poses = RelativePoses(
        {("R1", "R2"): RelativePose(relative(HERE, NEXT) if joined else None, 0.9)}
    )
    return targets(route, [EMPTY, EMPTY], poses, {}, HERE, HERE, CALIBRATION)


def test_a_landmark_on_the_way_is_driven_to_and_then_the_goal() -> None:
    (tracker,), goal, lookout = driven_to((8.0, 4.0))
    assert tracker.name == "landmark 1, common to R1 and R2"
    assert tracker.place.xy_m == pytest.approx([8.0, 4.0], abs=0.01)
    assert goal is not None and lookout is not None
    assert lookout.name == "where R2 looked around"
    assert lookout.place.xy_m == pytest.approx([12.0, 0.0])
    assert goal.xy_m == pytest.approx([12 + 9 * np.cos(0.1), 9 * np.sin(0.1)], abs=0.01)


def test_where_the_landmark_lies_aside_the_next_robots_place_is_driven_to() -> None:
    (tracker,), *_ = driven_to((6.0, 25.0))
    assert tracker.name == "where R2 looked around"
    assert tracker.place.xy_m == pytest.approx([12.0, 0.0]) and tracker.place.std_m > 1.0
    tracker.update(EMPTY, HERE)
    assert (tracker.seen, tracker.missed) == (0, 0)  # a place shows nothing of its own


def test_what_nothing_tells_of_ends_the_list() -> None:
    assert driven_to((8.0, 4.0), joined=False) == ([], None, None)


@pytest.mark.parametrize(("way_m", "steps"), [(0.0, 1), (30.0, 1), (30.0, 60)])
def test_an_estimate_fades_with_the_way_however_often_it_is_asked(way_m: float, steps: int) -> None:
    tracker = Tracker("a place", Estimate(np.zeros(2), np.eye(2)), CALIBRATION)
    for _ in range(steps):
        tracker.place = tracker.place.after(way_m / steps)
    assert tracker.place.std_m == pytest.approx(np.sqrt(1.0 + 0.03 * way_m))

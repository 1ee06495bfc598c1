"""Homing to a place among round things, by the panorama taken there."""

from dataclasses import replace

import pytest
from plains import PERCEPTION, Plain, Thing, Walker

from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.homing import HomeVector
from vrchain.navigation.driving.drive import Pilot
from vrchain.navigation.driving.estimates import Estimate
from vrchain.navigation.goal.place import ARRIVED_M, GoalPlace, PlaceArrival
from vrchain.navigation.perception import Look
from vrchain.navigation.settings import MissionConfig

PLAIN = Plain(
    tuple(
        Thing(f"thing {k}", xy_m)
        for k, xy_m in enumerate(
            [(9.0, 1.0), (4.0, 9.0), (6.0, -8.0), (18.0, -9.0), (16.0, 8.0), (-6.0, 2.0)]
        )
    )
)
PLACE = Pose(10.0, -4.0, 2.2)


def arrival(start: Pose, place: Pose = PLACE, plain: Plain = PLAIN) -> tuple[PlaceArrival, Walker]:
    body = Walker(plain, start)
    goal = GoalPlace(PLAIN.look(place), PERCEPTION)
    return PlaceArrival(Pilot(body, PERCEPTION, MissionConfig()), goal, lambda *a, **k: None), body


@pytest.mark.parametrize("start", [Pose(0, 0, 0.5), Pose(12.0, 3.0, -1.0), Pose(11.5, -3.0, 0.0)])
def test_it_arrives_where_the_panorama_was_taken(start: Pose) -> None:
    arriving, body = arrival(start)
    candidate = arriving.note(arriving.pilot.look_around())
    assert candidate is not None
    off_rad = candidate.place.bearing_rad(arriving.pilot.here) - start.bearing_to_rad(PLACE.xy_m)
    assert abs(wrap_angle_rad(off_rad)) < 0.1
    assert arriving.drive_to(candidate)
    assert body.pose.distance_to_m(PLACE.xy_m) < 1.0


@pytest.mark.parametrize("nearer", [4, 8, 12, 20, 30])
def test_where_all_is_far_away_it_is_not_there_before_it_came_near(
    monkeypatch: pytest.MonkeyPatch, nearer: int
) -> None:
    """As it was met: in a wide place homing told 0.7 m where 2.9 m were left, and 1.0 m from 4.1 m.

    The robot said then that it had arrived.
    """
    arriving, body = arrival(Pose(0, 0, 0.5))

    def homing(goal: GoalPlace, look: Look) -> HomeVector:
        bearing_rad = wrap_angle_rad(body.pose.bearing_to_rad(PLACE.xy_m))
        told_m = body.pose.distance_to_m(PLACE.xy_m) / nearer
        return HomeVector(float(bearing_rad), 0.01, 100, told_m <= ARRIVED_M, told_m)

    candidate = arriving.note(arriving.pilot.look_around())
    assert candidate is not None
    monkeypatch.setattr(GoalPlace, "homing", homing)
    short = Estimate(0.6 * candidate.place.xy_m, candidate.place.covariance)
    assert arriving.drive_to(replace(candidate, place=short))
    assert body.pose.distance_to_m(PLACE.xy_m) < 1.0


def test_it_does_not_wait_long_where_something_stands_on_the_place() -> None:
    """25 looks around were spent on it."""
    parked = Plain((*PLAIN.things, Thing("parked", (PLACE.x_m, PLACE.y_m), 0.8)))
    arriving, body = arrival(Pose(0, 0, 0.5), plain=parked)
    candidate = arriving.note(arriving.pilot.look_around())
    assert candidate is not None
    assert not arriving.drive_to(candidate)
    assert len(arriving.pilot.looks) < 10
    assert body.pose.distance_to_m(PLACE.xy_m) < 3.0


def test_where_no_way_leads_nearer_it_does_not_look_again_and_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    arriving, _ = arrival(Pose(0, 0, 0.5))
    candidate = arriving.note(arriving.pilot.look_around())
    assert candidate is not None
    monkeypatch.setattr(arriving.pilot, "stretch", lambda *way: None)
    monkeypatch.setattr(GoalPlace, "homing", lambda goal, look: None)
    assert not arriving.drive_to(candidate) and len(arriving.pilot.looks) == 2


def test_where_all_looks_otherwise_it_does_not_arrive() -> None:
    elsewhere = Plain(tuple(Thing(f"other {k}", t.xy_m) for k, t in enumerate(PLAIN.things)))
    arriving, _ = arrival(Pose(0, 0, 0.5), plain=elsewhere)
    assert arriving.note(arriving.pilot.look_around()) is None
    told, _ = arrival(Pose(0, 0, 0.5))
    candidate = told.note(told.pilot.look_around())
    assert candidate is not None
    assert not arriving.drive_to(candidate) and len(arriving.pilot.looks) < 8
    assert not arriving.was_mistaken(candidate.place)  # it is tried once more
    assert not arriving.drive_to(candidate) and arriving.was_mistaken(candidate.place)

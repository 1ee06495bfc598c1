import json
from collections.abc import Callable
from dataclasses import asdict, replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from plains import (
    BEAMS,
    CALIBRATION,
    GOAL_XY,
    HOME,
    PERCEPTION,
    TEAM,
    Plain,
    PlainIndex,
    Thing,
    Walker,
    beyond,
    street,
)  # fmt: skip

from vrchain.errors import ImageError
from vrchain.geometry import Pose, relative, wrap_angle_rad
from vrchain.landmarks.matching.common import CommonLandmark, Region
from vrchain.landmarks.retrieval.query import query_of
from vrchain.landmarks.retrieval.template import Goal
from vrchain.navigation.driving.estimates import Estimate
from vrchain.navigation.driving.tracker import Tracker
from vrchain.navigation.following import Follower, _is_idle
from vrchain.navigation.goal.arrival import Arrival
from vrchain.navigation.goal.candidates import Candidate
from vrchain.navigation.goal.recognition import GoalPictures, GoalSight
from vrchain.navigation.goal.rejections import Driven
from vrchain.navigation.mission import MissionResult, drive_mission
from vrchain.navigation.perception import Look, Perception
from vrchain.navigation.planning.route import Leg, Plan, Route
from vrchain.navigation.settings import Decision, MissionConfig, Published, panorama_name, robot_of
from vrchain.robot import UNSEEN_M, Observation

QUICK = MissionConfig(limit_s=200.0, explores=False)
PATIENT = MissionConfig(explores=False)


STREET_GOAL = street().goal("goal", 3.9, 3.4, -2.0, 1.0)
NO_CALLS: Callable[..., None] = lambda *said, **values: None  # noqa: E731


def within(centre: tuple[float, float], range_m: float):
    """Visible from so near only."""
    return lambda pose: pose.distance_to_m(centre) < range_m


def drive(
    plain: Plain,
    others: dict[str, Pose],
    *,
    start: Pose = HOME,
    config: MissionConfig = QUICK,
    goal: GoalPictures | None = None,
    index: PlainIndex | None = None,
    body: Walker | None = None,
    tell: Callable[[Decision], object] = NO_CALLS,
    perception: Perception = PERCEPTION,
) -> tuple[MissionResult, Walker]:
    body = body or Walker(plain, start)
    index = index or PlainIndex(plain, others)
    goal = goal or plain.goal("goal", 3.9, 3.4, -2.0, 1.0)
    asked = (index.published, index, goal, perception, config, cast(Any, tell))
    result = drive_mission("R1", body, *asked)
    check_log(result, config)
    return result, body


def words(result: MissionResult) -> list[str]:
    return [d.what for d in result.decisions]


def check_log(result: MissionResult, config: MissionConfig) -> None:
    """It can be read and stored, runs forward in time, and ends as the mission did."""
    assert json.loads(json.dumps([asdict(d) for d in result.decisions]))
    assert all(d.what and d.why for d in result.decisions)
    times = [d.time_s for d in result.decisions]
    assert times == sorted(times)
    assert times[-1] <= config.limit_s + 60
    looks = [d.look for d in result.decisions if d.look is not None]
    assert all(0 <= look < len(result.looks) for look in looks)
    assert all(0 <= look < len(result.looks) for look, _ in result.plans)
    last = result.decisions[-1]
    assert last.what == ("arrived" if result.arrived else "gave up")
    assert last.why == result.reason


def goal_range_m(body: Walker) -> float:
    return body.pose.distance_to_m(GOAL_XY) - 1.5


def test_a_goal_in_view_is_driven_to() -> None:
    plain = street(visible_from=lambda pose: True)
    result, body = drive(plain, {})  # with nobody in the ledger
    assert result.arrived and result.plans == ()
    assert words(result) == ["approach", "arrived"]
    assert goal_range_m(body) <= QUICK.arrival_m + 0.3
    assert result.decisions[0].values["chance"] >= 0.9
    assert abs(result.decisions[0].values["bearing_deg"]) < 8


def test_a_goal_out_of_view_is_reached_by_the_chain() -> None:
    result, body = drive(street(), TEAM)
    assert result.arrived, result.decisions
    assert goal_range_m(body) <= QUICK.arrival_m + 0.3
    assert words(result)[:3] == ["ledger", "route", "leg"]
    _, route = result.plans[0]
    assert route.robots == ("R1", "R2")


class Ahead(Walker):
    """A robot whose ranging sensor looks ahead alone, 120 degrees wide."""

    def observe(self, look: bool = False, towards_rad: float | None = None) -> Observation:
        seen = super().observe(look, towards_rad)
        blind = np.abs(wrap_angle_rad(BEAMS)) > np.pi / 3
        return replace(seen, range_ring_m=np.where(blind, UNSEEN_M, seen.range_ring_m))


@pytest.mark.parametrize("yaw_rad", [0.5, 3.0, -2.0])
def test_who_senses_no_range_behind_arrives_too(yaw_rad: float) -> None:
    result, body = drive(street(), TEAM, body=Ahead(street(), replace(HOME, yaw_rad=yaw_rad)))
    assert result.arrived, result.decisions
    assert goal_range_m(body) <= QUICK.arrival_m + 0.3
    assert "reached" in words(result)


def test_two_legs() -> None:
    plain = Plain(
        (
            Thing("goal", (30.0, 8.0), visible_from=beyond(18.0)),
            Thing("first", (9.0, 1.0), radius_m=1.0, visible_from=lambda p: p.x_m < 12),
            Thing("left", (4.0, 9.0), visible_from=lambda p: p.x_m < 12),
            Thing("right", (5.0, -8.0), visible_from=lambda p: p.x_m < 12),
            Thing("second", (19.0, 0.0), radius_m=1.0, visible_from=beyond(5.0)),
            Thing("north", (16.0, 10.0), visible_from=beyond(5.0)),
            Thing("south", (24.0, -9.0), visible_from=beyond(5.0)),
        )
    )
    team = {"R2": Pose(10.0, -3.5, 1.0), "R3": Pose(21.0, 4.0, -1.0)}
    result, body = drive(plain, team, config=PATIENT)
    assert result.arrived, result.decisions
    assert body.pose.distance_to_m((30.0, 8.0)) - 1.5 <= 2.3
    _, route = result.plans[0]
    assert route.robots == ("R1", "R2", "R3")
    first, second = (leg.chance for leg in route.legs)
    assert route.after(0).score == route.score == pytest.approx(first * second, rel=0.1)
    assert route.after(1).score == pytest.approx(second, rel=0.1)  # and that it is the goal


def west(pose: Pose) -> bool:
    return pose.x_m < 5


APART = Plain(  # all that R1 sees is hidden from R2
    (
        Thing("goal", GOAL_XY, visible_from=beyond(5.0)),
        Thing("mine", (3.0, 6.0), visible_from=west),
        Thing("also mine", (3.0, -6.0), visible_from=west),
        Thing("yours", (12.0, -3.0), visible_from=beyond(5.0)),
    )
)
UNHEARD_OF = Plain((Thing("unheard of", (0.0, 0.0)),)).goal("unheard of", 1.0, 2.0)


@pytest.mark.parametrize(
    ("plain", "others", "goal", "reason"),
    [
        (street(), {}, None, "the ledger holds no panorama of another robot"),
        (street(), {"R2": Pose(1.0, -4.0, 1.0), "R3": Pose(-2.0, 3.0)}, None,
         "no other robot's panorama shows the goal"),
        (street(), TEAM, UNHEARD_OF, "no other robot's panorama shows the goal"),
        (street(), TEAM, GoalPictures(query_of([]), Goal(()), CALIBRATION, ()),
         "no other robot's panorama shows the goal"),
        (APART, TEAM, None, "R2 sees the goal, but no chain of common landmarks leads there"),
    ],
    ids=["empty ledger", "nobody sees it", "nowhere", "blank pictures", "no chain"],
)  # fmt: skip
def test_without_a_route_it_gives_up_where_it_stands(
    plain: Plain, others: dict[str, Pose], goal: GoalPictures | None, reason: str
) -> None:
    result, body = drive(plain, others, goal=goal)
    assert not result.arrived and result.reason == reason
    assert words(result) == ["gave up"] and body.path == []


def test_what_vanishes_is_looked_for_where_it_was_and_given_up() -> None:
    """Nothing but the place of R2 is seen any more from x > 2; R2's sight was from before."""
    fading = lambda pose: pose.x_m < 2 or pose.x_m == TEAM["R2"].x_m  # noqa: E731
    plain = Plain(tuple(replace(t, visible_from=fading) for t in street().things[1:]))
    goal = Thing("goal", GOAL_XY, visible_from=lambda p: p.x_m == TEAM["R2"].x_m)
    plain = Plain((goal, *plain.things))
    result, _ = drive(plain, TEAM)
    assert not result.arrived
    assert "doubt" in words(result)  # it came to where the goal should be, and saw nothing of it
    assert "no other robot's panorama shows the goal" in result.reason  # R2 is not believed twice
    keys = [route.legs[0].key for _, route in result.plans]
    assert len(set(keys)) == len(keys)  # no landmark that failed is tried again


def test_what_was_blocked_before_and_shows_nothing_now_is_not_driven_to_for_ever(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As it was met: the same route, planned and left again on the spot, while time stood still."""
    seen_by_r2 = lambda p: p.x_m == TEAM["R2"].x_m  # noqa: E731
    plain = Plain((Thing("goal", GOAL_XY, visible_from=seen_by_r2), *street().things[1:]))
    monkeypatch.setattr(Arrival, "is_blocked", lambda self, place: True)
    result, _ = drive(plain, TEAM)
    assert "no other robot's panorama shows the goal" in result.reason  # R2 is not believed twice
    assert words(result).count("route") <= 2


def test_who_comes_by_again_from_elsewhere_is_led_to_a_landmark_anew() -> None:
    ours = object.__new__(Follower)
    ours.reached = {(b"", b"R2", 5): Pose(0.0, 0.0)}
    leg = Leg("R1", "R2", cast(Any, None), (b"", b"R2", 5), "N1")
    for x_m, reached in ((12.0, True), (60.0, False)):
        ours.pilot = cast(Any, SimpleNamespace(here=Pose(x_m, 0.0)))
        assert ours.was_reached(leg) == reached
    assert not ours.was_reached(replace(leg, key=(b"", b"R3", 5)))


def test_a_robot_that_is_shut_in_is_blocked_and_gives_up() -> None:
    result, _ = drive(street(), TEAM, body=Walker(street(), HOME, shut_in=True), config=PATIENT)
    assert not result.arrived and "no chain of common landmarks leads there" in result.reason
    assert words(result)[:4] == ["ledger", "route", "leg", "blocked"]
    assert "reached" not in words(result)
    for tried, then in pairwise(result.decisions):
        if tried.what in ("leg", "approach", "lookout"):  # and not before it has really tried
            assert then.what in ("blocked", "doubt")
            assert then.time_s - tried.time_s >= PATIENT.stuck_after_s
    keys = [route.legs[0].key for _, route in result.plans]
    assert len(set(keys)) == len(keys)  # no landmark that failed is tried again


def test_shut_in_with_the_goal_in_view() -> None:
    """It cannot be driven to, and the chain cannot either: the robot says so."""
    plain = street(visible_from=lambda pose: True)
    for others, reason in (
        ({}, "the ledger holds no panorama of another robot"),
        (TEAM, "no other robot's panorama shows the goal"),  # R2's sight of it is not believed
    ):
        result, _ = drive(plain, others, body=Walker(plain, HOME, shut_in=True), config=PATIENT)
        assert not result.arrived and result.reason == reason
        assert words(result)[0] == "approach" and words(result).count("blocked") == 2
        assert len(result.looks) < 20


def test_who_stood_before_a_goal_that_no_way_led_to_doubts_nobody() -> None:
    """Posts stand around it, too close to each other for the robot."""
    x_m, y_m = GOAL_XY
    around = [(x_m + 5.0 * np.cos(a), y_m + 5.0 * np.sin(a)) for a in np.arange(12) * np.pi / 6]
    posts = [Thing(f"post {k}", xy) for k, xy in enumerate(around)]
    plain = Plain((*street(visible_from=within(GOAL_XY, 9.0)).things, *posts))
    config = MissionConfig(limit_s=320.0, leg_limit_s=5.0, explores=False)
    index = PlainIndex(street(), TEAM)
    result, _ = drive(plain, {}, goal=STREET_GOAL, index=index, config=config)
    said = words(result)
    blocked = said.index("blocked")
    assert said[:4] == ["ledger", "route", "leg", "reached"] and "doubt" not in said[:blocked]
    assert not any("R2" in d.why for d in result.decisions if d.what == "doubt")
    assert said[blocked : blocked + 3] == ["blocked", "plan again", "approach"]  # once more
    assert not result.arrived


@pytest.mark.parametrize("limit_s", [0.0, 5.0, 12.0])
def test_time_runs_out(limit_s: float) -> None:
    config = MissionConfig(limit_s=limit_s, explores=False)
    result, body = drive(street(), TEAM, config=config)
    assert not result.arrived and result.reason == f"out of time after {limit_s:g} s"
    assert body.time_ns <= (limit_s + config.tick_s) * 1e9 + 1e6


def test_looks_run_out() -> None:
    config = MissionConfig(max_looks=3)
    result, _ = drive(Plain(street().things[1:]), {}, goal=STREET_GOAL, config=config)
    assert result.reason == "the goal was not found in 3 looks around" and len(result.looks) == 3


def test_what_only_resembles_the_goal_is_doubted_and_not_tried_again() -> None:
    """R2 sees a thing that has a fifth of the goal's keypoints: little, but worth the way."""
    plain = Plain(
        (
            Thing("double", GOAL_XY, looks="goal", share=0.2, visible_from=beyond(5.0)),
            *street().things[1:],
        )
    )
    easy = replace(PATIENT, least_trust=0.05)
    result, body = drive(plain, TEAM, goal=STREET_GOAL, config=easy)
    assert not result.arrived
    assert goal_range_m(body) <= easy.arrival_m + 0.3  # it was looked at from right before it
    told = [d.why for d in result.decisions if d.what in ("leg", "approach", "doubt")]
    assert told[1:] == [
        "the goal",
        "it never looked enough like the goal's pictures",
        "what R2 saw is not the goal",
    ]
    assert words(result).count("route") == 1 and "R2" in result.decisions[0].why
    assert result.reason == "no other robot's panorama shows the goal"


def test_on_a_long_way_to_the_goal_the_ledger_is_asked_anew() -> None:
    """Every 12 m: others may have seen by then that it is elsewhere."""
    things = [replace(t, xy_m=(60.0, 8.0)) for t in street().things if t.name == "goal"]
    plain = Plain((replace(things[0], visible_from=beyond(45.0)), *street().things[1:]))
    index = PlainIndex(plain, {"R2": Pose(54.0, 4.0, 2.0)})
    asked_at_m: list[float] = []

    def published() -> dict[str, Published]:
        asked_at_m.append(body.pose.x_m)
        return index.published()

    body, goal = Walker(plain, HOME), plain.goal("goal", 3.9, 3.4, -2.0, 1.0)
    result = drive_mission("R1", body, published, index, goal, PERCEPTION, QUICK)
    assert result.arrived and body.pose.distance_to_m((60.0, 8.0)) < 3.0
    on_the_way = [x_m for x_m in asked_at_m if 10.0 < x_m < 45.0]
    assert len(on_the_way) >= 2 and max(np.diff([0.0, *on_the_way, 45.0])) < 14.0


@pytest.mark.parametrize(
    ("trust", "why"),
    [
        (1.0, "what R2, R3 saw is not the goal"),
        (0.7, "R1 and R3 were not joined rightly"),  # relative poses are blamed first
    ],
)
def test_what_has_gone_is_not_sought_for_ever_whoever_saw_it(trust: float, why: str) -> None:
    """R2 and R3 saw the goal where there is nothing any more."""
    then, now = street(), Plain(street().things[1:])
    index = PlainIndex(then, {**TEAM, "R3": Pose(9.0, 5.5, 1.0)})
    goal = then.goal("goal", 3.9, 3.4, -2.0, 1.0)
    perception = replace(PERCEPTION, trust=lambda a, b, found: trust)
    result, _ = drive(now, {}, goal=goal, index=index, config=PATIENT, perception=perception)
    assert not result.arrived
    assert [d.why for d in result.decisions if d.what == "approach"].count("the goal") == 1
    assert why in [d.why for d in result.decisions]


def test_a_weak_chain_is_driven_once_looking_elsewhere_was_in_vain() -> None:
    plain = street(visible_from=within(GOAL_XY, 9.0))
    trust = drive(plain, TEAM, config=PATIENT)[0].plans[0][1].trust
    demanding = replace(PATIENT, least_trust=1.02 * trust, explore_m=4.0)
    refused, _ = drive(plain, TEAM, config=demanding)
    assert refused.reason == "the best chain is too unsure to be worth driving"
    result, _ = drive(plain, TEAM, config=replace(demanding, explores=True))
    assert result.arrived and words(result)[:2] == ["no route", "explore"]
    assert result.plans[0][1].trust < demanding.least_trust
    assert result.decisions[0].values == {"trust": round(trust, 2)}


def test_a_double_in_view_is_doubted_and_ends_with_a_reason() -> None:
    plain = Plain((Thing("double", (9.0, 5.0), looks="goal", share=0.2), *street().things[1:]))
    goal = street().goal("goal", 3.9, 3.4, -2.6, 1.0)
    for others in ({}, {"R2": Pose(2.0, -3.0)}):
        result, _ = drive(plain, others, goal=goal, config=PATIENT)
        assert not result.arrived
        assert words(result)[:2] == ["approach", "doubt"]
        assert result.decisions[0].why == "the goal"
        assert words(result).count("circle") == 0  # by one look it is not likely enough for that


class Junk(PlainIndex):
    """One robot has signed and published what is no panorama."""

    def look(self, digest: bytes):
        if digest == b"R0":
            raise ImageError("expected an encoded panorama, got other bytes")
        return super().look(digest)

    def published(self) -> dict[str, Published]:
        return {"R0": Published(b"R0"), **super().published()}


def test_a_member_that_publishes_junk_stops_nobody() -> None:
    plain = street()
    result, body = drive(plain, TEAM, index=Junk(plain, TEAM))
    assert result.arrived and goal_range_m(body) <= QUICK.arrival_m + 0.3
    alone, _ = drive(plain, TEAM, index=Junk(plain, {}))
    assert not alone.arrived and alone.reason


def test_every_decision_is_told_as_it_is_made_and_a_failing_listener_is_not_swallowed() -> None:
    class Stop(Exception):
        pass

    def stop(decision: Decision) -> None:
        raise Stop

    told: list[Decision] = []
    result, _ = drive(street(), TEAM, tell=told.append)
    assert tuple(told) == result.decisions
    with pytest.raises(Stop):
        drive(street(), TEAM, tell=stop)


def test_where_the_world_lies_and_how_the_robot_is_turned_make_no_difference() -> None:
    """The plain is moved and turned under the robots, or nothing is: the log stays as it is."""
    angle, offset = 2.1, np.array([30.0, -70.0])
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s], [s, c]])

    def there(pose: Pose) -> Pose:
        x_m, y_m = turn @ pose.xy_m + offset
        return Pose(float(x_m), float(y_m), pose.yaw_rad + angle)

    def back(pose: Pose) -> Pose:
        x_m, y_m = turn.T @ (pose.xy_m - offset)
        return Pose(float(x_m), float(y_m), pose.yaw_rad - angle)

    class Moved(Plain):
        def look(self, pose: Pose):
            return super().look(back(pose))

        def ring_m(self, pose: Pose):
            return super().ring_m(back(pose))

    (here, body), (again, other) = (drive(street(), TEAM) for _ in range(2))
    assert here.decisions == again.decisions and body.path == other.path
    team = {n: there(p) for n, p in TEAM.items()}
    elsewhere, _ = drive(Moved(street().things), team, start=there(HOME), goal=STREET_GOAL)
    assert len(here.decisions) == len(elsewhere.decisions) > 4
    for a, b in zip(here.decisions, elsewhere.decisions, strict=True):
        assert (a.time_s, a.what, a.why, a.look) == (b.time_s, b.what, b.why, b.look)
        assert a.values.keys() == b.values.keys()
        for key, value in a.values.items():
            assert b.values[key] == (
                value if isinstance(value, str) else pytest.approx(value, abs=0.1)
            )


def avenue() -> Plain:
    """Things on both sides of 60 m of way, each seen from 20 m at most, and a goal at its end."""
    sides = [
        Thing(f"{side} {x_m}", (x_m, y_m), 1.0, n=160, visible_from=within((x_m, y_m), 20.0))
        for x_m in range(-3, 62, 6)
        for side, y_m in (("left", 6.0), ("right", -6.0))
    ]
    goal = Thing("goal", (60.0, 1.0), visible_from=within((60.0, 1.0), 15.0))
    return Plain((*sides, goal))


def test_a_trail_of_panoramas_leads_to_a_goal_that_was_seen_long_ago() -> None:
    """R2 has come from the goal to the robot: its newest panorama shows nothing of the goal."""
    trail = {"R2" if k == 0 else f"R2~{k}": Pose(7.5 * k, 1.0, 3.0) for k in range(8)}
    start = Pose(-4.0, -1.0, 1.0)
    goal = avenue().goal("goal", 3.0, 2.0, -2.0)
    newest, _ = drive(avenue(), {"R2": trail["R2"]}, start=start, goal=goal)
    assert not newest.arrived and "no other robot's panorama shows the goal" in newest.reason
    result, body = drive(avenue(), trail, start=start, goal=goal, config=QUICK)
    assert result.arrived, result.decisions
    assert body.pose.distance_to_m((60.0, 1.0)) < 1.5 + QUICK.arrival_m + 0.3
    assert len(result.plans[0][1].legs) >= 2
    driven_m = np.hypot(*np.diff(body.path, axis=0).T).sum()
    assert driven_m < 1.25 * 64.0  # along the avenue, and not to each landmark at its side


def test_a_leg_that_is_cut_off_makes_what_is_left_no_surer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """R2 went a long way round: the robot goes straight on, by a pose that may yet be wrong."""
    stood = [Pose(*xy_m, 3.0) for xy_m in ((52, 1), (45, 20), (30, 40), (15, 25), (0, 1))]
    names = [panorama_name("R2", k) for k in range(len(stood))]
    moved = {n: relative(a, b) for n, (b, a) in zip(names, pairwise(stood), strict=False)}
    index = PlainIndex(avenue(), dict(zip(names, stood, strict=True)), moved)
    left = []
    regard = Follower.regard

    def noted(self: Follower, look: Look, route: Route) -> object:
        left.append((len(self.plans), route.score))
        return regard(self, look, route)

    monkeypatch.setattr(Follower, "regard", noted)
    start, goal = Pose(-4.0, -1.0, 1.0), avenue().goal("goal", 3.0, 2.0, -2.0)
    perception = replace(PERCEPTION, trust=lambda a, b, found: 0.9)
    result, body = drive(avenue(), {}, start=start, goal=goal, index=index, perception=perception)
    assert result.arrived and max(y_m for _, y_m in body.path) < 20.0
    scores = {score for n_plans, score in left if n_plans == 1}
    assert scores == {result.plans[0][1].score} and len(result.plans[0][1].legs) == 5


@pytest.mark.parametrize(
    ("trust", "by_odometry", "round_m", "idle"),
    [(0.9, False, 30.0, True), (0.5, False, 30.0, False), (0.5, True, 30.0, True),
     (0.9, False, 5.0, False)],
    ids=["sure", "unsure", "by odometry", "hardly longer"],
)  # fmt: skip
def test_a_long_way_round_is_followed_only_to_make_sure(
    trust: float, by_odometry: bool, round_m: float, idle: bool
) -> None:
    seen = Region(0, (0.0, 0.0, 0.0, 0.0), None if by_odometry else 0.1, None)
    common = CommonLandmark(0.9, seen, seen, np.empty(0, int), np.empty(0, int))
    leg = Leg("R2", "R3", common, (b"", b"", 0), "L", trust=trust)
    aside, goal = (Estimate(np.array(xy_m), np.eye(2)) for xy_m in ((10.0, round_m), (40.0, 0.0)))
    assert _is_idle(aside, [goal], Pose(0.0, 0.0), leg) == idle


LIES = {
    "backwards": lambda m: Pose(-m.x_m, m.y_m, m.yaw_rad),
    "aside": lambda m: Pose(m.y_m, m.x_m, m.yaw_rad),
    "turning": lambda m: Pose(m.x_m, m.y_m, 1.0),
    "far away": lambda m: Pose(60.0, 0.0, 0.0),
    "out of the world": lambda m: Pose(9_000.0, 0.0, 0.0),
}


@pytest.mark.parametrize(
    "lie",
    [
        pytest.param(lie, id=name, marks=[pytest.mark.slow] * (name == "out of the world"))
        for name, lie in LIES.items()
    ],
)
def test_who_lies_about_its_way_misleads_to_no_arrival_and_nobody_who_has_another_way(
    lie: Callable[[Pose], Pose],
) -> None:
    """R2 publishes what it saw, but not how it moved; R3, which came the same way, is honest."""
    poses, moved = {}, {}
    for robot, off_m, told in (("R2", 0.0, lie), ("R3", 2.0, lambda m: m)):
        names = [panorama_name(robot, k) for k in range(8)]
        stood = [Pose(7.5 * k + off_m, 1.0 - off_m, 3.0) for k in range(8)]
        poses |= dict(zip(names, stood, strict=True))
        moved |= {
            n: told(relative(a, b)) for n, (b, a) in zip(names, pairwise(stood), strict=False)
        }
    start, goal = Pose(-4.0, -1.0, 1.0), avenue().goal("goal", 3.0, 2.0, -2.0)
    arrived = {}
    for others in (("R2",), ("R2", "R3")):
        theirs = {n: pose for n, pose in poses.items() if robot_of(n) in others}
        index = PlainIndex(avenue(), theirs, moved)
        result, body = drive(avenue(), theirs, start=start, goal=goal, index=index)
        near = body.pose.distance_to_m((60.0, 1.0)) < 1.5 + QUICK.arrival_m + 0.3
        assert near == result.arrived, result.reason
        arrived[others] = result.arrived
    assert arrived["R2", "R3"]


@pytest.mark.parametrize(
    ("seen", "trust", "leads"),
    [("blocked", 1.0, False), ("a better plan", 1.0, True), ("a better plan", 0.8, False)],
)
def test_a_better_route_seen_on_the_way_to_a_lookout_is_followed(
    seen: str, trust: float, leads: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """None goes to a lookout from where the goal was hardly seen."""
    better = object.__new__(Plan)
    ours = object.__new__(Follower)
    ours.config, ours.log, followed = MissionConfig(), NO_CALLS, []
    found = better if seen == "a better plan" else seen
    monkeypatch.setattr(ours, "approach", lambda *asked: found)
    monkeypatch.setattr(ours, "follow", lambda plan: followed.append(plan) or True)
    place = Estimate(np.zeros(2), np.eye(2))
    lookout = Tracker("where R2 looked around", place, CALIBRATION)
    route = Route((), "R2", GoalSight(0.0, 9.0, 9.0, 0.1, 20, 3.0, 0.9), 0.5, trust)
    assert ours.from_lookout(lookout, route) == leads
    assert followed == [better] * leads


@pytest.mark.parametrize(
    ("x_m", "trust", "seen", "weighed"),
    [
        (60.0, 1.0, 0.75, 0.375),
        (60.0, 0.5, 0.75, 0.643),
        (14.0, 1.0, 0.75, 0.8),
        (14.0, 0.5, 0.75, 0.75),
        (14.0, 1.0, 0.5, 0.8),
        (30.0, 1.0, 0.75, 0.8),
        (30.0, 1.0, 0.5, 0.5),
        (46.0, 1.0, 0.75, 0.75),
    ],
)
def test_what_may_be_the_goal_is_weighed_against_a_route_that_leads_there_or_elsewhere(
    x_m: float, trust: float, seen: float, weighed: float
) -> None:
    """As it was met: a robot went to see what stood 80 m from where others surely saw the goal."""
    ours = object.__new__(Follower)
    ours.config, ours.pilot = MissionConfig(), cast(Any, SimpleNamespace(here=Pose(0.0, 0.0)))
    ours.rejections = cast(Any, SimpleNamespace(same_m=8.0))
    goal_m = 10.0 if x_m in (14.0, 60.0) else 34.0
    should_be, is_at = (Estimate(np.array([at, 0.0]), 9.0 * np.eye(2)) for at in (goal_m, x_m))
    route = Route((), "R2", GoalSight(0.0, 9.0, 9.0, 0.1, 20, 3.0, 0.9), 0.5, trust)
    driven, candidate = Driven(route, object.__new__(Plan), HOME, should_be), Candidate(is_at, seen)
    assert ours.weighed(candidate, driven).chance == pytest.approx(weighed, abs=1e-3)
    for unknown in (None, replace(driven, goal=None)):
        assert ours.weighed(candidate, unknown) is candidate


def test_where_no_goal_was_found_speaks_against_no_other_place(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ours, place = object.__new__(Follower), Estimate(np.array([5.0, 0.0]), np.eye(2))
    ours.config, ours.pilot = MissionConfig(), cast(Any, SimpleNamespace(here=HOME))
    ours.arrival = cast(Any, SimpleNamespace(is_blocked=lambda goal: False, was_mistaken=bool))
    ours.rejections = cast(Any, SimpleNamespace(pairs=[], found_nothing=lambda *found: None))
    monkeypatch.setattr(ours, "home", lambda *asked: False)
    met = list[Driven | None]()
    monkeypatch.setattr(ours, "from_lookout", lambda *asked: met.append(ours.driven))
    route = Route((), "R2", GoalSight(0.0, 9.0, 9.0, 0.1, 20, 3.0, 0.9), 0.5, 0.99)
    assert not ours.to_goal(place, None, Driven(route, object.__new__(Plan), HOME, place), 0)
    assert [driven.goal if driven else place for driven in met] == [None]

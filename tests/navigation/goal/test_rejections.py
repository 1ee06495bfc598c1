"""What is blamed where a chain led astray."""

from dataclasses import replace
from typing import Any, NamedTuple, cast

import numpy as np
import pytest
from plains import HOME, PERCEPTION, TEAM, PlainIndex, Walker, street

from vrchain.geometry import Pose
from vrchain.landmarks.matching.common import Comparison
from vrchain.navigation.driving.drive import Pilot
from vrchain.navigation.driving.estimates import Estimate
from vrchain.navigation.following import Follower
from vrchain.navigation.goal.rejections import Driven, Rejections
from vrchain.navigation.perception import Look
from vrchain.navigation.planning.route import Plan, Route
from vrchain.navigation.replanning import Replanner
from vrchain.navigation.settings import MissionConfig


class SetOut(NamedTuple):
    """A robot in the street, which has planned once; trust: of all relative poses, as it is set."""

    ours: Replanner
    look: Look
    found: Plan
    route: Route
    trust: dict[str, float]
    said: list[tuple[str, str]]

    @property
    def driven(self) -> Driven:
        return Driven(self.route, self.found, self.ours.pilot.here)


def set_out(trust: float) -> SetOut:
    """R3 stands beside R2 and sees the same."""
    trusts, said = {"now": trust}, list[tuple[str, str]]()
    perception = replace(PERCEPTION, trust=lambda a, b, found: trusts["now"])
    pilot = Pilot(Walker(street(), HOME), perception, MissionConfig(explores=False))
    index = PlainIndex(street(), {**TEAM, "R3": Pose(11.0, 5.0, 1.0)})
    goal = street().goal("goal", 3.9, 3.4, -2.0, 1.0)
    log = lambda what, why, *args, **values: said.append((what, why))  # noqa: E731
    ours = Replanner("R1", pilot, index.published, index, goal, log)
    look = pilot.look_around()
    found = ours.plan(look)
    assert found.route is not None
    return SetOut(ours, look, found, found.route, trusts, said)


@pytest.mark.parametrize(("trust", "pose_is_blamed"), [(0.6, True), (1.0, False)])
def test_what_is_least_sure_is_blamed_for_leading_astray(
    trust: float, pose_is_blamed: bool
) -> None:
    """Of a sight of the goal and the relative poses that lead there."""
    ours, look, found, route, *_ = out = set_out(trust)
    assert 0.6 < route.sighting.chance < 1.0
    ours.rejections.blame(out.driven)
    assert ours.rejections.sights == (set() if pose_is_blamed else {b"R2", b"R3"})
    nothing = Comparison((), None)
    left = 0.0 if pose_is_blamed else trust
    assert ours.rejections.trust(found.looks["R2"], look, nothing) == left
    again = ours.plan(look).route
    assert again and again.robots == ("R1", "R3") if pose_is_blamed else again is None
    elsewhere = ours.pilot.look_around()
    assert ours.rejections.trust(elsewhere, found.looks["R2"], nothing) == trust


@pytest.mark.parametrize(
    ("away_m", "trust", "elsewhere"),
    [((1.0, 4.0), 0.0, True), ((1.0, 4.0), 0.9, False), ((1.0, 40.0), 0.0, False)],
)
def test_where_nothing_is_as_others_saw_it_a_relative_pose_was_wrong(
    away_m: tuple[float, float], trust: float, elsewhere: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two that should have stood so near must be known again; of one alone nothing is told."""
    out = set_out(0.9)
    here, rejections = out.ours.pilot.here, out.ours.rejections
    stood = [
        (digest, Pose(here.x_m + off_m, here.y_m), 1)
        for digest, off_m in zip((b"R2", b"R3"), away_m, strict=True)
    ]
    monkeypatch.setattr(Driven, "expected", lambda self: stood)
    out.trust["now"] = trust
    assert rejections.is_elsewhere(out.look, here, out.driven) == elsewhere
    assert [what for what, _ in out.said] == (["elsewhere", "doubt"] if elsewhere else [])
    assert len(rejections.pairs) == elsewhere


def test_only_what_led_there_can_have_led_there_wrongly(monkeypatch: pytest.MonkeyPatch) -> None:
    """R2 and R3 should have stood near here; the pose of R3 is less sure, but comes later."""
    out = set_out(0.9)
    here, leg = out.ours.pilot.here, out.route.legs[0]
    chain = [("R1", "R2", 0.85), ("R2", "R3", 0.9), ("R3", "R2", 0.6)]
    legs = [replace(leg, seen_by=a, next_by=b, trust=trust) for a, b, trust in chain]
    driven = Driven(replace(out.route, legs=tuple(legs), seen_by="R2"), out.found, here)
    near = [(b"R2", here, 1), (b"R3", here, 2)]
    monkeypatch.setattr(Driven, "expected", lambda self: near)
    out.trust["now"] = 0.0
    assert out.ours.rejections.is_elsewhere(out.look, here, driven)
    assert out.said[-1][1] == "R1 and R2 were not joined rightly"


@pytest.mark.parametrize(("surest", "pose_is_blamed"), [(0.9, False), (0.99, True)])
def test_a_sight_is_as_sure_as_the_surest_of_the_same_thing(
    surest: float, pose_is_blamed: bool
) -> None:
    """R2 is not sure, but R3 beside it is: then it was the relative pose that led astray."""
    ours, _, found, route, *_ = out = set_out(0.97)
    sights = {n: replace(s, chance=0.8) for n, s in found.goal_seen_by.items()}
    other = ({"R2", "R3"} - {route.seen_by}).pop()
    sights[other] = replace(sights[other], chance=surest)
    ours.rejections.blame(replace(out.driven, plan=replace(found, goal_seen_by=sights)))
    assert bool(ours.rejections.pairs) == pose_is_blamed
    assert ours.rejections.sights == (set() if pose_is_blamed else {b"R2", b"R3"})


@pytest.mark.parametrize(
    ("times", "others", "taken"),
    [(1.3, True, True), (1.1, True, False), (0.9, False, True), (0.7, False, False)],
)
def test_on_the_way_a_route_by_other_panoramas_has_to_be_better(
    times: float, others: bool, taken: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From here the driven one is known better; another one may only seem so."""
    ours, look, found, route, *_ = out = set_out(1.0)
    assert len(found.digests) == 1
    arrival = cast(Any, type("Nothing", (), {"note": lambda self, look: None})())
    follower = Follower(ours, arrival, lambda *said, **values: None)
    follower.driven = out.driven
    again = replace(found, route=replace(route, score=times * route.score, trust=1.0))
    if others:  # one more than those, as it leads by
        (name,) = set(route.robots) & set(found.published)
        more = {"R9": replace(found.published[name], digest=b"R9")}
        onward = replace(route.legs[-1], seen_by=name, next_by="R9")
        longer = replace(again.route, legs=(*route.legs, onward), seen_by="R9")
        again = replace(again, route=longer, published={**found.published, **more})
    monkeypatch.setattr(ours, "plan", lambda look: again)
    monkeypatch.setattr(ours.rejections, "is_elsewhere", lambda *asked: False)
    assert isinstance(follower.regard(look, route), Plan) == taken


def test_in_rooms_another_goal_may_stand_nearer_to_where_none_was_found() -> None:
    """As its pictures were taken from nearer: in a house of 19 m, 8 m are half of it."""
    none, there, beside = (Estimate(np.array([x, 0.0]), np.eye(2)) for x in (0.0, 1.5, 5.0))
    for share, in_vain in ((1.0, [True, True]), (0.25, [True, False])):
        rejections = Rejections(PERCEPTION, cast(Any, None), lambda *said, **values: None, share)
        rejections.blame = lambda driven: None  # type: ignore[method-assign]
        rejections.found_nothing(none, cast(Any, None))
        assert [rejections.was_in_vain(goal) for goal in (there, beside)] == in_vain

"""What is blamed where a chain led astray."""

from dataclasses import replace

import pytest
from plains import HOME, PERCEPTION, TEAM, PlainIndex, Walker, street

from vrchain.geometry import Pose
from vrchain.landmarks.matching.common import Comparison
from vrchain.navigation.driving.drive import Pilot
from vrchain.navigation.goal.rejections import Driven
from vrchain.navigation.mission import _Mission
from vrchain.navigation.planning.route import Plan
from vrchain.navigation.settings import Decision, MissionConfig

PATIENT = MissionConfig(explores=False)


@pytest.mark.parametrize(("trust", "join_is_blamed"), [(0.6, True), (1.0, False)])
def test_what_is_least_sure_is_blamed_for_leading_astray(
    trust: float, join_is_blamed: bool
) -> None:
    """Of a sight of the goal and the joins that lead there."""
    index = PlainIndex(street(), {**TEAM, "R3": Pose(11.0, 5.0, 1.0)})
    perception = replace(PERCEPTION, trust=lambda a, b, found: trust)
    goal = street().goal("goal", 3.9, 3.4, -2.0, 1.0)
    pilot = Pilot(Walker(street(), HOME), perception, PATIENT)
    ours = _Mission("R1", pilot, index.published, index, goal, lambda decision: None)
    look = pilot.look_around()
    found = ours.plan(look)
    assert found.route is not None and 0.6 < found.route.sighting.chance < 1.0
    ours.rejections.blame(Driven(found.route, found, pilot.here))
    # R3 stood beside R2 and saw the same
    assert ours.rejections.sights == (set() if join_is_blamed else {b"R2", b"R3"})
    nothing = Comparison((), None)
    assert ours.rejections.trust(found.looks["R2"], look, nothing) == (
        0.0 if join_is_blamed else trust
    )
    again = ours.plan(look).route
    assert again is None if not join_is_blamed else again and again.robots == ("R1", "R3")
    assert ours.rejections.trust(pilot.look_around(), found.looks["R2"], nothing) == trust


@pytest.mark.parametrize(
    ("away_m", "trust", "elsewhere"),
    [((1.0, 4.0), 0.0, True), ((1.0, 4.0), 0.9, False), ((1.0, 40.0), 0.0, False)],
)
def test_where_nothing_is_as_others_saw_it_a_join_was_wrong(
    away_m: tuple[float, float], trust: float, elsewhere: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two that should have stood so near must be known again; of one alone nothing is told."""
    trusts = {"now": 0.9}
    index = PlainIndex(street(), {**TEAM, "R3": Pose(11.0, 5.0, 1.0)})
    perception = replace(PERCEPTION, trust=lambda a, b, found: trusts["now"])
    goal = street().goal("goal", 3.9, 3.4, -2.0, 1.0)
    told: list[Decision] = []
    pilot = Pilot(Walker(street(), HOME), perception, PATIENT)
    ours = _Mission("R1", pilot, index.published, index, goal, told.append)
    look = pilot.look_around()
    found = ours.plan(look)
    assert found.route is not None
    driven = Driven(found.route, found, pilot.here)
    stood = [
        (digest, Pose(pilot.here.x_m + off_m, pilot.here.y_m), 1)
        for digest, off_m in zip((b"R2", b"R3"), away_m, strict=True)
    ]
    monkeypatch.setattr(Driven, "expected", lambda self: stood)
    trusts["now"] = trust
    assert ours.rejections.is_elsewhere(look, pilot.here, driven) == elsewhere
    assert [d.what for d in told] == (["elsewhere", "doubt"] if elsewhere else [])
    assert len(ours.rejections.refuted) == elsewhere


def test_only_what_led_there_can_have_led_there_wrongly(monkeypatch: pytest.MonkeyPatch) -> None:
    """R2 and R3 should have stood near here; the join of R3 is less sure, but comes later."""
    trusts = {"now": 0.9}
    index = PlainIndex(street(), {**TEAM, "R3": Pose(11.0, 5.0, 1.0)})
    perception = replace(PERCEPTION, trust=lambda a, b, found: trusts["now"])
    goal = street().goal("goal", 3.9, 3.4, -2.0, 1.0)
    pilot = Pilot(Walker(street(), HOME), perception, PATIENT)
    ours = _Mission("R1", pilot, index.published, index, goal, lambda decision: None)
    look = pilot.look_around()
    found = ours.plan(look)
    assert found.route is not None
    leg = found.route.legs[0]
    chain = [("R1", "R2", 0.85), ("R2", "R3", 0.9), ("R3", "R2", 0.6)]
    legs = [replace(leg, seen_by=a, next_by=b, trust=trust) for a, b, trust in chain]
    driven = Driven(replace(found.route, legs=tuple(legs), seen_by="R2"), found, pilot.here)
    near = [(b"R2", pilot.here, 1), (b"R3", pilot.here, 2)]
    monkeypatch.setattr(Driven, "expected", lambda self: near)
    trusts["now"] = 0.0
    assert ours.rejections.is_elsewhere(look, pilot.here, driven)
    assert ours.decisions[-1].why == "R1 and R2 were not joined rightly"


def test_a_sight_is_as_sure_as_the_surest_of_the_same_thing() -> None:
    """R2 is not sure, but R3 beside it is: then it was the join that led astray."""
    index = PlainIndex(street(), {**TEAM, "R3": Pose(11.0, 5.0, 1.0)})
    perception = replace(PERCEPTION, trust=lambda a, b, found: 0.97)
    goal = street().goal("goal", 3.9, 3.4, -2.0, 1.0)
    pilot = Pilot(Walker(street(), HOME), perception, PATIENT)
    for surest, join_is_blamed in ((0.9, False), (0.99, True)):
        ours = _Mission("R1", pilot, index.published, index, goal, lambda decision: None)
        found = ours.plan(pilot.look_around())
        assert found.route is not None
        sights = {n: replace(s, chance=0.8) for n, s in found.goal_seen_by.items()}
        other = ({"R2", "R3"} - {found.route.seen_by}).pop()
        sights[other] = replace(sights[other], chance=surest)
        told = replace(found, goal_seen_by=sights)
        ours.rejections.blame(Driven(found.route, told, pilot.here))
        assert bool(ours.rejections.refuted) == join_is_blamed
        assert ours.rejections.sights == (set() if join_is_blamed else {b"R2", b"R3"})


@pytest.mark.parametrize(
    ("times", "others", "taken"),
    [(1.3, True, True), (1.1, True, False), (0.9, False, True), (0.7, False, False)],
)
def test_on_the_way_a_route_by_other_panoramas_has_to_be_better(
    times: float, others: bool, taken: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From here the driven one is known better; another one may only seem so."""
    index = PlainIndex(street(), {**TEAM, "R3": Pose(11.0, 5.0, 1.0)})
    pilot = Pilot(Walker(street(), HOME), PERCEPTION, PATIENT)
    goal = street().goal("goal", 3.9, 3.4, -2.0, 1.0)
    ours = _Mission("R1", pilot, index.published, index, goal, lambda decision: None)
    look = pilot.look_around()
    found = ours.plan(look)
    route = found.route
    assert route is not None and len(found.digests) == 1
    ours.driven = Driven(route, found, pilot.here)
    again = replace(found, route=replace(route, score=times * route.score, trust=1.0))
    if others:  # one more than those, as it leads by
        (name,) = set(route.robots) & set(found.published)
        more = {"R9": replace(found.published[name], digest=b"R9")}
        onward = replace(route.legs[-1], seen_by=name, next_by="R9")
        longer = replace(again.route, legs=(*route.legs, onward), seen_by="R9")
        again = replace(again, route=longer, published={**found.published, **more})
    monkeypatch.setattr(ours, "plan", lambda look: again)
    monkeypatch.setattr(ours.rejections, "is_elsewhere", lambda *asked: False)
    assert isinstance(ours.regard(look, route), Plan) == taken

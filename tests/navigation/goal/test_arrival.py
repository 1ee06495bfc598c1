"""Driving up to what may be the goal, and standing at it."""

from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.navigation.driving.drive import Pilot
from vrchain.navigation.driving.estimates import Estimate
from vrchain.navigation.goal.arrival import Arrival
from vrchain.navigation.goal.candidates import Candidate
from vrchain.navigation.goal.recognition import GoalSight
from vrchain.navigation.settings import MissionConfig
from vrchain.robot import beams_rad

CONFIG, HERE = MissionConfig(), Pose(0.0, 0.0)


class Standing:
    """A pilot that stands where it is: no path leads on. ahead_m: what its range ring shows."""

    config, looks, blind = CONFIG, (), False
    nearest, surface, _around = Pilot.nearest, Pilot.surface, Pilot._around

    def __init__(self, here: Pose = HERE, ahead_m: float = 8.0) -> None:
        self.here, self.met_m = here, ahead_m
        self.now = SimpleNamespace(time_ns=0, range_ring_m=np.full(72, ahead_m))

    def look_around(self) -> Any:
        return None

    def glance(self, bearing_rad: float) -> Any:
        return None

    def shows(self, bearing_rad: float) -> bool:
        return not self.blind

    def ahead_m(self, *bearing_rad: Any) -> float:
        return self.met_m

    def until_ns(self, place: Estimate) -> int:
        return self.now.time_ns + 1

    def stretch(self, *way: Any) -> float | None:
        self.now.time_ns += 1
        return None


def arrival(pilot: Standing | None = None, sight: GoalSight | None = None) -> Arrival:
    """An arrival whose every look shows this of the goal; said: what it logged."""
    said: list[str] = []
    goal = SimpleNamespace(find=lambda *asked, **fair: sight, share=1.0)
    log = lambda what, *args, **values: said.append(what)  # noqa: E731
    ours = Arrival(cast(Any, pilot or Standing()), cast(Any, goal), log)
    cast(Any, ours).said = said
    return ours


def sight_of(
    range_m: float, n_matches: int = 12, chance: float = 0.9, sized: bool = False, **more: float
) -> GoalSight:
    """Of the goal, so far ahead."""
    about = {"bearing_rad": 0.0, "half_width_rad": 0.2, "looks": 3.0, **more}
    return GoalSight(
        range_m=range_m, surface_m=range_m, n_matches=n_matches, chance=chance, sized=sized,
        **cast(Any, about),
    )  # fmt: skip


def at(x_m: float, *sights: tuple[float, GoalSight], chance: float = 0.99) -> Candidate:
    """Believed to be there on the x axis, seen from these places on it."""
    seen = tuple((Pose(float(here), 0.0), sight) for here, sight in sights)
    return Candidate(Estimate(np.array([x_m, 0.0]), np.eye(2)), chance, seen)


def candidate(x_m: float, chance: float = 0.9, n_matches: int = 12) -> Candidate:
    """Seen once, so far ahead."""
    return at(x_m, (0.0, sight_of(x_m, n_matches, chance)), chance=chance)


@pytest.mark.parametrize("seen", [candidate(30.0), candidate(8.0, 0.95, n_matches=60)])
def test_what_no_path_led_to_is_tried_once_more(seen: Candidate) -> None:
    """From afar, or surely the goal: that is blocked where it was seen, not at its far side."""
    ours = arrival()
    assert not ours.drive_to(seen) and ours.is_blocked(seen.place)
    assert not ours.was_mistaken(seen.place)
    assert not ours.drive_to(seen) and ours.was_mistaken(seen.place)


def test_what_was_refuted_from_near_is_not_driven_to_again() -> None:
    ours, near = arrival(), candidate(10.0)
    ours.candidates.append(candidate(10.5))  # the same, noted at another look
    assert ours.likeliest is not None
    assert not ours.drive_to(near) and ours.was_mistaken(near.place)
    assert ours.likeliest is None


def test_none_of_the_sides_of_what_was_circled_is_the_goal() -> None:
    """As it was met: a robot went round one house three times."""
    ours = arrival(sight=sight_of(8.0))
    assert not ours.drive_to(candidate(8.0))
    middle_xy_m = np.array([12.0, 0.0])
    for angle in np.arange(0.0, 2 * np.pi, 0.5):
        side = middle_xy_m + 4.0 * np.array([np.cos(angle), np.sin(angle)])
        assert ours.was_mistaken(Estimate(side, np.eye(2)))
    assert not ours.was_mistaken(Estimate(np.array([24.0, 0.0]), np.eye(2)))


@pytest.mark.parametrize(
    ("range_m", "said"), [(3.0, ["back", "circle"]), (8.0, ["circle"])], ids=["near", "far"]
)
def test_what_was_seen_from_too_near_only_is_seen_from_farther_first(
    range_m: float, said: list[str]
) -> None:
    """As it was met: a plain shop, surely seen from 4.9 m and less, was gone round for nothing."""
    ours, stands = arrival(), list[Any]()
    pilot = cast(Any, ours.pilot)
    stretch, pilot.stretch = pilot.stretch, lambda *way: (stands.append(way[0]), stretch(*way))[1]
    assert not ours.drive_to(candidate(range_m, 0.97))
    assert cast(Any, ours).said == ["approach", *said, "doubt"]
    if said[0] == "back":  # 15 m off its side, on this side of it
        assert any(np.allclose(xy_m, (range_m - 15.0, 0.0)) for xy_m in stands)


@pytest.mark.parametrize(("chance", "n_sides"), [(0.85, 1), (0.9, 2), (0.95, 3), (0.99, 5)])
def test_what_is_less_likely_is_looked_at_from_fewer_sides(
    chance: float, n_sides: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first side that leaves it unsure leaves a quarter of its odds, each more a half."""
    ours, seen = arrival(), candidate(8.0, chance)
    sides = iter([seen.place] * 5)
    monkeypatch.setattr(ours, "_sides", lambda candidate, n: sides)
    assert not ours._circle(seen).is_sure(CONFIG)
    assert 5 - len(list(sides)) == n_sides


def test_a_goal_that_is_known_from_one_side_alone_is_found_by_going_round() -> None:
    """As it was met: a barn was given up half round, and the side in its pictures was beyond."""
    ours, seen = arrival(), candidate(8.0, 0.99)
    middle_xy_m, pilot = np.array([12.0, 0.0]), cast(Any, ours.pilot)
    turns: list[float] = []

    def stretch(xy_m: Any, *way: object) -> float:
        pilot.here, pilot.now.time_ns = Pose(*xy_m), pilot.now.time_ns + 1
        return 1.0

    def find(look: Any, bearing_rad: float = 0.0, *window: Any, **fair: Any) -> GoalSight | None:
        if not window:
            return None  # all around
        turns.append(pilot.here.bearing_to_rad(middle_xy_m))
        surely = abs(turns[-1] + np.pi / 3) < 0.1
        return sight_of(8.0, 60 if surely else 12, 0.97, bearing_rad=bearing_rad)

    pilot.stretch, ours.goal = stretch, cast(Any, SimpleNamespace(find=find, share=1.0))
    assert ours._circle(seen).is_sure(CONFIG)
    assert len(turns) > 5  # at five sides, and on the way to the last


@pytest.mark.parametrize("bearing_rad", [0.0, 1.5])
def test_what_a_look_around_shows_of_what_is_circled_counts(
    bearing_rad: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As it was met: the goal was gone round, seen surely by looks around, and given up."""
    around = sight_of(8.0, 60, 0.99, bearing_rad=bearing_rad)  # beside where a glance is thrown
    ours, seen = arrival(), candidate(8.0, 0.95)
    monkeypatch.setattr(ours, "_sides", lambda candidate, turns: iter([seen.place] * len(turns)))
    find = lambda look, *window, **fair: None if window else around  # noqa: E731
    ours.goal = cast(Any, SimpleNamespace(find=find, share=1.0))
    cast(Any, ours.pilot).here = Pose(0.6, 0.0)
    assert ours._circle(seen).is_sure(CONFIG) == (bearing_rad == 0.0)


@pytest.mark.parametrize(("chance", "x_m", "left"), [(1.0, 60.0, 1), (1.0, 9.0, 3), (0.9, 60.0, 3)])
def test_a_circle_is_left_for_what_is_far_surer_elsewhere(
    chance: float, x_m: float, left: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As it was met: two minutes round a look-alike, with the goal in view 17 m away."""
    ours, seen = arrival(), candidate(8.0, 0.95)
    sides = iter([seen.place] * 5)
    monkeypatch.setattr(ours, "_sides", lambda candidate, n: sides)
    ours.candidates.append(candidate(x_m, chance))
    assert not ours._circle(seen).is_sure(CONFIG)
    assert 5 - len(list(sides)) == left
    waits = any(c.place is seen.place for c in ours.candidates)  # again, and is no mistake
    assert waits == (left == 1) != ours.was_mistaken(seen.place)


def test_a_mistake_gives_way_to_a_far_surer_sight_and_not_twice_to_the_same() -> None:
    """As it was met: a goal that was doubted by one poor sight, and then seen well in vain."""
    ours = arrival()
    assert not ours.drive_to(candidate(8.0, 0.6))
    for chance, given_up in ((0.85, True), (0.95, False)):
        assert ours.was_mistaken(candidate(8.0).place, chance) == given_up
        ours.candidates = [candidate(8.0, chance)]
        assert (ours.likeliest is None) == given_up
    assert not ours.drive_to(candidate(8.0, 0.95))
    assert ours.was_mistaken(candidate(8.0).place, 0.95)
    assert ours.was_mistaken(candidate(8.0).place)


def test_what_turns_out_to_be_a_known_mistake_is_not_circled() -> None:
    ours = arrival()
    assert not ours.drive_to(candidate(8.0)) and not ours.drive_to(candidate(9.0))
    assert cast(Any, ours).said == ["approach", "circle", "doubt", "approach", "doubt"]


@pytest.mark.parametrize(("chance", "goes_round"), [(0.96, True), (0.6, False)])
def test_what_was_surely_seen_from_afar_is_gone_round_if_it_is_not_seen_from_near(
    chance: float, goes_round: bool
) -> None:
    """As it was met: eight sights of a goal by a chance of 0.9 and more, and none from 8 m on."""
    ours, seen = arrival(), candidate(8.0, chance)
    for _ in range(3):
        seen = ours._regarded(seen)
    assert seen.against == 3 and (seen.chance > 0.5) == goes_round
    ours.drive_to(seen)
    assert ("circle" in cast(Any, ours).said) == goes_round


def test_what_is_left_for_what_is_likelier_waits_again() -> None:
    ours = arrival(sight=sight_of(40.0, chance=0.9, bearing_rad=2.0))
    left = candidate(30.0, 0.6)
    assert ours._seen_from_afar(left).chance == 0.9
    assert ours.candidates == [left]


@pytest.mark.parametrize(
    ("ahead_m", "blind", "against"), [(8.0, False, 1), (2.0, False, 0), (8.0, True, 0)]
)
def test_a_glance_that_cannot_show_it_does_not_speak_against_it(
    ahead_m: float, blind: bool, against: int
) -> None:
    """As it was met: ten along a goal's own wall, and it was given up. Or no camera looks there."""
    seen, pilot = candidate(8.0), Standing(ahead_m=ahead_m)
    pilot.blind = blind
    after = arrival(pilot)._regarded(seen)
    assert after.against == against and (after.chance < seen.chance) == bool(against)


def test_the_side_in_front_is_another_on_the_way() -> None:
    """As it was met: a robot passed a long wall, and what it drove to fell behind, in the house."""
    ours, before = arrival(), candidate(30.0)
    pilot = cast(Any, ours.pilot)
    pilot.stretch = lambda *way: setattr(pilot.now, "time_ns", 10) or 4.0
    after = ours._close_in(before)
    assert after.place.std_m**2 == pytest.approx(before.place.std_m**2 + 0.8)


def test_two_bearings_to_a_wide_thing_do_not_tell_how_far_it_is() -> None:
    """As it was met: two sights of a house, each to another part of it, put it 9 m before both."""
    ours = arrival()
    for bearing_rad in (0.0, 0.25):
        seen = sight_of(20.0, bearing_rad=bearing_rad, half_width_rad=0.3)
        find = lambda *asked, seen=seen, **fair: seen  # noqa: E731
        ours.goal = cast(Any, SimpleNamespace(find=find, share=1.0))
        ours.note(cast(Any, None))
        cast(Any, ours.pilot).here = Pose(1.0, 0.0)
    (found,) = ours.candidates
    assert 18.5 < found.place.range_m(HERE) < 21.0


def test_two_looks_from_one_place_are_one_sight() -> None:
    unsure = Candidate(Estimate(np.array([12.0, 0.0]), 9.0 * np.eye(2)), 0.5)
    once = unsure.with_sight(HERE, sight_of(12.0))
    again = once.with_sight(HERE, sight_of(12.0, chance=0.95))
    assert len(again.sights) == 1 and again.chance == 0.95
    assert again.place.std_m == once.place.std_m < 3.0


class BeforeABush(Standing):
    """Something narrow stands 0.8 m ahead, a wall farther on."""

    ahead_m = Pilot.ahead_m  # type: ignore[assignment]

    def __init__(self, front_m: float) -> None:
        super().__init__()
        self.driven_to: list[float] = []
        forward = np.cos(beams_rad(72))
        ring = np.minimum(front_m / np.maximum(forward, 1e-9), 8.0)
        self.now.range_ring_m = np.where(forward > np.cos(0.4), 0.8, ring)

    def stretch(self, xy_m: Any, *way: object) -> None:
        self.driven_to.append(float(xy_m[0]))


@pytest.mark.parametrize(
    ("front_m", "half_width_rad", "driven_to"),
    [
        (3.0, 0.3, [2.1]),  # beside the bush the wall is 3.3 m away
        (1.2, 0.3, []),  # it stands before the front itself
        (8.0, 0.3, []),  # nothing is behind
        (3.2, 0.1, []),  # the goal is narrow
    ],
)
def test_a_bush_before_a_wide_goal_is_gone_round(
    front_m: float, half_width_rad: float, driven_to: list[float]
) -> None:
    pilot = BeforeABush(front_m)
    wide = sight_of(9.0, half_width_rad=half_width_rad)
    arrival(pilot)._draw_up(at(1.0, (-9.0, wide)))
    assert pilot.driven_to == pytest.approx(driven_to, abs=0.05)


def test_who_would_have_to_go_far_round_stays_where_it_has_arrived() -> None:
    """As it was met: from 2 m before a house along a hedge, and 3.5 m from it it was claimed."""
    pilot = BeforeABush(3.0)

    def away(xy_m: Any, *way: object) -> float:
        pilot.here = Pose(pilot.here.x_m - 0.5, pilot.here.y_m)
        return 0.5

    pilot.stretch = away  # type: ignore[method-assign]
    arrival(pilot)._draw_up(at(1.0, (-9.0, sight_of(9.0, half_width_rad=0.3))))
    assert -1.0 <= pilot.here.x_m <= -0.5


def sized(range_m: float, bearing_rad: float = 0.0, n_matches: int = 20) -> GoalSight:
    """By its size so far away."""
    return sight_of(range_m, n_matches, 0.99, sized=True, bearing_rad=bearing_rad)


@pytest.mark.parametrize("off_by", [0.4, 0.9, 1.0, 1.15])
@pytest.mark.parametrize("range_m", [2.0, 6.0])
def test_how_far_it_is_is_told_by_how_large_it_looks(off_by: float, range_m: float) -> None:
    """From how far its pictures were taken is known about, or else told by how it grows.

    As it was met: a store of a strange world seemed to be half as far as it was.
    """
    places = np.arange(0.0, 29.0 - range_m, 2.5)
    ours = arrival(Standing(Pose(30.0 - range_m, 0.0)))
    there = ours._behind_this(at(0.0, *((x_m, sized((30.0 - x_m) * off_by)) for x_m in places)))
    if range_m < 4.0:
        assert there is None
    else:
        assert there == pytest.approx([30.0, 0.0], abs=2.0)
    assert ours._behind_this(at(0.0)) is None


def test_how_far_it_is_is_told_by_the_side_in_front() -> None:
    """From its other side it looked nearer than it was: that tells nothing of this one."""
    before = [(Pose(x_m, 0.0), sized(0.4 * (30.0 - x_m))) for x_m in range(0, 25, 4)]
    now = [(Pose(20.0, y_m), sized(y_m + 1.0, -np.pi / 2)) for y_m in (9.0, 6.0, 3.0)]
    seen = replace(at(0.0), sights=(*before, *now))
    assert arrival(Standing(Pose(20.0, 1.2)))._behind_this(seen) is None


@pytest.mark.parametrize("short_m", [-8.0, 8.0])
def test_what_looks_nearer_than_it_is_is_not_behind_what_the_robot_met(short_m: float) -> None:
    """As it was met: by size a house was 8 m behind the robot, which stood before it."""
    sights = [(x_m, sized(20.0 - short_m - x_m)) for x_m in (0.0, 3.0, 6.0, 8.0)]
    there = arrival(Standing(Pose(20.0, 0.0)))._behind_this(at(0.0, *sights))
    assert (there is None) == (short_m > 0)


@pytest.mark.parametrize(
    ("looks_m", "met_m", "there"),
    [(1.8, 1.0, True), (1.8, 6.0, False), (2.8, 1.0, False), (6.0, 1.0, False)],
)
def test_its_wall_is_met_before_it_is_believed_to_be(
    looks_m: float, met_m: float, there: bool
) -> None:
    """As it was met: the goal was believed 4 m away, and its wall was in the way there."""
    ours = arrival(Standing(ahead_m=met_m))
    assert ours._is_there(at(4.0, (0.0, sized(looks_m)))) == there


@pytest.mark.parametrize(("met_x_m", "side_x_m"), [(3.5, 5.0), (6.5, 6.5), (8.1, 5.0)])
def test_what_is_met_beyond_it_is_not_its_side(met_x_m: float, side_x_m: float) -> None:
    """As it was met: passing its goal's long wall, a robot took for it what came ahead, and next.

    Seen from 4 m, which tells that to 0.9 m; what is met at 3.5 m is before where it is believed.
    """
    ours = arrival(Standing(Pose(3.0, 0.0), met_x_m - 3.0))
    felt = ours._felt(at(5.0, (0.0, sized(4.0))))
    assert felt.place.xy_m == pytest.approx([side_x_m, 0.0])


@pytest.mark.parametrize(("sure", "std_m", "side_x_m"), [
    (True, 1.0, 3.6), (True, 0.5, 5.0), (False, 1.0, 5.0),
])  # fmt: skip
def test_a_goal_that_was_surely_seen_may_be_nearer_than_it_is_believed(
    sure: bool, std_m: float, side_x_m: float
) -> None:
    """As it was met: 0.6 m from its goal's wall a robot took the side to be 2 m farther in."""
    ours = arrival(Standing(Pose(3.0, 0.0), 0.6))
    seen = at(5.0, (0.0, sight_of(5.0, 60 if sure else 12)))
    assert seen.is_sure(CONFIG) == sure
    believed = replace(seen, place=Estimate(seen.place.xy_m, std_m**2 * np.eye(2)))
    assert ours._felt(believed).place.xy_m == pytest.approx([side_x_m, 0.0])


@pytest.mark.parametrize(
    ("y_m", "met_m", "matches", "touches"),
    [
        (3.5, 0.6, 60, True),
        (7.4, 0.6, 60, True),
        (3.5, 0.6, 12, False),
        (3.5, 2.0, 60, False),
        (9.5, 0.6, 60, False),
    ],
)
def test_round_its_corner_what_is_touched_is_the_goal(
    y_m: float, met_m: float, matches: int, touches: bool
) -> None:
    """As it was met: 0.6 m from its goal's wall a robot drove round it for 80 s.

    It had seen the side round the corner, and its own wall stood before where that should be. Not
    if that was not surely the goal, if nothing is near, or if what is near stands beside it.
    """
    ours = arrival(Standing(Pose(8.0, y_m), met_m))
    met = ours._touched(at(5.0, (0.0, sight_of(5.0, matches))))
    assert (met is not None) == touches
    if met is not None:
        assert np.hypot(*(met - [8.0, y_m])) == pytest.approx(met_m)


def test_what_is_touched_beside_an_open_way_to_the_goal_is_something_else() -> None:
    """As it was met: at a hedge, 4 m before its goal's wall, a robot took that for the goal."""
    ours = arrival(Standing(Pose(8.0, 3.5), 0.6))
    ours.pilot.ahead_m = lambda *bearing_rad: 4.0
    assert ours._touched(at(5.0, (0.0, sight_of(5.0, 60)))) is None


@pytest.mark.parametrize(
    ("believed_m", "from_m", "touches"), [(5.0, 15.0, True), (20.0, 60.0, False)]
)
def test_what_is_touched_on_the_way_to_what_was_seen_from_afar_is_not_it(
    believed_m: float, from_m: float, touches: bool
) -> None:
    """As it was met: 33 m before its goal, seen once from 101 m, a robot took another thing for it.

    It is where the goal may be, since that is so unsure.
    """
    ours = arrival(Standing(HERE, 0.6))
    surely = at(believed_m, (believed_m - from_m, sight_of(from_m, 60)))
    assert (ours._touched(surely) is not None) == touches


def test_what_is_touched_before_a_goal_that_looks_wide_is_not_it() -> None:
    """As it was met: 6 m before its goal, which looked wide with a hedge beside it, at that hedge.

    So wide, it may reach far to both sides, but no nearer than it was seen to be.
    """
    wide = sight_of(6.2, 60, 0.99, sized=True, half_width_rad=0.84)
    assert arrival(Standing(HERE, 1.0))._touched(at(6.2, (0.0, wide))) is None


class BesideAWall(Standing):
    """Along a wall to the right, and before what may be a bush."""

    ahead_m = Pilot.ahead_m  # type: ignore[assignment]

    def __init__(
        self, wall_m: float, bush_rad: float, bush_m: float, half_width_rad: float = 0.3
    ) -> None:
        super().__init__()
        beams = beams_rad(72)
        ring = np.minimum(wall_m / np.maximum(-np.sin(beams), 1e-9), 8.0)
        hidden = np.abs(wrap_angle_rad(beams - bush_rad)) < half_width_rad
        ring[hidden] = np.minimum(ring[hidden], bush_m)
        self.now.range_ring_m = ring


@pytest.mark.parametrize(
    ("wall_m", "bearing_rad", "bush_m", "here"),
    [(1.4, -0.32, 8.0, True), (2.5, -0.6, 8.0, False), (1.4, -0.32, 1.2, False)],
)
def test_who_looks_along_its_wall_stands_before_it(
    wall_m: float, bearing_rad: float, bush_m: float, here: bool
) -> None:
    """As it was met: a robot saw its goal's far end, 1.4 m from its wall, and went round it.

    Not if that wall is nowhere near, nor if a bush is met before what is seen.
    """
    ours = arrival(BesideAWall(wall_m, bearing_rad, bush_m))
    seen = at(1.4, (0.0, sized(6.5, bearing_rad)))
    assert (ours._behind_this(seen) is None) == here


def test_a_trunk_or_a_bush_is_not_the_wall_of_a_wide_goal() -> None:
    """As it was met: at a tree 3.8 m before its goal's wall a robot said that it had arrived.

    And at a bush, 4.1 m before it. What is as wide as a wall may be one.
    """
    seen = at(1.0, (-9.0, sight_of(9.0, half_width_rad=0.4)), (-9.5, sized(9.5)))
    for half_rad, wall_m, trunk_m, there in (
        (0.13, 4.4, 1.1, False), (0.13, 2.5, 1.1, True), (0.13, 1.1, 8.0, True),
        (0.55, 4.4, 1.1, False), (1.0, 4.4, 1.3, True),
    ):  # fmt: skip
        ours = arrival(BesideAWall(wall_m, -np.pi / 2, trunk_m, half_rad))
        ours.pilot.here = Pose(0.0, 0.0, np.pi / 4)  # its place is ahead, between both
        assert ours._is_there(seen) == there


def test_at_hand_it_may_be_on_any_side() -> None:
    """As it was met: its goal should be 0.6 m away, on one side, and its wall was on the other."""
    ours = arrival(BesideAWall(0.9, 0.0, 8.0))
    for way_m, there in ((5.6, True), (7.0, False)):
        assert ours._is_there(at(3.1, (-5.0, sized(way_m, 0.05)))) == there


@pytest.mark.parametrize(("range_m", "arrives"), [(6.0, False), (1.0, True)])
def test_from_another_side_it_is_looked_at_before_it_is_claimed(
    range_m: float, arrives: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As it was met: a hedge 5 m before the goal, which looked near in two sights of three."""
    sight = sight_of(range_m, 60, 0.99, sized=True, looks=3.4)
    ours = arrival(sight=sight)
    ahead = ((-12.0, 1.0), (-9.0, 1.0), (-6.0, range_m))  # stood, and believed it to be, on the x
    before = at(1.0, *((x_m, replace(sight, surface_m=at_m - x_m)) for x_m, at_m in ahead))
    beside: list[Candidate] = []

    def sides(candidate: Candidate, n: int) -> Iterator[Estimate]:
        beside.append(before)
        yield before.place

    monkeypatch.setattr(ours, "_sides", sides)
    met = lambda place, reach_m: (0.0, 1.0) if beside else None  # noqa: E731
    monkeypatch.setattr(ours, "_met_at", met)
    assert ours.drive_to(before) == arrives and beside


@pytest.mark.parametrize("unsure", [1, 2])
def test_what_is_no_longer_sure_is_not_claimed(
    unsure: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Surely the goal by two sights of so many more; a look from where it stands is unsure too."""
    good = sight_of(8.0, 30, looks=3.4)
    poor = replace(good, n_matches=5, looks=2.6, chance=0.6)
    ours = arrival(sight=poor)
    seen = at(1.0, *((-x_m, s) for x_m, s in enumerate([good, good] + [poor] * unsure, 2)))
    assert seen.is_sure(CONFIG)
    monkeypatch.setattr(ours, "_met_at", lambda place, reach_m: (0.0, 1.0))
    monkeypatch.setattr(ours, "_sides", lambda candidate, n: iter(()))
    assert ours.drive_to(seen) == (unsure == 1)
    assert ours.was_mistaken(seen.place) == (unsure == 2)

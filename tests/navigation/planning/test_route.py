"""Routes: the best chain of common landmarks, what is not trusted, and what is compared for it."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import pairwise, permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vrchain.errors import ImageError
from vrchain.geometry import Pose, relative
from vrchain.landmarks.matching.common import CommonLandmark, Comparison, Region, support_score
from vrchain.landmarks.matching.epipolar import PlanarGeometry
from vrchain.navigation.goal.recognition import GoalSight
from vrchain.navigation.planning.route import Plan, plan, worth
from vrchain.navigation.settings import Published, robot_of
from vrchain.panorama import CameraRig
from vrchain.seeding import generator


@dataclass(frozen=True)
class Shown:
    """Stands in for a look: how many of the goal's keypoints it shows."""

    matches: int
    rig: CameraRig = field(default_factory=CameraRig)
    record: None = None


def find(look: Shown, *around: float) -> GoalSight | None:
    """The goal, known by 15 keypoints or more."""
    if look.matches < 15:
        return None
    return GoalSight(0.1, 12.0, 10.0, 0.2, look.matches, 2.0, support_score(look.matches))


NOTHING, RIG, HERE = Shown(0), CameraRig(), Pose(0.0, 0.0)


def region(bearing_rad: float) -> Region:
    return Region(0, (0.0, 0.0, 9.0, 9.0), bearing_rad, 0.1)


def landmark(
    score: float,
    bearing_b: float = 0.5,
    ranges: tuple[float, float] | None = None,
    bearing_a: float = -0.5,
) -> CommonLandmark:
    return CommonLandmark(
        score, region(bearing_a), region(bearing_b), np.arange(5), np.arange(5) + 10, ranges
    )


class StubIndex:
    """What a ledger would say: common landmarks by pair of names, in the planner's order.

    shown: what each panorama is, or how many keypoints of the goal it shows.
    """

    def __init__(
        self,
        edges: dict[tuple[str, str], list[CommonLandmark]],
        shown: dict[str, int | Shown],
    ) -> None:
        self.edges, self.asked = edges, list[tuple[str, str]]()
        self.shown = {n: s if isinstance(s, Shown) else Shown(s) for n, s in shown.items()}

    @property
    def n_compared(self) -> int:
        return len(set(self.asked))

    def is_by(self, rig: CameraRig, digest: bytes) -> bool:
        return True

    def look(self, digest: bytes) -> Shown:
        return self.shown.get(digest.decode(), NOTHING)

    def compare(self, a: bytes, b: bytes) -> Comparison:
        return self._common(a.decode(), b.decode())

    def compare_with(self, current: Shown, b: bytes) -> Comparison:
        return self._common("R1", b.decode())

    def _common(self, a: str, b: str) -> Comparison:
        self.asked.append((a, b))
        return Comparison(tuple(self.edges.get((a, b), [])), None)


def plan_of(
    names: Sequence[str],
    index: StubIndex,
    own: Sequence[Shown] = (NOTHING,),
    stood: Sequence[Pose] = (HERE,) * 9,
    **options: object,
) -> Plan:
    """R1's, by panoramas of others, the earlier ones first, and its own, the latest first."""
    published = {name: Published(name.encode(), k) for k, name in enumerate(names)}
    options = {"find": find, **options}
    return plan("R1", list(zip(stood, own, strict=False)), published, index, **options)


def planned(
    edges: dict[tuple[str, str], float | list[CommonLandmark]],
    goal_matches: dict[str, int],
    robots: int = 4,
    **options: object,
) -> Plan:
    """The plan of R1 where R2, R3 ... have the named landmarks in common.

    One given as a score alone is a landmark that no other two have in common.
    """
    lists = {
        (a, b): v
        if isinstance(v, list)
        else [landmark(v, 0.3 * int(a[1:]), None, 0.3 * int(b[1:]))]
        for (a, b), v in edges.items()
    }
    names = [f"R{i}" for i in range(2, robots + 1)]
    return plan_of(names, StubIndex(lists, goal_matches), **options)


def test_the_papers_chain() -> None:
    found = planned({("R1", "R2"): 0.9, ("R2", "R3"): 0.8}, {"R3": 40}, 3)
    assert list(found.goal_seen_by) == ["R3"] and found.why_none == ""
    assert found.route.robots == ("R1", "R2", "R3") and found.route.seen_by == "R3"
    assert [(leg.seen_by, leg.next_by) for leg in found.route.legs] == [("R1", "R2"), ("R2", "R3")]
    assert found.route.score == pytest.approx(0.9 * 0.8 * support_score(40))
    assert found.route.sighting.n_matches == 40
    assert found.route.legs[0].landmark.score == 0.9


@pytest.mark.parametrize(
    ("edges", "goal_matches", "robots", "why"),
    [
        ({("R1", "R2"): 0.9}, {"R2": 10}, 3, "no other robot's panorama shows the goal"),
        ({("R1", "R2"): 0.9}, {"R3": 40}, 3,
         "R3 sees the goal, but no chain of common landmarks leads there"),
        ({}, {"R2": 40, "R3": 40}, 3,
         "R2, R3 see the goal, but no chain of common landmarks leads there"),
        ({("R1", "R2"): 1e-300}, {"R2": 40}, 2,  # so small a chance is none
         "R2 sees the goal, but no chain of common landmarks leads there"),
        ({}, {}, 1, "the ledger holds no panorama of another robot"),
    ],
)  # fmt: skip
def test_why_there_is_no_route(edges: dict, goal_matches: dict, robots: int, why: str) -> None:
    found = planned(edges, goal_matches, robots)
    assert found.route is None and found.why_none == why
    assert set(found.goal_seen_by) == {name for name, n in goal_matches.items() if n >= 15}
    assert set(found.graph.robots) == {f"R{k + 1}" for k in range(robots)}


def test_panoramas_that_cannot_be_read_or_are_of_another_rig_are_named() -> None:
    class Torn(StubIndex):
        def look(self, digest: bytes) -> Shown:
            if digest == b"R2":
                raise ImageError("no panorama")
            return super().look(digest)

    edges = {("R1", "R2"): [landmark(0.9)], ("R1", "R3"): [landmark(0.5)]}
    other = Shown(40, CameraRig(width_px=320))
    for index in (Torn(edges, {"R3": 40}), StubIndex(edges, {"R2": other, "R3": 40})):
        found = plan_of(["R2", "R3"], index)
        assert found.unreadable == ("R2",) and found.route.robots == ("R1", "R3")
        assert plan_of(["R2"], index).why_none == (
            "no panorama by cameras like its own can be read, of R2"
        )


def test_a_landmark_that_three_see_leads_from_each_to_each() -> None:
    """R1 and R3 were never found to see it both; R2 sees the same region as each of them."""
    by_r1 = landmark(0.9, bearing_b=0.5, bearing_a=-1.0)
    by_r3 = landmark(0.8, bearing_a=0.51, bearing_b=2.0)
    edges = {("R1", "R2"): [by_r1], ("R2", "R3"): [by_r3]}
    found = planned(edges, {"R3": 40}, 3)
    (leg,) = (claim for _, claim in found.graph.legs if (claim.a, claim.b) == ("R1", "R3"))
    assert leg.score == leg.landmark.score == pytest.approx(0.72)
    assert (leg.landmark.a, leg.landmark.b) == (by_r1.a, by_r3.b)
    assert leg.landmark.support_a is by_r1.support_a
    assert leg.landmark.support_b is by_r3.support_b
    # driven by way of R2: nothing was found that joins R1 and R3
    assert found.route.robots == ("R1", "R2", "R3")
    assert [leg.landmark for leg in found.route.legs] == [by_r1, by_r3]
    assert len({leg.node for leg in found.route.legs}) == 1
    assert found.route.score == pytest.approx(0.72 * support_score(40))
    assert found.route.trust == pytest.approx(support_score(40))


def test_a_failed_landmark_is_not_used_again_wherever_it_is_seen_from() -> None:
    near, far = landmark(0.9, 0.5), landmark(0.7, -2.0)
    first = planned({("R1", "R2"): [near, far]}, {"R2": 40}, 2).route.legs[0]
    assert first.landmark is near
    second = planned({("R1", "R2"): [near, far]}, {"R2": 40}, 2, failed={first.key}).route.legs[0]
    assert second.landmark is far and second.key != first.key
    # the driving robot has moved; seen from the other one the landmark is where it was
    moved = {("R1", "R2"): [landmark(0.95, 0.51, bearing_a=-2.0)]}
    assert planned(moved, {"R2": 40}, 2, failed={first.key}).route is None
    edges = {("R1", "R3"): 0.9, ("R2", "R3"): 0.9}  # walked against the order of comparison
    route = planned(edges, {"R2": 40}, 3).route
    assert route.robots == ("R1", "R3", "R2")
    assert planned(edges, {"R2": 40}, 3, failed={route.legs[1].key}).route is None


def test_a_panorama_whose_sight_is_rejected_is_no_end_but_may_be_on_the_way() -> None:
    edges = {("R1", "R2"): 0.9, ("R2", "R3"): 0.9}
    found = planned(edges, {"R2": 60, "R3": 20}, 3)
    assert found.route.seen_by == "R2"
    found = planned(edges, {"R2": 60, "R3": 20}, 3, rejected={b"R2"})
    assert found.route.robots == ("R1", "R2", "R3") and list(found.goal_seen_by) == ["R3"]
    assert planned(edges, {"R2": 60, "R3": 20}, 3, rejected={b"R2", b"R3"}).route is None


def test_a_landmark_walked_against_its_order_is_turned_round() -> None:
    """Compared as (R2, R3), walked from R3 to R2."""
    original = landmark(0.8, 0.5, (2.0, 0.5))
    found = planned({("R1", "R3"): 0.9, ("R2", "R3"): [original]}, {"R2": 40}, 3)
    leg = found.route.legs[1]
    assert (leg.seen_by, leg.next_by) == ("R3", "R2")
    assert leg.landmark.a is original.b and leg.landmark.b is original.a
    assert leg.landmark.support_a is original.support_b
    assert leg.landmark.support_b is original.support_a
    assert leg.landmark.ranges == (0.5, 2.0) and leg.landmark.score == 0.8
    forth = planned({("R1", "R2"): 0.9, ("R2", "R3"): [original]}, {"R3": 40}, 3)
    assert forth.route.legs[1].landmark is original
    assert forth.route.legs[1].key == leg.key
    blind = {("R1", "R3"): 0.9, ("R2", "R3"): [landmark(0.8)]}
    assert planned(blind, {"R2": 40}, 3).route.legs[1].landmark.ranges is None


def test_near_landmarks_are_worth_more_than_far_ones() -> None:
    near, far = landmark(0.8, 0.5, (0.7, 0.7)), landmark(0.99, -2.0, (9.0, 9.0))
    assert worth(near, 7.0) > worth(far, 7.0) > 0
    assert worth(near, 7.0) > worth(near, 14.0)  # the same angles, but twice the way
    assert worth(landmark(0.8), 7.0) == 0.8
    found = planned({("R1", "R2"): [far, near]}, {"R2": 40}, 2)
    assert found.route.legs[0].landmark is near


def test_every_pair_is_compared_once_in_a_fixed_order() -> None:
    index = StubIndex({}, {})
    published = {name: Published(name.encode()) for name in ("R3", "R10", "R2")}
    plan("R1", [(HERE, NOTHING)], published, index, find)
    assert index.asked == [
        ("R1", "R10"), ("R1", "R2"), ("R1", "R3"), ("R10", "R2"), ("R10", "R3"), ("R2", "R3"),
    ]  # fmt: skip


def exhaustive(edges: dict, goal_matches: dict[str, int], names: list[str]) -> float:
    """The best product over all chains, tried one after the other; 0 if there is none."""
    best = 0.0
    for n in range(1, len(names)):
        for chain in permutations(names[1:], n):
            if goal_matches.get(chain[-1], 0) >= 15:
                score = support_score(goal_matches[chain[-1]])
                for a, b in pairwise(("R1", *chain)):
                    score *= edges.get((a, b), edges.get((b, a), 0.0))
                best = max(best, score)
    return best


@given(st.integers(0, 100_000), st.integers(2, 6), st.floats(0.2, 0.9))
def test_no_chain_is_better_than_the_one_planned(seed: int, robots: int, density: float) -> None:
    draws = generator(seed, "graph")
    names = [f"R{i + 1}" for i in range(robots)]
    edges = {
        (a, b): float(draws.uniform(0.3, 1.0))
        for i, a in enumerate(names)
        for b in names[i + 1 :]
        if draws.uniform() < density
    }
    goal_matches = {n: int(draws.integers(15, 80)) for n in names[1:] if draws.uniform() < 0.5}
    route, best = planned(edges, goal_matches, robots).route, exhaustive(edges, goal_matches, names)
    if not best:
        assert route is None
        return
    assert route.score == pytest.approx(best, rel=1e-7) and route.score <= 1
    product = support_score(goal_matches[route.seen_by])
    for leg in route.legs:
        product *= leg.landmark.score
    assert route.score == pytest.approx(product, rel=1e-7)
    assert route.robots[0] == "R1" and len(set(route.robots)) == len(route.robots)
    assert [leg.next_by for leg in route.legs] == list(route.robots[1:])


def test_a_route_may_begin_where_the_robot_was_before() -> None:
    """What it sees now has nothing in common; two looks earlier it saw a landmark that R2 sees."""
    earlier, earliest = Shown(0), Shown(1)

    class Remembering(StubIndex):
        def compare_with(self, current: Shown, b: bytes) -> Comparison:
            return Comparison((landmark(0.9),) if current is earliest else (), None)

    index = Remembering({}, {"R2": 40})
    assert plan_of(["R2"], index).route is None
    found = plan_of(["R2"], index, [NOTHING, earlier, earliest])
    assert found.route.robots == ("R1~2", "R2") and len(found.route.legs) == 1
    assert 0.9 * 0.9 * support_score(40) < found.route.score < 0.9 * support_score(40)
    assert found.looks["R1~2"] is earliest
    assert plan_of([], index, [NOTHING, earlier]).why_none.startswith("the ledger")


def beside(places: dict[int, int]):
    """How much looks are alike, by where along a street they are, by their ids."""
    return lambda a, b: -abs(places[id(a)] - places[id(b)])


def test_of_many_panoramas_those_that_look_alike_are_compared() -> None:
    """Twenty of two robots along a street: neighbours, and the other robot's beside them."""
    names = [f"R{2 + k % 2}~{k // 2}" for k in range(20)]
    index = StubIndex({}, dict.fromkeys(names, 0))
    places = {id(look): k // 2 for k, look in enumerate(index.shown.values())} | {id(NOTHING): 0}
    plan_of(names, index, alike=beside(places))
    place = {name: k // 2 for k, name in enumerate(names)}
    apart = [abs(place[a] - place[b]) for a, b in index.asked if a != "R1"]
    assert max(apart) <= 5 and len(index.asked) < 21 * 20 / 2 / 2
    for k in range(9):  # each with the next of its robot, and with the other's at its side
        assert (names[2 * k], names[2 * k + 2]) in index.asked
        assert (names[2 * k], names[2 * k + 1]) in index.asked


def test_parts_that_do_not_hang_together_are_compared_further() -> None:
    """Two robots; the only pair that links their panoramas is not among those that look alike."""
    names = [f"{robot}~{k}" if k else robot for robot in ("R2", "R3") for k in range(11, -1, -1)]
    links = {(a, b): [landmark(0.9)] for a, b in pairwise(names) if robot_of(a) == robot_of(b)}
    links |= {("R1", "R2~11"): [landmark(0.9)]}

    def asked(edges: dict, seen: dict[str, int]) -> tuple[Plan, int]:
        index = StubIndex(edges, {**dict.fromkeys(names, 0), **seen})
        shown = enumerate(index.shown.values())
        places = {id(look): k % 12 for k, look in shown} | {id(NOTHING): 0}
        return plan_of(names, index, alike=beside(places)), index.n_compared

    bridge = {("R2~9", "R3~6"): [landmark(0.8)]}
    found, n_compared = asked(links | bridge, {"R3": 40})
    assert found.route.robots == (
        "R1", "R2~11", "R2~10", "R2~9", *(f"R3~{k}" for k in range(6, 0, -1)), "R3",
    )  # fmt: skip
    cut_off, n_tried = asked(links, {"R3": 40})
    assert cut_off.route is None and n_tried > n_compared
    assert asked(links, {"R2": 40})[1] == asked(links, {})[1] < n_compared


def test_the_goal_is_one_thing() -> None:
    """A sight much less sure than another is of something else."""

    def percent(look: Shown) -> GoalSight:
        return GoalSight(0.1, 12.0, 10.0, 0.2, look.matches, 2.0, look.matches / 100)

    def seen_by(**matches: int) -> list[str]:
        return sorted(plan_of([*matches], StubIndex({}, matches), find=percent).goal_seen_by)

    assert seen_by(R2=30, R3=16, R4=4) == ["R2", "R3"]
    assert seen_by(R2=98, R3=48, R4=52) == ["R2", "R4"]


def test_a_relative_pose_that_others_deny_is_not_driven_by() -> None:
    """R2 looks like the place where R1 stands, and is not; R3 is known from two of its looks."""
    stood = [Pose(0, 0), Pose(-6, 0), Pose(-12, 0)]
    own = [NOTHING, Shown(1), Shown(2)]
    there = Pose(4.0, 3.0, 1.0)

    class Looking(StubIndex):
        def compare_with(self, current: Shown, b: bytes) -> Comparison:
            k = next(i for i, look in enumerate(own) if look is current)
            self.asked.append((f"R1~{k}", b.decode()))
            if b == b"R2" and k:
                return Comparison((), None)
            to = relative(stood[k], there)
            heights = float(np.hypot(*to.xy_m)) / RIG.camera_height_m
            course = float(np.arctan2(to.y_m, to.x_m))
            geometry = PlanarGeometry(course, to.yaw_rad, np.ones(3, dtype=bool), 0.0, heights)
            return Comparison((landmark(0.9, int(b[1:]) / 3),), geometry)

    for trust, end in ((0.5, "R3"), (1.0, "R2")):  # R2 has the surer sight of the goal
        index = Looking({}, {"R2": 60, "R3": 20})
        found = plan_of(["R2", "R3"], index, own, stood, trust=lambda a, b, found, t=trust: t)
        assert found.route.robots[-1] == end

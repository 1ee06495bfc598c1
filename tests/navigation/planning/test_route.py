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


class StubGoal:
    """Known by 15 keypoints or more."""

    def find(self, look: Shown) -> GoalSight | None:
        if look.matches < 15:
            return None
        chance = support_score(look.matches)
        return GoalSight(0.1, 12.0, 10.0, 0.2, look.matches, 2.0, chance)


GOAL, NOTHING, RIG = StubGoal(), Shown(0), CameraRig()


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

    goal_matches: how many keypoints of the goal each panorama shows.
    """

    def __init__(
        self,
        edges: dict[tuple[str, str], list[CommonLandmark]],
        goal_matches: dict[str, int],
    ) -> None:
        self.edges, self.goal_matches = edges, goal_matches
        self.asked: list[tuple[str, str]] = []

    @property
    def n_compared(self) -> int:
        return len(set(self.asked))

    def look(self, digest: bytes) -> Shown:
        return Shown(self.goal_matches.get(digest.decode(), 0))

    def compare(self, a: bytes, b: bytes) -> Comparison:
        return self._common(a.decode(), b.decode())

    def compare_with(self, current: Shown, b: bytes) -> Comparison:
        assert current is NOTHING
        return self._common("R1", b.decode())

    def _common(self, a: str, b: str) -> Comparison:
        self.asked.append((a, b))
        return Comparison(tuple(self.edges.get((a, b), [])), None)


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
    published = {f"R{i}": Published(f"R{i}".encode()) for i in range(robots, 1, -1)}
    return plan("R1", NOTHING, published, StubIndex(lists, goal_matches), GOAL, **options)


def test_the_papers_chain() -> None:
    found = planned({("R1", "R2"): 0.9, ("R2", "R3"): 0.8}, {"R3": 40}, 3)
    assert list(found.goal_seen_by) == ["R3"]
    assert found.route.robots == ("R1", "R2", "R3") and found.route.seen_by == "R3"
    assert [(leg.seen_by, leg.next_by) for leg in found.route.legs] == [("R1", "R2"), ("R2", "R3")]
    assert found.route.score == pytest.approx(0.9 * 0.8 * support_score(40))
    assert found.route.sighting.n_matches == 40
    assert found.route.legs[0].landmark.score == 0.9


def test_the_best_product_wins() -> None:
    weak = {("R1", "R4"): 0.5, ("R1", "R2"): 0.9, ("R2", "R3"): 0.9, ("R3", "R4"): 0.9}
    assert planned(weak, {"R4": 40}).route.robots == ("R1", "R2", "R3", "R4")
    direct = {**weak, ("R1", "R4"): 0.75}  # more than 0.9 ** 3
    assert planned(direct, {"R4": 40}).route.robots == ("R1", "R4")


def test_how_well_the_goal_is_seen_counts_too() -> None:
    edges = {("R1", "R2"): 0.75, ("R1", "R3"): 0.9}
    assert planned(edges, {"R2": 60, "R3": 15}, 3).route.robots == ("R1", "R3")
    assert planned({**edges, ("R1", "R2"): 0.88}, {"R2": 60, "R3": 15}, 3).route.seen_by == "R2"


def test_of_equal_ends_the_one_with_fewer_legs_is_taken() -> None:
    edges = {("R1", "R2"): 0.8, ("R2", "R3"): 1.0, ("R1", "R4"): 0.8}
    assert planned(edges, {"R3": 40, "R4": 40}).route.robots == ("R1", "R4")


def test_of_equal_chains_to_one_end_the_one_with_fewer_legs_is_taken() -> None:
    """Scores reach 1 where support is large."""
    edges = {
        ("R1", "R2"): 1.0,
        ("R2", "R3"): 1.0,
        ("R3", "R5"): 0.5,
        ("R1", "R4"): 0.5,
        ("R4", "R5"): 1.0,
    }
    assert len(planned(edges, {"R5": 40}, 5).route.legs) == 2


def test_one_robot_in_between_is_no_more_than_needed() -> None:
    found = planned({("R1", "R2"): 0.9}, {"R2": 40}, 2)
    assert found.route.robots == ("R1", "R2") and len(found.route.legs) == 1


def test_nobody_sees_the_goal() -> None:
    for n in (0, 1, 10):
        found = planned({("R1", "R2"): 0.9}, {"R2": n}, 3)
        assert found.route is None and found.goal_seen_by == {}
        assert found.why_none == "no other robot's panorama shows the goal"
        assert [list(node.sights) for node in found.graph.landmarks] == [["R1", "R2"]]


def test_no_chain_leads_to_who_sees_it() -> None:
    found = planned({("R1", "R2"): 0.9}, {"R3": 40}, 3)
    assert found.route is None and list(found.goal_seen_by) == ["R3"]
    assert found.why_none == "R3 sees the goal, but no chain of common landmarks leads there"
    found = planned({}, {"R2": 40, "R3": 40}, 3)
    assert found.why_none.startswith("R2, R3 see the goal, but no chain")
    assert planned({("R1", "R2"): 0.9}, {"R2": 40}, 2).why_none == ""


def test_there_is_nobody_else() -> None:
    found = planned({}, {}, 1)
    assert found.route is None and found.goal_seen_by == {}
    assert found.graph.robots == ("R1",)
    assert found.why_none == "the ledger holds no panorama of another robot"


def test_panoramas_that_cannot_be_read_are_named() -> None:
    class Torn(StubIndex):
        def look(self, digest: bytes) -> Shown:
            if digest == b"R2":
                raise ImageError("no panorama")
            return super().look(digest)

    torn = Torn({("R1", "R3"): [landmark(0.9)]}, {"R3": 40})
    found = plan("R1", NOTHING, {"R2": Published(b"R2"), "R3": Published(b"R3")}, torn, GOAL)
    assert found.unreadable == ("R2",) and found.route.robots == ("R1", "R3")
    found = plan("R1", NOTHING, {"R2": Published(b"R2")}, torn, GOAL)
    assert found.why_none == "no panorama can be read, of R2"


def test_the_next_best_routes_share_no_landmark() -> None:
    edges = {("R1", "R2"): 0.9, ("R2", "R4"): 0.9, ("R1", "R3"): 0.8, ("R3", "R4"): 0.8}
    found = planned(edges, {"R4": 40})
    assert found.route.robots == ("R1", "R2", "R4")
    assert [spare.robots for spare in found.spares] == [("R1", "R3", "R4")]
    crossing = {("R1", "R2"): 0.9, ("R2", "R3"): 0.9, ("R2", "R4"): 0.8}
    found = planned(crossing, {"R3": 40, "R4": 40})
    assert found.route.robots == ("R1", "R2", "R3") and found.spares == ()
    assert planned(edges, {"R4": 40}, spares=0).spares == ()


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


def test_failed_landmarks_are_not_used_again() -> None:
    near, far = landmark(0.9, 0.5), landmark(0.7, -2.0)
    edges = {("R1", "R2"): [near, far]}
    first = planned(edges, {"R2": 40}, 2).route.legs[0]
    assert first.landmark is near
    second = planned(edges, {"R2": 40}, 2, failed={first.key}).route.legs[0]
    assert second.landmark is far and second.key != first.key
    assert planned(edges, {"R2": 40}, 2, failed={first.key, second.key}).route is None


def test_a_failed_landmark_is_known_again_from_another_place() -> None:
    """The driving robot has moved; seen from the other one the landmark is where it was."""
    first = planned({("R1", "R2"): [landmark(0.9, 0.5, bearing_a=0.1)]}, {"R2": 40}, 2)
    key = first.route.legs[0].key
    moved = {("R1", "R2"): [landmark(0.95, 0.51, bearing_a=-2.0)]}
    assert planned(moved, {"R2": 40}, 2, failed={key}).route is None


def test_a_failed_landmark_is_failed_whichever_way_it_is_walked() -> None:
    edges = {("R1", "R3"): 0.9, ("R2", "R3"): 0.9}
    route = planned(edges, {"R2": 40}, 3).route
    assert route.robots == ("R1", "R3", "R2")
    assert planned(edges, {"R2": 40}, 3, failed={route.legs[1].key}).route is None


def test_a_doubted_robot_is_no_end_but_may_be_on_the_way() -> None:
    edges = {("R1", "R2"): 0.9, ("R2", "R3"): 0.9}
    found = planned(edges, {"R2": 60, "R3": 20}, 3)
    assert found.route.seen_by == "R2"
    found = planned(edges, {"R2": 60, "R3": 20}, 3, doubted={b"R2"})
    assert found.route.robots == ("R1", "R2", "R3") and list(found.goal_seen_by) == ["R3"]
    assert planned(edges, {"R2": 60, "R3": 20}, 3, doubted={b"R2", b"R3"}).route is None


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


def test_turning_round_a_landmark_without_ranges() -> None:
    edges = {("R1", "R3"): 0.9, ("R2", "R3"): [landmark(0.8)]}
    assert planned(edges, {"R2": 40}, 3).route.legs[1].landmark.ranges is None


def test_near_landmarks_are_worth_more_than_far_ones() -> None:
    near, far = landmark(0.8, 0.5, (0.7, 0.7)), landmark(0.99, -2.0, (9.0, 9.0))
    assert worth(near, 7.0) > worth(far, 7.0) > 0
    assert worth(near, 7.0) > worth(near, 14.0)  # the same angles, but twice the way
    assert worth(landmark(0.8), 7.0) == 0.8
    found = planned({("R1", "R2"): [far, near]}, {"R2": 40}, 2)
    assert found.route.legs[0].landmark is near


def test_a_sure_score_and_a_hopeless_one_do_no_harm() -> None:
    assert planned({("R1", "R2"): 1.0}, {"R2": 40}, 2).route.score <= 1
    tiny = planned({("R1", "R2"): 1e-300}, {"R2": 40}, 2)
    assert tiny.route is None and "no chain of common landmarks" in tiny.why_none


def test_every_pair_is_compared_once_in_a_fixed_order() -> None:
    index = StubIndex({}, {})
    published = {name: Published(name.encode()) for name in ("R3", "R10", "R2")}
    plan("R1", NOTHING, published, index, GOAL)
    assert index.asked == [
        ("R1", "R10"), ("R1", "R2"), ("R1", "R3"), ("R10", "R2"), ("R10", "R3"), ("R2", "R3"),
    ]  # fmt: skip


def exhaustive(edges: dict, goal_matches: dict[str, int], names: list[str]) -> float | None:
    """The best product over all chains, tried one after the other."""
    best = None
    others = names[1:]
    for n in range(1, len(names)):
        for chain in permutations(others, n):
            if goal_matches.get(chain[-1], 0) < 15:
                continue
            score = support_score(goal_matches[chain[-1]])
            for a, b in pairwise(("R1", *chain)):
                score *= edges.get((a, b), edges.get((b, a), 0.0))
            if score > 0 and (best is None or score > best):
                best = score
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
    found = planned(edges, goal_matches, robots)
    best = exhaustive(edges, goal_matches, names)
    if best is None:
        assert found.route is None
        return
    route = found.route
    assert route.score == pytest.approx(best, rel=1e-7)
    product = support_score(goal_matches[route.seen_by])
    for leg in route.legs:
        product *= leg.landmark.score
    assert route.score == pytest.approx(product, rel=1e-7)
    assert route.robots[0] == "R1" and len(set(route.robots)) == len(route.robots)
    assert [leg.next_by for leg in route.legs] == list(route.robots[1:])


def test_a_route_may_begin_where_the_robot_was_before() -> None:
    """What it sees now joins nothing; two looks earlier it saw a landmark that R2 sees."""
    earlier, earliest = Shown(0), Shown(1)

    class Remembering(StubIndex):
        def compare_with(self, current: Shown, b: bytes) -> Comparison:
            return Comparison((landmark(0.9),) if current is earliest else (), None)

    index = Remembering({}, {"R2": 40})
    published = {"R2": Published(b"R2")}
    assert plan("R1", NOTHING, published, index, GOAL).route is None
    found = plan("R1", NOTHING, published, index, GOAL, before=[earlier, earliest])
    assert found.route.robots == ("R1~2", "R2") and len(found.route.legs) == 1
    assert 0.9 * 0.9 * support_score(40) < found.route.score < 0.9 * support_score(40)
    assert found.looks["R1~2"] is earliest and found.why_none == ""
    assert plan("R1", NOTHING, {}, index, GOAL, before=[earlier]).why_none.startswith("the ledger")


def test_of_many_panoramas_those_that_look_alike_are_compared() -> None:
    """Twenty of two robots along a street: neighbours, and the other robot's beside them."""
    published = {f"R{2 + k % 2}~{k // 2}": Published(f"{k:02d}".encode(), k) for k in range(20)}
    places = {p.digest.decode(): k // 2 for k, p in enumerate(published.values())}

    class Street(StubIndex):
        def look(self, digest: bytes) -> Shown:
            return looks[digest]

    looks = {p.digest: Shown(0) for p in published.values()}
    at = {id(looks[d.encode()]): k for d, k in places.items()} | {id(NOTHING): 0}
    index = Street({}, {})

    def alike(a: Shown, b: Shown) -> float:
        return -abs(at[id(a)] - at[id(b)])

    plan("R1", NOTHING, published, index, GOAL, alike=alike)
    apart = [abs(places[a] - places[b]) for a, b in index.asked if a != "R1"]
    assert max(apart) <= 5 and len(index.asked) < 21 * 20 / 2 / 2
    for k in range(9):  # each with the next of its robot, and with the other's at its side
        assert (f"{2 * k:02d}", f"{2 * k + 2:02d}") in index.asked
        assert (f"{2 * k:02d}", f"{2 * k + 1:02d}") in index.asked


def test_parts_that_do_not_hang_together_are_compared_further() -> None:
    """Two robots; the only pair that joins their trails is not among those that look alike."""
    trails = [f"{robot}~{k}" if k else robot for robot in ("R2", "R3") for k in range(11, -1, -1)]
    published = {name: Published(name.encode(), time) for time, name in enumerate(trails)}
    ways = {(a, b): [landmark(0.9)] for a, b in pairwise(trails) if robot_of(a) == robot_of(b)}
    bridge = {("R2~9", "R3~6"): [landmark(0.8)]}
    first = {("R1", "R2~11"): [landmark(0.9)]}

    def plan_of(edges: dict, seen: dict[str, int]) -> tuple[Plan, StubIndex]:
        index = StubIndex(edges, seen)
        looks = {name: index.look(name.encode()) for name in trails}
        index.look = lambda digest: looks[digest.decode()]  # type: ignore[method-assign]
        place = {id(look): k % 12 for k, look in enumerate(looks.values())} | {id(NOTHING): 0}

        def alike(a: Shown, b: Shown) -> float:
            return -abs(place[id(a)] - place[id(b)])

        return plan("R1", NOTHING, published, index, GOAL, alike=alike), index

    found, index = plan_of(ways | bridge | first, {"R3": 40})
    assert found.route.robots == (
        "R1",
        "R2~11",
        "R2~10",
        "R2~9",
        *(f"R3~{k}" for k in range(6, 0, -1)),
        "R3",
    )
    cut_off, tried = plan_of(ways | first, {"R3": 40})
    assert cut_off.route is None and tried.n_compared > index.n_compared
    _, enough = plan_of(ways | first, {"R2": 40})
    _, nobody = plan_of(ways | first, {})
    assert nobody.n_compared == enough.n_compared < index.n_compared


def test_the_goal_is_one_thing() -> None:
    """A sight much less sure than another is of something else."""

    class Percent:
        def find(self, look: Shown) -> GoalSight:
            return GoalSight(0.1, 12.0, 10.0, 0.2, look.matches, 2.0, look.matches / 100)

    def seen_by(**percent: int) -> list[str]:
        published = {name: Published(name.encode()) for name in percent}
        return sorted(
            plan("R1", NOTHING, published, StubIndex({}, percent), Percent()).goal_seen_by
        )

    assert seen_by(R2=30, R3=16, R4=4) == ["R2", "R3"]
    assert seen_by(R2=98, R3=48, R4=52) == ["R2", "R4"]


def test_a_join_that_others_deny_is_not_driven_by() -> None:
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
            way_m = float(np.hypot(*to.xy_m))
            course = float(np.arctan2(to.y_m, to.x_m))
            heights = way_m / RIG.camera_height_m
            geometry = PlanarGeometry(course, to.yaw_rad, np.ones(3, dtype=bool), 0.0, heights)
            return Comparison((landmark(0.9, int(b[1:]) / 3),), geometry)

    published = {"R2": Published(b"R2"), "R3": Published(b"R3")}

    def planned(trust: float) -> Plan:
        index = Looking({}, {"R2": 60, "R3": 20})
        return plan(
            "R1", NOTHING, published, index, GOAL, trust=lambda a, b, found: trust,
            before=own[1:], stood=stood,
        )  # fmt: skip

    assert planned(0.5).route.robots[-1] == "R3"
    assert planned(1.0).route.robots[-1] == "R2"  # the surer sight of the goal


def test_panoramas_of_another_rig_are_none_of_the_teams() -> None:
    other = Shown(40, CameraRig(width_px=320))

    class Mixed(StubIndex):
        def look(self, digest: bytes) -> Shown:
            return other if digest == b"R2" else super().look(digest)

    published = {"R2": Published(b"R2"), "R3": Published(b"R3")}
    index = Mixed({("R1", "R2"): [landmark(0.9)], ("R1", "R3"): [landmark(0.5)]}, {"R3": 40})
    found = plan("R1", NOTHING, published, index, GOAL)
    assert found.unreadable == ("R2",) and found.route.robots == ("R1", "R3")

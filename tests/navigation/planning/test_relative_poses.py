from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plains import RIG

from vrchain.geometry import Pose, placed, relative, wrap_angle_rad
from vrchain.landmarks.matching.common import Comparison
from vrchain.landmarks.matching.epipolar import PlanarGeometry
from vrchain.navigation.planning.relative_poses import (
    Pair,
    RelativePose,
    RelativePoses,
    baseline_m,
    pose_from,
)
from vrchain.seeding import generator

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
    told = pose_from(found, RIG)
    assert told is not None
    there = placed(here, told)
    assert there.xy_m == pytest.approx(THERE.xy_m)
    assert there.yaw_rad == pytest.approx(THERE.yaw_rad)
    assert found.geometry is not None
    unsized = Comparison((), replace(found.geometry, baseline_heights=np.nan))
    for nothing in (Comparison((), None), unsized):
        assert pose_from(nothing, RIG) is None


def told(poses: dict[str, Pose], trust: float = 0.95, **others: float) -> dict[Pair, RelativePose]:
    """True relative poses of panoramas taken at ``poses``; others: the trust in some, as a_b."""
    return {
        (a, b): RelativePose(relative(poses[a], poses[b]), others.get(f"{a}_{b}", trust))
        for a, b in combinations(poses, 2)
    }


WHOLE = {"a": Pose(0, 0, 1.0), "b": Pose(9, 2, -2.0), "c": Pose(4, 6, 3.0), "d": Pose(12, 7, 0.5)}
ELSEWHERE = RelativePose(Pose(1.0, 0.5, 0.3), 0.4)  # says that b is next to a


def test_what_others_agree_on_is_surer() -> None:
    poses = RelativePoses(told(WHOLE, a_b=0.4))
    assert poses.trust(("a", "b")) > 0.8 and poses.unasked(("a", "b")) == []
    assert poses.trust(("a", "c")) > 0.95


def test_what_others_deny_is_less_sure() -> None:
    """c and d know where a stands; b, said to stand there too, they do not know."""
    poses = told(WHOLE)
    poses[("a", "b")] = ELSEWHERE
    for pair in (("b", "c"), ("b", "d")):
        poses[pair] = RelativePose(None, 0.0)
    assert RelativePoses(poses).trust(("a", "b")) < 0.2
    poses[("b", "c")] = RelativePose(Pose(50.0, 0.0, 0.0), 0.9)  # known to stand elsewhere: worse
    assert RelativePoses(poses).trust(("a", "b")) < 0.02


@pytest.mark.parametrize(("author", "least", "most"), [("R5", 0.95, 1.0), ("R3", 0.0, 0.5)])
def test_many_panoramas_of_a_third_robot_speak_against_a_pose_but_once(
    author: str, least: float, most: float
) -> None:
    """Of one of the two that took the panoramas each counts: it speaks of what it saw itself."""
    names = ("R2", "R3", *(f"{author}~{k}" for k in range(1, 7)))
    spread = [Pose(0.0, 0.0), Pose(9.0, 2.0), *(Pose(5.0, 3.0 + k) for k in range(6))]
    at = dict(zip(names, spread, strict=True))
    poses = told(at, 0.995)
    for name in names[2:]:
        poses[("R3", name)] = RelativePose(None, 0.0)
    assert least < RelativePoses(poses).trust(("R2", "R3")) < most


def test_who_looks_twice_from_one_place_is_no_witness_of_its_own() -> None:
    """e was taken where a was, so it tells the same of b, where c and d know better."""
    false = RelativePose(Pose(6.0, -8.0, 0.3), 0.85)
    poses = told(WHOLE)
    poses[("a", "b")] = false
    for pair in (("a", "c"), ("a", "d")):
        poses[pair] = RelativePose(None, 0.0)
    alone = RelativePoses(poses).trust(("a", "b"))
    twice = {
        ("a", "e"): RelativePose(Pose(0.0, 0.0), 1.0),
        ("b", "e"): RelativePose(relative(false.pose, Pose(0, 0)), 0.85),
    }
    assert alone < 0.7
    assert RelativePoses({**poses, **twice}).trust(("a", "b")) == alone


def test_what_nobody_tells_of_stays_as_it_is_and_may_be_asked() -> None:
    poses = {pair: known for pair, known in told(WHOLE, a_b=0.4).items() if "b" not in pair}
    poses[("a", "b")] = told(WHOLE)[("a", "b")]
    unsure = {**poses, ("a", "b"): RelativePose(poses["a", "b"].pose, 0.4)}
    assert RelativePoses(unsure).trust(("a", "b")) == pytest.approx(0.4)
    assert RelativePoses(unsure).unasked(("a", "b")) == [("d", "b"), ("c", "b")]  # the nearer first
    nowhere = {**poses, ("a", "b"): RelativePose(None, 0.4)}
    assert RelativePoses(nowhere).trust(("a", "b")) == pytest.approx(0.4)
    assert RelativePoses(nowhere).unasked(("a", "b")) == []


def test_never_is_never_and_surely_is_surely() -> None:
    for certain in (0.0, 1.0):
        assert RelativePoses(told(WHOLE, a_b=certain)).trust(("a", "b")) == certain


@given(st.integers(0, 10_000))
def test_it_matters_neither_in_which_order_nor_from_where(seed: int) -> None:
    draws = generator(seed, "joins")
    poses = {n: Pose(*map(float, (*draws.uniform(-8, 8, 2), draws.uniform(-3, 3)))) for n in "abcd"}
    trusts = {f"{a}_{b}": float(draws.choice([0.0, 0.3, 0.9])) for a, b in combinations("abcd", 2)}
    poses = told(poses, **trusts)
    turned = {(b, a): RelativePose(j.pose and relative(j.pose, Pose(0, 0)), j.trust)
              for (a, b), j in reversed(poses.items())}  # fmt: skip
    for a, b in poses:
        assert RelativePoses(poses).trust((a, b)) == pytest.approx(
            RelativePoses(turned).trust((b, a))
        )


def test_where_panoramas_are_is_told_from_one_to_the_next_as_far_as_that_is_sure() -> None:
    poses = told(WHOLE)
    chain = {pair: poses[pair] for pair in (("a", "b"), ("b", "c"))}
    chain[("c", "d")] = RelativePose(relative(WHOLE["c"], WHOLE["d"]), 0.3)
    found = RelativePoses(chain).reached({"a": WHOLE["a"], "z": Pose(7.0, 7.0)})
    assert set(found) == {"a", "z", "b", "c"}
    for name in "abc":
        assert found[name].xy_m == pytest.approx(WHOLE[name].xy_m)

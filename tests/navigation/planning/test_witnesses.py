from dataclasses import dataclass, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from vrchain.geometry import Pose, relative
from vrchain.navigation.goal.recognition import GoalSight
from vrchain.navigation.planning.relative_poses import RelativePose, RelativePoses
from vrchain.navigation.planning.witnesses import borne_out

SIGHT = GoalSight(0.0, 20.0, 20.0, 0.2, 10, 2.0, 0.5)  # of what is 20 m ahead of A, at (20, 0)


@dataclass(frozen=True)
class Shown:
    """Stands in for a look: who took it, and how surely and how far it shows the goal there."""

    chance: float
    range_m: float = 5.0


def find(look: Shown, bearing_rad: float, window_rad: float) -> GoalSight | None:
    seen = replace(SIGHT, bearing_rad=bearing_rad, surface_m=look.range_m, chance=look.chance)
    return seen if look.chance else None


def chance_with(
    witnesses: dict[Pose, Shown], sight: GoalSight = SIGHT, trust: float = 1.0, by: str = "W{}"
) -> float:
    """That the sight of A, at the origin, is of the goal. trust: in all poses; by: their names."""
    at = {by.format(k): pose for k, pose in enumerate(witnesses)}
    known = {("A", w): RelativePose(relative(Pose(0.0, 0.0), p), trust) for w, p in at.items()}
    looks = {"A": Shown(0.0), **dict(zip(at, witnesses.values(), strict=True))}
    return borne_out({"A": sight}, looks, RelativePoses(known), find)["A"].chance


BESIDE = [Pose(20.0, 5.0), Pose(25.0, 0.0, 2.0), Pose(20.0, -5.0, -1.0)]
NOTHING, GOAL = Shown(0.0), Shown(0.9)


def test_who_was_nearer_and_sees_nothing_speaks_against_it() -> None:
    chances = [chance_with(dict.fromkeys(BESIDE[:n], NOTHING)) for n in range(4)]
    assert chances[0] == 0.5 and chances[3] < 0.1
    assert chances == sorted(chances, reverse=True) and len(set(chances)) == 4
    assert chance_with(dict.fromkeys(BESIDE, Shown(0.02))) == chances[3]


def test_who_sees_it_there_speaks_for_it() -> None:
    chances = [chance_with(dict.fromkeys(BESIDE[:n], GOAL)) for n in range(4)]
    assert chances[0] == 0.5 and chances[3] > 0.95
    assert chances == sorted(chances) and len(set(chances)) == 4


def test_who_sees_it_elsewhere_or_is_unsure_says_nothing() -> None:
    for said in (Shown(0.9, range_m=30.0), Shown(0.3)):
        assert chance_with(dict.fromkeys(BESIDE, said)) == 0.5


def test_one_sight_is_worth_little_against_many() -> None:
    surest = replace(SIGHT, chance=0.9999)
    assert chance_with({}, surest) == 0.9999
    assert chance_with(dict.fromkeys(BESIDE, NOTHING), surest) < 0.5


def test_another_robot_speaks_against_it_twice_at_most() -> None:
    """R5 says that it drove round the goal, and publishes walls; A's own word counts in full."""
    surest, ring = replace(SIGHT, chance=0.9), [Pose(20.0, 3.0 + k) for k in range(6)]
    walls = dict.fromkeys(ring, NOTHING)
    assert chance_with(walls, surest, by="R5~{}") == chance_with(
        dict.fromkeys(ring[:2], NOTHING), surest
    )
    assert (
        chance_with(walls, surest, by="R5~{}") > 0.5 > 0.1 > chance_with(walls, surest, by="A~{}")
    )
    honest = {Pose(20.0, 12.0): Shown(0.9, range_m=12.0)}
    assert chance_with(walls | honest, surest, by="R5~{}") > 0.8  # it is heard all the same


@pytest.mark.parametrize("chance", [0.0, 1.0])
def test_what_is_certain_stays_so(chance: float) -> None:
    for said in (NOTHING, GOAL):
        certain = replace(SIGHT, chance=chance)
        assert chance_with(dict.fromkeys(BESIDE, said), certain) == chance


def test_who_was_far_or_on_the_spot_or_is_nowhere_sure_is_not_heard() -> None:
    for pose in (Pose(20.0, 40.0), Pose(20.0, 0.5)):
        assert chance_with({pose: NOTHING}) == 0.5
    assert chance_with(dict.fromkeys(BESIDE, NOTHING), trust=0.5) == 0.5


@given(st.permutations(range(8)))
def test_the_nearest_are_heard_in_whatever_order_they_come(order: list[int]) -> None:
    """Six of eight, in rings of 2 m: the two outer ones would deny it."""
    said = [(Pose(20.0, 2.0 + 2.0 * k), GOAL if k < 6 else NOTHING) for k in range(8)]
    least = replace(SIGHT, chance=0.1)
    assert chance_with(dict(said[k] for k in order), least) == chance_with(dict(said[:6]), least)

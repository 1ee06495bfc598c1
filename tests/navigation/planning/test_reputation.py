"""Whose word of its own way is believed: teams in which some lie, and joins some of which err."""

from itertools import combinations

import pytest

from vrchain.geometry import Pose, placed, relative
from vrchain.navigation.planning import reputation
from vrchain.navigation.planning.odometry_links import Track, unbroken
from vrchain.navigation.planning.relative_poses import Pair, RelativePose
from vrchain.seeding import generator

N_EACH = 8  # panoramas of a robot


def reputations(poses: dict[Pair, RelativePose], tracks: list[Track]) -> dict[str, float]:
    return reputation.reputations(poses, tracks)[0]


def team(
    liars: int = 0,
    robots: int = 5,
    wrong: float = 0.0,
    seed: int = 0,
    joined: float = 0.4,
    step_m: float = 8.0,
) -> tuple[dict[Pair, RelativePose], list[Track]]:
    """Joins and tracks of robots that wandered; the first so many say other ways than they went."""
    draws = generator(seed, "team")
    true: dict[str, Pose] = {}
    tracks: list[Track] = []
    for k in range(robots):
        here, said = Pose(*draws.uniform(-10, 10, 2), 0.0), Pose(0.0, 0.0)
        track = []
        for n in range(N_EACH):
            name = f"R{k + 1}~{N_EACH - 1 - n}" if n < N_EACH - 1 else f"R{k + 1}"
            true[name] = here
            track.append((name, said))
            moved = Pose(*draws.uniform(-step_m, step_m, 2), float(draws.uniform(-1, 1)))
            here = placed(here, moved)
            turned = Pose(moved.x_m, moved.y_m, float(draws.uniform(-3, 3)))
            told = Pose(-moved.y_m, moved.x_m, turned.yaw_rad) if k < liars else moved
            said = placed(said, told)
        tracks.append(tuple(track))
    poses = {}
    for a, b in combinations(true, 2):
        if a.partition("~")[0] != b.partition("~")[0] and draws.uniform() < joined:
            pose = relative(true[a], true[b])
            if draws.uniform() < wrong:
                pose = Pose(*draws.uniform(-20, 20, 2), float(draws.uniform(-3, 3)))
            poses[a, b] = RelativePose(pose, 0.9)
    return poses, tracks


@pytest.mark.parametrize("seed", range(4))
def test_who_lies_is_not_believed_and_the_others_are(seed: int) -> None:
    for liars in (0, 1, 2):
        told = reputations(*team(liars, wrong=0.05, seed=seed))
        assert all(told[f"R{k + 1}"] < 0.5 for k in range(liars))
        assert all(told[f"R{k + 1}"] > 0.8 for k in range(liars, 5))


@pytest.mark.parametrize("step_m", [0.0, 0.3, 60.0])
def test_who_says_that_it_stood_still_or_leapt_is_not_believed(step_m: float) -> None:
    """Such ways are followed as others are, so they are tested as others are."""
    for seed in range(4):
        poses, (own, *others) = team(seed=seed)
        said = tuple((name, Pose(step_m * n, 0.0)) for n, (name, _) in enumerate(own))
        told = reputations(poses, [said, *others])
        assert told.pop("R1") < 0.5 and min(told.values()) > 0.8


def test_one_panorama_convicts_nobody_whatever_it_was_joined_to() -> None:
    """Such as one that is forged from two places."""
    poses, tracks = team(robots=2, joined=1.0)
    (witness, _), forged = tracks[1][0], Pose(30.0, -9.0, 2.0)
    only = {pair: known for pair, known in poses.items() if witness in pair}
    for k, pair in enumerate(only):
        if k % 2:
            only[pair] = RelativePose(forged, 0.99)
    assert reputations(only, tracks)["R1"] == 1.0


def test_many_panoramas_of_one_robot_weigh_no_more_than_one_of_another() -> None:
    """R3 publishes one forged panorama forty times; R2 tells how R1 moved."""
    poses, tracks = team(robots=2, joined=1.0)
    forged, names = Pose(30.0, -9.0, 2.0), [name for name, _ in tracks[0]]
    for k in range(40):
        for n, name in enumerate(names):
            poses[name, f"R3~{k}"] = RelativePose(forged if n % 2 else Pose(1.0, 1.0), 0.99)
    assert reputations(poses, tracks)["R1"] == 1.0


def test_one_mistake_convicts_nobody() -> None:
    """Two joins between two robots, of which one is wrong: who is to say which?"""
    poses, tracks = team(robots=2, joined=1.0)
    (a, b), (c, d) = [*poses][0 :: N_EACH + 2][:2]
    wrong = RelativePose(Pose(30.0, -9.0, 2.0), 0.99)
    told = reputations({(a, b): poses[a, b], (c, d): wrong}, tracks)
    assert min(told.values()) >= 0.8
    many = {pair: poses[pair] for pair in list(poses)[::9]}
    first = next(iter(many))
    assert min(reputations(many | {first: wrong}, tracks).values()) >= 0.8


def test_nobody_is_blamed_for_what_nobody_saw() -> None:
    poses, tracks = team(liars=1)
    assert reputations({}, tracks) == dict.fromkeys(("R1", "R2", "R3", "R4", "R5"), 1.0)
    unsure = {pair: RelativePose(known.pose, 0.5) for pair, known in poses.items()}
    assert set(reputations(unsure, tracks).values()) == {1.0}
    unknown = {pair: RelativePose(None, 0.9) for pair in poses}
    assert set(reputations(unknown, tracks).values()) == {1.0}
    assert reputations({}, []) == {}


def test_the_order_of_robots_and_joins_does_not_matter() -> None:
    poses, tracks = team(liars=1, wrong=0.1, seed=3)
    told = reputations(poses, tracks)
    back = {
        (b, a): RelativePose(relative(known.pose, Pose(0.0, 0.0)), known.trust)
        for (a, b), known in reversed(poses.items())
        if known.pose is not None
    }
    assert reputations(back, tracks[::-1]) == pytest.approx(told)


def test_a_liar_takes_nobody_along() -> None:
    """Also a robot that meets nobody but a liar keeps its name: pictures tell who lies."""
    poses, tracks = team(liars=1, robots=3, seed=1)
    alone = {p: k for p, k in poses.items() if {n.partition("~")[0] for n in p} == {"R1", "R2"}}
    told = reputations(alone, tracks)
    assert told["R1"] < 0.3 and told["R2"] == told["R3"] == 1.0


def test_panoramas_of_anywhere_say_nothing_against_those_who_know_them() -> None:
    """One that publishes other places is convicted where one panorama knows two of them."""
    poses, tracks = team(robots=2, joined=1.0)
    said = tuple((name, Pose(3.0 * n, -pose.y_m, 0.0)) for n, (name, pose) in enumerate(tracks[0]))
    told = reputations(poses, [said, tracks[1]])
    assert told["R1"] < 0.2 and told["R2"] == 1.0


@pytest.mark.parametrize("times", [0.25, 2.0, 3.0])
def test_who_says_that_it_drove_farther_or_less_far_is_not_believed(times: float) -> None:
    """Joins err by a third, so each alone hardly denies it; but none agrees."""
    for seed in range(4):
        poses, (own, *others) = team(seed=seed, step_m=20.0)
        said = tuple((name, Pose(times * at.x_m, times * at.y_m, at.yaw_rad)) for name, at in own)
        told = reputations(poses, [said, *others])
        assert told.pop("R1") < 0.5 and min(told.values()) > 0.8


@pytest.mark.parametrize("leap_m", [45.0, 400.0])
def test_one_leap_is_no_lie_of_a_robot_but_it_is_denied(leap_m: float) -> None:
    for seed in range(4):
        poses, (own, *others) = team(seed=seed)
        said = tuple(
            (name, Pose(at.x_m + leap_m * (n > 3), at.y_m, at.yaw_rad))
            for n, (name, at) in enumerate(own)
        )
        _, denied = reputation.reputations(poses, [said, *others])
        step = said[3][0], said[4][0]
        assert step in denied
        assert all(a.startswith("R1") for a, _ in denied)
        whole = [name for part in unbroken(said, denied) for name, _ in part]
        assert whole == [name for name, _ in own]
        parts = list(unbroken(said, {step}))
        assert [len(part) for part in parts] == [4, 4] and parts[1][0][0] == step[1]

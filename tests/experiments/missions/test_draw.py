import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import astuple
from itertools import combinations, pairwise, permutations, product
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
import shapely
from hamlet import hamlet
from sights import RIG
from worlds import RED, box, plain, world

from vrchain.errors import MissionError
from vrchain.experiments.missions import chains as chain_search
from vrchain.experiments.missions import draw
from vrchain.experiments.missions.chains import APPROACH_M, PLACE, Chains, TrueChain, Views
from vrchain.experiments.missions.draw import Ground, Mission
from vrchain.geometry import Pose
from vrchain.landmarks.quality import Sights, co_visible, shared
from vrchain.world.model import SceneObject
from vrchain.world.truth import GroundTruth


@pytest.fixture(scope="module")
def ground() -> Ground:
    return Ground(hamlet(), GroundTruth(hamlet()), RIG)


@pytest.fixture
def short_ways(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(draw, "WAY_M", (12.0, 60.0))


@pytest.mark.usefixtures("short_ways")
def test_a_mission_is_as_it_should_be_and_the_same_twice(ground: Ground) -> None:
    drawn = ground.draw(5, 0, 1, 4)
    again = Ground(hamlet(), ground.truth, RIG).draw(5, 0, 1, 4)
    assert drawn == again
    assert list(drawn.poses) == ["R1", "R2", "R3", "R4"] and len(drawn.goal_poses) == 4
    assert 12.0 <= drawn.way_m <= 60.0
    scene = hamlet()
    target = scene.index_of(drawn.goal)
    assert target not in ground.truth.visibility(drawn.poses["R1"], RIG).index
    assert scene.is_free([p.xy_m for p in drawn.poses.values()]).all()
    if drawn.chain is not None:
        assert len(drawn.chain.robots) == len(drawn.chain.landmarks) + 1
        assert drawn.chain.robots[0] == "R1" and drawn.chain.way_m >= drawn.way_m - 1.0
        last = ground.truth.visibility(drawn.poses[drawn.chain.robots[-1]], RIG)
        assert bool(last.visible[target])
    assert Mission.from_dict(json.loads(json.dumps(drawn.as_dict()))) == drawn
    assert ground.draw(5, 0, 2, 4) != drawn


@pytest.mark.usefixtures("short_ways")
def test_a_place_is_out_of_sight_of_all_that_the_start_sees(ground: Ground) -> None:
    drawn = ground.draw(5, 0, 1, 4, to_places=True, landmarks=1)
    assert drawn == ground.draw(5, 0, 1, 4, to_places=True, landmarks=1)
    assert drawn.goal == PLACE and len(drawn.goal_poses) == 1
    places = {tuple(stand) for stand in ground.places(5, 0, ground.room()[0])[0]}
    assert {astuple(p) for p in (*drawn.poses.values(), *drawn.goal_poses)} <= places
    start, (place,) = drawn.poses["R1"], drawn.goal_poses
    assert not co_visible(ground.truth, start, place, RIG)
    assert hamlet().is_free([place.xy_m]).all()
    assert start.distance_to_m(place.xy_m) <= drawn.way_m + 1.0 <= 61.0
    assert drawn.chain is not None
    last = drawn.poses[drawn.chain.robots[-1]]
    names = {hamlet().objects[i].name for i in co_visible(ground.truth, last, place, RIG)}
    assert drawn.chain.landmarks[-1] in names
    assert len(drawn.chain.robots) == len(drawn.chain.landmarks) and "R1" in drawn.chain.robots
    assert Mission.from_dict(json.loads(json.dumps(drawn.as_dict()))) == drawn


@pytest.mark.slow
@pytest.mark.usefixtures("short_ways")
@pytest.mark.parametrize(("number", "landmarks"), [(3, 0), (1, 2)])
def test_every_third_mission_needs_two_landmarks_or_each_as_many_as_asked(
    ground: Ground, number: int, landmarks: int
) -> None:
    drawn = ground.draw(5, 0, number, 4, landmarks=landmarks)
    assert drawn.chain is not None and len(drawn.chain.landmarks) == 2
    assert "no chain of 2 or more" in drawn.rejected
    assert drawn.chain.way_m == pytest.approx(_shortest_by_two_m(ground, drawn))


def _shortest_by_two_m(ground: Ground, drawn: Mission) -> float:
    """The shortest way by any two landmarks that make a chain, one after the other."""
    truth, chains, goal = ground.truth, ground.chains, ground.scene.index_of(drawn.goal)
    first, *others = drawn.poses
    seen = {name: Sights(truth, pose, RIG) for name, pose in drawn.poses.items()}
    far_m = ground.free.from_m(drawn.poses[first].xy_m)
    region = int(ground.free.region[far_m.argmin()])
    ways_m = []
    for a, b in permutations(others, 2):
        if goal not in seen[b].visible:
            continue
        firsts, seconds = (
            set(shared(truth, *(seen[n] for n in sorted(pair)))) - {goal}
            for pair in ((first, a), (a, b))
        )
        for i, j in product(firsts, seconds):
            if i != j and j in chains.near(i, region) and goal in chains.near(j, region):
                ways_m.append(_by_m(chains, far_m, (i, j))[chains.zone(goal, region)].min())
    return min(ways_m)


def _by_m(ground: Chains, far_m: np.ndarray, landmarks: Iterable[int]) -> np.ndarray:
    """How far every point is from a start by way of some landmarks, one after the other."""
    for i in landmarks:
        zone = ground.free.around(ground.scene.objects[i].footprint, APPROACH_M)
        far_m = ground.free.through_m(far_m[zone], zone)
    return far_m


class Made:
    """A ground where what is seen is written down, by the names of robots and landmarks.

    common: the landmarks of two robots, "R1 R2"; near: what is visible from near each landmark, if
    any of the points it is looked from is one that ``where`` allows; the last robot sees the goal.
    """

    def __init__(
        self,
        monkeypatch: pytest.MonkeyPatch,
        things: list[SceneObject],
        common: Mapping[str, Sequence[str]],
        near: Mapping[str, Sequence[str]],
        where: Callable[[np.ndarray], bool] = lambda xy_m: True,
    ) -> None:
        self.scene, self.common, self.near, self.where = world(*things), common, near, where
        self.names = sorted({name for pair in common for name in pair.split()})
        # nobody looks from these: where a robot stands is no more than its number
        self.poses = {name: Pose(float(k), 0.0) for k, name in enumerate(self.names)}
        last = self.poses[self.names[-1]]
        truth = SimpleNamespace(
            sees=lambda target, pose, rig: pose == last,
            cast=lambda origins_m, directions: (None, np.full(len(origins_m), np.inf)),
        )
        monkeypatch.setattr(chain_search, "shared", self._shared)
        monkeypatch.setattr(Chains, "_visible", self._visible)
        self.truth = cast(GroundTruth, truth)
        self.chains = Chains(self.scene, self.truth, RIG)

    def _shared(self, truth: object, a: Sights, b: Sights) -> list[int]:
        pair = " ".join(sorted(self.names[int(s.pose.x_m)] for s in (a, b)))
        return [self.scene.index_of(name) for name in self.common.get(pair, ())]

    def _visible(self, vantages: np.ndarray) -> list[int]:
        points_m = self.chains.free.points_m[vantages]
        points = shapely.points(points_m)
        name = min(self.near, key=lambda n: shapely.distance(self._footprint(n), points).max())
        seen = self.near[name] if any(map(self.where, points_m)) else ()
        return [self.scene.index_of(n) for n in seen]

    def _footprint(self, name: str) -> shapely.Geometry:
        return self.scene.objects[self.scene.index_of(name)].footprint

    def zone(self, name: str) -> np.ndarray:
        return self.chains.free.around(self._footprint(name), APPROACH_M)

    def chain(self, start_xy_m: tuple[float, float], least: int = 0) -> TrueChain | None:
        far_m = self.chains.free.from_m(np.array(start_xy_m))
        target = self.scene.index_of("goal")
        views = Views(self.truth, RIG, self.chains.free)
        return self.chains.chain(self.poses, target, far_m, self.zone("goal"), views, least)

    def way_m(self, start_xy_m: tuple[float, float], *names: str) -> float:
        """The shortest way by way of some landmarks, to the last of them."""
        far_m = self.chains.free.from_m(np.array(start_xy_m))
        by = [self.scene.index_of(name) for name in names[:-1]]
        return float(_by_m(self.chains, far_m, by)[self.zone(names[-1])].min())


def _post(name: str, x_m: float, y_m: float) -> SceneObject:
    return box(name, (x_m, y_m), (1.0, 1.0, 1.0), plain(RED))


def test_a_landmark_is_come_to_where_the_rest_of_the_way_is_shortest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    wall = box("wall", (0.0, 0.0), (20.0, 0.5, 1.0), plain(RED))
    made = Made(
        monkeypatch,
        [wall, _post("a", -12, -7), _post("b", 13, -7), _post("goal", 17, 3)],
        {"R1 R2": ["a"], "R1 R3": ["b"], "R2 R4": ["wall"], "R3 R4": ["wall"]},
        {"a": ["wall"], "b": ["wall"], "wall": ["goal"]},
    )
    start = (0.0, -16.0)
    chain = made.chain(start)
    assert chain is not None
    assert (chain.robots, chain.landmarks) == (("R1", "R3", "R4"), ("b", "wall"))
    assert chain.way_m == pytest.approx(made.way_m(start, "b", "wall", "goal"))
    assert made.way_m(start, "a", "wall") < made.way_m(start, "b", "wall")
    assert made.way_m(start, "a", "wall", "goal") > chain.way_m + 10.0


def test_what_a_landmark_shows_is_told_by_who_can_come_there_not_by_who_asked_first(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fence = [box(f"fence {y}", (0.0, y), (0.4, 19.0, 1.0), plain(RED)) for y in (-10.5, 10.5)]
    gate = box("gate", (0.0, 0.0), (1.0, 2.0, 1.0), plain(RED))
    made = Made(
        monkeypatch,
        [*fence, gate, _post("goal", 0, 15)],
        {"R1 R2": ["gate"]},
        {"gate": ["goal"]},
        where=lambda xy_m: bool(xy_m[0] > 0),
    )
    assert made.chain((-10.0, 0.0)) is None
    east = made.chain((10.0, 0.0))
    assert east is not None and east.landmarks == ("gate",)
    assert made.chain((-10.0, 0.0)) is None


@pytest.mark.parametrize("seed", range(30))
def test_a_chain_is_the_shortest_of_all_with_fewest_landmarks(
    monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    draws = np.random.default_rng(seed)
    spots = draws.permutation([(x, y) for x in range(-16, 17, 8) for y in range(-16, 17, 8)])
    posts = [_post(name, *spot) for name, spot in zip([*"abcdef", "goal"], spots, strict=False)]
    common = {
        f"R{a} R{b}": [i for i in "abcdef" if draws.random() < 0.25]
        for a, b in combinations(range(1, 6), 2)
        if b - a < 4
    }
    near = {i: [j for j in [*"abcdef", "goal"] if draws.random() < 0.35] for i in "abcdef"}
    made = Made(monkeypatch, posts, common, near)
    start = (0.5, 4.0)
    found = made.chain(start)
    every = next(filter(None, (_chains(made, n) for n in range(1, 5))), [])
    if found is None:
        assert not every
    else:
        assert (found.robots, found.landmarks) in every
        assert made.chain(start, least=len(found.landmarks)) == found
        assert made.chain(start, least=len(found.landmarks) + 1) is None
        assert found.way_m == pytest.approx(made.way_m(start, *found.landmarks, "goal"))
        assert found.way_m == pytest.approx(min(made.way_m(start, *by, "goal") for _, by in every))


def _chains(made: Made, n: int) -> list[tuple[tuple[str, ...], tuple[str, ...]]]:
    """Every chain of n landmarks, tried one by one: its robots and landmarks."""
    first, last = made.names[0], made.names[-1]
    found = []
    for between in product(made.names, repeat=n - 1):
        robots = (first, *between, last)
        common = [made.common.get(" ".join(sorted(pair)), ()) for pair in pairwise(robots)]
        for landmarks in product(*common):
            if all(i != j and j in made.near[i] for i, j in pairwise((*landmarks, "goal"))):
                found.append((robots, landmarks))
    return found


def test_where_no_mission_can_be_it_says_so(
    ground: Ground, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(draw, "WAY_M", (0.0, 0.1))
    monkeypatch.setattr(draw, "_DRAWS", 5)
    with pytest.raises(MissionError, match="found no mission"):
        ground.draw(5, 0, 1, 3)


def test_in_a_small_world_shorter_ways_do(ground: Ground, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(draw, "WAY_M", (500.0, 600.0))
    third_m = sum(ground.scene.extent_m) / 3
    assert third_m <= ground.draw(5, 0, 1, 4).way_m <= 600

import json
from dataclasses import replace
from itertools import permutations, product

import numpy as np
import pytest
from hamlet import hamlet
from sights import RIG

from vrchain.errors import MissionError
from vrchain.experiments import missions
from vrchain.experiments.missions import FreeSpace, Ground, Mission, _State
from vrchain.landmarks.quality import Sights, co_visible, shared
from vrchain.truth import GroundTruth


@pytest.fixture(scope="module")
def ground() -> Ground:
    return Ground(hamlet(), GroundTruth(hamlet()), RIG)


@pytest.fixture
def short_ways(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(missions, "WAY_M", (12.0, 60.0))


def test_ways_in_free_space_are_no_shorter_than_straight_and_go_around(ground: Ground) -> None:
    free: FreeSpace = ground.free
    start = np.array([-20.0, -20.0])
    far_m = free.from_m(start)
    straight_m = np.hypot(*(free.points_m - start).T)
    reached = np.isfinite(far_m)
    assert reached.mean() > 0.95
    assert (far_m[reached] >= straight_m[reached] - 1.0).all()
    assert (far_m[reached] <= 1.09 * straight_m[reached] + 6.0).mean() > 0.9
    assert hamlet().is_free(free.points_m, 0.49).all()


def test_a_way_through_a_zone_is_the_shortest_by_any_of_its_places(ground: Ground) -> None:
    free = ground.free
    far_m = free.from_m(np.array([-20.0, -20.0]))
    zone = np.array([100, len(far_m) // 2])
    through_m = free.through_m(far_m, zone)
    by_hand = np.minimum(*(far_m[z] + free.from_m(free.points_m[z]) for z in zone))
    assert through_m == pytest.approx(by_hand, abs=1e-3)
    assert np.isinf(free.through_m(np.full(len(far_m), np.inf), zone)).all()


def test_around_a_footprint(ground: Ground) -> None:
    footprint = hamlet().objects[0].footprint
    zone = ground.free.around(footprint, 3.0)
    away = [footprint.distance(_point(xy)) for xy in ground.free.points_m]
    assert sorted(zone) == sorted(np.flatnonzero(np.array(away) <= 3.0))


def _point(xy_m: np.ndarray) -> object:
    import shapely

    return shapely.Point(*xy_m)


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
    drawn = ground.draw(5, 0, 1, 4, to_places=True)
    assert drawn == ground.draw(5, 0, 1, 4, to_places=True)
    assert drawn.goal == missions.PLACE and len(drawn.goal_poses) == 1
    start, (place,) = drawn.poses["R1"], drawn.goal_poses
    assert not co_visible(ground.truth, start, place, RIG)
    assert hamlet().is_free([place.xy_m]).all()
    assert start.distance_to_m(place.xy_m) <= drawn.way_m + 1.0 <= 61.0
    if drawn.chain is not None:
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
    truth, goal = ground.truth, ground.scene.index_of(drawn.goal)
    first, *others = drawn.poses
    seen = {name: Sights(truth, pose, RIG) for name, pose in drawn.poses.items()}
    start = _State(first, None, ground.free.from_m(drawn.poses[first].xy_m), (), ())
    ways_m = []
    for a, b in permutations(others, 2):
        if goal not in seen[b].visible:
            continue
        firsts, seconds = (
            set(shared(truth, *(seen[n] for n in sorted(pair)))) - {goal}
            for pair in ((first, a), (a, b))
        )
        for i, j in product(firsts, seconds):
            by_i = replace(start, landmark=i)
            by_j = replace(start, landmark=j, before_m=ground._after_m(by_i))
            if i != j and j in ground._near(by_i) and goal in ground._near(by_j):
                ways_m.append(ground._after_m(by_j)[ground._zone(goal)].min())
    return min(ways_m)


def test_where_no_mission_can_be_it_says_so(
    ground: Ground, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(missions, "WAY_M", (500.0, 600.0))
    monkeypatch.setattr(missions, "_DRAWS", 5)
    with pytest.raises(MissionError, match="found no mission"):
        ground.draw(5, 0, 1, 3)

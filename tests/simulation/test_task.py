from itertools import pairwise

import numpy as np
import pytest
import shapely
import worlds
from hamlet import GOAL, hamlet, hamlet_truth
from sights import RIG
from test_simulated_goals import shut_in

from vrchain.errors import MissionError
from vrchain.landmarks.quality import co_visible
from vrchain.navigation.settings import GOAL_RANGE_M
from vrchain.panorama import CameraRig
from vrchain.simulation.goals import GOAL_PICTURES, goal_pictures
from vrchain.simulation.task import SPACING_M, Task, draw_task, robot_names
from vrchain.world.render import Renderer
from vrchain.world.truth import GroundTruth

FULL = CameraRig()


@pytest.fixture(scope="module", params=[(0, 2), (1, 3), (2, 4)], ids=lambda p: f"{p[1]} robots")
def task(request: pytest.FixtureRequest) -> Task:
    seed, n_robots = request.param
    return draw_task(hamlet(), hamlet_truth(), RIG, seed, n_robots, goal=GOAL)


def test_a_task_is_as_it_is_defined(task: Task) -> None:
    scene, truth = hamlet(), hamlet_truth()
    places = list(task.places.values())
    target = scene.index_of(task.goal)
    assert task.goal == GOAL
    assert list(task.places) == list(task.starts) == [f"R{i + 1}" for i in range(len(places))]
    for a, b in pairwise(places):
        assert SPACING_M[0] <= a.distance_to_m(b.xy_m) <= SPACING_M[1]
        assert co_visible(truth, a, b, RIG)
    assert scene.is_free([p.xy_m for p in places], 1.0).all()
    assert truth.visibility(places[-1], RIG).visible[target]
    object_id, _ = truth.look(places[0], FULL)
    assert not (object_id == target).any()  # not one pixel


def test_every_robot_reaches_its_place_straight_ahead(task: Task) -> None:
    scene = hamlet()
    for name, place in task.places.items():
        start = task.starts[name]
        assert start.bearing_to_rad(place.xy_m) == pytest.approx(0, abs=1e-6)
        way = start.xy_m + np.linspace(0, 1, 25)[:, None] * (place.xy_m - start.xy_m)
        assert scene.is_free(way).all()
        assert start.distance_to_m(place.xy_m) > 3


def test_the_goals_pictures_show_the_goal_and_little_else(task: Task) -> None:
    scene, truth = hamlet(), hamlet_truth()
    target = scene.index_of(task.goal)
    pictures = goal_pictures(scene, Renderer(scene), task.goal, task.goal_poses, RIG)
    assert len(pictures) == len(task.goal_poses) == GOAL_PICTURES
    for pose, picture in zip(task.goal_poses, pictures, strict=True):
        low, high = GOAL_RANGE_M
        range_m = scene.objects[target].footprint.distance(shapely.Point(*pose.xy_m))
        assert low - 1e-6 <= range_m <= high + 1e-6 and scene.is_free([pose.xy_m])[0]
        object_id, _ = truth.look(pose, picture.rig)
        share = (object_id == target).mean()
        assert share > 0.2
        assert object_id[0, picture.rig.height_px // 2, picture.rig.width_px // 2] == target
        assert picture.rig.focal_px == pytest.approx(RIG.focal_px, rel=0.05)
        assert picture.rig.n_views == 1


def test_the_same_seed_draws_the_same_task_and_another_draws_another() -> None:
    drawn = [
        draw_task(hamlet(), hamlet_truth(), RIG, seed, 2, goal=goal)
        for seed, goal in ((5, GOAL), (5, GOAL), (6, GOAL))
    ]
    assert drawn[0] == drawn[1]
    assert drawn[0] != drawn[2]


def test_a_goal_is_drawn_among_houses_and_the_robot_that_drives_is_named_first() -> None:
    task = draw_task(hamlet(), hamlet_truth(), RIG, 0, 2, "R2")
    assert task.goal.startswith("house")
    assert list(task.places) == ["R2", "R1"]
    assert robot_names(3) == ["R1", "R2", "R3"]
    assert robot_names(20, "R20")[0] == "R20"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"goal": "house 99"}, "no object 'house 99'"),
        ({"goal": "ground"}, "no landmark"),
        ({"robot": "R9"}, "no robot 'R9'"),
        ({"robot": ""}, "no robot ''"),
        ({"n_robots": 1}, "expected 2 to 20 robots, got 1"),
        ({"n_robots": 21}, "expected 2 to 20 robots, got 21"),
        ({"n_robots": -3}, "expected 2 to 20"),
        ({"scene": worlds.world()}, "name a --goal"),  # nothing stands there
    ],
)
def test_what_cannot_be_drawn_is_refused(options: dict, message: str) -> None:
    asked = {"scene": hamlet(), "truth": hamlet_truth(), "rig": RIG, "seed": 0, **options}
    with pytest.raises(MissionError, match=message):
        draw_task(**asked)


@pytest.fixture
def _few_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("vrchain.simulation.task._BATCHES", 1)
    monkeypatch.setattr("vrchain.simulation.task._BATCH", 4000)


@pytest.mark.usefixtures("_few_draws")
def test_too_many_robots_for_the_place_is_said_plainly() -> None:
    """A chain of twenty needs more room than there is."""
    with pytest.raises(MissionError, match=r"20 robots.*try another goal"):
        draw_task(hamlet(), hamlet_truth(), RIG, 0, 20, goal=GOAL)


@pytest.mark.usefixtures("_few_draws")
def test_a_goal_in_plain_view_of_everywhere_is_said_plainly() -> None:
    tower = worlds.box("tower", (0, 0), (2, 2, 3), worlds.blotches("tower"))
    scene = worlds.world(tower)
    with pytest.raises(MissionError, match="'tower'"):
        draw_task(scene, GroundTruth(scene), RIG, 0, goal="tower")


@pytest.mark.usefixtures("_few_draws")
def test_a_goal_without_enough_pictures_is_said_plainly() -> None:
    scene = shut_in()
    with pytest.raises(MissionError, match="'goal'"):
        draw_task(scene, GroundTruth(scene), RIG, 0, goal="goal")

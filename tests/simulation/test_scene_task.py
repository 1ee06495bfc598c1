"""A scene with robots of its own sets the task; a mission takes it."""

import numpy as np
import pytest
from hamlet import GOAL, hamlet, hamlet_truth

from vrchain.errors import MissionError
from vrchain.geometry import Pose
from vrchain.simulation.task import GOAL_PICTURES, goal_poses, scene_task
from vrchain.world.model import Scene

ROBOTS = (("R1", Pose(-20.0, -6.0, 1.0)), ("R2", Pose(0.0, 17.5, 2.0)))


def scene(robots: tuple[tuple[str, Pose], ...] = ROBOTS, goal: str | None = GOAL) -> Scene:
    own = hamlet()
    return Scene(own.name, own.extent_m, own.objects, robots=robots, goal=goal)


def test_its_places_and_goal_are_the_scene_s() -> None:
    task = scene_task(scene(), hamlet_truth(), 0, 2)
    assert dict(task.places) == dict(ROBOTS)
    assert task.goal == GOAL
    target = hamlet().index_of(GOAL)
    assert list(task.goal_poses) == goal_poses(hamlet(), hamlet_truth(), target, 0)
    assert len(task.goal_poses) == GOAL_PICTURES
    for name, start in task.starts.items():
        way = start.xy_m + np.linspace(0, 1, 20)[:, None] * (task.places[name].xy_m - start.xy_m)
        assert hamlet().is_free(way).all()


def test_another_robot_may_drive_to_another_goal() -> None:
    task = scene_task(scene(), hamlet_truth(), 0, 2, robot="R2", goal="house 7")
    assert list(task.places) == ["R2", "R1"]
    assert task.goal == "house 7"


def test_the_same_seed_draws_the_same_task() -> None:
    first, second, other = (scene_task(scene(), hamlet_truth(), s, 2) for s in (3, 3, 4))
    assert first == second
    assert first.starts != other.starts


@pytest.mark.parametrize(
    ("changed", "asked", "words"),
    [
        ({}, {"n_robots": 3}, "has 2 robots of its own, not 3: leave their number out"),
        ({}, {"n_robots": 2, "robot": "R7"}, "no robot 'R7'"),
        ({}, {"n_robots": 2, "goal": "castle"}, "no object 'castle'"),
        ({"goal": None}, {"n_robots": 2}, "sets no goal: name a --goal"),
        ({"robots": (("R1", Pose(-15.0, -12.0)), ROBOTS[1])}, {"n_robots": 2}, "no free way"),
    ],
)
def test_what_cannot_be_is_refused(changed: dict, asked: dict, words: str) -> None:
    with pytest.raises(MissionError, match=words):
        scene_task(scene(**changed), hamlet_truth(), 0, **asked)

from dataclasses import replace

import numpy as np
import pytest
import shapely
import worlds

from vrchain.errors import MissionError
from vrchain.geometry import Pose
from vrchain.navigation.settings import GOAL_RANGE_M
from vrchain.panorama import CameraRig
from vrchain.simulation.collision_free import FreeSpace
from vrchain.simulation.goals import (
    GOAL_PICTURES,
    _off,
    goal_ids,
    goal_pictures,
    goal_poses,
    pictured_share,
)
from vrchain.world.model import Scene, SceneObject
from vrchain.world.render import Renderer
from vrchain.world.truth import GroundTruth

BESIDE = ((0, (0.0, 4.5)), (1, (0.0, -4.5)))


def shut_in(to_m: float = 1.2, wide_m: float = 1.0, *more: SceneObject) -> Scene:
    """A goal in the middle of a room whose four walls are so far from its middle."""
    goal = worlds.box("goal", (0, 0), (wide_m, wide_m, 1), worlds.blotches("goal"))
    long_m = 2 * to_m + 0.2
    across, along = (0.2, long_m, 4), (long_m, 0.2, 4)
    sides = {(0, to_m): along, (0, -to_m): along, (to_m, 0): across, (-to_m, 0): across}
    walls = [worlds.box(f"w{c}", c, size, worlds.blotches("w")) for c, size in sides.items()]
    return worlds.world(goal, *walls, *more)


def test_a_goal_that_is_shut_in_has_no_pictures() -> None:
    scene = shut_in()
    assert goal_poses(scene, GroundTruth(scene), scene.index_of("goal"), 0) == []


@pytest.mark.parametrize(
    ("wide_m", "to_m", "share"), [(1, 9.0, 0.25), (5, 9.0, 0.5), (8, 19.0, 1.0), (1, 2.9, 0.25)]
)
def test_the_smaller_a_goal_the_nearer_by_it_is_pictured(
    wide_m: float, to_m: float, share: float
) -> None:
    scene = shut_in(to_m, wide_m)
    poses = goal_poses(scene, GroundTruth(scene), scene.index_of("goal"), 0)
    assert len(poses) == GOAL_PICTURES
    assert pictured_share(scene, "goal", poses) == share
    side = scene.objects[scene.index_of("goal")].footprint
    low_m, high_m = (share * range_m for range_m in GOAL_RANGE_M)
    for pose in poses:
        assert low_m - 1e-6 <= side.distance(shapely.Point(*pose.xy_m)) <= high_m + 1e-6
        assert np.abs(pose.xy_m).max() < to_m


@pytest.mark.parametrize("side_m", [1.5, 3.0, 3.7])
def test_what_is_small_is_pictured_from_near_wherever_the_draws_fall(side_m: float) -> None:
    """From 3 to 3.75 m it may be of either share: that which is tried first draws it."""
    poses = [Pose(x, 0.0) for x in (0.5 + side_m, -0.5 - side_m)]
    assert pictured_share(shut_in(9.0), "goal", poses) == 0.25


def test_a_goal_is_pictured_by_cameras_of_many_pixels_too() -> None:
    scene, near = shut_in(9.0, 8), Pose(-5.0, 0.0)
    rig = CameraRig(n_views=4, width_px=4096, field_of_view_deg=90)
    (picture,) = goal_pictures(scene, Renderer(scene), "goal", [near], rig)
    assert picture.rig.width_px == 4096
    assert picture.rig.field_of_view_deg == pytest.approx(100)


def test_it_is_pictured_from_farther_where_things_stand_all_around_it() -> None:
    fence = [worlds.box(f"f{k}", at, (9.0, 0.2, 0.3), worlds.blotches("f")) for k, at in BESIDE]
    fence += [
        worlds.box(f"g{k}", at[::-1], (0.2, 9.0, 0.3), worlds.blotches("f")) for k, at in BESIDE
    ]
    scene = shut_in(14.0, 1, *fence)
    free = FreeSpace(scene)
    room = int(free.region[free.nearest(np.array([-9.0, 0.0]))])
    target = scene.index_of("goal")
    poses = goal_poses(scene, GroundTruth(scene), target, 0, lambda xy_m: free.is_in(room, xy_m))
    assert len(poses) == GOAL_PICTURES
    assert min(np.abs(pose.xy_m).max() for pose in poses) > 4.5


def test_what_is_wide_has_no_pictures_in_a_small_room() -> None:
    scene = shut_in(6.0, 7)
    target = scene.index_of("goal")
    assert len(goal_poses(scene, GroundTruth(scene), target, 0)) < GOAL_PICTURES


def test_a_goals_pictures_are_of_the_room_that_robots_drive_in() -> None:
    """Over a low wall it is seen from beyond too, where none of them gets."""
    wall = worlds.box("low wall", (2.5, 0), (0.3, 40, 0.5), worlds.blotches("w"))
    goal = worlds.box("goal", (0, 0), (1, 1, 1), worlds.blotches("goal"))
    scene = worlds.world(goal, wall)
    truth, target = GroundTruth(scene), scene.index_of("goal")
    free = FreeSpace(scene)
    assert any(pose.x_m > 3 for pose in goal_poses(scene, truth, target, 0))
    room = int(free.region[free.nearest(np.array([-9.0, 0.0]))])
    poses = goal_poses(scene, truth, target, 0, lambda xy_m: free.is_in(room, xy_m))
    assert len(poses) == GOAL_PICTURES and all(pose.x_m < 2.5 for pose in poses)


def test_without_buildings_goals_are_large_things_without_a_twin() -> None:
    def thing(name: str, size_m: tuple[float, float, float], base_m: float = 0.0) -> SceneObject:
        at = (float(len(name)), 0.0)
        return worlds.box(name, at, size_m, worlds.plain((9, 9, 9)), base_m=base_m)

    chairs = [replace(thing(name, (1, 1, 1)), model="chair") for name in ("chair", "chair_1")]
    cup, lamp = thing("cup", (0.1, 0.1, 0.1)), thing("ceiling lamp", (1, 1, 0.2), 2.5)
    wall = worlds.box("wall", (0, 9), (9, 0.1, 2), worlds.plain((9, 9, 9)), landmark=False)
    scene = worlds.world(*chairs, cup, lamp, wall, thing("sofa", (2, 0.9, 0.8)))
    assert goal_ids(scene, None) == [scene.index_of("sofa")]
    with pytest.raises(MissionError, match="name a --goal"):
        goal_ids(worlds.world(*chairs, cup, lamp, wall), None)


def test_walls_farther_away_all_around_are_pictured_from_their_middle() -> None:
    walls = worlds.box("walls", (0, 0), (36, 36, 2), worlds.blotches("walls"))
    scene = worlds.world(replace(walls, outline=shapely.box(-18, -18, 18, 18).exterior))
    poses = goal_poses(scene, GroundTruth(scene), scene.index_of("walls"), 0)
    assert [tuple(pose.xy_m) for pose in poses] == [(0, 0)] * GOAL_PICTURES


def test_a_lamp_whose_arm_reaches_far_is_pictured_from_off_its_foot() -> None:
    """As it was met: the middle of such a lamp is farther from its foot than the foot is wide."""
    foot, centre, outward = shapely.Point(0, 0).buffer(0.1), np.array([1.0, 0.0]), np.array([-1, 0])
    for side_m in (1.5, 3.0, 6.0):
        stand = _off(foot, centre, outward, side_m)
        assert shapely.distance(foot, shapely.Point(stand)) == pytest.approx(side_m, abs=1e-6)

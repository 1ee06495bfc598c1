from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import worlds

from vrchain.geometry import Pose
from vrchain.panorama import CameraRig
from vrchain.paths import SCENES
from vrchain.seeding import generator
from vrchain.world import load_scene
from vrchain.world.model import Scene, SceneObject, place
from vrchain.world.render import Renderer
from vrchain.world.truth import SKY, GroundTruth

RIG = CameraRig(n_views=8, width_px=320, height_px=240)
GREY = worlds.plain((120, 120, 120))


def rectangle_deg2(width_m: float, height_m: float, distance_m: float) -> float:
    """Solid angle of a rectangle facing the eye, which is level with its middle."""
    a, b = width_m / 2, height_m / 2
    ratio = a * b / (distance_m * np.sqrt(distance_m**2 + a**2 + b**2))
    return float(4 * np.arctan(ratio) * np.degrees(1) ** 2)


def test_rays_measure_a_wall() -> None:
    scene = worlds.world(worlds.box("wall", (5.5, 0), (1, 30, 4), GREY))
    angle = np.linspace(-1.2, 1.2, 25)
    rays = np.stack([np.cos(angle), np.sin(angle), np.zeros(25)], axis=1)
    object_id, distance_m = GroundTruth(scene).cast([0, 0, 1.0], rays)
    assert object_id.dtype == np.int32
    assert (object_id == scene.index_of("wall")).all()
    assert np.allclose(distance_m, 5 / np.cos(angle), atol=1e-4)


def test_distances_come_in_lengths_of_the_ray_and_are_infinite_for_the_sky() -> None:
    truth = GroundTruth(worlds.world(worlds.box("box", (5.5, 0), (1, 1, 2), GREY)))
    rays = [[2.0, 0, 0], [0, 0, 1.0], [-1, 0, 0.2], [0, 0, -1.0]]
    object_id, distance = truth.cast([0, 0, 1.0], rays)
    assert object_id.tolist() == [1, SKY, SKY, 0]
    assert distance.tolist() == pytest.approx([2.5, np.inf, np.inf, 1.0])
    _, points = truth.look_along(Pose(0, 0), [0.0, 0.0], [5.0, -1.0])
    assert np.isnan(points[0]).all()
    assert np.allclose(points[1], (1, 0, 0), atol=1e-5)


def test_looking_gives_the_range_of_every_pixel() -> None:
    scene = worlds.world(worlds.box("wall", (0, 5.5), (30, 1, 4), GREY))
    object_id, range_m = GroundTruth(scene).look(Pose(0, 0, np.pi / 2), RIG)
    assert object_id.shape == range_m.shape == (8, 240, 320)
    wall = object_id[0] == scene.index_of("wall")
    assert wall[120, 160] and wall.mean() > 0.4
    rays = RIG.ray_directions()[0]
    assert np.allclose(range_m[0][wall], 5 / rays[..., 0][wall], rtol=1e-4)
    assert (object_id[4] != scene.index_of("wall")).all()  # behind
    assert np.isinf(range_m[object_id == SKY]).all()


def test_points_along_bearings_lie_on_what_is_hit() -> None:
    scene = worlds.world(worlds.box("wall", (0, 5.5), (30, 1, 4), GREY))
    pose = Pose(1.0, -1.0, 0.5)
    bearing = np.linspace(0.7, 1.4, 9)
    object_id, points = GroundTruth(scene).look_along(pose, bearing, np.full(9, 0.05))
    assert (object_id == scene.index_of("wall")).all()
    assert np.allclose(points[:, 1], 5.0, atol=1e-4)
    assert np.allclose([pose.bearing_to_rad(p) for p in points], bearing, atol=1e-5)
    range_m = np.hypot(points[:, 0] - 1, points[:, 1] + 1)
    assert np.allclose(points[:, 2], 1.0 + 0.05 * range_m, atol=1e-4)


@pytest.mark.parametrize("distance_m", [4.0, 8.0, 15.0])
@pytest.mark.parametrize("yaw_rad", [0.0, 2.5])
def test_visible_angles_agree_with_geometry(distance_m: float, yaw_rad: float) -> None:
    scene = worlds.world(worlds.box("box", (distance_m + 1, 0), (2, 2, 2), GREY))
    seen = GroundTruth(scene).visibility(Pose(0, 0, yaw_rad), CameraRig()).loc[1]
    assert seen.azimuth_deg == pytest.approx(2 * np.degrees(np.arctan(1 / distance_m)), abs=0.5)
    assert seen.area_deg2 == pytest.approx(rectangle_deg2(2, 2, distance_m), rel=0.05)
    assert seen.range_m == pytest.approx(distance_m, rel=0.06)
    assert seen.visible


def test_small_things_are_not_visible() -> None:
    thin = worlds.box("thin", (12, 0), (0.1, 0.1, 3), GREY)  # 0.5 degrees wide
    flat = worlds.box("flat", (0, 15), (6, 0.1, 0.1), GREY, base_m=1.0)  # 8 square degrees
    far = worlds.box("far", (0, -19), (0.4, 0.4, 0.4), GREY, base_m=0.8)  # 1.2 x 1.2 degrees
    scene = worlds.world(thin, flat, far)
    seen = GroundTruth(scene).visibility(Pose(0, 0))
    shown = [bool(seen.visible[scene.index_of(name)]) for name in ("thin", "flat", "far")]
    assert shown == [False, True, False]


def test_what_is_hidden_is_not_seen() -> None:
    screen = worlds.box("screen", (5, 0), (0.2, 4, 4), GREY)
    hidden = worlds.box("hidden", (9, 0), (1, 2, 2), GREY)
    half = worlds.box("half", (9.5, 3.6), (1, 4, 2), GREY)
    scene = worlds.world(screen, hidden, half)
    seen = GroundTruth(scene).visibility(Pose(0, 0))
    assert scene.index_of("hidden") not in seen.index
    edge, left = np.arctan2(2, 4.9), np.arctan2(5.6, 9.0)
    expected_deg = np.degrees(left - edge)
    assert seen.azimuth_deg[scene.index_of("half")] == pytest.approx(expected_deg, abs=0.5)


TEAM = {"R5": Pose(6.0, 0.0, np.pi), "R2": Pose(0.0, -3.0)}


def test_rays_meet_the_robots_they_are_given() -> None:
    truth = GroundTruth(worlds.walled(5.5))
    rays = [[1.0, 0, 0], [0, -2.0, 0], [0, 1.0, 0], [1.0, 0.1, 0]]
    near = {"R5": Pose(3.0, 0.0, np.pi), "R2": Pose(0.0, -3.0)}
    object_id, distance = truth.cast([0, 0, 0.15], rays, near)
    assert object_id.dtype == np.int32 and distance.dtype == np.float32
    assert object_id.tolist() == [-2, -3, SKY, 1]
    assert distance[0] == pytest.approx(3.0 - 0.255, abs=1e-4)  # its nose
    assert distance[1] == pytest.approx((3.0 - 0.25) / 2, abs=0.05)  # a wheel, or between them
    swapped, _ = truth.cast([0, 0, 0.15], rays, dict(reversed(near.items())))
    assert swapped.tolist() == [-3, -2, SKY, 1]
    for nobody in (None, {}):
        assert truth.cast([0, 0, 0.15], rays, nobody)[0].tolist() == [1, SKY, SKY, 1]


def test_a_robot_behind_a_wall_is_not_seen() -> None:
    truth = GroundTruth(worlds.walled(5.0))
    object_id, range_m = truth.look(Pose(0, 0), RIG, TEAM)
    assert set(np.unique(object_id)) == {-3, SKY, 0, 1}
    plain_id, plain_m = truth.look(Pose(0, 0), RIG)
    same = object_id != -3
    assert np.array_equal(object_id[same], plain_id[same])
    assert np.array_equal(range_m[same], plain_m[same])
    assert (range_m[~same] < plain_m[~same]).all()


def test_robots_hide_things_and_are_none_themselves() -> None:
    truth = GroundTruth(worlds.world(worlds.box("box", (3.6, 0), (0.2, 0.4, 0.2), GREY)))
    alone, hidden = (truth.visibility(Pose(0, 0), RIG, r) for r in ({}, {"R2": Pose(3, 0)}))
    assert alone.visible[1]
    assert 1 not in hidden.index or hidden.area_deg2[1] < 0.2 * alone.area_deg2[1]
    assert (hidden.index >= 0).all()
    _, points = truth.look_along(Pose(0, 0), [0.0], [-0.34 / 1.5], RIG, {"R2": Pose(1.5, 0)})
    assert points[0, 2] == pytest.approx(0.66, abs=0.1)  # on its flag


def test_one_object_alone_is_seen_as_among_all() -> None:
    scene = load_scene(SCENES / "crossing" / "crossing.world")
    truth = GroundTruth(scene)
    draws = generator(5, "one object")
    half_m = np.array(scene.extent_m) / 2
    single = CameraRig(1, 64, 48, 70.0)
    for k in range(8):  # also inside of things, above whose boxes all directions lead
        pose = Pose(
            *map(float, draws.uniform(-half_m, half_m)), float(draws.uniform(-np.pi, np.pi))
        )
        rig, team = (single, {"R2": Pose(pose.x_m + 2, pose.y_m)}) if k % 2 else (RIG, None)
        seen = truth.visibility(pose, rig, team)
        for i in range(len(scene.objects)):
            alone = truth.visibility(pose, rig, team, of=i)
            pd.testing.assert_frame_equal(alone, seen[seen.index == i])


def test_a_single_camera_sees_only_ahead() -> None:
    ahead, behind = (worlds.box(n, (x, 0), (1, 1, 2), GREY) for n, x in (("a", 5), ("b", -5)))
    truth, one = GroundTruth(worlds.world(ahead, behind)), CameraRig(1, 160, 120)
    seen = [set(truth.visibility(Pose(0, 0), rig).index) - {0} for rig in (one, CameraRig())]
    assert seen == [{1}, {1, 2}]


def test_the_whole_sphere_of_a_tunnel_adds_up() -> None:
    """Inside a closed room the visible areas sum to what the cylinder spans."""
    sides = ((4, 0, 1, 9), (-4, 0, 1, 9), (0, 4, 9, 1), (0, -4, 9, 1))
    walls = [worlds.box(f"wall {i}", s[:2], (*s[2:], 9), GREY) for i, s in enumerate(sides)]
    seen = GroundTruth(worlds.world(*walls)).visibility(Pose(0, 0), CameraRig())
    top = CameraRig().slope_of_row(-0.5)
    band_deg2 = 360 * np.degrees(2 * np.sin(np.arctan(top)))
    assert seen.area_deg2.sum() == pytest.approx(band_deg2, rel=0.01)


# --- cut-outs ---

ONE_VIEW = CameraRig(n_views=1, width_px=640, height_px=480)


def card(name: str, picture: np.ndarray, x_m: float, repeats: float = 1.0) -> SceneObject:
    """An upright 2 x 2 m picture across the x axis, seen from the origin."""
    corners = [(0, 1, 0), (0, -1, 0), (0, -1, 2), (0, 1, 2)]
    surface = worlds.quad(corners, picture)
    surface = replace(surface, uv=surface.uv * np.float32(repeats))
    return place(name, "card", name, [surface], Pose(x_m, 0), landmark=True)


def holed() -> Scene:
    """A blue card 4 m ahead whose upper left quarter is a hole, and a red wall 4 m behind it."""
    picture = np.full((8, 8, 4), (*worlds.BLUE, 255), dtype=np.uint8)
    picture[:4, :4, 3] = 127  # just see-through
    picture[4:, 4:, 3] = 128  # just not
    wall = worlds.box("wall", (8.5, 0), (1, 30, 9), worlds.plain(worlds.RED))
    return worlds.world(card("card", picture, 4.0), wall)


def test_a_ray_goes_on_through_a_hole() -> None:
    scene = holed()
    truth = GroundTruth(scene)
    aims = np.array([(4, y, z) for y in (0.5, -0.5) for z in (1.5, 0.5)])
    object_id, distance = truth.cast([0, 0, 1.0], aims - (0, 0, 1.0))
    wall, in_front = scene.index_of("wall"), scene.index_of("card")
    assert object_id.tolist() == [wall, in_front, in_front, in_front]
    assert distance == pytest.approx([2, 1, 1, 1], abs=1e-5)  # in lengths of the ray
    _, points = truth.look_along(Pose(0, 0), [np.arctan2(0.5, 4)], [0.5 / np.hypot(0.5, 4)])
    assert np.allclose(points, (8, 1, 2), atol=1e-4)
    behind, _ = truth.cast([7.9, 0.5, 1.5], [[-1.0, 0, 0], [-1, -0.25, 0]])  # from the other side
    assert behind.tolist() == [SKY, in_front]


def test_what_is_behind_a_hole_carries_its_own_id_and_shows_its_colour() -> None:
    scene, pose = holed(), Pose(0, 0)
    renderer = Renderer(scene)
    ids, range_m = (view[0] for view in GroundTruth(scene).look(pose, ONE_VIEW))
    drawn = renderer.segmentation(pose, ONE_VIEW)[0]
    colour = renderer.render(pose, ONE_VIEW).views[0].astype(int)
    row, column = 240 - 69, 320 - 69  # the middle of the hole: 0.5 m up and left, 4 m away
    for dy, dx, name, rgb in (
        (0, 0, "wall", worlds.RED),
        (0, 138, "card", worlds.BLUE),
        (138, 0, "card", worlds.BLUE),
        (138, 138, "card", worlds.BLUE),
    ):
        at = row + dy, column + dx
        assert ids[at] == drawn[at] == scene.index_of(name)
        assert np.abs(colour[at] - rgb).max() <= 2
        assert range_m[at] == pytest.approx(
            (8 if name == "wall" else 4) * ONE_VIEW.ray_directions()[0][at][0] ** -1, rel=1e-4
        )
    assert (ids != drawn).mean() < 1e-4
    red = np.abs(colour - worlds.RED).max(axis=-1) < 60
    assert (red == (drawn == scene.index_of("wall"))).mean() > 0.999


@pytest.mark.parametrize("repeats", [1.0, 3.3, -1.7])
def test_layers_of_noise_are_seen_through_alike_by_rays_and_renderer(repeats: float) -> None:
    draws = generator(0, "cards")
    pictures = draws.integers(0, 256, (4, 24, 20, 4), dtype=np.uint8)
    cards = [card(f"card {k}", p, 3.0 + k, repeats) for k, p in enumerate(pictures[:3])]
    cards.append(card("upright", pictures[3], 7.0))
    wall = worlds.box("wall", (9.5, 0), (1, 30, 9), worlds.plain(worlds.RED))
    scene = worlds.world(*cards, wall)
    renderer, truth = Renderer(scene), GroundTruth(scene)
    for pose in (Pose(0, 0), Pose(0.5, -1.5, 0.3), Pose(8.5, 0.2, np.pi)):
        drawn, cast = renderer.segmentation(pose, ONE_VIEW), truth.look(pose, ONE_VIEW)[0]
        assert (drawn == cast).mean() > 0.9999
        assert set(np.unique(cast)) >= {scene.index_of(c.name) for c in cards}


def test_a_ray_stops_behind_many_layers() -> None:
    air = np.zeros((4, 4, 4), dtype=np.uint8)
    few, many = ([card(f"{k}", air, 3.0 + 0.1 * k) for k in range(n)] for n in (32, 40))
    wall = worlds.box("wall", (9.5, 0), (1, 30, 9), GREY)
    object_id, distance = GroundTruth(worlds.world(*few, wall)).cast([0, 0, 1.0], [1.0, 0, 0])
    assert object_id == 33 and distance == pytest.approx(9.0, abs=1e-4)
    object_id, _ = GroundTruth(worlds.world(*many, wall)).cast([0, 0, 1.0], [1.0, 0, 0])
    assert object_id == 33  # of 40 cards the one after 32


def test_a_scene_of_cut_outs_alone() -> None:
    picture = np.zeros((2, 2, 4), dtype=np.uint8)
    picture[:, 1, 3] = 255  # the right half is there
    scene = Scene("cards", (40.0, 40.0), (card("card", picture, 4.0),))
    object_id, distance = GroundTruth(scene).cast([0, 0, 1.0], [[4.0, 0.5, 0], [4.0, -0.5, 0]])
    assert object_id.tolist() == [SKY, 0]
    assert np.isinf(distance[0]) and distance[1] == pytest.approx(1.0)

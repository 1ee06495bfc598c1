import numpy as np
import pytest
import worlds

from vrchain.geometry import Pose
from vrchain.panorama import CameraRig
from vrchain.truth import SKY, GroundTruth

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


def test_distances_come_in_lengths_of_the_ray() -> None:
    truth = GroundTruth(worlds.world(worlds.box("wall", (5.5, 0), (1, 30, 4), GREY)))
    _, distance = truth.cast([0, 0, 1.0], [2.0, 0, 0])
    assert distance == pytest.approx(2.5)


def test_rays_that_hit_nothing_are_sky() -> None:
    truth = GroundTruth(worlds.world(worlds.box("box", (5, 0), (1, 1, 1), GREY)))
    object_id, distance_m = truth.cast([0, 0, 1.0], [[0, 0, 1.0], [-1, 0, 0.2], [0, 0, -1.0]])
    assert object_id.tolist() == [SKY, SKY, 0]
    assert np.isinf(distance_m[:2]).all()
    assert distance_m[2] == pytest.approx(1.0)
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
    assert not seen.visible[scene.index_of("thin")]
    assert seen.visible[scene.index_of("flat")]
    assert not seen.visible[scene.index_of("far")]


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


def test_a_single_camera_sees_only_ahead() -> None:
    ahead, behind = (worlds.box(n, (x, 0), (1, 1, 2), GREY) for n, x in (("a", 5), ("b", -5)))
    truth = GroundTruth(worlds.world(ahead, behind))
    rig = CameraRig(n_views=1, width_px=160, height_px=120)
    assert 1 in truth.visibility(Pose(0, 0), rig).index
    assert 2 not in truth.visibility(Pose(0, 0), rig).index
    assert 2 in truth.visibility(Pose(0, 0), CameraRig()).index


def test_the_whole_sphere_of_a_tunnel_adds_up() -> None:
    """Inside a closed room the visible areas sum to what the cylinder spans."""
    walls = [
        worlds.box(f"wall {i}", c, s, GREY)
        for i, (c, s) in enumerate(
            [((4, 0), (1, 9, 9)), ((-4, 0), (1, 9, 9)), ((0, 4), (9, 1, 9)), ((0, -4), (9, 1, 9))]
        )
    ]
    seen = GroundTruth(worlds.world(*walls)).visibility(Pose(0, 0), CameraRig())
    top = CameraRig().slope_of_row(-0.5)
    band_deg2 = 360 * np.degrees(2 * np.sin(np.arctan(top)))
    assert seen.area_deg2.sum() == pytest.approx(band_deg2, rel=0.01)

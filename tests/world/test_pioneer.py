import hashlib
from dataclasses import replace

import numpy as np
import pytest
import worlds

from vrchain.geometry import Pose, rotation_z
from vrchain.world.model import ROBOT_RADIUS_M
from vrchain.world.spec import LightSpec
from vrchain.world.things import pioneer


def test_it_has_a_pioneers_size_and_a_camera_at_one_metre() -> None:
    surface = pioneer.build("R1")
    points = surface.vertices_m.astype(float)
    low = points[points[:, 2] <= pioneer.SIZE_M[2] + 1e-6]
    assert np.allclose(np.ptp(low, axis=0), pioneer.SIZE_M, atol=0.002)
    assert np.abs(low[:, :2].mean(axis=0)).max() < 0.03
    assert points[:, 2].min() == 0
    assert np.linalg.norm(points[:, :2], axis=1).max() < ROBOT_RADIUS_M
    head = points[points[:, 2] > 0.9]
    assert head[:, 2].max() - 1.0 == pytest.approx(0.05, abs=1e-6)
    assert 200 < len(surface.faces) < 600


def test_faces_show_their_outside() -> None:
    """Faces of parts that enclose the vertical through their middle look away from it."""
    surface = pioneer.build("R1")
    a, b, c = (surface.vertices_m[surface.faces[:, i]].astype(float) for i in range(3))
    normal, middle = np.cross(b - a, c - a), (a + b + c) / 3
    mast = (middle[:, 2] > 0.36) & (np.abs(normal[:, 2]) < 1e-6)
    assert (np.einsum("ij,ij->i", normal, middle)[mast] > 0).all()
    assert mast.sum() > 40


def test_robots_of_a_team_have_flags_of_their_own() -> None:
    colours = np.array([pioneer.colour_of(f"R{i}") for i in range(1, 21)])
    apart = np.abs(colours[:, None] - colours[None]).max(axis=2)
    assert apart[~np.eye(20, dtype=bool)].min() > 15
    assert apart[:4, :4][~np.eye(4, dtype=bool)].min() > 80
    assert pioneer.colour_of("scout") != pioneer.colour_of("rover")
    first, second = pioneer.build("R1"), pioneer.build("R2")
    assert first.vertices_m.tobytes() == second.vertices_m.tobytes()
    assert 0 < (first.texture != second.texture).any(axis=2).mean() < 0.3  # flags, nothing else


@pytest.mark.parametrize("name", ["", "scout 7b", "Zoë", "R" + "9" * 60])
def test_any_name_will_do(name: str) -> None:
    assert np.isfinite(pioneer.build(name).vertices_m).all()


def test_robots_stand_where_they_are_put() -> None:
    poses = {"R2": Pose(3, -4, 1.2), "R1": Pose(-1, 0.5, -2.0)}
    robots = pioneer.placed(worlds.yard(), poses)
    assert [r.name for r in robots] == ["R2", "R1"]
    assert not any(r.landmark for r in robots)
    own = pioneer.build("R2").vertices_m.astype(float)
    expected = own @ rotation_z(1.2).T + (3, -4, 0)
    assert np.allclose(robots[0].surfaces[0].vertices_m, expected, atol=1e-5)
    assert pioneer.placed(worlds.yard(), {}) == ()


def test_the_scenes_sun_shines_on_it() -> None:
    """What faces the sun is brighter, whichever way the robot is turned."""
    scene = replace(worlds.yard(), light=LightSpec(sun_azimuth_deg=90.0, sun_elevation_deg=30.0))
    for yaw_rad in (0.0, 2.0):
        surface = pioneer.placed(scene, {"R1": Pose(0, 0, yaw_rad)})[0].surfaces[0]
        points = surface.vertices_m
        mast = points[:, 2] > 0.5
        north, south = points[:, 1] > 0.01, points[:, 1] < -0.01
        assert surface.shade[mast & north].mean() > surface.shade[mast & south].mean() + 0.1


def test_two_processes_build_the_same_robot() -> None:
    code = """
import hashlib, json
from vrchain.world.things import pioneer
surface = pioneer.build("R1")
arrays = (surface.vertices_m, surface.uv, surface.texture)
print(json.dumps(hashlib.sha256(b"".join(a.tobytes() for a in arrays)).hexdigest()))
"""
    surface = pioneer.build("R1")
    arrays = (surface.vertices_m, surface.uv, surface.texture)
    here = hashlib.sha256(b"".join(a.tobytes() for a in arrays)).hexdigest()
    assert worlds.in_two_processes(code) == [here, here]

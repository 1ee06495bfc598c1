"""Small worlds of textured boxes, made directly of the scene model, for tests."""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrchain.geometry import Pose
from vrchain.panorama import CameraRig
from vrchain.robot import Drive, Observation
from vrchain.seeding import generator
from vrchain.simulation.simulator import Simulator
from vrchain.world.model import Scene, SceneObject, Surface, place

SMALL_RIG = CameraRig(n_views=8, width_px=160, height_px=120)
ROOT = Path(__file__).resolve().parents[1]
RED, GREEN, BLUE, YELLOW = (220, 30, 30), (30, 200, 30), (30, 30, 220), (230, 220, 30)


def plain(rgb: tuple[int, int, int]) -> NDArray[np.uint8]:
    """A texture of one colour."""
    return np.full((8, 8, 3), rgb, dtype=np.uint8)


def blotches(name: str, size_px: int = 64, cells: int = 16) -> NDArray[np.uint8]:
    """A texture of random coloured squares, its own for every name."""
    colours = generator(0, "blotches", name).integers(30, 256, (cells, cells, 3), dtype=np.uint8)
    return np.kron(colours, np.ones((size_px // cells, size_px // cells, 1), dtype=np.uint8))


def quad(corners_m: list[tuple[float, float, float]], texture: NDArray[np.uint8]) -> Surface:
    """A rectangle; corners anticlockwise seen from its front, the texture's lower left first."""
    uv = [(0, 0), (1, 0), (1, 1), (0, 1)]
    return Surface(
        np.array(corners_m, dtype=np.float32),
        np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32),
        np.array(uv, dtype=np.float32),
        np.ones(4, dtype=np.float32),
        texture,
    )


def box(
    name: str,
    centre_xy_m: tuple[float, float],
    size_m: tuple[float, float, float],
    texture: NDArray[np.uint8],
    *,
    yaw_rad: float = 0.0,
    base_m: float = 0.0,
    landmark: bool = True,
    solid: bool = True,
) -> SceneObject:
    """A box standing on the ground (or at ``base_m``), the texture upright on its four sides."""
    x, y, low, high = size_m[0] / 2, size_m[1] / 2, base_m, base_m + size_m[2]
    ring = [(-x, -y), (x, -y), (x, y), (-x, y)]
    sides = [
        quad([(*a, low), (*b, low), (*b, high), (*a, high)], texture)
        for a, b in zip(ring, ring[1:] + ring[:1], strict=True)
    ]
    top = quad([(*p, high) for p in ring], texture)
    pose = Pose(*centre_xy_m, yaw_rad)
    return place(name, "box", name, [*sides, top], pose, landmark=landmark, solid=solid)


def ground(extent_m: tuple[float, float], rgb: tuple[int, int, int] = (90, 120, 70)) -> SceneObject:
    """A flat green floor."""
    x, y = extent_m[0] / 2, extent_m[1] / 2
    corners = [(-x, -y, 0.0), (x, -y, 0.0), (x, y, 0.0), (-x, y, 0.0)]
    surface = quad(corners, plain(rgb))
    return place(
        "ground", "ground", "ground", [surface], Pose(0.0, 0.0), landmark=False, solid=False
    )


def world(*objects: SceneObject, extent_m: tuple[float, float] = (40.0, 40.0)) -> Scene:
    """A ground with objects on it; the ground has object id 0."""
    return Scene("boxes", extent_m, (ground(extent_m), *objects))


def walled(x_m: float = 5.0, thickness_m: float = 0.02) -> Scene:
    """One long wall whose near side is at ``x_m``."""
    centre = (x_m + thickness_m / 2, 0.0)
    return world(box("wall", centre, (thickness_m, 38.0, 2.0), plain((120, 120, 120))))


def yard() -> Scene:
    """Twelve boxes with textures of their own, free around the middle."""
    boxes = []
    for i in range(12):
        draws = generator(3, "yard", i)
        angle, range_m = 2 * np.pi * i / 12 + draws.uniform(-0.1, 0.1), draws.uniform(7.0, 17.0)
        size = (draws.uniform(0.8, 3.0), draws.uniform(0.8, 3.0), draws.uniform(0.8, 3.5))
        centre = (range_m * np.cos(angle), range_m * np.sin(angle))
        name = f"box {i}"
        boxes.append(box(name, centre, size, blotches(name), yaw_rad=draws.uniform(0, np.pi)))
    return world(*boxes)


def maze() -> Scene:
    """A fenced field of walls, boxes and thin posts."""
    walls = [
        box("wall 0", (0.0, 4.0), (8.0, 0.1, 2.0), blotches("wall")),
        box("wall 1", (4.0, 0.0), (0.1, 5.0, 2.0), blotches("wall")),
        box("wall 2", (-6.0, -2.0), (0.1, 8.0, 2.0), blotches("wall"), yaw_rad=0.4),
        box("wall 3", (-2.0, -7.0), (6.0, 0.1, 0.6), blotches("wall")),
    ]
    posts = [
        box(f"post {i}", (3.0 * np.cos(i) + 6, 3.0 * np.sin(i) - 5), (0.1, 0.1, 1.2), plain(RED))
        for i in range(5)
    ]
    return world(*walls, *posts, extent_m=(20.0, 20.0))


class Body:
    """R1 in a simulator, as a mission drives it; it publishes nothing."""

    def __init__(self, simulator: Simulator) -> None:
        self.simulator = simulator

    def observe(self, look: bool = False, towards_rad: float | None = None) -> Observation:
        return self.simulator.observe("R1", look=look, towards_rad=towards_rad)

    def drive(self, command: Drive, duration_s: float) -> None:
        self.simulator.step({"R1": command}, duration_s)


def in_two_processes(code: str) -> list[Any]:
    """Run code, which prints one JSON object, in two fresh processes; what each of them printed."""
    path = os.pathsep.join([str(ROOT), str(ROOT / "tests")])
    started = [
        subprocess.Popen(
            [sys.executable, "-c", code],
            env={**os.environ, "PYTHONPATH": path, "PYTHONHASHSEED": hash_seed},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for hash_seed in ("1", "2")
    ]
    printed = [process.communicate() for process in started]
    for process, (_, complaint) in zip(started, printed, strict=True):
        assert process.returncode == 0, complaint
    return [json.loads(output) for output, _ in printed]

"""What robots see, made up: matched directions of known points, and looks around a small yard."""

from dataclasses import dataclass
from functools import cache

import numpy as np
import worlds
from numpy.typing import NDArray

from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.landmarks.extraction.sift import Features, extract
from vrchain.panorama import CameraRig, Panorama
from vrchain.seeding import generator
from vrchain.world.model import Scene
from vrchain.world.render import Renderer
from vrchain.world.truth import GroundTruth

Array = NDArray[np.float64]
RIG = CameraRig(n_views=8, width_px=320, height_px=240)  # enough for SIFT, and quick
CAMERA_HEIGHT_M = 1.0


@dataclass(frozen=True, eq=False)
class TwoViews:
    """Matched directions of points as A (at the origin) and B see them, (n, 2) each."""

    pose_b: Pose
    points_m: Array
    good: NDArray[np.bool_]  # not an outlier
    a: Array
    b: Array

    @property
    def matches(self) -> tuple[Array, Array]:
        return self.a, self.b

    @property
    def direction_rad(self) -> float:
        return Pose(0, 0).bearing_to_rad(self.pose_b.xy_m)


def directions(pose: Pose, points_m: Array) -> tuple[Array, Array]:
    """Bearings and slopes of points, (n, 3), from a pose."""
    offset = points_m[:, :2] - pose.xy_m
    bearing = wrap_angle_rad(np.arctan2(offset[:, 1], offset[:, 0]) - pose.yaw_rad)
    return bearing, (points_m[:, 2] - CAMERA_HEIGHT_M) / np.hypot(*offset.T)


def two_views(
    pose_b: Pose, n: int = 100, noise_rad: float = 0.0, outliers: float = 0.0, seed: int = 0
) -> TwoViews:
    """Random points, 3-25 m from A and 1 m and more from B, 0-4 m high; some matched wrongly."""
    draws = generator(seed, "two views")
    angle, range_m = draws.uniform(-np.pi, np.pi, 4 * n), draws.uniform(3, 25, 4 * n)
    height = draws.uniform(0, 4, 4 * n)
    points = np.stack([range_m * np.cos(angle), range_m * np.sin(angle), height], axis=1)
    points = points[np.linalg.norm(points[:, :2] - pose_b.xy_m, axis=1) > 1][:n]
    views = [*directions(Pose(0, 0), points), *directions(pose_b, points)]
    views = [v + draws.normal(0, noise_rad, n) for v in views]
    good = draws.permutation(n) >= round(outliers * n)
    views[2] = np.where(good, views[2], draws.uniform(-np.pi, np.pi, n))
    views[3] = np.where(good, views[3], draws.uniform(-0.35, 0.35, n))
    a, b = (np.column_stack([wrap_angle_rad(views[k]), views[k + 1]]) for k in (0, 2))
    return TwoViews(pose_b, points, good, a, b)


def descriptors(n: int, *names: str | int) -> NDArray[np.uint8]:
    """Descriptors that are nothing like one another, (n, 128)."""
    return generator(0, "descriptors", *names).integers(0, 180, (n, 128), dtype=np.uint8)


def features_of(bearing_rad: Array, slope: Array, coded: NDArray[np.uint8]) -> Features:
    """Features of one small size."""
    return Features(bearing_rad, slope, np.full(len(bearing_rad), 0.01), coded)


@cache
def yard() -> Scene:
    return worlds.yard()


@cache
def yard_truth() -> GroundTruth:
    return GroundTruth(yard())


@cache
def _renderer(scene: Scene) -> Renderer:
    return Renderer(scene)


@cache
def look(pose: Pose, rig: CameraRig = RIG, scene: Scene | None = None) -> Panorama:
    """What is seen of a scene, the yard if none is named."""
    return _renderer(scene or yard()).render(pose, rig)


@cache
def sight(pose: Pose, rig: CameraRig = RIG, scene: Scene | None = None) -> Features:
    """The features of ``look``."""
    return extract(look(pose, rig, scene))


def boxes(name: str, n: int = 10, span_m: tuple[float, float] = (6.0, 16.0)) -> Scene:
    """A world like the yard, of other boxes in other places for every name."""
    made = []
    for i in range(n):
        draws = generator(0, "boxes", name, i)
        angle, range_m = 2 * np.pi * i / n + draws.uniform(-0.2, 0.2), draws.uniform(*span_m)
        centre = (float(range_m * np.cos(angle)), float(range_m * np.sin(angle)))
        size = (draws.uniform(1, 3), draws.uniform(1, 3), draws.uniform(1, 3.5))
        own = f"{name} {i}"
        made.append(worlds.box(own, centre, size, worlds.blotches(own), yaw_rad=angle))
    return worlds.world(*made)

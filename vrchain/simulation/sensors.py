"""What a robot's sensors measure, and their noise: odometry and the ring of ranges."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.robot import beams_rad
from vrchain.world.model import ROBOT_RADIUS_M, Scene
from vrchain.world.truth import GroundTruth

N_BEAMS = 72
RANGE_MAX_M = 8.0
RANGE_HEIGHT_M = 0.3


@dataclass(frozen=True)
class SensorNoise:
    """Standard deviations. Odometry errs with motion only: at rest it does not drift.

    That skid steering slips in a turn is part of ``turn_rad``.
    """

    range_m: float = 0.02  # a reading of the range ring
    scale: float = 0.01  # a robot's constant error of distance, as a share
    veer_rad_m: float = 0.002  # a robot's constant veer, a metre driven
    distance_m: float = 0.01  # distance, after one metre; grows with the root of the way
    turn_rad: float = 0.01  # yaw, after one radian turned; grows with the root of the turn


class Odometry:
    """A robot's estimate of its pose: a constant error of each robot and a random walk."""

    def __init__(self, noise: SensorNoise, draws: np.random.Generator) -> None:
        self.pose = Pose(0.0, 0.0)
        self._noise, self._draws = noise, draws
        scale, self._veer_rad_m = draws.normal(0.0, [noise.scale, noise.veer_rad_m])
        self._scale = 1 + scale

    def move(self, way_m: float, turn_rad: float) -> None:
        """Measure a motion."""
        jitter, twist = self._draws.normal(size=2)
        measured_m = self._scale * way_m + self._noise.distance_m * np.sqrt(abs(way_m)) * jitter
        measured_rad = turn_rad + self._veer_rad_m * way_m
        measured_rad += self._noise.turn_rad * np.sqrt(abs(turn_rad)) * twist
        before = self.pose
        heading = before.yaw_rad + measured_rad / 2
        self.pose = Pose(
            float(before.x_m + measured_m * np.cos(heading)),
            float(before.y_m + measured_m * np.sin(heading)),
            float(wrap_angle_rad(before.yaw_rad + measured_rad)),
        )


class RangeRing:
    """Ranges all around a robot: to things, other robots and the map's edge.

    What a ray at ``RANGE_HEIGHT_M`` meets, or the outline of anything that could stop the robot
    (a car's overhang, say), whichever is nearer: like a scanner of many layers, flattened.
    """

    def __init__(self, scene: Scene, truth: GroundTruth) -> None:
        self._half_m, self._truth = np.array(scene.extent_m) / 2, truth
        lines = []
        for part in (p for o in scene.objects if o.solid for p in shapely.get_parts(o.footprint)):
            polygon = isinstance(part, shapely.Polygon)  # with its holes; else as it is
            lines += [*shapely.get_rings(part)] if polygon else [part]
        corners = [shapely.get_coordinates(line) for line in lines]
        sides = (np.stack([c[:-1], c[1:]], axis=1) for c in corners)
        self._sides = np.concatenate([np.empty((0, 2, 2)), *sides])  # start and end of each
        self._tree = shapely.STRtree(shapely.linestrings(self._sides))

    def ranges_m(self, pose: Pose, others: Iterable[Pose]) -> NDArray[np.float64]:
        """The ranges without noise, (N_BEAMS,) float, at most ``RANGE_MAX_M``."""
        angle = pose.yaw_rad + beams_rad(N_BEAMS)
        rays = np.stack([np.cos(angle), np.sin(angle), np.zeros(N_BEAMS)], axis=1)
        _, hit_m = self._truth.cast([pose.x_m, pose.y_m, RANGE_HEIGHT_M], rays)
        rays = rays[:, :2]
        with np.errstate(divide="ignore"):
            to_edge_m = (np.copysign(self._half_m, rays) - pose.xy_m) / rays
        ring = np.minimum(hit_m.astype(float), np.abs(to_edge_m).min(axis=1))
        here = shapely.Point(pose.xy_m)
        near = self._tree.query(here, predicate="dwithin", distance=RANGE_MAX_M)
        ring = np.minimum(ring, _to_sides_m(self._sides[near] - pose.xy_m, rays))
        for other in others:
            ring = np.minimum(ring, _to_disc_m(other.xy_m - pose.xy_m, rays))
        return np.minimum(ring, RANGE_MAX_M)


def _to_sides_m(
    sides_xy_m: NDArray[np.float64], rays_xy: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Distances along unit rays from the origin to line segments, (n, 2, 2), inf where none is."""
    start, along = sides_xy_m[:, 0], sides_xy_m[:, 1] - sides_xy_m[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        facing = _cross(rays_xy[:, None], along)
        range_m = _cross(start, along) / facing
        share = _cross(start, rays_xy[:, None]) / facing
    hits = (range_m >= 0) & (share >= 0) & (share <= 1)
    return np.where(hits, range_m, np.inf).min(axis=1, initial=np.inf)


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _to_disc_m(
    offset_xy_m: NDArray[np.float64], rays_xy: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Distances along unit rays from the origin to a robot's circle, inf where they miss it."""
    along = rays_xy @ offset_xy_m
    miss_sq = offset_xy_m @ offset_xy_m - along**2
    inside = np.maximum(ROBOT_RADIUS_M**2 - miss_sq, 0.0)
    hits = (miss_sq < ROBOT_RADIUS_M**2) & (along > 0)
    return np.where(hits, along - np.sqrt(inside), np.inf)

"""The world that robots drive in: kinematics, sensors and their noise, collisions, the clock.

It alone knows where the robots truly are; a robot is given an ``Observation``.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely
from numpy.typing import NDArray

from vrchain.errors import MissionError, PoseError
from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.panorama import CameraRig
from vrchain.robot import MAX_SPEED_M_S, MAX_TURN_RAD_S, STOP, Drive, Observation, beams_rad
from vrchain.seeding import generator
from vrchain.world.model import ROBOT_RADIUS_M, Scene
from vrchain.world.render import Renderer
from vrchain.world.truth import GroundTruth

N_BEAMS = 72
RANGE_MAX_M = 8.0
RANGE_HEIGHT_M = 0.3
_SUBSTEP_S = 0.025  # at most 1.75 cm of way between two looks for contacts
_PARTED_M = 0.05  # a contact is over once the robot is this far clear


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


@dataclass(eq=False)
class _Body:
    """The truth about one robot."""

    pose: Pose
    odometry: Pose
    drift: np.random.Generator
    scale: float
    veer_rad_m: float
    path: list[tuple[float, float]]
    bumped: bool = False
    touching: bool = False
    collisions: int = 0


class Simulator:
    """Robots in a scene. The same seed and commands give the same bytes.

    poses: where each robot starts; PoseError if it cannot stand there. The map's edge is a wall.
    """

    def __init__(
        self,
        scene: Scene,
        poses: Mapping[str, Pose],
        *,
        seed: int,
        rig: CameraRig | None = None,
        noise: SensorNoise | None = None,
    ) -> None:
        self.scene, self.seed = scene, seed
        self.rig, self.noise = rig or CameraRig(), noise or SensorNoise()
        self.clock_ns = 0
        self._steps_ns = [0]
        self._bodies: dict[str, _Body] = {}
        for name, pose in poses.items():
            self.put(name, pose)

    def put(self, name: str, pose: Pose) -> None:
        """Put one more robot into the scene; PoseError if it cannot stand there."""
        self.scene.check_pose(pose)
        for other, body in self._bodies.items():
            if pose.distance_to_m(body.pose.xy_m) <= 2 * ROBOT_RADIUS_M:
                raise PoseError(
                    f"robots {other!r} and {name!r} start in one place: "
                    f"keep them more than {2 * ROBOT_RADIUS_M:g} m apart"
                )
        drift = generator(self.seed, "odometry", name)
        scale, veer = drift.normal(0.0, [self.noise.scale, self.noise.veer_rad_m])
        path = [(pose.x_m, pose.y_m)]
        self._bodies[name] = _Body(pose, Pose(0.0, 0.0), drift, 1 + scale, veer, path)

    @cached_property
    def truth(self) -> GroundTruth:
        """The scene's ray caster, made on first use; it sees robots only if they are passed."""
        return GroundTruth(self.scene)

    @cached_property
    def renderer(self) -> Renderer:
        """The scene's renderer, made on first use."""
        return Renderer(self.scene)

    @property
    def robots(self) -> tuple[str, ...]:
        """The robots' names, in the order given."""
        return tuple(self._bodies)

    def others(self, robot: str) -> dict[str, Pose]:
        """Where all but this robot truly are, as ``truth`` and ``renderer`` take them."""
        own = self._body(robot)
        return {name: body.pose for name, body in self._bodies.items() if body is not own}

    def pose(self, robot: str) -> Pose:
        """Where the robot truly is."""
        return self._body(robot).pose

    def path_xy_m(self, robot: str) -> NDArray[np.float64]:
        """True positions at the start and after every step, (n, 2) float."""
        return np.array(self._body(robot).path)

    @property
    def times_s(self) -> NDArray[np.float64]:
        """When those positions were, (n,) float, of a robot that was there from the start."""
        return np.array(self._steps_ns) / 1e9

    def collisions(self, robot: str) -> int:
        """How often the robot has driven into something; once a contact, however long it pushes."""
        return self._body(robot).collisions

    def step(self, commands: Mapping[str, Drive], duration_s: float) -> None:
        """Let ``duration_s`` pass; robots without a command stand still.

        Commands beyond a Pioneer P3-AT's speed are cut to it.
        """
        if not (np.isfinite(duration_s) and duration_s > 0):
            raise ValueError(f"expected a duration above 0 s, got {duration_s!r}")
        drives = {self._body(name): _clipped(name, drive) for name, drive in commands.items()}
        moving = [b for b in self._bodies.values() if drives.get(b, STOP) != STOP]
        for body in self._bodies.values():
            body.bumped = False
        n_substeps = int(np.ceil(duration_s / _SUBSTEP_S - 1e-9))
        for _ in range(n_substeps):
            for body in moving:
                self._move(body, drives[body], duration_s / n_substeps)
        for body in self._bodies.values():
            body.path.append((body.pose.x_m, body.pose.y_m))
        self.clock_ns += round(duration_s * 1e9)
        self._steps_ns.append(self.clock_ns)

    def observe(
        self, robot: str, *, look: bool = False, towards_rad: float | None = None
    ) -> Observation:
        """What the robot senses now, with a panorama if it looks. Asking twice changes nothing.

        The others are in the panorama; its own mast and body are not, as if masked out.
        towards_rad: look with one camera alone, that whose view shows most around a bearing.
        """
        body = self._body(robot)
        others = self.others(robot)
        panorama = self.renderer.render(body.pose, self.rig, others) if look else None
        view_rad = None
        if towards_rad is not None and not look:
            view_rad = float(self.rig.azimuths_rad[self.rig.view_of_bearing(towards_rad)])
            yaw_rad = float(wrap_angle_rad(body.pose.yaw_rad + view_rad))
            eye = replace(body.pose, yaw_rad=yaw_rad)
            panorama = self.renderer.render(eye, replace(self.rig, n_views=1), others)
        ring = self.true_ranges_m(robot)
        draws = generator(self.seed, "range", robot, self.clock_ns)
        noisy = ring + draws.normal(0.0, self.noise.range_m, N_BEAMS)
        noisy = np.where(ring < RANGE_MAX_M, np.clip(noisy, 0.0, RANGE_MAX_M), RANGE_MAX_M)
        return Observation(self.clock_ns, body.odometry, noisy, body.bumped, panorama, view_rad)

    def true_ranges_m(self, robot: str) -> NDArray[np.float64]:
        """The range ring without noise, (N_BEAMS,) float: things, other robots, the map's edge.

        What a ray at ``RANGE_HEIGHT_M`` meets, or the outline of anything that could stop the robot
        (a car's overhang, say), whichever is nearer: like a scanner of many layers, flattened.
        """
        body = self._body(robot)
        angle = body.pose.yaw_rad + beams_rad(N_BEAMS)
        rays = np.stack([np.cos(angle), np.sin(angle), np.zeros(N_BEAMS)], axis=1)
        _, hit_m = self.truth.cast([body.pose.x_m, body.pose.y_m, RANGE_HEIGHT_M], rays)
        ring = np.minimum(hit_m.astype(float), self._ranges_to_edge_m(body.pose, rays[:, :2]))
        ring = np.minimum(ring, self._ranges_to_outlines_m(body.pose, rays[:, :2]))
        for other in self._bodies.values():
            if other is not body:
                offset = other.pose.xy_m - body.pose.xy_m
                ring = np.minimum(ring, _ranges_to_disc_m(offset, rays[:, :2]))
        return np.minimum(ring, RANGE_MAX_M)

    def _body(self, robot: str) -> _Body:
        if robot not in self._bodies:
            known = ", ".join(map(repr, self._bodies)) or "none"
            raise MissionError(f"there is no robot {robot!r}; the robots are {known}")
        return self._bodies[robot]

    def _move(self, body: _Body, drive: Drive, duration_s: float) -> None:
        """One substep: an arc, taken as its chord, unless something is in the way."""
        pose, turn_rad = body.pose, drive.turn_rad_s * duration_s
        way_m = drive.speed_m_s * duration_s
        heading = pose.yaw_rad + turn_rad / 2
        target = pose.xy_m + way_m * np.array([np.cos(heading), np.sin(heading)])
        if way_m and not self._is_free(body, target, ROBOT_RADIUS_M):
            body.collisions += not body.touching
            body.touching = body.bumped = True
            target, way_m = pose.xy_m, 0.0
        elif body.touching and self._is_free(body, target, ROBOT_RADIUS_M + _PARTED_M):
            body.touching = False
        yaw = float(wrap_angle_rad(pose.yaw_rad + turn_rad))
        body.pose = Pose(float(target[0]), float(target[1]), yaw)
        body.odometry = self._estimate(body, way_m, turn_rad)

    def _is_free(self, body: _Body, xy_m: NDArray[np.float64], radius_m: float) -> bool:
        others = [o.pose.distance_to_m(xy_m) for o in self._bodies.values() if o is not body]
        apart = all(d > ROBOT_RADIUS_M + radius_m for d in others)
        return apart and bool(self.scene.is_free(xy_m, radius_m)[0])

    def _estimate(self, body: _Body, way_m: float, turn_rad: float) -> Pose:
        """Odometry after a motion: a constant error of each robot and a random walk."""
        jitter, twist = body.drift.normal(size=2)
        measured_m = body.scale * way_m + self.noise.distance_m * np.sqrt(abs(way_m)) * jitter
        measured_rad = turn_rad + body.veer_rad_m * way_m
        measured_rad += self.noise.turn_rad * np.sqrt(abs(turn_rad)) * twist
        heading = body.odometry.yaw_rad + measured_rad / 2
        return Pose(
            float(body.odometry.x_m + measured_m * np.cos(heading)),
            float(body.odometry.y_m + measured_m * np.sin(heading)),
            float(wrap_angle_rad(body.odometry.yaw_rad + measured_rad)),
        )

    @cached_property
    def _outlines(self) -> tuple[NDArray[np.float64], shapely.STRtree]:
        """Sides of the solid footprints, (n, 2, 2) float: start and end; and an index of them."""
        sides = [np.empty((0, 2, 2))]
        for obj in self.scene.objects:
            if obj.solid:
                for line in _lines_of(obj.footprint):
                    corners = shapely.get_coordinates(line)
                    sides.append(np.stack([corners[:-1], corners[1:]], axis=1))
        joined = np.concatenate(sides)
        return joined, shapely.STRtree(shapely.linestrings(joined))

    def _ranges_to_outlines_m(
        self, pose: Pose, rays_xy: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        sides, tree = self._outlines
        near = tree.query(shapely.Point(pose.xy_m), predicate="dwithin", distance=RANGE_MAX_M)
        return _ranges_to_sides_m(sides[near] - pose.xy_m, rays_xy)

    def _ranges_to_edge_m(self, pose: Pose, rays_xy: NDArray[np.float64]) -> NDArray[np.float64]:
        half = np.array(self.scene.extent_m) / 2
        with np.errstate(divide="ignore"):
            steps = (np.copysign(half, rays_xy) - pose.xy_m) / rays_xy
        return np.abs(steps).min(axis=1)


def _lines_of(footprint: shapely.Geometry) -> Iterator[shapely.Geometry]:
    """The outlines of a footprint's polygons, and of their holes; what is no polygon as it is."""
    for part in shapely.get_parts(footprint):
        yield from shapely.get_rings(part) if isinstance(part, shapely.Polygon) else [part]


def _clipped(name: str, drive: Drive) -> Drive:
    if not np.isfinite([drive.speed_m_s, drive.turn_rad_s]).all():
        raise ValueError(f"robot {name!r}: expected a finite speed and turn, got {drive}")
    speed = min(max(drive.speed_m_s, -MAX_SPEED_M_S), MAX_SPEED_M_S)
    return Drive(speed, min(max(drive.turn_rad_s, -MAX_TURN_RAD_S), MAX_TURN_RAD_S))


def _ranges_to_sides_m(
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


def _ranges_to_disc_m(
    offset_xy_m: NDArray[np.float64], rays_xy: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Distances along unit rays from the origin to a robot's circle, inf where they miss it."""
    along = rays_xy @ offset_xy_m
    miss_sq = offset_xy_m @ offset_xy_m - along**2
    inside = np.maximum(ROBOT_RADIUS_M**2 - miss_sq, 0.0)
    hits = (miss_sq < ROBOT_RADIUS_M**2) & (along > 0)
    return np.where(hits, along - np.sqrt(inside), np.inf)

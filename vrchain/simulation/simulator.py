"""The world that robots drive in: kinematics, collisions, the clock, and what each robot senses.

It alone knows where the robots truly are; a robot is given an ``Observation``. The noise of its
sensors is in ``sensors``.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from vrchain.errors import MissionError, PoseError
from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.panorama import CameraRig
from vrchain.robot import MAX_SPEED_M_S, MAX_TURN_RAD_S, STOP, Drive, Observation
from vrchain.seeding import generator
from vrchain.simulation.sensors import N_BEAMS, RANGE_MAX_M, Odometry, RangeRing, SensorNoise
from vrchain.world.model import ROBOT_RADIUS_M, Scene
from vrchain.world.render import Renderer
from vrchain.world.truth import GroundTruth

Trajectory: TypeAlias = tuple[tuple[int, Pose], ...]  # when, in ns, and where
_SUBSTEP_S = 0.025  # at most 1.75 cm of way between two looks for contacts
_PARTED_M = 0.05  # a contact is over once the robot is this far clear


@dataclass(eq=False)
class _Body:
    """The truth about one robot, and its odometry."""

    pose: Pose
    odometry: Odometry
    path: list[tuple[Pose, Pose]]  # and where it is by odometry
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
        odometry = Odometry(self.noise, generator(self.seed, "odometry", name))
        self._bodies[name] = _Body(pose, odometry, [(pose, odometry.pose)])

    @cached_property
    def truth(self) -> GroundTruth:
        """The scene's ray caster, made on first use; it sees robots only if they are passed."""
        return GroundTruth(self.scene)

    @cached_property
    def renderer(self) -> Renderer:
        """The scene's renderer, made on first use."""
        return Renderer(self.scene)

    @cached_property
    def _range_ring(self) -> RangeRing:
        return RangeRing(self.scene, self.truth)

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
        return np.array([pose.xy_m for pose, _ in self._body(robot).path])

    def trajectories(self, robot: str) -> tuple[Trajectory, Trajectory]:
        """When and where it was at the start and after every step: truly, and by odometry."""
        path = self._body(robot).path
        times_ns = self._steps_ns[-len(path) :]
        true, told = zip(*path, strict=True)
        return tuple(zip(times_ns, true, strict=True)), tuple(zip(times_ns, told, strict=True))

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
            body.path.append((body.pose, body.odometry.pose))
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
        odometry = body.odometry.pose
        return Observation(self.clock_ns, odometry, noisy, body.bumped, panorama, view_rad)

    def true_ranges_m(self, robot: str) -> NDArray[np.float64]:
        """The range ring without noise, (N_BEAMS,) float: things, other robots, the map's edge."""
        return self._range_ring.ranges_m(self.pose(robot), self.others(robot).values())

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
        body.odometry.move(way_m, turn_rad)

    def _is_free(self, body: _Body, xy_m: NDArray[np.float64], radius_m: float) -> bool:
        others = [o.pose.distance_to_m(xy_m) for o in self._bodies.values() if o is not body]
        apart = all(d > ROBOT_RADIUS_M + radius_m for d in others)
        return apart and bool(self.scene.is_free(xy_m, radius_m)[0])


def _clipped(name: str, drive: Drive) -> Drive:
    if not np.isfinite([drive.speed_m_s, drive.turn_rad_s]).all():
        raise ValueError(f"robot {name!r}: expected a finite speed and turn, got {drive}")
    speed = min(max(drive.speed_m_s, -MAX_SPEED_M_S), MAX_SPEED_M_S)
    return Drive(speed, min(max(drive.turn_rad_s, -MAX_TURN_RAD_S), MAX_TURN_RAD_S))

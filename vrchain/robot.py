"""What a robot decides by itself: when it publishes, and how it drives without hitting things.

It knows an ``Observation`` and nothing else: no map, no coordinates, no names of things.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vrchain.errors import SpecError
from vrchain.geometry import Pose, relative, wrap_angle_rad
from vrchain.panorama import Panorama, view_change

MAX_SPEED_M_S = 0.7  # a Pioneer P3-AT's limits
MAX_TURN_RAD_S = float(np.radians(140.0))

# Half the width that is free along a heading, and for how far; less will do in a squeeze.
_CORRIDOR_RADIUS_M, _LOOK_AHEAD_M = 0.5, 1.5
_SQUEEZE_RADIUS_M, _SQUEEZE_LOOK_AHEAD_M = 0.43, 0.5
_STOP_MARGIN_M = 0.1
_BRAKE_PER_S = 0.9  # speed for each metre free ahead
_TURN_PER_S = 1.5  # turn rate for each radian off
_TURN_ON_SPOT_RAD = float(np.radians(50.0))
_SEARCH_TURN_RAD_S = 1.0
_KEEP_HEADING = 0.25  # weight of going straight ahead against going where desired
_CAME_M = 0.1  # into what was free: five standard deviations of a reading
_ABEAM_RAD = float(np.radians(100.0))  # what comes from farther behind minds the robot
_HEADING_STEPS = 72
UNSEEN_M = 0.0  # of a range ring where no sensor looks: not free, and nothing that was met
_NEW_M = 15.0  # so far ahead a wandering robot minds where it has been

Rule = Literal["start", "distance", "view", "time"]


@dataclass(frozen=True)
class Observation:
    """All that a robot senses at one moment.

    odometry: its own estimate of its pose, in the frame in which it started at (0, 0, 0).
    range_ring_m: (n_beams,) float; beam i points along bearing 2 * pi * i / n_beams; readings end
    at the sensor's reach, and are ``UNSEEN_M`` where none looks. bumped: the last motion ended in a
    contact. panorama: if it looked.
    view_rad: the bearing that the panorama's camera looks along, if it is a single camera's view.
    """

    time_ns: int
    odometry: Pose
    range_ring_m: NDArray[np.float64]
    bumped: bool = False
    panorama: Panorama | None = None
    view_rad: float | None = None


@dataclass(frozen=True)
class Drive:
    """A command: metres a second ahead, radians a second anticlockwise."""

    speed_m_s: float = 0.0
    turn_rad_s: float = 0.0


STOP = Drive()


@dataclass(frozen=True)
class UpdateRules:
    """When a robot publishes again, as Rahouti, Lyons and Santana (2022) have it."""

    distance_m: float = 5.0  # driven since the last publication, by odometry
    view_change: float = 0.5  # of the panorama since then; in a suburb, 3 to 10 m of way
    max_age_s: float = 60.0  # of the last publication

    def __post_init__(self) -> None:
        for key in ("distance_m", "view_change", "max_age_s"):
            value = getattr(self, key)
            if not isinstance(value, int | float) or not value > 0:
                raise SpecError(f"update rules: {key} must be a number above 0, got {value!r}")


class UpdateMonitor:
    """Tells whether to publish, and by which rule.

    It is shown every observation, so that it knows the way driven.
    """

    def __init__(self, rules: UpdateRules | None = None) -> None:
        self.rules = rules or UpdateRules()
        self.travelled_m = 0.0  # since the last publication
        self._here: Pose | None = None
        self._last: Observation | None = None
        self._signature: NDArray[np.float32] | None = None

    def due(self, observation: Observation) -> Rule | None:
        """The rule that calls for a publication now; "view" can fire only if the robot looked."""
        if self._here is not None:
            self.travelled_m += self._here.distance_to_m(observation.odometry.xy_m)
        self._here = observation.odometry
        if self._last is None:
            return "start"
        if self.travelled_m >= self.rules.distance_m:
            return "distance"
        if observation.panorama is not None and self._signature is not None:
            change = view_change(self._signature, observation.panorama.signature())
            if change >= self.rules.view_change:
                return "view"
        if observation.time_ns - self._last.time_ns >= self.rules.max_age_s * 1e9:
            return "time"
        return None

    def published(self, observation: Observation) -> None:
        """Count anew from this observation, which has just been published."""
        self._here, self._last, self.travelled_m = observation.odometry, observation, 0.0
        panorama = observation.panorama
        self._signature = None if panorama is None else panorama.signature()


def beams_rad(n_beams: int) -> NDArray[np.float64]:
    """Bearings along which the beams of a range ring point, (n_beams,) float."""
    return 2 * np.pi * np.arange(n_beams) / n_beams


def free_distances_m(
    range_ring_m: ArrayLike, bearings_rad: ArrayLike, radius_m: float = _CORRIDOR_RADIUS_M
) -> NDArray[np.float64]:
    """How far a disc of ``radius_m`` could go straight along each bearing, (n,) float.

    Every reading counts as a thing, those at the sensor's reach too. A thing that is already inside
    the disc stops only what leads towards it. Where no sensor looks, nothing is free.
    """
    ring = np.asarray(range_ring_m, dtype=float)
    beams, bearings = beams_rad(len(ring)), np.atleast_1d(np.asarray(bearings_rad, dtype=float))
    angle = beams[None, :] - bearings[:, None]
    forward, lateral = ring * np.cos(angle), ring * np.sin(angle)
    in_the_way = (np.abs(lateral) < radius_m) & (forward > 0)
    until = forward - np.sqrt(np.maximum(radius_m**2 - lateral**2, 0.0))
    reach = np.where(in_the_way, until, np.inf).min(axis=1)
    nearest = np.round(bearings / (2 * np.pi / len(ring))).astype(int) % len(ring)
    reach = np.where(ring[nearest] == UNSEEN_M, 0.0, reach)
    return np.clip(reach, 0.0, ring.max())


def free_bearing_rad(desired_bearing_rad: float, range_ring_m: ArrayLike) -> float | None:
    """The free bearing nearest to the desired one, None if none is free.

    Free: the robot's width fits along it for 1.5 m; if there is none, a narrower and shorter
    corridor will do. Bearings near the heading are preferred a little, so that the robot does not
    dither. A vector field histogram (Borenstein and Koren, 1991) without its grid.
    """
    steps = np.arange(_HEADING_STEPS) - _HEADING_STEPS // 2
    bearings = wrap_angle_rad(desired_bearing_rad + steps * 2 * np.pi / _HEADING_STEPS)
    detour = np.abs(wrap_angle_rad(bearings - desired_bearing_rad))
    cost = detour + _KEEP_HEADING * np.abs(wrap_angle_rad(bearings))
    for radius_m, ahead_m in (
        (_CORRIDOR_RADIUS_M, _LOOK_AHEAD_M),
        (_SQUEEZE_RADIUS_M, _SQUEEZE_LOOK_AHEAD_M),
    ):
        free = free_distances_m(range_ring_m, bearings, radius_m) >= ahead_m
        if free.any():
            return float(bearings[np.argmin(np.where(free, cost, np.inf))])
    return None


def newcomer_m(before: Observation, now: Observation) -> float:
    """How near is what has come to where the earlier range ring shows nothing; inf: nothing has.

    Ahead or abeam. Where a beam went on before, and ends now, something has driven in; what fits
    between two beams may seem to.
    """
    ring, earlier = now.range_ring_m, before.range_ring_m
    beams, apart = beams_rad(len(ring)), 2 * np.pi / len(earlier)
    moved = relative(before.odometry, now.odometry)
    x_m = moved.x_m + ring * np.cos(beams + moved.yaw_rad)
    y_m = moved.y_m + ring * np.sin(beams + moved.yaw_rad)
    beside = np.floor(np.arctan2(y_m, x_m) / apart).astype(int) % len(earlier)
    free_m = np.minimum(earlier[beside], earlier[(beside + 1) % len(earlier)])
    came = np.hypot(x_m, y_m) < free_m - _CAME_M
    came &= (np.abs(wrap_angle_rad(beams)) < _ABEAM_RAD) & (ring != UNSEEN_M)
    return float(ring[came].min(initial=np.inf))


def steer(desired_bearing_rad: float, range_ring_m: ArrayLike) -> Drive:
    """Drive towards a bearing, round what the range ring shows; turn on the spot if shut in."""
    bearing = free_bearing_rad(desired_bearing_rad, range_ring_m)
    if bearing is None:
        return Drive(0.0, _SEARCH_TURN_RAD_S)
    turn = float(np.clip(_TURN_PER_S * bearing, -MAX_TURN_RAD_S, MAX_TURN_RAD_S))
    if abs(bearing) > _TURN_ON_SPOT_RAD:
        return Drive(0.0, turn)
    ahead_m = free_distances_m(range_ring_m, 0.0, _SQUEEZE_RADIUS_M)[0]
    safe_m_s = _BRAKE_PER_S * max(0.0, ahead_m - _STOP_MARGIN_M)
    return Drive(float(min(MAX_SPEED_M_S, safe_m_s) * np.cos(bearing) ** 2), turn)


@dataclass(frozen=True)
class Wander:
    """What a wandering robot has in mind: a heading in its odometry frame, and until when."""

    heading_rad: float = 0.0
    until_ns: int = 0


def wander(
    observation: Observation,
    generator: np.random.Generator,
    state: Wander = Wander(),
    been_xy_m: NDArray[np.float64] | None = None,
) -> tuple[Drive, Wander]:
    """Drive at random: keep a heading for 8-25 s, or until it is blocked, then draw another.

    been_xy_m: (n, 2) places, by odometry, from which it rather drives away.
    """
    ring, yaw_rad = observation.range_ring_m, observation.odometry.yaw_rad
    bearing = float(wrap_angle_rad(state.heading_rad - yaw_rad))
    over = observation.time_ns >= state.until_ns or observation.bumped
    if over or free_distances_m(ring, bearing)[0] < _SQUEEZE_LOOK_AHEAD_M:
        choices = wrap_angle_rad(2 * np.pi * np.arange(_HEADING_STEPS) / _HEADING_STEPS)
        room_m = free_distances_m(ring, choices) - _SQUEEZE_LOOK_AHEAD_M
        weights = np.clip(room_m, 0.0, 4.0) ** 2 + 1e-6
        if been_xy_m is not None:
            course = yaw_rad + choices
            ahead = _NEW_M * np.stack([np.cos(course), np.sin(course)], axis=1)
            apart = (observation.odometry.xy_m + ahead)[:, None] - been_xy_m
            new_m = np.hypot(*apart.transpose(2, 0, 1)).min(axis=1)
            weights = weights * np.clip(new_m / _NEW_M, 0.05, 1.0) ** 2
        if observation.bumped:  # whatever it was, it is ahead, even if the ring does not show it
            weights = weights * (np.cos(choices) < 0) + 1e-9
        bearing = float(generator.choice(choices, p=weights / weights.sum()))
        keep_ns = int(generator.uniform(8.0, 25.0) * 1e9)
        state = Wander(float(wrap_angle_rad(yaw_rad + bearing)), observation.time_ns + keep_ns)
    return steer(bearing, ring), state

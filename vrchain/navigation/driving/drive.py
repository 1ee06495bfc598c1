"""Driving and looking: to a place by odometry, around what the range ring shows."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import pdist

from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.navigation.driving.estimates import Array, Estimate
from vrchain.navigation.driving.obstacles import REACH_M, ObstacleMap
from vrchain.navigation.perception import Look, Perception
from vrchain.navigation.settings import Body, GaveUp, MissionConfig
from vrchain.panorama import Panorama
from vrchain.robot import UNSEEN_M, Observation, beams_rad, newcomer_m, steer
from vrchain.seeding import generator

_HEADWAY_M = 0.5  # of way, without which a robot is stuck
_LINGERS_M, _LINGERS_S = 2.0, 40.0  # back and forth within so much, for so long: stuck too
_TICKS = 3  # of steering between two searches for a path
_YIELDS_M = 1.5  # to what drives so near: steering minds only what is ahead
_SOON_S, _WAITS_S = 2.0, (0.3, 2.0)  # who yields again so soon waits for a time between these
_SLOW_M_S = 0.4  # an approach that is slower leads astray
_ONE_SURFACE_M = 1.0  # neighbouring beams that end no farther apart meet one surface


class Pilot:
    """A robot's body and perception, what it has met and looked at, and its clock.

    now: what it sensed last; looks: the panoramas of all looks around, kept as evidence, and
    looked: from where they were taken, and what they show. Places are in the odometry's frame.
    """

    def __init__(self, body: Body, perception: Perception, config: MissionConfig) -> None:
        self.body, self.perception, self.config = body, perception, config
        self.obstacles = ObstacleMap()
        self.looks: list[Panorama] = []
        self.looked: list[tuple[Pose, Look]] = []
        self.now: Observation = body.observe()
        self._before = self.now  # the last time it drove
        self._deadline_ns = self.now.time_ns + int(config.limit_s * 1e9)
        self._about_ns, self._about_xy_m = self.now.time_ns, self.here.xy_m
        self._yielded_ns, self._waits_ns = 0, 0  # when last, and until when it waits for the other

    @property
    def here(self) -> Pose:
        """By odometry."""
        return self.now.odometry

    def look_around(self) -> Look:
        """A look all around, which is kept as evidence."""
        self.now = self.body.observe(look=True)
        assert self.now.panorama is not None
        self.looks.append(self.now.panorama)
        look = self.perception.examine(self.now)
        self.looked.append((self.here, look))
        return look

    def glance(self, bearing_rad: float) -> Look:
        """What one camera shows around a bearing."""
        self.now = self.body.observe(towards_rad=bearing_rad)
        return self.perception.examine(self.now)

    def shows(self, bearing_rad: float) -> bool:
        """Whether the picture that was taken last shows what is along a bearing."""
        picture = self.now.panorama
        return picture is not None and picture.shows(bearing_rad - (self.now.view_rad or 0.0))

    def ahead_m(
        self,
        bearing_rad: float,
        half_width_rad: float = 0.1,
        of: Callable[[Array], np.floating] = np.min,
    ) -> float:
        """What the range ring shows around a bearing: the shortest reading, or another one.

        inf where no sensor looks.
        """
        near, ring = self._around(bearing_rad, half_width_rad), self.now.range_ring_m
        return float(of(ring[near])) if near.any() else float("inf")

    def nearest(
        self, bearing_rad: float, half_width_rad: float, but: NDArray[np.bool_] | None = None
    ) -> tuple[float, float]:
        """What the range ring meets nearest around a bearing: its bearing and range.

        but: beams that do not count.
        """
        near, ring = self._around(bearing_rad, half_width_rad), self.now.range_ring_m
        near &= True if but is None else ~but
        first = int(np.where(near, ring, np.inf).argmin())
        return float(beams_rad(len(ring))[first]), float(ring[first]) if near[first] else np.inf

    def _around(self, bearing_rad: float, half_width_rad: float) -> NDArray[np.bool_]:
        """The beams around a bearing, (n_beams,), but those where no sensor looks."""
        ring = self.now.range_ring_m
        off_rad = np.abs(wrap_angle_rad(beams_rad(len(ring)) - bearing_rad))
        return np.asarray((off_rad <= half_width_rad) & (ring != UNSEEN_M))

    def surface(self, bearing_rad: float) -> tuple[NDArray[np.bool_], float, float]:
        """Of the surface that is met at a bearing: its beams, (n_beams,), how near, how wide it is.

        Neighbouring beams meet one surface if they end near each other.
        """
        beams = beams_rad(len(self.now.range_ring_m))
        first = int(np.argmin(np.abs(wrap_angle_rad(beams - bearing_rad))))
        ring = np.roll(self.now.range_ring_m, -first)
        met = (ring < REACH_M) & (ring != UNSEEN_M)
        ends = ring[:, None] * np.column_stack([np.cos(beams), np.sin(beams)])
        apart_m = np.linalg.norm(np.roll(ends, -1, axis=0) - ends, axis=1)
        joined = met & np.roll(met, -1) & (apart_m <= _ONE_SURFACE_M)  # to the next beam
        onward = np.append(True, np.logical_and.accumulate(joined)[:-1])
        back = np.logical_and.accumulate(joined[::-1])[::-1]
        of_it = (onward | back) & met[0]
        near_m = float(ring[of_it].min(initial=np.inf))
        return np.roll(of_it, first), near_m, float(pdist(ends[of_it]).max(initial=0.0))

    def until_ns(self, place: Estimate) -> int:
        """When an approach to a place has taken too long."""
        self._sense()
        limit_s = self.config.leg_limit_s + place.range_m(self.here) / _SLOW_M_S
        return self.now.time_ns + int(limit_s * 1e9)

    def _sense(self) -> None:
        """Sense anew: the time that planning took, on a real robot, is no time without headway."""
        then_ns, self.now = self.now.time_ns, self.body.observe()
        self._about_ns += self.now.time_ns - then_ns

    def stretch(self, xy_m: Array, within_m: float, way_m: float) -> float | None:
        """Drive some way towards a place, around what is in the way; None: it gets no nearer.

        Returns the metres driven. GaveUp when the mission's time is over, unless it cannot drive.
        """
        self._sense()
        driven_m, previous = 0.0, self.here
        since_ns, since_m = self.now.time_ns, 0.0
        while driven_m < way_m:
            if self.here.distance_to_m(self._about_xy_m) > _LINGERS_M:
                self._about_ns, self._about_xy_m = self.now.time_ns, self.here.xy_m
            if driven_m >= since_m + _HEADWAY_M:
                since_ns, since_m = self.now.time_ns, driven_m
            self.obstacles.note(self.here, self.now.range_ring_m)
            course = self.obstacles.course_rad(self.here, xy_m, within_m)
            if course is None:
                return driven_m if driven_m > 0.2 else None
            stuck = self.now.time_ns - since_ns > self.config.stuck_after_s * 1e9
            if stuck or self.now.time_ns - self._about_ns > _LINGERS_S * 1e9:
                self._about_ns = self.now.time_ns
                self.obstacles.block(self.here, course)
                return None
            for _ in range(_TICKS):
                if self.now.time_ns > self._deadline_ns:
                    raise GaveUp(f"out of time after {self.config.limit_s:g} s")
                wanted = float(wrap_angle_rad(course - self.here.yaw_rad))
                drive = steer(wanted, self.now.range_ring_m)
                if self._yields():
                    drive = replace(drive, speed_m_s=0.0)
                self._before = self.now
                self.body.drive(drive, self.config.tick_s)
                self.now = self.body.observe()
                driven_m += previous.distance_to_m(self.here.xy_m)
                previous = self.here
        return driven_m

    def _yields(self) -> bool:
        """Whether something drives so near that it waits.

        Two that meet see each other stand, and would go on at the same moments until they touch. So
        who yields again waits for a time that hangs on where its odometry has it: one goes first.
        """
        now_ns = self.now.time_ns
        if newcomer_m(self._before, self.now) >= _YIELDS_M:
            return now_ns < self._waits_ns
        if now_ns - self._yielded_ns < _SOON_S * 1e9:
            draws = generator(round(1000 * self.here.x_m), "yield", round(1000 * self.here.y_m))
            self._waits_ns = now_ns + round(draws.uniform(*_WAITS_S) * 1e9)
        self._yielded_ns = now_ns
        return True

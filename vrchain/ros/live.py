"""A live robot over ROS as a mission's body: what it senses, and its wheels.

Its topics are understood by the same code as those of a bag.
"""

import posixpath
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from threading import Condition
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrchain.errors import BagError, ImageError, MissionError
from vrchain.geometry import Pose, placed, relative, rotation_z
from vrchain.panorama import Panorama
from vrchain.robot import STOP, UNSEEN_M, Drive, Observation
from vrchain.ros.cameras import picture_of
from vrchain.ros.contents import Contents, Topic, ahead_s, keep, yaw_of
from vrchain.ros.formats import Message
from vrchain.ros.messages import (
    COMPRESSED,
    IMAGE,
    INFO,
    ODOMETRY,
    SCAN,
    STAMPED,
    TF,
    TWIST,
    opened,
    stamp_ns,
)
from vrchain.ros.nodes import Node
from vrchain.ros.robots import Way, is_jump, robot_in
from vrchain.ros.telling import Messages
from vrchain.simulation.sensors import N_BEAMS, RANGE_MAX_M

_KEPT = 300  # poses of odometry
_PICTURES = 30  # of each camera, until there is one of each: some come a second late
_SAID_EVERY_S = 0.1  # a command, while it is driven
_AHEAD_S = 1.0  # of odometry: then a picture tells no place
_STALE_S = 1.0  # odometry or ranges that are older: the robot stands until new ones come


class LiveRobot:
    """A robot's senses and wheels (``Body``).

    robot: whose name it has; namespace: its topics begin with it. BagError says what of it is
    missing, after ``patience_s`` of listening. jumped: is called when its odometry was set anew.
    """

    def __init__(
        self,
        ros: Node,
        name: str,
        namespace: str,
        rig: Mapping[str, Any],
        slop_s: float,
        jumped: Callable[[], None] = lambda: None,
        patience_s: float = 20.0,
    ) -> None:
        self._ros, self._name, self._slop_ns = ros, name, round(slop_s * 1e9)
        self.jumped, self._patience_s = jumped, patience_s
        self._prefix = namespace.rstrip("/") + "/"
        self._changed = Condition()
        self._poses: deque[tuple[int, Pose]] = deque(maxlen=_KEPT)
        self._raw: Pose | None = None  # the newest, as odometry has it
        self._origin = Pose(0.0, 0.0)  # of its odometry, since that was last set anew
        self._scan: Any = None
        self._heard_s = {"odometry": -np.inf, "ranges": -np.inf}
        self._images: dict[str, deque[Message]] = {}
        self._listen(rig, slop_s)
        topic = posixpath.join(self._prefix, str(rig.get("velocity", "cmd_vel")))
        self._stamped = bool(rig.get("velocity_stamped", False))
        self._wheels = ros.advertise(topic, STAMPED if self._stamped else TWIST)
        self._make = Messages(ros.ros1)

    def _listen(self, rig: Mapping[str, Any], slop_s: float) -> None:
        """Until all that is needed was heard once, then go on with odometry and ranges alone."""
        contents = Contents({}, {})

        def take(message: Message) -> None:
            with self._changed:
                topic = contents.topics.setdefault(
                    message.topic, Topic(message.topic, message.type)
                )
                topic.count += 1
                keep(contents, topic, message)

        ends: dict[str, Callable[[], None]] = {}
        began_s = time.monotonic()
        until_s, complete_s = began_s + self._patience_s, began_s + self._patience_s / 2
        lacks = f"{self._name}: nothing is published below {self._prefix}"
        try:
            while time.monotonic() < until_s:
                for topic, kind in self._ros.topics().items():
                    own = topic.startswith(self._prefix) or kind == TF
                    if own and topic not in ends and kind in (
                        ODOMETRY, INFO, IMAGE, COMPRESSED, SCAN, TF
                    ):  # fmt: skip
                        ends[topic] = self._ros.subscribe(topic, kind, take)
                time.sleep(0.5)
                with self._changed:
                    if not any(topic.startswith(self._prefix) for topic in contents.topics):
                        continue
                    if ends.keys() - contents.topics.keys() and time.monotonic() < complete_s:
                        continue  # what is announced may still come: a camera too few is a hole
                    try:
                        found = robot_in(
                            contents, self._name, self._prefix, rig, max(slop_s, 3600.0)
                        )
                        scanned, self._laser = laser_in(
                            contents, self._name, self._prefix, rig, found.base
                        )
                    except BagError as error:
                        lacks = str(error)
                        continue
                    self._seen_by = found
                    break
            else:
                raise BagError(f"{lacks} (listened for {self._patience_s:g} s)")
        finally:
            for end in ends.values():
                end()
        for topic in found.topics:
            apart_s = ahead_s(contents.topics[topic], contents.topics[found.odometry])
            if apart_s > _AHEAD_S:
                raise BagError(
                    f"{self._name}: the clock of {topic} is {apart_s:.1f} s ahead of that of "
                    f"{found.odometry}: set them alike"
                )
        self._ros.subscribe(found.odometry, ODOMETRY, self._take_odometry)
        self._ros.subscribe(scanned, SCAN, self._take_scan)
        self._kinds = {topic: contents.topics[topic].type for topic in found.topics}

    def _take_odometry(self, message: Message) -> None:
        told = opened(message)
        place, yaw_rad = told.pose.pose.position, yaw_of(told.pose.pose.orientation)
        now_ns = stamp_ns(message) or message.received_ns
        if not np.isfinite([place.x, place.y, yaw_rad]).all():
            return
        with self._changed:
            raw = Pose(place.x, place.y, yaw_rad)
            if self._poses and now_ns <= self._poses[-1][0]:
                return
            here = raw
            if self._raw is not None:
                then_ns, here = self._poses[-1]
                step = relative(self._raw, raw)
                way_m = float(np.hypot(step.x_m, step.y_m))
                if is_jump(way_m, step.yaw_rad, (now_ns - then_ns) / 1e9):
                    self.jumped()
                    self._origin = placed(here, relative(raw, Pose(0.0, 0.0)))
                here = placed(self._origin, raw)
            self._raw, self._heard_s["odometry"] = raw, time.monotonic()
            self._poses.append((now_ns, here))
            self._changed.notify_all()

    def _take_scan(self, message: Message) -> None:
        scan = opened(message)
        with self._changed:
            self._scan, self._heard_s["ranges"] = scan, time.monotonic()
            self._changed.notify_all()

    def _take_image(self, message: Message) -> None:
        with self._changed:
            self._images[message.topic].append(message)
            self._changed.notify_all()

    def observe(self, look: bool = False, towards_rad: float | None = None) -> Observation:
        """What it senses now; it stands while it looks. MissionError if nothing comes any more."""
        if not look and towards_rad is None:
            with self._changed:
                if not self._is_fresh():
                    self._say(STOP)
                    self._await(self._is_fresh, "odometry and ranges")
                time_ns, pose = self._poses[-1]
                return Observation(time_ns, pose, ring_of(self._scan, self._laser))
        self._say(STOP)
        rig, view = self._seen_by.ring.rig, None
        if not look:
            assert towards_rad is not None
            view = int(rig.view_of_bearing(towards_rad))
        topics = self._seen_by.topics
        if view is not None and self._seen_by.ring.exact:
            topics = (topics[view],)
        images, time_ns = self._moment(topics)
        if len(topics) < len(self._seen_by.topics):
            panorama = Panorama(replace(rig, n_views=1), np.stack(images))
        else:
            panorama = self._seen_by.ring.panorama(images)
            if view is not None:
                one, seen = slice(view, view + 1), panorama.seen
                panorama = Panorama(
                    replace(rig, n_views=1),
                    panorama.views[one],
                    None if seen is None else seen[one],
                )
        with self._changed:
            way = Way(
                np.array([t for t, _ in self._poses]),
                np.array([[p.x_m, p.y_m, p.yaw_rad] for _, p in self._poses]),
            )
            pose = way.at(time_ns) or self._poses[-1][1]
            ring = ring_of(self._scan, self._laser)
        bearing = None if look else float(rig.azimuths_rad[view or 0])
        return Observation(time_ns, pose, ring, panorama=panorama, view_rad=bearing)

    def _moment(self, topics: Sequence[str]) -> tuple[list[NDArray[np.uint8]], int]:
        """Pictures of these topics that were taken within the slop, from now on, and when."""
        with self._changed:
            self._await(self._is_fresh, "odometry and ranges")
            since_ns = self._poses[-1][0]
            self._images = {topic: deque(maxlen=_PICTURES) for topic in topics}
        ends = [self._ros.subscribe(t, self._kinds[t], self._take_image) for t in topics]
        found: list[Message] = []

        def complete() -> bool:
            found[:] = []
            newest = [
                max(stamps) if (stamps := [self._when(m) for m in kept]) else 0
                for kept in self._images.values()
            ]
            limit_ns = min(newest)
            for kept in self._images.values():
                near = [m for m in kept if abs(self._when(m) - limit_ns) <= self._slop_ns]
                if near:
                    found.append(min(near, key=lambda m: abs(self._when(m) - limit_ns)))
            return len(found) == len(topics) and limit_ns >= since_ns

        try:
            with self._changed:
                self._await(complete, f"pictures of one moment from {', '.join(topics)}")
                taken = list(found)
        finally:
            for end in ends:
                end()
        own = self._seen_by
        told = dict(zip(own.topics, zip(own.labels, own.ring.cameras, strict=True), strict=True))
        try:
            pictures = [picture_of(m.topic, opened(m), *told[m.topic]) for m in taken]
        except (BagError, ImageError) as error:
            raise MissionError(f"{self._name}: {error}") from error
        return pictures, sorted(self._when(m) for m in taken)[len(taken) // 2]

    @staticmethod
    def _when(message: Message) -> int:
        return stamp_ns(message) or message.received_ns

    def _is_fresh(self) -> bool:
        """Whether it knows where it is, and what is before it."""
        return time.monotonic() - min(self._heard_s.values()) < _STALE_S

    def _await(self, ready: Callable[[], bool], what: str) -> None:
        """Wait, the lock held, for a message to make it so."""
        if not self._changed.wait_for(ready, self._patience_s):
            raise MissionError(
                f"{self._name}: expected {what} below {self._prefix}, nothing came for "
                f"{self._patience_s:g} s: is the robot on, and its clock that of its odometry?"
            )

    def drive(self, command: Drive, duration_s: float) -> None:
        """Drive so for a while, by the time of its odometry."""
        with self._changed:
            self._await(lambda: bool(self._poses), "odometry")
            until_ns = self._poses[-1][0] + round(duration_s * 1e9)
        patience_s = time.monotonic() + self._patience_s
        while True:
            self._say(command if self._is_fresh() else STOP)
            with self._changed:
                if self._changed.wait_for(
                    lambda: self._poses[-1][0] >= until_ns, timeout=_SAID_EVERY_S
                ):
                    return
            if time.monotonic() > patience_s:
                self._say(STOP)
                raise MissionError(
                    f"{self._name}: its odometry stands still for {self._patience_s:g} s"
                )

    def _say(self, command: Drive) -> None:
        make, zero = self._make, {"x": 0.0, "y": 0.0, "z": 0.0}
        ahead = make.make("geometry_msgs/msg/Vector3", **(zero | {"x": command.speed_m_s}))
        turn = make.make("geometry_msgs/msg/Vector3", **(zero | {"z": command.turn_rad_s}))
        said = make.make(TWIST, linear=ahead, angular=turn)
        if self._stamped:
            said = make.make(STAMPED, header=make.header(time.time_ns(), ""), twist=said)
        self._wheels.say(said)

    def close(self) -> None:
        """Stand still."""
        self._say(STOP)


def laser_in(
    contents: Contents, name: str, prefix: str, rig: Mapping[str, Any], base: str
) -> tuple[str, NDArray[np.float64]]:
    """The topic of its laser, and (4, 4) from that's frame to the robot's. BagError if unknown."""
    wanted = posixpath.join(prefix, str(rig["laser"])) if "laser" in rig else ""
    scans = [
        t for t in contents.topics.values()
        if t.type == SCAN and t.first and wanted in ("", t.name)
    ]  # fmt: skip
    if not scans:
        raise BagError(f"{name}: no {SCAN} comes {f'as {wanted}' if wanted else f'below {prefix}'}")
    if len(scans) > 1:
        names = ", ".join(t.name for t in scans)
        raise BagError(f"{name}: {names} are lasers: name one as laser in --rig")
    (topic,) = scans
    pose = contents.of(prefix).pose_in(topic.frame, base)
    if "laser_bearing_deg" in rig:
        pose, told = np.eye(4), rig["laser_bearing_deg"]
        if not isinstance(told, int | float) or not np.isfinite(told):
            raise BagError(f"{name}: expected degrees as laser_bearing_deg in --rig, got {told!r}")
        pose[:3, :3] = rotation_z(np.radians(told))
    if pose is None:
        raise BagError(
            f"{name}: no transform leads from its laser, {topic.frame}, to {base}: publish it as "
            "tf_static, or tell laser_bearing_deg in --rig"
        )
    return topic.name, pose


def ring_of(scan: Any, laser: NDArray[np.float64]) -> NDArray[np.float64]:
    """The range ring in a LaserScan: per beam the nearest reading; not free where none looks.

    laser: (4, 4), from the scan's frame to the robot's. By REP 117 inf is nothing in reach, and
    NaN, or less than ``range_min``, is no reading; nor is any of a scan that has no reach.
    """
    ranges = np.asarray(scan.ranges, float)
    angles = scan.angle_min + scan.angle_increment * np.arange(len(ranges))
    good = ~np.isnan(ranges) & (ranges >= scan.range_min) & (scan.range_max > scan.range_min)
    ranges, angles = ranges[good], angles[good]
    echo = ranges < scan.range_max
    ranges = np.where(echo, ranges, RANGE_MAX_M)
    flat = np.stack([ranges * np.cos(angles), ranges * np.sin(angles), 0 * ranges, 0 * ranges + 1])
    x_m, y_m = (laser @ flat)[:2]
    beam = np.round(np.arctan2(y_m, x_m) / (2 * np.pi / N_BEAMS)).astype(int) % N_BEAMS
    ring = np.full(N_BEAMS, np.inf)
    away_m = np.where(echo, np.hypot(x_m, y_m), RANGE_MAX_M)
    np.minimum.at(ring, beam, np.minimum(away_m, RANGE_MAX_M))
    return np.where(np.isinf(ring), UNSEEN_M, ring)

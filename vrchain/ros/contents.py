"""What bags hold: the first reading, which keeps times, odometry, calibration and transforms."""

from array import array
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrchain.errors import BagError, ImageError
from vrchain.ros.formats import Message
from vrchain.ros.messages import (
    COMPRESSED,
    IMAGE,
    INFO,
    ODOMETRY,
    POSE,
    SCAN,
    TF,
    opened,
    rgb_of,
    stamp_ns,
)
from vrchain.ros.storage import messages

Times = NDArray[np.int64]

OF_TF = " of tf"  # ends the name of a way that transforms tell
_TRIED = 20  # pictures, for one that can be read
_FRAMES = 10_000  # of transforms; a robot has hundreds
_APART_NS = 1_000_000_000  # of a stamp from when it was received, more than before: it is wrong
_HELD_UP_NS = 60_000_000_000  # that a message may come late, where a network fails


@dataclass(eq=False)
class Topic:
    """What is kept of one topic.

    times: of each message in turn, by its header, and when it was received. first: the first
    message, opened, of those that are asked for calibration or pictures. poses: of odometry, x, y
    and yaw, NaN where a message tells none.
    """

    name: str
    type: str
    count: int = 0
    broken: int = 0
    stamps_ns: array = field(default_factory=lambda: array("q"))
    received_ns: array = field(default_factory=lambda: array("q"))
    poses: array = field(default_factory=lambda: array("d"))
    first: Any = None
    size_px: tuple[int, int] = (0, 0)
    trouble: str = ""

    @property
    def frame(self) -> str:
        """The frame that the header names."""
        return "" if self.first is None else self.first.header.frame_id.lstrip("/")


@dataclass(eq=False)
class Contents:
    """Everything that was kept.

    transforms: by the namespace of their topic, "/" of ``/tf``, and the child frame, its parent's
    name and (4, 4): robots may have frames of one name.
    """

    topics: dict[str, Topic]
    transforms: dict[tuple[str, str], tuple[str, NDArray[np.float64]]]

    def of(self, namespace: str) -> "Contents":
        """As a robot has it, whose topics begin with a namespace: its own frames before others."""
        found: dict[tuple[str, str], tuple[str, NDArray[np.float64]]] = {}
        for (of, frame), told in sorted(self.transforms.items(), key=lambda t: len(t[0][0])):
            if namespace.startswith(of) or of.startswith(namespace):
                found["/", frame] = told
        return Contents(self.topics, found)

    def pose_in(self, frame: str, base: str) -> NDArray[np.float64] | None:
        """(4, 4) from ``frame`` to ``base``; None where no transforms lead there."""
        up, down = self._to_top(frame), self._to_top(base)
        for name, pose in up.items():
            if name in down:
                return pose if name == base else np.linalg.inv(down[name]) @ pose
        return None

    def _to_top(self, frame: str) -> dict[str, NDArray[np.float64]]:
        found, pose = {frame: np.eye(4)}, np.eye(4)
        while ("/", frame) in self.transforms:
            frame, step = self.transforms["/", frame]
            pose = step @ pose
            if frame in found:  # a circle
                break
            found[frame] = pose
        return found


def contents_of(
    bags: Iterable[str | Path], tell: Callable[[str], None] = lambda line: None
) -> Contents:
    """Read the bags once. tell: is given a line for each thing that is damaged. BagError."""
    found = Contents({}, {})
    for message in messages(bags, tell=tell):
        topic = found.topics.setdefault(message.topic, Topic(message.topic, message.type))
        topic.count += 1
        try:
            keep(found, topic, message)
            if message.type == TF:
                _keep_way(found, message)
        except BagError:
            topic.broken += 1
    for topic in found.topics.values():
        if topic.broken:
            tell(f"{topic.name}: {topic.broken} of {topic.count} messages are broken: left out")
    if not found.topics:
        raise BagError(f"{', '.join(map(str, bags))}: no message was read: record again")
    return found


def keep(found: Contents, topic: Topic, message: Message) -> None:
    """Keep of one message what is needed later. BagError if it is broken."""
    if message.type == TF:
        for told in opened(message).transforms:
            child = namespace_of(message), told.child_frame_id.lstrip("/")
            if child in found.transforms or len(found.transforms) >= _FRAMES:
                continue
            pose = matrix_of(told.transform.translation, told.transform.rotation)
            if pose is not None:
                found.transforms[child] = told.header.frame_id.lstrip("/"), pose
    elif message.type == INFO:
        info = opened(message)
        if topic.first is None or not any(focal_lengths(topic.first)):
            topic.first = info
    elif message.type == SCAN:
        topic.first = topic.first or opened(message)
    elif message.type in (ODOMETRY, POSE):
        topic.first = told = opened(message)
        pose = told.pose.pose if message.type == ODOMETRY else told.pose
        topic.poses.extend((pose.position.x, pose.position.y, yaw_of(pose.orientation)))
        _keep_times(topic, message)
    elif message.type in (IMAGE, COMPRESSED):
        _keep_times(topic, message)
        if topic.first is None or (topic.trouble and topic.count < _TRIED):
            _first_picture(topic, message)


def _keep_way(found: Contents, message: Message) -> None:
    """How transforms move a robot, as if it were a topic: from frames that end in ``odom``."""
    for told in opened(message).transforms:
        frame, own = told.header.frame_id.lstrip("/"), namespace_of(message)
        if frame.rpartition("/")[2] == "odom":
            name = f"{own}{frame.removeprefix(own[1:])}{OF_TF}"
            topic = found.topics.setdefault(name, Topic(name, TF))
            place, stamp = told.transform.translation, told.header.stamp
            topic.first = told
            topic.count += 1
            topic.poses.extend((place.x, place.y, yaw_of(told.transform.rotation)))
            topic.stamps_ns.append(stamp.sec * 1_000_000_000 + stamp.nanosec)
            topic.received_ns.append(message.received_ns)


def namespace_of(message: Message) -> str:
    """Of a message's topic, with slashes around it."""
    return message.topic.rpartition("/")[0] + "/"


def _keep_times(topic: Topic, message: Message) -> None:
    topic.stamps_ns.append(stamp_ns(message))
    topic.received_ns.append(message.received_ns)


def _first_picture(topic: Topic, message: Message) -> None:
    topic.first = opened(message)
    topic.trouble = ""
    try:
        height_px, width_px = rgb_of(topic.first).shape[:2]
        topic.size_px = width_px, height_px
    except ImageError as error:
        topic.trouble = str(error)
        if hasattr(topic.first, "encoding"):
            topic.size_px = topic.first.width, topic.first.height
    topic.first.data = topic.first.data[:16]  # the picture itself is not needed again


def focal_lengths(info: Any) -> tuple[float, float]:
    """Of a CameraInfo, zero where it is not calibrated."""
    matrix = info.k if hasattr(info, "k") else info.K
    return float(matrix[0]), float(matrix[4])


def yaw_of(q: Any) -> float:
    """Yaw of a quaternion; NaN if it is none."""
    norm = q.x * q.x + q.y * q.y + q.z * q.z + q.w * q.w  # inf where a power would overflow
    if not 0.25 < norm < 4:
        return float("nan")
    return float(np.arctan2(2 * (q.w * q.z + q.x * q.y), norm - 2 * (q.y**2 + q.z**2)))


def matrix_of(translation: Any, q: Any) -> NDArray[np.float64] | None:
    """(4, 4) of a transform; None if its quaternion is none."""
    v, w = np.array([q.x, q.y, q.z]), q.w
    norm = float(np.sqrt(v @ v + w * w))
    if not 0.5 < norm < 2:
        return None
    v, w = v / norm, w / norm
    cross = np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])
    pose = np.eye(4)
    pose[:3, :3] += 2 * w * cross + 2 * cross @ cross
    pose[:3, 3] = translation.x, translation.y, translation.z
    return pose


def clocked(stamps_ns: Iterable[int], received_ns: Iterable[int]) -> tuple[Times, int, int]:
    """The times of one topic's messages, their clock's usual offset, and how many were wrong.

    A stamp counts if it is as far from when its message was received as those before it, or if the
    message was held up on its way: it is later, and goes on from the one before. Where it is zero,
    or the clock stepped, time goes on by when messages were received.
    """
    stamps = np.fromiter(stamps_ns, np.int64)
    received = np.fromiter(received_ns, np.int64)
    told = stamps != 0
    if not told.any():
        return received, 0, len(received)
    late = received - stamps
    usual = offset = int(np.median(late[told][:100]))
    times, wrong, before = stamps.copy(), 0, 0
    for k, (is_told, late_ns) in enumerate(zip(told.tolist(), late.tolist(), strict=True)):
        is_held_up = 0 < late_ns - offset <= _HELD_UP_NS and stamps[k] > before
        if is_told and abs(late_ns - offset) <= _APART_NS:
            offset = late_ns
        elif not (is_told and is_held_up):
            times[k] = received[k] - offset
            wrong += times[k] != stamps[k]
        before = max(before, int(times[k]))
    return times, usual, wrong


def ahead_s(topic: Topic, other: Topic) -> float:
    """By how much a topic's clock is ahead of another's; below zero it may be late instead."""
    own_ns, others_ns = (np.array(t.received_ns) for t in (topic, other))
    own_fast_ns, others_fast_ns = (
        np.where(stamps_ns != 0, stamps_ns - came_ns, 0)
        for stamps_ns, came_ns in (
            (np.array(topic.stamps_ns), own_ns), (np.array(other.stamps_ns), others_ns),
        )
    )  # fmt: skip
    last = np.searchsorted(others_ns, own_ns, side="right") - 1  # of the other's, before each
    return float(np.median(own_fast_ns - others_fast_ns[last.clip(0)])) / 1e9


def gaps_of(topic: Topic) -> dict[str, float]:
    """How often a topic's messages came, and the longest time without one; {} of fewer than two."""
    steps_s = np.diff(np.sort(clocked(topic.stamps_ns, topic.received_ns)[0])) / 1e9
    if not steps_s.sum():
        return {}
    return {
        "rate_hz": round(float(len(steps_s) / steps_s.sum()), 2),
        "longest_gap_s": round(float(steps_s.max()), 2),
    }

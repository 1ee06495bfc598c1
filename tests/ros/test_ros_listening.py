"""How long a live robot is listened to before it is known what it has; no ROS, time made up."""

import contextlib
from collections.abc import Callable
from copy import deepcopy
from types import SimpleNamespace
from typing import Any

import pytest

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from recordings import Row, changed, recording, stamped
from sights import RIG

from vrchain.errors import BagError, MissionError
from vrchain.robot import Drive
from vrchain.ros import live
from vrchain.ros.formats import Message
from vrchain.ros.messages import typestore
from vrchain.ros.nodes import Said

LATE = "/R1/camera_3/image_raw"
NEVER_S = 1e9


class Node:
    """A node, and the time: of each topic the first message comes, at once or after a while."""

    ros1 = False

    def __init__(self, rows: list[Row], after_s: dict[str, float]) -> None:
        self._first = {row.topic: row for row in reversed(rows)}
        self._after_s, self.now_s = after_s, 0.0
        self.told: list[tuple[str, str, Any]] = []
        self._taking: dict[str, Callable[[Message], None]] = {}

    def sleep(self, seconds: float) -> None:
        self.now_s += seconds
        for topic, take in list(self._taking.items()):
            if self.now_s >= self._after_s.get(topic, 0.0):
                row, kind = self._first[topic], self.topics()[topic]
                data = bytes(typestore(False).serialize_cdr(row.message, kind))
                take(Message(topic, kind, False, row.received_ns, data))
                del self._taking[topic]

    def topics(self) -> dict[str, str]:
        return {topic: row.message.__msgtype__ for topic, row in self._first.items()}

    def subscribe(
        self, topic: str, kind: str, take: Callable[[Message], None]
    ) -> Callable[[], None]:
        self._taking[topic] = take
        return lambda: None

    def advertise(self, topic: str, kind: str, latch: bool = False) -> Said:
        return Said(lambda message: self.told.append((topic, kind, message)), lambda: False)

    def close(self) -> None:
        """Nothing is to be left."""


@pytest.fixture
def listened(monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[live.LiveRobot, float]]:
    def listen(after_s: dict[str, float], without: str = "-") -> tuple[live.LiveRobot, float]:
        node = Node([row for row in recording() if without not in row.topic], after_s)
        clock = SimpleNamespace(
            monotonic=lambda: node.now_s, sleep=node.sleep, time_ns=lambda: 7_000_000_001
        )
        monkeypatch.setattr(live, "time", clock)
        return live.LiveRobot(node, "R1", "/R1", {}, 0.05, patience_s=20.0), node.now_s

    return listen


def test_a_camera_that_comes_late_is_no_hole(
    listened: Callable[..., tuple[live.LiveRobot, float]],
) -> None:
    for after_s in (0.0, 7.2):
        robot, took_s = listened({LATE: after_s})
        ring = robot._seen_by.ring
        assert ring.rig == RIG and ring.exact and len(ring.cameras) == 8
        assert after_s < took_s <= after_s + 0.5


def test_a_camera_that_never_speaks_is_one(
    listened: Callable[..., tuple[live.LiveRobot, float]],
) -> None:
    """It is given up after half of the patience."""
    robot, took_s = listened({LATE: NEVER_S})
    ring = robot._seen_by.ring
    assert took_s == 10.0 and LATE not in robot._seen_by.topics
    assert len(ring.cameras) == 7 and not ring.exact and 300 < ring.seen_deg < 340


@pytest.mark.parametrize(
    ("after_s", "without", "said"),
    [
        ({}, "scan", "no sensor_msgs/msg/LaserScan comes below /R1/"),
        ({"/R1/odom": NEVER_S}, "-", "expected nav_msgs/msg/Odometry under /R1/"),
        ({}, "R1", "nothing is published below /R1/"),
    ],
)
def test_what_must_be_there_is_waited_for_to_the_end(
    after_s: dict[str, float],
    without: str,
    said: str,
    listened: Callable[..., tuple[live.LiveRobot, float]],
) -> None:
    with pytest.raises(BagError, match=f"{said}.*listened for 20 s"):
        listened(after_s, without)


@pytest.mark.parametrize("silent", ["odom", "scan"])
def test_without_odometry_or_ranges_a_robot_stands(
    silent: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Commands that go on keep its own watchdog quiet, so they have to be to stand."""
    rows = {row.topic: row for row in deepcopy(recording())}
    node = Node(list(rows.values()), {})
    clock = SimpleNamespace(monotonic=lambda: node.now_s, sleep=node.sleep, time_ns=lambda: 0)
    monkeypatch.setattr(live, "time", clock)
    robot = live.LiveRobot(node, "R1", "/R1", {}, 0.05, patience_s=3.0)
    said: list[float] = []

    def hear(command: Any) -> None:
        said.append(command.linear.x)
        node.now_s += 0.1
        for topic in {"odom", "scan"} - ({silent} if len(said) > 5 else set()):
            row, kind = rows[f"/R1/{topic}"], node.topics()[f"/R1/{topic}"]
            if topic == "odom":
                row.message.header.stamp.sec += 1
            data = bytes(typestore(False).serialize_cdr(row.message, kind))
            take = robot._take_odometry if topic == "odom" else robot._take_scan
            take(Message(row.topic, kind, False, row.received_ns, data))

    monkeypatch.setattr(robot, "_wheels", Said(hear, lambda: True))
    hear(SimpleNamespace(linear=SimpleNamespace(x=0.0)))
    with contextlib.suppress(MissionError):
        for _ in range(30):
            robot.drive(Drive(0.5), 1.0)
    assert said[1] == 0.5 and said[-1] == 0.0
    assert said[5:].index(0.0) <= 11  # a second of commands, ten a second


def test_a_camera_whose_clock_is_ahead_tells_no_place(monkeypatch: pytest.MonkeyPatch) -> None:
    """One that is behind may be late instead."""
    for apart_s, ahead in ((30, True), (-3, False)):
        rows = changed(
            recording(), "image_raw", lambda r, s=apart_s: stamped(r, r.received_ns + s * 10**9)
        )
        node = Node(rows, {})
        clock = SimpleNamespace(monotonic=lambda n=node: n.now_s, sleep=node.sleep)
        monkeypatch.setattr(live, "time", clock)
        with (
            pytest.raises(BagError, match=r"is 30.0 s ahead of that of /R1/odom: set them alike")
            if ahead
            else contextlib.nullcontext()
        ):
            live.LiveRobot(node, "R1", "/R1", {}, 0.05)


def test_a_look_waits_for_ranges(listened: Callable[..., tuple[live.LiveRobot, float]]) -> None:
    robot, _ = listened({})
    robot._patience_s = 0.01
    with pytest.raises(MissionError, match="expected odometry and ranges below /R1/"):
        robot.observe(look=True)


def test_a_robot_that_wants_its_velocity_stamped(monkeypatch: pytest.MonkeyPatch) -> None:
    node = Node(list(recording()), {})
    clock = SimpleNamespace(
        monotonic=lambda: node.now_s, sleep=node.sleep, time_ns=lambda: 7_000_000_001
    )
    monkeypatch.setattr(live, "time", clock)
    for named in ("base/cmd_vel", "/R1/base/cmd_vel"):
        rig = {"velocity": named, "velocity_stamped": True}
        live.LiveRobot(node, "R1", "/R1", rig, 0.05).close()
    (topic, kind, message), again = node.told
    assert again[0] == topic
    assert (topic, kind) == ("/R1/base/cmd_vel", "geometry_msgs/msg/TwistStamped")
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (7, 1)
    assert message.twist.linear.x == message.twist.angular.z == 0
    assert typestore(False).serialize_cdr(message, kind)

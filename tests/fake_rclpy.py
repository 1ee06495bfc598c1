"""A rclpy without ROS 2: topics within one process, and the documented calls that are used of it.

It is as strict as rclpy: names and kinds of parameters, what may be published, qualities that must
suit each other, and one thread that has to do with a node's subscriptions.
"""

import re
import sys
import threading
import types
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from queue import Empty, Queue
from typing import Any

import pytest

CLASSES = {
    "sensor_msgs": ("Image", "CompressedImage", "CameraInfo", "LaserScan"),
    "nav_msgs": ("Odometry",),
    "geometry_msgs": ("Twist",),
    "tf2_msgs": ("TFMessage",),
}


class ReliabilityPolicy(Enum):
    RELIABLE = 1
    BEST_EFFORT = 2


class DurabilityPolicy(Enum):
    TRANSIENT_LOCAL = 1
    VOLATILE = 2


@dataclass
class QoSProfile:
    depth: int
    reliability: ReliabilityPolicy = ReliabilityPolicy.RELIABLE
    durability: DurabilityPolicy = DurabilityPolicy.VOLATILE


@dataclass(eq=False)
class Publisher:
    msg_type: type
    topic: str
    qos: QoSProfile
    sent: deque[bytes]

    def publish(self, msg: Any) -> None:
        if not isinstance(msg, bytes | self.msg_type):
            raise TypeError(f"Expected {self.msg_type}, got {type(msg)}")
        self.sent.append(msg)
        for subscription in list(BUS.subscriptions):
            if subscription.hears(self):
                subscription.node.ready.put((subscription, msg))

    def get_subscription_count(self) -> int:
        return sum(s.hears(self) for s in list(BUS.subscriptions))


@dataclass(eq=False)
class Subscription:
    node: "Node"
    msg_type: type
    topic: str
    callback: Callable[[Any], None]
    qos: QoSProfile

    def hears(self, of: Publisher) -> bool:
        """By DDS, what is requested must be offered."""
        best, own = ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE
        suits = self.qos.reliability is best or of.qos.reliability is not best
        lasts = self.qos.durability is own or of.qos.durability is not own
        return (self.topic, self.msg_type) == (of.topic, of.msg_type) and suits and lasts


@dataclass
class Bus:
    publishers: list[Publisher] = field(default_factory=list)
    subscriptions: list[Subscription] = field(default_factory=list)


BUS = Bus()


class Context:
    valid = False


@dataclass(eq=False)
class Node:
    name: str
    ready: Queue = field(default_factory=Queue)
    thread: int | None = None  # the one that spins
    warned: list[str] = field(default_factory=list)

    def _check(self) -> None:
        assert self.thread in (None, threading.get_ident()), "not in the thread that spins"

    def create_publisher(self, msg_type: type, topic: str, qos_profile: QoSProfile) -> Publisher:
        self._check()
        publisher = Publisher(msg_type, topic, qos_profile, deque(maxlen=qos_profile.depth))
        BUS.publishers.append(publisher)
        return publisher

    def create_subscription(
        self, msg_type: type, topic: str, callback: Callable, qos_profile: QoSProfile,
        *, raw: bool = False,
    ) -> Subscription:  # fmt: skip
        self._check()
        assert raw, "the fake knows no other"
        subscription = Subscription(self, msg_type, topic, callback, qos_profile)
        BUS.subscriptions.append(subscription)
        if qos_profile.durability is DurabilityPolicy.TRANSIENT_LOCAL:
            for publisher in BUS.publishers:
                for msg in publisher.sent if subscription.hears(publisher) else ():
                    self.ready.put((subscription, msg))
        return subscription

    def destroy_subscription(self, subscription: Subscription) -> bool:
        self._check()
        BUS.subscriptions.remove(subscription)
        return True

    def get_topic_names_and_types(self) -> list[tuple[str, list[str]]]:
        known = {e.topic: e.msg_type for e in (*BUS.publishers, *BUS.subscriptions)}
        return [(t, [f"{c.__module__.replace('.', '/')}/{c.__name__}"]) for t, c in known.items()]

    def count_publishers(self, topic_name: str) -> int:
        return sum(p.topic == topic_name for p in BUS.publishers)

    def get_logger(self) -> Any:
        return types.SimpleNamespace(warning=self.warned.append)

    def destroy_node(self) -> None:
        BUS.subscriptions[:] = [s for s in BUS.subscriptions if s.node is not self]


class SingleThreadedExecutor:
    def __init__(self, *, context: Context) -> None:
        assert context.valid
        self.nodes: list[Node] = []

    def add_node(self, node: Node) -> bool:
        self.nodes.append(node)
        return True

    def create_task(self, callback: Callable, *args: Any) -> None:
        self.nodes[0].ready.put((None, lambda: callback(*args)))

    def spin_once(self, timeout_sec: float | None = None) -> None:
        (node,) = self.nodes
        node.thread = threading.get_ident()
        try:
            subscription, what = node.ready.get(timeout=timeout_sec)
        except Empty:
            return
        if subscription is None:
            what()
        elif subscription in BUS.subscriptions:
            subscription.callback(what)

    def shutdown(self) -> bool:
        self.nodes[0].thread = None
        return True


def init(*, args: list[str] | None = None, context: Context) -> None:
    assert not context.valid
    context.valid = True


def shutdown(*, context: Context) -> None:
    assert context.valid
    context.valid = False


def create_node(node_name: str, *, context: Context) -> Node:
    assert context.valid and re.fullmatch(r"[A-Za-z_]\w*", node_name, re.ASCII), node_name
    return Node(node_name)


def install(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have it imported as rclpy, and the packages of messages that ROS 2 brings."""
    BUS.publishers.clear()
    BUS.subscriptions.clear()
    sensed = QoSProfile(5, ReliabilityPolicy.BEST_EFFORT)
    modules: dict[str, dict[str, Any]] = {
        "rclpy": {"init": init, "shutdown": shutdown, "create_node": create_node},
        "rclpy.context": {"Context": Context},
        "rclpy.executors": {"SingleThreadedExecutor": SingleThreadedExecutor},
        "rclpy.qos": {
            "QoSProfile": QoSProfile,
            "DurabilityPolicy": DurabilityPolicy,
            "qos_profile_sensor_data": sensed,
        },
    }
    for package, names in CLASSES.items():
        made = {name: type(name, (), {"__module__": f"{package}.msg"}) for name in names}
        modules |= {package: {}, f"{package}.msg": made}
    for name, content in modules.items():
        module = types.ModuleType(name)
        vars(module).update(content)
        monkeypatch.setitem(sys.modules, name, module)

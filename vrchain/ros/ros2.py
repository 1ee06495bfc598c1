"""ROS 2 by rclpy: messages as bytes, as bags hold them. Never tried on a real ROS 2.

rclpy is imported only here. It comes with ROS 2, for one Python, once its setup file is sourced.
"""

import re
import time
from collections.abc import Callable
from concurrent.futures import Future
from importlib import import_module
from threading import Event, Thread
from typing import Any, TypeVar

from vrchain.errors import BagError
from vrchain.extras import require
from vrchain.ros.formats import Message
from vrchain.ros.messages import typestore
from vrchain.ros.nodes import Said

T = TypeVar("T")
_ANSWERS_S = 10.0  # the thread that spins


class Ros2:
    """A node of ROS 2. BagError if there is no rclpy.

    One thread has all to do with the node: rclpy fails where a subscription is made or ended while
    another thread waits on it (github.com/ros2/rclpy/issues/255, 1355).
    """

    ros1 = False

    def __init__(self, name: str) -> None:
        require("rosbags", "mcap", what="driving over ROS", error=BagError)
        self._rclpy, self._qos = _imported("rclpy"), _imported("rclpy.qos")
        self._context = _imported("rclpy.context").Context()  # our own, so Ctrl-C stays Python's
        self._rclpy.init(args=[], context=self._context)
        own = re.sub(r"\W", "_", name, flags=re.ASCII)
        self._node = self._rclpy.create_node(own, context=self._context)
        executors = _imported("rclpy.executors")
        self._executor = executors.SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._closing, self._thread = Event(), Thread(target=self._spin, daemon=True)
        self._thread.start()

    def _spin(self) -> None:
        while not self._closing.is_set():
            self._executor.spin_once(timeout_sec=0.1)

    def _there(self, work: Callable[[], T]) -> T:
        """Do it in the thread that spins."""
        answer: Future[T] = Future()

        def done() -> None:
            try:
                answer.set_result(work())
            except Exception as error:  # rclpy's own, for who asked
                answer.set_exception(error)

        self._executor.create_task(done)
        try:
            return answer.result(_ANSWERS_S)
        except TimeoutError as error:
            raise BagError(f"ROS 2's node did not answer for {_ANSWERS_S:g} s") from error

    def topics(self) -> dict[str, str]:
        """Topics that are published now, and their types."""

        def published() -> dict[str, str]:
            known = self._node.get_topic_names_and_types()
            return {topic: kinds[0] for topic, kinds in known if self._node.count_publishers(topic)}

        return self._there(published)

    def subscribe(
        self, topic: str, kind: str, take: Callable[[Message], None]
    ) -> Callable[[], None]:
        """Have ``take`` called, in the thread that spins, with each message. Returns what ends it.

        Best effort, as sensors are listened to: every publisher grants that.
        """

        def taken(data: bytes) -> None:
            try:
                take(Message(topic, kind, False, time.time_ns(), data))
            except Exception as error:  # whatever it is, it would end the thread
                self._node.get_logger().warning(str(error))

        qos = self._kept(True) if topic.endswith("tf_static") else self._qos.qos_profile_sensor_data
        asked, node = (_class_of(kind), topic, taken, qos), self._node
        subscription = self._there(lambda: node.create_subscription(*asked, raw=True))
        return lambda: self._there(lambda: node.destroy_subscription(subscription))

    def advertise(self, topic: str, kind: str, latch: bool = False) -> Said:
        """Announce a topic of messages of a type."""
        asked, store = (_class_of(kind), topic, self._kept(latch)), typestore(False)
        publisher = self._there(lambda: self._node.create_publisher(*asked))
        return Said(
            lambda message: publisher.publish(bytes(store.serialize_cdr(message, kind))),
            lambda: publisher.get_subscription_count() > 0,
        )

    def _kept(self, latch: bool) -> Any:
        told = self._qos.DurabilityPolicy
        durability = told.TRANSIENT_LOCAL if latch else told.VOLATILE
        return self._qos.QoSProfile(depth=10, durability=durability)  # reliable, by default

    def close(self) -> None:
        """Leave ROS."""
        self._closing.set()
        self._thread.join()
        self._executor.shutdown()
        self._node.destroy_node()
        self._rclpy.shutdown(context=self._context)


def _class_of(kind: str) -> Any:
    """ROS's own class of messages: it tells the middleware their layout."""
    package, _, name = kind.split("/")
    return getattr(_imported(f"{package}.msg"), name)


def _imported(module: str) -> Any:
    try:
        return import_module(module)
    except ImportError as error:
        raise BagError(
            f"expected ROS 2's {module.partition('.')[0]}, got: {error}; source ROS's setup file, "
            "and use an environment of the Python that ROS has"
        ) from error

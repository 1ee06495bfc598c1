"""ROS 1 by rospy: messages as bytes, as bags hold them, so that one code reads both.

rospy is looked for where ROS and Debian install it, and imported only here. No package of messages
is needed: their definitions come with the library that reads bags.
"""

import sys
import time
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

from vrchain.errors import BagError
from vrchain.extras import require
from vrchain.ros.formats import Message, type_named
from vrchain.ros.messages import typestore
from vrchain.ros.nodes import Said

_PLACES = ("/opt/ros/noetic/lib/python3/dist-packages", "/usr/lib/python3/dist-packages")


class Ros1:
    """A node of ROS 1. BagError if there is no rospy, or no master answers."""

    ros1 = True

    def __init__(self, name: str) -> None:
        require("rosbags", "mcap", what="driving over ROS", error=BagError)
        self._rospy = _rospy()
        try:
            import_module("rosgraph").Master("/vrchain").getPid()
        except Exception as error:  # of sockets, or of the master's own
            where = import_module("rosgraph").get_master_uri()
            raise BagError(
                f"no ROS master answers at {where} ({error}): start `roscore`, or Debian's "
                "`rosmaster --core`, or set ROS_MASTER_URI"
            ) from error
        self._rospy.init_node(name, anonymous=True, disable_signals=True)

    def topics(self) -> dict[str, str]:
        """Topics that are published now, and their types."""
        return {topic: type_named(kind) for topic, kind in self._rospy.get_published_topics()}

    def subscribe(
        self, topic: str, kind: str, take: Callable[[Message], None]
    ) -> Callable[[], None]:
        """Have ``take`` called, in threads of its own, with each message. Returns what ends it."""

        def taken(raw: Any) -> None:
            if type_named(raw._connection_header["type"]) == kind:
                take(Message(topic, kind, True, time.time_ns(), raw._buff))

        subscriber = self._rospy.Subscriber(topic, self._rospy.AnyMsg, taken, queue_size=10)
        return subscriber.unregister

    def advertise(self, topic: str, kind: str, latch: bool = False) -> Said:
        """Announce a topic of messages of a type."""
        raw_class = _raw_class(self._rospy.AnyMsg, kind)
        publisher = self._rospy.Publisher(topic, raw_class, queue_size=10, latch=latch)

        def say(message: Any) -> None:
            raw = raw_class()
            raw._buff = bytes(typestore(True).serialize_ros1(message, kind))
            publisher.publish(raw)

        return Said(say, lambda: publisher.get_num_connections() > 0)

    def close(self) -> None:
        """Leave ROS."""
        self._rospy.signal_shutdown("done")


def _rospy() -> Any:
    for place in ("", *_PLACES):
        if place and Path(place, "rospy").is_dir():
            sys.path.append(place)  # behind our own libraries
        try:
            return import_module("rospy")
        except ImportError:
            continue
    raise BagError(
        "expected ROS 1's rospy, found none: install ROS Noetic, or on Debian 12 "
        "`apt-get install --no-install-recommends python3-rosmaster python3-rospy`"
    )


@cache
def _raw_class(base: Any, kind: str) -> Any:
    """A message class of rospy that is sent as the bytes that it is given."""
    text, digest = typestore(True).generate_msgdef(kind)
    fields = {
        "_type": kind.replace("/msg/", "/"), "_md5sum": digest, "_full_text": text,
        "__slots__": [], "_slot_types": [],
    }  # fmt: skip
    return type("Raw", (base,), fields)

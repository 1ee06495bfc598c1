"""What is asked of a node of ROS 1 or 2: all that a live robot and a played one need of either."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from vrchain.ros.formats import Message


@dataclass(frozen=True)
class Said:
    """A topic that is published: ``say`` takes messages made by ``telling.Messages``, ``heard``
    tells whether anyone listens.
    """

    say: Callable[[Any], None]
    heard: Callable[[], bool]


class Node(Protocol):
    """A node. ros1: whether its messages are those of ROS 1."""

    ros1: bool

    def topics(self) -> dict[str, str]:
        """Topics that are published now, and their types."""

    def subscribe(
        self, topic: str, kind: str, take: Callable[[Message], None]
    ) -> Callable[[], None]:
        """Have ``take`` called, in another thread, with each message. Returns what ends it."""

    def advertise(self, topic: str, kind: str, latch: bool = False) -> Said:
        """Announce a topic of messages of a type; ``latch``: the last is for who comes later."""

    def close(self) -> None:
        """Leave ROS."""

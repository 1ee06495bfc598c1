"""ROS 2 without ROS 2: against a rclpy that is as strict, within one process."""

import threading
import time

import fake_rclpy
import numpy as np
import pytest
import ros_roles

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from vrchain.cli import robot
from vrchain.errors import BagError
from vrchain.robot import Drive
from vrchain.ros.formats import Message
from vrchain.ros.messages import TF, TWIST, opened, typestore
from vrchain.ros.playing import PlayedRobot
from vrchain.ros.ros2 import Ros2
from vrchain.ros.telling import Messages

MAKE = Messages(False)


@pytest.fixture
def ros_2(monkeypatch: pytest.MonkeyPatch) -> None:
    fake_rclpy.install(monkeypatch)


def twist(speed_m_s: float) -> object:
    ahead, turn = (
        MAKE.make("geometry_msgs/msg/Vector3", x=x, y=0.0, z=0.0) for x in (speed_m_s, 0.0)
    )
    return MAKE.make(TWIST, linear=ahead, angular=turn)


def until(ready: object) -> None:
    for _ in range(200):
        if ready():
            return
        time.sleep(0.01)
    raise AssertionError("it never came")


def test_messages_come_as_bytes_as_bags_hold_them(ros_2: None) -> None:
    one, other = Ros2("one"), Ros2("drives-R.1")
    said, heard = one.advertise("/R1/cmd_vel", TWIST), []
    assert not said.heard() and other.topics() == {"/R1/cmd_vel": TWIST}
    end = other.subscribe("/R1/cmd_vel", TWIST, heard.append)
    assert said.heard()
    said.say(twist(0.25))
    until(lambda: heard)
    (message,) = heard
    assert isinstance(message, Message) and (message.type, message.ros1) == (TWIST, False)
    assert opened(message).linear.x == 0.25
    end()
    assert not said.heard()
    one.close()
    other.close()


def test_what_is_only_listened_to_is_not_published(ros_2: None) -> None:
    node = Ros2("one")
    node.subscribe("/R1/cmd_vel", TWIST, lambda message: None)
    assert node.topics() == {}
    node.close()


def test_fixed_transforms_reach_who_comes_later(ros_2: None) -> None:
    one, other = Ros2("one"), Ros2("other")
    said, heard = one.advertise("/tf_static", TF, latch=True), []
    said.say(MAKE.make(TF, transforms=[]))
    other.subscribe("/tf_static", TF, heard.append)
    until(lambda: heard)
    one.close()
    other.close()


def test_a_broken_message_does_not_end_the_node(ros_2: None) -> None:
    node, heard = Ros2("one"), []
    said = node.advertise("/R1/cmd_vel", TWIST)
    node.subscribe("/R1/cmd_vel", TWIST, lambda message: heard.append(opened(message)))
    (publisher,) = fake_rclpy.BUS.publishers
    publisher.publish(b"\0\1\0\0broken")
    said.say(twist(1.0))
    until(lambda: heard)
    (warned,) = node._node.warned
    assert "/R1/cmd_vel: a message is broken" in warned
    node.close()


def test_what_is_missing_is_told(ros_2: None, monkeypatch: pytest.MonkeyPatch) -> None:
    node = Ros2("one")
    with pytest.raises(BagError, match="expected ROS 2's stereo_msgs"):
        node.advertise("/x", "stereo_msgs/msg/DisparityImage")
    node.close()
    monkeypatch.setitem(fake_rclpy.sys.modules, "rclpy", None)
    with pytest.raises(BagError, match=r"expected ROS 2's rclpy.*source ROS's setup file"):
        Ros2("one")


def test_which_ros_is_taken(ros_2: None, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("vrchain.ros.ros1.Ros1", lambda name: ("ROS 1", name))
    monkeypatch.setattr("vrchain.ros.ros2.Ros2", lambda name: ("ROS 2", name))
    monkeypatch.setattr(robot, "find_spec", lambda name: object())
    asked = [robot.node_of("n", version) for version in (None, 1, 2)]
    assert [ros for ros, _ in asked] == ["ROS 2", "ROS 1", "ROS 2"]
    monkeypatch.setattr(robot, "find_spec", lambda name: None)
    assert robot.node_of("n")[0] == "ROS 1"


def test_a_robot_is_told_no_number(ros_2: None) -> None:
    """What commands it then is not driven by; the one before goes on until it is too old."""
    node = Ros2("play")
    played = PlayedRobot(node, ros_roles.simulator(), "R1")
    for speed_m_s in (0.5, float("nan"), float("inf")):
        data = bytes(typestore(False).serialize_cdr(twist(speed_m_s), TWIST))
        played._take(Message("/R1/cmd_vel", TWIST, False, 0, data))
        assert played._command == Drive(0.5, 0.0)
    node.close()


def test_a_robot_is_driven(ros_2: None) -> None:
    """The same that is asked of ROS 1, between two nodes."""
    expected, told = ros_roles.expected(), {}
    drives = threading.Thread(
        target=lambda: told.update(ros_roles.drive(Ros2("drive"), expected)), daemon=True
    )
    drives.start()
    ros_roles.play(Ros2("play"), lambda left: drives.is_alive())
    assert told["look"] and told["rig"] and told["glance"], told
    assert told["glance_rad"] == pytest.approx(np.pi / 2)
    assert told["ring_off_m"] < 0.15 and told["rolled_m"] < 0.01
    assert 0.8 < told["driven_m"] < 1.6

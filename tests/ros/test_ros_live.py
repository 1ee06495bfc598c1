"""A robot over ROS 1: one process plays it, another drives it."""

import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from shutil import which
from types import SimpleNamespace as Scan

import numpy as np
import pytest
from worlds import ROOT

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from vrchain.errors import BagError
from vrchain.robot import UNSEEN_M, beams_rad, free_distances_m, steer
from vrchain.ros.contents import Contents, Topic
from vrchain.ros.live import laser_in, ring_of
from vrchain.ros.messages import SCAN
from vrchain.ros.ros1 import Ros1
from vrchain.simulation.sensors import N_BEAMS, RANGE_MAX_M

needs_ros = pytest.mark.skipif(
    which("rosmaster") is None, reason="needs ROS 1: python3-rosmaster and python3-rospy"
)


def scan(ranges: np.ndarray, first_rad: float, step_rad: float) -> Scan:
    return Scan(
        ranges=ranges.astype(np.float32), angle_min=first_rad, angle_increment=step_rad,
        range_min=0.1, range_max=30.0,
    )  # fmt: skip


def test_a_scan_all_around_is_the_range_ring() -> None:
    ranges = 1.0 + np.arange(N_BEAMS) / N_BEAMS
    ring = ring_of(scan(ranges, 0.0, 2 * np.pi / N_BEAMS), np.eye(4))
    assert ring == pytest.approx(ranges, abs=1e-6)


def test_a_laser_that_does_not_see_behind() -> None:
    """There it is not free; ahead, what has no echo is."""
    degrees = np.arange(-90, 91)
    ring = ring_of(scan(np.full(181, np.inf), -np.pi / 2, np.radians(1)), np.eye(4))
    behind = np.abs(np.degrees(beams_rad(N_BEAMS)) - 180) < 86
    assert (ring[behind] == UNSEEN_M).all() and (ring[~behind] == RANGE_MAX_M).all()
    free_m = free_distances_m(ring, np.radians([0, 30, -30, 135, 180, -135]))
    assert (free_m[:3] > 5).all() and (free_m[3:] == 0).all()
    assert steer(np.pi, ring).speed_m_s == 0 < abs(steer(np.pi, ring).turn_rad_s)
    assert steer(0.2, ring).speed_m_s > 0.5
    ranges = np.where(np.abs(degrees) < 10, 2.0, np.nan)
    ring = ring_of(scan(ranges, -np.pi / 2, np.radians(1)), np.eye(4))
    assert ring[0] == 2.0 and ring[6] == UNSEEN_M


def test_where_the_laser_is_mounted_counts() -> None:
    ahead = scan(np.array([2.0, 30.0]), 0.0, np.pi)
    turned = np.eye(4)
    turned[:3] = [[0, -1, 0, 0.3], [1, 0, 0, 0.0], [0, 0, 1, 0.2]]  # looks left, 0.3 m ahead
    ring = ring_of(ahead, turned)
    left, right = (round(np.arctan2(y_m, 0.3) / (2 * np.pi) * N_BEAMS) for y_m in (2.0, -8.0))
    assert ring[left] == pytest.approx(np.hypot(2.0, 0.3))
    assert ring[right] == RANGE_MAX_M  # no echo


def heard(*names: str, frame: str = "laser") -> Contents:
    first = Scan(header=Scan(frame_id=frame))
    turned = np.eye(4)
    turned[:2, :2] = -np.eye(2)
    topics = {name: Topic(name, SCAN, first=first) for name in names}
    return Contents(topics, {("/", "laser"): ("base_link", turned)})


def test_the_laser_is_the_one_that_is_meant_where_it_is_mounted() -> None:
    """One that looks back and is taken to look ahead would steer into what is there."""
    one = heard("/R1/scan")
    assert laser_in(one, "R1", "/R1/", {}, "base_link")[1][0, 0] == -1.0
    topic, pose = laser_in(one, "R1", "/R1/", {"laser_bearing_deg": 90}, "base_link")
    assert topic == "/R1/scan" and pose[:2, 0] == pytest.approx([0.0, 1.0])
    two = heard("/R1/front/scan", "/R1/rear/scan")
    assert laser_in(two, "R1", "/R1/", {"laser": "rear/scan"}, "base_link")[0] == "/R1/rear/scan"
    for contents, rig, words in (
        (two, {}, "/R1/front/scan, /R1/rear/scan are lasers: name one"),
        (one, {"laser": "rear/scan"}, "no sensor_msgs/msg/LaserScan comes as /R1/rear/scan"),
        (one, {"laser_bearing_deg": "left"}, "expected degrees as laser_bearing_deg.*got 'left'"),
        (heard("/R1/scan", frame="lidar"), {}, "no transform leads from its laser, lidar, to base"),
    ):
        with pytest.raises(BagError, match=words):
            laser_in(contents, "R1", "/R1/", rig, "base_link")


@pytest.fixture
def master(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[None]:
    """A ROS master of its own."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    monkeypatch.setenv("ROS_MASTER_URI", f"http://127.0.0.1:{port}")
    monkeypatch.setenv("ROS_IP", "127.0.0.1")
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))
    monkeypatch.setenv("no_proxy", "127.0.0.1,localhost")
    process = subprocess.Popen(["rosmaster", "--core", "-p", str(port)], stdout=subprocess.DEVNULL)
    while process.poll() is None:
        with socket.socket() as asked:
            if asked.connect_ex(("127.0.0.1", port)) == 0:
                break
        time.sleep(0.1)
    yield
    process.terminate()
    process.wait()


def started(*words: str) -> subprocess.Popen:
    path = os.pathsep.join([str(ROOT / "tests"), str(ROOT), os.environ.get("PYTHONPATH", "")])
    return subprocess.Popen(
        [sys.executable, *words], text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        env=os.environ | {"PYTHONPATH": path},
    )  # fmt: skip


@needs_ros
@pytest.mark.timeout(1200)  # two processes, on whatever machine
def test_a_robot_is_driven_by_another_process(master: None) -> None:
    played = started("-m", "ros_roles", "play")
    try:
        out, err = started("-m", "ros_roles", "drive").communicate()
    finally:
        played.terminate()
        played.communicate()
    assert out, err
    told = json.loads(out.splitlines()[-1])
    assert told["look"] and told["rig"] and told["glance"], told
    assert told["glance_rad"] == pytest.approx(np.pi / 2)
    assert told["ring_off_m"] < 0.15  # noise, and readings of float32
    assert 0.8 < told["driven_m"] < 1.6 and told["rolled_m"] < 0.01


@needs_ros
def test_no_master(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", "http://127.0.0.1:9")
    with pytest.raises(BagError, match=r"no ROS master answers.*start `roscore`"):
        Ros1("nobody")


@needs_ros
def test_a_robot_that_is_not_there(master: None, tmp_path: Path) -> None:
    from vrchain.simulation.team import team_ledger

    team_ledger(tmp_path / "ledger", ["R1"], 0).close()
    asked = [
        "robot",
        "run",
        "--ros",
        "--robot",
        "R1=/R1",
        "--simulated",
        "0",
        "--patience",
        "2",
        "--ledger",
    ]
    out, err = started("-m", "vrchain", *asked, str(tmp_path / "ledger")).communicate()
    assert not out and err.count("\n") == 1
    assert "R1: nothing is published below /R1/" in err and "listened for 2 s" in err


@needs_ros
@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_the_barns_mission_over_topics(master: None, tmp_path: Path) -> None:
    """Arrives as it does in one process."""
    asked = ["robot", "play", "scenes/barn.yaml", "-o", str(tmp_path / "played")]
    played = started("-m", "vrchain", *asked)
    try:
        assert played.stdout is not None
        command = played.stdout.readline().partition("drive it by: ")[2].split()
        assert command[:3] == ["vrchain", "robot", "run"]
        out, err = started("-m", *command, "--patience", "600").communicate()
        stands, _ = played.communicate()  # it ends by itself
    finally:
        played.kill()
    assert "R1 arrived" in out.splitlines()[-1], out + err
    assert "in reach and sight" in stands and "not in reach" not in stands

"""The two sides of a test over ROS: one plays a robot, the other drives it."""

import json
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import worlds

from vrchain.geometry import Pose
from vrchain.panorama import Panorama
from vrchain.robot import Drive
from vrchain.ros.live import LiveRobot
from vrchain.ros.nodes import Node
from vrchain.ros.playing import PlayedRobot
from vrchain.ros.ros1 import Ros1
from vrchain.simulation.simulator import Simulator

START = Pose(0.0, 0.0, 0.4)


def simulator() -> Simulator:
    return Simulator(worlds.yard(), {"R1": START}, seed=3, rig=worlds.SMALL_RIG)


def play(node: Node, goes_on: Callable[[bool], bool] = lambda left: not left) -> None:
    PlayedRobot(node, simulator(), "R1").run(goes_on)
    node.close()


def expected() -> Panorama:
    """What it sees where it starts."""
    panorama = simulator().observe("R1", look=True).panorama
    assert panorama is not None
    return panorama


def drive(node: Node, expected: Panorama) -> dict[str, Any]:
    robot = LiveRobot(node, "R1", "/R1", {}, 0.05, patience_s=600.0)
    there = simulator()
    seen, glance = robot.observe(look=True), robot.observe(towards_rad=np.pi / 2)
    told = {
        "look": bool(np.array_equal(seen.panorama.views, expected.views)),
        "rig": seen.panorama.rig == worlds.SMALL_RIG,
        "glance": bool(np.array_equal(glance.panorama.views[0], expected.views[2])),
        "glance_rad": glance.view_rad,
        "ring_off_m": float(np.abs(robot.observe().range_ring_m - there.true_ranges_m("R1")).max()),
    }
    before = robot.observe()
    for _ in range(5):
        robot.drive(Drive(0.5, 0.0), 0.4)
    robot.close()
    time.sleep(1.0)
    after = robot.observe()
    told["driven_m"] = after.odometry.distance_to_m(before.odometry.xy_m)
    time.sleep(1.0)
    told["rolled_m"] = robot.observe().odometry.distance_to_m(after.odometry.xy_m)
    node.close()
    return told


if __name__ == "__main__":
    if sys.argv[1] == "play":
        play(Ros1("play"))
    else:
        print(json.dumps(drive(Ros1("drive"), expected())), flush=True)

"""The two processes of a test over ROS 1: one plays a robot, the other drives it."""

import json
import sys
import time

import numpy as np
import worlds

from vrchain.geometry import Pose
from vrchain.robot import Drive
from vrchain.ros.live import LiveRobot
from vrchain.ros.playing import PlayedRobot
from vrchain.ros.ros1 import Ros1
from vrchain.simulation.simulator import Simulator

START = Pose(0.0, 0.0, 0.4)


def simulator() -> Simulator:
    return Simulator(worlds.yard(), {"R1": START}, seed=3, rig=worlds.SMALL_RIG)


def play() -> None:
    PlayedRobot(Ros1("play"), simulator(), "R1").run(lambda left: not left)


def drive() -> None:
    node = Ros1("drive")
    robot = LiveRobot(node, "R1", "/R1", {}, 0.05, patience_s=600.0)
    there = simulator()
    expected = there.observe("R1", look=True).panorama
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
    print(json.dumps(told), flush=True)
    node.close()


if __name__ == "__main__":
    {"play": play, "drive": drive}[sys.argv[1]]()

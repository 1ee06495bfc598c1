"""A simulated robot behind ROS topics: for whoever drives, it is a robot like another."""

import math
import time
from collections.abc import Callable
from threading import Lock

from vrchain.robot import STOP, Drive
from vrchain.ros.formats import Message
from vrchain.ros.messages import IMAGE, INFO, ODOMETRY, SCAN, TF, TWIST, opened
from vrchain.ros.nodes import Node
from vrchain.ros.telling import Messages, RobotTopics
from vrchain.simulation.simulator import Simulator

_STEP_S = 0.1  # between two messages of odometry
_DRIVES_ON_S = 0.4  # after a command, as a robot's own watchdog has it
_SHOWS_EVERY_S = 0.3
_INFORMS_EVERY_S = 1.0
_LEFT_S = 5.0  # since nobody listens to odometry any more


class PlayedRobot:
    """One robot of a simulator, on topics below its name; ``run`` plays it.

    Pictures are drawn only while somebody listens to them, and stopped clocks stand while they are.
    """

    def __init__(self, ros: Node, simulator: Simulator, name: str) -> None:
        self._simulator, self._name = simulator, name
        self._topics = RobotTopics(name, simulator.rig, Messages(ros.ros1), None)
        self._command, self._until_s, self._lock = STOP, 0.0, Lock()
        own, kinds = f"/{name}", {"odom": ODOMETRY, "scan": SCAN}
        self._said = {f"{own}/{t}": ros.advertise(f"{own}/{t}", k) for t, k in kinds.items()}
        self._said["/tf"] = ros.advertise("/tf", TF)
        self._cameras = []
        for k in range(simulator.rig.n_views):
            camera = f"{own}/camera_{k}"
            self._cameras.append(ros.advertise(f"{camera}/image_raw", IMAGE))
            self._said[f"{camera}/camera_info"] = ros.advertise(f"{camera}/camera_info", INFO)
        self._fixed = ros.advertise("/tf_static", TF, latch=True)
        fixed = self._topics.fixed(simulator.clock_ns)
        self._fixed.say(self._topics.make.make(TF, transforms=fixed))
        ros.subscribe(f"{own}/cmd_vel", TWIST, self._take)

    def _take(self, message: Message) -> None:
        twist = opened(message)
        speed_m_s, turn_rad_s = float(twist.linear.x), float(twist.angular.z)
        if not (math.isfinite(speed_m_s) and math.isfinite(turn_rad_s)):
            return
        with self._lock:
            self._command = Drive(speed_m_s, turn_rad_s)
            self._until_s = time.monotonic() + _DRIVES_ON_S

    def run(self, goes_on: Callable[[bool], bool]) -> None:
        """Play until ``goes_on``, told whether who drove it has left, says no.

        Time is real, or slower.
        """
        shown_s = informed_s = heard_s = 0.0
        odometry = self._said[f"/{self._name}/odom"]
        while goes_on(self._until_s > 0 and time.monotonic() - heard_s > _LEFT_S):
            began_s = time.monotonic()
            if odometry.heard():
                heard_s = began_s
            with self._lock:
                command = self._command if began_s < self._until_s else STOP
            self._simulator.step({self._name: command}, _STEP_S)
            seen = self._simulator.observe(self._name)
            for topic, message in self._topics.sensed(seen):
                self._said[topic].say(message)
            if began_s - informed_s > _INFORMS_EVERY_S:
                informed_s = began_s
                for topic, message in self._topics.informed(seen.time_ns):
                    self._said[topic].say(message)
            if began_s - shown_s > _SHOWS_EVERY_S and any(c.heard() for c in self._cameras):
                self._show()
                shown_s = time.monotonic()
            time.sleep(max(0.0, _STEP_S - (time.monotonic() - began_s)))

    def _show(self) -> None:
        """The cameras that are listened to."""
        wanted = [k for k, camera in enumerate(self._cameras) if camera.heard()]
        rig = self._simulator.rig
        if len(wanted) == 1:
            towards_rad = float(rig.azimuths_rad[wanted[0]])
            seen = self._simulator.observe(self._name, towards_rad=towards_rad)
            assert seen.panorama is not None
            views = {wanted[0]: seen.panorama.views[0]}
        else:
            seen = self._simulator.observe(self._name, look=True)
            assert seen.panorama is not None
            views = {k: seen.panorama.views[k] for k in wanted}
        for k, view in views.items():
            self._cameras[k].say(self._topics.image(seen.time_ns, k, view))

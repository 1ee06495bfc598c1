"""Legs that are barred by something that nobody knows of until a robot drives there.

It is a row of parked robots across the middle of the way.
"""

import contextlib

import numpy as np
from numpy.typing import NDArray

from vrchain.errors import PoseError
from vrchain.geometry import Pose
from vrchain.navigation.settings import Decision
from vrchain.seeding import generator
from vrchain.simulation.simulator import Simulator
from vrchain.world.model import ROBOT_RADIUS_M

ROW_M = 6.0  # wide
_LEAST_M = 6.0  # of way: before less there is no room for a row
_SAME_M = 8.0  # legs that end so near to each other are one leg
_GAP_M = 0.05  # between parked robots: nothing gets through


class Barred:
    """Bars a share of the legs that a robot decides to drive, each once; told all decisions."""

    def __init__(self, simulator: Simulator, robot: str, share: float, seed: int) -> None:
        self._simulator, self._robot, self._share = simulator, robot, share
        self._draws = generator(seed, "barred")
        self._ends: list[NDArray[np.float64]] = []
        self.rows = 0

    def tell(self, decision: Decision) -> None:
        """Bar the leg that was decided on, or not."""
        if decision.what != "leg":
            return
        pose, way_m = self._simulator.pose(self._robot), float(decision.values["range_m"])
        course = pose.yaw_rad + np.radians(decision.values["bearing_deg"])
        ahead = np.array([np.cos(course), np.sin(course)])
        end = pose.xy_m + way_m * ahead
        if way_m < _LEAST_M or any(np.hypot(*(end - other)) < _SAME_M for other in self._ends):
            return
        self._ends.append(end)
        if self._draws.uniform() < self._share:
            self._park(pose.xy_m + way_m / 2 * ahead, float(course))

    def _park(self, middle: NDArray[np.float64], course_rad: float) -> None:
        """Robots side by side, where nothing stands already."""
        across = np.array([-np.sin(course_rad), np.cos(course_rad)])
        step_m = 2 * ROBOT_RADIUS_M + _GAP_M
        half, before = round(ROW_M / step_m) // 2, len(self._simulator.robots)
        for k in range(-half, half + 1):
            x_m, y_m = middle + k * step_m * across
            with contextlib.suppress(PoseError):
                place = Pose(float(x_m), float(y_m), course_rad)
                self._simulator.put(f"parked {self.rows}, {k}", place)
        self.rows += len(self._simulator.robots) > before

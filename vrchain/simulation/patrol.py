"""Robots that drive about and publish, before a mission and while it runs."""

from collections.abc import Mapping

import numpy as np

from vrchain.robot import Drive, Wander, wander
from vrchain.seeding import generator
from vrchain.simulation.simulator import Simulator
from vrchain.simulation.team import PublishingRobot

LOOK_EVERY_M = 12.0
_DECIDES_EVERY_S = 0.6
_BEEN_EVERY_M = 5.0


class Patrol:
    """Robots that drive about, rather where they have not been, and publish by the update rules."""

    def __init__(
        self,
        simulator: Simulator,
        robots: Mapping[str, PublishingRobot],
        seed: int,
        look_every_m: float = LOOK_EVERY_M,
    ) -> None:
        self._simulator, self._robots, self._look_every_m = simulator, dict(robots), look_every_m
        self._draws = {name: generator(seed, "patrol", name) for name in robots}
        self._minds = dict.fromkeys(robots, Wander())
        self._been: dict[str, list[np.ndarray]] = {name: [] for name in robots}
        self._drives: dict[str, Drive] = {}
        self._decides_ns = 0

    def drive(self, duration_s: float) -> None:
        """Let them patrol for a while."""
        until_ns = self._simulator.clock_ns + int(duration_s * 1e9)
        while self._simulator.clock_ns < until_ns:
            self._simulator.step(self.drives(), _DECIDES_EVERY_S)

    def leave(self, name: str) -> None:
        """This robot has something else to do from now on."""
        self._robots.pop(name, None)
        self._drives = {other: drive for other, drive in self._drives.items() if other != name}

    def drives(self) -> Mapping[str, Drive]:
        """What each does now; they look, publish and decide in between."""
        now_ns = self._simulator.clock_ns
        if now_ns >= self._decides_ns:
            self._decides_ns = now_ns + int(_DECIDES_EVERY_S * 1e9)
            self._drives = {name: self._drive_of(name) for name in self._robots}
        return self._drives

    def _drive_of(self, name: str) -> Drive:
        seen, been = self._robots[name].watch(self._look_every_m), self._been[name]
        here_m = seen.odometry.xy_m
        if not been or np.hypot(*(here_m - been[-1])) >= _BEEN_EVERY_M:
            been.append(here_m)
        drive, self._minds[name] = wander(
            seen, self._draws[name], self._minds[name], np.array(been)
        )
        return drive

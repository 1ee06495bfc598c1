"""Robots that each follow a mind of their own in one scene, all driving at one clock.

A mind is a function that drives its robot: a mission, as it is driven by one robot alone. Each runs
until its robot drives for a while; when all do, the scene moves on to where the first is due. They
take turns in one thread (greenlets), in the order given, so that the same seed gives the same
bytes.
"""

from collections.abc import Callable, Mapping
from typing import TypeVar

from greenlet import greenlet

from vrchain.robot import Drive
from vrchain.simulation.simulator import Simulator
from vrchain.simulation.team import SimulatedBody

T = TypeVar("T")


class Together:
    """One clock for several minds."""

    def __init__(self, simulator: Simulator) -> None:
        self.simulator = simulator
        self._driving: dict[str, tuple[Drive, int]] = {}  # how, and until when
        self._between: greenlet | None = None

    def body(self, simulator: Simulator, name: str) -> SimulatedBody:
        """A robot's body, to be driven by a mind (``assemble``'s ``body_of``)."""
        return _Sharing(simulator, name, self)

    def run(self, minds: Mapping[str, Callable[[], T]]) -> dict[str, T]:
        """Let each robot's mind drive it until it ends; robots without one stand still.

        What the minds returned. An error of one ends all, and is raised.
        """
        found: dict[str, T] = {}

        def live(name: str, mind: Callable[[], T]) -> None:
            found[name] = mind()
            self._driving.pop(name, None)

        self._between = greenlet.getcurrent()
        living = {name: greenlet(lambda n=name, m=mind: live(n, m)) for name, mind in minds.items()}
        try:
            while living:
                now_ns = self.simulator.clock_ns
                for name in list(living):
                    if name not in self._driving or self._driving[name][1] <= now_ns:
                        living[name].switch()
                        if living[name].dead:
                            del living[name]
                if living:
                    until_ns = min(until_ns for _, until_ns in self._driving.values())
                    drives = {name: drive for name, (drive, _) in self._driving.items()}
                    self.simulator.step(drives, (until_ns - now_ns) / 1e9)
            return found
        finally:
            self._between = None
            for one in living.values():  # what was begun is ended in its own place
                one.throw()
            self._driving.clear()

    def drive(self, name: str, command: Drive, duration_s: float) -> None:
        """Wait while a robot drives; outside of ``run``, let the time pass."""
        if self._between is None:
            self.simulator.step({name: command}, duration_s)
            return
        until_ns = self.simulator.clock_ns + round(duration_s * 1e9)
        self._driving[name] = command, until_ns
        self._between.switch()


class _Sharing(SimulatedBody):
    """A body whose time passes only when all others' does."""

    def __init__(self, simulator: Simulator, name: str, together: Together) -> None:
        super().__init__(simulator, name)
        self._together = together

    def drive(self, command: Drive, duration_s: float) -> None:
        """Drive so for a while; the others do as their minds say."""
        self._together.drive(self.name, command, duration_s)

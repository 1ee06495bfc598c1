"""A team of simulated robots: a robot publishes whenever it looks and an update rule says so."""

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, astuple, dataclass
from pathlib import Path

import numpy as np

from vrchain.ledger import Ledger, simulated_key
from vrchain.publisher import Examine, Publication, Publisher, PublishingBody, Told
from vrchain.robot import Drive, Observation, UpdateRules, steer
from vrchain.simulation.simulator import Simulator
from vrchain.simulation.task import Task

_TICK_S = 0.5


@dataclass(frozen=True)
class LocatedPublication(Publication):
    """With the true pose, for evaluation.

    others: where the other robots stood then, JSON of name to [x_m, y_m, yaw_rad].
    """

    x_m: float
    y_m: float
    yaw_rad: float
    others: str


class SimulatedBody:
    """A simulated robot's senses and wheels."""

    def __init__(self, simulator: Simulator, name: str) -> None:
        self.simulator, self.name = simulator, name
        self.others: Callable[[], Mapping[str, Drive]] = dict  # what they do as this one drives

    def observe(self, look: bool = False, towards_rad: float | None = None) -> Observation:
        """What it senses now."""
        return self.simulator.observe(self.name, look=look, towards_rad=towards_rad)

    def watch(self) -> Observation:
        """What it senses without a look around: it publishes nothing."""
        return self.observe()

    def drive(self, command: Drive, duration_s: float) -> None:
        """Drive so for a while; the others do what ``others`` says: stand, if nothing was said."""
        self.simulator.step({**self.others(), self.name: command}, duration_s)

    def located(self, published: Publication) -> LocatedPublication:
        """With where it and the others truly are now."""
        pose = self.simulator.pose(self.name)
        team = {name: astuple(other) for name, other in self.simulator.others(self.name).items()}
        return LocatedPublication(**asdict(published), **asdict(pose), others=json.dumps(team))


PublishingRobot = PublishingBody[SimulatedBody, LocatedPublication]


def team_ledger(folder: str | Path, robots: Iterable[str], seed: int) -> Ledger:
    """A new ledger; members' and operator's keys derive from the seed, as ``assemble``'s do."""
    members = {name: simulated_key(seed, name).public for name in robots}
    return Ledger.create(folder, members, simulated_key(seed, "operator"))


def assemble(
    simulator: Simulator,
    ledger: Ledger,
    seed: int,
    rules: UpdateRules | None = None,
    examine: Examine | None = None,
    body_of: Callable[[Simulator, str], SimulatedBody] = SimulatedBody,
    told: Mapping[str, Told] | None = None,
) -> dict[str, PublishingRobot]:
    """The simulator's robots, able to publish with keys that derive from the seed.

    examine: extracts the landmarks that are published with each panorama; none are, without.
    told: what those who are not honest say of what they see.
    """
    told = told or {}
    return {
        body.name: PublishingBody(
            body,
            Publisher(
                body.name,
                ledger,
                simulated_key(seed, body.name),
                rules,
                examine,
                told.get(body.name),
            ),
            body.located,
        )
        for body in (body_of(simulator, name) for name in simulator.robots)
    }


def drive_to_places(
    simulator: Simulator,
    robots: Mapping[str, PublishingRobot | SimulatedBody],
    task: Task,
    rest_s: float = UpdateRules().max_age_s,
) -> None:
    """All robots drive to their places at once, by odometry, and publish as they go.

    Then they wait for ``rest_s``, until the third rule, time, has each publish what it sees from
    there.
    """
    goals = {}  # in the frames of their odometry
    for name in robots:
        start, place_m = task.starts[name], task.places[name].xy_m
        bearing = start.bearing_to_rad(place_m)
        ahead = np.array([np.cos(bearing), np.sin(bearing)])
        goals[name] = start.distance_to_m(place_m) * ahead
    deadline_ns = simulator.clock_ns + int(60e9)
    driving = set(robots)
    while driving and simulator.clock_ns < deadline_ns:
        commands = {}
        for name in sorted(driving):
            seen = robots[name].watch()
            if seen.odometry.distance_to_m(goals[name]) < 0.3:
                driving.remove(name)
            else:
                commands[name] = steer(seen.odometry.bearing_to_rad(goals[name]), seen.range_ring_m)
        simulator.step(commands, _TICK_S)
    simulator.step({}, rest_s)
    for robot in robots.values():
        robot.watch()

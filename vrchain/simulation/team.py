"""A team of simulated robots: a robot publishes whenever it looks and an update rule says so."""

import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import astuple, dataclass, replace
from pathlib import Path

import numpy as np

from vrchain.geometry import Pose, relative
from vrchain.landmarks.extraction.record import LandmarkRecord, encode_record
from vrchain.ledger import Ledger, SigningKey, simulated_key
from vrchain.panorama import Panorama
from vrchain.robot import Drive, Observation, UpdateMonitor, UpdateRules, steer
from vrchain.simulation.simulator import Simulator
from vrchain.simulation.task import Task

LOOK_EVERY_M = 2.5
_TICK_S = 0.5


@dataclass(frozen=True)
class Publication:
    """One transaction as its robot published it, with the true pose for evaluation.

    others: where the other robots stood then, JSON of name to [x_m, y_m, yaw_rad].
    """

    robot: str
    time_s: float
    rule: str
    digest: str
    payload_bytes: int
    x_m: float
    y_m: float
    yaw_rad: float
    others: str


class PublishingRobot:
    """A simulated robot's senses and wheels; whenever it looks, the update rules may publish.

    A mission can be driven on it (``navigation.settings.Body``). examine: its landmarks are
    extracted before it signs, and published beside the panorama, with how it moved since the one
    before.
    """

    def __init__(
        self,
        simulator: Simulator,
        name: str,
        ledger: Ledger,
        key: SigningKey,
        rules: UpdateRules,
        examine: Callable[[Observation], LandmarkRecord] | None = None,
    ) -> None:
        self.simulator, self.name, self._ledger, self._key = simulator, name, ledger, key
        self._examine = examine
        self.monitor = UpdateMonitor(rules)
        self.publications: list[Publication] = []
        self.others: Callable[[], Mapping[str, Drive]] = dict  # what they do as this one drives
        self._looked: Observation | None = None
        self._published: Pose | None = None  # where, by odometry, the last panorama was taken

    def observe(self, look: bool = False, towards_rad: float | None = None) -> Observation:
        """What it senses now; a look all around publishes if a rule says so."""
        if towards_rad is not None:
            glance = self.simulator.observe(self.name, towards_rad=towards_rad)
            self.monitor.due(replace(glance, panorama=None))
            return glance
        seen = self.simulator.observe(self.name, look=look)
        rule = self.monitor.due(seen)
        if look:
            seen = self._looked = self._publish(seen, rule) if rule else seen
        return seen

    def watch(self, look_every_m: float = LOOK_EVERY_M) -> Observation:
        """Observe, and look if the last look is some way or time ago: looking costs."""
        last = self._looked
        seen = self.simulator.observe(self.name)
        if last is not None:
            moved_m = last.odometry.distance_to_m(seen.odometry.xy_m)
            waited_s = (seen.time_ns - last.time_ns) / 1e9
            if moved_m < look_every_m and waited_s < self.monitor.rules.max_age_s:
                self.monitor.due(seen)
                return seen
        return self.observe(look=True)

    def drive(self, command: Drive, duration_s: float) -> None:
        """Drive so for a while; the others do what ``others`` says: stand, if nothing was said."""
        self.simulator.step({**self.others(), self.name: command}, duration_s)

    def _publish(self, seen: Observation, rule: str) -> Observation:
        """What it saw, as all others will see it."""
        assert seen.panorama is not None
        blob = seen.panorama.encode()
        landmarks = None
        if self._examine is not None:
            seen = replace(seen, panorama=Panorama.decode(blob))  # else none could extract it again
            before, self._published = self._published, seen.odometry
            moved = None if before is None else relative(before, seen.odometry)
            landmarks = encode_record(replace(self._examine(seen), moved=moved))
        entry = self._ledger.publish(
            self.name, self._key, blob, rule, seen.time_ns, landmarks=landmarks
        )
        self.monitor.published(seen)
        pose = self.simulator.pose(self.name)
        team = {name: astuple(other) for name, other in self.simulator.others(self.name).items()}
        published = Publication(
            self.name, seen.time_ns / 1e9, rule, entry.payload_digest.hex(), len(blob),
            pose.x_m, pose.y_m, pose.yaw_rad, json.dumps(team),
        )  # fmt: skip
        self.publications.append(published)
        return seen


def team_ledger(folder: str | Path, robots: Iterable[str], seed: int) -> Ledger:
    """A new ledger; members' and operator's keys derive from the seed, as ``assemble``'s do."""
    members = {name: simulated_key(seed, name).public for name in robots}
    return Ledger.create(folder, members, simulated_key(seed, "operator"))


def assemble(
    simulator: Simulator,
    ledger: Ledger,
    seed: int,
    rules: UpdateRules | None = None,
    examine: Callable[[Observation], LandmarkRecord] | None = None,
) -> dict[str, PublishingRobot]:
    """The simulator's robots, able to publish with keys that derive from the seed.

    examine: extracts the landmarks that are published with each panorama; none are, without.
    """
    rules = rules or UpdateRules()
    return {
        name: PublishingRobot(simulator, name, ledger, simulated_key(seed, name), rules, examine)
        for name in simulator.robots
    }


def drive_to_places(
    simulator: Simulator, robots: Mapping[str, PublishingRobot], task: Task
) -> None:
    """All robots drive to their places at once, by odometry, and publish as they go.

    Then they wait until the third rule, time, has had each publish what it sees from there.
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
    simulator.step({}, max(r.monitor.rules.max_age_s for r in robots.values()))
    for robot in robots.values():
        robot.watch()

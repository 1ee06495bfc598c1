"""Bags published as their robots would have: the same looks, rules, landmarks and signatures.

The first reading tells when to look; the second opens the pictures of those looks alone. What was
published before a break is found in the ledger, and the same call goes on from there.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from itertools import combinations
from pathlib import Path

import numpy as np

from vrchain.errors import BagError, ImageError
from vrchain.geometry import Pose
from vrchain.ledger import Ledger, SigningKey
from vrchain.panorama import Panorama
from vrchain.panorama.panorama import pack
from vrchain.publisher import LOOK_EVERY_M, Examine, Publication, Publisher, look_due
from vrchain.robot import Observation, UpdateRules
from vrchain.ros.cameras import picture_of
from vrchain.ros.contents import contents_of
from vrchain.ros.formats import Message, Tell
from vrchain.ros.messages import is_jpeg, opened
from vrchain.ros.robots import Moment, Recorded, load_rig, robot_in
from vrchain.ros.storage import messages

SLOP_S = 0.05
_AHEAD_NS = 60_000_000_000  # by which a clock may be ahead
_TRIES = 3  # of later moments, where a look's pictures are broken


@dataclass(frozen=True)
class Look:
    """A moment at which the robot would have looked around, and where it was by odometry."""

    moment: Moment
    pose: Pose


@dataclass(eq=False)
class _Pictures:
    """Of each topic, messages by number: who asked for them, for which look and camera; and the
    number of the last one that was read."""

    asked: dict[str, dict[int, list[tuple["_Player", int, int]]]]
    seen: dict[str, int]


@dataclass(eq=False)
class _Player:
    """One robot's recording, played to its publisher look by look."""

    recorded: Recorded
    publisher: Publisher
    ledger: Ledger
    tell: Tell
    looks: list[Look]
    pictures: "_Pictures"
    pending: list[dict[int, Message]] = field(default_factory=list)
    next: int = 0
    told: int = 0  # messages of odometry that the publisher has been shown
    tries: int = 0  # of moments for one look
    broken: int = 0
    earlier: int = 0
    publications: list[Publication] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.pending = [{} for _ in self.looks]
        self._jumps = list(self.recorded.way.jumps_ns)
        self._resume()
        for topic in self.recorded.topics:
            self.pictures.asked.setdefault(topic, {})
        for look in range(self.next, len(self.looks)):
            self.ask(look)

    def _resume(self) -> None:
        """Go on after what the ledger holds of this robot."""
        last = self.ledger.latest(self.publisher.robot)
        if last is None:
            return
        then_ns = last.timestamp_ns
        self.earlier = self.next = sum(look.moment.time_ns <= then_ns for look in self.looks)
        moments = {moment.time_ns for moment in self.recorded.moments}
        known = {t.timestamp_ns for t in self.ledger.history(self.publisher.robot)}
        if self.earlier and not moments & known:
            told = (
                f"{self.publisher.robot}: {self.earlier} of {len(self.looks)} looks are older than "
                f"its newest transaction, of {then_ns / 1e9:.2f} s, and were never published: "
                "publish recordings in the order of time"
            )
            if self.earlier == len(self.looks):
                raise BagError(told)
            self.tell(told)
        here = self.recorded.way.at(then_ns)
        if here is not None and then_ns in moments:
            self._drive_to(then_ns)
            self.publisher.resume(here)

    def ask(self, look: int) -> None:
        """Ask for the pictures of a look."""
        numbers = self.looks[look].moment.numbers
        for camera, (topic, number) in enumerate(zip(self.recorded.topics, numbers, strict=True)):
            self.pictures.asked[topic].setdefault(number, []).append((self, look, camera))

    def take(self, look: int, camera: int, message: Message) -> None:
        """A picture; publishes what is complete by it, in the order of time."""
        self.pending[look][camera] = message
        cameras = range(len(self.recorded.topics))
        while self.next < len(self.looks) and len(self.pending[self.next]) == len(cameras):
            coded, self.pending[self.next] = self.pending[self.next], {}
            if self._look(self.looks[self.next], [coded[k] for k in cameras]):
                self.next, self.tries = self.next + 1, 0

    def played(self) -> "Played":
        """What came of it, in the end."""
        told = (self.publisher.robot, len(self.looks), self.broken, self.earlier)
        return Played(*told, tuple(self.publications))

    def _look(self, look: Look, coded: Sequence[Message]) -> bool:
        """Whether that look is done; if its pictures are broken, those of the next moment serve."""
        try:
            panorama, blob = self._panorama(coded)
        except (BagError, ImageError) as error:
            self.tell(f"{self.publisher.robot} at {look.moment.time_ns / 1e9:.2f} s: {error}")
            later = self._later(look) if self.tries < _TRIES else None
            if later is None:
                self.broken += 1
                return True
            self.looks[self.next], self.tries = later, self.tries + 1
            self.ask(self.next)
            return False
        self._drive_to(look.moment.time_ns)
        _, published = self.publisher.looked(_observation(look, panorama), blob)
        if published is not None:
            self.publications.append(published)
        return True

    def _later(self, look: Look) -> Look | None:
        """The next moment before the next look, of pictures that are still to come."""
        following = self.looks[self.next + 1 : self.next + 2]
        for moment in self.recorded.moments:
            if moment.time_ns <= look.moment.time_ns:
                continue
            if following and moment.time_ns >= following[0].moment.time_ns:
                break
            told = zip(self.recorded.topics, moment.numbers, strict=True)
            pose = self.recorded.way.at(moment.time_ns)
            if pose is not None and all(number > self.pictures.seen[t] for t, number in told):
                return Look(moment, pose)
        return None

    def _panorama(self, coded: Sequence[Message]) -> tuple[Panorama, bytes | None]:
        recorded, images = self.recorded, [opened(message) for message in coded]
        told = zip(recorded.topics, images, recorded.labels, recorded.ring.cameras, strict=True)
        pictures = [picture_of(*one) for one in told]
        panorama = recorded.ring.panorama(pictures)
        own = recorded.ring.exact and not any(recorded.labels) and all(map(is_jpeg, images))
        rig = recorded.ring.rig
        return panorama, pack(rig, "jpeg", [bytes(i.data) for i in images]) if own else None

    def _drive_to(self, time_ns: int) -> None:
        """Show the publisher the odometry before that time."""
        way = self.recorded.way
        while self.told < len(way.times_ns) and way.times_ns[self.told] < time_ns:
            now_ns = int(way.times_ns[self.told])
            if self._jumps and now_ns >= self._jumps[0]:
                self._jumps.pop(0)
                self.publisher.lost_track()
            pose = Pose(*map(float, way.poses[self.told]))
            self.publisher.passed(Observation(now_ns, pose, np.zeros(0)))
            self.told += 1


def _observation(look: Look, panorama: Panorama | None) -> Observation:
    return Observation(look.moment.time_ns, look.pose, np.zeros(0), panorama=panorama)


def looks_of(recorded: Recorded, look_every_m: float, max_age_s: float) -> list[Look]:
    """When the robot would have looked around: as it does live, by way and time alone. BagError."""
    found: list[Look] = []
    last = None
    for moment in recorded.moments:
        pose = recorded.way.at(moment.time_ns)
        if pose is None or (last is not None and moment.time_ns <= last.time_ns):
            continue
        look = Look(moment, pose)
        seen = _observation(look, None)
        if look_due(last, seen, look_every_m, max_age_s):
            found.append(look)
            last = seen
    if not found:
        raise BagError("no moment has both pictures and odometry within 1 s of them")
    return found


@dataclass(frozen=True)
class Played:
    """What came of one robot's recording.

    broken: looks whose pictures could not be read; earlier: looks that an earlier call has done.
    """

    robot: str
    looks: int
    broken: int
    earlier: int
    publications: tuple[Publication, ...]


def publish_bags(
    bags: Sequence[str | Path],
    ledger: Ledger,
    keys: Mapping[str, SigningKey],
    robots: Mapping[str, str],
    *,
    rig: Path | None = None,
    look_every_m: float = LOOK_EVERY_M,
    slop_s: float = SLOP_S,
    rules: UpdateRules | None = None,
    examine: Examine | None = None,
    tell: Tell = lambda line: None,
    now_ns: int | None = None,
) -> list[Played]:
    """Publish what robots recorded, each as if it had done so itself.

    robots: name to the namespace of its topics. keys: theirs. rig: a file that tells what the bags
    do not. slop_s: how far apart in time the cameras' pictures of one panorama may be. tell: is
    given a line for each thing that is mended or left out. now_ns: a clock that ran ahead of that
    by more than a minute is refused. BagError before anything is published; the ledger's errors as
    ``Ledger.publish``; what was published before stays.
    """
    _check_apart(robots)
    contents, told = contents_of(bags, tell), load_rig(rig)
    rules = rules or UpdateRules()
    pictures = _Pictures({}, {})
    players = []
    for name, namespace in robots.items():
        recorded = robot_in(contents, name, namespace, told, slop_s, tell)
        try:
            looks = looks_of(recorded, look_every_m, rules.max_age_s)
        except BagError as error:
            raise BagError(f"{name}: {error}") from None
        if now_ns is not None and looks[-1].moment.time_ns > now_ns + _AHEAD_NS:
            when = datetime.fromtimestamp(looks[-1].moment.time_ns / 1e9, UTC)
            raise BagError(
                f"{name}: expected a recording of the past, it ends at {when:%Y-%m-%d %H:%M} UTC: "
                "whose clock is wrong? Nothing earlier could be published by that robot any more"
            )
        publisher = Publisher(name, ledger, keys[name], rules, examine)
        players.append(_Player(recorded, publisher, ledger, tell, looks, pictures))
    del contents
    seen = pictures.seen = dict.fromkeys(pictures.asked, -1)
    for message in messages(bags):
        if message.topic in seen:
            seen[message.topic] += 1
            for player, look, camera in pictures.asked[message.topic].pop(seen[message.topic], ()):
                player.take(look, camera, message)
    return [player.played() for player in players]


def _check_apart(robots: Mapping[str, str]) -> None:
    """BagError if two robots would be told by the same topics."""
    for (one, own), (other, second) in combinations(robots.items(), 2):
        begin, end = sorted((own.rstrip("/") + "/", second.rstrip("/") + "/"), key=len)
        if end.startswith(begin):
            raise BagError(f"{one} and {other}: expected namespaces apart, got {own} and {second}")

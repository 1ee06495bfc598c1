"""What a robot publishes: the same for one that is simulated, lives, or was recorded in a bag.

It monitors what the robot observes, signs what an update rule calls for, and publishes it.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Generic, TypeVar

import numpy as np

from vrchain.errors import ImageError
from vrchain.geometry import Pose, relative
from vrchain.landmarks.extraction.record import LandmarkRecord, encode_record
from vrchain.ledger import Ledger, SigningKey
from vrchain.ledger.errors import DroppedError
from vrchain.navigation.settings import Body
from vrchain.panorama import Panorama
from vrchain.robot import Drive, Observation, UpdateMonitor, UpdateRules

LOOK_EVERY_M = 2.5

Examine = Callable[[Observation], LandmarkRecord]
Told = Callable[[Observation], Observation | None]
"""What a robot says of an observation: itself, if it is honest; None: nothing."""
B = TypeVar("B", bound=Body)
P = TypeVar("P")


@dataclass(frozen=True)
class Publication:
    """One transaction as its robot published it."""

    robot: str
    time_s: float
    rule: str
    digest: str
    payload_bytes: int


def look_due(
    last: Observation | None, seen: Observation, look_every_m: float, max_age_s: float
) -> bool:
    """Whether the last look is some way or time ago."""
    if last is None:
        return True
    moved_m = last.odometry.distance_to_m(seen.odometry.xy_m)
    return moved_m >= look_every_m or (seen.time_ns - last.time_ns) / 1e9 >= max_age_s


class Publisher:
    """Publishes for one robot; it is shown all that the robot observes, in the order of time.

    examine: its landmarks are extracted before it signs, and published beside the panorama, with
    how it moved since the one before. told: what it says of a look around, if that is not so.
    """

    def __init__(
        self,
        robot: str,
        ledger: Ledger,
        key: SigningKey,
        rules: UpdateRules | None = None,
        examine: Examine | None = None,
        told: Told | None = None,
    ) -> None:
        self.robot, self._ledger, self._key, self._examine = robot, ledger, key, examine
        self._told = told
        self.monitor = UpdateMonitor(rules)
        self._looked: Observation | None = None
        self._published: Pose | None = None  # where, by odometry, the last panorama was taken
        self._n_lost = 0  # times that its odometry was set anew, by whoever hears of it

    def wants_look(self, seen: Observation, look_every_m: float = LOOK_EVERY_M) -> bool:
        """Whether the last look is some way or time ago: looking costs."""
        return look_due(self._looked, seen, look_every_m, self.monitor.rules.max_age_s)

    def passed(self, seen: Observation) -> None:
        """The robot was there, without a look around."""
        self.monitor.due(replace(seen, panorama=None))

    def looked(
        self, seen: Observation, blob: bytes | None = None
    ) -> tuple[Observation, Publication | None]:
        """The look as others will see it, and what was published of it if a rule says so.

        blob: the panorama as it is to be published, if it is encoded already. Raises as
        ``Ledger.publish``; then nothing was published.
        """
        rule, published = self.monitor.due(seen), None
        if rule is not None:
            said = seen if self._told is None else self._told(seen)
            if said is seen:
                seen, published = self._publish(seen, rule, blob)
            elif said is not None:
                _, published = self._publish(said, rule, None)
                self.monitor.published(seen)
        self._looked = seen
        return seen, published

    def resume(self, here: Pose) -> None:
        """Go on from what this robot published last, if anything; by odometry that was ``here``."""
        last = self._ledger.latest(self.robot)
        if last is None:
            return
        try:
            panorama = Panorama.decode(self._ledger.payload(last.payload_digest))
        except (DroppedError, ImageError):  # or anything else that was appended for it
            panorama = None
        seen = Observation(last.timestamp_ns, here, np.zeros(0), panorama=panorama)
        self.monitor.published(seen)
        self._looked, self._published = seen, here

    def lost_track(self) -> None:
        """How it moved since it last published is not known: the next record says nothing of it."""
        self._published, self._n_lost = None, self._n_lost + 1

    def _publish(
        self, seen: Observation, rule: str, blob: bytes | None
    ) -> tuple[Observation, Publication]:
        assert seen.panorama is not None
        blob = blob or seen.panorama.encode()
        landmarks, before, n_lost = None, self._published, self._n_lost
        if self._examine is not None:
            seen = replace(seen, panorama=Panorama.decode(blob))  # else none could extract it again
            moved = None if before is None else relative(before, seen.odometry)
            landmarks = encode_record(replace(self._examine(seen), moved=moved))
        entry = self._ledger.publish(
            self.robot, self._key, blob, rule, seen.time_ns, landmarks=landmarks
        )
        self._published = seen.odometry if n_lost == self._n_lost else None  # lost meanwhile
        self.monitor.published(seen)
        digest = entry.payload_digest.hex()
        return seen, Publication(self.robot, seen.time_ns / 1e9, rule, digest, len(blob))


class PublishingBody(Generic[B, P]):
    """A body whose looks around are published; a mission can be driven on it (``Body``).

    note: what is kept of each publication, in ``publications``.
    """

    def __init__(self, body: B, publisher: Publisher, note: Callable[[Publication], P]) -> None:
        self.body, self.publisher, self._note = body, publisher, note
        self.publications: list[P] = []

    def observe(self, look: bool = False, towards_rad: float | None = None) -> Observation:
        """What it senses now; a look all around publishes if a rule says so."""
        seen = self.body.observe(look, towards_rad)
        if towards_rad is not None or not look:
            self.publisher.passed(seen)
            return seen
        seen, published = self.publisher.looked(seen)
        if published is not None:
            self.publications.append(self._note(published))
        return seen

    def watch(self, look_every_m: float = LOOK_EVERY_M) -> Observation:
        """Observe, and look if the last look is some way or time ago."""
        seen = self.body.observe()
        if self.publisher.wants_look(seen, look_every_m):
            return self.observe(look=True)
        self.publisher.passed(seen)
        return seen

    def drive(self, command: Drive, duration_s: float) -> None:
        """Drive so for a while."""
        self.body.drive(command, duration_s)

"""What a robot reads in the ledger: what others saw, and by which way that leads to a goal."""

from collections.abc import Callable, Sequence

from vrchain.errors import ImageError
from vrchain.geometry import Pose
from vrchain.landmarks.retrieval.index import LandmarkIndex
from vrchain.ledger import NO_BLOB, Ledger
from vrchain.ledger.records.encoding import DIGEST_BYTES
from vrchain.navigation.goal.place import GoalPlace
from vrchain.navigation.goal.recognition import GoalSight, KnownGoal, goal_from
from vrchain.navigation.perception import Look, Perception, learned_perception
from vrchain.navigation.planning.route import LEAST_SIGHT, Plan, plan
from vrchain.navigation.settings import Published, panorama_name
from vrchain.panorama import Panorama

REMEMBERED = 40  # panoramas of each robot that others plan by
HERE = "(here)"  # no member can be called so


def published_of(
    ledger: Ledger, robot: str, most: int = 1, memory: bool = False
) -> Callable[[], dict[str, Published]]:
    """Asks a ledger for the newest panoramas of each other robot, at most so many, by now.

    R2 is robot R2's newest, R2~1 the one before, and so on. memory: with what the robot itself had
    published when this was called, as *R1 before*.
    """

    def newest(author: str, name: str) -> dict[str, Published]:
        return {
            panorama_name(name, k): Published(t.payload_digest + t.landmarks_digest, t.timestamp_ns)
            for k, t in enumerate(reversed(ledger.history(author)[-most:]))
        }

    ledger.refresh()
    known = newest(robot, f"{robot} before") if memory else {}

    def published() -> dict[str, Published]:
        ledger.refresh()
        found = dict(known)
        for name in ledger.robots:
            if name != robot:
                found |= newest(name, name)
        return found

    return published


def index_of(
    ledger: Ledger, perception: Perception, read: Callable[[bytes], bytes] | None = None
) -> LandmarkIndex[Look]:
    """An index of what ``published_of`` names: a panorama with the record that its author signed.

    By the panorama alone another member could publish the same one with landmarks of its own.
    read: the blob of a digest, from the ledger or wherever it is.
    """
    read = read or ledger.payload

    def panorama(published: bytes) -> bytes:
        return read(published[:DIGEST_BYTES])

    def described(published: bytes) -> bytes | None:
        record = published[DIGEST_BYTES:]
        return None if record == NO_BLOB else read(record)

    return LandmarkIndex(panorama, described, perception.stored, perception.compare)


def route_to(
    ledger: Ledger, here: Panorama, goal: Sequence[Panorama]
) -> tuple[GoalSight | None, Plan]:
    """What ``here`` itself shows of a goal, and the chain of common landmarks that leads there.

    here: a panorama, called ``HERE`` in the plan. goal: one panorama by the same cameras, of a
    place; or single views framed on a thing, from 6 to 15 m. ImageError: goal is neither.
    """
    perception = learned_perception()
    known, seen = _known(goal, here, perception), perception.stored(here.encode(), None)
    published = published_of(ledger, HERE, REMEMBERED)()
    own = known.find(seen)
    return own if own and own.chance >= LEAST_SIGHT else None, plan(
        HERE, [(Pose(0.0, 0.0), seen)], published, index_of(ledger, perception), known.find,
        trust=perception.trust, alike=perception.alike,
    )  # fmt: skip


def _known(goal: Sequence[Panorama], here: Panorama, perception: Perception) -> KnownGoal:
    if goal and not any(picture.rig.closed for picture in goal):
        return goal_from(goal)
    if len(goal) != 1 or goal[0].rig != here.rig:
        raise ImageError(
            f"expected as goal one panorama of {here.rig}, as the one from here, or single views, "
            f"got {len(goal)} of {goal[0].rig if goal else 'nothing'}"
        )
    return GoalPlace(perception.stored(goal[0].encode(), None), perception)

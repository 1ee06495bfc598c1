"""A short recording of one robot, and what recorders and drivers do to such."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from sights import RIG, look

from vrchain.geometry import Pose
from vrchain.landmarks.extraction.proposer import nothing
from vrchain.landmarks.extraction.record import LandmarkRecord
from vrchain.landmarks.extraction.sift import NO_FEATURES
from vrchain.ledger import simulated_key
from vrchain.panorama import Codec
from vrchain.robot import Observation
from vrchain.ros.export import BagWriter
from vrchain.ros.messages import TF
from vrchain.ros.publishing import Played, publish_bags
from vrchain.ros.telling import Messages, RobotTopics
from vrchain.simulation.team import team_ledger

START_NS = 1_700_000_000_000_000_000
SECONDS = 12
SPEED_M_S = 0.6
STATIC = "/tf_static"


@dataclass(frozen=True)
class Row:
    """One message as it is to be recorded."""

    topic: str
    message: Any
    received_ns: int


def at_s(seconds: float) -> Pose:
    return Pose(-3.0 + SPEED_M_S * seconds, 0.0)


@cache
def _rows(ros1: bool, codec: Codec | None) -> tuple[Row, ...]:
    topics = RobotTopics("R1", RIG, Messages(ros1), codec)
    fixed = topics.make.make(TF, transforms=topics.fixed(START_NS))
    rows = [Row(STATIC, fixed, START_NS)]
    for tick in range(10 * SECONDS):
        time_ns, whole = START_NS + tick * 100_000_000, tick % 10 == 0
        here = Pose(SPEED_M_S * tick / 10, 0.0)
        panorama = look(at_s(tick // 10)) if whole else None
        seen = Observation(time_ns, here, look_ranges(), panorama=panorama)
        said = [*topics.sensed(seen), *topics.shown(seen)]
        rows += [Row(topic, message, time_ns) for topic, message in said]
    return tuple(rows)


def look_ranges() -> Any:
    import numpy as np

    return np.full(72, 8.0)


def recording(ros1: bool = False, codec: Codec | None = None) -> list[Row]:
    """A robot that drives 7 m in 12 s: odometry ten times a second, all cameras once."""
    return list(_rows(ros1, codec))


def fields(message: Any, **changed: Any) -> Any:
    """A copy of a message with other fields; a name with __ reaches into it."""
    for name, value in changed.items():
        first, _, rest = name.partition("__")
        inner = fields(getattr(message, first), **{rest: value}) if rest else value
        message = replace(message, **{first: inner})
    return message


def changed(rows: Iterable[Row], where: str, change: Callable[[Row], Row | None]) -> list[Row]:
    """The rows, those of topics that contain ``where`` changed or, for None, left out."""
    made = (change(row) if where in row.topic else row for row in rows)
    return [row for row in made if row is not None]


def stamped(row: Row, stamp_ns: int) -> Row:
    """With another time in its header."""
    if not hasattr(row.message, "header"):
        return row
    seconds, rest = divmod(stamp_ns, 1_000_000_000)
    stamp = {"header__stamp__sec": seconds, "header__stamp__nanosec": rest}
    return replace(row, message=fields(row.message, **stamp))


def write(rows: Iterable[Row], path: Path, form: str = "mcap") -> Path:
    with BagWriter(path, form) as writer:
        for row in rows:
            writer.write(row.topic, row.message, row.received_ns)
    return path


def examine(seen: Observation) -> LandmarkRecord:
    assert seen.panorama is not None
    return LandmarkRecord(seen.panorama.rig, "ab" * 32, nothing(), NO_FEATURES)


@dataclass(frozen=True)
class Outcome:
    """What was published: times from the start in s, digests; what was said; how it moved."""

    times_s: tuple[float, ...]
    digests: tuple[str, ...]
    said: tuple[str, ...]
    moved: tuple[Pose | None, ...]
    played: Played


def published(bags: list[Path], folder: Path, **more: Any) -> Outcome:
    from vrchain.landmarks.extraction.record import decode_record

    said: list[str] = []
    with team_ledger(folder, ["R1"], 1) as ledger:
        keys = {"R1": simulated_key(1, "R1")}
        told = {"examine": examine, "tell": said.append, "robots": {"R1": "/R1"}} | more
        (played,) = publish_bags(bags, ledger, keys, **told)
        history = ledger.history("R1")
        moved = [decode_record(ledger.payload(t.landmarks_digest)).moved for t in history]
    times = tuple(round((t.timestamp_ns - START_NS) / 1e9, 3) for t in history)
    digests = tuple(t.payload_digest.hex() for t in history)
    return Outcome(times, digests, tuple(said), tuple(moved), played)

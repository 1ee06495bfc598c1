"""A simulated patrol as a bag: what real robots' recorders would have written of it."""

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self

from vrchain.errors import BagError
from vrchain.extras import require
from vrchain.geometry import Pose
from vrchain.ledger import Ledger
from vrchain.panorama import CameraRig, Codec
from vrchain.publisher import LOOK_EVERY_M, Examine
from vrchain.robot import Observation, UpdateRules
from vrchain.ros.messages import TF, typestore
from vrchain.ros.telling import Messages, RobotTopics
from vrchain.simulation.patrol import Patrol
from vrchain.simulation.simulator import Simulator
from vrchain.simulation.survey import start_poses
from vrchain.simulation.team import LocatedPublication, SimulatedBody, assemble
from vrchain.simulation.trajectory import tum_line
from vrchain.world.model import Scene

FORMS = ("mcap", "sqlite3", "ros1")
IMAGES = {"jpeg": Codec("jpeg", 90), "png": Codec("png"), "raw": None}


class BagWriter:
    """A new bag; messages are given with their topics."""

    def __init__(self, path: Path, form: str) -> None:
        require("rosbags", what="writing bags", error=BagError)
        if form not in FORMS:
            raise BagError(f"expected a bag's form of {', '.join(FORMS)}, got {form!r}")
        self.make = Messages(form == "ros1")
        self._writer: Any = _writer(path, form)
        self._connections: dict[str, Any] = {}

    def __enter__(self) -> Self:
        self._writer.open()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        at: object,
    ) -> None:
        self._writer.close()

    def write(self, topic: str, message: Any, time_ns: int) -> None:
        """Write one message as received at a time."""
        store, kind = typestore(self.make.ros1), message.__msgtype__
        if topic not in self._connections:
            extra = {} if self.make.ros1 else {"offered_qos_profiles": _qos(topic)}
            self._connections[topic] = self._writer.add_connection(
                topic, kind, typestore=store, **extra
            )
        pack = store.serialize_ros1 if self.make.ros1 else store.serialize_cdr
        self._writer.write(self._connections[topic], time_ns, pack(message, kind))


def _writer(path: Path, form: str) -> Any:
    if form == "ros1":
        from rosbags.rosbag1 import Writer as Ros1Writer

        return Ros1Writer(path)
    from rosbags.rosbag2 import StoragePlugin, Writer

    return Writer(path, version=9, storage_plugin=StoragePlugin[form.upper()])


def _qos(topic: str) -> list[Any]:
    """tf_static is kept for who comes later."""
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )  # fmt: skip

    lasting = topic == "/tf_static"
    durability = QosDurability.TRANSIENT_LOCAL if lasting else QosDurability.VOLATILE
    never = QosTime(9223372036, 854775807)
    kept = (QosHistory.KEEP_LAST, 10, QosReliability.RELIABLE, durability, never, never)
    return [Qos(*kept, QosLiveliness.AUTOMATIC, never, False)]


@dataclass(eq=False)
class _Recorder:
    """Writes what one robot observes, once a moment, and keeps its trajectory."""

    topics: RobotTopics
    writer: BagWriter
    odometry: list[str] = field(default_factory=list)
    truth: list[str] = field(default_factory=list)
    last_ns: int = -1

    def record(self, seen: Observation, true: Pose) -> None:
        if seen.time_ns > self.last_ns:
            self.last_ns = seen.time_ns
            self._write(seen.time_ns, self.topics.sensed(seen))
            self.odometry.append(tum_line(seen.time_ns, seen.odometry))
            self.truth.append(tum_line(seen.time_ns, true))
        self._write(seen.time_ns, self.topics.shown(seen))

    def _write(self, time_ns: int, said: list[tuple[str, Any]]) -> None:
        for topic, message in said:
            self.writer.write(topic, message, time_ns)


class _RecordedBody(SimulatedBody):
    def __init__(self, simulator: Simulator, name: str, recorder: _Recorder) -> None:
        super().__init__(simulator, name)
        self._recorder = recorder

    def observe(self, look: bool = False, towards_rad: float | None = None) -> Observation:
        seen = super().observe(look, towards_rad)
        self._recorder.record(seen, self.simulator.pose(self.name))
        return seen


@dataclass(frozen=True)
class Exported:
    """What a patrol's export wrote. publications: what the robots published meanwhile."""

    bag: Path
    seconds: float
    publications: tuple[LocatedPublication, ...]


def export_patrol(
    scene: Scene,
    folder: Path,
    ledger_of: Callable[[tuple[str, ...]], Ledger],
    *,
    robots: tuple[str, ...] = ("R1", "R2"),
    seconds: float = 60.0,
    seed: int = 0,
    rig: CameraRig | None = None,
    form: str = "mcap",
    images: str = "jpeg",
    look_every_m: float = LOOK_EVERY_M,
    rules: UpdateRules | None = None,
    examine: Examine | None = None,
) -> Exported:
    """Let robots patrol, and write what they sense into ``folder``: the bag, and trajectories.

    ledger_of: makes the ledger into which they publish meanwhile, for the robots' names; its keys
    derive from the seed. form: of ``FORMS``; images: of ``IMAGES``. Pictures are recorded whenever
    a robot looks. Trajectories, of odometry and of truth, are as TUM's benchmark has them.
    """
    if images not in IMAGES:
        raise BagError(f"expected images as {', '.join(IMAGES)}, got {images!r}")
    rig, codec = rig or CameraRig(), IMAGES[images]
    bag = folder / ("patrol.bag" if form == "ros1" else "patrol")
    simulator = Simulator(scene, start_poses(scene, robots, seed), seed=seed, rig=rig)
    with ExitStack() as stack:
        writer = stack.enter_context(BagWriter(bag, form))
        ledger = stack.enter_context(ledger_of(robots))
        recorders = {
            name: _Recorder(RobotTopics(name, rig, writer.make, codec), writer) for name in robots
        }
        fixed = [t for recorder in recorders.values() for t in recorder.topics.fixed(0)]
        writer.write("/tf_static", writer.make.make(TF, transforms=fixed), 0)
        team = assemble(
            simulator, ledger, seed, rules, examine,
            lambda simulator, name: _RecordedBody(simulator, name, recorders[name]),
        )  # fmt: skip
        Patrol(simulator, team, seed, look_every_m).drive(seconds)
    for name, recorder in recorders.items():
        (folder / f"{name}_odometry.tum").write_text("".join(recorder.odometry))
        (folder / f"{name}_truth.tum").write_text("".join(recorder.truth))
    publications = tuple(p for robot in team.values() for p in robot.publications)
    return Exported(bag, simulator.clock_ns / 1e9, publications)

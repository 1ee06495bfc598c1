"""One robot of a simulated team, in a process of its own; what the others see is in the ledger.

Each process simulates where all of them drive, which the seed alone decides, and draws what its own
robot sees and nothing else. So all agree on where everybody is, and what comes of it is what comes
of one process.
"""

import time
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

from vrchain.errors import MissionError
from vrchain.landmarks.extraction.weights import SHIPPED
from vrchain.ledger import Ledger, SigningKey
from vrchain.ledger.network.robot import RobotLedger
from vrchain.navigation.perception import learned_perception
from vrchain.navigation.settings import Decision, MissionConfig
from vrchain.panorama import CameraRig
from vrchain.publisher import Publisher, PublishingBody
from vrchain.simulation.mission import MissionRun, send, set_out
from vrchain.simulation.team import PublishingRobot, SimulatedBody, drive_to_places
from vrchain.world.model import Scene

TEAM_WAIT_S = 900.0  # for what others publish from their places
_LOOK_S = 0.1


def run_apart(
    scene: Scene,
    ledger: Ledger,
    robot: str,
    key: SigningKey,
    *,
    seed: int = 0,
    n_robots: int = 3,
    sent: str = "R1",
    goal: str | None = None,
    rig: CameraRig | None = None,
    config: MissionConfig | None = None,
    weights: Path = SHIPPED,
    wait_s: float = TEAM_WAIT_S,
    tell: Callable[[Decision], None] = lambda decision: None,
) -> tuple[PublishingRobot, MissionRun | None]:
    """As ``run_mission``, of which this is ``robot``'s part; the mission, if it is ``sent``.

    All parts are given the same scene, seed, ``n_robots``, ``sent`` and goal. What was published is
    in the chain when it ends. MissionError if another robot has not published from its place within
    ``wait_s``; LedgerError kinds.
    """
    perception = learned_perception(weights)
    outset = set_out(scene, seed, n_robots, sent, goal, rig or CameraRig())
    simulator, task, _ = outset
    bodies = {name: SimulatedBody(simulator, name) for name in simulator.robots}
    if robot not in bodies:
        raise MissionError(f"there is no robot {robot!r}; expected one of {', '.join(bodies)}")
    publisher = Publisher(robot, ledger, key, examine=perception.record)
    own: PublishingRobot = PublishingBody(bodies[robot], publisher, bodies[robot].located)
    drive_to_places(simulator, {**bodies, robot: own}, task)
    mission = None
    if robot == sent:
        _wait_for(ledger, bodies, simulator.clock_ns, wait_s)
        mission = send(robot, own, outset, ledger, perception, config, weights, tell)
    if isinstance(ledger, RobotLedger):
        ledger.wait()
    ledger.refresh()
    return own, mission and replace(mission, head=ledger.head.hash.hex())


def _wait_for(ledger: Ledger, robots: Iterable[str], time_ns: int, wait_s: float) -> None:
    """Until all have published from their places, which they do at the same moment."""
    until_s = time.monotonic() + wait_s
    while late := [name for name in robots if not _has_come(ledger, name, time_ns)]:
        if time.monotonic() > until_s:
            raise MissionError(
                f"{', '.join(late)} published nothing from their places within {wait_s:g} s: "
                "run each, with the same scene and seed"
            )
        time.sleep(_LOOK_S)
        ledger.refresh()


def _has_come(ledger: Ledger, robot: str, time_ns: int) -> bool:
    last = ledger.latest(robot)
    return last is not None and last.timestamp_ns >= time_ns

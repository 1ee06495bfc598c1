"""A mission driven on a robot's body: look around, plan a chain of landmarks, drive it, home in.

The robot decides from its observations and the ledger's panoramas. Where nothing leads on it goes
and looks elsewhere, and plans again. It gives up (``GaveUp``) when its time or its looks are over,
when there is nowhere left to look, or, if it does not explore, when no route is worth driving.
Every decision is logged, with the panorama that it rested on where it rested on one, so that a
mission can be read, and replayed in pictures. ``vrchain.simulation.mission`` runs one in a scene.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf
from typing import Any

from vrchain.landmarks.retrieval.index import LandmarkIndex
from vrchain.navigation.driving.drive import Pilot
from vrchain.navigation.driving.exploring import Explorer
from vrchain.navigation.following import Follower
from vrchain.navigation.goal.arrival import Arrival
from vrchain.navigation.goal.place import GoalPlace, PlaceArrival
from vrchain.navigation.goal.recognition import KnownGoal
from vrchain.navigation.perception import Look, Perception
from vrchain.navigation.planning.route import Route
from vrchain.navigation.replanning import MOVED_M, Replanner
from vrchain.navigation.settings import Body, Decision, GaveUp, MissionConfig, Published
from vrchain.panorama import Panorama

_PATIENCE = 0.97  # times as sure need a route be, after each look elsewhere, to be worth driving


@dataclass(frozen=True, eq=False)
class MissionResult:
    """How it ended, by the robot's own judgement, and why; its log, looks and plans.

    plans: each route with the index, in looks, of the robot's panorama that it begins with.
    """

    arrived: bool
    reason: str
    decisions: tuple[Decision, ...]
    looks: tuple[Panorama, ...]
    plans: tuple[tuple[int, Route], ...]


def drive_mission(
    robot: str,
    body: Body,
    published: Callable[[], Mapping[str, Published]],
    index: LandmarkIndex[Look],
    goal: KnownGoal,
    perception: Perception,
    config: MissionConfig | None = None,
    tell: Callable[[Decision], None] = lambda decision: None,
) -> MissionResult:
    """Drive ``robot``, which is ``body``, to ``goal`` by what the ledger says.

    published: the panoramas of others in the ledger, by name, asked for at each plan: of each robot
    its newest, or older ones too.
    tell: is given each decision as it is made.
    """
    pilot = Pilot(body, perception, config or MissionConfig())
    decisions: list[Decision] = []

    def log(what: str, why: str, look: int | None = None, **values: Any) -> None:
        decisions.append(Decision(pilot.now.time_ns / 1e9, what, why, look, values))
        tell(decisions[-1])

    replanner = Replanner(robot, pilot, published, index, goal, log)
    arrives = PlaceArrival if isinstance(goal, GoalPlace) else Arrival
    follower = Follower(replanner, arrives(pilot, goal, log), log)
    try:
        _drive(follower, Explorer(pilot, goal.promise, log))
        arrived, reason = True, "the goal is in front of me"
    except GaveUp as end:
        arrived, reason = False, str(end)
    log("arrived" if arrived else "gave up", reason)
    return MissionResult(
        arrived, reason, tuple(decisions), tuple(pilot.looks), tuple(follower.plans)
    )


def _drive(follower: Follower, explorer: Explorer) -> None:
    """Until it has arrived; GaveUp if it cannot."""
    pilot, arrival, replanner = follower.pilot, follower.arrival, follower.replanner
    config, fruitless = pilot.config, 0  # looks elsewhere since a route was driven
    for _ in range(config.max_looks):  # not every round needs a new look
        if len(pilot.looks) >= config.max_looks:
            break
        stood, seen = pilot.looked[-1] if pilot.looked else (None, None)
        # Where it stands as it did: what was refuted of its last look holds.
        look = seen if seen is not None and stood == pilot.here else pilot.look_around()
        arrival.note(look)
        candidate, found = arrival.likeliest, replanner.plan(look)
        if candidate and found.route:
            candidate = follower.weighed(candidate, follower.aim(found)[0])
        least = config.least_trust * _PATIENCE**fruitless
        if candidate is not None:  # before what is likely no route is tried
            least = candidate.chance if candidate.chance < config.likely else inf
        if found.route is not None and found.route.trust >= least:
            before = pilot.here
            if follower.follow(found):
                return
            if before.distance_to_m(pilot.here.xy_m) > MOVED_M:
                fruitless = 0
            follower.log("plan again", "the goal was not reached this way")
        elif candidate is not None:
            if arrival.drive_to(candidate):
                return
        else:
            why = found.why_none or "the best chain is too unsure to be worth driving"
            if not config.explores:
                raise GaveUp(why)
            trust = {} if found.route is None else {"trust": round(found.route.trust, 2)}
            follower.log("no route", why, len(pilot.looks) - 1, **trust)
            explorer.drive_on(replanner.looked_by_others(found))
            fruitless += 1
    raise GaveUp(f"the goal was not found in {len(pilot.looks)} looks around")

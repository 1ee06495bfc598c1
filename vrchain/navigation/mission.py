"""A mission: look around, plan a chain of landmarks, drive it leg by leg, home to the goal.

The robot decides from its observations and the ledger's panoramas. Where nothing leads on it goes
and looks elsewhere, and plans again. Every decision is logged with the panorama that it rested on,
so that a mission can be read, and replayed in pictures.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrchain.landmarks.common import Comparison
from vrchain.landmarks.index import LandmarkIndex
from vrchain.navigation.arrival import Arrival, Suspect
from vrchain.navigation.driving import Pilot
from vrchain.navigation.exploring import Explorer
from vrchain.navigation.eyes import Eyes, Look
from vrchain.navigation.goal import FoundOnce, KnownGoal
from vrchain.navigation.place_goal import GoalPlace, PlaceArrival
from vrchain.navigation.places import Place
from vrchain.navigation.route import LandmarkKey, Plan, Route, plan
from vrchain.navigation.stands import AGREED, Stands
from vrchain.navigation.targets import targets
from vrchain.navigation.terms import Body, Decision, GaveUp, MissionConfig
from vrchain.navigation.tracker import Tracker
from vrchain.panorama import Panorama

_LOST_AFTER, _LOST_M = 4, 6.0  # looks without a landmark that should be so near
_LARGE_M = 6.0  # from a landmark's middle to its side, at most


@dataclass(frozen=True, eq=False)
class MissionResult:
    """How it ended, by the robot's own judgement, and why; its log, looks and plans.

    plans: each route with the index, in looks, of the panorama from which it was planned.
    """

    arrived: bool
    reason: str
    decisions: tuple[Decision, ...]
    looks: tuple[Panorama, ...]
    plans: tuple[tuple[int, Route], ...]


def run_mission(
    robot: str,
    body: Body,
    newest: Callable[[], Mapping[str, bytes]],
    index: LandmarkIndex[Look],
    goal: KnownGoal,
    eyes: Eyes,
    config: MissionConfig | None = None,
    tell: Callable[[Decision], None] = lambda decision: None,
) -> MissionResult:
    """Drive ``robot`` to ``goal`` by what the ledger says.

    newest: digest of every other robot's newest panorama in the ledger, asked at each plan.
    tell: is given each decision as it is made.
    """
    pilot = Pilot(body, eyes, config or MissionConfig())
    mission = _Mission(robot, pilot, newest, index, goal, tell)
    try:
        mission.run()
        arrived, reason = True, "the goal is in front of me"
    except GaveUp as end:
        arrived, reason = False, str(end)
    mission.log("arrived" if arrived else "gave up", reason)
    return MissionResult(
        arrived, reason, tuple(mission.decisions), tuple(pilot.looks), tuple(mission.plans)
    )


class _Mission:
    def __init__(
        self,
        robot: str,
        pilot: Pilot,
        newest: Callable[[], Mapping[str, bytes]],
        index: LandmarkIndex[Look],
        goal: KnownGoal,
        tell: Callable[[Decision], None],
    ) -> None:
        self.robot, self.pilot, self.config = robot, pilot, pilot.config
        self.newest, self.index, self.tell = newest, index, tell
        self.goal = FoundOnce(goal)
        self.decisions: list[Decision] = []
        self.plans: list[tuple[int, Route]] = []
        self.failed: set[LandmarkKey] = set()
        self.doubted: set[str] = set()  # robots whose sighting of the goal was a mistake
        self.arrival = (
            PlaceArrival(pilot, goal, self.log)
            if isinstance(goal, GoalPlace)
            else Arrival(pilot, goal, self.log)
        )
        self.explorer = Explorer(pilot, self.log)
        self.stands = Stands()

    def log(self, what: str, why: str, look: int | None = None, **values: Any) -> None:
        decision = Decision(self.pilot.now.time_ns / 1e9, what, why, look, values)
        self.decisions.append(decision)
        self.tell(decision)

    def run(self) -> None:
        """Until it has arrived; GaveUp if it cannot."""
        while len(self.pilot.looks) < self.config.max_looks:
            look = self.pilot.look_around()
            self.arrival.note(look)
            suspect = self.arrival.likeliest
            if suspect is not None and suspect.chance >= self.config.likely:
                if self.arrival.drive_to(suspect):
                    return
                continue
            found = self.plan(look)
            least = self.config.least_score if suspect is None else suspect.chance
            if found.route is not None and found.route.score >= least:
                if self.follow(found.route, found, look):
                    return
                self.log("plan again", "the goal was not reached this way")
            elif suspect is not None:
                if self.arrival.drive_to(suspect):
                    return
            else:
                why = found.why_none or "the best chain is too unsure to be worth driving"
                if not self.config.explores:
                    raise GaveUp(why)
                self.log("no route", why, len(self.pilot.looks) - 1)
                self.explorer.drive_on()
        raise GaveUp(f"the goal was not found in {self.config.max_looks} looks around")

    def plan(self, look: Look) -> Plan:
        """What the ledger says now, of what did not fail before."""
        newest, here = self.newest(), self.pilot.here

        def trust(a: str, b: str, found: Comparison) -> float:
            agreed = a == self.robot and self.stands.agree(here, newest[b], found, look.rig)
            one = look if a == self.robot else self.index.look(newest[a])
            trust = self.pilot.eyes.trust(one, self.index.look(newest[b]), found)
            return max(AGREED if agreed else 0.0, trust)

        return plan(
            self.robot, look, newest, self.index, self.goal, self.failed, self.doubted, trust
        )

    def follow(self, route: Route, found: Plan, look: Look) -> bool:
        """Drive a route leg by leg, and home to the goal; True if it is reached."""
        pilot, number = self.pilot, len(self.pilot.looks) - 1
        for name, sight in sorted(found.goal_seen_by.items()):
            self.log(
                "ledger", f"{name} sees the goal", number, robot=name, matches=sight.n_matches,
                chance=round(sight.chance, 2),
            )  # fmt: skip
        names = " - ".join(route.robots)
        self.log(
            "route", f"{names} - goal, by {len(route.legs)} common landmarks", number,
            score=round(route.score, 3),
        )  # fmt: skip
        self.plans.append((number, route))
        digests = self.newest()
        looks = [look, *(self.index.look(digests[n]) for n in route.robots[1:])]
        trackers, goal = targets(route, looks, found.compared, pilot.here, pilot.eyes.calibration)
        for k, (leg, tracker) in enumerate(zip(route.legs, trackers, strict=False), 1):
            name = f"landmark {k}, common to {leg.seen_by} and {leg.next_by}"
            self.log(
                "approach", name, len(pilot.looks) - 1,
                bearing_deg=round(float(np.degrees(tracker.place.bearing_rad(pilot.here))), 1),
                range_m=round(tracker.place.range_m(pilot.here), 1),
            )  # fmt: skip
            ended = self.approach(name, tracker)
            if isinstance(ended, Suspect):
                return self.arrival.drive_to(ended)
            if ended != "near":
                self.failed.add(leg.key)
                return False
        if len(trackers) < len(route.legs) or goal is None:
            return False  # from here it will see more
        if self.home(goal, route):
            return True
        self.doubted.add(route.seen_by)
        return False

    def home(self, place: Place, route: Route) -> bool:
        """From the last landmark to where the goal should be."""
        suspect = self.arrival.note(self.pilot.look_around())
        if suspect is None or suspect.chance < self.config.likely:
            suspect = Suspect(place, route.score, seen=False)
        return self.arrival.drive_to(suspect)

    def approach(self, name: str, tracker: Tracker) -> str | Suspect:
        """Drive to a landmark: "near", "lost", "blocked", or what came into view on the way."""
        config, pilot = self.config, self.pilot
        until_ns = pilot.until_ns(tracker.place)
        glanced, looked, stretch = 0.0, 0.0, 0.5
        while pilot.now.time_ns < until_ns:
            place = tracker.place
            range_m = place.range_m(pilot.here)
            ahead_m = pilot.ahead_m(place.bearing_rad(pilot.here))
            if range_m <= config.approach_m or (
                ahead_m < config.approach_m and range_m < config.approach_m + _LARGE_M
            ):
                self.log("reached", f"{name} is near", seen=tracker.seen)
                return "near"
            if tracker.missed >= _LOST_AFTER and tracker.seen == 0 and range_m < _LOST_M:
                self.log("lost", f"{name} is not where it should be")
                return "lost"
            way_m = pilot.stretch(place.xy_m, config.approach_m - 0.5, stretch)
            if way_m is None:
                if range_m < config.approach_m + _LARGE_M:
                    self.log("reached", f"{name} is as near as it gets", seen=tracker.seen)
                    return "near"
                self.log("blocked", f"no way leads to {name}")
                return "blocked"
            tracker.moved(way_m)
            glanced, looked = glanced + way_m, looked + way_m
            if looked >= config.look_every_m:
                glanced = looked = 0.0
                look = pilot.look_around()
                suspect = self.arrival.note(look)
                if suspect is not None and suspect.chance >= config.likely:
                    return suspect
                tracker.update(look, pilot.here)
            elif glanced >= config.glance_every_m:
                glanced = 0.0
                look = pilot.glance(tracker.place.bearing_rad(pilot.here))
                tracker.update(look, pilot.here)
        self.log("astray", f"{name} is not reached in reasonable time")
        return "lost"

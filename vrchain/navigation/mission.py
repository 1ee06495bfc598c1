"""A mission: look around, plan a chain of landmarks, drive it leg by leg, home to the goal.

The robot decides from its observations and the ledger's panoramas. Where nothing leads on it goes
and looks elsewhere, and plans again. Every decision is logged, with the panorama that it rested on
where it rested on one, so that a mission can be read, and replayed in pictures.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vrchain.geometry import Pose
from vrchain.landmarks.retrieval.index import LandmarkIndex
from vrchain.navigation.driving.drive import Array, Pilot
from vrchain.navigation.driving.estimates import Estimate
from vrchain.navigation.driving.exploring import Explorer
from vrchain.navigation.driving.targets import targets
from vrchain.navigation.driving.tracker import Tracker
from vrchain.navigation.goal.arrival import NEAR_M, Arrival
from vrchain.navigation.goal.candidates import Candidate
from vrchain.navigation.goal.place import GoalPlace, PlaceArrival
from vrchain.navigation.goal.recognition import FoundOnce, KnownGoal
from vrchain.navigation.goal.rejections import SAME_M, Driven, Rejections
from vrchain.navigation.perception import Look, Perception
from vrchain.navigation.planning.relative_poses import SURE
from vrchain.navigation.planning.route import LandmarkKey, Leg, Plan, Route, plan
from vrchain.navigation.settings import (
    Body,
    Decision,
    GaveUp,
    MissionConfig,
    Published,
    panorama_name,
)
from vrchain.panorama import Panorama

_LOST_AFTER, _LOST_M = 4, 6.0  # looks without a landmark that should be so near
_LARGE_M = 6.0  # from a landmark's middle to its side, at most
_PATIENCE = 0.97  # times as sure need a route be, after each look elsewhere, to be worth driving
_BETTER = 1.2  # times as sure a route is taken instead of the one that is driven,
_AFRESH = 0.8  # or so many times as sure a one by the same panoramas: from here more is known
_ELSEWHERE = "elsewhere"
_DETOUR = 1.5  # times the straight way: so long a way round is not followed, if it is surely one
_OWN = 8  # latest looks from which a route may begin
_MOVED_M = 1.0  # nearer to each other are looks from one place
_REACHED_M = 25.0  # a landmark that was reached from farther away is led to again
# Trust in a route from which its goal is looked for again where it was seen: 15 of 51 times it was
# found so, by routes trusted less 3 of 54 times, for 45 s each.
_WORTH_SEEING = 0.9


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
    """Drive ``robot`` to ``goal`` by what the ledger says.

    published: the panoramas of others in the ledger, by name, asked for at each plan: of each robot
    its newest, or older ones too.
    tell: is given each decision as it is made.
    """
    pilot = Pilot(body, perception, config or MissionConfig())
    mission = _Mission(robot, pilot, published, index, goal, tell)
    try:
        mission.run()
        arrived, reason = True, "the goal is in front of me"
    except GaveUp as end:
        arrived, reason = False, str(end)
    mission.log("arrived" if arrived else "gave up", reason)
    return MissionResult(
        arrived, reason, tuple(mission.decisions), tuple(pilot.looks), tuple(mission.plans)
    )


def _is_idle(place: Estimate, later: Sequence[Estimate], here: Pose, leg: Leg) -> bool:
    """Whether the way to a place is for nothing: what comes later is nearer, or far nearer so."""
    sure = leg.by_odometry or leg.trust >= SURE
    way_m, last = place.range_m(here), place
    for onward in later:
        range_m = onward.range_m(here)
        way_m, last = way_m + float(np.hypot(*(onward.xy_m - last.xy_m))), onward
        if range_m < place.range_m(here) or (sure and way_m > _DETOUR * range_m):
            return True
    return False


class _Mission:
    def __init__(
        self,
        robot: str,
        pilot: Pilot,
        published: Callable[[], Mapping[str, Published]],
        index: LandmarkIndex[Look],
        goal: KnownGoal,
        tell: Callable[[Decision], None],
    ) -> None:
        self.robot, self.pilot, self.config = robot, pilot, pilot.config
        self.published, self.index, self.tell = published, index, tell
        self.goal = FoundOnce(goal)
        self.decisions: list[Decision] = []
        self.plans: list[tuple[int, Route]] = []
        self.failed: set[LandmarkKey] = set()
        self.own: list[tuple[Pose, Look, int]] = []  # where it planned, what it saw; latest first
        self._alike: dict[tuple[int, int], tuple[float, Look, Look]] = {}
        self.reached: dict[LandmarkKey, Pose] = {}  # and from where, last
        self.driven: Driven | None = None
        self.rejections = Rejections(pilot.perception, index, self.log)
        self.arrival = (
            PlaceArrival(pilot, goal, self.log)
            if isinstance(goal, GoalPlace)
            else Arrival(pilot, goal, self.log)
        )
        self.explorer = Explorer(pilot, self.log)

    def log(self, what: str, why: str, look: int | None = None, **values: Any) -> None:
        decision = Decision(self.pilot.now.time_ns / 1e9, what, why, look, values)
        self.decisions.append(decision)
        self.tell(decision)

    def run(self) -> None:
        """Until it has arrived; GaveUp if it cannot."""
        fruitless = 0  # looks elsewhere since a route was driven
        for _ in range(self.config.max_looks):  # not every round needs a new look
            if len(self.pilot.looks) >= self.config.max_looks:
                break
            look = self.look()
            self.arrival.note(look)
            candidate = self.arrival.likeliest
            if candidate is not None and candidate.chance >= self.config.likely:
                if self.arrival.drive_to(candidate):
                    return
                continue
            found = self.plan(look)
            least = self.config.least_trust * _PATIENCE**fruitless
            least = least if candidate is None else candidate.chance
            if found.route is not None and found.route.trust >= least:
                before = self.pilot.here
                if self.follow(found):
                    return
                if before.distance_to_m(self.pilot.here.xy_m) > _MOVED_M:
                    fruitless = 0
                self.log("plan again", "the goal was not reached this way")
            elif candidate is not None:
                if self.arrival.drive_to(candidate):
                    return
            else:
                why = found.why_none or "the best chain is too unsure to be worth driving"
                if not self.config.explores:
                    raise GaveUp(why)
                trust = {} if found.route is None else {"trust": round(found.route.trust, 2)}
                self.log("no route", why, len(self.pilot.looks) - 1, **trust)
                self.explorer.drive_on(self.looked_by_others(found))
                fruitless += 1
        raise GaveUp(f"the goal was not found in {self.config.max_looks} looks around")

    def look(self) -> Look:
        """All around; the last look if the robot stands as it did: what was refuted of it holds."""
        stood, look = self.pilot.latest or (None, None)
        return look if look is not None and stood == self.pilot.here else self.pilot.look_around()

    def plan(self, look: Look) -> Plan:
        """What the ledger says now, of what did not fail before."""
        published = self.published()
        if self.own and self.own[0][0].distance_to_m(self.pilot.here.xy_m) < _MOVED_M:
            self.own.pop(0)  # from here it saw the same: it is no second witness
        self.own.insert(0, (self.pilot.here, look, len(self.pilot.looks) - 1))
        latest = self.own[:_OWN]
        return plan(
            self.robot, look, published, self.index, self.goal, self.failed, self.rejections.sights,
            self.rejections.trust, self.lasting, self.alike, [seen for _, seen, _ in latest[1:]],
            [stood for stood, _, _ in latest], spares=0,
        )  # fmt: skip

    def looked_by_others(self, found: Plan) -> list[Array]:
        """From where others, as far as that is sure, did not see the goal."""
        own = {panorama_name(self.robot, k): stood for k, (stood, _, _) in enumerate(self.own)}
        return [
            pose.xy_m for name, pose in found.poses.reached(own).items()
            if name in found.published and name not in found.goal_seen_by
        ]  # fmt: skip

    def alike(self, a: Look, b: Look) -> float:
        """Asked of the same two again and again."""
        key = id(a), id(b)
        if key not in self._alike:
            self._alike[key] = self.pilot.perception.alike(a, b), a, b  # kept: so are their ids
        return self._alike[key][0]

    def lasting(self, seen: Published) -> float:
        """The chance that a view has not changed since."""
        age_s = max(0, self.pilot.now.time_ns - seen.time_ns) / 1e9
        return float(np.exp(-age_s / self.config.lasting_s))

    def follow(self, found: Plan) -> bool:
        """Drive a plan's route leg by leg, and home to the goal; True if it is reached."""
        pilot, number, route = self.pilot, len(self.pilot.looks) - 1, found.route
        assert route is not None, "there is none to follow"
        for name, sight in sorted(found.goal_seen_by.items()):
            self.log(
                "ledger", f"{name} sees the goal", number, robot=name, matches=sight.n_matches,
                chance=round(sight.chance, 2),
            )  # fmt: skip
        names = route.robots
        n_landmarks = len({leg.node for leg in route.legs if not leg.by_odometry})
        self.log(
            "route", f"{' - '.join(names)} - goal, by {n_landmarks} common landmarks", number,
            score=round(route.score, 3), trust=round(route.trust, 4),
        )  # fmt: skip
        begin, _, first = next(
            own for k, own in enumerate(self.own) if panorama_name(self.robot, k) == names[0]
        )
        self.plans.append((first, route))
        self.driven = driven = Driven(route, found, begin)
        looks = [found.looks[name] for name in names]
        trackers, goal, lookout = targets(
            route,
            looks,
            found.poses,
            found.goal_seen_by,
            begin,
            pilot.here,
            pilot.perception.calibration,
        )
        if goal is not None and (
            self.arrival.was_mistaken(goal) or self.rejections.was_in_vain(goal)
        ):
            self.log(
                "doubt", f"no goal is where {route.seen_by} should see it, as was found before"
            )
            self.rejections.blame(driven)
            return False
        passed = 0  # legs behind the robot, if it drove any of them
        for k, (leg, tracker) in enumerate(zip(route.legs, trackers, strict=False), 1):
            later = [t.place for t in trackers[k:]] + ([goal] if goal else [])
            same = passed and leg.node == route.legs[passed - 1].node
            if same or self.was_reached(leg) or _is_idle(tracker.place, later, pilot.here, leg):
                continue
            ended = self.lead("leg", tracker, route, passed, self.config.approach_m)
            if not isinstance(ended, str):
                return self.turn_to(ended)
            if ended != "near":
                if ended != _ELSEWHERE:
                    self.failed.add(leg.key)
                return False
            self.log(
                "reached", f"{tracker.name} is near", seen=tracker.seen,
                landmark=bool(len(tracker.embedding)),
            )  # fmt: skip
            self.reached[leg.key] = pilot.here
            passed = k
        if len(trackers) < len(route.legs) or goal is None:
            if not passed:  # or else from here it will see more
                stand = found.poses.between
                unknown = (leg for leg in route.legs if stand(leg.seen_by, leg.next_by) is None)
                lost = next(unknown, route.legs[-1])
                self.log("lost", f"nothing tells how far {lost.next_by} is from {lost.seen_by}")
                self.failed.add(lost.key)
            return False
        if goal.range_m(pilot.here) > NEAR_M:
            far = Tracker.of_place("where the goal should be", goal, pilot.perception.calibration)
            ended = self.lead("approach", far, route, passed, NEAR_M)
            if not isinstance(ended, str):
                return self.turn_to(ended)
            if ended == _ELSEWHERE:
                return False
            goal = far.place
        tried = self.arrival.is_blocked(goal)
        if self.home(goal, route):
            return True
        if not tried and self.arrival.is_blocked(goal):
            return False  # the route was right
        shown = self.arrival.was_mistaken(goal) or goal.range_m(pilot.here) < NEAR_M
        refuted = len(self.rejections.refuted)
        if self.from_lookout(lookout, route.after(len(route.legs))):
            return True
        if len(self.rejections.refuted) > refuted:
            return False
        if not shown:
            self.failed.add(route.legs[-1].key)
            return False
        self.rejections.found_nothing(goal, driven)
        return False

    def was_reached(self, leg: Leg) -> bool:
        """Whether a leg's landmark was reached, from around here."""
        stood = self.reached.get(leg.key)
        return stood is not None and stood.distance_to_m(self.pilot.here.xy_m) < _REACHED_M

    def turn_to(self, seen: Candidate | Plan) -> bool:
        """To what came into view instead; True if it leads to the goal."""
        return self.arrival.drive_to(seen) if isinstance(seen, Candidate) else self.follow(seen)

    def regard(self, look: Look, route: Route) -> "Candidate | Plan | str | None":
        """What a look on the way tells: what may be the goal, a better route, or a wrong one."""
        candidate = self.arrival.note(look)
        if candidate is not None and candidate.chance >= self.config.likely:
            return candidate
        if self.driven and self.rejections.is_elsewhere(look, self.pilot.here, self.driven):
            return _ELSEWHERE
        again = self.plan(look)
        if again.route is None:
            return None
        driven = self.driven.plan.digests if self.driven else frozenset()
        better = _AFRESH if again.digests <= driven else _BETTER
        if again.route.score <= better * route.score:
            return None
        if again.route.trust < min(route.trust, self.config.least_trust):
            return None
        return again

    def home(self, place: Estimate, route: Route) -> bool:
        """From the last landmark to where the goal should be."""
        candidate = self.arrival.note(self.pilot.look_around())
        if candidate is not None and candidate.chance >= self.config.likely:
            if self.arrival.drive_to(candidate):
                return True
            if np.hypot(*(candidate.place.xy_m - place.xy_m)) < SAME_M:
                return False
        return self.arrival.drive_to(Candidate(place, route.trust))

    def from_lookout(self, lookout: Tracker | None, route: Route) -> bool:
        """The goal is not where it should be: look for it from where it was surely seen."""
        if lookout is None or route.trust < _WORTH_SEEING:
            return False
        self.log("lookout", f"to {lookout.name}")
        seen = self.approach(lookout, route, self.config.approach_m)
        if seen == "near":
            seen = self.arrival.note(self.pilot.look_around()) or seen
        return not isinstance(seen, str) and self.turn_to(seen)

    def lead(
        self, what: str, tracker: Tracker, route: Route, passed: int, within_m: float
    ) -> "str | Candidate | Plan":
        """Approach what a route leads to; after a leg with a look around: more is known now."""
        left = route.after(passed)
        seen = self.regard(self.pilot.look_around(), left) if passed else None
        if seen is not None:
            return seen
        here, place = self.pilot.here, tracker.place
        self.log(
            what, tracker.name, len(self.pilot.looks) - 1,
            bearing_deg=round(float(np.degrees(place.bearing_rad(here))), 1),
            range_m=round(place.range_m(here), 1),
        )  # fmt: skip
        return self.approach(tracker, left, within_m)

    def approach(self, tracker: Tracker, route: Route, within_m: float) -> "str | Candidate | Plan":
        """Drive to a landmark or place: how that ended, or what came into view.

        "near", which is within so many metres, "lost", "blocked", or "elsewhere" if the route is
        wrong.
        """
        config, pilot, name = self.config, self.pilot, tracker.name
        until_ns = pilot.until_ns(tracker.place)
        glanced_m = looked_m = 0.0
        large_m = _LARGE_M if len(tracker.embedding) else 0.0  # a mere place has no side
        while pilot.now.time_ns < until_ns:
            place = tracker.place
            range_m = place.range_m(pilot.here)
            ahead_m = pilot.ahead_m(place.bearing_rad(pilot.here))
            if range_m <= within_m or (
                ahead_m < config.approach_m and range_m < config.approach_m + large_m
            ):
                return "near"
            if tracker.missed >= _LOST_AFTER and tracker.seen == 0 and range_m < _LOST_M:
                self.log("lost", f"{name} is not where it should be")
                return "lost"
            way_m = pilot.stretch(place.xy_m, config.approach_m - 0.5, 0.5)
            if way_m is None:
                if range_m < config.approach_m + _LARGE_M:  # from a place so near, on to the next
                    return "near"
                self.log("blocked", f"no way leads to {name}")
                return "blocked"
            tracker.moved(way_m)
            glanced_m, looked_m = glanced_m + way_m, looked_m + way_m
            if looked_m >= config.look_every_m:
                glanced_m = looked_m = 0.0
                look = pilot.look_around()
                seen = self.regard(look, route)
                if seen is not None:
                    return seen
                tracker.update(look, pilot.here)
            elif glanced_m >= config.glance_every_m and len(tracker.embedding):
                glanced_m = 0.0
                look = pilot.glance(tracker.place.bearing_rad(pilot.here))
                tracker.update(look, pilot.here)
        self.log("astray", f"{name} is not reached in reasonable time")
        return "lost"

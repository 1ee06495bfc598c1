"""Following a route: from landmark to landmark, and from the last one home to the goal."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vrchain.geometry import Pose
from vrchain.navigation.driving.estimates import Estimate
from vrchain.navigation.driving.targets import targets
from vrchain.navigation.driving.tracker import Tracker
from vrchain.navigation.goal.arrival import Arrival
from vrchain.navigation.goal.candidates import NEAR_M, SAME_STD, Candidate, at_odds
from vrchain.navigation.goal.place import PlaceArrival
from vrchain.navigation.goal.rejections import Driven
from vrchain.navigation.perception import Look
from vrchain.navigation.planning.relative_poses import SURE
from vrchain.navigation.planning.route import LandmarkKey, Leg, Plan, Route
from vrchain.navigation.replanning import Replanner
from vrchain.navigation.settings import Log

Seen = Candidate | Plan  # what came into view, and is turned to
_ELSEWHERE = "elsewhere"
_LOST_AFTER, _LOST_M = 4, 6.0  # looks without a landmark that should be so near
_LARGE_M = 6.0  # from a landmark's middle to its side, at most
_BETTER = 1.2  # times as sure a route is taken instead of the one that is driven,
_AFRESH = 0.8  # or so many times as sure a one by the same panoramas: from here more is known
_DETOUR = 1.5  # times the straight way: so long a detour is not followed, if it surely is one
_REACHED_M = 25.0  # a landmark that was reached from farther away is led to again
# Trust in a route from which its goal is looked for again from where it was seen: 15 of 51 times it
# was found so, by routes trusted less 3 of 54 times, for 45 s each.
_WORTH_SEEING = 0.9
_LED = 0.8  # of routes that are trusted led to the goal


class Follower:
    """Drives routes; plans: each with the index of the look that it begins with."""

    def __init__(self, replanner: Replanner, arrival: Arrival | PlaceArrival, log: Log) -> None:
        self.pilot, self.config = replanner.pilot, replanner.pilot.config
        self.replanner, self.rejections = replanner, replanner.rejections
        self.arrival, self.log = arrival, log
        self.plans: list[tuple[int, Route]] = []
        self.driven: Driven | None = None
        self.reached: dict[LandmarkKey, Pose] = {}  # and from where, last

    def follow(self, found: Plan) -> bool:
        """Drive a plan's route leg by leg, and home to the goal; True if it is reached."""
        driven, trackers, lookout = self.aim(found)
        pilot, route, goal = self.pilot, driven.route, driven.goal
        self.log_route(found, route)
        self.plans.append((self.replanner.begin(route)[1], route))
        self.driven = driven
        if goal and (self.arrival.was_mistaken(goal) or self.rejections.was_in_vain(goal)):
            why = f"no goal is where {route.seen_by} should see it, as was found before"
            self.log("doubt", why)
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
                    self.replanner.failed.add(leg.key)
                return False
            landmark = bool(len(tracker.embedding))
            self.log("reached", f"{tracker.name} is near", seen=tracker.seen, landmark=landmark)
            self.reached[leg.key] = pilot.here
            passed = k
        if goal:
            return self.to_goal(goal, lookout, driven, passed)
        if not passed:  # or else from here it will see more
            between = found.poses.between
            unknown = (leg for leg in route.legs if between(leg.seen_by, leg.next_by) is None)
            lost = next(unknown, route.legs[-1])
            self.log("lost", f"nothing tells how far {lost.next_by} is from {lost.seen_by}")
            self.replanner.failed.add(lost.key)
        return False

    def aim(self, found: Plan) -> tuple[Driven, list[Tracker], Tracker | None]:
        """A plan's route from here, what its legs lead to, and from where the goal was seen."""
        route, pilot = found.route, self.pilot
        assert route is not None, "there is none to follow"
        begin, _ = self.replanner.begin(route)
        trackers, goal, lookout = targets(
            route, [found.looks[name] for name in route.robots], found.poses, found.goal_seen_by,
            begin, pilot.here, pilot.perception.calibration,
        )  # fmt: skip
        return Driven(route, found, begin, goal), trackers, lookout

    def weighed(self, candidate: Candidate, driven: Driven | None) -> Candidate:
        """As likely as it is beside a route, which leads to the goal there, or elsewhere."""
        goal = driven.goal if driven else None
        if driven is None or goal is None:
            return candidate
        chance, led = candidate.chance, _LED * driven.route.trust
        if goal.astray(candidate.place) >= SAME_STD:
            return replace(candidate, chance=at_odds(chance, 1 - led))
        near = candidate.place.range_m(self.pilot.here) < NEAR_M  # from afar the route is better
        there = np.hypot(*(goal.xy_m - candidate.place.xy_m)) < self.rejections.same_m
        if there and (near or chance >= self.config.likely):
            return replace(candidate, chance=max(chance, led))  # a look-alike deceives others too
        return candidate

    def log_route(self, found: Plan, route: Route) -> None:
        """Who sees the goal, and by which landmarks the robot goes there."""
        number = len(self.pilot.looks) - 1
        n_landmarks = len({leg.node for leg in route.legs if not leg.by_odometry})
        for name, sight in sorted(found.goal_seen_by.items()):
            self.log(
                "ledger", f"{name} sees the goal", number, robot=name, matches=sight.n_matches,
                chance=round(sight.chance, 2),
            )  # fmt: skip
        for name, share in sorted(found.doubted.items()):
            self.log("ledger", f"{name} did not move as it says", robot=name, agree=round(share, 2))
        landmarks = "landmark" if n_landmarks == 1 else "landmarks"
        why = f"{' - '.join(route.robots)} - goal, by {n_landmarks} common {landmarks}"
        score, trust = round(route.score, 3), round(route.trust, 4)
        self.log("route", why, number, score=score, trust=trust)

    def to_goal(self, goal: Estimate, lookout: Tracker | None, driven: Driven, passed: int) -> bool:
        """From the last leg home to the goal, or to where it was seen from; True if it is reached.

        If it is not, what led there wrongly is rejected.
        """
        pilot, route = self.pilot, driven.route
        if goal.range_m(pilot.here) > NEAR_M:
            far = Tracker("where the goal should be", goal, pilot.perception.calibration)
            ended = self.lead("approach", far, route, passed, NEAR_M)
            if not isinstance(ended, str):
                return self.turn_to(ended)
            if ended == _ELSEWHERE:
                return False
            goal = far.place
        tried = self.arrival.is_blocked(goal)
        if self.home(goal, route):
            return True
        self.driven = replace(driven, goal=None)  # it speaks against no other place any more
        if not tried and self.arrival.is_blocked(goal):
            return False  # the route was right
        shown = self.arrival.was_mistaken(goal) or goal.range_m(pilot.here) < NEAR_M
        n_rejected = len(self.rejections.pairs)
        if self.from_lookout(lookout, route.after(len(route.legs))):
            return True
        if len(self.rejections.pairs) > n_rejected:
            return False
        if shown:
            self.rejections.found_nothing(goal, driven)
        else:
            self.replanner.failed.add(route.legs[-1].key)
        return False

    def was_reached(self, leg: Leg) -> bool:
        """Whether a leg's landmark was reached, from around here."""
        stood = self.reached.get(leg.key)
        return stood is not None and stood.distance_to_m(self.pilot.here.xy_m) < _REACHED_M

    def turn_to(self, seen: Seen) -> bool:
        """To what came into view instead; True if it leads to the goal."""
        return self.arrival.drive_to(seen) if isinstance(seen, Candidate) else self.follow(seen)

    def noted(self, look: Look) -> Candidate | None:
        """What may be the goal in a look, beside the route that is driven."""
        candidate = self.arrival.note(look)
        return self.weighed(candidate, self.driven) if candidate else None

    def regard(self, look: Look, route: Route) -> Seen | str | None:
        """What a look on the way tells: what may be the goal, a better route, or a wrong one."""
        candidate = self.noted(look)
        if candidate is not None and candidate.chance >= self.config.likely:
            return candidate
        if self.driven and self.rejections.is_elsewhere(look, self.pilot.here, self.driven):
            return _ELSEWHERE
        again = self.replanner.plan(look)
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
        candidate = self.noted(self.pilot.look_around())
        if candidate is not None and candidate.chance >= self.config.likely:
            if self.arrival.drive_to(candidate):
                return True
            if np.hypot(*(candidate.place.xy_m - place.xy_m)) < self.rejections.same_m:
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
    ) -> Seen | str:
        """Approach what a route leads to; after a leg with a look around: more is known now."""
        left = route.after(passed)
        seen = self.regard(self.pilot.look_around(), left) if passed else None
        if seen is not None:
            return seen
        bearing, range_m = tracker.place.seen_from(self.pilot.here)
        self.log(
            what, tracker.name, len(self.pilot.looks) - 1,
            bearing_deg=round(float(np.degrees(bearing)), 1), range_m=round(range_m, 1),
        )  # fmt: skip
        return self.approach(tracker, left, within_m)

    def approach(self, tracker: Tracker, route: Route, within_m: float) -> Seen | str:
        """Drive to a landmark or place: how that ended, or what came into view.

        "near", which is within so many metres, "lost", "blocked", or "elsewhere" if the route is
        wrong.
        """
        config, pilot, name = self.config, self.pilot, tracker.name
        until_ns = pilot.until_ns(tracker.place)
        glanced_m = looked_m = 0.0
        large_m = _LARGE_M if len(tracker.embedding) else 0.0  # a mere place has no side
        while pilot.now.time_ns < until_ns:
            bearing, range_m = tracker.place.seen_from(pilot.here)
            ahead_m = pilot.ahead_m(bearing)
            if range_m <= within_m or (
                ahead_m < config.approach_m and range_m < config.approach_m + large_m
            ):
                return "near"
            if tracker.missed >= _LOST_AFTER and tracker.seen == 0 and range_m < _LOST_M:
                self.log("lost", f"{name} is not where it should be")
                return "lost"
            way_m = pilot.stretch(tracker.place.xy_m, config.approach_m - 0.5, 0.5)
            if way_m is None:
                if range_m < config.approach_m + _LARGE_M:  # from a place so near, on to the next
                    return "near"
                self.log("blocked", f"no way leads to {name}")
                return "blocked"
            tracker.place = tracker.place.after(way_m)
            glanced_m, looked_m = glanced_m + way_m, looked_m + way_m
            if looked_m >= config.look_every_m:
                glanced_m = looked_m = 0.0
                look = pilot.look_around()
                seen = self.regard(look, route)
                if seen is not None:
                    return seen
                self._track(tracker, look)
            elif glanced_m >= config.glance_every_m and len(tracker.embedding):
                glanced_m = 0.0
                self._track(tracker, pilot.glance(tracker.place.bearing_rad(pilot.here)))
        self.log("astray", f"{name} is not reached in reasonable time")
        return "lost"

    def _track(self, tracker: Tracker, look: Look) -> None:
        """Take in a look, just taken, if a camera looked there."""
        here = self.pilot.here
        if self.pilot.shows(tracker.place.bearing_rad(here)):
            tracker.update(look, here)


def _is_idle(place: Estimate, later: Sequence[Estimate], here: Pose, leg: Leg) -> bool:
    """Whether a leg is for nothing: what comes later is nearer, or much nearer without it."""
    sure = leg.by_odometry or leg.trust >= SURE
    way_m, last = place.range_m(here), place
    for onward in later:
        range_m = onward.range_m(here)
        way_m, last = way_m + float(np.hypot(*(onward.xy_m - last.xy_m))), onward
        if range_m < place.range_m(here) or (sure and way_m > _DETOUR * range_m):
            return True
    return False

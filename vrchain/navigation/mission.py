"""A mission: look around, plan a chain of landmarks, drive it leg by leg, home to the goal.

The robot decides from its observations and the ledger's panoramas. Every decision is logged with
the panorama that it rested on, so that a mission can be read, and replayed in pictures.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from vrchain.geometry import wrap_angle_rad
from vrchain.homing import home_vector
from vrchain.landmarks.common import Region
from vrchain.landmarks.index import LandmarkIndex
from vrchain.landmarks.recognition import (
    GOAL_MATCHES,
    LOWEST_SLOPE,
    Goal,
    Sighting,
    Template,
    find_goal,
    template_around,
)
from vrchain.landmarks.sift import Features, extract
from vrchain.navigation.route import LandmarkKey, Leg, Plan, Route, plan
from vrchain.navigation.tracker import Tracker, best_sighting, sighting_template
from vrchain.panorama import Panorama
from vrchain.robot import Drive, Observation, steer

_LANDMARK_MATCHES = 8  # by which a landmark is recognised again


class Body(Protocol):
    """What a mission needs of a robot: its senses and its wheels."""

    def observe(self, look: bool = False) -> Observation:
        """What it senses now, with a panorama if it looks."""

    def drive(self, command: Drive, duration_s: float) -> None:
        """Drive so for a while."""


@dataclass(frozen=True)
class MissionConfig:
    """How a mission is driven."""

    approach_m: float = 3.0  # a landmark is reached at this range, so that it hides no other
    arrival_m: float = 2.0  # the goal is reached at this range
    look_every_m: float = 1.0  # of way, while homing on something
    tick_s: float = 0.3  # between two steering commands
    sure_matches: int = 30  # with the goal's pictures, seen on the way, to claim arrival
    lost_after: int = 4  # looks in a row without recognising it
    stuck_after_s: float = 20.0  # without half a metre of headway
    leg_limit_s: float = 90.0  # for one approach; what takes longer leads astray
    limit_s: float = 600.0
    max_plans: int = 4


@dataclass(frozen=True)
class Decision:
    """One line of the log. look: index of the panorama it rested on, in ``MissionResult.looks``."""

    time_s: float
    what: str
    why: str
    look: int | None = None
    values: Mapping[str, Any] = field(default_factory=dict)


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


class _GaveUp(Exception):
    """Ends a mission; the text is the reason."""


def run_mission(
    robot: str,
    body: Body,
    newest: Callable[[], Mapping[str, bytes]],
    index: LandmarkIndex,
    goal: Goal,
    config: MissionConfig | None = None,
    tell: Callable[[Decision], None] = lambda decision: None,
) -> MissionResult:
    """Drive ``robot`` to ``goal`` by what the ledger says.

    newest: digest of every other robot's newest panorama in the ledger, asked at each plan.
    tell: is given each decision as it is made.
    """
    mission = _Mission(robot, body, newest, index, goal, config or MissionConfig(), tell)
    try:
        mission.run()
        arrived, reason = True, "the goal is in front of me"
    except _GaveUp as end:
        arrived, reason = False, str(end)
    mission.log("arrived" if arrived else "gave up", reason)
    return MissionResult(
        arrived, reason, tuple(mission.decisions), tuple(mission.looks), tuple(mission.plans)
    )


class _Mission:
    def __init__(
        self,
        robot: str,
        body: Body,
        newest: Callable[[], Mapping[str, bytes]],
        index: LandmarkIndex,
        goal: Goal,
        config: MissionConfig,
        tell: Callable[[Decision], None],
    ) -> None:
        self.robot, self.body, self.newest, self.index = robot, body, newest, index
        self.goal, self.config, self.tell = goal, config, tell
        self.decisions: list[Decision] = []
        self.looks: list[Panorama] = []
        self.plans: list[tuple[int, Route]] = []
        self.failed: set[LandmarkKey] = set()
        self.doubted: set[str] = set()  # robots whose sighting of the goal was a mistake
        self.now: Observation = body.observe()
        self.deadline_ns = self.now.time_ns + int(config.limit_s * 1e9)

    def log(self, what: str, why: str, look: int | None = None, **values: Any) -> None:
        decision = Decision(self.now.time_ns / 1e9, what, why, look, values)
        self.decisions.append(decision)
        self.tell(decision)

    def run(self) -> None:
        for _ in range(self.config.max_plans):
            features = self.look_around()
            sighting = find_goal(self.goal, features)
            if sighting is not None:
                if self.home_to_goal(sighting):
                    return
                features = self.look_around()  # it has driven since
            route = self.plan_route(features)
            self.plans.append((len(self.looks) - 1, route))
            if self.drive_chain(route) and self.home_to_goal(route=route):
                return
            self.log("plan again", "the goal was not reached this way")
        raise _GaveUp(f"{self.config.max_plans} plans failed")

    def look_around(self) -> Features:
        """A look that is kept as evidence."""
        features = self.look()
        assert self.now.panorama is not None
        self.looks.append(self.now.panorama)
        return features

    def look(self) -> Features:
        self.now = self.body.observe(look=True)
        assert self.now.panorama is not None
        return extract(self.now.panorama)

    def plan_route(self, features: Features) -> Route:
        others = self.newest()
        assert self.now.panorama is not None
        rig = self.now.panorama.rig
        found = plan(
            self.robot, features, rig, others, self.index, self.goal, self.failed, self.doubted
        )
        self._log_plan(found)
        if found.route is None:
            raise _GaveUp(found.why_none)
        return found.route

    def drive_chain(self, route: Route) -> bool:
        for number, leg in enumerate(route.legs):
            features = self.look_around()
            templates = self.leg_templates(leg)
            sighting = _best_sighting(templates, features, _LANDMARK_MATCHES)
            if number == 0 and leg.landmark.a.bearing_rad is not None:
                # planned from this very place: the plan knows where the landmark is
                half_width = 0.6 * (leg.landmark.a.angular_size_rad or 0.2)
                n_matches = len(leg.landmark.support_a)
                sighting = Sighting(leg.landmark.a.bearing_rad, 1.0, half_width, n_matches)
            name = f"landmark {number + 1}, common to {leg.seen_by} and {leg.next_by}"
            if sighting is None and not self.seek(name, templates, leg.next_by, _LANDMARK_MATCHES):
                self.failed.add(leg.key)
                return False
            stop_m = self.config.approach_m
            if not self.approach(name, templates, sighting, stop_m, _LANDMARK_MATCHES):
                self.failed.add(leg.key)
                return False
        return True

    def home_to_goal(self, sighting: Sighting | None = None, route: Route | None = None) -> bool:
        """Home to the goal, in view or as the route's last robot saw it; True if it is reached."""
        pictures = list(self.goal.templates)
        if route is not None:
            features = self.index.features(self.newest()[route.seen_by])
            pictures.append(sighting_template(features, route.sighting))
            sighting = _best_sighting(pictures, self.look_around(), GOAL_MATCHES)
            if sighting is None and not self.seek(
                "the goal", pictures, route.seen_by, GOAL_MATCHES
            ):
                return False
        stop_m = self.config.arrival_m
        track = self.approach("the goal", pictures, sighting, stop_m, GOAL_MATCHES)
        if track is None:
            return False
        if max(track.best_matches[: len(self.goal.templates)]) < self.config.sure_matches:
            self.log("doubt", "it never looked enough like the goal's pictures")
            self.doubted |= {route.seen_by} if route else set()
            return False
        return True

    def leg_templates(self, leg: Leg) -> list[Template]:
        """The landmark as the robots at both ends of the leg saw it, the farther one first."""
        newest = self.newest()
        ends = ((leg.next_by, leg.landmark.b), (leg.seen_by, leg.landmark.a))
        return [
            _region_template(self.index.features(newest[name]), region)
            for name, region in ends
            if name in newest
        ]

    def seek(
        self, name: str, templates: Sequence[Template], towards: str, min_matches: int
    ) -> bool:
        """Home to the place of another robot's panorama until one of the templates is seen."""
        digest = self.newest().get(towards)
        if digest is None:
            return False
        self.log("seek", f"{name} is not in view: homing to where {towards} saw it")
        home = self.index.features(digest)
        lost = 0
        while lost < self.config.lost_after:
            features = self.look()
            if _best_sighting(templates, features, min_matches) is not None:
                self.log("found", f"{name} came into view")
                return True
            vector = home_vector(features, home)
            if vector is not None and vector.arrived:
                break
            lost = lost + 1 if vector is None else 0
            if vector is not None and self.drive_towards(vector.bearing_rad) == "stuck":
                break
        self.log("lost", f"{name} did not come into view on the way to {towards}")
        return False

    def approach(
        self,
        name: str,
        templates: Sequence[Template],
        sighting: Sighting | None,
        stop_m: float,
        min_matches: int,
    ) -> Tracker | None:
        """Servo on a landmark's bearing, tracking it from view to view; None if that fails."""
        features = self.look()
        sighting = sighting or _best_sighting(templates, features, min_matches)
        if sighting is None:
            self.log("lost", f"{name} is not in view")
            return None
        bearing_deg = round(float(np.degrees(sighting.bearing_rad)), 1)
        self.log(
            "approach", f"{name} in view", len(self.looks) - 1,
            bearing_deg=bearing_deg, matches=sighting.n_matches,
        )  # fmt: skip
        track = Tracker(templates, min_matches, sighting, features, self.now.odometry)
        until_ns = self.now.time_ns + int(self.config.leg_limit_s * 1e9)
        while track.lost < self.config.lost_after:
            if self.now.time_ns > until_ns:
                self.log("astray", f"{name} is not reached after {self.config.leg_limit_s:g} s")
                return None
            outcome = self.drive_towards(track.bearing_rad, stop_m, track)
            if outcome == "near":
                self.log(
                    "reached", f"{name} is {stop_m:g} m ahead",
                    growth=round(track.growth, 2), matches=max(track.best_matches),
                )  # fmt: skip
                return track
            if outcome == "stuck":
                self.log("blocked", f"no headway towards {name}")
                return None
            track.update(self.look(), self.now.odometry)
        self.log("lost", f"{name} has not been recognised for {track.lost} looks")
        return None

    def drive_towards(
        self, bearing_rad: float, stop_m: float = 0.0, track: Tracker | None = None
    ) -> str:
        """Drive a stretch on a bearing; "near" if the thing ahead is, "stuck" or "on the way"."""
        course = wrap_angle_rad(self.now.odometry.yaw_rad + bearing_rad)
        started_ns, previous, travelled_m = self.now.time_ns, self.now.odometry, 0.0
        while travelled_m < self.config.look_every_m:
            if self.now.time_ns > self.deadline_ns:
                raise _GaveUp(f"out of time after {self.config.limit_s:g} s")
            wanted = float(wrap_angle_rad(course - self.now.odometry.yaw_rad))
            near = range_along_m(self.now.range_ring_m, wanted) < stop_m
            if near and (track is None or track.may_be_within(stop_m, self.now.odometry)):
                return "near"
            if self.now.time_ns - started_ns > self.config.stuck_after_s * 1e9:
                return "stuck"
            self.body.drive(steer(wanted, self.now.range_ring_m), self.config.tick_s)
            self.now = self.body.observe()
            travelled_m += previous.distance_to_m(self.now.odometry.xy_m)
            previous = self.now.odometry
        return "on the way"

    def _log_plan(self, found: Plan) -> None:
        look = len(self.looks) - 1
        for name, sighting in sorted(found.goal_seen_by.items()):
            self.log(
                "ledger", f"{name} sees the goal", look, robot=name, matches=sighting.n_matches
            )
        if found.route is not None:
            names = " - ".join(found.route.robots)
            self.log(
                "route",
                f"{names} - goal, by {len(found.route.legs)} common landmarks",
                look,
                score=round(found.route.score, 3),
            )


def range_along_m(
    range_ring_m: np.ndarray, bearing_rad: float, half_width_rad: float = 0.1
) -> float:
    """The shortest reading of a range ring within ``half_width_rad`` of a bearing."""
    beams = 2 * np.pi * np.arange(len(range_ring_m)) / len(range_ring_m)
    near = np.abs(wrap_angle_rad(beams - bearing_rad)) <= half_width_rad
    return float(range_ring_m[near].min()) if near.any() else float("inf")


def _region_template(features: Features, region: Region) -> Template:
    bearing, width = region.bearing_rad or 0.0, region.angular_size_rad or 0.2
    half_width = float(np.clip(0.6 * width, 0.05, 0.4))
    return template_around(features, bearing, half_width, (LOWEST_SLOPE, np.inf))


def _best_sighting(
    templates: Sequence[Template], features: Features, min_matches: int
) -> Sighting | None:
    found = best_sighting(templates, features, min_matches)
    return found[1] if found else None

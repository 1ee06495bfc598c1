"""A mission: look around, plan a chain of landmarks, drive it leg by leg, home to the goal.

The robot decides from its observations and the ledger's panoramas. Where nothing leads on it goes
and looks elsewhere, and plans again. Every decision is logged with the panorama that it rested on,
so that a mission can be read, and replayed in pictures.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Protocol

import numpy as np

from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.landmarks.common import Comparison, Region
from vrchain.landmarks.index import LandmarkIndex
from vrchain.landmarks.proposer import Proposals
from vrchain.landmarks.recognition import Sighting
from vrchain.navigation.eyes import Eyes, GoalPictures, GoalSight, Look
from vrchain.navigation.places import Place, beyond, sighted
from vrchain.navigation.route import LandmarkKey, Route, plan
from vrchain.navigation.tracker import Tracker
from vrchain.navigation.ways import Ways
from vrchain.panorama import Panorama
from vrchain.robot import Drive, Observation, steer

_DOUBTED_M = 7.0  # around where a goal was not confirmed, nothing is taken for it again
_FARTHEST_M = 80.0  # from farther away nothing is driven to
_STAND_DOUBT = 0.15  # of the distance to where another panorama was taken, as a share
_SAME_RAD = 0.1  # between a claim's region and its proposal
_LOST_AFTER, _LOST_M = 4, 6.0  # looks without a landmark that should be so near
_LARGE_M = 6.0  # from a landmark's middle to its side, at most
_TICKS = 3  # of steering between two looks for a way
_TURNS = 16  # directions in which it may go and look elsewhere
_EXPLORE_WITHIN_M = 60.0
_TURN_M = 4.0  # of way, that a radian of turn counts for
_FEELS_M, _FELT_M = 4.0, 0.7  # a goal so near is felt by the range ring, within so much
_AHEAD_RAD = 0.15
_LEAST_WAY_M = 4.0  # of way, after which the growth of a thing tells how far it is
_LOOKS_FAR_M = 7.5  # to the middle of what is seen of a goal, whose side is near
_SLOW_M_S = 0.4  # an approach that is slower leads astray
_CIRCLE = 6  # places around a goal from which it is looked at, to make sure
_CIRCLE_M = 5.0  # from its side


class Body(Protocol):
    """What a mission needs of a robot: its senses and its wheels."""

    def observe(self, look: bool = False, towards_rad: float | None = None) -> Observation:
        """What it senses now, with a panorama if it looks, or one camera's view."""

    def drive(self, command: Drive, duration_s: float) -> None:
        """Drive so for a while."""


@dataclass(frozen=True)
class MissionConfig:
    """How a mission is driven."""

    approach_m: float = 3.0  # a landmark is reached at this range, so that it hides no other
    arrival_m: float = 1.5  # the goal is reached at this range
    glance_every_m: float = 2.5  # of way: a view of what is driven to
    look_every_m: float = 10.0  # of way: a look around
    sees_m: float = 25.0  # from farther away a glance at the goal tells nothing
    tick_s: float = 0.3  # between two steering commands
    sure_matches: int = 20  # with the goal's pictures, seen on the way, to claim arrival
    least_score: float = 0.1  # of a route that is worth driving
    explores: bool = True  # whether it goes and looks elsewhere where no route leads on
    explore_m: float = 16.0  # from all places where it has looked around
    stuck_after_s: float = 15.0  # without half a metre of headway
    leg_limit_s: float = 60.0  # for one approach, beside the way; what takes longer leads astray
    limit_s: float = 600.0
    max_looks: int = 200


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
    index: LandmarkIndex[Look],
    goal: GoalPictures,
    eyes: Eyes,
    config: MissionConfig | None = None,
    tell: Callable[[Decision], None] = lambda decision: None,
) -> MissionResult:
    """Drive ``robot`` to ``goal`` by what the ledger says.

    newest: digest of every other robot's newest panorama in the ledger, asked at each plan.
    tell: is given each decision as it is made.
    """
    mission = _Mission(robot, body, newest, index, goal, eyes, config or MissionConfig(), tell)
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
        index: LandmarkIndex[Look],
        goal: GoalPictures,
        eyes: Eyes,
        config: MissionConfig,
        tell: Callable[[Decision], None],
    ) -> None:
        self.robot, self.body, self.newest, self.index = robot, body, newest, index
        self.goal, self.eyes, self.config, self.tell = goal, eyes, config, tell
        self.decisions: list[Decision] = []
        self.looks: list[Panorama] = []
        self.plans: list[tuple[int, Route]] = []
        self.failed: set[LandmarkKey] = set()
        self.doubted: set[str] = set()  # robots whose sighting of the goal was a mistake
        self.sizes: list[tuple[np.ndarray, dict[int, Sighting]]] = []  # of the goal, and from where
        self.mistaken: list[np.ndarray] = []  # where what looked like the goal was something else
        self.looked: list[np.ndarray] = []  # where it has looked around
        self.unreachable: list[np.ndarray] = []
        self.target: np.ndarray | None = None  # where it goes to look
        self.ways = Ways()
        self.compared: Mapping[tuple[str, str], Comparison] = {}  # of the plan that is driven
        self.found: GoalSight | None = None
        self.now: Observation = body.observe()
        self.deadline_ns = self.now.time_ns + int(config.limit_s * 1e9)

    @property
    def here(self) -> Pose:
        """By odometry."""
        return self.now.odometry

    def log(self, what: str, why: str, look: int | None = None, **values: Any) -> None:
        decision = Decision(self.now.time_ns / 1e9, what, why, look, values)
        self.decisions.append(decision)
        self.tell(decision)

    def run(self) -> None:
        while len(self.looks) < self.config.max_looks:
            look = self.look_around()
            sight = self.goal_in(look)
            if sight is not None:
                if self.home(self.place_of(sight), sight):
                    return
                continue
            route = self.plan_route(look)
            if route is not None:
                if self.follow(route, look):
                    return
                self.log("plan again", "the goal was not reached this way")
                continue
            self.explore()
        raise _GaveUp(f"the goal was not found in {self.config.max_looks} looks around")

    # --- looking ---

    def look_around(self) -> Look:
        """A look all around, which is kept as evidence."""
        self.now = self.body.observe(look=True)
        assert self.now.panorama is not None
        self.looks.append(self.now.panorama)
        self.looked.append(self.here.xy_m)
        return self.eyes.examine(self.now)

    def glance(self, bearing_rad: float) -> Look:
        """What one camera shows around a bearing."""
        self.now = self.body.observe(towards_rad=bearing_rad)
        return self.eyes.examine(self.now)

    def goal_in(self, look: Look) -> GoalSight | None:
        """The goal in a look around, if it is surely there and was not a mistake before."""
        sizes = self.goal.sizes(look)
        sight = self.goal.find(look, sizes=sizes)
        if sight is None or sight.chance < 0.5:
            return None
        self.sizes.append((self.here.xy_m, sizes))
        xy_m = self.place_of(sight).xy_m
        if any(np.hypot(*(xy_m - m)) < _DOUBTED_M for m in self.mistaken):
            return None
        return sight

    def place_of(self, sight: GoalSight) -> Place:
        """Where the goal's nearest side is."""
        return sighted(self.here, sight.bearing_rad, sight.surface_m)

    # --- planning ---

    def plan_route(self, look: Look) -> Route | None:
        found = plan(
            self.robot, look, self.newest(), self.index, self.goal, self.failed, self.doubted
        )
        number = len(self.looks) - 1
        route = found.route
        if route is not None and route.score >= self.config.least_score:
            for name, sight in sorted(found.goal_seen_by.items()):
                self.log(
                    "ledger", f"{name} sees the goal", number, robot=name, matches=sight.n_matches
                )
            names = " - ".join(route.robots)
            self.log(
                "route", f"{names} - goal, by {len(route.legs)} common landmarks", number,
                score=round(route.score, 3),
            )  # fmt: skip
            self.plans.append((number, route))
            self.compared = found.compared
            return route
        why = found.why_none or "the best chain is too unsure to be worth driving"
        if not self.config.explores:
            raise _GaveUp(why)
        self.log("no route", why, number)
        return None

    def targets(self, route: Route, look: Look) -> tuple[list[Tracker], Place | None]:
        """Where the route's landmarks and the goal should be, as far as the panoramas tell."""
        digests = self.newest()
        looks = [look, *(self.index.look(digests[n]) for n in route.robots[1:])]
        stands: list[Pose | None] = [self.here]
        for a, b in pairwise(route.robots):
            stands.append(self._stand(stands[-1], a, b))
        found = []
        for i, leg in enumerate(route.legs):
            ranges = leg.landmark.ranges or (None, None)
            baseline_m = self._baseline_m(leg.seen_by, leg.next_by)
            places, embedding = [], []
            for region, share, seen, stand in zip(
                (leg.landmark.a, leg.landmark.b), ranges, looks[i : i + 2], stands[i : i + 2],
                strict=True,
            ):  # fmt: skip
                k = proposal_of(seen.proposals, region)
                p = seen.proposals
                if k is not None:
                    embedding.append(p.embedding[k])
                range_m = float(p.range_m[k]) if k is not None else np.inf
                if k is None and share is not None and baseline_m is not None:
                    range_m = share * baseline_m
                if stand is not None and range_m < _FARTHEST_M:
                    off_m = _STAND_DOUBT * stand.distance_to_m(self.here.xy_m)
                    place = sighted(stand, region.bearing_rad or 0.0, range_m)
                    places.append(place.unsure(off_m))
            if not places:
                break
            place = places[0] if i == 0 or len(places) == 1 else places[0].with_sight(places[1])
            seen_as = np.stack(embedding) if embedding else np.empty((0, 0), dtype=np.float32)
            found.append(Tracker(place, seen_as, self.eyes.calibration))
        last, goal = stands[-1], None
        if last is not None:
            goal = sighted(last, route.sighting.bearing_rad, route.sighting.surface_m)
            goal = goal.unsure(_STAND_DOUBT * last.distance_to_m(self.here.xy_m))
        return found, goal

    def _compared(self, a: str, b: str) -> tuple[Comparison, bool]:
        """What two panoramas have in common, and whether it was asked the other way round."""
        if (a, b) in self.compared:
            return self.compared[a, b], False
        return self.compared[b, a], True

    def _baseline_m(self, a: str, b: str) -> float | None:
        geometry = self._compared(a, b)[0].geometry
        if geometry is None or not np.isfinite(geometry.baseline_heights):
            return None
        assert self.now.panorama is not None
        return float(geometry.baseline_heights * self.now.panorama.rig.camera_height_m)

    def _stand(self, stand: Pose | None, a: str, b: str) -> Pose | None:
        """Where b's panorama was taken, if a's was at ``stand``; None: nothing tells."""
        compared, turned = self._compared(a, b)
        geometry, baseline_m = compared.geometry, self._baseline_m(a, b)
        if stand is None or geometry is None or baseline_m is None:
            return None
        if turned:
            return beyond(stand, geometry.back_rad, baseline_m, -geometry.heading_rad)
        return beyond(stand, geometry.direction_rad, baseline_m, geometry.heading_rad)

    # --- driving ---

    def follow(self, route: Route, look: Look) -> bool:
        """Drive a route leg by leg, and home to the goal; True if it is reached."""
        trackers, goal_place = self.targets(route, look)
        for number, (leg, tracker) in enumerate(zip(route.legs, trackers, strict=False), 1):
            name = f"landmark {number}, common to {leg.seen_by} and {leg.next_by}"
            self.log(
                "approach", name, len(self.looks) - 1,
                bearing_deg=round(float(np.degrees(tracker.place.bearing_rad(self.here))), 1),
                range_m=round(tracker.place.range_m(self.here), 1),
            )  # fmt: skip
            ended = self.approach(name, tracker)
            if ended == "goal":
                assert self.found is not None
                return self.home(self.place_of(self.found), self.found)
            if ended != "near":
                self.failed.add(leg.key)
                return False
        if len(trackers) < len(route.legs) or goal_place is None:
            return False  # from here it will see more
        if self.home(goal_place, None):
            return True
        self.doubted.add(route.seen_by)
        return False

    def approach(self, name: str, tracker: Tracker) -> str:
        """Drive to a landmark: "near", "goal" if that came into view, "lost" or "blocked"."""
        config = self.config
        until_ns = self.now.time_ns + self.limit_ns(tracker.place)
        glanced, looked, stretch = 0.0, 0.0, 0.5
        while self.now.time_ns < until_ns:
            place = tracker.place
            range_m = place.range_m(self.here)
            ahead_m = range_along_m(self.now.range_ring_m, place.bearing_rad(self.here))
            if range_m <= config.approach_m or (
                ahead_m < config.approach_m and range_m < config.approach_m + _LARGE_M
            ):
                self.log("reached", f"{name} is near", seen=tracker.seen)
                return "near"
            if tracker.missed >= _LOST_AFTER and tracker.seen == 0 and range_m < _LOST_M:
                self.log("lost", f"{name} is not where it should be")
                return "lost"
            way_m = self.stretch(place.xy_m, config.approach_m - 0.5, stretch)
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
                look = self.look_around()
                self.found = self.goal_in(look)
                if self.found is not None:
                    return "goal"
                tracker.update(look, self.here)
            elif glanced >= config.glance_every_m:
                glanced = 0.0
                look = self.glance(tracker.place.bearing_rad(self.here))
                tracker.update(look, self.here)
        self.log("astray", f"{name} is not reached in reasonable time")
        return "lost"

    def stretch(self, xy_m: np.ndarray, within_m: float, way_m: float) -> float | None:
        """Drive some way towards a place, around what is in the way; None: it gets no nearer."""
        started_ns, driven_m, previous = self.now.time_ns, 0.0, self.here
        while driven_m < way_m:
            self.ways.note(self.here, self.now.range_ring_m)
            course = self.ways.course_rad(self.here, xy_m, within_m)
            if course is None:
                return driven_m if driven_m > 0.2 else None
            if self.now.time_ns - started_ns > self.config.stuck_after_s * 1e9:
                self.ways.block(self.here, course)
                return None
            for _ in range(_TICKS):
                if self.now.time_ns > self.deadline_ns:
                    raise _GaveUp(f"out of time after {self.config.limit_s:g} s")
                wanted = float(wrap_angle_rad(course - self.here.yaw_rad))
                self.body.drive(steer(wanted, self.now.range_ring_m), self.config.tick_s)
                self.now = self.body.observe()
                driven_m += previous.distance_to_m(self.here.xy_m)
                previous = self.here
        return driven_m

    def home(self, place: Place, sight: GoalSight | None) -> bool:
        """Drive to the goal, making sure on the way that it is the goal; True if it is reached."""
        matches = sight.n_matches if sight is not None else 0
        sure = sight is not None and self.is_sure(sight)
        self.log(
            "approach", "the goal", len(self.looks) - 1,
            bearing_deg=round(float(np.degrees(place.bearing_rad(self.here))), 1),
            range_m=round(place.range_m(self.here), 1), matches=matches,
        )  # fmt: skip
        place, sure = self.close_in(place, sure)
        if not sure:
            self.log("circle", "it has not looked enough like the goal yet: from other sides")
            place, sure = self.circle(place)
            if sure:
                place, sure = self.close_in(place, sure)
        if not sure:
            self.log("doubt", "it never looked enough like the goal's pictures")
            self.mistaken.append(place.xy_m)
            return False
        if not self.is_at(self.felt(place)) or self.looks_far():
            self.log("blocked", "no way leads to the goal from here")
            self.mistaken.append(place.xy_m)
            return False
        return True

    def looks_far(self) -> bool:
        """Whether the goal has not grown enough to be here: something before it stands here.

        What looks g times larger after a way D towards it is D / (g - 1) away.
        """
        now = self.goal.sizes(self.look_around())
        ranges_m = [
            self.here.distance_to_m(then) / max(now[k].scale / seen.scale - 1.0, 1e-3)
            for then, sizes in self.sizes
            if self.here.distance_to_m(then) > _LEAST_WAY_M
            for k, seen in sizes.items()
            if k in now
        ]
        return bool(ranges_m) and float(np.median(ranges_m)) > _LOOKS_FAR_M

    def is_sure(self, sight: GoalSight) -> bool:
        return sight.chance >= 1.0 or sight.n_matches >= self.config.sure_matches

    def is_at(self, place: Place) -> bool:
        """Whether the goal's side is within reach, and something is there."""
        ahead_m = range_along_m(self.now.range_ring_m, place.bearing_rad(self.here), _AHEAD_RAD)
        reach_m = self.config.arrival_m
        return place.range_m(self.here) <= reach_m and ahead_m <= reach_m + _FELT_M

    def felt(self, place: Place) -> Place:
        """The goal's side where the range ring meets something, once it is believed so near."""
        bearing, range_m = place.bearing_rad(self.here), place.range_m(self.here)
        ahead_m = range_along_m(self.now.range_ring_m, bearing, _AHEAD_RAD)
        if range_m > _FEELS_M or not range_m - _FELT_M < ahead_m < self.ways.reach_m:
            return place  # what is before it is to be driven around
        course = self.here.yaw_rad + bearing
        there = self.here.xy_m + ahead_m * np.array([np.cos(course), np.sin(course)])
        return Place(there, place.covariance)

    def close_in(self, place: Place, sure: bool) -> tuple[Place, bool]:
        """Drive up to the goal's side; where it is by the last sight, and whether that is sure."""
        config = self.config
        glanced, looked = config.glance_every_m, 0.0
        until_ns = self.now.time_ns + self.limit_ns(place)
        while self.now.time_ns < until_ns and not self.is_at(place):
            if place.range_m(self.here) <= config.sees_m:
                if glanced >= config.glance_every_m:
                    glanced = 0.0
                    place, made_sure = self.regard(place)
                    sure = sure or made_sure
            elif looked >= config.look_every_m:
                looked = 0.0
                sight = self.goal_in(self.look_around())
                if sight is not None:
                    place, sure = self.place_of(sight), sure or self.is_sure(sight)
            place = self.felt(place)
            way_m = self.stretch(place.xy_m, 1.0, 0.5)
            if way_m is None:
                break
            glanced, looked = glanced + way_m, looked + way_m
            place = place.after(way_m)
        return place, sure

    def limit_ns(self, place: Place) -> int:
        """How long an approach may take."""
        return int((self.config.leg_limit_s + place.range_m(self.here) / _SLOW_M_S) * 1e9)

    def regard(self, place: Place) -> tuple[Place, bool]:
        """Glance at the goal; where it is now, and whether it surely is the goal."""
        bearing = place.bearing_rad(self.here)
        look = self.glance(bearing)
        window_rad = float(np.clip(2 * place.std_m / max(place.range_m(self.here), 1.0), 0.2, 1.0))
        sight = self.goal.find(look, bearing, window_rad)
        if sight is None or sight.chance <= 0:
            return place, False
        self.sizes.append((self.here.xy_m, self.goal.sizes(look)))
        seen = self.place_of(sight)
        if place.astray(seen) > 4.0:
            return place, False
        return place.with_sight(seen), self.is_sure(sight)

    def circle(self, place: Place) -> tuple[Place, bool]:
        """Look at what may be the goal from other sides."""
        middle = place.xy_m + 4.0 * (place.xy_m - self.here.xy_m) / max(
            place.range_m(self.here), 0.1
        )
        first = np.arctan2(*(self.here.xy_m - middle)[::-1])
        for turn in (1, -1, 2, -2, 3)[: _CIRCLE - 1]:
            angle = first + turn * 2 * np.pi / _CIRCLE
            xy_m = middle + (4.0 + _CIRCLE_M) * np.array([np.cos(angle), np.sin(angle)])
            until_ns = self.now.time_ns + int(25e9)
            while self.now.time_ns < until_ns and self.here.distance_to_m(xy_m) > 1.5:
                if self.stretch(xy_m, 1.0, 1.0) is None:
                    break
            around = Place(middle, 9.0 * np.eye(2))
            seen, sure = self.regard(around)
            if sure:
                return seen, True
        return place, False

    # --- exploring ---

    def explore(self) -> None:
        """Drive on towards the nearest place, by ways, around which it has not looked yet."""
        target = self.unseen()
        if target is None:
            raise _GaveUp("there is nowhere left to look from where I can get")
        if self.target is None or np.hypot(*(target - self.target)) > 1e-6:
            self.log("explore", "going where I have not looked yet", len(self.looks) - 1)
        self.target = target
        way_m = 0.0
        while way_m < self.config.look_every_m:
            if self.here.distance_to_m(target) < 3.0:
                return
            driven_m = self.stretch(target, 2.0, 1.0)
            if driven_m is None:
                self.unreachable.append(target)
                return
            way_m += driven_m

    def unseen(self) -> np.ndarray | None:
        """The nearest place far from all where it has looked; as before, if that is near."""
        apart_m = self.config.explore_m
        known = np.array(self.looked + self.unreachable)
        angle = np.arange(_TURNS) * 2 * np.pi / _TURNS
        rim = (apart_m + 1.0) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        places = (known[:, None] + rim).reshape(-1, 2)
        places = places if self.target is None else np.vstack([self.target, places])
        new = np.hypot(*(places[:, None] - known).transpose(2, 0, 1)).min(axis=1) >= apart_m
        own = self.target is not None and bool(new[0])
        near = np.hypot(*(places - self.here.xy_m).T) < _EXPLORE_WITHIN_M
        places = places[new & near]
        if len(places) == 0:
            return None
        length_m = self.ways.lengths_m(self.here, places)
        turn = np.arctan2(*(places - self.here.xy_m).T[::-1]) - self.here.yaw_rad
        value = length_m + _TURN_M * np.abs(wrap_angle_rad(turn))
        if own and near[0]:
            value[0] *= 0.6  # no dithering
        best = int(value.argmin())
        return places[best] if np.isfinite(value[best]) else None


def proposal_of(proposals: Proposals, region: Region) -> int | None:
    """The proposal that a claim's region is of, or None."""
    box = proposals.box
    middle, width = (box[:, 0] + box[:, 1]) / 2, box[:, 1] - box[:, 0]
    off = np.abs(wrap_angle_rad(middle - (region.bearing_rad or 0.0)))
    off = off + 0.5 * np.abs(width - (region.angular_size_rad or 0.0))
    if len(off) == 0 or off.min() > _SAME_RAD:
        return None
    return int(off.argmin())


def range_along_m(
    range_ring_m: np.ndarray, bearing_rad: float, half_width_rad: float = 0.1
) -> float:
    """The shortest reading of a range ring within ``half_width_rad`` of a bearing."""
    beams = 2 * np.pi * np.arange(len(range_ring_m)) / len(range_ring_m)
    near = np.abs(wrap_angle_rad(beams - bearing_rad)) <= half_width_rad
    return float(range_ring_m[near].min()) if near.any() else float("inf")

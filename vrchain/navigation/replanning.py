"""Planning again and again on the way: by what the ledger says now, and what was not rejected."""

from collections.abc import Callable, Mapping
from functools import cache

import numpy as np

from vrchain.geometry import Pose
from vrchain.landmarks.retrieval.index import LandmarkIndex
from vrchain.navigation.driving.drive import Pilot
from vrchain.navigation.driving.exploring import Looked
from vrchain.navigation.goal.recognition import KnownGoal
from vrchain.navigation.goal.rejections import Rejections
from vrchain.navigation.perception import Look
from vrchain.navigation.planning.route import LandmarkKey, Plan, Route, plan
from vrchain.navigation.settings import Log, Published, panorama_name

MOVED_M = 1.0  # nearer to each other are looks from one place
_OWN = 8  # latest looks from which a route may begin


class Replanner:
    """Plans from where the robot is now.

    own: where it planned before, what it saw, and the index of that look; the latest first. failed:
    landmarks that led nowhere.
    """

    def __init__(
        self,
        robot: str,
        pilot: Pilot,
        published: Callable[[], Mapping[str, Published]],
        index: LandmarkIndex[Look],
        goal: KnownGoal,
        log: Log,
    ) -> None:
        self.robot, self.pilot, self.published, self.index = robot, pilot, published, index
        self.rejections = Rejections(pilot.perception, index, log, goal.share)
        self.own: list[tuple[Pose, Look, int]] = []
        self.failed: set[LandmarkKey] = set()
        self._doubted: Mapping[str, float] = {}
        self._find = goal.find
        self._alike = cache(pilot.perception.alike)  # asked of the same looks again and again

    def plan(self, look: Look) -> Plan:
        """What the ledger says now, of what did not fail before."""
        published = self.published()
        if self.own and self.own[0][0].distance_to_m(self.pilot.here.xy_m) < MOVED_M:
            self.own.pop(0)  # from here it saw the same: it is no second witness
        self.own.insert(0, (self.pilot.here, look, len(self.pilot.looks) - 1))
        found = plan(
            self.robot, [(stood, seen) for stood, seen, _ in self.own[:_OWN]], published,
            self.index, self._find, self.failed, self.rejections.sights, self.rejections.trust,
            self._lasting, self._alike, self.pilot.config.reputation, self._doubted,
        )  # fmt: skip
        self._doubted = found.doubted  # also when what told against it is long published
        return found

    def begin(self, route: Route) -> tuple[Pose, int]:
        """Where a route begins, and the index of the look from there."""
        names = (panorama_name(self.robot, k) for k in range(len(self.own)))
        at = dict(zip(names, self.own, strict=True))[route.robots[0]]
        return at[0], at[2]

    def looked_by_others(self, found: Plan) -> list[Looked]:
        """From where others, as far as that is sure, did not see the goal, and what they saw."""
        own = {panorama_name(self.robot, k): stood for k, (stood, _, _) in enumerate(self.own)}
        return [
            (pose, found.looks[name])
            for name, pose in found.poses.reached(own).items()
            if name in found.published and name not in found.goal_seen_by
        ]

    def _lasting(self, seen: Published) -> float:
        """The chance that a view has not changed since."""
        age_s = max(0, self.pilot.now.time_ns - seen.time_ns) / 1e9
        return float(np.exp(-age_s / self.pilot.config.lasting_s))

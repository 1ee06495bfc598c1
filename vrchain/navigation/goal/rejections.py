"""What led astray and is not followed again: relative poses, sights of the goal, places."""

from dataclasses import dataclass

import numpy as np

from vrchain.geometry import Pose
from vrchain.landmarks.matching.common import Comparison
from vrchain.landmarks.retrieval.index import LandmarkIndex
from vrchain.navigation.driving.estimates import Array, Estimate
from vrchain.navigation.driving.targets import poses_along
from vrchain.navigation.perception import Look, Perception
from vrchain.navigation.planning.relative_poses import ORIGIN, SURE
from vrchain.navigation.planning.route import Leg, Plan, Route
from vrchain.navigation.settings import Log

_SAME_M = 8.0  # within which two panoramas that are said to show the goal show one thing
_ASKED, _KNOWN_M = 2, 12.0  # panoramas from so near are known again,
_NOTHING = 0.05  # or else this is the trust in a relative pose with them


@dataclass(frozen=True, eq=False)
class Driven:
    """A route that is driven, from where, the plan that it is of, and where the goal should be."""

    route: Route
    plan: Plan
    begin: Pose
    goal: Estimate | None = None

    def expected(self) -> list[tuple[bytes, Pose, int]]:
        """Where others' panoramas should have been taken, as far as something tells.

        Of each its digest, the pose, and how many legs lead there.
        """
        taken = poses_along(self.route, self.plan.poses, self.begin)
        return [
            (self.plan.published[name].digest, pose, n_legs)
            for n_legs, (name, pose) in enumerate(zip(self.route.robots, taken, strict=True))
            if pose is not None and name in self.plan.published
        ]


class Rejections:
    """What was found wrong so far.

    pairs: of looks whose relative pose is; sights: panoramas whose sight of the goal is. share: the
    goal's; same_m: within which one goal is supposed, less in rooms.
    """

    def __init__(
        self, perception: Perception, index: LandmarkIndex[Look], log: Log, share: float
    ) -> None:
        self._perception, self._index, self._log = perception, index, log
        self.pairs: list[tuple[Look, Look]] = []
        self.sights: set[bytes] = set()
        self.same_m = share * _SAME_M
        self._in_vain: list[Array] = []  # where the goal should have been

    def trust(self, a: Look, b: Look, compared: Comparison) -> float:
        """The chance that a relative pose is right, none if it was rejected."""
        if any({id(a), id(b)} == {id(one), id(other)} for one, other in self.pairs):
            return 0.0
        return self._perception.trust(a, b, compared)

    def was_in_vain(self, goal: Estimate) -> bool:
        """Whether no goal was found there before."""
        return any(np.hypot(*(goal.xy_m - before)) < self.same_m for before in self._in_vain)

    def found_nothing(self, goal: Estimate, driven: Driven) -> None:
        """A route was driven to its end, and no goal is there."""
        self._in_vain.append(goal.xy_m)
        self.blame(driven)

    def blame(self, driven: Driven) -> None:
        """What led to where no goal is: the relative pose that is least sure, or a sight."""
        route, plan = driven.route, driven.plan
        same = {n for n in plan.goal_seen_by if self._is_one_thing(plan, route.seen_by, n)}
        names = sorted({route.seen_by, *same})
        leg = min(route.legs, key=lambda leg: leg.trust)
        if leg.trust < max(plan.goal_seen_by[name].chance for name in names):
            self._reject(leg, plan)
            return
        self._log("doubt", f"what {', '.join(names)} saw is not the goal")
        self.sights.update(plan.published[name].digest for name in names)

    def is_elsewhere(self, look: Look, here: Pose, driven: Driven) -> bool:
        """Whether what was seen from near here looks nothing like it: a relative pose was wrong.

        Panoramas so near to each other as good as always have something in common.
        """
        asked = sorted(
            (here.distance_to_m(pose.xy_m), digest, n_legs)
            for digest, pose, n_legs in driven.expected()
        )[:_ASKED]
        if len(asked) < _ASKED or asked[-1][0] >= _KNOWN_M:
            return False
        for _, digest, _ in asked:
            found = self._index.compare_with(look, digest)
            if found.common and self.trust(look, self._index.look(digest), found) >= _NOTHING:
                return False
        # One of them is expected here by the legs that lead to it alone.
        led = driven.route.legs[: min(n_legs for *_, n_legs in asked)]
        by_landmarks = [leg for leg in led if not leg.by_odometry]
        self._log("elsewhere", "nothing here is as others should have seen it")
        self._reject(min(by_landmarks, key=lambda leg: leg.trust), driven.plan)
        return True

    def _reject(self, leg: Leg, plan: Plan) -> None:
        """The relative pose that a leg rests on."""
        self._log("doubt", f"{leg.seen_by} and {leg.next_by} were not joined rightly")
        self.pairs.append((plan.looks[leg.seen_by], plan.looks[leg.next_by]))

    def _is_one_thing(self, plan: Plan, a: str, b: str) -> bool:
        """Whether what two panoramas take for the goal is in one place, by a sure relative pose."""
        step = plan.poses.between(a, b)
        if step is None or plan.poses.trust((a, b)) < SURE:
            return False
        one, other = (
            plan.goal_seen_by[name].place(pose).xy_m for name, pose in ((a, ORIGIN), (b, step))
        )
        return bool(np.hypot(*(one - other)) < self.same_m)

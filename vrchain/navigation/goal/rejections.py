"""What led astray, and is not followed again: joins of panoramas, sights of the goal, places."""

from dataclasses import dataclass

import numpy as np

from vrchain.geometry import Pose
from vrchain.landmarks.matching.common import Comparison
from vrchain.landmarks.retrieval.index import LandmarkIndex
from vrchain.navigation.driving.drive import Array
from vrchain.navigation.driving.estimates import Estimate, sighted
from vrchain.navigation.driving.targets import poses_along
from vrchain.navigation.perception import Look, Perception
from vrchain.navigation.planning.relative_poses import ORIGIN, SURE
from vrchain.navigation.planning.route import Leg, Plan, Route
from vrchain.navigation.settings import Log

SAME_M = 8.0  # within which two panoramas that are said to show the goal show one thing
_ASKED, _KNOWN_M = 2, 12.0  # panoramas from so near are known again,
_NOTHING = 0.05  # or else this is the trust in a join with them


@dataclass(frozen=True, eq=False)
class Driven:
    """A route that is driven, from where, and the plan that it is of."""

    route: Route
    plan: Plan
    begin: Pose

    def expected(self) -> list[tuple[bytes, Pose, int]]:
        """Where others' panoramas should have been taken, as far as something tells.

        Of each its digest, the pose, and how many legs lead there.
        """
        stands = poses_along(self.route, self.plan.poses, self.begin)
        return [
            (self.plan.published[name].digest, stand, n_legs)
            for n_legs, (name, stand) in enumerate(zip(self.route.robots, stands, strict=True))
            if stand is not None and name in self.plan.published
        ]


class Rejections:
    """What was found wrong so far."""

    def __init__(self, perception: Perception, index: LandmarkIndex[Look], log: Log) -> None:
        self._eyes, self._index, self._log = perception, index, log
        self.refuted: list[tuple[Look, Look]] = []  # that were not joined rightly
        self.sights: set[bytes] = set()  # panoramas whose sight of the goal was a mistake
        self._in_vain: list[Array] = []  # where the goal should have been

    def trust(self, a: Look, b: Look, compared: Comparison) -> float:
        """The chance that two panoramas were joined rightly, none if that was refuted."""
        if any({id(a), id(b)} == {id(one), id(other)} for one, other in self.refuted):
            return 0.0
        return self._eyes.trust(a, b, compared)

    def was_in_vain(self, goal: Estimate) -> bool:
        """Whether no goal was found there before."""
        return any(np.hypot(*(goal.xy_m - before)) < SAME_M for before in self._in_vain)

    def found_nothing(self, goal: Estimate, driven: Driven) -> None:
        """A route was driven to its end, and no goal is there."""
        self._in_vain.append(goal.xy_m)
        self.blame(driven)

    def blame(self, driven: Driven) -> None:
        """What led to where no goal is: the join that is least sure, or the sight if it is less."""
        route, plan = driven.route, driven.plan
        same = {n for n in plan.goal_seen_by if _is_one_thing(plan, route.seen_by, n)}
        names = sorted({route.seen_by, *same})
        leg = min(route.legs, key=lambda leg: leg.trust)
        if leg.trust < max(plan.goal_seen_by[name].chance for name in names):
            self._refute(leg, plan)
            return
        self._log("doubt", f"what {', '.join(names)} saw is not the goal")
        self.sights.update(plan.published[name].digest for name in names)

    def is_elsewhere(self, look: Look, here: Pose, driven: Driven) -> bool:
        """Whether what was seen from near here looks nothing like it: then a join was wrong.

        Panoramas so near to each other are as good as always joined.
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
        joined = [leg for leg in led if not leg.by_odometry]
        self._log("elsewhere", "nothing here is as others should have seen it")
        self._refute(min(joined, key=lambda leg: leg.trust), driven.plan)
        return True

    def _refute(self, leg: Leg, plan: Plan) -> None:
        """The two panoramas of a leg are not joined again."""
        self._log("doubt", f"{leg.seen_by} and {leg.next_by} were not joined rightly")
        self.refuted.append((plan.looks[leg.seen_by], plan.looks[leg.next_by]))


def _is_one_thing(plan: Plan, a: str, b: str) -> bool:
    """Whether what two surely joined panoramas take for the goal is in one place."""
    stand = plan.poses.between(a, b)
    if stand is None or plan.poses.trust((a, b)) < SURE:
        return False
    one, other = (
        sighted(pose, sight.bearing_rad, sight.surface_m).xy_m
        for pose, sight in ((ORIGIN, plan.goal_seen_by[a]), (stand, plan.goal_seen_by[b]))
    )
    return bool(np.hypot(*(one - other)) < SAME_M)

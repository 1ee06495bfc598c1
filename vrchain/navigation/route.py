"""Planning: who sees the goal, and by which chain of common landmarks to get there.

The paper's chain R1 -L12- R2 -L23- R3 - goal is a path in the landmark graph of panoramas: the one
in front of the robot and every other robot's newest.
"""

from collections.abc import Callable, Mapping, Set
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from vrchain.errors import VRChainError
from vrchain.landmarks.common import CommonLandmark, Comparison
from vrchain.landmarks.index import LandmarkIndex
from vrchain.navigation.eyes import Look
from vrchain.navigation.goal import GoalSight, KnownGoal
from vrchain.navigation.graph import Claim, LandmarkGraph, landmark_graph
from vrchain.navigation.planner import Chain
from vrchain.navigation.stands import baseline_m

_FAR_M = 80.0  # a way this long by a landmark leaves 1/e of the chance to arrive
_TYPICAL_BASELINE_M = 12.0  # where too little of the ground was matched to tell
_LEAST_SIGHT = 0.05  # chance that a sight is of the goal, from which it counts as one
_LEAST = 1e-300  # a chance is never nothing

LandmarkKey = tuple[str, str, int]


@dataclass(frozen=True, eq=False)
class Leg:
    """Drive to ``landmark``, common to what ``seen_by`` and ``next_by`` see.

    node: the landmark's name in ``LandmarkGraph.networkx``.
    """

    seen_by: str
    next_by: str
    landmark: CommonLandmark
    key: LandmarkKey  # names the landmark among those that failed
    node: str


@dataclass(frozen=True, eq=False)
class Route:
    """A chain of legs; from the last landmark on, what ``seen_by`` saw of the goal leads home."""

    legs: tuple[Leg, ...]
    seen_by: str
    sighting: GoalSight
    score: float

    @property
    def robots(self) -> tuple[str, ...]:
        """The robots of the chain, the driving one first."""
        return (*tuple(leg.seen_by for leg in self.legs), self.seen_by)


@dataclass(frozen=True, eq=False)
class Plan:
    """The best route, or None; what is known of who sees the goal, in matches; the graph.

    spares: the next best routes, best first; no landmark in two routes. unreadable: robots whose
    newest panorama is gone or is none. compared: what each two panoramas have in common.
    """

    route: Route | None
    spares: tuple[Route, ...]
    graph: LandmarkGraph
    goal_seen_by: dict[str, GoalSight]
    unreadable: tuple[str, ...]
    compared: Mapping[tuple[str, str], Comparison] = field(default_factory=dict)

    @property
    def why_none(self) -> str:
        """Why there is no route, in plain words; empty if there is one."""
        if self.route is not None:
            return ""
        if len(self.graph.robots) == 1 and self.unreadable:
            return f"no newest panorama can be read, of {', '.join(self.unreadable)}"
        if len(self.graph.robots) == 1:
            return "the ledger holds no panorama of another robot"
        if not self.goal_seen_by:
            return "no robot's newest panorama shows the goal"
        names = ", ".join(sorted(self.goal_seen_by))
        sees = "sees" if len(self.goal_seen_by) == 1 else "see"
        return f"{names} {sees} the goal, but no chain of common landmarks leads there"


def plan(
    robot: str,
    current: Look,
    newest: Mapping[str, bytes],
    index: LandmarkIndex[Look],
    goal: KnownGoal,
    failed: Set[LandmarkKey] = frozenset(),
    doubted: Set[str] = frozenset(),
    trust: Callable[[str, str, Comparison], float] = lambda a, b, found: 1.0,
    spares: int = 2,
) -> Plan:
    """The chain with the best chance, a product over its landmarks, from ``robot`` to the goal.

    newest: digest of every other robot's newest panorama. failed: landmarks not to use again.
    doubted: robots whose sighting of the goal is not to be trusted. trust: the chance that two
    robots' panoramas were joined rightly. spares: how many more routes.
    """
    unreadable = tuple(name for name in sorted(newest) if not _readable(index, newest[name]))
    newest = {name: digest for name, digest in newest.items() if name not in unreadable}
    seen: dict[str, GoalSight] = {}
    for name, digest in newest.items():
        sighting = goal.find(index.look(digest))
        if sighting and sighting.chance >= _LEAST_SIGHT and name not in doubted:
            seen[name] = sighting
    names = [robot, *sorted(newest)]
    claims, compared = [], {}
    for i, a in enumerate(names):
        for b in names[i + 1 :]:
            found = (
                index.compare_with(current, newest[b])
                if a == robot
                else index.compare(newest[a], newest[b])
            )
            compared[a, b] = found
            right = trust(a, b, found)
            apart_m = baseline_m(found, current.rig) or _TYPICAL_BASELINE_M
            claims += [
                Claim(a, b, common, max(right * worth(common, apart_m), _LEAST))
                for common in found.common
                if _key(a, b, common) not in failed
            ]
    chances = {name: sighting.chance for name, sighting in seen.items()}
    graph = landmark_graph(names, claims, chances)
    without = [k for k, (_, c) in enumerate(graph.legs) if _key(c.a, c.b, c.landmark) in failed]
    chains = graph.planner.routes(
        0, {names.index(name): chance for name, chance in chances.items()}, 1 + spares,
        without_legs=without,
    )  # fmt: skip
    routes = tuple(_route(graph, chain, seen) for chain in chains)
    return Plan(routes[0] if routes else None, routes[1:], graph, seen, unreadable, compared)


def _readable(index: LandmarkIndex[Look], digest: bytes) -> bool:
    """Whether the panorama is there and is one: what others publish may be anything."""
    try:
        index.look(digest)
    except VRChainError:
        return False
    return True


def worth(claim: CommonLandmark, baseline_m: float) -> float:
    """The chance to get on by a common landmark: its score, less for a long way by it.

    baseline_m: the distance between the two robots that have it in common.
    """
    if claim.ranges is None:
        return claim.score
    return claim.score * float(np.exp(-sum(claim.ranges) * baseline_m / _FAR_M))


def _key(a: str, b: str, claim: CommonLandmark) -> LandmarkKey:
    # seen from b, whose panorama stands still while the driving robot's changes
    bearing = claim.b.bearing_rad if claim.b.bearing_rad is not None else 0.0
    return (a, b, round(float(np.degrees(bearing)) / 5))


def _route(graph: LandmarkGraph, chain: Chain, seen: Mapping[str, GoalSight]) -> Route:
    robots = [graph.robots[i] for i in chain.robots]
    legs = tuple(
        _leg(*pair, graph.legs[k][1], graph.name(landmark))
        for pair, k, landmark in zip(pairwise(robots), chain.legs, chain.landmarks, strict=True)
    )
    return Route(legs, robots[-1], seen[robots[-1]], chain.score)


def _leg(a: str, b: str, claim: Claim, node: str) -> Leg:
    landmark, key = claim.landmark, _key(claim.a, claim.b, claim.landmark)
    if (claim.a, claim.b) != (a, b):  # walked against the order of comparison
        ranges = landmark.ranges[::-1] if landmark.ranges else None
        landmark = CommonLandmark(
            landmark.score,
            landmark.b,
            landmark.a,
            landmark.support_b,
            landmark.support_a,
            ranges,
        )
    return Leg(a, b, landmark, key, node)

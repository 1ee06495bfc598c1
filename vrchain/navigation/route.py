"""Planning: who sees the goal, and by which chain of common landmarks to get there.

The paper's chain R1 -L12- R2 -L23- R3 - goal is a path in a graph whose nodes are panoramas: the
one in front of the robot and every other robot's newest; an edge is a common landmark.
"""

from collections.abc import Mapping, Set
from dataclasses import dataclass
from itertools import pairwise

import networkx as nx
import numpy as np

from vrchain.errors import VRChainError
from vrchain.landmarks.common import CommonLandmark, Comparison, support_score
from vrchain.landmarks.index import LandmarkIndex
from vrchain.landmarks.recognition import Goal, Sighting, find_goal
from vrchain.landmarks.sift import Features
from vrchain.panorama import CameraRig

_FAR_M = 30.0  # a way this long by a landmark leaves 1/e of the chance to arrive
_NEIGHBOUR_M = 10.0  # robots farther apart have few landmarks in common, and less sure ones
_TYPICAL_BASELINE_M = 12.0  # where too little of the ground was matched to tell

_LEG_COST = 1e-9  # decides between chains of equal scores: the fewer legs the better

LandmarkKey = tuple[str, str, int]


@dataclass(frozen=True, eq=False)
class Leg:
    """Drive to ``landmark``, common to what ``seen_by`` and ``next_by`` see."""

    seen_by: str
    next_by: str
    landmark: CommonLandmark
    key: LandmarkKey  # names the landmark among those that failed


@dataclass(frozen=True, eq=False)
class Route:
    """A chain of legs; from the last landmark on, what ``seen_by`` saw of the goal leads home."""

    legs: tuple[Leg, ...]
    seen_by: str
    sighting: Sighting
    score: float

    @property
    def robots(self) -> tuple[str, ...]:
        """The robots of the chain, the driving one first."""
        return (*tuple(leg.seen_by for leg in self.legs), self.seen_by)


@dataclass(frozen=True, eq=False)
class Plan:
    """The best route, or None; and what is known of who sees the goal, in matches."""

    route: Route | None
    graph: nx.Graph
    goal_seen_by: dict[str, Sighting]


def plan(
    robot: str,
    current: Features,
    rig: CameraRig,
    newest: Mapping[str, bytes],
    index: LandmarkIndex,
    goal: Goal,
    failed: Set[LandmarkKey] = frozenset(),
    doubted: Set[str] = frozenset(),
) -> Plan:
    """The chain with the best chance, a product over its landmarks, from ``robot`` to the goal.

    newest: digest of every other robot's newest panorama. failed: landmarks not to use again.
    doubted: robots whose sighting of the goal is not to be trusted.
    """
    newest = {name: digest for name, digest in newest.items() if _readable(index, digest)}
    seen: dict[str, Sighting] = {}
    for name, digest in newest.items():
        sighting = find_goal(goal, index.features(digest))
        if sighting is not None and name not in doubted:
            seen[name] = sighting
    graph = nx.Graph()
    graph.add_nodes_from([robot, *newest])
    names = [robot, *sorted(newest)]
    for i, a in enumerate(names):
        for b in names[i + 1 :]:
            compared = (
                index.compare_with(current, rig, newest[b])
                if a == robot
                else index.compare(newest[a], newest[b])
            )
            usable = [(c, _key(a, b, c)) for c in compared.common]
            usable = [(c, key) for c, key in usable if key not in failed]
            if usable:
                baseline_m = _baseline_m(compared, rig)
                worths = [worth(c, baseline_m) for c, _ in usable]
                best = int(np.argmax(worths))
                landmark, key = usable[best]
                graph.add_edge(a, b, landmark=landmark, key=key, ends=(a, b), worth=worths[best])
    return Plan(_best_route(graph, robot, seen), graph, seen)


def _readable(index: LandmarkIndex, digest: bytes) -> bool:
    """Whether the panorama is there and is one: what others publish may be anything."""
    try:
        index.features(digest)
    except VRChainError:
        return False
    return True


def worth(claim: CommonLandmark, baseline_m: float) -> float:
    """The chance to get on by a common landmark: its score, less for robots far from each other.

    baseline_m: the distance between the two robots that have it in common. Also less for a long
    way by the landmark.
    """
    if claim.ranges is None:
        return claim.score
    apart = (baseline_m / _NEIGHBOUR_M) ** 2 + sum(claim.ranges) * baseline_m / _FAR_M
    return claim.score * float(np.exp(-apart))


def _baseline_m(compared: Comparison, rig: CameraRig) -> float:
    heights = compared.geometry.baseline_heights if compared.geometry else np.nan
    return heights * rig.camera_height_m if np.isfinite(heights) else _TYPICAL_BASELINE_M


def _key(a: str, b: str, claim: CommonLandmark) -> LandmarkKey:
    # seen from b, whose panorama stands still while the driving robot's changes
    bearing = claim.b.bearing_rad if claim.b.bearing_rad is not None else 0.0
    return (a, b, round(float(np.degrees(bearing)) / 5))


def _best_route(graph: nx.Graph, robot: str, seen: Mapping[str, Sighting]) -> Route | None:
    def cost(a: str, b: str, edge: dict) -> float:
        return float(-np.log(edge["worth"])) + _LEG_COST

    distance, paths = nx.single_source_dijkstra(graph, robot, weight=cost)
    ends = {
        name: distance[name] - float(np.log(support_score(sighting.n_matches)))
        for name, sighting in seen.items()
        if name in distance
    }
    if not ends:
        return None
    last = min(ends, key=lambda name: (ends[name], len(paths[name]), name))
    path = paths[last]
    legs = tuple(_leg(graph, a, b) for a, b in pairwise(path))
    return Route(legs, last, seen[last], float(np.exp(-ends[last])))


def _leg(graph: nx.Graph, a: str, b: str) -> Leg:
    edge = graph.edges[a, b]
    landmark: CommonLandmark = edge["landmark"]
    if edge["ends"] != (a, b):  # walked against the order of comparison
        ranges = landmark.ranges[::-1] if landmark.ranges else None
        landmark = CommonLandmark(
            landmark.score,
            landmark.b,
            landmark.a,
            landmark.support_b,
            landmark.support_a,
            ranges,
        )
    return Leg(a, b, landmark, edge["key"])

"""Planning: who sees the goal, and by which chain of common landmarks to get there.

The paper's chain R1 -L12- R2 -L23- R3 - goal is a path in the landmark graph of panoramas: the one
in front of the robot and those that the others have published.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass, replace
from itertools import pairwise
from math import prod
from types import MappingProxyType

import numpy as np

from vrchain.errors import VRChainError
from vrchain.geometry import Pose
from vrchain.landmarks.matching.common import CommonLandmark, Comparison, Region
from vrchain.landmarks.retrieval.index import LandmarkIndex
from vrchain.navigation.goal.recognition import GoalSight
from vrchain.navigation.perception import Look
from vrchain.navigation.planning.comparisons import Compared
from vrchain.navigation.planning.graph import Claim, LandmarkGraph, landmark_graph
from vrchain.navigation.planning.planner import Chain
from vrchain.navigation.planning.relative_poses import Pair, RelativePoses, baseline_m
from vrchain.navigation.planning.witnesses import Find, borne_out
from vrchain.navigation.settings import Published
from vrchain.panorama import CameraRig

_FAR_M = 40.0  # a way this long by a landmark leaves 1/e of the chance to arrive
_TYPICAL_BASELINE_M = 12.0  # where too little of the ground was matched to tell
LEAST_SIGHT = 0.05  # chance that a sight is of the goal, from which it counts as one
_RIVAL = 0.5  # the goal is one thing: sights so much less sure than the surest are of others
_LEAST = 0.005  # chance to get on by a landmark, below which it is none: there are thousands
_CHECKS = 8  # times a route is drawn up anew after its relative poses were checked
_UNLIKELY = 0.5  # trust in a route, below which more is compared
_BY_ODOMETRY = 0.98  # chance to get from where a robot took a panorama to where it took the next

LandmarkKey = tuple[bytes, bytes, int]


@dataclass(frozen=True, eq=False)
class Leg:
    """Drive to ``landmark``, common to what ``seen_by`` and ``next_by`` see.

    key: names the landmark among those that failed. node: its name in the graph's picture.
    chance: that it leads on. trust: that the relative pose of the two panoramas is right.
    """

    seen_by: str
    next_by: str
    landmark: CommonLandmark
    key: LandmarkKey
    node: str
    chance: float = 1.0
    trust: float = 1.0

    @property
    def by_odometry(self) -> bool:
        """Whether no landmark leads on, but the way that the robot which saw both drove."""
        return self.landmark.a.bearing_rad is None


@dataclass(frozen=True, eq=False)
class Route:
    """A chain of legs; from the last landmark on, what ``seen_by`` saw of the goal leads home.

    score: the chance that all its landmarks are right, and got by, one after the other. trust: the
    chance that it leads to the goal at all: that its relative poses are right, and that
    ``seen_by`` shows the goal.
    """

    legs: tuple[Leg, ...]
    seen_by: str
    sighting: GoalSight
    score: float
    trust: float = 1.0

    @property
    def robots(self) -> tuple[str, ...]:
        """The robots of the chain, the driving one first."""
        return (*(leg.seen_by for leg in self.legs), self.seen_by)

    def after(self, passed: int) -> "Route":
        """The same with so many legs behind the robot, to be compared with others from here."""
        behind = prod(leg.chance for leg in self.legs[:passed])
        return replace(self, score=min(1.0, self.score / behind))


@dataclass(frozen=True, eq=False)
class Plan:
    """The best route, or None; the graph; the sights of the goal, by the panoramas that show it.

    unreadable: robots whose panorama is gone or is none. published: the panoramas that can be read,
    by name. looks: what each panorama shows, the robot's own ones too; poses: their relative poses.
    doubted: robots whose word of how they moved pictures contradict, and the share that agrees.
    """

    route: Route | None
    graph: LandmarkGraph
    goal_seen_by: Mapping[str, GoalSight]
    unreadable: tuple[str, ...]
    published: Mapping[str, Published]
    looks: Mapping[str, Look]
    poses: RelativePoses
    doubted: Mapping[str, float]

    @property
    def digests(self) -> frozenset[bytes]:
        """Of the others' panoramas that the route leads by."""
        names = self.route.robots if self.route else ()
        return frozenset(self.published[name].digest for name in names if name in self.published)

    @property
    def why_none(self) -> str:
        """Why there is no route, in plain words; empty if there is one."""
        if self.route is not None:
            return ""
        if not self.published and self.unreadable:
            return (
                f"no panorama by cameras like its own can be read, of {', '.join(self.unreadable)}"
            )
        if not self.published:
            return "the ledger holds no panorama of another robot"
        if not self.goal_seen_by:
            return "no other robot's panorama shows the goal"
        names = ", ".join(sorted(self.goal_seen_by))
        sees = "sees" if len(self.goal_seen_by) == 1 else "see"
        return f"{names} {sees} the goal, but no chain of common landmarks leads there"


def plan(
    robot: str,
    own: Sequence[tuple[Pose, Look]],
    published: Mapping[str, Published],
    index: LandmarkIndex[Look],
    find: Find,
    failed: Set[LandmarkKey] = frozenset(),
    rejected: Set[bytes] = frozenset(),
    trust: Callable[[Look, Look, Comparison], float] = lambda a, b, found: 1.0,
    lasting: Callable[[Published], float] = lambda seen: 1.0,
    alike: Callable[[Look, Look], float] = lambda a, b: 0.0,
    reputation: bool = True,
    doubted: Mapping[str, float] = MappingProxyType({}),
) -> Plan:
    """The chain with the best chance, a product over its landmarks, from ``robot`` to the goal.

    own: what the robot saw, and where it stood by odometry, the latest first; a route may begin at
    any of these. published: panoramas of others, by name. find: the goal in a look, or within a
    window around a bearing; others bear a sight out, or do not (``witnesses``). failed:
    landmarks not to use again. rejected: digests of panoramas whose sight of the goal is not to be
    trusted. trust: the chance that the relative pose of two panoramas is right; it counts for more
    where others agree, for less where they do not. lasting: the chance that a view has not changed
    since. alike: how much two look alike, where there are too many to compare them all. reputation:
    whether a robot is not believed how it moved where pictures contradict it. doubted: who was not
    believed before.
    """
    rig = own[0][1].rig
    unreadable = tuple(
        n for n in sorted(published) if not _readable(index, published[n].digest, rig)
    )
    known = {name: p for name, p in published.items() if name not in unreadable}
    panoramas = Compared(robot, own, known, index, trust, reputation, doubted)
    seen = _sights(known, panoramas.looks, find, rejected)
    panoramas.compare_likely(alike, set(_unrivalled(seen)))

    def key(claim: Claim) -> LandmarkKey:
        # seen from b, whose panorama stands still while the driving robot's changes
        bearing = claim.landmark.b.bearing_rad or 0.0
        a, b = (known[name].digest if name in known else b"" for name in (claim.a, claim.b))
        return a, b, round(float(np.degrees(bearing)) / 5) % 72

    def draw_up() -> tuple[LandmarkGraph, Route | None, dict[str, GoalSight]]:
        poses = panoramas.poses()
        sights = _unrivalled(borne_out(seen, panoramas.looks, poses, find))
        rights = {
            pair: poses.trust(pair) * min(lasting(known[name]) for name in pair if name in known)
            for pair in panoramas.found
        }
        claims = [_by_odometry(*step) for step in panoramas.steps()]
        claims += _claims(panoramas.found, rights, rig)
        claims = [claim for claim in claims if key(claim) not in failed]
        chances = {name: sighting.chance for name, sighting in sights.items()}
        graph = landmark_graph(panoramas.names, claims)
        chain = graph.planner.best(
            0, {panoramas.names.index(name): chance for name, chance in chances.items()},
            without_legs=[k for k, (_, claim) in enumerate(graph.legs) if key(claim) in failed],
        )  # fmt: skip
        route = _route(graph, chain, sights, key, panoramas) if chain else None
        return graph, route, sights

    graph, route, sights = draw_up()
    for _ in range(_CHECKS):
        legs = route.legs if route else ()
        asked = panoramas.check((leg.seen_by, leg.next_by) for leg in legs)
        if not asked and (route is None or route.trust < _UNLIKELY):
            asked = panoramas.bridge(set(sights))
        if not asked:
            break
        graph, route, sights = draw_up()
    return Plan(
        route, graph, sights, unreadable, known, panoramas.looks, panoramas.poses(),
        panoramas.doubted(),
    )  # fmt: skip


def _readable(index: LandmarkIndex[Look], digest: bytes, rig: CameraRig) -> bool:
    """Whether the panorama is there and is one like the robot's own: it may be anything."""
    try:
        return index.is_by(rig, digest) and index.look(digest).rig == rig
    except VRChainError:
        return False


def _sights(
    known: Mapping[str, Published],
    looks: Mapping[str, Look],
    find: Find,
    rejected: Set[bytes],
) -> dict[str, GoalSight]:
    """Which panoramas show the goal."""
    seen: dict[str, GoalSight] = {}
    for name, p in known.items():
        sighting = None if p.digest in rejected else find(looks[name])
        if sighting and sighting.chance >= LEAST_SIGHT:
            seen[name] = sighting
    return seen


def _unrivalled(seen: Mapping[str, GoalSight]) -> dict[str, GoalSight]:
    """The sights that are not of others, as the goal is one thing."""
    surest = max((s.chance for s in seen.values()), default=0.0)
    return {name: s for name, s in seen.items() if s.chance >= max(LEAST_SIGHT, _RIVAL * surest)}


def _claims(
    found: Mapping[Pair, Comparison], rights: Mapping[Pair, float], rig: CameraRig
) -> Iterator[Claim]:
    """What panoramas have in common, with the chance to get on by each."""
    for (a, b), comparison in found.items():
        apart_m = baseline_m(comparison, rig) or _TYPICAL_BASELINE_M
        for common in comparison.common:
            chance = rights[a, b] * worth(common, apart_m)
            if chance >= _LEAST:
                yield Claim(a, b, common, chance)


def _by_odometry(a: str, b: str) -> Claim:
    """Between two panoramas of one robot: what its odometry tells stands in for a landmark."""
    nowhere = Region(0, (0.0, 0.0, 0.0, 0.0), None, None)
    none = np.empty(0, dtype=np.int64)
    return Claim(a, b, CommonLandmark(_BY_ODOMETRY, nowhere, nowhere, none, none), _BY_ODOMETRY)


def worth(claim: CommonLandmark, baseline_m: float) -> float:
    """The chance to get on by a common landmark: its score, less for a long way by it.

    baseline_m: the distance between the two robots that have it in common.
    """
    if claim.ranges is None:
        return claim.score
    return claim.score * float(np.exp(-((sum(claim.ranges) * baseline_m / _FAR_M) ** 2)))


def _route(
    graph: LandmarkGraph,
    chain: Chain,
    seen: Mapping[str, GoalSight],
    key: Callable[[Claim], LandmarkKey],
    panoramas: Compared,
) -> Route:
    """A chain as a route, which begins at the last of the robot's own panoramas in it.

    Two that are known to see a landmark by way of others are two legs or more, by one landmark.
    """
    robots = [graph.robots[i] for i in chain.robots]
    hops = [
        (a, b, claim, f"N{landmark + 1}")
        for pair, landmark in zip(pairwise(robots), chain.landmarks, strict=True)
        for a, b, claim in graph.landmarks[landmark].path(*pair)
    ]
    begins = max(k for k, (a, *_) in enumerate(hops) if a in panoramas.own)
    poses, last = panoramas.poses(), robots[-1]
    legs = tuple(
        Leg(a, b, _seen_from(a, claim), key(claim), node, claim.score, poses.trust((a, b)))
        for a, b, claim, node in hops[begins:]
    )
    right = prod(leg.trust for leg in legs)
    return Route(legs, last, seen[last], chain.score, seen[last].chance * right)


def _seen_from(a: str, claim: Claim) -> CommonLandmark:
    """A claim's landmark, turned round where ``a`` is its second panorama."""
    own = claim.landmark
    if claim.a == a:
        return own
    ranges = own.ranges[::-1] if own.ranges else None
    return CommonLandmark(own.score, own.b, own.a, own.support_b, own.support_a, ranges)

"""The landmark graph: panoramas, landmarks, and which shows which with what score.

A claim says that a region of one panorama and one of another show the same thing. A robot's name
stands for its newest panorama; earlier ones, R2~1, R2~2, are nodes of their own. A landmark is a
connected component of claims. No landmark is twice in one panorama: a component that holds two
regions of one is split at its weakest claim until none does.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, pairwise

import networkx as nx
import numpy as np
from numpy.typing import NDArray
from scipy.cluster.hierarchy import DisjointSet

from vrchain.landmarks.matching.common import CommonLandmark, Region
from vrchain.navigation.planning.planner import Planner

_SAME_REGION = 0.5  # of what both cover together, in common: a lamp before a house is not the house


@dataclass(frozen=True, eq=False)
class Claim:
    """``landmark`` is common to the panoramas of a and b; score: in (0, 1]."""

    a: str
    b: str
    landmark: CommonLandmark
    score: float


@dataclass(frozen=True, eq=False)
class Sight:
    """How a robot sees a landmark; support: indices of the keypoints of the best claim on it."""

    region: Region
    support: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Landmark:
    """A landmark node: who sees it, in the graph's order, and the claims that say so."""

    sights: Mapping[str, Sight]
    claims: tuple[Claim, ...]

    def pairs(self) -> list[Claim]:
        """For each two that see it the best reason to think so.

        That is a claim, or the product of claims that lead from one to the other.
        """
        names = list(self.sights)
        place = {name: i for i, name in enumerate(names)}
        chance = np.eye(len(names))
        direct: dict[tuple[str, str], Claim] = {}
        for claim in sorted(self.claims, key=lambda c: c.score):
            i, j = place[claim.a], place[claim.b]
            chance[i, j] = chance[j, i] = claim.score
            direct[claim.a, claim.b] = direct[claim.b, claim.a] = claim
        for k in range(len(names)):
            chance = np.maximum(chance, np.outer(chance[:, k], chance[k]))
        found = []
        for a, b in combinations(names, 2):
            score, own = float(chance[place[a], place[b]]), direct.get((a, b))
            if own is not None and own.score >= score:
                found.append(own)
            elif score > 0:  # a product of very small scores is nothing
                one, other = self.sights[a], self.sights[b]
                joined = (one.region, other.region, one.support, other.support)
                found.append(Claim(a, b, CommonLandmark(score, *joined), score))
        return found

    def path(self, a: str, b: str) -> list[tuple[str, str, Claim]]:
        """The claims that lead from one that sees it to another, of the greatest product."""
        graph = nx.Graph()
        for claim in sorted(self.claims, key=lambda c: c.score):
            graph.add_edge(claim.a, claim.b, claim=claim, unlikely=-np.log(claim.score))
        names = nx.dijkstra_path(graph, a, b, weight="unlikely")
        return [(one, other, graph.edges[one, other]["claim"]) for one, other in pairwise(names)]


@dataclass(frozen=True, eq=False)
class LandmarkGraph:
    """Robots, and the landmarks that two or more of them see."""

    robots: tuple[str, ...]
    landmarks: tuple[Landmark, ...]

    @cached_property
    def legs(self) -> tuple[tuple[int, Claim], ...]:
        """Each leg: its landmark's index, and the claim (or product of claims) it rests on."""
        return tuple((i, c) for i, landmark in enumerate(self.landmarks) for c in landmark.pairs())

    @cached_property
    def planner(self) -> Planner:
        """Prepared for planning; robots, landmarks and legs by their index here."""
        place = {name: i for i, name in enumerate(self.robots)}
        return Planner(
            len(self.robots),
            [place[claim.a] for _, claim in self.legs],
            [place[claim.b] for _, claim in self.legs],
            [i for i, _ in self.legs],
            [claim.score for _, claim in self.legs],
        )


def landmark_graph(robots: Sequence[str], claims: Sequence[Claim]) -> LandmarkGraph:
    """The graph of what panoramas have in common; each is named like a robot."""
    surest_first = sorted(claims, key=lambda claim: -claim.score)
    numbers, owners = _numbered(
        [end for c in surest_first for end in ((c.a, c.landmark.a), (c.b, c.landmark.b))]
    )
    ends = list(zip(numbers[::2], numbers[1::2], strict=True))
    label = split_components(owners, ends)
    members: dict[int, list[int]] = {}
    for k, (u, v) in enumerate(ends):
        if label[u] == label[v]:
            members.setdefault(label[u], []).append(k)
    landmarks = []
    for chosen in members.values():
        sights: dict[str, Sight] = {}
        for claim in (surest_first[k] for k in chosen):
            seen = claim.landmark
            sights.setdefault(claim.a, Sight(seen.a, seen.support_a))
            sights.setdefault(claim.b, Sight(seen.b, seen.support_b))
        in_order = {name: sights[name] for name in robots if name in sights}
        landmarks.append(Landmark(in_order, tuple(surest_first[k] for k in chosen)))
    return LandmarkGraph(tuple(robots), tuple(landmarks))


def split_components(
    panorama: Sequence[object], surest_first: Sequence[tuple[int, int]]
) -> list[int]:
    """The landmark, a number, that each region belongs to.

    panorama: of each region, which panorama it is in; surest_first: claims as pairs of regions, the
    strongest first. Joining regions strongest claim first, and refusing what would put two regions
    of one panorama together, is the same as splitting whole components at their weakest claims:
    what a refused claim would have joined, no weaker claim may join to anything.
    """
    regions = range(len(panorama))
    linked, joined = DisjointSet(regions), DisjointSet(regions)  # by all claims, by those kept
    inside: list[set[object] | None] = [{p} for p in panorama]  # by root; None: it is split
    for u, v in surest_first:
        mine, other = inside[linked[u]], inside[linked[v]]
        if not linked.merge(u, v):
            continue
        if mine is None or other is None or not mine.isdisjoint(other):
            inside[linked[u]] = None
        else:
            inside[linked[u]] = mine | other
            joined.merge(u, v)
    return [joined[i] for i in regions]


def _numbered(seen: Sequence[tuple[str, Region]]) -> tuple[list[int], list[str]]:
    """The number of each region, one for those of a panorama on much the same bearings, and whose.

    The first of them stands for the others.
    """
    of_robot: dict[str, list[int]] = {}
    for k, (robot, _) in enumerate(seen):
        of_robot.setdefault(robot, []).append(k)
    founder = np.arange(len(seen))
    for own in of_robot.values():
        same = _same([seen[k][1] for k in own])
        left = np.ones(len(own), dtype=bool)
        for i, k in enumerate(own):
            if left[i]:
                members = np.flatnonzero(left & same[i])
                founder[np.array(own)[members]] = k
                left[members] = False
    founders, number = np.unique(founder, return_inverse=True)
    return number.tolist(), [seen[k][0] for k in founders]


def _same(regions: Sequence[Region]) -> NDArray[np.bool_]:
    """Which regions of one panorama have half of the bearings they cover in common: (n, n)."""
    nowhere = [r.bearing_rad is None for r in regions]
    bearing = np.array([r.bearing_rad or 0.0 for r in regions])
    width = np.array([r.angular_size_rad or 0.0 for r in regions])
    both = width[:, None] + width
    apart = np.abs(bearing[:, None] - bearing) % (2 * np.pi)
    apart = np.minimum(apart, 2 * np.pi - apart)
    common = np.minimum(both / 2 - apart, np.minimum(width[:, None], width))
    same = common >= _SAME_REGION * (both - common)
    same[nowhere] = same[:, nowhere] = False
    return same | np.eye(len(regions), dtype=bool)

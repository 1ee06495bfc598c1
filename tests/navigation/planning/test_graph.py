"""The landmark graph: components of claims, split where a panorama would show a landmark twice."""

from itertools import combinations

import networkx as nx
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from vrchain.landmarks.matching.common import CommonLandmark, Region
from vrchain.navigation.planning.graph import Claim, landmark_graph, split_components
from vrchain.seeding import generator


def region(bearing_rad: float, width_rad: float = 0.1) -> Region:
    return Region(0, (0.0, 0.0, 9.0, 9.0), bearing_rad, width_rad)


def claim(a: str, at_a: float | Region, b: str, at_b: float | Region, score: float = 0.9) -> Claim:
    ends = (end if isinstance(end, Region) else region(end) for end in (at_a, at_b))
    return Claim(a, b, CommonLandmark(score, *ends, np.arange(5), np.arange(5)), score)


def seen_by(robots: str, claims: list[Claim]) -> list[set[str]]:
    """Who sees each landmark."""
    graph = landmark_graph(robots.split(), claims)
    return [set(landmark.sights) for landmark in graph.landmarks]


def split_literally(
    panorama: list[int], surest_first: list[tuple[int, int]]
) -> set[frozenset[int]]:
    """As it is defined: the weakest claim goes until no component shows one panorama twice."""
    graph = nx.Graph()
    graph.add_nodes_from(range(len(panorama)))
    for rank, (u, v) in enumerate(surest_first):
        if not graph.has_edge(u, v):
            graph.add_edge(u, v, rank=rank)
    done: set[frozenset[int]] = set()
    todo = [frozenset(part) for part in nx.connected_components(graph)]
    while todo:
        part = todo.pop()
        if len({panorama[i] for i in part}) == len(part):
            done.add(part)
            continue
        inside = nx.Graph(graph.subgraph(part))
        while nx.is_connected(inside):
            inside.remove_edge(*max(inside.edges, key=lambda e: inside.edges[e]["rank"]))
        graph = nx.compose(graph.subgraph(set(graph) - part), inside)
        todo += [frozenset(p) for p in nx.connected_components(inside)]
    return done


@given(st.integers(0, 100_000), st.integers(2, 6), st.integers(1, 4), st.floats(0.05, 0.7))
def test_components_are_split_as_they_are_defined(
    seed: int, panoramas: int, regions: int, density: float
) -> None:
    draws = generator(seed, "claims")
    panorama = [p for p in range(panoramas) for _ in range(regions)]
    pairs = [
        (u, v)
        for u, v in combinations(range(len(panorama)), 2)
        if panorama[u] != panorama[v] and draws.uniform() < density
    ]
    surest_first = [pairs[i] for i in draws.permutation(len(pairs))]
    label = split_components(panorama, surest_first)
    parts: dict[int, set[int]] = {}
    for i, name in enumerate(label):
        parts.setdefault(name, set()).add(i)
    assert {frozenset(part) for part in parts.values()} == split_literally(panorama, surest_first)


def test_a_landmark_is_what_claims_join() -> None:
    chained = [claim("A", 0.0, "B", 1.0), claim("B", 1.02, "C", 2.0), claim("A", 2.0, "C", -2.0)]
    assert seen_by("A B C", chained) == [{"A", "B", "C"}, {"A", "C"}]


def test_the_weakest_claim_gives_way() -> None:
    """Two trees of A, said to be one tree of C: the weaker claim was wrong."""
    claims = [
        claim("A", 0.0, "B", 1.0, 0.9),
        claim("B", 1.0, "C", 2.0, 0.8),
        claim("C", 2.0, "A", 0.5, 0.6),
        claim("A", 0.5, "D", 0.0, 0.7),
    ]
    assert seen_by("A B C D", claims) == [{"A", "B", "C"}, {"A", "D"}]


def test_a_lamp_before_a_house_is_not_the_house() -> None:
    house, lamp = region(0.0, 0.6), region(0.1, 0.04)
    claims = [claim("A", house, "B", 1.0), claim("A", lamp, "C", 2.0)]
    assert seen_by("A B C", claims) == [{"A", "B"}, {"A", "C"}]
    across = [claim("A", region(np.pi), "B", 1.0), claim("A", region(-np.pi + 0.01), "C", 2.0)]
    assert seen_by("A B C", across) == [{"A", "B", "C"}]


def test_without_bearings_every_region_is_its_own() -> None:
    blind = [Region(0, (0.0, 0.0, 9.0, 9.0), None, None) for _ in range(4)]
    claims = [claim("A", blind[0], "B", blind[1]), claim("A", blind[2], "C", blind[3])]
    assert seen_by("A B C", claims) == [{"A", "B"}, {"A", "C"}]


def test_legs_rest_on_the_best_reason() -> None:
    weak, strong = claim("A", 0.0, "C", 2.0, 0.5), claim("A", 0.0, "B", 1.0, 0.9)
    graph = landmark_graph(["A", "B", "C"], [weak, strong, claim("B", 1.0, "C", 2.0, 0.8)])
    legs = {(leg.a, leg.b): leg for _, leg in graph.legs}
    assert legs["A", "B"] is strong
    assert np.isclose(legs["A", "C"].score, 0.72)  # by way of B
    graph = landmark_graph(["A", "B", "C"], [weak, strong])
    assert next(leg for _, leg in graph.legs if (leg.a, leg.b) == ("A", "C")) is weak
    hopeless = [claim("A", 0.0, "B", 1.0, 1e-300), claim("B", 1.0, "C", 2.0, 1e-300)]
    assert len(landmark_graph(["A", "B", "C"], hopeless).legs) == 2


def test_an_empty_ledger() -> None:
    graph = landmark_graph(["A"], [])
    assert graph.legs == () and graph.landmarks == () and graph.planner.best(0, {}) is None

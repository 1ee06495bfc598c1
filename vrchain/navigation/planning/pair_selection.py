"""Which panoramas are compared with which: all of them with all would take too long."""

from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from itertools import combinations

import networkx as nx

from vrchain.navigation.settings import robot_of

_FEW = 6  # panoramas: of no more, each two are compared
_PARTNERS, _NEXT = 4, 2  # of more, each with so many of others, most alike, and its robot's next
_JOINED = 0.5  # trust in a relative pose from which two panoramas hang together


def partners(
    names: Sequence[str], most_alike_first: Sequence[tuple[str, str]]
) -> list[tuple[str, str]]:
    """Those that are compared anyway: all of few; of many, what robots saw in succession, and
    panoramas of different robots that look alike. names: each robot's in their order.
    """
    if len(names) <= _FEW:
        return list(combinations(names, 2))
    chosen: set[tuple[str, str]] = set()
    earlier: dict[str, list[str]] = {}
    for name in names:
        own = earlier.setdefault(robot_of(name), [])
        chosen.update((before, name) for before in own[-_NEXT:])
        own.append(name)
    rank = dict.fromkeys(names, 0)
    for a, b in most_alike_first:
        if robot_of(a) != robot_of(b):
            if min(rank[a], rank[b]) < _PARTNERS:
                chosen.add((a, b))
            rank[a], rank[b] = rank[a] + 1, rank[b] + 1
    return [pair for pair in combinations(names, 2) if pair in chosen]


def bridges(
    names: Sequence[str],
    left: Iterable[tuple[str, str]],
    rights: Mapping[tuple[str, str], float],
    own: Set[str],
    seers: Set[str],
) -> Iterator[tuple[str, str]]:
    """Pairs that may join the robot's part of the graph, or the goal's, to another; till it is one.

    left: pairs not compared yet, the most promising first; rights: the trust in each that was, to
    which what is learned of the pairs that come from here is added meanwhile.
    """
    graph = nx.Graph()
    graph.add_nodes_from(names)
    nx.add_path(graph, [name for name in names if name in own])
    graph.add_edges_from(pair for pair, right in rights.items() if right >= _JOINED)

    def parts() -> tuple[dict[str, int], set[int], set[int]]:
        hanging = enumerate(nx.connected_components(graph))
        part = {name: k for k, together in hanging for name in together}
        return part, {part[name] for name in own}, {part[name] for name in seers}

    waiting, tried = list(left), 0
    part, here, there = parts()
    while not here & there and tried < len(waiting):
        a, b = waiting[tried]
        ends = {part[a], part[b]}
        if len(ends) == 1 or not ends & (here | there):
            tried += 1
            continue
        yield waiting.pop(tried)
        if rights[a, b] >= _JOINED:
            graph.add_edge(a, b)
            part, here, there = parts()
            tried = 0  # what touched neither may do so now

"""Planning on arrays: of thousands of legs, the chain of landmarks with the best chance to arrive.

A *leg* leads from one robot's place to another's by a landmark that both see, either way. The
arrays are prepared once for a ledger's head; each question is then answered by Dijkstra's search
(Numer. Math. 1, 1959) over the best usable leg of each pair of robots.
"""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from heapq import heappop, heappush

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vrchain.errors import VRChainError

# A cost is one integer: the logarithm of the chance in its high bits, the number of legs in its low
# ones. So a tie is a tie, and goes to the chain with fewer legs.
_LOG_UNIT = 1e-9
_LEGS_BITS = 16
_NOWHERE = 1 << 200


class PlanningError(VRChainError):
    """What was given is no graph: a score is no probability, or there is no such robot."""


@dataclass(frozen=True)
class Chain:
    """R1 -L12- R2 -L23- R3 - goal: robots[i] and robots[i + 1] both see landmarks[i].

    robots, (k + 1,), the first where it starts, the last sees the goal; landmarks and legs, (k,),
    legs as indices into what the planner was given. score: product over legs and goal.
    """

    robots: tuple[int, ...]
    landmarks: tuple[int, ...]
    legs: tuple[int, ...]
    score: float


class Planner:
    """The legs of one graph, prepared.

    a, b: (m,) robots at the ends of each leg, 0 to n_robots - 1; landmark: (m,) by which it leads;
    score: (m,) its chance, in (0, 1]. Raises PlanningError otherwise.
    """

    def __init__(
        self, n_robots: int, a: ArrayLike, b: ArrayLike, landmark: ArrayLike, score: ArrayLike
    ) -> None:
        ends = np.sort(np.array([a, b], dtype=np.int64).reshape(2, -1), axis=0)
        self.n_robots = n_robots
        self.landmark = np.asarray(landmark, dtype=np.int64)
        self.score = np.asarray(score, dtype=float)
        if not ends.shape[1] == len(self.landmark) == len(self.score):
            lengths = f"{ends.shape[1]}, {len(self.landmark)}, {len(self.score)}"
            raise PlanningError(f"expected as many robots as landmarks and scores, got {lengths}")
        if ends.size and (ends.min() < 0 or ends.max() >= n_robots):
            raise PlanningError(f"expected robots 0 to {n_robots - 1}, got {ends.ravel()}")
        cost = (_log_cost(self.score) << _LEGS_BITS) + 1
        # by pair, the best leg first
        self._order = np.lexsort((self.landmark, cost, ends[1], ends[0]))
        self._cost = cost[self._order]
        pair = (ends[0] * n_robots + ends[1])[self._order]
        starts = np.flatnonzero(np.diff(pair, prepend=-1, append=-1))
        self._rest = dict(  # the best leg of each pair -> where its others are in that order
            zip(
                self._order[starts[:-1]].tolist(),
                zip((starts[:-1] + 1).tolist(), starts[1:].tolist(), strict=True),
                strict=True,
            )
        )
        self._by_landmark = np.argsort(self.landmark, kind="stable")
        self._landmarks = self.landmark[self._by_landmark]
        self._steps: list[list[tuple[int, int, int]]] = [[] for _ in range(n_robots)]
        best = self._order[starts[:-1]]
        for x, y, step, leg in zip(
            *ends[:, best].tolist(), cost[best].tolist(), best.tolist(), strict=True
        ):
            self._steps[x].append((step, y, leg))
            self._steps[y].append((step, x, leg))

    def best(
        self,
        start: int,
        goal: Mapping[int, float],
        without_landmarks: Collection[int] = (),
        without_legs: Collection[int] = (),
    ) -> Chain | None:
        """The chain with the greatest product of scores, of equal ones that with fewest legs.

        goal: the robots that see it, each with the chance that it is reached from there. None if
        no chain leads to one of them.
        """
        for robot in (start, *goal):
            if not 0 <= robot < self.n_robots:
                raise PlanningError(f"expected a robot of 0 to {self.n_robots - 1}, got {robot}")
        steps = self._steps
        instead = self._next_best(without_landmarks, without_legs)
        scores = np.array([*goal.values()], dtype=float)
        ends = dict(zip(goal, (_log_cost(scores) << _LEGS_BITS).tolist(), strict=True))
        reached, came = [_NOWHERE] * self.n_robots, [(-1, -1)] * self.n_robots
        last, cheapest = -1, _NOWHERE
        reached[start] = 0
        heap = [(0, start)]
        while heap:
            cost, robot = heappop(heap)
            if cost >= cheapest:
                break
            if cost > reached[robot]:
                continue
            if robot in ends and cost + ends[robot] < cheapest:
                last, cheapest = robot, cost + ends[robot]
            for step, other, leg in steps[robot]:
                if leg in instead:
                    step, leg = instead[leg]
                if cost + step < reached[other]:
                    reached[other], came[other] = cost + step, (robot, leg)
                    heappush(heap, (cost + step, other))
        if last < 0:
            return None
        robots, legs = [last], []
        while robots[-1] != start:
            before, leg = came[robots[-1]]
            robots.append(before)
            legs.append(leg)
        legs.reverse()
        score = float(np.prod(self.score[legs])) * goal[last]
        landmarks = tuple(self.landmark[legs].tolist())
        return Chain(tuple(reversed(robots)), landmarks, tuple(legs), score)

    def routes(
        self,
        start: int,
        goal: Mapping[int, float],
        k: int,
        without_landmarks: Collection[int] = (),
        without_legs: Collection[int] = (),
    ) -> list[Chain]:
        """The best chain and the next best, k at most, no landmark in two of them."""
        used, goal = set(without_landmarks), dict(goal)
        found: list[Chain] = []
        while len(found) < k:
            chain = self.best(start, goal, used, without_legs)
            if chain is None:
                break
            found.append(chain)
            used.update(chain.landmarks)
            if not chain.landmarks:  # it sees the goal from where it stands
                del goal[chain.robots[-1]]
        return found

    def _next_best(
        self, without_landmarks: Collection[int], without_legs: Collection[int]
    ) -> dict[int, tuple[int, int]]:
        """For each excluded leg that is the best of its pair: cost and leg to take instead."""
        excluded = set(without_legs)
        if without_landmarks:
            chosen = np.array(sorted(without_landmarks))
            low = np.searchsorted(self._landmarks, chosen, "left")
            high = np.searchsorted(self._landmarks, chosen, "right")
            for i, j in zip(low, high, strict=True):
                excluded.update(self._by_landmark[i:j].tolist())
        instead = {}
        for leg in excluded & self._rest.keys():
            usable = (
                (int(self._cost[k]), other)
                for k in range(*self._rest[leg])
                if (other := int(self._order[k])) not in excluded
            )
            instead[leg] = next(usable, (_NOWHERE, leg))
        return instead


def _log_cost(score: NDArray[np.float64]) -> NDArray[np.int64]:
    """Minus the logarithm of chances, in units of 1e-9."""
    bad = score[~((score > 0) & (score <= 1))]
    if len(bad):
        raise PlanningError(f"expected scores over 0 and up to 1, got {bad[0]}")
    return np.rint(-np.log(score) / _LOG_UNIT).astype(np.int64)

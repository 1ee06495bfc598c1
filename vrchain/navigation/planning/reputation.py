"""How far each robot's word is to be trusted, by the ledger alone.

Pictures speak for themselves: who reads them compares them itself. Only how a robot says it moved
between its panoramas is taken on trust. Where two panoramas of one robot were joined to panoramas
of another, two ways lead round: if they agree, which is no chance, all four words are right; if
they do not, a robot lied, or a join is wrong. Whom others agree with is believed, and whom nobody
does is not. Every disagreement counts against both robots, but less, the less the other is
believed, until nothing changes (as in HITS; Kleinberg, 1999).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vrchain.geometry import Pose, relative, wrap_angle_rad
from vrchain.navigation.planning.odometry_links import HOLDS_M, Track
from vrchain.navigation.planning.relative_poses import (
    DIFFERENT,
    ORIGIN,
    SURE,
    Pair,
    RelativePose,
    off,
)
from vrchain.navigation.settings import robot_of

Counts = NDArray[np.integer]

EVEN = 0.5  # share of agreement from which a robot's word is taken as it is
_BELIEVED = 4.0  # agreements that a robot is credited with: one mistake convicts nobody
_ROUNDS = 10
_LEAST_M = 2.0  # between the two panoramas of a robot, or its word says nothing


def reputations(poses: Mapping[Pair, RelativePose], tracks: Sequence[Track]) -> dict[str, float]:
    """The share of agreement with each robot, 0 to 1, by its name; 1 where nothing speaks.

    poses: of panoramas that were compared; tracks: each robot's own, by its odometry. A robot's
    agreements and disagreements are counted by panoramas of its own, not by pairs.
    """
    votes = _votes(poses, tracks)
    robots = {robot_of(name) for track in tracks for name, _ in track}
    trusted = dict.fromkeys(robots, 1.0)
    for _ in range(_ROUNDS):
        trusted = {robot: _share(robot, votes, trusted) for robot in robots}
    return trusted


def _share(
    robot: str, votes: Mapping[tuple[str, str], tuple[int, int]], trusted: Mapping[str, float]
) -> float:
    agreed, denied = _BELIEVED, 0.0
    for (one, other), (right, wrong) in votes.items():
        if one == robot:
            agreed += right
            denied += wrong * trusted[other]
    return agreed / (agreed + denied)


def _votes(
    poses: Mapping[Pair, RelativePose], tracks: Sequence[Track]
) -> dict[tuple[str, str], tuple[int, int]]:
    """Of each robot and each other one: its panoramas that mostly agree, and the others."""
    place = {name: (k, pose) for k, track in enumerate(tracks) for name, pose in track}
    joins: dict[tuple[int, int], list[tuple[str, str, Pose]]] = {}
    for (a, b), known in poses.items():
        if known.pose is None or known.trust < SURE or not {a, b} <= place.keys():
            continue
        one, other = place[a][0], place[b][0]
        if one < other:
            joins.setdefault((one, other), []).append((a, b, known.pose))
        elif other < one:
            joins.setdefault((other, one), []).append((b, a, relative(known.pose, ORIGIN)))
    found: dict[tuple[str, str], tuple[int, int]] = {}
    for between in joins.values():
        names_a, names_b, told = zip(*between, strict=True)
        mine, yours = (
            _Ways.of([place[name][1] for name in names]).to_each() for names in (names_a, names_b)
        )
        joined = _Ways.of(told)
        off = joined.each(0).then(yours).apart(mine.then(joined.each(1)))
        clear = (np.maximum(abs(mine.to), abs(yours.to)) <= HOLDS_M) & ~(
            (off > 1.0) & (off <= DIFFERENT)
        )
        for names, partner, way in ((names_a, names_b[0], mine), (names_b, names_a[0], yours)):
            tried = clear & (abs(way.to) >= _LEAST_M)  # else only the other's word is
            heard = _heard(names, tried.sum(axis=1), (tried & (off <= 1.0)).sum(axis=1))
            pair = robot_of(names[0]), robot_of(partner)
            before = found.get(pair, (0, 0))
            found[pair] = before[0] + heard[0], before[1] + heard[1]
    return found


def _heard(names: Sequence[str], tried: Counts, agreed: Counts) -> tuple[int, int]:
    """How many panoramas mostly agree, and mostly do not, of the joins of each.

    One of those that do not may have been joined wrongly, and so put all others off.
    """
    _, own = np.unique(names, return_inverse=True)
    heard, right = np.bincount(own, tried), np.bincount(own, agreed)
    agree = int(((heard > 0) & (2 * right >= heard)).sum())
    return agree, max(0, int((heard > 0).sum()) - agree - 1)


@dataclass(frozen=True, eq=False)
class _Ways:
    """Poses on the plane, of any shape: where to, as complex metres, and the turn in radians."""

    to: NDArray[np.complex128]
    turn: NDArray[np.float64]

    @classmethod
    def of(cls, poses: Sequence[Pose]) -> "_Ways":
        x_m, y_m, yaw_rad = np.array([(p.x_m, p.y_m, p.yaw_rad) for p in poses]).T
        return cls(x_m + 1j * y_m, yaw_rad)

    def each(self, axis: int) -> "_Ways":
        """Each in all columns (0), or in all rows (1)."""
        return _Ways(np.expand_dims(self.to, 1 - axis), np.expand_dims(self.turn, 1 - axis))

    def to_each(self) -> "_Ways":
        """From each (rows) to each (columns)."""
        here, there = self.each(0), self.each(1)
        return _Ways((there.to - here.to) * np.exp(-1j * here.turn), there.turn - here.turn)

    def then(self, onward: "_Ways") -> "_Ways":
        return _Ways(self.to + onward.to * np.exp(1j * self.turn), self.turn + onward.turn)

    def apart(self, other: "_Ways") -> NDArray[np.float64]:
        """As ``relative_poses.apart``."""
        ways_m = np.maximum(abs(self.to), abs(other.to))
        turned = abs(wrap_angle_rad(self.turn - other.turn))
        return np.asarray(off(abs(self.to - other.to), ways_m, turned))

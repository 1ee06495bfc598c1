"""How far each robot's word is to be trusted, by the ledger alone.

Pictures speak for themselves: who reads them compares them itself. Only how a robot says it moved
between its panoramas is taken on trust. Where two panoramas of one robot were joined to panoramas
of another, two ways lead round: if they agree, which is no chance, all four words are right; if
they do not, a robot lied, or a join is wrong. Whom others agree with is believed, and whom nobody
does is not. Every disagreement counts against both robots, but less, the less the other is
believed, until nothing changes (as in HITS; Kleinberg, 1999).
"""

from collections.abc import Mapping, Sequence
from itertools import combinations

import numpy as np

from vrchain.geometry import Pose, placed, relative
from vrchain.navigation.planning.odometry_links import HOLDS_M, Track
from vrchain.navigation.planning.relative_poses import (
    DIFFERENT,
    ORIGIN,
    SURE,
    Pair,
    RelativePose,
    apart,
)
from vrchain.navigation.settings import robot_of

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
        if place[a][0] > place[b][0]:
            a, b, known = b, a, RelativePose(relative(known.pose, ORIGIN), known.trust)
        if place[a][0] != place[b][0] and known.pose is not None:
            joins.setdefault((place[a][0], place[b][0]), []).append((a, b, known.pose))
    said: dict[tuple[str, str], dict[str, list[bool]]] = {}
    for between in joins.values():
        for (a, b, pose), (c, d, other) in combinations(between, 2):
            mine, yours = relative(place[a][1], place[c][1]), relative(place[b][1], place[d][1])
            ways_m = [float(np.hypot(*way.xy_m)) for way in (mine, yours)]
            off = apart(placed(pose, yours), placed(mine, other))
            if max(ways_m) > HOLDS_M or 1.0 < off <= DIFFERENT:
                continue
            for names, partner, way_m in (((a, c), b, ways_m[0]), ((b, d), a, ways_m[1])):
                if way_m < _LEAST_M:  # only the other's word is tried
                    continue
                heard = said.setdefault((robot_of(names[0]), robot_of(partner)), {})
                for name in names:
                    heard.setdefault(name, []).append(off <= 1.0)
    agreed = {pair: sum(map(_mostly, heard.values())) for pair, heard in said.items()}
    # One of those that disagree may have been joined wrongly, and so put all others off.
    return {
        pair: (agreed[pair], max(0, len(heard) - agreed[pair] - 1)) for pair, heard in said.items()
    }


def _mostly(heard: Sequence[bool]) -> bool:
    return 2 * sum(heard) >= len(heard)

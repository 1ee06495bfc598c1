"""How far each robot's word is to be trusted, by the ledger alone.

Pictures speak for themselves: who reads them compares them itself. Only how a robot says it moved
between its panoramas is taken on trust. Where one panorama, of whomever, was joined to two of a
robot's, those two joins tell how it moved, by pictures alone: it agrees with what the robot says,
or the robot lied, or a join is wrong. Nobody else's word is asked, so no liar takes others along.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np

from vrchain.geometry import Pose, relative
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
_BELIEVED = 1.0  # agreements that a robot is credited with
_LEAST_M = 2.0  # between the two panoramas of a robot, or its word says nothing


def reputations(poses: Mapping[Pair, RelativePose], tracks: Sequence[Track]) -> dict[str, float]:
    """The share of agreement with each robot, 0 to 1, by its name; 1 where nothing speaks.

    poses: of panoramas that were compared; tracks: each robot's own, by its odometry. Counted are a
    robot's panoramas of which most that is told agrees, and those of which most does not, but for
    one: it may have been joined wrongly, so one mistake convicts nobody.
    """
    heard, agreed = Counter[str](), Counter[str]()
    for a, b, agree in _tests(poses, tracks):
        heard.update((a, b))
        if agree:
            agreed.update((a, b))
    found = {}
    for robot in {robot_of(name) for track in tracks for name, _ in track}:
        own = [name for name in heard if robot_of(name) == robot]
        right = sum(2 * agreed[name] >= heard[name] for name in own)
        wrong = max(0, len(own) - right - 1)
        found[robot] = (_BELIEVED + right) / (_BELIEVED + right + wrong)
    return found


def _tests(
    poses: Mapping[Pair, RelativePose], tracks: Sequence[Track]
) -> Iterator[tuple[str, str, bool]]:
    """Two panoramas of a robot that another panorama knows, and whether it agrees on the way."""
    place = {name: (k, pose) for k, track in enumerate(tracks) for name, pose in track}
    seen: dict[tuple[str, int], list[tuple[str, Pose]]] = {}  # by the other panorama, and the track
    for (a, b), known in poses.items():
        if known.pose is None or known.trust < SURE:
            continue
        for one, other, pose in ((a, b, known.pose), (b, a, relative(known.pose, ORIGIN))):
            if other in place and robot_of(one) != robot_of(other):
                seen.setdefault((one, place[other][0]), []).append((other, pose))
    for joined in seen.values():
        for (a, from_a), (b, from_b) in combinations(joined, 2):
            told, said = relative(from_a, from_b), relative(place[a][1], place[b][1])
            differs = apart(told, said)
            if _LEAST_M <= np.hypot(*said.xy_m) <= HOLDS_M and not 1.0 < differs <= DIFFERENT:
                yield a, b, differs <= 1.0

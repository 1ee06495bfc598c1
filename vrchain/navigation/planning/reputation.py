"""How far each robot's word is to be trusted, by the ledger alone.

Pictures speak for themselves: who reads their records compares them itself. How a robot says that
it moved between its panoramas is taken on trust. Where one panorama, of whomever, was joined to two
of a robot's, those two joins tell how it moved, by pictures alone: it agrees with what the robot
says, or the robot lied, or a join is wrong. Nobody else's word is asked, so no liar takes others
along. What is tested is what is followed: every link of its odometry.
"""

from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from itertools import permutations

import numpy as np

from vrchain.geometry import Pose, relative
from vrchain.navigation.planning.odometry_links import Track, links
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
_LEAST_M = 2.0  # of way, by a robot's word or by pictures: below, both say nothing


def reputations(poses: Mapping[Pair, RelativePose], tracks: Sequence[Track]) -> dict[str, float]:
    """The share of agreement with each robot, 0 to 1, by its name; 1 where nothing speaks.

    poses: of panoramas that were compared; tracks: each robot's own, by its odometry. Counted are a
    robot's panoramas of which most that is told agrees, and those of which most does not. Whatever
    one panorama alone tells against a robot is forgiven: it may have been joined wrongly, or be
    forged, so one mistake convicts nobody.
    """
    heard = defaultdict[tuple[str, str], Counter[str]](Counter)  # a robot's panoramas, by witness
    agreed = defaultdict[tuple[str, str], Counter[str]](Counter)
    for witness, a, b, agree in _tests(poses, tracks):
        heard[robot_of(a), witness].update((a, b))
        if agree:
            agreed[robot_of(a), witness].update((a, b))
    found = {}
    for robot in {robot_of(name) for track in tracks for name, _ in track}:
        own = [key for key in heard if key[0] == robot]
        in_all, in_all_agreed = (sum((by[key] for key in own), Counter()) for by in (heard, agreed))
        found[robot] = max(
            [_share(in_all, in_all_agreed)]
            + [_share(in_all - heard[key], in_all_agreed - agreed[key]) for key in own]
        )
    return found


def _share(heard: Counter[str], agreed: Counter[str]) -> float:
    right = sum(2 * agreed[name] >= count for name, count in heard.items())
    return (_BELIEVED + right) / (_BELIEVED + len(heard))


def _tests(
    poses: Mapping[Pair, RelativePose], tracks: Sequence[Track]
) -> Iterator[tuple[str, str, str, bool]]:
    """A panorama, two of a robot that it knows and odometry links, and whether they agree."""
    place = {name: k for k, track in enumerate(tracks) for name, _ in track}
    linked = {(a, b): said for track in tracks for a, b, said in links(track)}
    seen: dict[tuple[str, int], list[tuple[str, Pose]]] = {}  # by the other panorama, and the track
    for (a, b), known in poses.items():
        if known.pose is None or known.trust < SURE:
            continue
        for one, other, pose in ((a, b, known.pose), (b, a, relative(known.pose, ORIGIN))):
            if other in place and robot_of(one) != robot_of(other):
                seen.setdefault((one, place[other]), []).append((other, pose))
    for (one, _), joined in seen.items():
        for (a, from_a), (b, from_b) in permutations(joined, 2):
            if (said := linked.get((a, b))) is None:
                continue
            told = relative(from_a, from_b)
            moved = max(np.hypot(*said.xy_m), np.hypot(*told.xy_m)) >= _LEAST_M
            differs = apart(told, said)
            if moved and not 1.0 < differs <= DIFFERENT:
                yield one, a, b, differs <= 1.0

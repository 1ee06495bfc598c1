"""How far each robot's word is to be trusted, by the ledger alone.

Pictures speak for themselves: who reads their records compares them itself. How a robot says that
it moved between its panoramas is taken on trust. Where one panorama, of whomever, was joined to two
of a robot's, those two joins tell how it moved, by pictures alone: it agrees with what the robot
says, or the robot lied, or a join is wrong. Nobody else's word is asked, so no liar takes others
along. A link that is denied is not followed, whatever the robot's name: who lies now and then keeps
its name.
"""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
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
_BELIEVED = 1  # agreements that a robot is credited with
# Of 300 tests of honest robots 11 are vague; of one that says 2.5 times its way hardly any is not.
_VAGUE = 2  # tests between agreement and denial that count as one denial
_LEAST_M = 2.0  # of way, by a robot's word or by pictures: below, both say nothing


def reputations(
    poses: Mapping[Pair, RelativePose], tracks: Sequence[Track]
) -> tuple[dict[str, float], set[Pair]]:
    """The share of agreement with each robot, 0 to 1, by its name; 1 where nothing speaks. And the
    odometry links, an earlier panorama and a later, that two more panoramas deny than confirm.

    poses: of panoramas that were compared; tracks: each robot's own, by its odometry. Counted are a
    robot's panoramas of which most that others tell agrees, and those of which most does not; of
    each, all panoramas of one other robot have one vote, so that many forged ones weigh no more
    than one. Whatever one panorama alone tells against a robot is forgiven: it may have been joined
    wrongly, or be forged, so one mistake convicts nobody. What is between agreement and denial
    denies only where it is the most by far: who says twice its way is hardly ever denied outright.
    """
    # of each robot, by its panorama and by witness: how often one agrees with it, and how often not
    told = defaultdict[str, dict[str, dict[str, Counter[int]]]](lambda: defaultdict(dict))
    says = Counter[Pair]()
    for witness, a, b, differs in _tests(poses, tracks):
        verdict = (differs <= 1.0) - (differs > DIFFERENT)
        says[a, b] += verdict
        for name in (a, b):
            told[robot_of(a)][name].setdefault(witness, Counter())[verdict] += 1
    found = dict.fromkeys((robot_of(name) for track in tracks for name, _ in track), 1.0)
    for robot, own in told.items():
        # to leave out who does nothing but agree makes no share larger
        against = {w for by in own.values() for w, said in by.items() if said[-1] + said[0]}
        found[robot] = max(_share(own.values(), witness) for witness in ("", *against))
    return found, {pair for pair, more in says.items() if more < -1}


def _share(told: Iterable[Mapping[str, Counter[int]]], forgiven: str) -> float:
    """Of the panoramas that something is told of; what one witness tells is left out."""
    counts = [1] * _BELIEVED
    for by in told:
        votes = defaultdict[str, Counter[int]](Counter)
        for witness, says in by.items():
            if witness != forgiven:
                votes[robot_of(witness)] += says
        against = ((says, says[-1] + says[0] // _VAGUE) for says in votes.values())
        agree = [says[1] >= other for says, other in against if says[1] + other]
        counts += [2 * sum(agree) >= len(agree)] if agree else []
    return sum(counts) / len(counts)


def _tests(
    poses: Mapping[Pair, RelativePose], tracks: Sequence[Track]
) -> Iterator[tuple[str, str, str, float]]:
    """A panorama, two of a robot that it knows and odometry links, and by how much they differ."""
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
            if max(np.hypot(*said.xy_m), np.hypot(*told.xy_m)) >= _LEAST_M:
                yield one, a, b, apart(told, said)

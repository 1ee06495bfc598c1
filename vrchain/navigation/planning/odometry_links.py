"""Odometry links: how robots moved from panorama to panorama, by what they published of it.

A publisher tells, signed, how it moved since its panorama before. So the panoramas of one robot
need no common landmark to hang together, and where it drove another can drive.
"""

from collections.abc import Iterator, Mapping, Set
from itertools import combinations, pairwise

from vrchain.geometry import Pose, placed, relative
from vrchain.navigation.perception import Look
from vrchain.navigation.settings import Published, age_of, robot_of

HOLDS_M = 50.0  # of way, after which odometry alone tells no relative pose any more

Track = tuple[tuple[str, Pose], ...]


def tracks(known: Mapping[str, Published], looks: Mapping[str, Look]) -> list[Track]:
    """Each robot's panoramas in succession, oldest first, in the frame of the first of them.

    Where nothing tells how a robot moved, or a panorama is missing, another track begins.
    """
    found: list[list[tuple[str, Pose]]] = []
    for name in sorted(known, key=lambda name: (robot_of(name), -age_of(name))):
        before, here = found[-1][-1] if found else ("", Pose(0.0, 0.0))
        moved: Pose | None = None
        if robot_of(name) == robot_of(before) and age_of(before) == age_of(name) + 1:
            record = looks[name].record
            moved = None if record is None else record.moved
            if known[name].digest == known[before].digest:  # it stood still
                moved = Pose(0.0, 0.0)
        if moved is None:
            found.append([(name, Pose(0.0, 0.0))])
        else:
            found[-1].append((name, placed(here, moved)))
    return [tuple(track) for track in found]


def unbroken(track: Track, denied: Set[tuple[str, str]]) -> Iterator[Track]:
    """What is left of a track without the steps, two panoramas in succession, that are denied."""
    begin = 0
    for k, ((a, _), (b, _)) in enumerate(pairwise(track), 1):
        if (a, b) in denied:
            yield track[begin:k]
            begin = k
    yield track[begin:]


def links(track: Track) -> Iterator[tuple[str, str, Pose]]:
    """Each two of a track, the way between them short, and where the later is for the earlier."""
    way_m = [0.0]
    for (_, a), (_, b) in pairwise(track):
        way_m.append(way_m[-1] + a.distance_to_m(b.xy_m))
    for i, j in combinations(range(len(track)), 2):
        if j == i + 1 or way_m[j] - way_m[i] <= HOLDS_M:
            yield track[i][0], track[j][0], relative(track[i][1], track[j][1])

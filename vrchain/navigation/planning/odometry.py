"""How robots moved from panorama to panorama, by their own odometry: their trails.

A publisher tells, signed, how it moved since its panorama before. So the panoramas of one robot
need no common landmark to hang together, and where it drove another can drive.
"""

from collections.abc import Iterator, Mapping
from itertools import combinations, pairwise

from vrchain.geometry import Pose, placed, relative
from vrchain.navigation.perception import Look
from vrchain.navigation.settings import Published, age_of, robot_of

_HOLDS_M = 50.0  # of way, after which odometry alone is no witness any more

Trail = tuple[tuple[str, Pose], ...]


def trails(known: Mapping[str, Published], looks: Mapping[str, Look]) -> list[Trail]:
    """Each robot's panoramas in succession, oldest first, in the frame of the first of them.

    Where nothing tells how a robot moved, or a panorama is missing, another trail begins.
    """
    found: list[list[tuple[str, Pose]]] = []
    for name in sorted(known, key=lambda name: (robot_of(name), -age_of(name))):
        before, here = found[-1][-1] if found else ("", Pose(0.0, 0.0))
        moved = _moved(name, before, known, looks)
        if moved is None:
            found.append([(name, Pose(0.0, 0.0))])
        else:
            found[-1].append((name, placed(here, moved)))
    return [tuple(trail) for trail in found]


def _moved(
    name: str, before: str, known: Mapping[str, Published], looks: Mapping[str, Look]
) -> Pose | None:
    """Where a panorama was taken, in the frame of the one before; None: nothing tells."""
    if robot_of(name) != robot_of(before) or age_of(before) != age_of(name) + 1:
        return None
    if known[name].digest == known[before].digest:  # it stood still
        return Pose(0.0, 0.0)
    record = looks[name].record
    return None if record is None else record.moved


def linked(trail: Trail) -> Iterator[tuple[str, str, Pose]]:
    """Each two of a trail, the way between them short, and where the later is for the earlier."""
    way_m = [0.0]
    for (_, a), (_, b) in pairwise(trail):
        way_m.append(way_m[-1] + a.distance_to_m(b.xy_m))
    for i, j in combinations(range(len(trail)), 2):
        if j == i + 1 or way_m[j] - way_m[i] <= _HOLDS_M:
            yield trail[i][0], trail[j][0], relative(trail[i][1], trail[j][1])

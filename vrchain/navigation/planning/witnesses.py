"""Whether others bear out a sight of the goal: what was taken near to it should show it too.

A panorama alone takes what looks like the goal for it now and then, mostly from afar. Whoever
passed nearer has seen the same thing better.
"""

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from vrchain.geometry import Pose
from vrchain.navigation.goal.recognition import GoalSight
from vrchain.navigation.perception import Look
from vrchain.navigation.planning.relative_poses import ORIGIN, RelativePoses
from vrchain.navigation.settings import robot_of

Find = Callable[..., GoalSight | None]
"""The goal in a look, or in it within a window around a bearing: both in radians."""

# The odds times so much for each witness that sees the goal there, and for each that sees nothing
# like it; of so many, the nearest to it. One sight is worth odds of 20 at most, once others speak.
_FOR, _AGAINST, _HEARD, _ALONE = 4.0, 0.36, 6, 20.0
# So often a robot speaks against another's sight: it may publish walls along a way that it never
# went. Of 389 sights in missions of seed 1387 that moved three, over 0.3.
_EACH = 2
_NEAR_M, _TOO_NEAR_M = 25.0, 1.5
_SEES, _NOTHING = 0.5, 0.05  # chance of a sight from which it speaks for the goal, or against it
_SAME_M = 12.0  # within which two sights are of one thing
_LOST = 0.01  # odds below which no more witnesses are heard
_WINDOW_RAD = 0.25  # a witness is asked so far beside the bearing from it


def borne_out(
    seen: Mapping[str, GoalSight],
    looks: Mapping[str, Look],
    poses: RelativePoses,
    find: Find,
) -> dict[str, GoalSight]:
    """The sights, by the panoramas that show them, as likely as by what all others say of them.

    looks: of all panoramas; poses: their relative poses, of which sure ones alone are followed.
    """
    found, taken = dict(seen), dict[str, Pose]()
    for name, sight in seen.items():
        if 0 < sight.chance < 1:  # what is certain needs no witness
            if name not in taken:
                taken = poses.reached({name: ORIGIN})
            found[name] = replace(sight, chance=_chance(name, sight, taken, looks, find))
    return found


def _chance(
    name: str, sight: GoalSight, taken: Mapping[str, Pose], looks: Mapping[str, Look], find: Find
) -> float:
    """That it is of the goal. taken: where panoramas were, in one frame."""
    there_m = sight.place(taken[name]).xy_m
    ranges = sorted((pose.distance_to_m(there_m), other) for other, pose in taken.items())
    near = [other for m, other in ranges if _TOO_NEAR_M <= m <= _NEAR_M and other != name]
    odds = sight.chance / (1 - sight.chance)
    odds, heard = min(odds, _ALONE) if near else odds, 0
    against = Counter[str]()
    for other in near:
        here, robot = taken[other], robot_of(other)
        if odds < _LOST or heard == _HEARD:
            break
        again = find(looks[other], here.bearing_to_rad(there_m), _WINDOW_RAD)
        if again is None or again.chance < _NOTHING:
            against[robot] += 1
            if robot != robot_of(name) and against[robot] > _EACH:
                continue
            odds *= _AGAINST
        elif again.chance >= _SEES and np.hypot(*(again.place(here).xy_m - there_m)) < _SAME_M:
            odds *= _FOR
        heard += 1
    return float(odds / (1 + odds))

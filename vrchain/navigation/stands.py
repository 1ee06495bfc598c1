"""Where panoramas were taken as seen from others, and whether three of them agree on that.

It is no chance if two rightly joined panoramas tell the same of a third; and if one of them does
not know a third that, by the other's join with it, is near, that join is probably wrong.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.landmarks.common import Comparison
from vrchain.navigation.places import beyond
from vrchain.panorama import CameraRig

Pair = tuple[str, str]

SURE = 0.8  # trust from which a join bears witness
_TOLD = 0.1  # trust from which it is compared with what a witness says
_NEAR_M, _APART_M = 25.0, 2.0  # witnesses: so near the one, and not at the place of either
_OFF, _OFF_M, _OFF_RAD = 0.3, 3.0, 0.2  # agreement: share of the way there, metres, heading
# The odds times so much if two witnesses agree; with each of two that do not, if none does. By all
# pairs of two patrols of seed 1003: of those of a chance between 0.2 and 0.5 (right: 0.34), 0.82
# (n 11) and 0.11 (35) are right then, of those between 0.5 and 0.8 (0.84), 0.93 (40) and 0.33 (6).
_FOR, _AGAINST, _HEARD = 9.0, 0.4, 2
ORIGIN = Pose(0.0, 0.0)


@dataclass(frozen=True)
class Join:
    """What a comparison of two panoramas tells.

    stand: where the second was taken, in the frame of the first; None: nothing tells. trust: the
    chance that they were joined rightly.
    """

    stand: Pose | None
    trust: float


class Joins:
    """Joins of panoramas, and what they say of each other."""

    def __init__(self, joins: Mapping[Pair, Join]) -> None:
        self._joins: dict[Pair, Join] = {}  # either way round
        self._sure: dict[str, list[str]] = {}
        for (a, b), join in joins.items():
            back = None if join.stand is None else relative(join.stand, ORIGIN)
            self._joins |= {(a, b): join, (b, a): Join(back, join.trust)}
            if join.trust >= SURE and join.stand is not None:
                self._sure.setdefault(a, []).append(b)
                self._sure.setdefault(b, []).append(a)

    def trust(self, pair: Pair) -> float:
        """The chance that two were joined rightly, by what others say too."""
        join = self._joins[pair]
        if not 0 < join.trust < 1:
            return join.trust
        said: dict[str, bool | None] = {}
        for third, other, told in self._witnesses(pair):
            said[third] = said.get(third) or self._agrees(third, other, told)
        agreed = list(said.values())
        odds = join.trust / (1 - join.trust)
        if agreed.count(True) >= _HEARD:
            odds *= _FOR
        elif True not in agreed:
            odds *= _AGAINST ** min(_HEARD, agreed.count(False))
        return float(odds / (1 + odds))

    def unasked(self, pair: Pair) -> list[Pair]:
        """What might yet be compared to know more of two that were joined, the nearest first."""
        told = {third: (other, way) for third, other, way in self._witnesses(pair)}
        left = [
            (third, *what) for third, what in told.items() if (third, what[0]) not in self._joins
        ]
        wanted = max(0, _HEARD - (len(told) - len(left)))
        left.sort(key=lambda w: (float(np.hypot(*w[2].xy_m)), w[0]))
        return [(third, other) for third, other, _ in left[:wanted]]

    def _witnesses(self, pair: Pair) -> Iterator[tuple[str, str, Pose]]:
        """Others that know one of the two; the other; where it is for them if the two are right."""
        for here, there in (pair, pair[::-1]):
            stand = self._joins[here, there].stand
            if stand is None:
                continue
            way_m, course_rad = float(np.hypot(*stand.xy_m)), ORIGIN.bearing_to_rad(stand.xy_m)
            for third in self._sure.get(here, []):
                back = self._joins[third, here].stand
                if third == there or back is None or np.hypot(*back.xy_m) < _APART_M:
                    continue
                told = beyond(back, course_rad, way_m, stand.yaw_rad)
                if _APART_M <= np.hypot(*told.xy_m) <= _NEAR_M:
                    yield third, there, told

    def _agrees(self, here: str, there: str, told: Pose) -> bool | None:
        """Whether a join tells what it should; None: they were not compared."""
        join = self._joins.get((here, there))
        if join is None:
            return None
        stand = join.stand
        if stand is None or join.trust < _TOLD:
            return False
        way_m = max(float(np.hypot(*stand.xy_m)), float(np.hypot(*told.xy_m)))
        turned = abs(float(wrap_angle_rad(stand.yaw_rad - told.yaw_rad)))
        return stand.distance_to_m(told.xy_m) <= _OFF_M + _OFF * way_m and turned <= _OFF_RAD


def relative(a: Pose, b: Pose) -> Pose:
    """Where B is in A's frame, both given in one frame."""
    c, s = np.cos(a.yaw_rad), np.sin(a.yaw_rad)
    x_m, y_m = b.xy_m - a.xy_m
    return Pose(
        float(c * x_m + s * y_m), float(c * y_m - s * x_m),
        float(wrap_angle_rad(b.yaw_rad - a.yaw_rad)),
    )  # fmt: skip


def baseline_m(found: Comparison, rig: CameraRig) -> float | None:
    """How far apart two panoramas were taken, None if nothing tells."""
    if found.geometry is None or not np.isfinite(found.geometry.baseline_heights):
        return None
    return float(found.geometry.baseline_heights * rig.camera_height_m)


def stand_of(here: Pose, found: Comparison, rig: CameraRig, back: bool = False) -> Pose | None:
    """Where the other panorama was taken, if the one was at ``here``; None: nothing tells.

    back: from the comparison's second panorama to its first.
    """
    geometry, way_m = found.geometry, baseline_m(found, rig)
    if geometry is None or way_m is None:
        return None
    if back:
        return beyond(here, geometry.back_rad, way_m, -geometry.heading_rad)
    return beyond(here, geometry.direction_rad, way_m, geometry.heading_rad)

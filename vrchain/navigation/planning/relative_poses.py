"""Relative poses of panoramas, and whether those of three agree.

It is no chance if two rightly matched panoramas tell the same of a third; and if one of them does
not know a third that, by the other's relative pose, is near, that pose is probably wrong.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from math import prod

import numpy as np

from vrchain.geometry import Pose, placed, relative, wrap_angle_rad
from vrchain.landmarks.matching.common import Comparison
from vrchain.navigation.settings import robot_of
from vrchain.panorama import CameraRig

Pair = tuple[str, str]

SURE = 0.8  # trust from which a relative pose bears witness
_TOLD, _FIRM = 0.05, 0.5  # trust below which it tells nothing, from which it tells for sure
_NEAR_M, _APART_M = 25.0, 2.0  # witnesses: so near the one, and not at the place of either
_OFF, _OFF_M, _OFF_RAD = 0.3, 3.0, 0.2  # agreement: share of the way there, metres, heading
DIFFERENT = 2.0  # times what still passes for agreement
# The odds times so much for each witness that agrees, for each that knows nothing of what should
# be near, and for each that firmly knows it elsewhere; of so many, the nearest. By four patrols of
# seeds 1311 and 1312: of the witnesses of right poses 0.84 agree, 0.05 know nothing and 0.001 know
# it elsewhere, of those of wrong ones 0.003, 0.85 and 0.10; less here, as witnesses err together.
_FOR, _AGAINST, _DENIED, _HEARD = 20.0, 0.4, 0.05, 6
ORIGIN = Pose(0.0, 0.0)


@dataclass(frozen=True)
class RelativePose:
    """What a comparison of two panoramas tells.

    pose: where the second was taken, in the frame of the first; None: nothing tells. trust: the
    chance that it is right.
    """

    pose: Pose | None
    trust: float


class RelativePoses:
    """The relative poses of pairs of panoramas, and what they say of each other."""

    def __init__(self, poses: Mapping[Pair, RelativePose]) -> None:
        self._poses: dict[Pair, RelativePose] = {}  # either way round
        self._sure: dict[str, list[str]] = {}
        for (a, b), known in poses.items():
            back = None if known.pose is None else relative(known.pose, ORIGIN)
            self._poses |= {(a, b): known, (b, a): RelativePose(back, known.trust)}
            if known.trust >= SURE and known.pose is not None:
                self._sure.setdefault(a, []).append(b)
                self._sure.setdefault(b, []).append(a)

    def between(self, a: str, b: str) -> Pose | None:
        """Where B was taken, in A's frame; None: nothing tells."""
        known = self._poses.get((a, b))
        return None if known is None else known.pose

    def reached(self, known: Mapping[str, Pose]) -> dict[str, Pose]:
        """Where panoramas were taken that sure relative poses lead to from some known ones."""
        found = dict(known)
        waiting = list(found)
        for here in waiting:  # grows
            for there in self._sure.get(here, []):
                pose = self.between(here, there)
                if there not in found and pose is not None and self.trust((here, there)) >= SURE:
                    found[there] = placed(found[here], pose)
                    waiting.append(there)
        return found

    def trust(self, pair: Pair) -> float:
        """The chance that a relative pose is right, by what others say too."""
        known = self._poses[pair]
        if not 0 < known.trust < 1:
            return known.trust
        odds = known.trust / (1 - known.trust) * prod(islice(self._heard(pair), _HEARD))
        return float(odds / (1 + odds))

    def _heard(self, pair: Pair) -> Iterator[float]:
        """The odds by each witness that tells something, the nearest first.

        A robot that took neither panorama speaks against them but once: it may publish many, of
        anything. Of 2,290 poses of missions of seed 1386 that moved one, from 0.13 to 0.47.
        """
        spoke = set[str]()
        own = {robot_of(name) for name in pair}
        for witness in self._witnesses(pair):
            odds, robot = self._speaks(*witness), robot_of(witness[0])
            if odds is None or (odds < 1 and robot in spoke):
                continue
            if odds < 1 and robot not in own:
                spoke.add(robot)
            yield odds

    def unasked(self, pair: Pair) -> list[Pair]:
        """What might yet be compared to know more of a pair, the nearest first."""
        nearest = self._witnesses(pair)[:_HEARD]
        return [(third, other) for third, other, _ in nearest if (third, other) not in self._poses]

    def _witnesses(self, pair: Pair) -> list[tuple[str, str, Pose]]:
        """Others that know one of the two; the other; where it is for them if the pair is right.

        The nearest to the other first, each once.
        """
        found: list[tuple[float, str, str, Pose]] = []
        for here, there in (pair, pair[::-1]):
            pose = self.between(here, there)
            if pose is None:
                continue
            for third in self._sure.get(here, []):
                back = self.between(third, here)
                if third == there or back is None or np.hypot(*back.xy_m) < _APART_M:
                    continue
                told = placed(back, pose)
                range_m = float(np.hypot(*told.xy_m))
                if _APART_M <= range_m <= _NEAR_M:
                    found.append((range_m, third, there, told))
        nearest: dict[str, tuple[str, str, Pose]] = {}
        for _, third, there, told in sorted(found, key=lambda witness: witness[:3]):
            nearest.setdefault(third, (third, there, told))
        return list(nearest.values())

    def _speaks(self, here: str, there: str, told: Pose) -> float | None:
        """The odds by a pair whose relative pose should be as told; None: it was not compared."""
        known = self._poses.get((here, there))
        if known is None:
            return None
        pose, firm = known.pose, known.trust >= _FIRM
        if pose is None or known.trust < _TOLD:
            return _AGAINST
        differs = apart(pose, told)
        if firm:
            return _FOR if differs <= 1.0 else _DENIED if differs > DIFFERENT else 1.0
        return 1.0 if differs <= 1.0 else _AGAINST


def apart(one: Pose, other: Pose) -> float:
    """By how much two relative poses differ, in what still passes for agreement."""
    way_m = max(float(np.hypot(*one.xy_m)), float(np.hypot(*other.xy_m)))
    by_place = one.distance_to_m(other.xy_m) / (_OFF_M + _OFF * way_m)
    turned = abs(float(wrap_angle_rad(one.yaw_rad - other.yaw_rad)))
    return float(max(by_place, turned / _OFF_RAD))


def baseline_m(found: Comparison, rig: CameraRig) -> float | None:
    """How far apart two panoramas were taken, None if nothing tells."""
    if found.geometry is None or not np.isfinite(found.geometry.baseline_heights):
        return None
    return float(found.geometry.baseline_heights * rig.camera_height_m)


def pose_from(found: Comparison, rig: CameraRig) -> Pose | None:
    """Where the second panorama was taken, in the frame of the first; None: nothing tells."""
    geometry, way_m = found.geometry, baseline_m(found, rig)
    if geometry is None or way_m is None:
        return None
    x_m, y_m = way_m * np.cos(geometry.direction_rad), way_m * np.sin(geometry.direction_rad)
    return Pose(float(x_m), float(y_m), float(wrap_angle_rad(geometry.heading_rad)))

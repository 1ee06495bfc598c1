"""What a robot makes of what it sees: landmark records, their comparison, and the goal in them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vrchain.geometry import wrap_angle_rad
from vrchain.landmarks.calibration import Calibration, load_calibration
from vrchain.landmarks.common import Comparison
from vrchain.landmarks.common import compare as compare_by_sift
from vrchain.landmarks.gallery import record_from, sought
from vrchain.landmarks.joint import JointConfig, compare_joint
from vrchain.landmarks.proposer import Proposals
from vrchain.landmarks.recognition import GOAL_MATCHES, Goal, Sighting, goal_of, locate
from vrchain.landmarks.record import LandmarkRecord, examine
from vrchain.landmarks.sift import Features, extract
from vrchain.landmarks.weights import SHIPPED
from vrchain.panorama import CameraRig, Panorama
from vrchain.robot import Observation

Array = NDArray[np.float64]

_LEAST_MATCHES = 8  # keypoints by which a goal may be told at all
_SURE_MATCHES = 20  # ... and by which it is surely the goal
_FEW = 3.0  # claims, all of them sure: so many are sometimes found by chance
_FEW_MATCHES = 8.0  # keypoints that obey one pose, likewise
_NONE = np.empty(0, dtype=np.int64)
_WIDE_RAD = 0.15  # a goal's keypoints may lie so far beside its proposal
_AMONG = 6  # proposals that look most like the goal


@dataclass(frozen=True, eq=False)
class Look:
    """What a robot makes of what it sees: what may be landmarks, and all keypoints.

    Bearings in the robot's frame. record: of a whole panorama, as it is published and compared.
    """

    rig: CameraRig
    proposals: Proposals
    features: Features
    record: LandmarkRecord | None = None


@dataclass(frozen=True, eq=False)
class Eyes:
    """examine: what a robot makes of an observation with a panorama or a view.

    stored: what it makes of a panorama's bytes and of the record published with it, or None.
    compare: what two looks have in common.
    """

    examine: Callable[[Observation], Look]
    stored: Callable[[bytes, bytes | None], Look]
    compare: Callable[[Look, Look], Comparison]
    calibration: Calibration

    def record(self, seen: Observation) -> LandmarkRecord:
        """The record of a panorama, to publish."""
        record = self.examine(seen).record
        assert record is not None, "only whole panoramas are published"
        return record


def learned_eyes(weights: Path = SHIPPED, config: JointConfig | None = None) -> Eyes:
    """Eyes by the network and by SIFT; LearnedError without torch or weights."""
    calibration = load_calibration(weights)
    last: list[tuple[Panorama, Look]] = []  # what is published was just looked at

    def look(seen: Observation) -> Look:
        assert seen.panorama is not None
        if not last or last[0][0] is not seen.panorama:
            features = extract(seen.panorama)
            record = examine(seen.panorama, weights, features=features)
            made = Look(record.rig, record.proposals, features, record)
            last[:] = [(seen.panorama, in_robots_frame(made, seen))]
        return last[0][1]

    def stored(panorama: bytes, landmarks: bytes | None) -> Look:
        record = record_from(panorama, landmarks, weights)
        return Look(record.rig, record.proposals, extract(Panorama.decode(panorama)), record)

    def compare(a: Look, b: Look) -> Comparison:
        return by_both(a, b, config, calibration)

    return Eyes(look, stored, compare, calibration)


def by_both(
    a: Look, b: Look, config: JointConfig | None = None, calibration: Calibration | None = None
) -> Comparison:
    """What two looks have in common by the network and by SIFT over all keypoints.

    Scores are lowered where little speaks for the relative pose that they rest on: of panoramas
    with nothing in common a few claims are sometimes made, but not many. Supports count by the
    features of the looks; claims by the network have none. The surer of both poses is given.
    """
    assert a.record is not None and b.record is not None, "only whole panoramas are compared"
    learned = compare_joint(a.record, b.record, config, calibration)
    keypoints = compare_by_sift(a.features, b.features, a.rig)
    agree = 0 if keypoints.geometry is None else int(keypoints.geometry.inliers.sum())
    trusted = 1.0 - 0.5 ** (sum(common.score**2 for common in learned.common) / _FEW)
    by_sift = 1.0 - 0.5 ** (agree / _FEW_MATCHES)
    claims = [
        *(replace(c, score=c.score * trusted, support_a=_NONE, support_b=_NONE)
          for c in learned.common),
        *(replace(c, score=c.score * by_sift) for c in keypoints.common),
    ]  # fmt: skip
    geometry = keypoints.geometry if by_sift > trusted else learned.geometry
    return Comparison(tuple(sorted(claims, key=lambda c: -c.score)), geometry)


def in_robots_frame(look: Look, seen: Observation) -> Look:
    """A look through one camera, its bearings from the robot's heading."""
    if seen.view_rad is None:
        return look
    turn = seen.view_rad
    p, f = look.proposals, look.features
    box = p.box + np.array([turn, turn, 0.0, 0.0])
    proposals = replace(p, box=box, bearing_rad=wrap_angle_rad(p.bearing_rad + turn))
    features = replace(f, bearing_rad=wrap_angle_rad(f.bearing_rad + turn))
    return Look(look.rig, proposals, features)


def surface_m(look: Look, index: int) -> float:
    """How far a proposal's nearest side is: by where it stands on the ground, if that is seen."""
    p = look.proposals
    low, middle_m = float(p.box[index, 2]), float(p.range_m[index])
    if low > -0.03:
        return middle_m
    return min(middle_m, look.rig.camera_height_m / -low)


@dataclass(frozen=True)
class GoalSight:
    """What may be the goal. surface_m: how far its nearest side is; chance: that it is the goal.

    n_matches: keypoints that agree with one of its pictures.
    """

    bearing_rad: float
    range_m: float
    surface_m: float
    half_width_rad: float
    n_matches: int
    looks: float
    chance: float


@dataclass(frozen=True, eq=False)
class GoalPictures:
    """A goal as a robot knows it: what its pictures show in their middle, and all their keypoints.

    embedding: (n, d) of those pictures in whose middle something is proposed. by_looks: whether
    looks alone are enough to tell it surely.
    """

    embedding: NDArray[np.float32]
    keypoints: Goal
    calibration: Calibration
    by_looks: bool = False

    def find(
        self,
        look: Look,
        near_rad: float | None = None,
        window_rad: float = 0.4,
        sizes: Mapping[int, Sighting] | None = None,
    ) -> GoalSight | None:
        """The best sight of the goal, within a window around a bearing if one is given.

        sizes: those of the look, where they are known already.
        """
        p = look.proposals
        middle = (p.box[:, 0] + p.box[:, 1]) / 2
        half = (p.box[:, 1] - p.box[:, 0]) / 2
        looks = self.looks(look)
        found: list[GoalSight] = []
        near = np.ones(len(p), dtype=bool)
        if near_rad is not None:
            near = np.abs(wrap_angle_rad(middle - near_rad)) < half + window_rad
        for i in np.flatnonzero(near)[np.argsort(-looks[near], kind="stable")][:_AMONG]:
            bearing, half_rad = float(middle[i]), float(half[i])
            matches = 0 if self.by_looks else self._matches(look.features, bearing, half_rad)
            found.append(
                GoalSight(
                    float(wrap_angle_rad(bearing)), float(p.range_m[i]), surface_m(look, i),
                    half_rad, matches, float(looks[i]),
                    self._chance(matches, float(looks[i])),
                )
            )  # fmt: skip
        if near_rad is None:
            found += self._by_keypoints(look, self.sizes(look) if sizes is None else sizes)
        return max(found, key=lambda s: (s.chance, s.looks), default=None)

    def looks(self, look: Look) -> Array:
        """How much each proposal looks like it: log-likelihood ratio, (n,)."""
        own = look.proposals.embedding
        if len(self.embedding) == 0 or len(own) == 0:
            return np.full(len(own), -10.0)
        cosine = (own @ self.embedding.T).astype(float).max(axis=1)
        return np.asarray(self.calibration.alike_scale * (cosine - self.calibration.alike_even))

    def _matches(self, features: Features, middle_rad: float, half_rad: float) -> int:
        window_rad = half_rad + _WIDE_RAD
        seen = (
            locate(t, features, middle_rad, window_rad, _LEAST_MATCHES)
            for t in self.keypoints.templates
        )
        return max((s.n_matches for s in seen if s is not None), default=0)

    def sizes(self, look: Look) -> dict[int, Sighting]:
        """The goal by keypoints, picture by picture; a sighting's scale is its size there."""
        if self.by_looks:
            return {}
        found = {
            k: locate(template, look.features, min_matches=GOAL_MATCHES)
            for k, template in enumerate(self.keypoints.templates)
        }
        return {k: seen for k, seen in found.items() if seen is not None}

    def _by_keypoints(self, look: Look, sizes: Mapping[int, Sighting]) -> list[GoalSight]:
        """The goal where no proposal looks like it, but many keypoints say so.

        Its range is that of the nearest proposal of about its width: a rough one.
        """
        seen = max(sizes.values(), key=lambda s: s.n_matches, default=None)
        if seen is None:
            return []
        p = look.proposals
        off = np.abs(wrap_angle_rad((p.box[:, 0] + p.box[:, 1]) / 2 - seen.bearing_rad))
        off += 0.3 * np.abs((p.box[:, 1] - p.box[:, 0]) / 2 - seen.half_width_rad)
        k = int(off.argmin()) if len(off) else -1
        range_m, near_m = (float(p.range_m[k]), surface_m(look, k)) if k >= 0 else (12.0, 10.0)
        return [
            GoalSight(seen.bearing_rad, range_m, near_m, seen.half_width_rad, seen.n_matches,
                      float(self.looks(look)[k]) if k >= 0 else 0.0,
                      self._chance(seen.n_matches, 0.0))
        ]  # fmt: skip

    def _chance(self, matches: int, looks: float) -> float:
        """That a sight is of the goal: a few keypoints say little, many are proof."""
        if self.by_looks:
            return 1.0 if looks > 2.5 else 0.0
        if matches < _LEAST_MATCHES:
            return 0.0
        surely = (matches - _LEAST_MATCHES) / (_SURE_MATCHES - _LEAST_MATCHES)
        return min(1.0, 0.5 + 0.5 * surely)


def goal_from(pictures: Sequence[Panorama], weights: Path = SHIPPED) -> GoalPictures:
    """A goal by single views that are framed on it."""
    shown = sought([examine(p, weights) for p in pictures])
    return GoalPictures(shown.embedding, goal_of(pictures), load_calibration(weights))

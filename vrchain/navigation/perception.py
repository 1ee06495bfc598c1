"""What a robot makes of what it sees: its looks, their comparison, and how far that is trusted."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from vrchain.geometry import wrap_angle_rad
from vrchain.landmarks.extraction.proposer import Proposals
from vrchain.landmarks.extraction.raster import CELL_PX, PX_PER_RAD, directions_of
from vrchain.landmarks.extraction.record import LandmarkRecord, examine, examine_quickly
from vrchain.landmarks.extraction.sift import NO_FEATURES, Features, extract, extract_near
from vrchain.landmarks.extraction.spots import NO_SPOTS, Spots
from vrchain.landmarks.extraction.weights import SHIPPED
from vrchain.landmarks.matching.calibration import Calibration, load_calibration
from vrchain.landmarks.matching.common import Comparison
from vrchain.landmarks.matching.epipolar import PlanarGeometry
from vrchain.landmarks.matching.joint import JointConfig, compare_joint
from vrchain.landmarks.retrieval.gallery import record_from
from vrchain.navigation.planning.relative_poses import baseline_m
from vrchain.panorama import CameraRig, Panorama
from vrchain.robot import Observation

# A route weighs claims by their scores, and by the chance that relative poses are right. Of 1711
# pairs of six missions of seed 1368 a third had no likelier pose than that: three of 780 that were
# joined with a trust of 0.5 or more.
PLANNING = JointConfig(min_score=0.3, min_joined=0.0, min_pose=-2.0)
# Claims a proposal, all of them sure, of panoramas joined rightly half the time, and how steeply
# that chance rises: logistic regression on 955 pairs of seed 1003.
_FEW, _RISING = 0.04, 3.4
_NEAR_HEIGHTS = 20.0  # at shorter distances, in camera heights, each claim counts for less
# Log-odds that the relative pose of panoramas of a ledger is right: so much, so many times those by
# claims, and so many times the log of the way between them over a typical one. Logistic regression
# on all pairs of three patrols' panoramas, of seeds 1311 and 1312.
_LESS, _STEEP, _BY_WAY, _TYPICAL_M = -0.57, 1.8, 2.4, 15.0
_SUREST = 0.995
_BEFORE_IT = 0.05  # of a proposal's columns may be of what stands before it


@dataclass(frozen=True, eq=False)
class Look:
    """What a robot makes of what it sees: what may be landmarks, their spots, and all keypoints.

    Bearings in the robot's frame. extracted: the keypoints, once they are asked for;
    extracted_near: those so far beside a bearing, where that costs less. record: of a whole
    panorama, as it is published and compared.
    """

    rig: CameraRig
    proposals: Proposals
    extracted: Callable[[], Features]
    spots: Spots = NO_SPOTS
    record: LandmarkRecord | None = None
    extracted_near: Callable[[float, float], Features] | None = None

    @cached_property
    def features(self) -> Features:
        return self.extracted()

    def features_near(self, bearing_rad: float, half_rad: float) -> Features:
        """The keypoints at most so far beside a bearing."""
        if self.extracted_near is not None:
            return self.extracted_near(bearing_rad, half_rad)
        return self.features.near(bearing_rad, half_rad)


@dataclass(frozen=True, eq=False)
class Perception:
    """examine: what a robot makes of an observation with a panorama or a view.

    stored: what it makes of a panorama's bytes and of the record published with it, or None.
    compare: what two looks have in common; trust: the chance that their relative pose is right.
    """

    examine: Callable[[Observation], Look]
    stored: Callable[[bytes, bytes | None], Look]
    compare: Callable[[Look, Look], Comparison]
    calibration: Calibration
    trust: Callable[[Look, Look, Comparison], float] = lambda a, b, found: 1.0

    def alike(self, a: Look, b: Look) -> float:
        """How much looks speak for landmarks in common, without a comparison.

        By the log-likelihood ratios of proposals that are each other's most alike, of as many as
        there may be.
        """
        one, other = a.proposals.embedding, b.proposals.embedding
        if len(one) == 0 or len(other) == 0:
            return 0.0
        looks = self.calibration.appearance(one @ other.T)
        rows, best = np.arange(len(one)), looks.argmax(axis=1)
        mutual = looks.argmax(axis=0)[best] == rows
        speaks = np.logaddexp(0.0, looks[rows, best][mutual]).sum()
        return float(speaks / np.sqrt(len(one) * len(other)))

    def record(self, seen: Observation) -> LandmarkRecord:
        """The record of a panorama, to publish."""
        record = self.examine(seen).record
        assert record is not None, "only whole panoramas are published"
        return record


def learned_perception(weights: Path = SHIPPED, config: JointConfig = PLANNING) -> Perception:
    """Perception by the network and by SIFT; LearnedError without torch or weights."""
    calibration = load_calibration(weights)
    decoded = lru_cache(maxsize=1)(Panorama.decode)  # the goal is sought in parts of it

    @lru_cache(maxsize=1)  # what is published was just looked at
    def examined(panorama: Panorama, view_rad: float | None) -> Look:
        if view_rad is None:
            return look_at(examine_quickly(panorama, weights), lambda: panorama)
        record = examine(panorama, weights, features=NO_FEATURES)  # it is compared with nothing
        return turned(look_at(record, lambda: panorama), view_rad)

    def look(seen: Observation) -> Look:
        assert seen.panorama is not None
        return examined(seen.panorama, seen.view_rad)

    def stored(panorama: bytes, landmarks: bytes | None) -> Look:
        return look_at(record_from(panorama, landmarks, weights), lambda: decoded(panorama))

    def compare(a: Look, b: Look) -> Comparison:
        assert a.record is not None and b.record is not None, "only whole panoramas are compared"
        return compare_joint(a.record, b.record, config, calibration)

    return Perception(look, stored, compare, calibration, trust)


def look_at(record: LandmarkRecord, panorama: Callable[[], Panorama]) -> Look:
    """A look at a panorama whose record is known; keypoints are extracted when asked for."""
    return Look(
        record.rig,
        record.proposals,
        lambda: extract(panorama()),
        record.spots,
        record,
        lambda bearing_rad, half_rad: extract_near(panorama(), bearing_rad, half_rad),
    )


def trust(a: Look, b: Look, found: Comparison) -> float:
    """The chance that a relative pose is right, by the claims and the way between the panoramas.

    What a ledger says is asked of hundreds: those that look alike by chance seem to be near.
    """
    few = min(len(a.proposals), len(b.proposals))
    chance = chance_joined([common.score for common in found.common], few, found.geometry)
    way_m = baseline_m(found, a.rig)
    if way_m is None or chance == 0.0:
        return chance
    chance = min(chance, _SUREST)
    odds = np.exp(_LESS) * (chance / (1 - chance)) ** _STEEP * (way_m / _TYPICAL_M) ** _BY_WAY
    return float(odds / (1 + odds))


def chance_joined(scores: ArrayLike, n_proposals: int, geometry: PlanarGeometry | None) -> float:
    """The chance that two panoramas were joined rightly, told by all their claims at once.

    Of panoramas far apart, or of two suburbs, a wrong relative pose is sometimes found, and the
    more proposals there are, the more claims under it; it mostly says that they are near to each
    other, but then they would have much more in common. scores: of claims from ``PLANNING`` on;
    n_proposals: of the panorama that has fewer.
    """
    heights = np.inf if geometry is None else geometry.baseline_heights
    counted = min(1.0, 0.15 + heights / _NEAR_HEIGHTS) if np.isfinite(heights) else 1.0
    speaks = counted * float((np.asarray(scores, dtype=float) ** 2).sum())
    few = max(_FEW * n_proposals, 1e-9)
    return float(1.0 / (1.0 + (few / speaks) ** _RISING)) if speaks > 0 else 0.0


def turned(look: Look, view_rad: float) -> Look:
    """A look through one camera, along a bearing, told from the robot's heading."""
    p, spots = look.proposals, look.spots
    box = p.box + np.array([view_rad, view_rad, 0.0, 0.0])
    proposals = replace(p, box=box, bearing_rad=wrap_angle_rad(p.bearing_rad + view_rad))
    spots = replace(spots, bearing_rad=wrap_angle_rad(spots.bearing_rad + view_rad))

    def features() -> Features:
        f = look.features
        return replace(f, bearing_rad=wrap_angle_rad(f.bearing_rad + view_rad))

    return Look(look.rig, proposals, features, spots)


def surface_m(look: Look, index: int) -> float:
    """How far a proposal's nearest side is: by where it stands on the ground, if that is seen."""
    p = look.proposals
    low, middle_m = float(p.box[index, 2]), float(p.range_m[index])
    if low > -0.03:
        return middle_m
    return min(middle_m, look.rig.camera_height_m / -low)


def foot_m(picture: LandmarkRecord, index: int) -> float:
    """How far a proposal's nearest side is, in plain view, by its lowest cells; inf: it hovers.

    The ground is level, and the nearest twentieth of its columns may be of something before it.
    """
    p = picture.proposals
    bearing_rad, slope = directions_of(p.cell[p.owner == index], picture.rig)
    _, column = np.unique(bearing_rad, return_inverse=True)
    lowest = np.full(column.max() + 1, np.inf)
    np.minimum.at(lowest, column, slope - CELL_PX / PX_PER_RAD / 2)
    foot = float(np.quantile(lowest, _BEFORE_IT, method="inverted_cdf"))
    return picture.rig.camera_height_m / -foot if foot < 0 else np.inf

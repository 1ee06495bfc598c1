"""Common landmarks by what they look like and where they stand; with SIFT, or without.

Proposals of the two panoramas are joined by ``constellation``. Keypoints inside joined proposals
are matched by SIFT, obey the same relative pose, and sharpen it. Each joined pair is a claim,
scored by the probability that it is right.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from vrchain.errors import ImageError
from vrchain.geometry import wrap_angle_rad
from vrchain.landmarks.calibration import Calibration, load_calibration
from vrchain.landmarks.common import CommonLandmark, Comparison, Region, view_box
from vrchain.landmarks.constellation import (
    Constellation,
    ConstellationConfig,
    by_looks,
    join,
)
from vrchain.landmarks.epipolar import PlanarGeometry, estimate
from vrchain.landmarks.proposer import Proposals, overlaps
from vrchain.landmarks.raster import CELL_PX, cell_bearings_rad, cell_slopes, columns_of
from vrchain.landmarks.record import LandmarkRecord, owners
from vrchain.landmarks.sift import mutual_matches
from vrchain.panorama import CameraRig

Array = NDArray[np.float64]
Matched = tuple[NDArray[np.int64], NDArray[np.int64]]
"""Keypoints of A and of B, those of one place being the same point."""

_NONE = np.empty(0, dtype=np.int64)

FEATURES = (
    "looks", "place", "evidence", "rival", "matches", "doubt_a", "doubt_b", "range", "tied",
)  # fmt: skip


@dataclass(frozen=True)
class JointConfig:
    """How claims are made of joined proposals."""

    sift: bool = True  # whether keypoints take part
    embedding: bool = True  # whether looks do; without, by places alone
    geometry: bool = True  # whether places do; without, by looks alone
    ratio: float = 0.85  # nearest over second nearest descriptor distance, within a pair
    anywhere: int = 1500  # largest keypoints that are matched all over, for the relative pose
    ratio_anywhere: float = 0.8
    joined: float = -2.0  # log-odds from which a pair's keypoints are matched
    agree_rad: float = 0.2  # keypoints sharpen a relative pose; they do not overthrow it
    min_inliers: int = 8
    alike_descriptors: float = 300.0  # distance of descriptors of keypoints that match
    min_support: int = 5  # matched keypoints from which they, not the region, are the support
    same_box: float = 0.3  # intersection over union from which two claims are of one landmark
    min_score: float = 0.5  # claims below this are not made
    constellation: ConstellationConfig = field(default_factory=ConstellationConfig)

    @property
    def name(self) -> str:
        """What tables call it."""
        left_out = [part for part in ("embedding", "geometry") if not getattr(self, part)]
        return ", no ".join(["cnn+sift" if self.sift else "cnn", *left_out])


def compare_joint(
    a: LandmarkRecord,
    b: LandmarkRecord,
    config: JointConfig | None = None,
    calibration: Calibration | None = None,
) -> Comparison:
    """Common landmarks of two panoramas, surest first.

    ImageError if they are of different rigs, or their records of different weights.
    """
    for what, one, other in (
        ("rig", a.rig, b.rig),
        ("weights and configuration", a.maker, b.maker),
    ):
        if one != other:
            raise ImageError(f"expected two landmark records of one {what}, got {one} and {other}")
    config = config or JointConfig()
    calibration = calibration or load_calibration()
    found = candidates(a, b, config, calibration)
    if found is None:
        return Comparison((), None)
    worth = calibration.claims[config.name]
    score = worth.probability(found.features)
    kept = distinct(a, b, found.pairs, score, config)
    claims = [claim(a, b, found, k, float(score[k]), config) for k in kept]
    return Comparison(tuple(c for c in claims if c.score >= config.min_score), found.geometry)


@dataclass(frozen=True, eq=False)
class Candidates:
    """Joined pairs (n, 2), what speaks for each (n, features), their matched keypoints.

    geometry: the relative pose; None where places took no part.
    """

    pairs: NDArray[np.int64]
    features: Array
    support: tuple[Matched, ...]
    geometry: PlanarGeometry | None


def candidates(
    a: LandmarkRecord, b: LandmarkRecord, config: JointConfig, calibration: Calibration
) -> Candidates | None:
    """What may be claimed of two panoramas, before it is scored; None: nothing."""
    looks = np.zeros((len(a.proposals), len(b.proposals)))
    if config.embedding:
        alike = (a.proposals.embedding @ b.proposals.embedding.T).astype(float)
        looks = calibration.alike_scale * (alike - calibration.alike_even)
    joined = (
        join(a.proposals, b.proposals, looks, config.constellation)
        if config.geometry
        else by_looks(looks)
    )
    if joined is None or len(joined.pairs) == 0:
        return None
    geometry = _geometry_of(joined, a.rig) if config.geometry else None
    support: list[Matched] = [(_NONE, _NONE)] * len(joined.pairs)
    if config.sift:
        inside = _inside(a, b, joined)
        matched = [_matched(a, b, own, config.ratio) for own in inside]
        exact = _exact(a, b, [_anywhere(a, b, config), *matched], geometry, config)
        if exact is not None:
            geometry = exact
            support = [_guided(a, b, own, exact, config) for own in inside]
        support = support if geometry else matched
    pairs = joined.pairs
    gain = joined.looks + joined.place
    i, j = pairs.T
    rivals = gain.copy()
    rivals[i, j] = -np.inf
    rival = np.maximum(rivals[i].max(axis=1), rivals[:, j].max(axis=0)).clip(-30, 30)
    features = np.column_stack(
        [
            joined.looks[i, j].clip(-10, 10),
            joined.place[i, j].clip(-10, 10),
            np.full(len(pairs), np.log1p(max(0.0, joined.evidence))),
            np.log1p(np.exp(-np.clip(gain[i, j] - rival, -20, 20))),
            np.log1p([len(s[0]) for s in support]),
            -np.log(a.proposals.score[i]),
            -np.log(b.proposals.score[j]),
            np.log(np.maximum(a.proposals.range_m[i], b.proposals.range_m[j])),
            np.full(len(pairs), np.log1p(len(pairs))),
        ]
    )
    return Candidates(pairs, features, tuple(support), geometry)


def distinct(
    a: LandmarkRecord,
    b: LandmarkRecord,
    pairs: NDArray[np.int64],
    score: Array,
    config: JointConfig,
) -> list[int]:
    """Which of the pairs (n, 2) stay, surest first: none overlaps with a surer one in A or in B.

    A landmark is proposed whole and in pieces; one claim of it is enough, and the others are worse.
    """
    same = np.zeros((len(pairs), len(pairs)), dtype=bool)
    for record, index in zip((a, b), pairs.T, strict=True):
        right, left, low, high = record.proposals.box[index].T
        boxes = np.stack([-left, -high, -right, -low], axis=1)
        same |= overlaps(boxes, boxes, 2 * np.pi) > config.same_box
    kept: list[int] = []
    for k in map(int, np.argsort(-score, kind="stable")):
        if not same[k, kept].any():
            kept.append(k)
    return kept


def _geometry_of(joined: Constellation, rig: CameraRig) -> PlanarGeometry:
    x_m, y_m = joined.xy_m
    apart_m = max(float(np.hypot(x_m, y_m)), 1e-6)
    across = np.array([-y_m, x_m]) / apart_m
    spread_m = float(np.sqrt(across @ joined.covariance[:2, :2] @ across))
    return PlanarGeometry(
        float(np.arctan2(y_m, x_m)),
        joined.heading_rad,
        np.ones(len(joined.pairs), dtype=bool),
        float(np.arctan2(spread_m, apart_m)),
        apart_m / rig.camera_height_m,
    )


def _inside(a: LandmarkRecord, b: LandmarkRecord, joined: Constellation) -> list[Matched]:
    """The keypoints of each pair's proposals."""
    owner_a, owner_b = (owners(r.rig, r.proposals, r.features) for r in (a, b))
    return [(np.flatnonzero(owner_a == i), np.flatnonzero(owner_b == j)) for i, j in joined.pairs]


def _anywhere(a: LandmarkRecord, b: LandmarkRecord, config: JointConfig) -> Matched:
    """Keypoints that match all over, the largest: they say most of the relative pose."""
    own = tuple(np.argsort(-r.features.size_rad, kind="stable")[: config.anywhere] for r in (a, b))
    return _matched(a, b, (own[0], own[1]), config.ratio_anywhere)


def _matched(a: LandmarkRecord, b: LandmarkRecord, own: Matched, ratio: float) -> Matched:
    described_a, described_b = a.features.descriptors[own[0]], b.features.descriptors[own[1]]
    ia, ib = mutual_matches(described_a, described_b, ratio)
    return own[0][ia], own[1][ib]


def _exact(
    a: LandmarkRecord,
    b: LandmarkRecord,
    matched: list[Matched],
    rough: PlanarGeometry | None,
    config: JointConfig,
) -> PlanarGeometry | None:
    """The relative pose by matched keypoints, if it agrees with that by proposals."""
    if rough is None:
        return None
    ia, ib = (np.concatenate(side) for side in zip(*matched, strict=True))
    fa, fb = a.features.take(ia), b.features.take(ib)
    exact = estimate(fa.bearing_rad, fa.slope, fb.bearing_rad, fb.slope, config.min_inliers)
    if exact is None or not _agree(exact, rough, config.agree_rad):
        return None
    return replace(exact, baseline_heights=rough.baseline_heights)


def _guided(
    a: LandmarkRecord,
    b: LandmarkRecord,
    own: Matched,
    geometry: PlanarGeometry,
    config: JointConfig,
) -> Matched:
    """Keypoints that match where the relative pose lets them, no ratio test being needed then."""
    if min(map(len, own)) == 0:
        return _NONE, _NONE
    fa, fb = a.features.take(own[0]), b.features.take(own[1])
    wide_a, wide_b = fa.descriptors.astype(np.float32), fb.descriptors.astype(np.float32)
    square = (wide_a**2).sum(1)[:, None] + (wide_b**2).sum(1) - 2 * wide_a @ wide_b.T
    square[~geometry.allows(fa.bearing_rad, fa.slope, fb.bearing_rad, fb.slope)] = np.inf
    best_b, best_a = square.argmin(axis=1), square.argmin(axis=0)
    k = np.arange(len(fa))
    good = (best_a[best_b] == k) & (square[k, best_b] < config.alike_descriptors**2)
    return own[0][good], own[1][best_b[good]]


def _agree(exact: PlanarGeometry, rough: PlanarGeometry, within_rad: float) -> bool:
    turned = abs(float(wrap_angle_rad(exact.heading_rad - rough.heading_rad)))
    aside = abs(float(wrap_angle_rad(exact.direction_rad - rough.direction_rad)))
    return turned < within_rad and aside < within_rad + 3 * rough.direction_std_rad


def claim(
    a: LandmarkRecord,
    b: LandmarkRecord,
    found: Candidates,
    k: int,
    score: float,
    config: JointConfig,
) -> CommonLandmark:
    i, j = found.pairs[k]
    bearings = float(a.proposals.bearing_rad[i]), float(b.proposals.bearing_rad[j])
    support_a, support_b = found.support[k]
    if len(support_a) < config.min_support:
        support_a = support_b = _NONE
    return CommonLandmark(
        score,
        region_of(a.proposals, int(i), a.rig),
        region_of(b.proposals, int(j), b.rig),
        support_a,
        support_b,
        found.geometry.ranges(*bearings) if found.geometry else None,
        mask_of(a.proposals, int(i), a.rig),
        mask_of(b.proposals, int(j), b.rig),
    )


def region_of(proposals: Proposals, index: int, rig: CameraRig) -> Region:
    """The region of a proposal, in the view that looks at it most directly."""
    right, left, low, high = proposals.box[index]
    return view_box(float((left + right) / 2), float(left - right), (float(low), float(high)), rig)


def mask_of(proposals: Proposals, index: int, rig: CameraRig) -> Array:
    """Directions of a proposal's cells, (k, 2) bearing_rad and slope."""
    cell = proposals.cell[proposals.owner == index]
    row, column = np.divmod(cell, columns_of(rig) // CELL_PX)
    return np.column_stack([cell_bearings_rad(rig)[column], cell_slopes()[row]])

"""Common landmarks by what they look like and where they stand; with SIFT, or without.

Proposals of the two panoramas are joined by ``constellation``. Keypoints inside joined proposals
are matched by SIFT, obey the same relative pose, and sharpen it. Each joined pair is a claim,
scored by the probability that it is right.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from vrchain.geometry import wrap_angle_rad
from vrchain.landmarks.calibration import Calibration, load_calibration
from vrchain.landmarks.common import CommonLandmark, Comparison, Region, view_box
from vrchain.landmarks.constellation import Constellation, ConstellationConfig, by_looks, join
from vrchain.landmarks.epipolar import PlanarGeometry, estimate
from vrchain.landmarks.proposer import Proposals
from vrchain.landmarks.raster import CELL_PX, cell_bearings_rad, cell_slopes, columns_of
from vrchain.landmarks.record import LandmarkRecord, owners
from vrchain.landmarks.sift import mutual_matches
from vrchain.panorama import CameraRig

Array = NDArray[np.float64]

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
    joined: float = -2.0  # log-odds from which a pair's keypoints are matched
    agree_rad: float = 0.2  # keypoints sharpen a relative pose; they do not overthrow it
    min_inliers: int = 8
    min_support: int = 5  # matched keypoints from which they, not the region, are the support
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
    """Common landmarks of two panoramas of one rig, surest first."""
    config = config or JointConfig()
    calibration = calibration or load_calibration()
    found = candidates(a, b, config, calibration)
    if found is None:
        return Comparison((), None)
    worth = calibration.claims[config.name]
    claims = [
        claim(a, b, found, k, float(score), config)
        for k, score in enumerate(worth.probability(found.features))
        if score >= config.min_score
    ]
    return Comparison(tuple(sorted(claims, key=lambda c: -c.score)), found.geometry)


@dataclass(frozen=True, eq=False)
class Candidates:
    """Joined pairs (n, 2), what speaks for each (n, features), their matched keypoints.

    geometry: the relative pose; None where places took no part.
    """

    pairs: NDArray[np.int64]
    features: Array
    support: tuple[tuple[NDArray[np.int64], NDArray[np.int64]], ...]
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
    pairs = joined.pairs
    none = np.empty(0, dtype=np.int64)
    support = [(none, none)] * len(pairs)
    if config.sift:
        geometry, support = _sharpened(a, b, joined, geometry, config)
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


def _sharpened(
    a: LandmarkRecord,
    b: LandmarkRecord,
    joined: Constellation,
    rough: PlanarGeometry | None,
    config: JointConfig,
) -> tuple[PlanarGeometry | None, list[tuple[NDArray[np.int64], NDArray[np.int64]]]]:
    """The relative pose by keypoints of joined proposals, where they agree; and their matches."""
    owner_a, owner_b = (owners(r.rig, r.proposals, r.features) for r in (a, b))
    matched_a, matched_b, pair = [], [], []
    for number, (i, j) in enumerate(joined.pairs):
        own_a, own_b = np.flatnonzero(owner_a == i), np.flatnonzero(owner_b == j)
        ia, ib = mutual_matches(
            a.features.descriptors[own_a], b.features.descriptors[own_b], config.ratio
        )
        matched_a.append(own_a[ia])
        matched_b.append(own_b[ib])
        pair.append(np.full(len(ia), number))
    if rough is None:
        return None, list(zip(matched_a, matched_b, strict=True))
    ia, ib, owner = (np.concatenate(x).astype(int) for x in (matched_a, matched_b, pair))
    fa, fb = a.features.take(ia), b.features.take(ib)
    exact = estimate(fa.bearing_rad, fa.slope, fb.bearing_rad, fb.slope, config.min_inliers)
    none = np.empty(0, dtype=np.int64)
    if exact is None or not _agree(exact, rough, config.agree_rad):
        return rough, [(none, none)] * len(joined.pairs)
    support = []
    for k in range(len(joined.pairs)):
        own = exact.inliers & (owner == k)
        support.append((ia[own], ib[own]))
    baseline = rough.baseline_heights
    sharp = PlanarGeometry(
        exact.direction_rad, exact.heading_rad, exact.inliers, exact.direction_std_rad, baseline
    )
    return sharp, support


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
        support_a = support_b = np.empty(0, dtype=np.int64)
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

"""Common landmarks by what they look like and where they stand; with SIFT, or without.

Proposals of the two panoramas are joined by ``constellation``. Keypoints matched by SIFT and spots
matched by what the network makes of them obey one relative pose and say it more exactly. Under it
they are matched again inside joined proposals. Each joined pair is a claim, scored by the
probability that it is right.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from vrchain.errors import ImageError
from vrchain.geometry import wrap_angle_rad
from vrchain.landmarks.extraction.proposer import Proposals, overlaps
from vrchain.landmarks.extraction.raster import directions_of
from vrchain.landmarks.extraction.record import LandmarkRecord, owners
from vrchain.landmarks.extraction.sift import mutual_matches
from vrchain.landmarks.extraction.spots import Matched, Spots, by_owner, matched, matched_within
from vrchain.landmarks.matching.calibration import Calibration, load_calibration
from vrchain.landmarks.matching.common import CommonLandmark, Comparison, Region, view_boxes
from vrchain.landmarks.matching.consistency import LEAST_CLAIM, chance_joined
from vrchain.landmarks.matching.constellation import (
    Constellation,
    ConstellationConfig,
    by_looks,
    join,
    join_along,
    one_to_one,
)
from vrchain.landmarks.matching.epipolar import PlanarGeometry, estimate
from vrchain.landmarks.matching.guided import matched_under
from vrchain.panorama import CameraRig

Array = NDArray[np.float64]
_NONE = np.empty(0, dtype=np.int64)
_NO_SPOTS = 0.5  # how much it speaks against a pair that it shares no spot, in log-odds

FEATURES = (
    "looks", "place", "evidence", "rival", "matches", "doubt_a", "doubt_b", "range", "tied",
    "spots", "spots_share", "spots_alike", "spots_anywhere", "share_a", "share_b", "agreed",
)  # fmt: skip


@dataclass(frozen=True)
class JointConfig:
    """How claims are made of joined proposals."""

    sift: bool = True  # whether keypoints take part
    spots: bool = True  # whether single spots do
    embedding: bool = True  # whether looks do; without, by places alone
    geometry: bool = True  # whether places do; without, by looks alone
    ratio: float = 0.85  # nearest over second nearest descriptor distance, within a pair
    anywhere: int = 700  # largest keypoints that are matched all over, for the relative pose
    ratio_anywhere: float = 0.8
    min_inliers: int = 8
    sure_inliers: int = 60  # matches that agree on a relative pose, from which it is beyond doubt
    agree_rad: float = 0.2  # what fewer agree on must be this near to what proposals say
    tolerance_rad: float = 0.008  # of matches, keypoints and spots, under one relative pose
    guided_rad: float = 0.005  # ... of keypoints, once the relative pose is known
    alike_descriptors: float = 300.0  # distance of descriptors of keypoints that match
    same_box: float = 0.4  # intersection over union from which two claims are of one landmark
    min_score: float = 0.75  # claims less likely than this to be right are not made
    min_joined: float = 0.5  # nor any of panoramas less likely than this to be joined rightly
    constellation: ConstellationConfig = field(default_factory=ConstellationConfig)

    @property
    def name(self) -> str:
        """What tables call it."""
        verified = self.sift or self.spots
        parts = [*(("sift", "spots") if verified else ()), "embedding", "geometry"]
        left_out = [part for part in parts if not getattr(self, part)]
        return ", no ".join(["cnn+sift" if verified else "cnn", *left_out])


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
    own = distinct(a, b, found.pairs, score, config)
    heard = [score[k] for k in own if score[k] >= LEAST_CLAIM]
    few = min(len(a.proposals), len(b.proposals))
    chance = chance_joined(heard, few, found.geometry)
    if chance < config.min_joined:
        return Comparison((), found.geometry, chance)
    chosen = [k for k in own if score[k] >= config.min_score]
    return Comparison(tuple(claims_of(a, b, found, chosen, score)), found.geometry, chance)


@dataclass(frozen=True, eq=False)
class Candidates:
    """Joined pairs (n, 2), what speaks for each (n, features), their matched keypoints and spots.

    geometry: the relative pose; None where places took no part.
    """

    pairs: NDArray[np.int64]
    features: Array
    support: tuple[Matched, ...]
    spots: tuple[Matched, ...]
    geometry: PlanarGeometry | None


def candidates(
    a: LandmarkRecord, b: LandmarkRecord, config: JointConfig, calibration: Calibration
) -> Candidates | None:
    """What may be claimed of two panoramas, before it is scored; None: nothing."""
    looks = np.zeros((len(a.proposals), len(b.proposals)))
    if config.embedding:
        looks = calibration.looks(a.proposals.embedding @ b.proposals.embedding.T)
    anywhere = np.zeros(looks.shape)
    joined: Constellation | None = by_looks(looks)
    geometry = exact = None
    if config.geometry:
        spots = matched(a.spots, b.spots) if config.spots else (_NONE, _NONE)
        exact = _exact(a, b, spots, config)
        sure = exact is not None and exact.inliers.sum() >= config.sure_inliers
        own = a.proposals, b.proposals, looks, config.constellation
        if exact and sure:
            joined = join_along(exact.direction_rad, exact.heading_rad, *own)
        else:
            joined = join(*own)
        if joined is not None:
            geometry = _geometry_of(joined, a.rig)
        if geometry and exact and (sure or _agree(exact, geometry, config.agree_rad)):
            geometry = exact = replace(exact, baseline_heights=geometry.baseline_heights)
            anywhere = _shared(a, b, spots, exact, config)
        else:
            exact = None
    if joined is None:
        return None
    gain = joined.looks + joined.place
    if exact and config.spots:
        gain += np.log1p(anywhere) - _NO_SPOTS
    pairs = one_to_one(gain)
    if len(pairs) == 0:
        return None
    i, j = pairs.T
    inside = _inside(a, b, pairs)
    if exact:
        support = _guided(a, b, inside, exact, config) if config.sift else []
        within = matched_within(a.spots, b.spots, pairs, exact) if config.spots else []
    else:
        alone = config.sift and not config.geometry
        support = [_matched(a, b, own, config.ratio) for own in inside] if alone else []
        within = []
    support = support or [(_NONE, _NONE)] * len(pairs)
    within = within or [(_NONE, _NONE, np.empty(0, dtype=np.float32))] * len(pairs)
    rivals = gain.copy()
    rivals[i, j] = -np.inf
    rival = np.maximum(rivals[i].max(axis=1), rivals[:, j].max(axis=0)).clip(-30, 30)
    n_within = np.array([len(w[0]) for w in within])
    held_a, held_b = (
        np.bincount(r.spots.owner, minlength=len(r.proposals))[k] for r, k in ((a, i), (b, j))
    )
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
            np.log1p(n_within),
            n_within / np.maximum(np.minimum(held_a, held_b), 1),
            [w[2].mean() if len(w[2]) else 0.0 for w in within],
            np.log1p(anywhere[i, j]),
            anywhere[i, j] / np.maximum(anywhere.sum(axis=1)[i], 1),
            anywhere[i, j] / np.maximum(anywhere.sum(axis=0)[j], 1),
            np.full(len(pairs), np.log1p(int(exact.inliers.sum()) if exact else 0)),
        ]
    )
    return Candidates(
        pairs, features, tuple(support), tuple((w[0], w[1]) for w in within), geometry
    )


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


def _inside(a: LandmarkRecord, b: LandmarkRecord, pairs: NDArray[np.int64]) -> list[Matched]:
    """The keypoints of each pair's proposals."""
    own_a, own_b = (
        by_owner(owners(r.rig, r.proposals, r.features), len(r.proposals)) for r in (a, b)
    )
    return [(own_a[i], own_b[j]) for i, j in pairs]


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
    spots: Matched,
    config: JointConfig,
) -> PlanarGeometry | None:
    """The relative pose by matched keypoints and spots."""
    ia, ib = _anywhere(a, b, config) if config.sift else (_NONE, _NONE)
    fa, fb, sa, sb = a.features.take(ia), b.features.take(ib), *_taken(a, b, spots)
    return estimate(
        np.concatenate([fa.bearing_rad, sa.bearing_rad]), np.concatenate([fa.slope, sa.slope]),
        np.concatenate([fb.bearing_rad, sb.bearing_rad]), np.concatenate([fb.slope, sb.slope]),
        config.min_inliers, config.tolerance_rad,
    )  # fmt: skip


def _taken(a: LandmarkRecord, b: LandmarkRecord, spots: Matched) -> tuple[Spots, Spots]:
    return a.spots.take(spots[0]), b.spots.take(spots[1])


def _shared(
    a: LandmarkRecord,
    b: LandmarkRecord,
    spots: Matched,
    exact: PlanarGeometry,
    config: JointConfig,
) -> Array:
    """How many matched spots obey the relative pose, by the proposals they lie in: (n_a, n_b)."""
    sa, sb = _taken(a, b, spots)
    good = exact.obeyed(sa.bearing_rad, sa.slope, sb.bearing_rad, sb.slope, config.tolerance_rad)
    found = np.zeros((len(a.proposals), len(b.proposals)))
    np.add.at(found, (sa.owner[good], sb.owner[good]), 1)
    return found


def _guided(
    a: LandmarkRecord,
    b: LandmarkRecord,
    inside: list[Matched],
    geometry: PlanarGeometry,
    config: JointConfig,
) -> list[Matched]:
    """Of each pair's keypoints those that match where the relative pose lets them."""
    wide_a, wide_b = (r.features.descriptors.astype(np.float32) for r in (a, b))
    square_a, square_b = ((wide**2).sum(axis=1) for wide in (wide_a, wide_b))

    def alike(ia: NDArray[np.int64], ib: NDArray[np.int64]) -> NDArray[np.float32]:
        product = wide_a[ia] @ wide_b[ib].T
        return np.asarray(2 * product - square_a[ia][:, None] - square_b[ib])

    found = matched_under(
        geometry, a.features.directions, b.features.directions, inside, alike,
        -(config.alike_descriptors**2), config.guided_rad,
    )  # fmt: skip
    return [(ia, ib) for ia, ib, _ in found]


def _agree(exact: PlanarGeometry, rough: PlanarGeometry, within_rad: float) -> bool:
    turned = abs(float(wrap_angle_rad(exact.heading_rad - rough.heading_rad)))
    aside = abs(float(wrap_angle_rad(exact.direction_rad - rough.direction_rad)))
    return turned < within_rad and aside < within_rad + 3 * rough.direction_std_rad


def claims_of(
    a: LandmarkRecord, b: LandmarkRecord, found: Candidates, chosen: Sequence[int], score: Array
) -> list[CommonLandmark]:
    """The claims of the chosen pairs; score: (n,) that each of all pairs is right."""
    own = found.pairs[list(chosen)]
    regions = (regions_of(r.proposals, k, r.rig) for r, k in zip((a, b), own.T, strict=True))
    made = []
    for k, (i, j), region_a, region_b in zip(chosen, own.tolist(), *regions, strict=True):
        bearings = float(a.proposals.bearing_rad[i]), float(b.proposals.bearing_rad[j])
        support_a, support_b = found.support[k]
        spots_a, spots_b = found.spots[k]
        made.append(
            CommonLandmark(
                float(score[k]),
                region_a,
                region_b,
                support_a,
                support_b,
                found.geometry.ranges(*bearings) if found.geometry else None,
                _spoken_for(a, i, spots_a, support_a),
                _spoken_for(b, j, spots_b, support_b),
                len(spots_a),
            )
        )
    return made


def _spoken_for(
    own: LandmarkRecord, index: int, spots: NDArray[np.int64], keypoints: NDArray[np.int64]
) -> Array:
    """Directions of what matches; where nothing does, of all that the proposal covers."""
    if len(spots) + len(keypoints) == 0:
        return mask_of(own.proposals, index, own.rig)
    return np.concatenate([own.spots.directions[spots], own.features.directions[keypoints]])


def regions_of(proposals: Proposals, index: NDArray[np.int64], rig: CameraRig) -> list[Region]:
    """The regions of proposals (n,), each in the view that looks at it most directly."""
    right, left, low, high = proposals.box[index].T
    return view_boxes(np.stack([(left + right) / 2, left - right, low, high], axis=1), rig)


def mask_of(proposals: Proposals, index: int, rig: CameraRig) -> Array:
    """Directions of a proposal's cells, (k, 2) bearing_rad and slope."""
    cell = proposals.cell[proposals.owner == index]
    return np.column_stack(directions_of(cell, rig))

"""Common landmarks by appearance and by where they stand; with SIFT, or without.

Proposals of the two panoramas are joined by ``constellation``. Keypoints and spots that match
obey one relative pose and say it more exactly. Under it they are matched again inside joined
proposals. Each joined pair is a claim, scored by the probability that it is right.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vrchain.errors import ImageError
from vrchain.geometry import wrap_angle_rad
from vrchain.landmarks.extraction.proposer import Proposals, overlaps
from vrchain.landmarks.extraction.raster import directions_of
from vrchain.landmarks.extraction.record import LandmarkRecord, owners
from vrchain.landmarks.extraction.sift import mutual_matches
from vrchain.landmarks.matching.calibration import (
    LEAST_CLAIM,
    Calibration,
    chance_joined,
    load_calibration,
)
from vrchain.landmarks.matching.common import CommonLandmark, Comparison, Region, view_boxes
from vrchain.landmarks.matching.constellation import (
    Constellation,
    by_appearance,
    join,
    join_along,
    one_to_one,
)
from vrchain.landmarks.matching.epipolar import PlanarGeometry, estimate
from vrchain.landmarks.matching.guided import (
    NO_MATCH,
    Matched,
    by_owner,
    keypoints_within,
    spots_anywhere,
    spots_within,
)
from vrchain.panorama import CameraRig

Array = NDArray[np.float64]

_LARGEST, _RATIO_ANYWHERE = 700, 0.8  # keypoints that are matched all over, and their ratio test
_RATIO = 0.85  # of the ratio test within a pair
_TOLERANCE_RAD = 0.008  # of keypoints and spots that are matched all over, under one relative pose
_MIN_INLIERS = 8
_SURE_INLIERS = 60  # from which the relative pose that they agree on is beyond doubt
_AGREE_RAD = 0.2  # what fewer agree on must be this near to what proposals say
_NO_SPOTS = 0.5  # how much it speaks against a pair that it shares no spot, in log-odds
_SAME_BOX = 0.4  # intersection over union from which two claims are of one landmark


@dataclass(frozen=True)
class JointConfig:
    """How claims are made of joined proposals."""

    sift: bool = True  # whether keypoints take part
    spots: bool = True  # whether single spots do
    embedding: bool = True  # whether appearance does; without, by places alone
    geometry: bool = True  # whether places do; without, by appearance alone
    min_score: float = 0.75  # claims less likely than this to be right are not made
    min_joined: float = 0.5  # nor any of panoramas less likely than this to be joined rightly

    @property
    def name(self) -> str:
        """What tables call it."""
        verified = self.sift or self.spots
        parts = [*(("sift", "spots") if verified else ()), "embedding", "geometry"]
        left_out = [part for part in parts if not getattr(self, part)]
        return ", no ".join(["cnn+sift" if verified else "cnn", *left_out])


JOINT = {
    config.name: config
    for config in (
        JointConfig(sift=False, spots=False),
        JointConfig(),
        JointConfig(sift=False),
        JointConfig(spots=False),
        JointConfig(embedding=False),
        JointConfig(geometry=False),
    )
}
"""The default, and what it is with something left out, by their names in tables."""


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
    own = distinct(a, b, found.pairs, score)
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
    support: list[Matched]
    spots: list[Matched]
    geometry: PlanarGeometry | None


def candidates(
    a: LandmarkRecord, b: LandmarkRecord, config: JointConfig, calibration: Calibration
) -> Candidates | None:
    """What may be claimed of two panoramas, before it is scored; None: nothing."""
    appearance = np.zeros((len(a.proposals), len(b.proposals)))
    if config.embedding:
        appearance = calibration.appearance(a.proposals.embedding @ b.proposals.embedding.T)
    anywhere = np.zeros(appearance.shape)
    joined: Constellation | None = by_appearance(appearance)
    geometry = exact = None
    if config.geometry:
        spots = spots_anywhere(a.spots, b.spots) if config.spots else NO_MATCH
        exact = _exact(a, b, spots, config)
        sure = exact is not None and exact.inliers.sum() >= _SURE_INLIERS
        own = a.proposals, b.proposals, appearance
        if exact and sure:
            joined = join_along(exact.direction_rad, exact.heading_rad, *own)
        else:
            joined = join(*own)
        if joined is not None:
            geometry = _geometry_of(joined, a.rig)
        if geometry and exact and (sure or _agree(exact, geometry)):
            geometry = exact = replace(exact, baseline_heights=geometry.baseline_heights)
            anywhere = _shared(a, b, spots, exact)
        else:
            exact = None
    if joined is None:
        return None
    gain = joined.appearance + joined.place
    if exact and config.spots:
        gain += np.log1p(anywhere) - _NO_SPOTS
    pairs = one_to_one(gain)
    if len(pairs) == 0:
        return None
    i, j = pairs.T
    inside = _inside(a, b, pairs)
    support = [NO_MATCH] * len(pairs)
    within = [(*NO_MATCH, np.empty(0, dtype=np.float32))] * len(pairs)
    if exact and config.sift:
        support = keypoints_within(a.features, b.features, inside, exact)
    elif config.sift and not config.geometry:
        support = [_matched(a, b, own, _RATIO) for own in inside]
    if exact and config.spots:
        within = spots_within(a.spots, b.spots, pairs, exact)
    rivals = gain.copy()
    rivals[i, j] = -np.inf
    rival = np.maximum(rivals[i].max(axis=1), rivals[:, j].max(axis=0)).clip(-30, 30)
    n_within = np.array([len(w[0]) for w in within])
    held_a, held_b = (
        np.bincount(r.spots.owner, minlength=len(r.proposals))[k] for r, k in ((a, i), (b, j))
    )
    features = np.column_stack(
        [
            joined.appearance[i, j].clip(-10, 10),
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
    return Candidates(pairs, features, support, [(w[0], w[1]) for w in within], geometry)


def distinct(
    a: LandmarkRecord, b: LandmarkRecord, pairs: NDArray[np.int64], score: Array
) -> list[int]:
    """Which of the pairs (n, 2) stay, surest first: none overlaps with a surer one in A or in B.

    A landmark is proposed whole and in pieces; one claim of it is enough, and the others are worse.
    """
    same = np.zeros((len(pairs), len(pairs)), dtype=bool)
    for record, index in zip((a, b), pairs.T, strict=True):
        right, left, low, high = record.proposals.box[index].T
        boxes = np.stack([-left, -high, -right, -low], axis=1)
        same |= overlaps(boxes, boxes, 2 * np.pi) > _SAME_BOX
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


def _matched(a: LandmarkRecord, b: LandmarkRecord, own: Matched, ratio: float) -> Matched:
    described_a, described_b = a.features.descriptors[own[0]], b.features.descriptors[own[1]]
    ia, ib = mutual_matches(described_a, described_b, ratio)
    return own[0][ia], own[1][ib]


def _exact(
    a: LandmarkRecord, b: LandmarkRecord, spots: Matched, config: JointConfig
) -> PlanarGeometry | None:
    """The relative pose by matched spots and keypoints, of which the largest say most."""
    keypoints = NO_MATCH
    if config.sift:
        of_a, of_b = (np.argsort(-r.features.size_rad, kind="stable")[:_LARGEST] for r in (a, b))
        keypoints = _matched(a, b, (of_a, of_b), _RATIO_ANYWHERE)
    seen_a, seen_b = (
        np.concatenate([r.features.directions[own], r.spots.directions[of_spots]])
        for r, own, of_spots in zip((a, b), keypoints, spots, strict=True)
    )
    return estimate(seen_a, seen_b, _MIN_INLIERS, _TOLERANCE_RAD)


def _shared(a: LandmarkRecord, b: LandmarkRecord, spots: Matched, exact: PlanarGeometry) -> Array:
    """How many matched spots obey the relative pose, by the proposals they lie in: (n_a, n_b)."""
    seen_a, seen_b = a.spots.take(spots[0]), b.spots.take(spots[1])
    good = exact.obeyed(seen_a.directions, seen_b.directions, _TOLERANCE_RAD)
    found = np.zeros((len(a.proposals), len(b.proposals)))
    np.add.at(found, (seen_a.owner[good], seen_b.owner[good]), 1)
    return found


def _agree(exact: PlanarGeometry, rough: PlanarGeometry) -> bool:
    turned = abs(float(wrap_angle_rad(exact.heading_rad - rough.heading_rad)))
    aside = abs(float(wrap_angle_rad(exact.direction_rad - rough.direction_rad)))
    return turned < _AGREE_RAD and aside < _AGREE_RAD + 3 * rough.direction_std_rad


def claims_of(
    a: LandmarkRecord, b: LandmarkRecord, found: Candidates, chosen: Sequence[int], score: Array
) -> list[CommonLandmark]:
    """The claims of the chosen pairs; score: (n,) that each of all pairs is right."""
    own = found.pairs[list(chosen)]
    regions = (regions_of(r.proposals, k, r.rig) for r, k in zip((a, b), own.T, strict=True))
    made = []
    for k, (i, j), region_a, region_b in zip(chosen, own.tolist(), *regions, strict=True):
        bearings = float(a.proposals.bearing_rad[i]), float(b.proposals.bearing_rad[j])
        (support_a, support_b), (spots_a, spots_b) = found.support[k], found.spots[k]
        ranges = found.geometry.ranges(*bearings) if found.geometry else None
        masks = _spoken_for(a, i, spots_a, support_a), _spoken_for(b, j, spots_b, support_b)
        regions_k = region_a, region_b, support_a, support_b
        made.append(CommonLandmark(float(score[k]), *regions_k, ranges, *masks, len(spots_a)))
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

"""Claims of common landmarks: of joined proposals, and of keypoints that agree and lie together."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vrchain.geometry import circular_mean_rad, wrap_angle_rad
from vrchain.landmarks.extraction.proposer import Proposals, overlaps
from vrchain.landmarks.extraction.raster import directions_of
from vrchain.landmarks.extraction.record import LandmarkRecord, owners
from vrchain.landmarks.matching.common import (
    CommonLandmark,
    MatchConfig,
    Region,
    group_by_nearness,
    panorama_region,
    places_of,
    view_boxes,
)
from vrchain.landmarks.matching.constellation import Constellation
from vrchain.landmarks.matching.epipolar import PlanarGeometry, baseline_by_ground
from vrchain.landmarks.matching.guided import Matched, keypoints_under
from vrchain.landmarks.matching.poses import NO_RIVAL_RAD
from vrchain.panorama import CameraRig

Array = NDArray[np.float64]

_SAME_BOX = 0.4  # intersection over union from which two claims are of one landmark
CLAIM_SIGNS, GROUP_SIGNS = 16, 7  # numbers that speak for a joined pair, and for a group
JOINED_SIGNS = 6  # and for a pose once claims are made under it
SETTLED_SIGNS = CLAIM_SIGNS + 17  # and for a joined pair under the pose that was chosen
_GROUP_RAD, _LEAST = 0.08, 3  # keypoints that lie so near in both belong together; in a group
_TOPS = -1.0, 3.0  # of groups, in camera heights above the cameras, between which they differ
_LOWEST_TOP = -0.85  # of a group, in camera heights above the cameras: the ground is at -1
_OFF = np.log(100.0)  # of a range from what the pose says, in logarithms, at most
_TYPICAL_M, _TYPICAL_HEIGHTS = 20.0, 20.0  # a distance that is not known
_HEARD = 0.3  # score from which claims are heard when the pose is judged
_FARTHEST = 100.0  # in camera heights: what is farther, or nobody knows how far, is scenery


@dataclass(frozen=True, eq=False)
class Candidates:
    """Joined pairs (n, 2), what speaks for each (n, features), their matched keypoints and spots.

    geometry: the relative pose; None where places took no part. pose_log_odds: that it is right, by
    matches alone, 0 where there are none. keypoints: the matched ones that obey it, anywhere.
    """

    pairs: NDArray[np.int64]
    features: Array
    support: list[Matched]
    spots: list[Matched]
    geometry: PlanarGeometry | None
    pose_log_odds: float
    keypoints: Matched


def claim_signs(
    a: LandmarkRecord,
    b: LandmarkRecord,
    joined: Constellation,
    gain: Array,
    pairs: NDArray[np.int64],
    support: list[Matched],
    within: list[tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float32]]],
    anywhere: Array,
    likely: float,
) -> Array:
    """What speaks for each joined pair: (n, CLAIM_SIGNS)."""
    i, j = pairs.T
    if len(pairs) == 0:
        return np.empty((0, CLAIM_SIGNS))
    rivals = gain.copy()
    rivals[i, j] = -np.inf
    rival = np.maximum(rivals[i].max(axis=1), rivals[:, j].max(axis=0)).clip(-30, 30)
    n_within = np.array([len(w[0]) for w in within])
    held_a, held_b = (
        np.bincount(r.spots.owner, minlength=len(r.proposals))[k] for r, k in ((a, i), (b, j))
    )
    return np.column_stack(
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
            np.full(len(pairs), likely),
        ]
    )


def settled_signs(
    a: LandmarkRecord, b: LandmarkRecord, found: Candidates, chosen: Sequence[int], chance: float
) -> Array:
    """What speaks for the chosen pairs once their pose is kept: (n, SETTLED_SIGNS).

    chance: of the pose. Beside what spoke for them before: how large, far and high both proposals
    are, by themselves and by the pose, and whether that is one thing.
    """
    index = found.pairs[list(chosen)].T
    sides = list(zip((a.proposals, b.proposals), index, strict=True))
    right, left, low, high = np.array([seen.box[k].T for seen, k in sides]).swapaxes(0, 1)
    wide, tall = np.log(left - right), np.log(high - low)
    far_m = np.array([seen.range_m[k] for seen, k in sides], dtype=float)
    bearings = [seen.bearing_rad[k] for seen, k in sides]
    off, parallax, baseline_m = np.zeros_like(far_m), np.zeros(far_m.shape[1]), np.nan
    if found.geometry is not None:
        baseline_m = found.geometry.baseline_heights * a.rig.camera_height_m
        told_m = np.array([found.geometry.ranges(*pair) for pair in zip(*bearings, strict=True)])
        with np.errstate(all="ignore"):
            off = np.abs(np.log(told_m.reshape(-1, 2).T * baseline_m / far_m).clip(-_OFF, _OFF))
        off = np.where(np.isfinite(off), off, 0.0)
        parallax = np.abs(np.sin(bearings[0] - bearings[1] - found.geometry.heading_rad))
    baseline_m = float(np.clip(np.nan_to_num(baseline_m, nan=_TYPICAL_M), 0.5, 100.0))
    counts = [np.log(max(1, len(r.proposals))) for r in (a, b)]
    return np.column_stack(
        [
            found.features[list(chosen)],
            np.abs(np.diff(wide + np.log(far_m), axis=0)[0]),
            np.abs(np.diff(tall + np.log(far_m), axis=0)[0]),
            *off,
            np.full(len(chosen), np.log(baseline_m)),
            parallax,
            np.log(far_m.min(axis=0)),
            wide.min(axis=0),
            wide.max(axis=0),
            tall.min(axis=0),
            np.full((len(chosen), 2), counts),
            low.min(axis=0),
            high.max(axis=0),
            *(low * far_m / a.rig.camera_height_m),
            np.full(len(chosen), log_odds_of(chance)),
        ]
    )


def joined_signs(
    a: LandmarkRecord, b: LandmarkRecord, options: Sequence[Candidates], scores: Sequence[Array]
) -> Array:
    """What speaks for each pose being right, once claims are made: (k, JOINED_SIGNS).

    scores: of each pose's claims. Of panoramas that share nothing, chance mostly finds poses near
    to each other; those would have more in common, so the distance counts too.
    """
    few = max(1, min(len(a.proposals), len(b.proposals)))
    likely = np.array([found.pose_log_odds for found in options])
    speaks = np.array([(score[score >= _HEARD] ** 2).sum() for score in scores])
    heights = np.array([f.geometry.baseline_heights if f.geometry else np.nan for f in options])
    heights = np.where(np.isfinite(heights), heights, _TYPICAL_HEIGHTS)
    rivals = ~np.array([[_near(one, other) for other in options] for one in options])

    def lead(values: Array) -> Array:
        """Over the best of the other poses; infinite where there is none."""
        return values - np.where(rivals, values[None], -np.inf).max(axis=1)

    return np.column_stack(
        [
            likely,
            np.log(speaks + 0.1),
            np.log(speaks / few + 0.01),
            np.log(heights.clip(0.5, 50.0)),
            lead(likely).clip(-4, 4),
            lead(np.log(speaks + 0.5)).clip(-2, 2),
        ]
    )


def _near(one: Candidates, other: Candidates) -> bool:
    """Whether two poses are nearly the same."""
    if one.geometry is None or other.geometry is None:
        return one is other
    return one.geometry.near(other.geometry, NO_RIVAL_RAD)


def log_odds_of(chance: float) -> float:
    """Of a probability, kept finite."""
    sure = min(max(chance, 1e-4), 1 - 1e-4)
    return float(np.log(sure / (1 - sure)))


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


@dataclass(frozen=True, eq=False)
class Group:
    """Matched keypoints that lie together.

    known: how many of them had matched before there was a pose. ranges: from A and from B, in
    distances between them; None where rays hardly meet. heights: the larger one in heights of the
    cameras. top_heights: of its highest point above the cameras, in the same; the ground is at -1.
    wide_rad: over how many bearings it extends. told: the share of all that agree that lies in
    claimed proposals: where that is small, the network knows little of the place.
    """

    keypoints: Matched
    known: int
    ranges: tuple[float, float] | None
    heights: float
    top_heights: float
    wide_rad: float
    told: float


def grouped(
    a: LandmarkRecord, b: LandmarkRecord, found: Candidates, chosen: Sequence[int]
) -> list[Group]:
    """Keypoints that agree on the pose, lie in no chosen pair's proposals, and lie together.

    Those that matched all over, and those that match where the pose lets them. A group stands up
    from the ground. How high that is, is told by the lowest of what agrees, or else by the horizon:
    cameras are upright.
    """
    geometry = found.geometry
    if geometry is None or len(found.keypoints[0]) < _LEAST:
        return []
    more = keypoints_under(a.features, b.features, geometry)
    new = ~(np.isin(more[0], found.keypoints[0]) | np.isin(more[1], found.keypoints[1]))
    index_a, index_b = (
        np.concatenate([old, own[new]]) for old, own in zip(found.keypoints, more, strict=True)
    )
    seen_a, seen_b = a.features.take(index_a), b.features.take(index_b)
    by_ground = baseline_by_ground(geometry, seen_a.directions, seen_b.directions)
    known = np.isfinite(by_ground)
    baseline_heights = by_ground if known else geometry.baseline_heights
    places_a, places_b = (places_of(f) for f in (seen_a, seen_b))
    claimed = found.pairs[list(chosen)].T
    in_a, in_b = (
        np.isin(owners(r.rig, r.proposals, seen), own)
        for r, seen, own in zip((a, b), (seen_a, seen_b), claimed, strict=True)
    )
    free, told = np.flatnonzero(~(in_a | in_b)), float((in_a | in_b).mean())
    groups = []
    for members in group_by_nearness(places_a[free], places_b[free], _GROUP_RAD):
        if len(members) < _LEAST:
            continue
        own = free[members]
        sides = seen_a.take(own), seen_b.take(own)
        middles = circular_mean_rad(sides[0].bearing_rad), circular_mean_rad(sides[1].bearing_rad)
        ranges = geometry.ranges(*middles)
        far, tops = max(ranges), [float(side.slope.max()) for side in sides]
        top = max(top * r for top, r in zip(tops, ranges, strict=True)) * baseline_heights
        top = float(np.clip(np.nan_to_num(top), *_TOPS))
        if not (
            top > _LOWEST_TOP if known and np.isfinite(far) else min(tops) > MatchConfig.min_slope
        ):
            continue
        wide_rad = max(
            float(np.ptp(wrap_angle_rad(side.bearing_rad - middle)))
            for side, middle in zip(sides, middles, strict=True)
        )
        groups.append(Group(
            (index_a[own], index_b[own]), int((own < len(found.keypoints[0])).sum()),
            ranges if far <= MatchConfig.max_range else None,
            float(far * baseline_heights), top, wide_rad, told,
        ))  # fmt: skip
    return sorted(groups, key=lambda group: -len(group.keypoints[0]))


def group_signs(groups: Sequence[Group], chance: float) -> Array:
    """What speaks for each (n, GROUP_SIGNS): sizes, width, range, top, the chance of the pose."""
    signs = [
        (np.log(len(g.keypoints[0])), np.log1p(g.known), np.log(g.wide_rad + 0.01),
         np.log(np.clip(np.nan_to_num(g.heights, nan=_FARTHEST), 0.5, _FARTHEST)),
         g.top_heights, g.told, log_odds_of(chance))
        for g in groups
    ]  # fmt: skip
    return np.array(signs, dtype=float).reshape(len(groups), GROUP_SIGNS)


def claims_of_groups(
    a: LandmarkRecord, b: LandmarkRecord, groups: Sequence[Group], score: Array, min_score: float
) -> list[CommonLandmark]:
    """The claims of groups likely enough to be right; score: (n,) of each."""
    claims = []
    for group, sure in zip(groups, score.tolist(), strict=True):
        if sure >= min_score:
            own_a, own_b = group.keypoints
            regions = (
                panorama_region(a.features.take(own_a), a.rig),
                panorama_region(b.features.take(own_b), b.rig),
            )
            claims.append(CommonLandmark(sure, *regions, own_a, own_b, group.ranges))
    return claims

"""Common landmarks by appearance and by where they stand; with SIFT, or without.

Matched keypoints and spots speak for several relative poses (``poses``). Under each of the
likeliest, proposals are joined by ``constellation``, and keypoints and spots are matched again
inside joined proposals. The pose whose claims speak most is kept, if it is likely to be right. Each
pair joined under it is a claim, scored by the probability that it is right; and so is each group of
keypoints that agree on the pose where nothing was proposed.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from vrchain.errors import ImageError
from vrchain.landmarks.extraction.record import LandmarkRecord, owners
from vrchain.landmarks.extraction.sift import mutual_matches
from vrchain.landmarks.matching.calibration import Calibration, Worth, load_calibration
from vrchain.landmarks.matching.claims import (
    Candidates,
    claim_signs,
    claims_of,
    claims_of_groups,
    distinct,
    group_signs,
    grouped,
    joined_signs,
    settled_signs,
)
from vrchain.landmarks.matching.common import CommonLandmark, Comparison
from vrchain.landmarks.matching.constellation import (
    Constellation,
    by_appearance,
    join,
    join_along,
    one_to_one,
)
from vrchain.landmarks.matching.epipolar import PlanarGeometry
from vrchain.landmarks.matching.guided import (
    NO_MATCH,
    Matched,
    by_owner,
    keypoints_within,
    spots_within,
)
from vrchain.landmarks.matching.levelling import levelled, tilts
from vrchain.landmarks.matching.poses import (
    NO_RIVAL_RAD,
    Matches,
    PoseHypothesis,
    matches_of,
    pose_hypotheses,
)
from vrchain.panorama import CameraRig

Array = NDArray[np.float64]
Records = tuple[LandmarkRecord, LandmarkRecord]

_RATIO = 0.85  # of the ratio test within a pair, where no pose is known
_TOLERANCE_RAD = 0.008  # of spots under one relative pose
_NO_SPOTS = 0.5  # how much it speaks against a pair that it shares no spot, in log-odds
_POSES, _LESS_LIKELY = 3, 3.0  # relative poses whose claims are made; log-odds below the likeliest
_NO_POSE = -8.0  # log-odds of a pose that no matches speak for; and of any, at most as far from 0


@dataclass(frozen=True)
class JointConfig:
    """How claims are made of joined proposals."""

    sift: bool = True  # whether keypoints take part
    spots: bool = True  # whether single spots do
    embedding: bool = True  # whether appearance does; without, by places alone
    geometry: bool = True  # whether places do; without, by appearance alone
    min_score: float = 0.85  # claims less likely than this to be right are not made
    min_surest: float = 0.6  # where there is none, the surest is made from this on
    min_joined: float = 0.5  # nor any of panoramas less likely than this to be joined rightly
    min_pose: float = -np.inf  # poses of less log-odds by their matches alone are not looked into

    @property
    def verified(self) -> bool:
        """Whether matches take part."""
        return self.sift or self.spots

    @property
    def name(self) -> str:
        """What tables call it."""
        parts = [*(("sift", "spots") if self.verified else ()), "embedding", "geometry"]
        left_out = [part for part in parts if not getattr(self, part)]
        return ", no ".join(["cnn+sift" if self.verified else "cnn", *left_out])


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
    matches = matched(a, b, config)
    level = levelled(a, b, tilts(a, b, matches))
    options = judged(level, matches, config, calibration)
    if not options:
        return Comparison((), None)
    best = options[0]
    if best.chance < config.min_joined:
        return Comparison((), best.found.geometry, best.chance)
    made = claims_under(level, best, config, calibration.of(config.name), seen=(a, b))
    return Comparison(tuple(made), best.found.geometry, best.chance)


def matched(a: LandmarkRecord, b: LandmarkRecord, config: JointConfig) -> Matches:
    """What matches all over two panoramas, of what may take part."""
    return matches_of(a, b, config.geometry and config.sift, config.geometry and config.spots)


@dataclass(frozen=True, eq=False)
class Judged:
    """What may be claimed under one pose, and how likely all that is right.

    score: (n,) of each pair. own: which pairs are distinct, surest first. chance: of the pose.
    """

    found: Candidates
    score: Array
    own: list[int]
    chance: float


def judged(
    level: Records, matches: Matches, config: JointConfig, calibration: Calibration
) -> list[Judged]:
    """What may be claimed under each likely pose, the likeliest first."""
    worth, (a, b) = calibration.of(config.name), level
    options = list(candidates(a, b, matches, config, calibration))
    scores = [worth.claims.probability(found.features) for found in options]
    owns = [
        distinct(a, b, found.pairs, score) for found, score in zip(options, scores, strict=True)
    ]
    if not options:
        return []
    claimed = [score[own] for score, own in zip(scores, owns, strict=True)]
    chances = worth.joined.probability(joined_signs(a, b, options, claimed))
    made = map(Judged, options, scores, owns, chances.tolist())
    return sorted(made, key=lambda one: -one.chance)


def claims_under(
    level: Records, best: Judged, config: JointConfig, worth: Worth, seen: Records
) -> list[CommonLandmark]:
    """What is claimed under the pose that is kept, surest first, where it was ``seen``."""
    score = settled(*level, best, worth)

    def claimed(least: float) -> list[CommonLandmark]:
        chosen = [k for k in best.own if score[k] >= least]
        groups = grouped(*level, best.found, chosen)
        sure = worth.groups.probability(group_signs(groups, best.chance))
        made = claims_of(*seen, best.found, chosen, score)
        made += claims_of_groups(*seen, groups, sure, least)
        return sorted(made, key=lambda claim: -claim.score)

    least = min(config.min_surest, config.min_score)
    made = claimed(config.min_score)
    return made if made or least == config.min_score else claimed(least)[:1]


def settled(a: LandmarkRecord, b: LandmarkRecord, best: Judged, worth: Worth) -> Array:
    """How likely each pair is right, (n,), now that its pose is kept; 0 of what is not distinct."""
    score = np.zeros(len(best.score))
    score[best.own] = worth.settled.probability(
        settled_signs(a, b, best.found, best.own, best.chance)
    )
    return score


def candidates(
    a: LandmarkRecord,
    b: LandmarkRecord,
    matches: Matches,
    config: JointConfig,
    calibration: Calibration,
) -> Iterator[Candidates]:
    """What may be claimed of two panoramas, before it is scored, under each likely pose."""
    appearance = np.zeros((len(a.proposals), len(b.proposals)))
    if config.embedding:
        appearance = calibration.appearance(a.proposals.embedding @ b.proposals.embedding.T)
    if not config.geometry:
        yield _candidates(a, b, config, by_appearance(appearance), None, matches, 0.0)
        return
    posed = pose_hypotheses(a, b, matches) if config.verified else []
    own = a.proposals, b.proposals, appearance
    if not posed:
        likely = _NO_POSE if config.verified else 0.0
        rough = join(*own) if likely > config.min_pose else None
        if rough is not None:
            yield _candidates(a, b, config, rough, None, matches, likely)
        return
    for hypothesis, likely in likeliest(posed, config, calibration):
        exact = hypothesis.geometry
        joined = join_along(exact.direction_rad, exact.heading_rad, *own)
        yield _candidates(a, b, config, joined, hypothesis, matches, likely)


def likeliest(
    posed: list[PoseHypothesis], config: JointConfig, calibration: Calibration
) -> list[tuple[PoseHypothesis, float]]:
    """The poses worth a closer look, and the log-odds that they are right, likeliest first.

    Of those that are no rivals only the one that most keypoints obey: it is the most exact.
    """
    log_odds = calibration.of(config.name).poses.log_odds(np.stack([p.signs for p in posed]))
    order = np.argsort(-log_odds, kind="stable")
    least = max(log_odds[order[0]] - _LESS_LIKELY, config.min_pose)
    left = order[log_odds[order] > least].tolist()
    found: list[tuple[PoseHypothesis, float]] = []
    while left and len(found) < _POSES:
        first = posed[left[0]].geometry
        same = [k for k in left if posed[k].geometry.near(first, NO_RIVAL_RAD)]
        best = max(same, key=lambda k: len(posed[k].keypoints[0]))
        found.append((posed[best], float(log_odds[best].clip(_NO_POSE, -_NO_POSE))))
        left = [k for k in left if k not in same]
    return found


def _candidates(
    a: LandmarkRecord,
    b: LandmarkRecord,
    config: JointConfig,
    joined: Constellation,
    posed: PoseHypothesis | None,
    matches: Matches,
    likely: float,
) -> Candidates:
    """What may be claimed under one pose, which matches speak for, or the constellation alone."""
    geometry = _geometry_of(joined, a.rig) if config.geometry else None
    exact = None
    anywhere = np.zeros(joined.appearance.shape)
    gain = joined.appearance + joined.place
    if posed is not None and geometry is not None:
        heights = geometry.baseline_heights
        geometry = exact = replace(posed.geometry, baseline_heights=heights)
        if config.spots:
            anywhere = _shared(a, b, matches.spots, exact)
            gain = gain + np.log1p(anywhere) - _NO_SPOTS
    pairs = one_to_one(gain)
    support = [NO_MATCH] * len(pairs)
    within = [(*NO_MATCH, np.empty(0, dtype=np.float32))] * len(pairs)
    inside = _inside(a, b, pairs) if config.sift else []
    if exact and config.sift:
        support = keypoints_within(a.features, b.features, inside, exact)
    elif config.sift and not config.geometry:
        support = [_matched(a, b, own, _RATIO) for own in inside]
    if exact and config.spots and len(pairs):
        within = spots_within(a.spots, b.spots, pairs, exact)
    features = claim_signs(a, b, joined, gain, pairs, support, within, anywhere, likely)
    return Candidates(
        pairs, features, support, [(w[0], w[1]) for w in within], geometry, likely,
        posed.keypoints if posed else NO_MATCH,
    )  # fmt: skip


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


def _shared(a: LandmarkRecord, b: LandmarkRecord, spots: Matched, exact: PlanarGeometry) -> Array:
    """How many matched spots obey the relative pose, by the proposals they lie in: (n_a, n_b)."""
    seen_a, seen_b = a.spots.take(spots[0]), b.spots.take(spots[1])
    good = exact.obeyed(seen_a.directions, seen_b.directions, _TOLERANCE_RAD)
    found = np.zeros((len(a.proposals), len(b.proposals)))
    np.add.at(found, (seen_a.owner[good], seen_b.owner[good]), 1)
    return found

"""What the network's answers are worth, by claims on suburbs kept for choosing.

Pairs of panoramas near and far, some of two different suburbs; every pair of proposals that might
be claimed is judged by ground truth.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm.auto import tqdm

from vrchain.geometry import Pose
from vrchain.landmarks.extraction.record import LandmarkRecord, examine
from vrchain.landmarks.matching.calibration import Calibration, Logistic, Worth, fit
from vrchain.landmarks.matching.claims import (
    CLAIM_SIGNS,
    GROUP_SIGNS,
    JOINED_SIGNS,
    SETTLED_SIGNS,
    Candidates,
    claims_of,
    claims_of_groups,
    distinct,
    group_signs,
    grouped,
    joined_signs,
    mask_of,
    settled_signs,
)
from vrchain.landmarks.matching.common import CommonLandmark, Comparison
from vrchain.landmarks.matching.epipolar import PlanarGeometry
from vrchain.landmarks.matching.joint import (
    JOINT,
    JointConfig,
    Judged,
    candidates,
    matched,
    settled,
)
from vrchain.landmarks.matching.poses import SIGNS, PoseHypothesis, pose_hypotheses
from vrchain.landmarks.quality import POSE_RIGHT_DEG, Verdict, judge, pose_errors_deg
from vrchain.landmarks.training.examples import varied_suburb
from vrchain.panorama import CameraRig
from vrchain.seeding import generator
from vrchain.world import Scene
from vrchain.world.truth import GroundTruth

Array = NDArray[np.float64]

_SPACING_M = (1.0, 50.0)
_TRIES = 1000
_N_SIGNS = len(SIGNS), CLAIM_SIGNS, JOINED_SIGNS, SETTLED_SIGNS, GROUP_SIGNS  # as in ``Worth``
_SUREST, _MOSTLY = 5, 0.5  # claims, and the share of them that is right, without a pose to judge


@dataclass(frozen=True)
class CalibrateConfig:
    """On what the answers are weighed."""

    seed: int = 1000  # model choice: 1,000..1,999
    suburbs: int = 72
    suburbs_of_parts: int = 24  # of these, for variants with something left out
    pairs: int = 8  # of each suburb, spacing log-uniform


@dataclass(frozen=True, eq=False)
class Sight:
    """A panorama's record, the pose it was taken from, and the object each proposal shows.

    shows: (n,) object id, -1 where most of it, at least half, is no one landmark.
    """

    record: LandmarkRecord
    pose: Pose
    shows: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Asked:
    """Two sights and what is true of them; truth is None where they share nothing."""

    truth: GroundTruth | None
    a: Sight
    b: Sight

    def pose_right(self, geometry: PlanarGeometry | None) -> bool:
        """Whether a relative pose is near the true one."""
        off_deg = pose_errors_deg(geometry, self.a.pose, self.b.pose)
        return self.truth is not None and bool(np.less(off_deg, POSE_RIGHT_DEG).all())

    def verdicts(self, claims: list[CommonLandmark]) -> list[Verdict] | None:
        """Of claims that are made of the two; None: they share nothing."""
        if self.truth is None:
            return None
        records = self.a.record, self.b.record
        features = records[0].features, records[1].features
        found = Comparison(tuple(claims), None)
        return judge(found, self.truth, (self.a.pose, self.b.pose), features, records[0].rig)


def calibrate(weights: Path, config: CalibrateConfig) -> Calibration:
    """The calibration of a weights file."""
    seen: list[tuple[GroundTruth, list[tuple[Sight, Sight]]]] = []
    for k in tqdm(range(config.suburbs), desc="suburbs to weigh by", unit="", disable=None):
        scene = varied_suburb(config.seed, k)
        truth = GroundTruth(scene)
        seen.append((truth, list(_sights(scene, truth, weights, config, k))))
    return weigh(_asked(seen), _asked(seen[: config.suburbs_of_parts]))


def _asked(seen: list[tuple[GroundTruth, list[tuple[Sight, Sight]]]]) -> list[Asked]:
    """The pairs of suburbs, and some of two different ones."""
    firsts = [found[k][0] for _, found in seen for k in (0, 1)]
    known = [Asked(truth, a, b) for truth, found in seen for a, b in found]
    return known + [Asked(None, a, b) for a, b in zip(firsts[:-2], firsts[2:], strict=True)]


def weigh(asked: list[Asked], fewer: list[Asked]) -> Calibration:
    """The calibration by pairs of known truth; fewer: for variants with something left out."""
    known = [(one.a, one.b) for one in asked if one.truth is not None]
    calibration = Calibration(*_worth_of_appearance(known))
    for joint in JOINT.values():
        own = asked if joint == JointConfig() else fewer
        calibration.worth[joint.name] = _worth_of(joint, own, calibration)
    return calibration


def _worth_of(joint: JointConfig, asked: list[Asked], calibration: Calibration) -> Worth:
    """How likely poses, claims and groups of one variant are right, one resting on the other."""
    bar = partial(tqdm, asked, unit="", disable=None)
    worth = Worth(*[_even(n) for n in _N_SIGNS])
    if joint.verified and joint.geometry:
        posed = [
            (one, hypothesis)
            for one in bar(desc=f"{joint.name}: poses")
            for hypothesis in _hypotheses(one, joint)
        ]
        known = np.stack([hypothesis.signs for _, hypothesis in posed])
        right = np.array([one.pose_right(hypothesis.geometry) for one, hypothesis in posed])
        worth = replace(worth, poses=fit(known, right))
    rough = replace(calibration, worth={joint.name: worth})

    def under(one: Asked) -> Iterator[Candidates]:
        a, b = one.a.record, one.b.record
        return candidates(a, b, matched(a, b, joint), joint, rough)

    options = [
        [_Weighed(one, found, _verdicts(one, found)) for found in under(one)]
        for one in bar(desc=f"{joint.name}: claims")
    ]
    weighed = [w for of_pair in options for w in of_pair]
    first = fit(np.concatenate([w.found.features for w in weighed]),
                np.concatenate([w.right for w in weighed]))  # fmt: skip
    kept = [w.distinct(first.probability(w.found.features)) for w in weighed]
    worth = replace(worth, claims=fit(
        np.concatenate([w.found.features[k] for w, k in zip(weighed, kept, strict=True)]),
        np.concatenate([w.right[k] for w, k in zip(weighed, kept, strict=True)]),
    ))  # fmt: skip
    signs, unknown, rightly, made = [], [], [], []
    for of_pair in filter(None, options):
        a, b = of_pair[0].asked.a.record, of_pair[0].asked.b.record
        scores = [worth.claims.probability(w.found.features) for w in of_pair]
        chosen = [distinct(a, b, w.found.pairs, s) for w, s in zip(of_pair, scores, strict=True)]
        claimed = [score[own] for score, own in zip(scores, chosen, strict=True)]
        found = [w.found for w in of_pair]
        signs.append(joined_signs(a, b, found, claimed))
        rightly += [
            w.asked.pose_right(w.found.geometry) if joint.geometry else w.mostly_right(own)
            for w, own in zip(of_pair, chosen, strict=True)
        ]
        unknown.append(joined_signs(a, b, found, [np.empty(0)] * len(found)))
        made.append(list(zip(of_pair, scores, chosen, strict=True)))
    # elsewhere the network may know little: without claims, matches have to do
    known_too = [*signs, *(unknown if joint.verified and joint.geometry else [])]
    both = rightly * (len(known_too) // len(signs))
    worth = replace(worth, joined=fit(np.concatenate(known_too), np.array(both)))
    best: list[tuple[_Weighed, Judged]] = []
    for judged, own_signs in zip(made, signs, strict=True):
        chances = worth.joined.probability(own_signs)
        w, score, own = judged[int(chances.argmax())]
        best.append((w, Judged(w.found, score, own, float(chances.max()))))
    labelled = [(w, one, w.distinct(one.score)) for w, one in best]
    worth = replace(worth, settled=fit(
        np.concatenate([w.signs_of(one, k) for w, one, k in labelled]),
        np.concatenate([w.right[k] for w, _, k in labelled]),
        products=True,
    ))  # fmt: skip
    return replace(worth, groups=_worth_of_groups(joint, worth, best))


def _worth_of_groups(
    joint: JointConfig, worth: Worth, best: list[tuple["_Weighed", Judged]]
) -> Logistic:
    """Also as if nothing were proposed: elsewhere the network may know little."""
    signs, right = [], []
    for w, one in best:
        a, b = w.asked.a.record, w.asked.b.record
        if one.chance < joint.min_joined:
            continue
        score = settled(a, b, one, worth)
        sure = [k for k in one.own if score[k] >= joint.min_score]
        for pairs in (sure, list[int]()) if sure else (sure,):
            members = grouped(a, b, w.found, pairs)
            made_so_far = claims_of(a, b, w.found, pairs, score)
            claims = claims_of_groups(a, b, members, np.ones(len(members)), 0.0)
            verdicts = w.asked.verdicts([*made_so_far, *claims])
            told = verdicts[len(made_so_far) :] if verdicts else []
            new = np.array([not v.duplicate for v in told] or [True] * len(claims), dtype=bool)
            signs.append(group_signs(members, one.chance)[new])
            right += [v.right for v in told if not v.duplicate] or [False] * int(new.sum())
    return fit(np.concatenate(signs), np.array(right)) if right else _even(GROUP_SIGNS)


def _even(n: int) -> Logistic:
    """What says nothing, of so many signs."""
    return Logistic(np.zeros(n), np.ones(n), np.zeros(n), 0.0)


def _hypotheses(one: Asked, joint: JointConfig) -> list[PoseHypothesis]:
    a, b = one.a.record, one.b.record
    return pose_hypotheses(a, b, matched(a, b, joint))


@dataclass(frozen=True, eq=False)
class _Weighed:
    """Joined pairs of two panoramas and what truth says of them; None: nothing is right."""

    asked: Asked
    found: Candidates
    verdicts: list[Verdict] | None

    @property
    def right(self) -> NDArray[np.bool_]:
        if self.verdicts is None:
            return np.zeros(len(self.found.pairs), dtype=bool)
        return np.array([v.right for v in self.verdicts], dtype=bool)

    def mostly_right(self, own: list[int]) -> bool:
        """Of the surest claims, which take a pose's place where there is none to judge."""
        return bool(own) and bool(self.right[own[:_SUREST]].mean() > _MOSTLY)

    def signs_of(self, one: Judged, chosen: NDArray[np.int64]) -> Array:
        """What speaks for the chosen pairs under the pose that is kept."""
        own = self.asked.a.record, self.asked.b.record
        return settled_signs(*own, self.found, chosen.tolist(), one.chance)

    def distinct(self, score: Array) -> NDArray[np.int64]:
        """Those that are claimed, no two of the same objects."""
        kept = distinct(self.asked.a.record, self.asked.b.record, self.found.pairs, score)
        if self.verdicts is not None:
            first: dict[tuple[str, str], int] = {}
            for k in kept:
                first.setdefault((self.verdicts[k].object_a, self.verdicts[k].object_b), k)
            kept = list(first.values())
        return np.array(kept, dtype=np.int64)


def _verdicts(one: Asked, found: Candidates) -> list[Verdict] | None:
    n = len(found.pairs)
    return one.verdicts(claims_of(one.a.record, one.b.record, found, range(n), np.ones(n)))


def _worth_of_appearance(pairs: list[tuple[Sight, Sight]]) -> tuple[float, float]:
    """Log-odds a unit of cosine, and the cosine at which they are even, all else being equal."""
    cosines, same = [], []
    for a, b in pairs:
        alike = a.record.proposals.embedding @ b.record.proposals.embedding.T
        known = (a.shows[:, None] >= 0) & (b.shows[None, :] >= 0)
        cosines.append(alike[known])
        same.append((a.shows[:, None] == b.shows[None, :])[known])
    cosine, is_same = np.concatenate(cosines).astype(float), np.concatenate(same)
    found = fit(cosine[:, None], is_same)
    scale = float(found.weight[0] / found.spread[0])
    prior = float(np.log(is_same.mean() / (1 - is_same.mean())))
    even = float(found.mean[0] + (prior - found.bias) / scale)
    return scale, even


def _sights(
    scene: Scene, truth: GroundTruth, weights: Path, config: CalibrateConfig, k: int
) -> Iterator[tuple[Sight, Sight]]:
    from vrchain.world.render import Renderer

    draws = generator(config.seed, "calibrate", k)
    renderer, rig = Renderer(scene), CameraRig()
    landmark = np.array([o.landmark for o in scene.objects])

    def look(pose: Pose) -> Sight:
        record = examine(renderer.render(pose, rig), weights)
        return Sight(record, pose, _shown(record, truth, pose, landmark))

    half = np.array(scene.extent_m) / 2
    made = 0
    for _ in range(_TRIES):
        spacing_m = np.exp(draws.uniform(*np.log(_SPACING_M)))
        first, course = draws.uniform(-half, half), draws.uniform(-np.pi, np.pi)
        second = first + spacing_m * np.array([np.cos(course), np.sin(course)])
        yaws = draws.uniform(-np.pi, np.pi, 2)
        if not scene.is_free([first, second]).all():
            continue
        a, b = (
            Pose(*map(float, (*xy, yaw))) for xy, yaw in zip((first, second), yaws, strict=True)
        )
        yield look(a), look(b)
        made += 1
        if made == config.pairs:
            return


def _shown(
    record: LandmarkRecord, truth: GroundTruth, pose: Pose, landmark: NDArray[np.bool_]
) -> NDArray[np.int64]:
    shows = np.full(len(record.proposals), -1)
    for i in range(len(shows)):
        bearing_rad, slope = mask_of(record.proposals, i, record.rig).T
        ids, _ = truth.look_along(pose, bearing_rad, slope, record.rig)
        values, counts = np.unique(ids, return_counts=True)
        leader = values[counts.argmax()]
        if leader >= 0 and landmark[leader] and counts.max() * 2 >= len(ids):
            shows[i] = leader
    return shows

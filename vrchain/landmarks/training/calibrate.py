"""What the network's answers are worth, by claims on suburbs kept for choosing.

Pairs of panoramas near and far, some of two different suburbs; every pair of proposals that might
be claimed is judged by ground truth.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from tqdm.auto import tqdm

from vrchain.geometry import Pose
from vrchain.landmarks.extraction.record import LandmarkRecord, examine
from vrchain.landmarks.matching.calibration import Calibration, fit
from vrchain.landmarks.matching.common import Comparison
from vrchain.landmarks.matching.joint import (
    JOINT,
    Candidates,
    candidates,
    claims_of,
    distinct,
    mask_of,
)
from vrchain.landmarks.quality import Verdict, judge
from vrchain.landmarks.training.examples import varied_suburb
from vrchain.panorama import CameraRig
from vrchain.seeding import generator
from vrchain.world import Scene
from vrchain.world.truth import GroundTruth

Array = NDArray[np.float64]

_SPACING_M = (1.0, 50.0)
_TRIES = 1000


@dataclass(frozen=True)
class CalibrateConfig:
    """On what the answers are weighed."""

    seed: int = 1000  # model choice: 1,000..1,999
    suburbs: int = 24
    pairs: int = 8  # of each suburb, spacing log-uniform


@dataclass(frozen=True, eq=False)
class Sight:
    """A panorama's record, the pose it was taken from, and the object each proposal shows.

    shows: (n,) object id, -1 where most of it, at least half, is no one landmark.
    """

    record: LandmarkRecord
    pose: Pose
    shows: NDArray[np.int64]


def calibrate(weights: Path, config: CalibrateConfig) -> Calibration:
    """The calibration of a weights file."""
    pairs, strangers = [], []
    for k in tqdm(range(config.suburbs), desc="suburbs to weigh by", unit="", disable=None):
        scene = varied_suburb(config.seed, k)
        truth = GroundTruth(scene)
        found = list(_sights(scene, truth, weights, config, k))
        pairs += [(truth, a, b) for a, b in found]
        strangers += [found[0][0], found[1][0]]
    scale, even = _worth_of_appearance([(a, b) for _, a, b in pairs])
    rough = Calibration(scale, even, {})
    elsewhere = zip(strangers[:-2], strangers[2:], strict=True)
    asked: list[tuple[GroundTruth | None, Sight, Sight]] = [*pairs]
    asked += [(None, one, other) for one, other in elsewhere]
    claims = {}
    for joint in JOINT.values():
        weighed = []
        for known, a, b in tqdm(asked, desc=joint.name, unit="", disable=None):
            joined = candidates(a.record, b.record, joint, rough)
            if joined is not None:
                verdicts = _verdicts(known, a, b, joined) if known else None
                weighed.append(_Weighed(a.record, b.record, joined, verdicts))
        first = fit(np.concatenate([w.found.features for w in weighed]),
                    np.concatenate([w.right for w in weighed]))  # fmt: skip
        kept = [w.distinct(first.probability(w.found.features)) for w in weighed]
        claims[joint.name] = fit(
            np.concatenate([w.found.features[k] for w, k in zip(weighed, kept, strict=True)]),
            np.concatenate([w.right[k] for w, k in zip(weighed, kept, strict=True)]),
        )
    return Calibration(scale, even, claims)


@dataclass(frozen=True, eq=False)
class _Weighed:
    """Joined pairs of two panoramas and what truth says of them; None: nothing is right."""

    a: LandmarkRecord
    b: LandmarkRecord
    found: Candidates
    verdicts: list[Verdict] | None

    @property
    def right(self) -> NDArray[np.bool_]:
        if self.verdicts is None:
            return np.zeros(len(self.found.pairs), dtype=bool)
        return np.array([v.right for v in self.verdicts])

    def distinct(self, score: Array) -> NDArray[np.int64]:
        """Those that are claimed, no two of the same objects."""
        kept = distinct(self.a, self.b, self.found.pairs, score)
        if self.verdicts is not None:
            first: dict[tuple[str, str], int] = {}
            for k in kept:
                first.setdefault((self.verdicts[k].object_a, self.verdicts[k].object_b), k)
            kept = list(first.values())
        return np.array(kept, dtype=np.int64)


def _verdicts(truth: GroundTruth, a: Sight, b: Sight, found: Candidates) -> list[Verdict]:
    n = len(found.pairs)
    made = claims_of(a.record, b.record, found, range(n), np.ones(n))
    return judge(
        Comparison(tuple(made), found.geometry), truth, (a.pose, b.pose),
        (a.record.features, b.record.features), a.record.rig,
    )  # fmt: skip


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

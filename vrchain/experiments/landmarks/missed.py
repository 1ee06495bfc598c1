"""Why a landmark that two robots both see, by truth, is not among those that they find."""

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from vrchain.geometry import Pose
from vrchain.landmarks.extraction.record import LandmarkRecord
from vrchain.landmarks.matching.calibration import load_calibration
from vrchain.landmarks.matching.common import Comparison
from vrchain.landmarks.matching.joint import (
    JointConfig,
    Judged,
    compare_joint,
    judged,
    matched,
    settled,
)
from vrchain.landmarks.matching.levelling import levelled, tilts
from vrchain.landmarks.quality import co_visible, judge
from vrchain.world.truth import GroundTruth

_GRID = np.linspace(0.1, 0.9, 7)  # of a box, looked along each way
_ALIKE = -4.0  # log-odds of appearance below which two looks speak clearly against each other


def found_and_missed(
    a: LandmarkRecord, b: LandmarkRecord, truth: GroundTruth, poses: tuple[Pose, Pose]
) -> tuple[Comparison, pd.DataFrame]:
    """What two records have in common, and a row for each landmark that both robots truly see.

    Columns: landmark, found, why (the score of the right claim, or where the landmark was lost).
    """
    found = compare_joint(a, b)
    both = co_visible(truth, *poses, a.rig)
    verdicts = judge(found, truth, poses, (a.features, b.features), a.rig)
    right: dict[str, float] = {}
    for claim, verdict in zip(found.common, verdicts, strict=True):
        if verdict.right:
            right.setdefault(verdict.object_a, claim.score)
    lost = _Lost(a, b, truth, poses, found)
    rows = []
    for number in both:
        name = truth.scene.objects[number].name
        score = right.get(name)
        why = lost.why(number) if score is None else f"right with probability {score:.2f}"
        rows.append({"landmark": name, "found": score is not None, "why": why})
    return found, pd.DataFrame(rows, columns=["landmark", "found", "why"])


class _Lost:
    """The stages of one comparison, and what truth says of the proposals that go through them."""

    def __init__(
        self,
        a: LandmarkRecord,
        b: LandmarkRecord,
        truth: GroundTruth,
        poses: tuple[Pose, Pose],
        found: Comparison,
    ) -> None:
        self._config, calibration = JointConfig(), load_calibration()
        self._names = [o.name for o in truth.scene.objects]
        self._ids = [_shown_by(r, truth, p) for r, p in zip((a, b), poses, strict=True)]
        self._alike = calibration.appearance(a.proposals.embedding @ b.proposals.embedding.T)
        matches = matched(a, b, self._config)
        level = levelled(a, b, tilts(a, b, matches))
        options = judged(level, matches, self._config, calibration)
        self._best: Judged | None = options[0] if options else None
        self._score = np.empty(0)
        if self._best is not None:
            worth = calibration.of(self._config.name)
            self._score = settled(*level, self._best, worth)

    def why(self, number: int) -> str:
        """Where a landmark was lost, by its object id."""
        for robot, ids in zip(("R1", "R2"), self._ids, strict=True):
            if number not in ids:
                return f"the network proposes nothing there in what {robot} sees"
        if self._best is None:
            return "no relative pose was found: too little matches"
        if self._best.chance < self._config.min_joined:
            return (
                f"the likeliest relative pose is right with probability {self._best.chance:.2f}, "
                f"and {self._config.min_joined} is needed"
            )
        mine, other = (np.flatnonzero(ids == number) for ids in self._ids)
        pairs = self._best.found.pairs
        same = [
            k for k in self._best.own if pairs[k, 0] in mine and pairs[k, 1] in other
        ]  # fmt: skip
        if same:
            score = float(self._score[same].max())
            if score < self._config.min_score:
                least = self._config.min_score
                return f"joined, but right with probability {score:.2f}, and {least} is needed"
            return "claimed, but most of its support lies on something else"
        partners = {int(self._ids[1][pairs[k, 1]]) for k in self._best.own if pairs[k, 0] in mine}
        named = [self._names[i] for i in sorted(partners) if i >= 0]
        if self._alike[np.ix_(mine, other)].max() < _ALIKE:
            return "it looks too different from the two places"
        if named:
            return f"R1's view of it was joined with {named[0]} instead"
        return "its two views do not lie where the relative pose says, or overlap a surer pair"


def _shown_by(record: LandmarkRecord, truth: GroundTruth, pose: Pose) -> NDArray[np.int64]:
    """The landmark that most of each proposal's box shows, by object id, -1 where none: (n,)."""
    box = record.proposals.box
    if not len(box):
        return np.empty(0, dtype=np.int64)
    across, along = np.meshgrid(_GRID, _GRID)
    bearing = box[:, :1] + across.ravel() * (box[:, 1:2] - box[:, :1])
    slope = box[:, 2:3] + along.ravel() * (box[:, 3:4] - box[:, 2:3])
    ids, _ = truth.look_along(pose, bearing.ravel(), slope.ravel(), record.rig)
    standing = np.array([o.landmark for o in truth.scene.objects])
    shown = []
    for own in ids.reshape(len(box), -1):
        own = own[(own >= 0) & standing[np.maximum(own, 0)]]
        values, counts = np.unique(own, return_counts=True)
        shown.append(int(values[counts.argmax()]) if len(values) else -1)
    return np.array(shown)

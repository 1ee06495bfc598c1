"""The ways to find common landmarks, by name; and how to add another.

A matcher is any function of two landmark records of one rig that returns a ``Comparison``: its
claims, surest first, and the relative pose if it has one. Put it into a table like ``VARIANTS``
and give it to ``experiments.landmark_evaluation``:

    def mine(a: LandmarkRecord, b: LandmarkRecord) -> Comparison: ...
    evaluate(spec, 300, (1, 20), {**VARIANTS, "mine": mine}, seed=3000)
"""

from collections.abc import Callable, Mapping
from functools import partial

from vrchain.landmarks.common import Comparison, MatchConfig, compare
from vrchain.landmarks.joint import JointConfig, compare_joint
from vrchain.landmarks.record import LandmarkRecord

Matcher = Callable[[LandmarkRecord, LandmarkRecord], Comparison]


def by_sift(a: LandmarkRecord, b: LandmarkRecord, config: MatchConfig | None = None) -> Comparison:
    """SIFT over the whole panoramas, as far as their records hold the keypoints."""
    return compare(a.features, b.features, a.rig, config)


def matchers(min_score: float = 0.5) -> Mapping[str, Matcher]:
    """The three variants, with claims from a score on."""
    return {
        "sift": partial(by_sift, config=MatchConfig(min_score=min_score)),
        "cnn": partial(compare_joint, config=JointConfig(sift=False, min_score=min_score)),
        "cnn+sift": partial(compare_joint, config=JointConfig(min_score=min_score)),
    }


VARIANTS = matchers()

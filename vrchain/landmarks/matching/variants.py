"""The ways to find common landmarks, by name; and how to plug in a matcher of your own.

    mine = Variant("mine", look=my_features, compare=my_comparison, keypoints=lambda look: look)

It is given by where it is found, ``--variant mymodule:mine``, and stands in every table beside the
others.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, lru_cache, partial
from operator import attrgetter, itemgetter
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from vrchain.errors import MissionError
from vrchain.landmarks.extraction.record import LandmarkRecord, examine, examine_quickly, maker_of
from vrchain.landmarks.extraction.sift import Features, extract
from vrchain.landmarks.extraction.weights import SHIPPED
from vrchain.landmarks.matching.calibration import load_calibration
from vrchain.landmarks.matching.common import (
    CommonLandmark,
    Comparison,
    MatchConfig,
    check_comparable,
    compare,
)
from vrchain.landmarks.matching.joint import JOINT, JointConfig, compare_joint
from vrchain.panorama import CameraRig, Panorama
from vrchain.plugins import plugged_in

DEFAULT = "cnn+sift"
HALF = ", half resolution"
FEWER = "cnn+sift, fewer keypoints"  # as robots under way look
Whole = tuple[Features, CameraRig]


@dataclass(frozen=True)
class Variant:
    """One way to find common landmarks: what to implement for a matcher of your own.

    look: takes a ``Panorama``, gives what the matcher keeps of it, of any type; asked once for each
    panorama. compare: takes two of these, of panoramas of one rig, gives a ``Comparison``: the
    claims, surest first, and the relative pose if there is one. keypoints: takes one of these,
    gives the ``Features`` that the supports of its claims count by.

    maker: what its results depend on beside the code, as text: results that are kept are used again
    only where it is the same; of one plugged in, the digest of its module's file is put behind.
    claimed: the score from which its claims count where all are kept to see what other thresholds
    would do, of one plugged in all; surest: that from which a pair's surest one does, None: the
    same. partial: it is the default with something left out, to compare with and not for use.
    """

    name: str
    look: Callable[[Panorama], Any]
    compare: Callable[[Any, Any], Comparison]
    keypoints: Callable[[Any], Features]
    maker: str = ""
    claimed: float = 0.0
    partial: bool = False
    surest: float | None = None


def sift(min_score: float = MatchConfig().min_score) -> Variant:
    """SIFT over whole panoramas under one relative pose."""

    def by_sift(a: Whole, b: Whole) -> Comparison:
        return compare(a[0], b[0], a[1], MatchConfig(min_score=min_score))

    usual = MatchConfig().min_score
    return Variant("sift", _whole, by_sift, itemgetter(0), maker=f"{min_score}", claimed=usual)


def compared(variant: Variant, a: Panorama, b: Panorama) -> Comparison:
    """What two panoramas have in common. ImageError: one is blank, or their rigs differ."""
    check_comparable(a, b)
    return variant.compare(variant.look(a), variant.look(b))


def at_half_resolution(variant: Variant) -> Variant:
    """The same with cameras of half as many pixels each way."""

    def look(panorama: Panorama) -> Any:
        return variant.look(halved(panorama))

    return replace(variant, name=f"{variant.name}{HALF}", look=look)


def halved(panorama: Panorama) -> Panorama:
    """The panorama as cameras of half its resolution would have taken it."""
    rig = panorama.rig
    size = rig.width_px // 2, rig.height_px // 2
    small = replace(rig, width_px=size[0], height_px=size[1])
    views = [cv2.resize(v, size, interpolation=cv2.INTER_AREA) for v in panorama.views]
    seen = panorama.seen
    if seen is not None:
        shares = [
            cv2.resize(s.astype(np.float32), size, interpolation=cv2.INTER_AREA) for s in seen
        ]
        seen = np.stack(shares) > 1 - 1e-3
    return Panorama(small, np.stack(views).astype(np.uint8), seen)


def variant_named(name: str | Variant, min_score: float | None = None) -> Variant:
    """A variant by its name; MissionError if there is none, LearnedError without torch or weights.

    Or WEIGHTS.pt, the default with other weights; or one plugged in: itself, or MODULE:NAME of it,
    whose comparisons raise MissionError where they are none. min_score: of the claims that it
    makes, if not its own.
    """
    if isinstance(name, Variant):
        return _checked(name)
    if name.endswith(HALF):
        return at_half_resolution(variant_named(name.removesuffix(HALF), min_score))
    if name == FEWER:
        return replace(variant_named(DEFAULT, min_score), name=FEWER, look=examine_quickly)
    if name == "sift":
        return sift() if min_score is None else sift(min_score)
    if name in JOINT:
        return _joint(name, JOINT[name], SHIPPED, min_score)
    if name.endswith(".pt"):
        return _joint(f"{DEFAULT}, {Path(name).name}", JOINT[DEFAULT], Path(name), min_score)
    return _plugged_in(name)


def _joint(name: str, config: JointConfig, weights: Path, min_score: float | None) -> Variant:
    """Landmarks that the network proposes, joined by appearance and places; with SIFT, or not."""
    if min_score is not None:
        config = replace(config, min_score=min_score)
    joining = partial(compare_joint, config=config, calibration=load_calibration(weights))
    usual, part = JointConfig(), config.name != DEFAULT
    looks, keypoints = _look_by(weights), attrgetter("features")
    maker = f"{maker_of(weights)} {config}"
    return Variant(name, looks, joining, keypoints, maker, usual.min_score, part, usual.min_surest)


def _plugged_in(name: str) -> Variant:
    known = f"{'; '.join(['sift', *JOINT, FEWER])}; these with {HALF!r} behind; WEIGHTS.pt"
    found, made_of = plugged_in(name, "variant", known, lambda it: isinstance(it, Variant))
    return replace(_checked(found), maker=f"{found.maker} {made_of}")


def _checked(variant: Variant) -> Variant:
    """The same, of which each comparison is looked at: it is somebody's own."""

    def compare(a: Any, b: Any) -> Comparison:
        found = variant.compare(a, b)
        wrong = f"{type(found).__name__} in place of a Comparison"
        if isinstance(found, Comparison):
            wrong = _wrong(found, variant.keypoints, (a, b))
        if wrong:
            raise MissionError(f"the matcher {variant.name!r} gave {wrong}")
        return found

    return replace(variant, compare=compare)


def _wrong(found: Comparison, keypoints: Callable[[Any], Features], looks: tuple[Any, Any]) -> str:
    """What is wrong with a comparison's claims, empty if nothing is."""
    counts = [len(keypoints(look)) for look in looks] if found.common else []
    for claim in found.common:
        if not isinstance(claim, CommonLandmark):
            return f"a {type(claim).__name__} as a claim: expected a CommonLandmark"
        if not 0 <= claim.score <= 1:  # NaN neither
            return f"a claim of score {claim.score}: expected 0 to 1"
        supports, masks = (claim.support_a, claim.support_b), (claim.mask_a, claim.mask_b)
        for support, mask, count in zip(supports, masks, counts, strict=True):
            index = np.asarray(support)
            if not index.size and (mask is None or not len(mask)):
                return "a claim without keypoints: expected some, or its directions in mask_a, _b"
            whole = index.dtype.kind in "iu"
            if index.size and not (whole and 0 <= index.min() <= index.max() < count):
                return f"a claim by keypoints {index.min()}..{index.max()}, of which it has {count}"
    return ""


@lru_cache(maxsize=2)
def _keypoints(panorama: Panorama) -> Features:
    """All of a panorama's: more than one variant wants them."""
    return extract(panorama)


def _whole(panorama: Panorama) -> Whole:
    return _keypoints(panorama), panorama.rig


@cache
def _look_by(weights: Path) -> Callable[[Panorama], LandmarkRecord]:
    """The same function for the same weights: what several variants look at, is looked at once."""

    def look(panorama: Panorama) -> LandmarkRecord:
        return examine(panorama, weights, features=_keypoints(panorama))

    return look

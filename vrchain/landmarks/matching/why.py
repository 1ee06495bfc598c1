"""Why two pictures have no more in common: what each stage found, and what it left."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from vrchain.landmarks.extraction.record import LandmarkRecord, examine
from vrchain.landmarks.matching import photos
from vrchain.landmarks.matching.calibration import load_calibration
from vrchain.landmarks.matching.claims import group_signs, grouped
from vrchain.landmarks.matching.common import check_comparable
from vrchain.landmarks.matching.joint import (
    JointConfig,
    Judged,
    claims_under,
    judged,
    matched,
    settled,
)
from vrchain.landmarks.matching.levelling import levelled, tilts
from vrchain.landmarks.matching.photos import Described, PhotoConfig, agreeing, by_chance
from vrchain.panorama import Panorama

Told = Iterator[tuple[str, str]]
"""Stages and what they found, in order; the last is the answer."""


def why_files(a: str | Path, b: str | Path, model: str | None = None) -> Told:
    """Of two files, which are taken as ``landmarks_of_files`` does."""
    left, right = photos.load_both(a, b, model)
    if isinstance(left, Panorama) and isinstance(right, Panorama):
        check_comparable(left, right)
        return why_panoramas(examine(left), examine(right))
    found = photos.landmarks_of_views(left, right)
    return why_photographs(photos.described(found.a_rgb), photos.described(found.b_rgb))


def seen_in(file: str | Path, model: str | None = None) -> Told:
    """What one file has to compare."""
    picture = photos.load_picture(file, model)
    if not isinstance(picture, Panorama):
        found = photos.described(picture)
        yield "found", f"{len(found.in_sky)} keypoints, {found.in_sky.sum()} of them in the sky"
        return
    record = examine(picture)
    own = record.proposals
    away = f", {own.range_m.min():.1f} to {own.range_m.max():.1f} m away" if len(own) else ""
    yield "proposed", f"{len(own)} landmarks{away}"
    yield "found", f"{len(record.features)} keypoints, {len(record.spots)} spots in the landmarks"
    if picture.seen is not None:
        yield "seen", f"{picture.seen.mean():.0%} of all directions; the rest is masked"


def why_panoramas(a: LandmarkRecord, b: LandmarkRecord) -> Told:
    """Of two panoramas, by the default variant."""
    config, calibration = JointConfig(), load_calibration()
    worth = calibration.of(config.name)
    sides = (("A", a), ("B", b))
    yield "proposed", ", ".join(f"{len(r.proposals)} landmarks in {side}" for side, r in sides)
    alike = calibration.appearance(a.proposals.embedding @ b.proposals.embedding.T) > 0
    yield "look alike", f"{alike.any(axis=1).sum()} of A's have one in B that does"
    matches = matched(a, b, config)
    yield (
        "match",
        f"{len(matches.keypoints[0])} of {len(a.features)} and {len(b.features)} keypoints, "
        f"{len(matches.spots[0])} of {len(a.spots)} and {len(b.spots)} spots within proposals",
    )
    tilted = tilts(a, b, matches)
    if tilted is not None:
        told = " and ".join(f"{np.degrees(np.hypot(*tilt)):.1f}" for tilt in tilted)
        yield "tilt", f"{told} degrees at least, by the matches; both are levelled"
    level = levelled(a, b, tilted)
    options = judged(level, matches, config, calibration)
    for option in options:
        yield "relative pose", _pose_told(option)
    if not options:
        yield "answer", "nothing in common: matches and proposals speak for no relative pose"
        return
    best = options[0]
    found, score = best.found, settled(*level, best, worth)
    sure = [k for k in best.own if score[k] >= config.min_score]
    surest = f", the surest {score[best.own].max():.2f}" if len(best.own) else ""
    enough = f"reach {config.min_score}"
    yield "joined", f"{len(best.own)} pairs of proposals{surest}; {len(sure)} {enough}"
    groups = grouped(*level, found, sure)
    good = worth.groups.probability(group_signs(groups, best.chance)) >= config.min_score
    yield (
        "grouped",
        f"{len(groups)} groups of other keypoints; {good.sum()} {enough}",
    )
    if best.chance < config.min_joined:
        yield (
            "answer",
            f"nothing in common: the likeliest pose is right with probability {best.chance:.2f}, "
            f"and {config.min_joined} is needed: pictures taken nearer to each other match better",
        )
    elif not (made := claims_under(level, best, config, worth, (a, b))):
        yield (
            "answer",
            f"nothing in common: the likeliest pose is right with probability {best.chance:.2f}, "
            "but what matches lies on the ground, or is scattered",
        )
    else:
        count = "common landmarks" if len(made) > 1 else "common landmark"
        yield (
            "answer",
            f"{len(made)} {count}, the surest right with probability {made[0].score:.2f}",
        )


def _pose_told(option: Judged) -> str:
    geometry, found = option.found.geometry, option.found
    if geometry is None:
        return "none"
    direction, heading = np.degrees([geometry.direction_rad, geometry.heading_rad])
    by_matches = 1 / (1 + np.exp(-found.pose_log_odds))
    return (
        f"B at {direction:.0f} degrees, turned by {heading:.0f}: {len(found.keypoints[0])} "
        f"matched keypoints obey it; right with probability {by_matches:.2f} by its matches, "
        f"{option.chance:.2f} by what is joined under it too"
    )


def why_photographs(a: Described, b: Described, config: PhotoConfig | None = None) -> Told:
    """Of two photographs."""
    config = config or PhotoConfig()
    obey, chance = len(agreeing(a, b, config)[0]), by_chance(a, b, config)
    sides = (("A", a), ("B", b))
    yield "found", ", ".join(f"{len(d.in_sky)} keypoints in {side}" for side, d in sides)
    yield "match", f"{len(photos.matches_of(a, b, config)[0])} of them"
    yield (
        "agree",
        f"{obey} on where the cameras stood, those in the sky left out; {chance} when it is "
        "shuffled who matches whom",
    )
    few = max(config.min_inliers, chance + 1)
    if obey < few:
        yield "answer", f"nothing in common: {few} would have to agree"
    else:
        yield "answer", "common landmarks where those lie together"

"""Relative poses that the matches of two records speak for, and how much speaks for each.

Keypoints place exactly, spots carry farther. Either alone may be led astray by what repeats, so
several poses are told, each with signs that mean the same in any world: how many matches obey it
against the best other pose and against poses drawn at random, and how they spread.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vrchain.geometry import wrap_angle_rad
from vrchain.landmarks.extraction.record import LandmarkRecord
from vrchain.landmarks.extraction.sift import mutual_matches, root
from vrchain.landmarks.matching.epipolar import PlanarGeometry, hypotheses, obeyed
from vrchain.landmarks.matching.guided import NO_MATCH, Matched, spots_anywhere
from vrchain.seeding import generator

Array = NDArray[np.float64]
Directions = tuple[Array, Array]
"""Bearing and slope of what matches, (m, 2), from A and from B."""

_RATIO = 0.9  # of the ratio test of keypoints, asked both ways
_EACH = 5  # poses by keypoints alone, and by keypoints and spots
_MIN_INLIERS = 8
_KEYPOINT_RAD, _SPOT_RAD = 0.006, 0.01  # within which matches obey a pose when they are counted
_SEARCH_RAD = 0.005, 0.008  # the same when poses are sought
_RANDOM = 48  # poses that tell how many matches obey one by chance
_FEW = 2.0  # matches that count for nothing, in ratios
_SECTORS = 24  # of a full turn, over which matches may spread
_LEAST_STD_RAD = 1e-4
NO_RIVAL_RAD = 0.2  # poses that are no rivals
_SIZE_LOG = 0.4  # by how much keypoints may be larger in B than the way to them tells
_ALONG = 0.05  # sine of bearings from the baseline, below which that tells nothing

SIGNS = (
    "keypoints over the best other pose", "spots over the best other pose",
    "keypoints over chance", "spots over chance", "sectors in A", "sectors in B",
    "deviation of the direction", "keypoints of the right size",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Matches:
    """What matches all over two panoramas: keypoints and spots, (m,) indices in A and in B."""

    keypoints: Matched
    spots: Matched


@dataclass(frozen=True, eq=False)
class PoseHypothesis:
    """A relative pose, what speaks for it (``SIGNS``), and the matched keypoints that obey it."""

    geometry: PlanarGeometry
    signs: Array
    keypoints: Matched


def matches_of(a: LandmarkRecord, b: LandmarkRecord, sift: bool, spots: bool) -> Matches:
    """Matched keypoints, if ``sift``, and matched spots, if ``spots``, wherever they are."""
    keypoints = NO_MATCH
    if sift:
        known_a, known_b = (root(r.features.descriptors) for r in (a, b))
        keypoints = mutual_matches(known_a, known_b, _RATIO)
    return Matches(keypoints, spots_anywhere(a.spots, b.spots) if spots else NO_MATCH)


def pose_hypotheses(a: LandmarkRecord, b: LandmarkRecord, matches: Matches) -> list[PoseHypothesis]:
    """Different relative poses that many matches obey, in no order."""
    (ka, kb), (sa, sb) = matches.keypoints, matches.spots
    keypoints = a.features.directions[ka], b.features.directions[kb]
    spots = a.spots.directions[sa], b.spots.directions[sb]
    both = [np.concatenate(sides) for sides in zip(keypoints, spots, strict=True)]
    sought = hypotheses(*keypoints, _EACH, _MIN_INLIERS, _SEARCH_RAD[0])
    if len(sa):
        sought += hypotheses(both[0], both[1], _EACH, _MIN_INLIERS, _SEARCH_RAD[1])
    found: list[PlanarGeometry] = []
    for geometry in sought:
        if not any(geometry.near(other) for other in found):
            found.append(geometry)
    if not found:
        return []
    sizes = np.log(b.features.size_rad[kb] / a.features.size_rad[ka])
    signs, good = _signs(found, keypoints, spots, sizes)
    return [
        PoseHypothesis(geometry, own, (ka[held], kb[held]))
        for geometry, own, held in zip(found, signs, good, strict=True)
    ]


def _signs(
    found: list[PlanarGeometry], keypoints: Directions, spots: Directions, sizes: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """What speaks for each pose: (k, ``SIGNS``); and which keypoints (m,) obey it: (k, m).

    sizes: (m,) how much larger each keypoint looks from B, as a logarithm. Of what is near to one
    robot and far from the other, sizes differ as ranges do; chance does not mind.
    """
    poses = np.array([(g.direction_rad, g.heading_rad) for g in found]).T
    drawn = generator(0, "random poses").uniform(-np.pi, np.pi, (2, _RANDOM))
    held = _obeying(poses, keypoints, _KEYPOINT_RAD)
    sized = held & _right_size(poses, keypoints, sizes)
    of_spots = _obeying(poses, spots, _SPOT_RAD)
    by_chance = (
        _obeying(drawn, keypoints, _KEYPOINT_RAD) & _right_size(drawn, keypoints, sizes),
        _obeying(drawn, spots, _SPOT_RAD),
    )
    rivals = ~np.array([[one.near(other, NO_RIVAL_RAD) for other in found] for one in found])
    counts = sized.sum(axis=1), of_spots.sum(axis=1)
    best_other = (np.where(rivals, count, 0).max(axis=1) for count in counts)
    mean = (chance.sum(axis=1).mean() for chance in by_chance)
    together = np.concatenate([held, of_spots], axis=1)
    seen = (np.concatenate([k[:, 0], s[:, 0]]) for k, s in zip(keypoints, spots, strict=True))
    columns = [np.log((n + 1) / (other + 1)) for n, other in zip(counts, best_other, strict=True)]
    columns += [np.log((n + _FEW) / (few + _FEW)) for n, few in zip(counts, mean, strict=True)]
    columns += [np.array([_spread(bearing_rad[own]) for own in together]) for bearing_rad in seen]
    columns.append(np.log([g.direction_std_rad + _LEAST_STD_RAD for g in found]))
    columns.append(np.log((counts[0] + 1) / (held.sum(axis=1) + 1)))
    return np.stack(columns, axis=1), held


def _obeying(poses: Array, seen: Directions, tolerance_rad: float) -> NDArray[np.bool_]:
    return obeyed(poses[0], poses[1], seen[0], seen[1], tolerance_rad)


def _right_size(poses: Array, keypoints: Directions, sizes: Array) -> NDArray[np.bool_]:
    """Which keypoints' sizes fit the ranges that each pose (direction, heading) gives: (k, m)."""
    direction_rad, heading_rad = poses[:, :, None]
    sine_a = np.abs(np.sin(keypoints[0][:, 0] - direction_rad))
    sine_b = np.abs(np.sin(keypoints[1][:, 0] + heading_rad - direction_rad))
    nearer = np.log(np.maximum(sine_b, _ALONG) / np.maximum(sine_a, _ALONG))  # law of sines
    unknown = np.minimum(sine_a, sine_b) < _ALONG
    return unknown | (np.abs(sizes - nearer) < _SIZE_LOG)


def _spread(bearing_rad: Array) -> float:
    """Over how many sectors bearings spread: the exponential of their entropy."""
    sector = ((wrap_angle_rad(bearing_rad) + np.pi) * (_SECTORS / (2 * np.pi))).astype(int)
    share = np.bincount(sector % _SECTORS) / max(1, len(sector))
    share = share[share > 0]
    return float(np.exp(-(share * np.log(share)).sum()))

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
from vrchain.landmarks.extraction.sift import matches_and_ratios, root
from vrchain.landmarks.matching.epipolar import (
    PlanarGeometry,
    hypotheses,
    obeyed,
    of_right_size,
)
from vrchain.landmarks.matching.guided import NO_MATCH, Matched, spots_anywhere
from vrchain.seeding import generator

Array = NDArray[np.float64]
Directions = tuple[Array, Array]
"""Bearing and slope of what matches, (m, 2), from A and from B."""

_RATIO = 0.9  # of the ratio test of keypoints, asked both ways
# the probability that a match of such a ratio is right, on suburbs and in rooms alike
_RATIOS = (0.4, 0.55, 0.65, 0.725, 0.775, 0.825, 0.875)
_RIGHT = (0.85, 0.75, 0.5, 0.35, 0.2, 0.1, 0.05)
_BY_CHANCE = 0.003  # of wrong matches the share that obeys any pose, at least
_EACH = 5  # poses by keypoints alone, and by keypoints and spots
_MIN_INLIERS = 8
_KEYPOINT_RAD, _SPOT_RAD = 0.006, 0.01  # within which matches obey a pose when they are counted
_SEARCH_RAD = 0.005, 0.008  # the same when poses are sought
_RANDOM = 48  # poses that tell how many matches obey one by chance
_FEW = 2.0  # matches that count for nothing, in ratios
_SECTORS = 24  # of a full turn, over which matches may spread
_LEAST_STD_RAD = 1e-4
NO_RIVAL_RAD = 0.2  # poses that are no rivals

SIGNS = (
    "evidence over the best other pose", "spots over the best other pose",
    "keypoints over chance", "spots over chance", "sectors in A", "sectors in B",
    "deviation of the direction", "keypoints of the right size",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Matches:
    """What matches all over two panoramas: keypoints and spots, (m,) indices in A and in B.

    ratios: (m,) of the keypoints' distances, nearest over second nearest.
    """

    keypoints: Matched
    ratios: NDArray[np.float32]
    spots: Matched


@dataclass(frozen=True, eq=False)
class PoseHypothesis:
    """A relative pose, what speaks for it (``SIGNS``), and the matched keypoints that obey it."""

    geometry: PlanarGeometry
    signs: Array
    keypoints: Matched


def matches_of(a: LandmarkRecord, b: LandmarkRecord, sift: bool, spots: bool) -> Matches:
    """Matched keypoints, if ``sift``, and matched spots, if ``spots``, wherever they are."""
    index_a, index_b, ratios = *NO_MATCH, np.empty(0, dtype=np.float32)
    if sift:
        known_a, known_b = (root(r.features.descriptors) for r in (a, b))
        index_a, index_b, ratios = matches_and_ratios(known_a, known_b, _RATIO)
    in_spots = spots_anywhere(a.spots, b.spots) if spots else NO_MATCH
    return Matches((index_a, index_b), ratios, in_spots)


def chance_right(ratios: NDArray[np.float32]) -> Array:
    """The probability that keypoints matched with such ratios (m,) are of one point."""
    return np.interp(ratios, _RATIOS, _RIGHT)


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
    signs, good = _signs(found, keypoints, spots, sizes, matches.ratios)
    return [
        PoseHypothesis(geometry, own, (ka[held], kb[held]))
        for geometry, own, held in zip(found, signs, good, strict=True)
    ]


def _signs(
    found: list[PlanarGeometry],
    keypoints: Directions,
    spots: Directions,
    sizes: Array,
    ratios: NDArray[np.float32],
) -> tuple[Array, NDArray[np.bool_]]:
    """What speaks for each pose: (k, ``SIGNS``); and which keypoints (m,) obey it: (k, m).

    sizes: (m,) how much larger each keypoint looks from B, as a logarithm. Of what is near to one
    robot and far from the other, sizes differ as ranges do; chance does not mind.
    """
    k = len(found)
    drawn = generator(0, "random poses").uniform(-np.pi, np.pi, (2, _RANDOM))
    told = np.array([(g.direction_rad, g.heading_rad) for g in found]).T
    poses = np.concatenate([told, drawn], axis=1)
    held, of_spots = _obeying(poses, keypoints, _KEYPOINT_RAD), _obeying(poses, spots, _SPOT_RAD)
    sized = held & of_right_size(poses[0], poses[1], *keypoints, sizes)
    speaks = _evidence(sized, ratios, keypoints[0][:, 0])
    n_keypoints, n_spots = sized.sum(axis=1), of_spots.sum(axis=1)
    near = np.array([[one.near(other, NO_RIVAL_RAD) for other in found] for one in found])

    def best_other(values: NDArray[np.generic]) -> Array:
        return np.where(near, -np.inf, values[:k]).max(axis=1)

    ahead = speaks[:k] - np.maximum(best_other(speaks), speaks[k:].max())
    together = np.concatenate([held, of_spots], axis=1)[:k]
    seen = (np.concatenate([p[:, 0], s[:, 0]]) for p, s in zip(keypoints, spots, strict=True))
    columns = [
        np.sign(ahead) * np.sqrt(np.abs(ahead)),
        np.log((n_spots[:k] + 1) / (best_other(n_spots).clip(0) + 1)),
        *(np.log((n[:k] + _FEW) / (n[k:].mean() + _FEW)) for n in (n_keypoints, n_spots)),
        *(np.array([_spread(bearing_rad[own]) for own in together]) for bearing_rad in seen),
        np.log([g.direction_std_rad + _LEAST_STD_RAD for g in found]),
        np.log((n_keypoints[:k] + 1) / (held[:k].sum(axis=1) + 1)),
    ]
    return np.stack(columns, axis=1), held[:k]


def _evidence(obeyed: NDArray[np.bool_], ratios: NDArray[np.float32], bearing_rad: Array) -> Array:
    """How much matches (m,) speak for each pose (k,), of which they obey some: (k, m).

    Log-likelihood ratios: a right match obeys the true pose, a wrong one any as chance will. Many
    of one thing, of which there may be another, count as their root.
    """
    right = chance_right(ratios)
    wrong = 1 - right
    chance = (obeyed @ wrong / max(wrong.sum(), 1.0) / 2 + _BY_CHANCE)[:, None]
    speaks = np.log(wrong + obeyed * right / chance)
    of_sector = _sector(bearing_rad)[:, None] == np.arange(_SECTORS)
    by_sector = speaks @ of_sector
    return np.asarray((np.sign(by_sector) * np.sqrt(np.abs(by_sector))).sum(axis=1))


def _obeying(poses: Array, seen: Directions, tolerance_rad: float) -> NDArray[np.bool_]:
    return obeyed(poses[0], poses[1], seen[0], seen[1], tolerance_rad)


def _spread(bearing_rad: Array) -> float:
    """Over how many sectors bearings spread: the exponential of their entropy."""
    share = np.bincount(_sector(bearing_rad)) / max(1, len(bearing_rad))
    share = share[share > 0]
    return float(np.exp(-(share * np.log(share)).sum()))


def _sector(bearing_rad: Array) -> NDArray[np.int64]:
    """The sector that each bearing lies in."""
    turn = (wrap_angle_rad(bearing_rad) + np.pi) / (2 * np.pi)
    return np.asarray(turn * _SECTORS, dtype=np.int64) % _SECTORS

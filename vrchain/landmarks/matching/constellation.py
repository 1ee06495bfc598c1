"""Two robots' proposals joined: which are the same landmarks, and where the robots stand.

Each panorama alone places its proposals on a map of its own, bearings well and ranges roughly.
Two such maps of one place differ by a turn and a shift. Pairs of proposals that look alike
suggest one; what all proposals say of it, by appearance and by place, decides. Twins look the same
and are told apart by what stands around them.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from vrchain.geometry import wrap_angle_rad
from vrchain.landmarks.extraction.proposer import Proposals
from vrchain.seeding import generator

Array = NDArray[np.float64]

_ALIKE = 4  # most alike ones of each proposal from which a relative pose is guessed
_HEARD = 200  # of these candidates, the most alike, say which guesses are worth settling
_GUESSES, _KEPT = 2000, 10  # relative poses tried, and how many are settled by least squares
_AREA_M2 = 2000.0  # where a landmark might as well stand: rivals of the right place
_REACH_M = 70.0  # robots farther apart than this are not looked for
_NEAREST_M, _DISTANCES = 0.3, 48  # the least distance between two robots, and how many are tried


@dataclass(frozen=True, eq=False)
class Constellation:
    """B's pose in A's frame, and for every pair of proposals how well it agrees.

    xy_m: (2,) where B stands; heading_rad: B's heading against A's; covariance: (3, 3) of x, y and
    heading. evidence: log-likelihood of all proposals against that of two unrelated places.
    appearance, place: (n_a, n_b) log-likelihood ratios of being the same, by each of them.
    pairs: (m, 2) the one-to-one joining that both together favour.
    """

    xy_m: Array
    heading_rad: float
    covariance: Array
    evidence: float
    appearance: Array
    place: Array
    pairs: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class _Places:
    """Places in their robot's frame, (..., 2), and their covariances, (..., 2, 2)."""

    xy_m: Array
    covariance: Array

    def take(self, *index: Any) -> "_Places":
        return _Places(self.xy_m[index], self.covariance[index])

    def narrow(self) -> "_Places":
        return _Places(_narrow(self.xy_m), _narrow(self.covariance))


Alike = tuple[_Places, _Places, Array, NDArray[np.int64]]
"""Candidates: where they are in A and in B, how alike they look, and A's proposal. (n,) each."""


def join(a: Proposals, b: Proposals, appearance: Array) -> Constellation | None:
    """The relative pose that most speaks for, and the pairs under it; None: nothing to go by.

    appearance: (n_a, n_b) log-likelihood ratio of being the same landmark, by appearance alone.
    """
    if min(len(a), len(b)) < 2:
        return None
    i, j = _candidates(appearance)
    alike = appearance[i, j]
    poses = _guesses(a, b, i, j, alike)
    if len(poses) == 0:
        return None
    places_a, places_b = _places(a), _places(b)
    own = places_a.take(i), places_b.take(j), alike, i
    heard = np.sort(np.argsort(-alike, kind="stable")[:_HEARD])
    few_a, few_b = (side.take(heard).narrow() for side in own[:2])
    few = few_a, few_b, _narrow(alike[heard]), i[heard]
    kept = _distinct(poses, _support(_narrow(poses), few))
    settled = [_settle(poses[k], own) for k in kept]
    support = _support(np.stack([pose for pose, _ in settled]), own)
    pose, covariance = settled[int(support.argmax())]
    return replace(_join_at(pose, places_a, places_b, appearance, own), covariance=covariance)


def join_along(
    direction_rad: float, heading_rad: float, a: Proposals, b: Proposals, appearance: Array
) -> Constellation:
    """The same where B's direction and heading are known from elsewhere: how far is it to B?"""
    i, j = _candidates(appearance)
    apart_m = np.geomspace(_NEAREST_M, _REACH_M, _DISTANCES)
    along = np.array([np.cos(direction_rad), np.sin(direction_rad), 0.0])
    poses = apart_m[:, None] * along + np.array([0.0, 0.0, heading_rad])
    places_a, places_b = _places(a), _places(b)
    own = places_a.take(i), places_b.take(j), appearance[i, j], i
    best = int(_support(poses, own).argmax()) if len(i) else _DISTANCES // 2
    return _join_at(poses[best], places_a, places_b, appearance, own)


def _join_at(
    pose: Array, places_a: _Places, places_b: _Places, appearance: Array, candidates: Alike
) -> Constellation:
    """The pairs under a relative pose (3,): x, y, heading."""
    evidence = float(_support(pose[None], candidates)[0]) if len(candidates[-1]) else 0.0
    place = _place(pose[None], places_a.take(slice(None), None), places_b.take(None))[0]
    return Constellation(
        pose[:2], float(wrap_angle_rad(pose[2])), np.zeros((3, 3)), evidence, appearance, place,
        one_to_one(appearance + place),
    )  # fmt: skip


def by_appearance(appearance: Array) -> Constellation:
    """Proposals joined without regard to where they stand; the pose is unknown (NaN)."""
    nowhere, unsure = np.full(2, np.nan), np.full((3, 3), np.nan)
    return Constellation(
        nowhere, np.nan, unsure, 0.0, appearance, np.zeros_like(appearance), one_to_one(appearance)
    )


def one_to_one(gain: Array) -> NDArray[np.int64]:
    """The pairs (m, 2), each proposal in one at most, that together gain most; all of them gain."""
    gain = np.maximum(gain, -1.0)
    rows, columns = linear_sum_assignment(-gain)
    return np.stack([rows, columns], axis=1)[gain[rows, columns] > 0]


def _candidates(appearance: Array) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs of proposals of which one is among the few that look most like the other."""
    of_a, of_b = _most(appearance), _most(appearance.T).T
    i, j = np.nonzero((of_a & of_b) | (appearance > 0) & (of_a | of_b))
    return i, j


def _most(values: Array) -> NDArray[np.bool_]:
    """Which are among the largest of their row."""
    found = np.zeros(values.shape, dtype=bool)
    n = min(_ALIKE, values.shape[1])
    largest = np.argsort(-values, axis=1, kind="stable")[:, :n]  # ties alike on every processor
    np.put_along_axis(found, largest, True, axis=1)
    return found


def _guesses(
    a: Proposals, b: Proposals, i: NDArray[np.int64], j: NDArray[np.int64], alike: Array
) -> Array:
    """Relative poses (k, 3) x, y, heading from two candidates each, the more alike more often."""
    if len(i) < 2:
        return np.empty((0, 3))
    draws = generator(0, "constellation", len(i))
    share = 1 / (1 + np.exp(-alike))
    share /= share.sum()
    first, second = draws.choice(len(i), size=(2, _GUESSES), p=share)
    fair = (i[first] != i[second]) & (j[first] != j[second])
    first, second = first[fair], second[fair]
    from_a = a.xy_m[i[second]] - a.xy_m[i[first]]
    from_b = b.xy_m[j[second]] - b.xy_m[j[first]]
    long_a, long_b = np.hypot(*from_a.T), np.hypot(*from_b.T)
    rough = 0.3 * (
        a.range_m[i[first]] + a.range_m[i[second]] + b.range_m[j[first]] + b.range_m[j[second]]
    ) / 2  # fmt: skip
    fair = (np.abs(long_a - long_b) < rough + 2.0) & (np.minimum(long_a, long_b) > 1.0)
    first, second, from_a, from_b = first[fair], second[fair], from_a[fair], from_b[fair]
    heading = np.arctan2(from_a[:, 1], from_a[:, 0]) - np.arctan2(from_b[:, 1], from_b[:, 0])
    middle_a = (a.xy_m[i[first]] + a.xy_m[i[second]]) / 2
    middle_b = (b.xy_m[j[first]] + b.xy_m[j[second]]) / 2
    shift = middle_a - _turned(middle_b, heading)
    near = np.hypot(*shift.T) < _REACH_M
    return np.column_stack([shift, heading])[near]


def _support(poses: Array, candidates: Alike) -> Array:
    """Log-likelihood ratio of each pose (k,): what A's proposals say of it, each heard once."""
    places_a, places_b, alike, owner = candidates
    gain = np.logaddexp(0.0, np.minimum(alike, 4.0) + _place(poses, places_a, places_b))
    order = np.argsort(owner, kind="stable")
    starts = np.flatnonzero(np.r_[True, np.diff(owner[order]) > 0])
    found: Array = np.maximum.reduceat(gain[:, order], starts, axis=1).sum(axis=1)
    return found


def _place(poses: Array, a: _Places, b: _Places) -> Array:
    """Log of how much more likely two places are, under each pose (k,), for one thing than for two.

    (k, ...) for places (..., 2).
    """
    places_a, places_b, shape_a, shape_b = a.xy_m, b.xy_m, a.covariance, b.covariance
    dims = max(places_a.ndim, places_b.ndim) - 1
    x, y, heading = poses.T.reshape(3, len(poses), *(1,) * dims)
    c, s = np.cos(heading), np.sin(heading)
    x = places_a[..., 0] - (c * places_b[..., 0] - s * places_b[..., 1]) - x
    y = places_a[..., 1] - (s * places_b[..., 0] + c * places_b[..., 1]) - y
    # the sum of A's covariance and B's turned one, written out: p q / q r
    mean = (shape_b[..., 0, 0] + shape_b[..., 1, 1]) / 2
    half, mixed = (shape_b[..., 0, 0] - shape_b[..., 1, 1]) / 2, shape_b[..., 0, 1]
    turned = (c * c - s * s) * half - 2 * c * s * mixed
    p = shape_a[..., 0, 0] + mean + turned
    r = shape_a[..., 1, 1] + mean - turned
    q = shape_a[..., 0, 1] + 2 * c * s * half + (c * c - s * s) * mixed
    determinant = p * r - q * q
    square = (r * x * x - 2 * q * x * y + p * y * y) / determinant
    found: Array = np.log(_AREA_M2 / (2 * np.pi)) - 0.5 * (np.log(determinant) + square)
    return found.clip(-30.0, None)


def _settle(pose: Array, candidates: Alike) -> tuple[Array, Array]:
    """The pose by least squares over the candidates that it makes likely, and its covariance."""
    a, b, alike, _ = candidates
    pose, normal = pose.copy(), np.eye(3)
    for _ in range(6):
        place = _place(pose[None], a, b)[0]
        weight = 1 / (1 + np.exp(-(np.minimum(alike, 4.0) + place)))
        turn = _rotations(pose[2:])[0]
        x, y = (b.xy_m @ turn.T).T
        off_x, off_y = (a.xy_m - pose[:2]).T - (x, y)
        # weight times the inverse of the sum of covariances, written out: p q / q r
        unsure = a.covariance + turn @ b.covariance @ turn.T
        r, q, p = unsure[:, 0, 0], -unsure[:, 0, 1], unsure[:, 1, 1]
        p, q, r = np.array([p, q, r]) * (weight / (p * r - q * q))
        # by how much x, y and heading pull, and (the mixed terms once) how strongly they are held
        pull_x, pull_y = p * off_x + q * off_y, q * off_x + r * off_y
        turn_x, turn_y = q * x - p * y, r * x - q * y
        (xx, xy, yy, xt, yt, tt, pull, pull_across, pull_round) = np.sum(
            [p, q, r, turn_x, turn_y, turn_y * x - turn_x * y, pull_x, pull_y,
             pull_y * x - pull_x * y], axis=1,
        )  # fmt: skip
        normal = np.array([[xx, xy, xt], [xy, yy, yt], [xt, yt, tt]]) + np.diag([1e-4, 1e-4, 1e-3])
        pose += np.linalg.solve(normal, [pull, pull_across, pull_round])
    return pose, np.asarray(np.linalg.inv(normal), dtype=float)


def _distinct(poses: Array, support: Array) -> list[int]:
    """The best supported poses, none near a better one."""
    chosen: list[int] = []
    for k in np.argsort(-support, kind="stable")[: 40 * _KEPT]:
        apart_m = [np.hypot(*(poses[k, :2] - poses[c, :2])) for c in chosen]
        turned = [abs(float(wrap_angle_rad(poses[k, 2] - poses[c, 2]))) for c in chosen]
        if all(m > 1.5 or t > 0.15 for m, t in zip(apart_m, turned, strict=True)):
            chosen.append(int(k))
        if len(chosen) == _KEPT:
            break
    return chosen


def _places(found: Proposals) -> _Places:
    """Where proposals are, and how unsure that is."""
    along = np.stack([np.cos(found.bearing_rad), np.sin(found.bearing_rad)], axis=1)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    deep = (found.range_std * found.range_m) ** 2 + 0.1**2
    wide = (found.bearing_std_rad * found.range_m) ** 2 + 0.1**2
    return _Places(
        found.xy_m,
        deep[:, None, None] * along[:, :, None] * along[:, None, :]
        + wide[:, None, None] * across[:, :, None] * across[:, None, :],
    )


def _narrow(values: Array) -> Array:
    """Half as wide, nearly twice as fast, and exact enough to choose by."""
    return values.astype(np.float32)


def _rotations(heading_rad: Array) -> Array:
    c, s = np.cos(heading_rad), np.sin(heading_rad)
    return np.stack([np.stack([c, -s], -1), np.stack([s, c], -1)], axis=-2)


def _turned(places: Array, heading_rad: Array) -> Array:
    """Places (k, 2), each turned by its own angle."""
    return np.asarray((_rotations(heading_rad) @ places[..., None])[..., 0])

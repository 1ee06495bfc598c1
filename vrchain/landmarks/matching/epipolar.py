"""Where two panoramas were taken, relative to each other, from matched directions alone.

Robots drive on a plane and carry their cameras upright at one height, so two angles say it all:
the direction in which B lies from A, and B's heading against A's. A point at horizontal ranges
r_a, r_b and slopes t_a, t_b has one height: r_a t_a = r_b t_b. In the triangle of A, B and the
point, r_a sin(alpha - theta) = r_b sin(beta - psi), where theta and psi are the bearings of the
baseline A -> B in A's and in B's frame. Together:

    t_b sin(alpha - theta) = t_a sin(beta - psi)

Two matches determine theta and psi in closed form; RANSAC (Fischler and Bolles, 1981) and a
least-squares polish do the rest.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vrchain.geometry import wrap_angle_rad
from vrchain.seeding import generator

Array = NDArray[np.float64]
Real = NDArray[np.floating]
Matches = tuple[Array, Array, Array, Array]
"""Bearings and slopes from A, then from B, (m,) each."""

_SAMPLES, _AT_ONCE = 800, 100
_MISSED = 1e-4  # probability that no sample yet held two right matches, at which it is enough
_HEARD, _LIKELY = 300, 40  # matches that choose the likely ones of all hypotheses, and how many
_SEVERAL, _SAME_RAD = 200, 0.1  # the same where several are asked for; hypotheses that are one
_TOLERANCE_RAD = 0.005  # about three pixels of a 640-pixel, 60-degree view
_PARALLEL_RAD = 0.01  # rays closer than this to parallel do not tell in front from behind
_POLISH_STEPS = 5
_SIZE_LOG = 0.4  # by how much keypoints may be larger in B than the way to them tells
_ALONG = 0.05  # sine of bearings from the baseline, below which that tells nothing
_NEAR_RAD = 0.03  # parallax of points that tell the scale
_LEAST_LOW_POINTS = 7
_LOWEST = 0.95  # what lies lower still is a mistake; within 20 % on suburbs of seed 1000


@dataclass(frozen=True, eq=False)
class PlanarGeometry:
    """The pose of B relative to A, up to scale.

    direction_rad: bearing of B seen from A. heading_rad: B's heading against A's, anticlockwise.
    back_rad: bearing of A seen from B. inliers: (m,) bool over the matches given.
    direction_std_rad: standard deviation of the direction by the spread of the residuals.
    baseline_heights: distance from A to B in heights of the cameras above the ground, NaN if too
    little of the ground was matched.
    """

    direction_rad: float
    heading_rad: float
    inliers: NDArray[np.bool_]
    direction_std_rad: float
    baseline_heights: float = np.nan

    @property
    def back_rad(self) -> float:
        return float(wrap_angle_rad(self.direction_rad - self.heading_rad + np.pi))

    def ranges(self, bearing_a_rad: float, bearing_b_rad: float) -> tuple[float, float]:
        """Ranges from A and from B, in baselines, of a point seen at these bearings.

        Infinite where the two rays are too nearly parallel to meet.
        """
        da = bearing_a_rad - self.direction_rad
        db = bearing_b_rad + self.heading_rad - self.direction_rad
        parallax = np.sin(db - da)
        if abs(parallax) < _PARALLEL_RAD:
            return np.inf, np.inf
        return abs(float(np.sin(db) / parallax)), abs(float(np.sin(da) / parallax))

    def near(self, other: "PlanarGeometry", within_rad: float = _SAME_RAD / 2) -> bool:
        """Whether another is of about the same direction and heading."""
        turned = wrap_angle_rad(self.heading_rad - other.heading_rad)
        aside = wrap_angle_rad(self.direction_rad - other.direction_rad)
        return bool(max(abs(turned), abs(aside)) < within_rad)

    def obeyed(self, a: Array, b: Array, tolerance_rad: float) -> NDArray[np.bool_]:
        """Which matches, directions (n, 2) from A and from B, may show one point: (n,)."""
        return obeyed([self.direction_rad], [self.heading_rad], a, b, tolerance_rad)[0]


def estimate(
    a: Array, b: Array, min_inliers: int = 8, tolerance_rad: float = _TOLERANCE_RAD
) -> PlanarGeometry | None:
    """Two-view geometry of upright cameras from matched directions; None if unclear.

    a, b: (m, 2) bearing_rad and slope of each match from A and from B.
    """
    found = hypotheses(a, b, 1, min_inliers, tolerance_rad)
    return found[0] if found else None


def hypotheses(
    a: Array, b: Array, most: int, min_inliers: int = 8, tolerance_rad: float = _TOLERANCE_RAD
) -> list[PlanarGeometry]:
    """The geometries that most matches obey, at most so many, none near a better one.

    By what ``estimate`` is given. The first is its answer.
    """
    if len(a) < max(2, min_inliers):
        return []
    matches = _matches(a, b)
    likely = _likely(matches, tolerance_rad, _LIKELY if most == 1 else _SEVERAL)
    counts = _inliers(likely[:, 0], likely[:, 1], matches, tolerance_rad).sum(axis=1)
    tried: list[Array] = []
    found: list[PlanarGeometry] = []
    for angles in likely[np.argsort(-counts, kind="stable")]:
        if len(tried) == most:
            break
        if any(_near(angles, other) for other in tried):
            continue
        tried.append(angles)
        geometry = _polished(angles, matches, min_inliers, tolerance_rad)
        if geometry is not None and not any(geometry.near(other) for other in found):
            found.append(geometry)
    return found


def obeyed(
    direction_rad: ArrayLike, heading_rad: ArrayLike, a: Array, b: Array, tolerance_rad: float
) -> NDArray[np.bool_]:
    """Which matches, (m, 2) from A and from B, may show one point, under each pose (k,): (k, m)."""
    theta = np.asarray(direction_rad, dtype=float)
    return _inliers(theta, theta - np.asarray(heading_rad), _matches(a, b), tolerance_rad)


def of_right_size(
    direction_rad: ArrayLike, heading_rad: ArrayLike, a: Array, b: Array, larger: Array
) -> NDArray[np.bool_]:
    """Which keypoints' sizes fit the ranges that each pose (k,) gives: (k, m), by the law of sines.

    a, b: (m, 2) from A and from B. larger: (m,) size in B over size in A, as a logarithm.
    """
    theta = np.asarray(direction_rad, dtype=float)[:, None]
    sine_a = np.abs(np.sin(a[:, 0] - theta))
    sine_b = np.abs(np.sin(b[:, 0] + np.asarray(heading_rad)[:, None] - theta))
    expected = np.log(np.maximum(sine_b, _ALONG) / np.maximum(sine_a, _ALONG))
    unknown = np.minimum(sine_a, sine_b) < _ALONG
    return np.asarray(unknown | (np.abs(larger - expected) < _SIZE_LOG))


def _near(one: Array, other: Array) -> bool:
    """Whether two hypotheses (theta, psi) are of about one direction and heading."""
    theta, psi = wrap_angle_rad(one - other)
    return bool(abs(theta) < _SAME_RAD and abs(wrap_angle_rad(theta - psi)) < _SAME_RAD)


def _polished(
    angles: Array, matches: Matches, min_inliers: int, tolerance_rad: float
) -> PlanarGeometry | None:
    """The geometry at a hypothesis (theta, psi), by least squares; None: too few obey it."""
    std_rad = np.inf
    for _ in range(_POLISH_STEPS):
        inliers = _inliers(angles[:1], angles[1:], matches, tolerance_rad)[0]
        if inliers.sum() < min_inliers:
            return None
        angles, std_rad = _polish(angles, matches, inliers)
    inliers = _inliers(angles[:1], angles[1:], matches, tolerance_rad)[0]
    if inliers.sum() < min_inliers:
        return None
    direction, heading = (float(wrap_angle_rad(a)) for a in (angles[0], angles[0] - angles[1]))
    alpha, t_a, beta, _ = (x[inliers] for x in matches)
    baseline = _baseline_heights(alpha - angles[0], t_a, beta - angles[1])
    return PlanarGeometry(direction, heading, inliers, std_rad, baseline)


def _matches(a: Array, b: Array) -> Matches:
    alpha, t_a, beta, t_b = np.ascontiguousarray(np.hstack([a, b]).T)
    return alpha, t_a, beta, t_b


def _likely(matches: Matches, tolerance_rad: float, most: int) -> Array:
    """The hypotheses (theta, psi), (k, 2), that most of some matches obey, at most so many.

    Where many matches are right, few hypotheses are enough (Fischler and Bolles, equation 3).
    """
    n = len(matches[0])
    pairs = generator(0, "epipolar", n).integers(0, n, (_SAMPLES, 2))
    pairs = pairs[pairs[:, 0] != pairs[:, 1]]
    heard = generator(0, "heard", n).permutation(n)[:_HEARD]
    # narrow numbers are exact enough to choose by
    alpha, t_a, beta, t_b = (x[heard].astype(np.float32) for x in matches)
    drawn, counts = np.empty((0, 2)), np.empty(0, dtype=np.int64)
    for some in np.split(pairs, range(_AT_ONCE, len(pairs), _AT_ONCE)):
        theta, psi = from_two(matches, some)
        half = len(theta) // 2  # the other half are the opposites
        (sin_a, cos_a), (sin_b, cos_b) = (
            _turned(bearing, angle[:half].astype(np.float32))
            for bearing, angle in ((alpha, theta), (beta, psi))
        )
        ways = _either_way(sin_a, cos_a, t_a, sin_b, cos_b, t_b, tolerance_rad)
        drawn = np.concatenate([drawn, np.column_stack([theta, psi])])
        counts = np.concatenate([counts, *(way.sum(axis=1) for way in ways)])
        share = counts.max(initial=0) / len(heard)
        if (1 - share**2) ** (len(drawn) / 4) < _MISSED:
            break
    return drawn[np.argsort(-counts, kind="stable")[:most]]


def baseline_by_ground(geometry: PlanarGeometry, a: Array, b: Array) -> float:
    """The distance from A to B in heights of the cameras, by matches that obey the geometry.

    a, b: (m, 2) directions. NaN if too little of the ground was matched.
    """
    alpha, t_a, beta, _ = _matches(a, b)
    da, db = alpha - geometry.direction_rad, beta - geometry.direction_rad + geometry.heading_rad
    return _baseline_heights(da, t_a, db)


def _baseline_heights(da: Array, t_a: Array, db: Array) -> float:
    """The scale of the scene: its lowest points are the ground, one camera height down."""
    parallax = np.sin(db - da)
    near = np.abs(parallax) > _NEAR_RAD
    depth = -np.abs(np.sin(db[near]) / parallax[near]) * t_a[near]  # below the camera, in baselines
    depth = depth[depth > 0]
    if len(depth) < _LEAST_LOW_POINTS:
        return np.nan
    return float(1 / np.quantile(depth, _LOWEST))


def from_two(matches: Matches, pairs: NDArray[np.int64]) -> tuple[Array, Array]:
    """All (theta, psi) that satisfy two matches each, of pairs (k, 2), then their opposites."""
    bearing_a, slope_a, bearing_b, slope_b = (x[pairs] for x in matches)
    a = np.stack([slope_b * np.sin(bearing_a), -slope_b * np.cos(bearing_a)], axis=2)
    b = np.stack([slope_a * np.sin(bearing_b), -slope_a * np.cos(bearing_b)], axis=2)
    determinant = np.linalg.det(b)
    usable = np.abs(determinant) > 1e-9
    m = np.linalg.solve(b[usable], a[usable])  # v = m u, and both are unit vectors
    s = np.swapaxes(m, 1, 2) @ m - np.eye(2)
    mean, half = (s[:, 0, 0] + s[:, 1, 1]) / 2, (s[:, 0, 0] - s[:, 1, 1]) / 2
    radius = np.hypot(half, s[:, 0, 1])
    real = radius > np.abs(mean)
    m, mean, radius = m[real], mean[real], radius[real]
    offset, opening = np.arctan2(s[real, 0, 1], half[real]), np.arccos(-mean / radius)
    theta = np.concatenate([(offset + opening) / 2, (offset - opening) / 2])
    u = np.stack([np.cos(theta), np.sin(theta)], axis=1)
    v = np.einsum("kij,kj->ki", np.concatenate([m, m]), u)
    psi = np.arctan2(v[:, 1], v[:, 0])
    return np.concatenate([theta, theta + np.pi]), np.concatenate([psi, psi + np.pi])


def _inliers(theta: Array, psi: Array, matches: Matches, tolerance_rad: float) -> NDArray[np.bool_]:
    """(k hypotheses, m matches) bool: small Sampson distance, and the point in front of both."""
    alpha, t_a, beta, t_b = matches
    (sin_a, cos_a), (sin_b, cos_b) = _turned(alpha, theta), _turned(beta, psi)
    return one_point(sin_a, cos_a, t_a, sin_b, cos_b, t_b, tolerance_rad)


def _turned(bearing_rad: Real, origin_rad: Real) -> tuple[Real, Real]:
    """Sine and cosine of bearings (m,) counted from each of some origins (k,): (k, m) each."""
    sine, cosine = np.sin(bearing_rad), np.cos(bearing_rad)
    s, c = np.sin(origin_rad)[:, None], np.cos(origin_rad)[:, None]
    return sine * c - cosine * s, cosine * c + sine * s


def one_point(
    sin_a: Real, cos_a: Real, t_a: Real, sin_b: Real, cos_b: Real, t_b: Real, tolerance: float
) -> NDArray[np.bool_]:
    """Whether directions from A and from B, counted from the baseline, may show one point."""
    close, along, side_a, side_b = _triangle(sin_a, cos_a, t_a, sin_b, cos_b, t_b, tolerance)
    return close & ((side_a > 0) & (side_b > 0) | along)


def _either_way(
    sin_a: Real, cos_a: Real, t_a: Real, sin_b: Real, cos_b: Real, t_b: Real, tolerance: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """The same for B where the baseline points, and for B in the opposite direction."""
    close, along, side_a, side_b = _triangle(sin_a, cos_a, t_a, sin_b, cos_b, t_b, tolerance)
    ahead, behind = (side_a > 0) & (side_b > 0), (side_a < 0) & (side_b < 0)
    return close & (ahead | along), close & (behind | along)


def _triangle(
    sin_a: Real, cos_a: Real, t_a: Real, sin_b: Real, cos_b: Real, t_b: Real, tolerance: float
) -> tuple[NDArray[np.bool_], NDArray[np.bool_], Real, Real]:
    """Of two directions: a small Sampson distance? One course? On which side of it they meet."""
    residual = t_b * sin_a - t_a * sin_b
    square = sin_a**2 + sin_b**2 + (t_b * cos_a) ** 2 + (t_a * cos_b) ** 2
    close = residual**2 < tolerance**2 * square
    parallax = cos_a * sin_b - sin_a * cos_b
    along = (np.abs(parallax) < _PARALLEL_RAD) & (cos_a * cos_b + sin_a * sin_b > 0)
    return close, along, sin_a * parallax, sin_b * parallax


def sampson(da: Array, t_a: Array, db: Array, t_b: Array) -> tuple[Array, Array]:
    """Sampson distances of matches (m,) from the constraint, and their scale.

    da, db: bearings from A and from B, counted from the baseline; t_a, t_b: slopes.
    """
    sin_a, sin_b = np.sin(da), np.sin(db)
    scale = np.sqrt(sin_a**2 + sin_b**2 + (t_b * np.cos(da)) ** 2 + (t_a * np.cos(db)) ** 2)
    return (t_b * sin_a - t_a * sin_b) / scale, scale


def _polish(angles: Array, matches: Matches, inliers: NDArray[np.bool_]) -> tuple[Array, float]:
    """One Gauss-Newton step on the Sampson distances of the inliers; also theta's deviation."""
    alpha, t_a, beta, t_b = (x[inliers] for x in matches)
    da, db = alpha - angles[0], beta - angles[1]
    residual, scale = sampson(da, t_a, db, t_b)
    jacobian = np.stack([-t_b * np.cos(da), t_a * np.cos(db)], axis=1) / scale[:, None]
    normal = jacobian.T @ jacobian + 1e-12 * np.eye(2)
    covariance = np.linalg.inv(normal) * (residual @ residual) / max(1, len(residual) - 2)
    step = np.linalg.solve(normal, -jacobian.T @ residual)
    return angles + np.clip(step, -0.1, 0.1), float(np.sqrt(covariance[0, 0]))

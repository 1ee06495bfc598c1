"""Two-view geometry of cameras that may be tilted a little, and how likely each pose is.

As in ``epipolar``, but each camera has two more angles, its tilt about its own horizontal axes, by
an expectation that is normal around upright. Each match is right with a chance of its own. Where it
is right, it lies near the constraint, in front of both, and looks larger from where it is nearer;
where not, anywhere. From any start a pose is led uphill by iteratively reweighted least squares
while what counts as near becomes narrower, and its evidence is that of a normal peak (Laplace).
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from vrchain.geometry import wrap_angle_rad
from vrchain.landmarks.matching.epipolar import Matches, from_two
from vrchain.seeding import generator

Array = NDArray[np.float64]
Real = NDArray[np.floating]

TILT_STD_RAD = np.radians(4.0)  # of each axis, expected where a camera is not upright
_NARROWING_RAD = (0.03, 0.02, 0.012, 0.007, 0.004, 0.003, 0.003, 0.003)
_EXACT_STEPS = 4  # of these, from poses that are nearly right
NEAR_RAD = _NARROWING_RAD[-1]  # deviation of a right match from the constraint
_WIDE_RAD, _WIDE_SHARE = 0.012, 0.3  # some right matches are less exact
_ANYWHERE = 0.5  # density of a wrong match's distance from the constraint, 1/rad
_SIZE_STD, _SIZE_WRONG, _SIZE_LEAST = 0.25, 0.8, 0.02  # of the logarithm of how a size changed
_LOOSE, _LOOSE_GAIN = 0.15, (0.4, 1.6)  # some lie on the same thing: behind, in front
_ALONG = 0.05  # sine of bearings from the baseline, below which sizes tell nothing
_PARALLEL_RAD = 0.01
_ROUGH_RAD = 0.02  # how near the constraint matches lie for a pose yet to be led to its peak
_APART_RAD = 0.06  # poses led to different peaks
_TEMPER = 0.4  # matches of one thing are right or wrong together
_MOST_STEP_RAD = 0.15
_SECTORS = 12
_SQRT_2PI = float(np.sqrt(2 * np.pi))


@dataclass(frozen=True)
class Compass:
    """What a compass says of B's heading against A's. wild: share of readings that mean nothing."""

    heading_rad: float
    std_rad: float = np.radians(5.0)
    wild: float = 0.05

    def log_odds(self, heading_rad: Array) -> Array:
        """Of headings (k,), against not knowing."""
        off = wrap_angle_rad(heading_rad - self.heading_rad) / self.std_rad
        peak = np.sqrt(2 * np.pi) / self.std_rad * np.exp(-(off**2) / 2)
        return np.asarray(np.log(self.wild + (1 - self.wild) * peak))


@dataclass(frozen=True, eq=False)
class Peaks:
    """Poses (k, 6): direction of B from A, the same seen from B, tilts of A and of B about x and y.

    log_evidence (k,): of the peak, against all matches being wrong. std_rad (k,): of the direction.
    """

    poses: Array
    log_evidence: Array
    std_rad: Array

    def take(self, index: NDArray[np.integer]) -> Self:
        return replace(self, **{name: values[index] for name, values in vars(self).items()})

    @property
    def tilt_rad(self) -> Array:
        """The larger tilt of the two cameras, (k,)."""
        return np.maximum(*(np.hypot(*self.poses[:, k : k + 2].T) for k in (2, 4)))


@dataclass(frozen=True, eq=False)
class Likelihood:
    """Matched unit rays, a and b, (m, 3); growth (m,): log of sizes in B over those in A.

    chance (m,): that a match is right, before any pose is known.
    """

    a: Real
    b: Real
    growth: Real
    chance: Real
    compass: Compass | None = None

    def coarse(self, directions: Array, near_rad: float) -> Array:
        """Log-odds of upright poses (k, 2), each about ``near_rad`` unsure, with the compass."""
        narrow = replace(self, **{n: getattr(self, n).astype(np.float32)
                                  for n in ("a", "b", "growth", "chance")})  # fmt: skip
        poses = np.zeros((len(directions), 6), np.float32)
        poses[:, :2] = directions
        parts = np.array_split(poses, max(1, len(poses) * len(self.growth) // 200_000))
        odds = np.concatenate([narrow._log_odds(narrow._seen(p, False), near_rad) for p in parts])
        return odds + self._expected(directions)

    def starts(
        self, matches: Matches, most: int, n_pairs: int = 800, n_grid: int = 48
    ) -> tuple[Array, Array]:
        """Upright poses (k, 2) to be led to their peaks, likeliest first, at most so many.

        matches: bearings and slopes of a and b. Two of them determine up to four poses, so many
        pairs are drawn; others are of a grid of so many directions and as many headings, whose
        log-odds are the second answer.
        """
        grid = np.arange(n_grid) * (2 * np.pi / n_grid)
        every = np.stack(np.meshgrid(grid, grid, indexing="ij"), axis=-1).reshape(-1, 2)
        share = self.chance / self.chance.sum()
        draws = generator(0, "pairs of matches", len(share))
        pairs = draws.choice(len(share), (n_pairs, 2), p=share)
        pairs = pairs[pairs[:, 0] != pairs[:, 1]]
        poses = np.concatenate([np.column_stack(from_two(matches, pairs)), every])
        rough = self.coarse(poses, _ROUGH_RAD)
        left, kept = poses[np.argsort(-rough, kind="stable")], np.empty((0, 2))
        while len(left) and len(kept) < most:
            kept = np.concatenate([kept, left[:1]])
            left = left[np.abs(wrap_angle_rad(left - left[0])).max(axis=1) > _APART_RAD]
        return kept, rough[-len(every) :].reshape(n_grid, n_grid)

    def peaks(self, starts: Array, tilted: bool, exact: bool = False) -> Peaks:
        """The peaks that are uphill of poses (k, 6). exact: near them, if they are nearly right."""
        poses = starts.copy()
        n = 6 if tilted else 2
        pull = np.full(n, 1 / TILT_STD_RAD**2)
        pull[:2] = 1e-2
        for near_rad in _NARROWING_RAD[-_EXACT_STEPS if exact else 0 :]:
            seen = self._seen(poses, tilted)
            gradient, curvature = self._descent(seen, poses, near_rad, n)
            gradient[:, 2:] += poses[:, 2:n] * pull[2:]
            if self.compass is not None:
                off = wrap_angle_rad(poses[:, 0] - poses[:, 1] - self.compass.heading_rad)
                stiff = np.exp(-((off / self.compass.std_rad) ** 2) / 2) / self.compass.std_rad**2
                gradient[:, 0] += stiff * off
                gradient[:, 1] -= stiff * off
                curvature[:, :2, :2] += stiff[:, None, None] * np.array([[1, -1], [-1, 1]])
            curvature += np.diag(pull)
            step = np.linalg.solve(curvature, gradient[..., None])[..., 0]
            poses[:, :n] -= np.clip(step, -_MOST_STEP_RAD, _MOST_STEP_RAD)
        odds = self._log_odds(self._seen(poses, tilted), NEAR_RAD) + self._expected(poses)
        odds += (n - 2) / 2 * np.log(pull[-1]) - (poses[:, 2:n] ** 2).sum(axis=1) * pull[-1] / 2
        odds += np.log(2 * np.pi) - np.linalg.slogdet(curvature)[1] / 2
        return Peaks(poses, odds, self._deviation(poses, tilted, curvature))

    def _deviation(self, poses: Array, tilted: bool, curvature: Array) -> Array:
        """Of the directions (k,), where errors within a sector of the picture are of one kind.

        Liang and Zeger, "Longitudinal data analysis using generalized linear models", 1986.
        """
        seen, inverse = self._seen(poses, tilted), np.linalg.inv(curvature)
        n = curvature.shape[-1]
        pulls = self._pulls(seen, NEAR_RAD)[..., None] * seen.slopes(poses, n)
        pulls *= seen.off[..., None]
        sector = (np.arctan2(self.a[:, 1], self.a[:, 0]) * (_SECTORS / 2 / np.pi)).astype(int)
        summed = np.einsum("kmi,ms->ksi", pulls, sector[:, None] == np.unique(sector))
        moved = np.einsum("ki,ksi->ks", inverse[:, 0], summed)
        return np.sqrt(np.maximum(inverse[:, 0, 0], (moved**2).sum(axis=1)))

    def agreeing(self, pose: Array, tolerance_rad: float) -> NDArray[np.bool_]:
        """Which matches lie so near the constraint of one pose (6,), in front of both: (m,)."""
        seen = self._seen(pose[None], True)
        return np.asarray((np.abs(seen.off) < tolerance_rad) & seen.front)[0]

    def upright(self, pose: Array) -> tuple[Array, Array]:
        """The rays as cameras would see them that are not tilted as a pose (6,) says."""
        return raised(self.a, pose[None, 2:4])[0], raised(self.b, pose[None, 4:6])[0]

    def _expected(self, poses: Array) -> Array:
        """Log of what is expected of directions and heading, (k,)."""
        even = np.full(len(poses), -2 * np.log(2 * np.pi))
        if self.compass is None:
            return even
        return even + self.compass.log_odds(poses[:, 0] - poses[:, 1])

    def _seen(self, poses: Real, tilted: bool) -> "_Seen":
        a = raised(self.a, poses[:, 2:4]) if tilted else self.a[None]
        b = raised(self.b, poses[:, 4:6]) if tilted else self.b[None]
        return _Seen.of(a, b, poses[:, :1], poses[:, 1:2])

    def _odds(self, seen: "_Seen", near_rad: float) -> tuple[Real, Real]:
        """Of each match's place and size together, right over wrong, and of its size: (k, m)."""
        unclear = np.minimum(seen.aside_a, seen.aside_b) < _ALONG
        nearer = np.log(np.maximum(seen.aside_b, _ALONG) / np.maximum(seen.aside_a, _ALONG))
        by_chance = _normal(self.growth, _SIZE_WRONG) + _SIZE_LEAST
        size = np.where(unclear, 1.0, _normal(self.growth - nearer, _SIZE_STD) / by_chance)
        near = np.add(*_exact_and_less(seen.off, near_rad))
        return np.asarray(np.where(seen.front, near / _ANYWHERE, 0.0) * size), size

    def _log_odds(self, seen: "_Seen", near_rad: float) -> Array:
        placed, size = self._odds(seen, near_rad)
        behind, before = _LOOSE_GAIN
        odds = (1 - _LOOSE) * placed + _LOOSE * np.where(seen.front, before, behind) * size
        return np.asarray(_TEMPER * np.log(1 - self.chance + self.chance * odds).sum(axis=1))

    def _pulls(self, seen: "_Seen", near_rad: float) -> Array:
        """How strongly each match counts, (k, m): more, the likelier it is right, and exact."""
        placed = self.chance * self._odds(seen, near_rad)[0]
        exact, less = _exact_and_less(seen.off, near_rad)
        share = exact / np.maximum(exact + less, 1e-30)
        weight = share / near_rad**2 + (1 - share) / max(near_rad, _WIDE_RAD) ** 2
        return np.asarray(_TEMPER * placed / (1 - self.chance + placed) * weight)

    def _descent(self, seen: "_Seen", poses: Array, near_rad: float, n: int) -> tuple[Array, Array]:
        """Gradient (k, n) and curvature (k, n, n) of half the sum of squares of right matches."""
        right = self._pulls(seen, near_rad)
        columns = seen.slopes(poses, n)
        gradient = np.einsum("km,kmi,km->ki", right, columns, seen.off)
        weighted = columns * right[..., None]
        return gradient, np.einsum("kmi,kmj->kij", weighted, columns)


@dataclass(frozen=True, eq=False)
class _Seen:
    """Upright rays a, b (k or 1, m, 3) under poses, and (k, m): off, the distance from the
    constraint, its scale, front, and the sines of the angles aside of the baseline."""

    a: Real
    b: Real
    off: Real
    scale: Real
    front: NDArray[np.bool_]
    aside_a: Real
    aside_b: Real

    @classmethod
    def of(cls, a: Real, b: Real, theta: Real, psi: Real) -> "_Seen":
        (side_a, ahead_a), (side_b, ahead_b) = _turned(a, theta), _turned(b, psi)
        up_a, up_b = a[..., 2], b[..., 2]
        off = up_b * side_a - up_a * side_b
        scale = np.sqrt(np.maximum(up_b**2 + side_b**2 + up_a**2 + side_a**2 - 2 * off**2, 1e-6))
        flat_a, flat_b = (np.hypot(ray[..., 0], ray[..., 1]) for ray in (a, b))
        parallax = (ahead_a * side_b - side_a * ahead_b) / (flat_a * flat_b)
        along = (np.abs(parallax) < _PARALLEL_RAD) & (ahead_a * ahead_b + side_a * side_b > 0)
        front = (side_a * parallax > 0) & (side_b * parallax > 0) | along
        return cls(
            a, b, off / scale, scale, front, np.abs(side_a) / flat_a, np.abs(side_b) / flat_b
        )

    def slopes(self, poses: Array, n: int) -> Array:
        """Derivatives of ``off`` by the first two of the pose's angles, or all six, (k, m, n)."""
        theta, psi = poses[:, :1], poses[:, 1:2]
        (side_a, ahead_a), (side_b, ahead_b) = _turned(self.a, theta), _turned(self.b, psi)
        up_a, up_b = self.a[..., 2], self.b[..., 2]
        made = [_stack(-up_b * ahead_a, up_a * ahead_b)]
        if n > 2:
            by_a = _stack(-np.sin(theta) * up_b, np.cos(theta) * up_b, -side_b)
            by_b = _stack(np.sin(psi) * up_a, -np.cos(psi) * up_a, side_a)
            made += [np.cross(ray, by)[..., :2] for ray, by in ((self.a, by_a), (self.b, by_b))]
        return np.asarray(np.concatenate(made, axis=-1) / self.scale[..., None])


def _turned(rays: Real, angle_rad: Real) -> tuple[Real, Real]:
    """Parts of rays to the left of a direction, and along it."""
    x, y, c, s = rays[..., 0], rays[..., 1], np.cos(angle_rad), np.sin(angle_rad)
    return y * c - x * s, x * c + y * s


def raised(rays: Real, tilt_rad: Real) -> Array:
    """Rays (m, 3) of a camera tilted about x and y by each of (k, 2), upright: (k, m, 3)."""
    tilt = np.zeros((len(tilt_rad), 1, 3))
    tilt[:, 0, :2] = tilt_rad
    once = np.cross(tilt, rays[None])
    raised = rays[None] + once + np.cross(tilt, once) / 2
    return np.asarray(raised / np.linalg.norm(raised, axis=-1, keepdims=True))


def _stack(*parts: Real) -> Array:
    return np.stack(np.broadcast_arrays(*parts), axis=-1)


def _exact_and_less(off: Real, near_rad: float) -> tuple[Real, Real]:
    """Densities of right matches so far from the constraint, those that are exact, and the rest."""
    exact = (1 - _WIDE_SHARE) * _normal(off, near_rad)
    return exact, _WIDE_SHARE * _normal(off, max(near_rad, _WIDE_RAD))


def _normal(off: Real, std: float) -> Real:
    return np.asarray(np.exp(-((off / std) ** 2) / 2) / (std * _SQRT_2PI))

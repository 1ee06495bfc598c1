from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from vrchain.geometry import Pose, relative, wrap_angle_rad
from vrchain.landmarks.extraction.proposer import Proposals, nothing
from vrchain.landmarks.matching.constellation import Constellation, join
from vrchain.seeding import generator

N = 30


@cache
def things_m(seed: int = 0) -> NDArray[np.float64]:
    """A street of things on the map, (N, 2)."""
    draws = generator(seed, "things")
    along, aside = draws.uniform(-40, 40, N), draws.choice([-1, 1], N) * draws.uniform(5, 14, N)
    return np.column_stack([along, aside])


def seen(pose: Pose, places_m: NDArray[np.float64], seed: int, noise: float = 1.0) -> Proposals:
    """The things as a robot would place them: bearings within 0.6 degrees, ranges within 10 %."""
    draws = generator(seed, "seen", pose.x_m, pose.y_m)
    away = places_m - pose.xy_m
    n = len(places_m)
    bearing = np.arctan2(away[:, 1], away[:, 0]) - pose.yaw_rad
    none = np.empty(0, dtype=np.int64)
    return Proposals(
        np.ones(n), np.zeros((n, 4)),
        wrap_angle_rad(bearing + noise * 0.01 * draws.normal(size=n)),
        np.hypot(*away.T) * np.exp(noise * 0.1 * draws.normal(size=n)),
        np.full(n, 0.01), np.full(n, 0.1), np.zeros(n, dtype=np.int64),
        np.zeros((n, 1), dtype=np.float32), none, none,
    )  # fmt: skip


def looks(truth: NDArray[np.bool_], sure: float, seed: int) -> NDArray[np.float64]:
    """Log-likelihood ratios that are right on the average: those alike by ``sure`` more."""
    return np.where(truth, sure, -sure) / 2 + generator(seed, "looks").normal(
        scale=np.sqrt(sure), size=truth.shape
    )


def errors(found: Constellation | None, a: Pose, b: Pose) -> NDArray[np.float64]:
    """How far off x_m, y_m and heading are."""
    assert found is not None
    true = relative(a, b)
    return np.r_[found.xy_m - true.xy_m, wrap_angle_rad(found.heading_rad - true.yaw_rad)]


PAIRS = [
    (Pose(0, 0, 0), Pose(2, 1, 0.5)),
    (Pose(-10, 1, 1.0), Pose(8, -2, -2.0)),
    (Pose(-20, 0, 3.0), Pose(18, 2, -3.0)),
]


@pytest.mark.parametrize(("a", "b"), PAIRS)
@pytest.mark.parametrize("sure", [4.0, 8.0])
def test_the_relative_pose_is_found_and_the_things_joined(a: Pose, b: Pose, sure: float) -> None:
    """Looks alone confuse many of thirty things at 4; with their places hardly any."""
    order = generator(1, "order").permutation(N)
    truth = np.arange(N)[:, None] == order[None, :]
    values = looks(truth, sure, 1)
    found = join(seen(a, things_m(), 1), seen(b, things_m()[order], 2), values)
    x_m, y_m, turned_rad = errors(found, a, b)
    assert np.hypot(x_m, y_m) < 1.0 + 0.05 * a.distance_to_m(b.xy_m)
    assert abs(turned_rad) < np.radians(3)
    right = truth[tuple(found.pairs.T)]
    assert right.mean() >= 0.9 and right.sum() >= 0.6 * N
    assert right.mean() >= truth[np.arange(N), values.argmax(axis=1)].mean()
    assert all(len(set(side)) == len(found.pairs) for side in found.pairs.T)  # one to one


def test_twins_are_told_apart_by_what_stands_around_them() -> None:
    """Every thing has a twin that looks the very same; places decide."""
    a, b = PAIRS[1]
    truth = np.eye(N, dtype=bool)
    values = looks(truth, 8.0, 1)
    twin = np.arange(N) ^ 1
    same_looks = np.maximum(values, values[:, twin])
    found = join(seen(a, things_m(), 1), seen(b, things_m(), 2), same_looks)
    assert found is not None
    right = truth[tuple(found.pairs.T)]
    assert right.mean() >= 0.9 and right.sum() >= 0.6 * N


def test_unrelated_places_have_far_less_evidence() -> None:
    a, b = PAIRS[0]
    values = looks(np.eye(N, dtype=bool), 6.0, 1)
    together = join(seen(a, things_m(), 1), seen(b, things_m(), 2), values)
    nothing_alike = looks(np.zeros((N, N), dtype=bool), 6.0, 2)
    apart = join(seen(a, things_m(), 1), seen(b, things_m(7), 2), nothing_alike)
    assert together is not None
    assert apart is None or apart.evidence < together.evidence / 4


def test_the_covariance_tells_how_far_off_the_pose_is() -> None:
    """Squared errors in units of the covariance: three degrees of freedom, on the average."""
    squares = []
    for seed in range(20):
        a, b = Pose(-10, 1, 1.0), Pose(8, -2, -2.0)
        values = looks(np.eye(N, dtype=bool), 8.0, seed)
        found = join(seen(a, things_m(seed), seed), seen(b, things_m(seed), seed + 50), values)
        error = errors(found, a, b)
        squares.append(error @ np.linalg.solve(found.covariance, error))
    assert 0.5 < np.median(squares) < 8


@pytest.mark.parametrize("n", [0, 1])
def test_too_little_gives_nothing(n: int) -> None:
    few = seen(Pose(0, 0, 0), things_m(), 1).take(np.arange(n))
    many = seen(Pose(0, 0, 0), things_m(), 1)
    assert join(few, many, np.zeros((n, N))) is None
    assert join(many, nothing(), np.zeros((N, 0))) is None


def test_the_same_answer_every_time() -> None:
    a, b = PAIRS[1]
    values = looks(np.eye(N, dtype=bool), 6.0, 1)
    first, again = (join(seen(a, things_m(), 1), seen(b, things_m(), 2), values) for _ in range(2))
    assert first is not None and again is not None
    assert (first.xy_m == again.xy_m).all() and (first.pairs == again.pairs).all()

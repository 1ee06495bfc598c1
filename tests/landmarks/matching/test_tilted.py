"""Poses of cameras that are tilted, from directions of known points."""

import cv2
import numpy as np
import pytest
from sights import two_views

from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.landmarks.matching.tilted import Compass, Likelihood

B = Pose(1.5, 2.0, 0.8)
DIRECTION_RAD = Pose(0, 0).bearing_to_rad(B.xy_m)
TRUE = np.array([DIRECTION_RAD, DIRECTION_RAD - B.yaw_rad])


def rays(directions: np.ndarray, tilt_rad: np.ndarray) -> np.ndarray:
    """Of bearings and slopes, as a camera tilted about x and y sees them."""
    made = np.column_stack([np.cos(directions[:, 0]), np.sin(directions[:, 0]), directions[:, 1]])
    made /= np.linalg.norm(made, axis=1, keepdims=True)
    return made @ cv2.Rodrigues(np.array([*tilt_rad, 0.0]))[0]


def seen(
    tilt_a_deg: tuple[float, float] = (0, 0),
    tilt_b_deg: tuple[float, float] = (0, 0),
    compass: Compass | None = None,
    noise_rad: float = 0.001,
) -> Likelihood:
    """A third of the matches is wrong."""
    views = two_views(B, 200, noise_rad, 0.33)
    near, far = (np.linalg.norm(views.points_m[:, :2] - p, axis=1) for p in (0.0, B.xy_m))
    a, b = (rays(s, np.radians(t)) for s, t in ((views.a, tilt_a_deg), (views.b, tilt_b_deg)))
    return Likelihood(a, b, np.log(near / far), np.full(len(a), 0.5), compass)


def start(off_deg: float = 8.0) -> np.ndarray:
    return np.r_[TRUE + np.radians(off_deg) * np.array([1, -0.5]), np.zeros(4)][None]


def off_deg(pose: np.ndarray) -> np.ndarray:
    return np.degrees(np.abs(wrap_angle_rad(pose[:2] - TRUE)))


def test_upright_cameras_need_no_tilt() -> None:
    likelihood = seen()
    upright, tilted = (likelihood.peaks(start(), tilted=t) for t in (False, True))
    assert (off_deg(upright.poses[0]) < 0.2).all() and (off_deg(tilted.poses[0]) < 0.5).all()
    assert upright.log_evidence[0] > tilted.log_evidence[0] > 50
    assert upright.tilt_rad[0] == 0 and np.degrees(tilted.tilt_rad[0]) < 1
    assert 0 < upright.std_rad[0] < tilted.std_rad[0] < 0.02


@pytest.mark.parametrize("tilts_deg", [((3.0, -2.0), (0.0, 0.0)), ((-4.0, 3.0), (2.0, 4.0))])
def test_tilts_are_found_with_the_direction(tilts_deg: tuple[tuple[float, float], ...]) -> None:
    likelihood = seen(*tilts_deg)
    upright, tilted = (likelihood.peaks(start(), tilted=t) for t in (False, True))
    assert tilted.log_evidence[0] > upright.log_evidence[0] + 20
    assert (off_deg(tilted.poses[0]) < 1.5).all()
    # a roll about the way between the two cannot be told from none; what differs can
    assert np.degrees(tilted.tilt_rad[0]) > 2
    right = likelihood.agreeing(tilted.poses[0], 0.006)
    assert right.mean() == pytest.approx(0.67, abs=0.1)
    assert likelihood.agreeing(upright.poses[0], 0.006).mean() < 0.6


def test_rays_are_raised_as_the_pose_says() -> None:
    likelihood, level = seen((3.0, -2.0), (1.0, 4.0)), seen()
    pose = np.r_[TRUE, np.radians([3.0, -2.0, 1.0, 4.0])]
    for made, true in zip(likelihood.upright(pose), (level.a, level.b), strict=True):
        assert np.allclose(made, true, atol=1e-3)


def test_slopes_are_the_derivatives_of_the_distance() -> None:
    """Of matches on the constraint, where the scale does not count."""
    likelihood, pose = seen(noise_rad=0.0), np.r_[TRUE, np.zeros(4)][None]
    slopes, step = likelihood._seen(pose, True).slopes(pose, 6)[0], 1e-6
    right = likelihood.agreeing(pose[0], 1e-4)
    assert right.sum() > 100
    for k in range(6):
        ahead, behind = (
            likelihood._seen(pose + s * step * np.eye(6)[k], True).off[0] for s in (1, -1)
        )
        found = (ahead - behind) / (2 * step)
        assert np.allclose(found[right], slopes[right, k], atol=1e-3)


def test_a_compass_is_one_measurement_among_others() -> None:
    right = Compass(B.yaw_rad)
    wrong = Compass(B.yaw_rad + 1.0)
    turned = np.array([B.yaw_rad, B.yaw_rad + 0.1, B.yaw_rad + 2.0])
    odds = right.log_odds(turned)
    assert odds[0] > odds[1] > odds[2] and odds[2] == pytest.approx(np.log(right.wild), abs=0.01)
    heading = np.linspace(-np.pi, np.pi, 20_001)
    assert np.exp(right.log_odds(heading)).mean() == pytest.approx(1, abs=0.01)
    without, with_right, with_wrong = (
        seen(compass=c).peaks(start(), tilted=False) for c in (None, right, wrong)
    )
    for peaks in (without, with_right, with_wrong):
        assert (off_deg(peaks.poses[0]) < 0.3).all()
    assert with_right.log_evidence[0] > without.log_evidence[0] > with_wrong.log_evidence[0]


def test_rough_odds_are_highest_at_the_true_pose() -> None:
    grid = np.arange(36) * np.pi / 18
    every = np.stack(np.meshgrid(grid, grid, indexing="ij"), axis=-1).reshape(-1, 2)
    odds = seen().coarse(np.concatenate([every, TRUE[None]]), 0.02)
    assert odds.argmax() == len(every)

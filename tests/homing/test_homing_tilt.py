"""Our homing where cameras are tilted, or the compass errs."""

from functools import cache

import numpy as np
import pytest
from sights import look

from vrchain.experiments.landmarks.degradations import tilted
from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.homing import HomeVector, Snapshot, snapshot, step
from vrchain.panorama import CameraRig, Panorama

TALL = CameraRig(n_views=8, width_px=320, height_px=480)
HOME = Pose(0.5, -0.3, 1.0)
STARTS = Pose(2.4, 0.9, -2.0), Pose(-1.0, -1.5, 0.4), Pose(0.2, 2.7, 2.9), Pose(3.6, -1.6, -0.7)


@cache
def sight(pose: Pose, tilt_deg: float, axis_rad: float = 0.0) -> Snapshot:
    return snapshot(tilted(look(pose, TALL), np.radians(tilt_deg), axis_rad))


def off_deg(vector: HomeVector, here: Pose) -> float:
    off_rad = wrap_angle_rad(vector.bearing_rad - here.bearing_to_rad(HOME.xy_m))
    return float(np.degrees(abs(off_rad)))


def test_a_picture_is_tilted_by_the_right_hands_rule() -> None:
    """About the axis ahead, the left side of the camera goes up: it sees higher there."""
    panorama = look(HOME, TALL)
    same = tilted(panorama, 0.0, 1.0)
    assert np.abs(same.views.astype(int) - panorama.views).mean() < 0.5
    back = tilted(tilted(panorama, 0.05, 0.7), -0.05, 0.7)
    middle = slice(100, 380)
    assert np.abs(back.views[:, middle].astype(int) - panorama.views[:, middle]).mean() < 4
    up = int(np.radians(5) * TALL.px_per_rad)
    rolled = tilted(panorama, np.radians(5), 0.0).cylinder
    columns = TALL.cylinder_shape[1]
    left, rows = columns // 4, slice(150, 250)
    seen, higher = rolled[rows, left].astype(int), panorama.cylinder[150 - up : 250 - up, left]
    assert np.abs(seen - higher).mean() < 0.5 * np.abs(seen - panorama.cylinder[rows, left]).mean()


@pytest.mark.parametrize("tilt_deg", [0.0, 1.0, 2.0, 5.0, 10.0, 12.0])
def test_home_lies_where_it_says_though_the_cameras_are_tilted(tilt_deg: float) -> None:
    for k, here in enumerate(STARTS):
        vector = step("epipolar", sight(here, tilt_deg, 1.7 * k), sight(HOME, tilt_deg, 2.5))
        assert vector is not None and not vector.arrived
        assert off_deg(vector, here) < 3 or off_deg(vector, here) < 2 * np.degrees(vector.std_rad)


def test_what_is_tilted_farther_than_15_degrees_is_refused() -> None:
    """As found from matches, which may be a little less; then the answer is right."""
    vectors = [step("epipolar", sight(here, 16.0, 1.7 * k), sight(HOME, 16.0, 2.5))
               for k, here in enumerate(STARTS)]  # fmt: skip
    assert sum(vector is None for vector in vectors) >= 3
    for here, vector in zip(STARTS, vectors, strict=True):
        assert vector is None or (off_deg(vector, here) < 3 and not vector.arrived)


@pytest.mark.parametrize("error_deg", [0.0, 10.0, 90.0])
def test_a_wrong_compass_takes_no_answer_away(error_deg: float) -> None:
    for here in STARTS:
        told = float(wrap_angle_rad(HOME.yaw_rad - here.yaw_rad + np.radians(error_deg)))
        vector = step("epipolar", sight(here, 0.0), sight(HOME, 0.0), told)
        assert vector is not None and off_deg(vector, here) < 1
        assert np.degrees(vector.std_rad) < 3


def test_few_matches_give_a_doubtful_answer_and_a_compass_a_surer_one() -> None:
    here = Pose(2.4, 0.9, -2.0)
    draws = np.random.default_rng(0)
    errors, stds = {}, {}
    told = float(wrap_angle_rad(HOME.yaw_rad - here.yaw_rad))
    for compass in (None, told):
        off, std = [], []
        for _ in range(6):
            few = [
                Snapshot(s.features.take(draws.permutation(len(s.features))[:150]), None)
                for s in (sight(here, 0.0), sight(HOME, 0.0))
            ]
            vector = step("epipolar", *few, compass)
            if vector is not None:
                off.append(off_deg(vector, here))
                std.append(np.degrees(vector.std_rad))
        errors[compass], stds[compass] = off, std
        assert len(off) >= 4 and np.mean(np.array(off) <= 2 * np.array(std)) >= 0.7
    assert np.median(stds[told]) < np.median(stds[None])


def only(snapshot_: Snapshot, low_rad: float, high_rad: float) -> Snapshot:
    """What is seen within some bearings."""
    bearing_rad = snapshot_.features.bearing_rad
    return Snapshot(snapshot_.features.take((bearing_rad > low_rad) & (bearing_rad < high_rad)))


def test_matches_on_one_side_alone_make_no_answer_sure() -> None:
    """One thing may look like another one."""
    here = Pose(2.4, 0.9, -2.0)
    whole = step("epipolar", sight(here, 0.0), sight(HOME, 0.0))
    one_side = step("epipolar", only(sight(here, 0.0), -0.5, 1.0), sight(HOME, 0.0))
    assert whole is not None and np.degrees(whole.std_rad) < 3
    assert one_side is not None and np.degrees(one_side.std_rad) > 20


def test_cameras_that_leave_holes_never_lead_surely_astray() -> None:
    """One that looks ahead, and two, ahead and back, whichever way each robot faces."""
    answers = 0
    for here in STARTS[:2]:
        for views in ((0, 1), (0, 1, 4, 5)):
            for turn in (0, 3, 5):
                looks = [holed(here, tuple((v + turn) % 8 for v in views)), holed(HOME, views)]
                vector = step("epipolar", *looks)
                assert vector is None or not vector.arrived
                if vector is not None:
                    answers += 1
                    off = off_deg(vector, here)
                    assert off < 45 or np.degrees(vector.std_rad) > 20
    assert answers >= 6


@cache
def holed(pose: Pose, views: tuple[int, ...]) -> Snapshot:
    """Only what some views see; the others are black, and masked."""
    whole = look(pose)
    seen = np.zeros(whole.views.shape[:3], bool)
    seen[list(views)] = True
    return snapshot(Panorama(whole.rig, whole.views * seen[..., None], seen))

"""Every homing method where the answer is known, and where there is none."""

import sys
from dataclasses import replace
from types import ModuleType

import numpy as np
import pytest
import sights
from rings import HOME, heading_rad, ring_snapshot
from sights import RIG, look

from vrchain.errors import ImageError, MissionError
from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.homing import METHODS, HomeVector, Snapshot, Views, method_named, snapshot, step
from vrchain.homing.warping import Warping
from vrchain.panorama import CameraRig, Panorama

PLACES = [
    Pose(range_m * np.cos(angle), range_m * np.sin(angle), 2.1 * angle)
    for angle, range_m in zip(np.linspace(-3, 3, 8), [0.5, 1, 2, 3, 4, 1.5, 2.5, 3.5], strict=True)
]
MOST_OFF_DEG = {"epipolar": 0.1, "scale": 3.0, "average landmark vector": 1.0, "warping": 2.1}
WIDE = {**METHODS, "warping": Warping(farthest=0.6, lengths=12)}  # the ring is nearer than suburbs


@pytest.mark.parametrize("compass", [False, True])
@pytest.mark.parametrize("method", METHODS)
def test_home_is_found_in_a_ring_of_landmarks(method: str, compass: bool) -> None:
    home = ring_snapshot(HOME)
    for here in PLACES:
        told = heading_rad(here) if compass else None
        vector = WIDE[method](Views(ring_snapshot(here), home), told)
        assert vector is not None and not vector.arrived
        off_deg = np.degrees(wrap_angle_rad(vector.bearing_rad - here.bearing_to_rad(HOME.xy_m)))
        assert abs(off_deg) < MOST_OFF_DEG[method]
        assert 0 <= vector.std_rad < 0.6 and -np.pi <= vector.bearing_rad < np.pi


@pytest.mark.parametrize("compass", [False, True])
@pytest.mark.parametrize("method", METHODS)
def test_the_robot_is_home_whichever_way_it_faces(method: str, compass: bool) -> None:
    for turn_rad in (0.0, 1.0, -3.0):
        here = Pose(0.02, 0.01, turn_rad)
        told = heading_rad(here) if compass else None
        vector = step(method, ring_snapshot(here), ring_snapshot(HOME), told)
        assert vector is None or vector.arrived
        assert method == "scale" or vector is not None  # there nothing has changed its size


@pytest.mark.parametrize("method", METHODS)
def test_remoteness_grows_with_the_distance(method: str) -> None:
    home = ring_snapshot(HOME)
    vectors = [step(method, ring_snapshot(Pose(-r, 0.0, 2.0)), home) for r in (0.5, 1.0, 1.5)]
    remoteness = [v.remoteness for v in vectors if v is not None]
    assert len(remoteness) == 3 and remoteness == sorted(remoteness)
    if method == "epipolar":
        assert remoteness == pytest.approx([0.5, 1.0, 1.5], rel=0.01)


@pytest.mark.parametrize("compass", [True, False])
@pytest.mark.parametrize("method", ["scale", "average landmark vector"])
def test_by_the_very_same_picture_the_robot_is_home(method: str, compass: bool) -> None:
    """As on the grid of a database: nothing has changed, so no direction follows."""
    home = ring_snapshot(HOME)
    vector = step(method, home, home, 0.0 if compass else None)
    assert vector is not None and vector.arrived


def test_one_of_ones_own(monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("someone")
    module.ahead = lambda views, heading_rad: HomeVector(0.5, 0.1, 9, False, 1.0)  # type: ignore[attr-defined]
    module.none = lambda views, heading_rad: None  # type: ignore[attr-defined]
    module.pair = lambda views, heading_rad: (0.5, 0.1)  # type: ignore[attr-defined]
    module.nowhere = lambda *asked: HomeVector(np.nan, 0.1, 9, False, 1.0)  # type: ignore[attr-defined]
    module.other = 3  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "someone", module)
    here, home = ring_snapshot(PLACES[0]), ring_snapshot(HOME)
    vector = step("someone:ahead", here, home)
    assert vector is not None and vector.bearing_rad == 0.5
    assert step("someone:none", here, home) is None
    for name in ("someone:pair", "someone:nowhere"):
        with pytest.raises(MissionError, match=f"{name}' gave .*expected a HomeVector"):
            step(name, here, home)
    for name in ("someone:other", "someone:missing", "nobody:ahead", "nothing"):
        with pytest.raises(MissionError, match="no homing method"):
            method_named(name)


BLANK = Panorama(RIG, np.full((RIG.n_views, RIG.height_px, RIG.width_px, 3), 90, np.uint8))


@pytest.mark.parametrize("told", [None, 0.3])
@pytest.mark.parametrize("method", METHODS)
def test_a_blank_panorama_gives_no_answer(method: str, told: float | None) -> None:
    nothing, yard = snapshot(BLANK), snapshot(look(Pose(0, 0, 0)))
    for pair in ((nothing, yard), (yard, nothing), (nothing, nothing)):
        assert step(method, *pair, told) is None


@pytest.mark.parametrize("told", [None, 0.3])
@pytest.mark.parametrize("method", ["epipolar", "scale", "average landmark vector"])
def test_keypoints_of_which_none_match_tell_nothing(method: str, told: float | None) -> None:
    ring = ring_snapshot(HOME)
    coded = sights.descriptors(len(ring.features), "another ring")
    other = replace(ring.features, descriptors=coded)
    vector = step(method, Snapshot(other), ring, told)
    assert vector is None or (method == "epipolar" and vector.std_rad > 1 and not vector.arrived)


@pytest.mark.parametrize("method", METHODS)
def test_no_one_is_home_in_another_place(method: str) -> None:
    there = snapshot(look(Pose(0, 0, 1), RIG, sights.boxes("another place")))
    vector = step(method, snapshot(look(Pose(0.5, -0.3, 1.0))), there)
    assert vector is None or not vector.arrived
    assert method != "epipolar" or vector is None or vector.std_rad > 1


@pytest.mark.parametrize("method", METHODS)
def test_cameras_may_differ_in_resolution_but_not_in_height(method: str) -> None:
    home, here = Pose(0.5, -0.3, 1.0), Pose(2.5, 0.7, -2.0)
    fine = snapshot(look(here, CameraRig(n_views=6, width_px=480, height_px=320)))
    vector = step(method, fine, snapshot(look(home)))
    assert vector is not None
    if method == "epipolar":
        off_rad = wrap_angle_rad(vector.bearing_rad - here.bearing_to_rad(home.xy_m))
        assert abs(np.degrees(off_rad)) < 2
    tall = snapshot(look(here, replace(RIG, camera_height_m=1.5)))
    with pytest.raises(ImageError, match=r"one height, got 1\.5 and 1 m"):
        step(method, tall, snapshot(look(home)))


def test_views_that_close_no_ring_have_no_horizon() -> None:
    single = snapshot(look(Pose(0, 0, 0), CameraRig(n_views=1, width_px=320, height_px=240)))
    assert single.horizon is None and len(single.features) > 0
    assert step("warping", single, snapshot(look(Pose(0, 0, 0)))) is None


def test_a_horizon_is_what_is_seen_along_its_bearings() -> None:
    """One bright box at a bearing of half a radian to the left."""
    views = BLANK.views.copy()
    view = int(RIG.view_of_bearing(0.5))
    x_px, _ = RIG.project(view, 0.5, 0.0)
    views[view, :, int(x_px) - 6 : int(x_px) + 7] = 255
    ring = snapshot(Panorama(RIG, views)).horizon
    assert ring is not None and ring.shape == (180,)
    assert (ring.argmax() + 0.5) * np.pi / 90 - np.pi == pytest.approx(0.5, abs=0.03)


def test_what_no_camera_saw_is_not_taken_for_black() -> None:
    """Where two views are missing, the horizon is the mean of the rest, and elsewhere the same."""
    whole = look(Pose(0.3, 0.2, 0.0))
    views, seen = whole.views.copy(), np.ones(whole.views.shape[:3], bool)
    views[2:4], seen[2:4] = 0, False
    full, holed = snapshot(whole).horizon, snapshot(Panorama(RIG, views, seen)).horizon
    assert full is not None and holed is not None
    missing = np.isin(RIG.view_of_bearing((np.arange(180) + 0.5) * np.pi / 90 - np.pi), (2, 3))
    inside = missing & np.roll(missing, 1) & np.roll(missing, -1)
    rest = ~missing & ~np.roll(missing, 1) & ~np.roll(missing, -1)
    assert holed[inside] == pytest.approx(holed[rest].mean(), rel=0.02)
    assert np.array_equal(holed[rest], full[rest])
    assert snapshot(Panorama(RIG, views, np.zeros_like(seen))).horizon is None


def test_an_unknown_method_is_named_with_those_there_are() -> None:
    with pytest.raises(MissionError, match=r"'snapshot': there are epipolar, scale, "):
        step("snapshot", ring_snapshot(HOME), ring_snapshot(HOME))


@pytest.mark.parametrize("method", METHODS)
def test_nothing_is_changed_and_the_same_comes_again(method: str) -> None:
    here, home = ring_snapshot(PLACES[2]), ring_snapshot(HOME)
    before = here.features.bearing_rad.copy(), home.features.bearing_rad.copy()
    assert step(method, here, home) == METHODS[method](Views(here, home), None)
    assert np.array_equal(here.features.bearing_rad, before[0])
    assert np.array_equal(home.features.bearing_rad, before[1])

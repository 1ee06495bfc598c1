"""Other robots' cameras: what the rig shows of them."""

from typing import Any

import cv2
import numpy as np
import pytest

pytest.importorskip("rosbags")

from sights import RIG

from vrchain.errors import BagError
from vrchain.panorama import CameraRig, Panorama
from vrchain.panorama.models import Lens
from vrchain.ros.cameras import Camera, pose_from_rig, ring_of

FOCAL = RIG.focal_px
BENT = (-0.12, 0.04, 0.001, -0.002, -0.004)
FISHEYE = {
    "size_px": (400, 200),
    "focal_px": (150.0, 150.0),
    "middle_px": (199.5, 99.5),
    "distortion": (0.02, -0.004, 0.001, 0.0),
    "equidistant": True,
}
TILTED = {"pitch_deg": 12, "roll_deg": -4}
HIGH = {"size_px": (320, 320), "focal_px": (150, 150), "middle_px": (160, 158)}


def colours(rays: np.ndarray) -> np.ndarray:
    """A world far away that is smoothly coloured, each direction its own."""
    x, y, z = np.moveaxis(rays / np.linalg.norm(rays, axis=-1, keepdims=True), -1, 0)
    waves = np.stack([np.sin(5 * x + 1), np.sin(6 * y + z), np.sin(9 * z - 2 * x)], axis=-1)
    return (128 + 100 * waves).round().astype(np.uint8)


def seen_by(camera: Camera) -> np.ndarray:
    """What a camera shows of it: OpenCV's own inverse of its model."""
    lens = camera.lens
    width_px, height_px = lens.size_px
    x_px, y_px = np.meshgrid(np.arange(width_px), np.arange(height_px))
    points = np.stack([x_px, y_px], axis=-1).reshape(-1, 1, 2).astype(float)
    if lens.equidistant:
        flat = cv2.fisheye.undistortPoints(points, lens.matrix, np.array(lens.distortion))
    else:
        ends = (cv2.TERM_CRITERIA_COUNT, 60, 0)
        bends = np.array(lens.distortion or (0.0,) * 5)
        flat = cv2.undistortPoints(points, lens.matrix, bends, None, None, None, ends)
    rays = np.column_stack([flat.reshape(-1, 2), np.ones(len(flat))]) @ camera.pose[:3, :3].T
    return colours(rays).reshape(height_px, width_px, 3)


def camera(topic: str = "/c", told: dict[str, float] | None = None, **changed: Any) -> Camera:
    known = {"size_px": (320, 200), "focal_px": (FOCAL, FOCAL), "middle_px": (161.3, 97.2)}
    pose = pose_from_rig({"height_m": 1.2} | (told or {}))
    return Camera(topic, Lens(**(known | changed)), pose)


def ring(n: int, told: dict[str, float] | None = None, **changed: Any) -> list[Camera]:
    return [
        camera(f"/c{k}", {"bearing_deg": k * 360 / n + 3} | (told or {}), **changed)
        for k in range(n)
    ]


def truth(rig: CameraRig) -> np.ndarray:
    return Panorama(rig, colours(rig.ray_directions())).cylinder.astype(float)


@pytest.mark.parametrize(
    "cameras",
    [
        ring(8),
        ring(10, distortion=BENT),
        ring(6, **FISHEYE),
        ring(8, TILTED, **HIGH),
        [*ring(8)[:3], *ring(6, **FISHEYE)[2:]],
    ],
    ids=["plain", "bent", "fisheye", "tilted", "mixed"],
)
def test_a_ring_of_other_cameras(cameras: list[Camera]) -> None:
    made = ring_of(cameras)
    assert not made.exact and made.rig.closed and made.rig.camera_height_m == 1.2
    focal_px = np.median([c.lens.focal_px[0] for c in cameras])
    assert made.rig.px_per_rad == pytest.approx(focal_px, rel=0.02)
    panorama = made.panorama([seen_by(c) for c in made.cameras])
    off = panorama.cylinder - truth(made.rig)
    assert np.abs(off).mean() < 1 and np.percentile(np.abs(off), 99.9) < 4
    assert panorama.seen is None and made.seen_deg == 360


def test_the_rigs_own_cameras_are_passed_on() -> None:
    told = {"size_px": (320, 240), "middle_px": (159.5, 119.5)}
    own = [
        camera(f"/c{k}", {"bearing_deg": 45.0 * k, "height_m": 1.0}, **told)
        for k in (3, 1, 0, 2, 7, 6, 5, 4)
    ]
    made = ring_of(own)
    assert made.exact and made.rig == RIG
    assert [c.topic for c in made.cameras] == [f"/c{k}" for k in range(8)]
    views = [seen_by(c) for c in made.cameras]
    assert np.array_equal(made.panorama(views).views, views)
    (first, *others) = made.cameras
    turned = camera("/c0", {"bearing_deg": 0.02, "height_m": 1.0}, **told)
    assert first.topic == "/c0" and not ring_of([turned, *others]).exact


@pytest.mark.parametrize(
    ("cameras", "least_deg", "most_deg"),
    [
        ([camera()], 50, 62),
        ([camera(told={"bearing_deg": 180})], 50, 62),
        ([*ring(8)[:2], ring(8)[7]], 140, 152),
        ([camera("/front"), camera("/back", {"bearing_deg": 180}, **FISHEYE)], 180, 240),
    ],
    ids=["front", "rear", "three", "front and back"],
)
def test_cameras_that_do_not_close_the_ring_leave_holes(
    cameras: list[Camera], least_deg: float, most_deg: float
) -> None:
    made = ring_of(cameras)
    assert made.rig.closed and least_deg < made.seen_deg < most_deg and not made.exact
    panorama = made.panorama([seen_by(c) for c in made.cameras])
    seen = panorama.seen_cylinder
    level = seen[len(seen) // 2]
    assert level.mean() * 360 == pytest.approx(made.seen_deg, abs=2)
    bearings = made.rig.bearing_of_column(np.arange(len(level)))
    towards = [np.abs(np.angle(np.exp(1j * (bearings - c.bearing_rad)))) for c in made.cameras]
    assert level[np.min(towards, axis=0) < np.radians(25)].all()
    off = np.abs(panorama.cylinder - truth(made.rig))
    assert off[seen].mean() < 1 and np.percentile(off[seen], 99.5) < 12
    assert Panorama.decode(panorama.encode()).seen_cylinder.tolist() == seen.tolist()


def test_fisheyes_that_see_behind_themselves() -> None:
    """Two of 200 degrees, back to back, close the ring."""
    wide = FISHEYE | {"size_px": (420, 420), "focal_px": (110, 110), "middle_px": (209.5, 209.5)}
    wide["distortion"] = (0.0,) * 4
    made = ring_of([camera(f"/{b}", {"bearing_deg": b}, **wide) for b in (0, 180)])
    assert made.seen_deg == 360


def test_cameras_that_see_no_horizon_or_have_no_height() -> None:
    with pytest.raises(BagError, match="see nothing at the horizon"):
        ring_of([camera(told={"pitch_deg": -80})])
    low = [camera(told={"height_m": 0.0})]
    with pytest.raises(BagError, match="camera_height_m"):
        ring_of(low)
    assert ring_of(low, 0.7).rig.camera_height_m == 0.7


def test_no_ray_from_behind_falls_into_the_picture() -> None:
    """Beyond where its radial curve rises, a strongly bent model would show rays twice."""
    bent = camera(distortion=(-0.9, 0.0, 0.0, 0.0, 0.0))
    bearings = np.radians(np.arange(-180, 180, 1.0))
    rays = np.stack([np.cos(bearings), np.sin(bearings), 0 * bearings], axis=-1)
    seen = np.degrees(bearings[bent.mounted.pixels_of(rays)[2]])
    assert seen.min() > -45 and seen.max() < 45 and (np.diff(seen) < 1.5).all()

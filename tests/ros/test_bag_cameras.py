"""Other robots' cameras: what the rig shows of them."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rosbags")

from lenses import BENT, FISHEYE, HIGH, TILTED, camera, seen_by, truth
from sights import RIG

from vrchain.errors import BagError, ImageError
from vrchain.panorama import Panorama
from vrchain.ros.cameras import Camera, lens_in, narrowed, picture_of, ring_of


def ring(n: int, told: dict[str, float] | None = None, **changed: Any) -> list[Camera]:
    return [
        camera(f"/c{k}", {"bearing_deg": k * 360 / n + 3} | (told or {}), **changed)
        for k in range(n)
    ]


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


@pytest.mark.parametrize("rectified", [False, True])
def test_a_rectified_fisheye_is_a_pinhole(rectified: bool) -> None:
    """Its camera_info still names the lens that took it."""
    roi = SimpleNamespace(width=0, height=0, x_offset=0, y_offset=0)
    matrix = np.array([[300.0, 0, 320], [0, 300, 240], [0, 0, 1]])
    info = SimpleNamespace(
        k=matrix.ravel(), p=np.column_stack([matrix, np.zeros(3)]).ravel(), roi=roi,
        d=[0.1, 0.0, 0.0, 0.0], distortion_model="equidistant", width=640, height=480,
    )  # fmt: skip
    lens = lens_in("/c/image_rect", info, (640, 480), rectified)
    assert lens.equidistant != rectified
    assert lens.distortion == (() if rectified else (0.1, 0.0, 0.0, 0.0))


def test_a_picture_of_another_size_is_refused() -> None:
    """As when a driver is started again at another resolution."""
    own = camera("/c")
    width_px, height_px = own.lens.size_px
    size = {"width": 2 * width_px, "height": height_px}
    image = SimpleNamespace(
        **size, step=6 * width_px, encoding="rgb8", is_bigendian=0,
        data=np.zeros(6 * width_px * height_px, dtype=np.uint8),
    )  # fmt: skip
    with pytest.raises(ImageError, match=f"/c: expected {width_px} x {height_px} pixels, got"):
        picture_of("/c", image, None, own)


def test_fisheyes_that_see_behind_themselves() -> None:
    """Two of 200 degrees, back to back, close the ring."""
    wide = FISHEYE | {"size_px": (420, 420), "focal_px": (110, 110), "middle_px": (209.5, 209.5)}
    wide["distortion"] = (0.0,) * 4
    made = ring_of([camera(f"/{b}", {"bearing_deg": b}, **wide) for b in (0, 180)])
    assert made.seen_deg == 360


def test_a_circle_in_the_picture_is_all_that_a_fisheye_shows() -> None:
    """By default the picture's corners count too, which are black."""
    wide = camera("/front", **FISHEYE)
    for degrees in (100, 140):
        assert ring_of([narrowed(wide, degrees)]).seen_deg == pytest.approx(degrees, abs=1)
    assert ring_of([wide]).seen_deg > 140
    for bad in (0, 400, "wide", None):
        with pytest.raises(BagError, match="field_of_view_deg"):
            narrowed(wide, bad)


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

"""Each model shows every ray where pictures made by the model's inverse have it."""

from collections.abc import Callable
from functools import partial

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from vrchain.panorama import CameraRig, Panorama
from vrchain.panorama.models import (
    FACES,
    Field,
    Lens,
    Mirror,
    cubemap,
    cylinder,
    equirectangular,
    fisheye,
    mirror,
    pinhole,
)
from vrchain.panorama.resampling import Camera, resampled, sharpness, shrunk, tilted

Rays = NDArray[np.float64]
RIG = CameraRig(8, 80, 200, 60.0)


def grid(width_px: int, height_px: int) -> tuple[NDArray, NDArray]:
    x, y = np.meshgrid(np.arange(width_px), np.arange(height_px))
    return (x + 0.5) / width_px, (y + 0.5) / height_px


def painted(rays: Rays) -> NDArray[np.uint8]:
    """The colour tells the direction."""
    unit = rays / np.maximum(np.linalg.norm(rays, axis=-1, keepdims=True), 1e-9)
    return np.round(127.5 + 120 * unit).astype(np.uint8)


def polar(bearing: NDArray, elevation: NDArray) -> Rays:
    flat = np.cos(elevation)
    parts = flat * np.cos(bearing), flat * np.sin(bearing), np.sin(elevation)
    return np.stack(np.broadcast_arrays(*parts), axis=-1)


def in_part() -> Camera:
    """200 degrees wide from 110 left, -20 to 45 degrees high."""
    u, v = grid(800, 300)
    picture = painted(polar(np.radians(110 - 200 * u), np.radians(45 - 65 * v)))
    part = Field(np.radians(110), np.radians(200), np.radians(45), np.radians(65))
    return Camera(picture, partial(equirectangular, field=part))


def rolled() -> Camera:
    u, v = grid(1000, 300)
    slope = 0.9 - 1.4 * v
    picture = painted(polar(np.pi - 2 * np.pi * u, np.arctan(slope)))
    return Camera(picture, partial(cylinder, field=Field(top=0.9, height=1.4)), closed=True)


def mirrored(flip: bool) -> Camera:
    """Ahead is at the top of the ring, left on its left; offset 30 turns it to the right."""
    u, v = grid(900, 700)
    x, y = u * 900 - 0.45 * 900, v * 700 - 0.55 * 700
    radius = np.hypot(x, y) / 700
    bearing = np.arctan2(-x, -y) + np.radians(30)
    down = (radius - 0.1) / (0.4 - 0.1)
    down = 1 - down if flip else down
    picture = painted(polar(bearing, np.radians(35 - 55 * down)))
    ring = Mirror((0.45, 0.55), 0.1, 0.4, 30.0, flip, np.radians(-20), np.radians(35))
    return Camera(picture, partial(mirror, ring=ring))


def round_about(width_px: int) -> Camera:
    """190 degrees in each circle: one ahead, or one ahead and one behind."""
    u, v = grid(width_px, 600)
    x = u * width_px
    circle = x // 600 if width_px == 1200 else np.zeros_like(x)
    right, down = x - circle * 600 - (300 if width_px == 1200 else width_px / 2), v * 600 - 300
    radius = np.hypot(right, down)
    angle = radius / 300 * np.radians(95)
    rays = np.stack([np.cos(angle), -np.sin(angle) * right / radius,
                     -np.sin(angle) * down / radius], axis=-1)  # fmt: skip
    behind = rays * [-1, -1, 1]
    picture = painted(np.where((circle == 1)[..., None], behind, rays))
    return Camera(picture, partial(fisheye, field_rad=np.radians(190)))


def cube(layout: tuple[str, ...]) -> Camera:
    u, v = grid(200, 200)
    a, b, one = 2 * u - 1, 2 * v - 1, np.ones_like(u)
    faces = {
        "f": (one, -a, -b), "b": (-one, a, -b), "l": (a, one, -b), "r": (-a, -one, -b),
        "u": (b, -a, one), "d": (-b, -a, -one), ".": (one, one, one),
    }  # fmt: skip
    rows = [np.concatenate([painted(np.stack(faces[f], -1)) for f in row], 1) for row in layout]
    return Camera(np.concatenate(rows, 0), partial(cubemap, layout=layout))


def lensed(equidistant: bool, distortion: tuple[float, ...]) -> Camera:
    lens = Lens((640, 400), (300.0, 310.0), (322.0, 195.0), distortion, equidistant)
    x, y = np.meshgrid(np.arange(640.0), np.arange(400.0))
    points = np.stack([x, y], -1).reshape(-1, 1, 2)
    undo = cv2.fisheye.undistortPoints if equidistant else cv2.undistortPoints
    right, down = undo(points, lens.matrix, np.array(distortion))[:, 0].T
    rays = np.stack([np.ones_like(right), -right, -down], -1).reshape(400, 640, 3)
    return Camera(painted(rays), partial(pinhole, lens=lens))


CAMERAS: dict[str, tuple[Callable[[], Camera], float]] = {
    "part of a sphere": (in_part, 0.2),
    "cylinder": (rolled, 0.5),
    "mirror": (lambda: mirrored(False), 0.3),
    "mirror flipped": (lambda: mirrored(True), 0.3),
    "one fisheye": (lambda: round_about(600), 0.5),
    "fisheye in a wide picture": (lambda: round_about(900), 0.5),
    "two fisheyes": (lambda: round_about(1200), 1.0),
    "cube strip": (lambda: cube((FACES,)), 1.0),
    "cube cross": (lambda: cube((".u..", "lfrb", ".d..")), 1.0),
    "cube of two rows": (lambda: cube(("rlu", "dfb")), 1.0),
    "pinhole": (lambda: lensed(False, (-0.2, 0.05, 0.001, -0.001)), 0.1),
    "equidistant": (lambda: lensed(True, (0.01, -0.002, 0.0, 0.0)), 0.1),
}


@pytest.mark.parametrize("scale", [0.37, 0.556, 0.81])
@pytest.mark.parametrize("made", [lambda: round_about(1200), lambda: cube((FACES,))])
def test_made_smaller_two_circles_are_two_still_and_six_faces_six(
    made: Callable[[], Camera], scale: float
) -> None:
    """As it was met: 3800 x 1900 pixels became 1057 x 528, which is no picture of two circles."""
    (small,) = shrunk([made()], scale)
    off = np.abs(resampled([small], RIG).views.astype(float) - (127.5 + 120 * RIG.ray_directions()))
    assert np.percentile(off, 99) < 8


@pytest.mark.parametrize("name", CAMERAS)
def test_every_pixel_shows_its_own_direction(name: str) -> None:
    made, least = CAMERAS[name]
    panorama = resampled([made()], RIG)
    seen = np.ones(panorama.views.shape[:3], bool) if panorama.seen is None else panorama.seen
    off = np.abs(panorama.views.astype(float) - (127.5 + 120 * RIG.ray_directions()))
    assert off[seen].max() < 4.5
    assert seen.mean() >= least and (seen.mean() == 1) == (least == 1)
    assert not panorama.views[~seen].any()


@pytest.mark.parametrize(
    ("pitch_deg", "roll_deg", "ray"),
    [(10.0, 0.0, (1, 0, 0)), (0.0, 20.0, (0, 0, 1)), (-7.0, 12.0, (1, 1, 1))],
)
def test_a_tilted_camera_is_set_upright(
    pitch_deg: float, roll_deg: float, ray: tuple[float, float, float]
) -> None:
    """Middle up, right side down; what it saw is where it is in the world."""
    turn = tilted(pitch_deg, roll_deg)
    if not roll_deg:
        assert np.degrees(np.arcsin(turn @ ray)[2]) == pytest.approx(pitch_deg)
    if not pitch_deg:
        assert (turn @ ray)[1] == pytest.approx(-np.sin(np.radians(roll_deg)))
        assert (turn @ (0, -1, 0))[2] < 0
    u, v = grid(1000, 500)
    rays = polar(np.pi - 2 * np.pi * u, np.pi / 2 - np.pi * v) @ turn.T
    camera = Camera(painted(rays), equirectangular, turn, closed=True)
    found = resampled([camera], RIG)
    assert found.seen is None
    assert np.abs(found.views - (127.5 + 120 * RIG.ray_directions())).max() < 3


def test_of_two_cameras_the_nearer_axis_counts() -> None:
    flat = Lens((200, 200), (100.0, 100.0), (99.5, 99.5))
    pictures = [np.full((200, 200, 3), c, np.uint8) for c in (50, 200)]
    turns = [np.eye(3), np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])]
    cameras = [
        Camera(p, partial(pinhole, lens=flat), t) for p, t in zip(pictures, turns, strict=True)
    ]
    found: Panorama = resampled(cameras, RIG)
    middle = found.cylinder[found.cylinder.shape[0] // 2, :, 0]
    bearing = np.degrees(RIG.bearing_of_column(np.arange(len(middle))))
    assert (middle[(bearing > -42) & (bearing < 43)] == 50).all()
    assert (middle[(bearing > 47) & (bearing < 132)] == 200).all()
    assert not middle[np.abs(bearing + 110) < 55].any()


@pytest.mark.parametrize(
    ("made", "across", "along"),
    [(rolled, 1000 / 2 / np.pi, 300 / 1.4), (in_part, 800 / np.radians(200), 300 / np.radians(65))],
)
def test_pixels_a_radian(made: Callable[[], Camera], across: float, along: float) -> None:
    found = sharpness([made()])
    assert (found.across, found.along) == (pytest.approx(across, 0.01), pytest.approx(along, 0.01))


def test_what_looks_up_sees_nothing_of_the_horizon() -> None:
    u, v = grid(100, 20)
    high = Field(top=np.pi / 2, height=np.radians(20))
    camera = Camera(painted(polar(u, v)), partial(equirectangular, field=high))
    assert sharpness([camera]).reach == 0

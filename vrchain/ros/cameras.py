"""A robot's own cameras made into our rig: calibration, where they look, and what they show.

Cameras are taken to see from one point: things near by are joined badly where two are far apart.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from vrchain.errors import BagError, SpecError
from vrchain.panorama import CameraRig, Panorama
from vrchain.panorama.sources import rig_for

Array = NDArray[np.float64]
Seen = NDArray[np.bool_]

_SAME_PX = 0.02  # a camera is the rig's own if no pixel is farther off
_COLUMNS = 4096  # of a turn, at most
_REACH = 1.4  # slope, at most
_STEP_DEG = 0.5  # of the search for what is seen
_NARROWEST_DEG, _WIDEST_DEG = 20.0, 110.0  # of one view, where the ring does not close
_FISHEYE = ("equidistant", "fisheye", "kannala_brandt4")
_PINHOLE = ("plumb_bob", "rational_polynomial", "radtan", "radial-tangential", "none", "")


@dataclass(frozen=True, eq=False)
class Camera:
    """One calibrated camera.

    intrinsics_px: fx, fy, cx, cy, pixel centres whole numbers. distortion: OpenCV's coefficients,
    of its fisheye model if ``fisheye``. pose: (4, 4), from the optical frame (x right, y down,
    z ahead) to the robot's.
    """

    topic: str
    width_px: int
    height_px: int
    intrinsics_px: tuple[float, float, float, float]
    distortion: tuple[float, ...] = ()
    fisheye: bool = False
    pose: Array | None = None

    @property
    def bearing_rad(self) -> float:
        """Where its axis points."""
        assert self.pose is not None
        return float(np.arctan2(self.pose[1, 2], self.pose[0, 2]))

    def text(self) -> str:
        """One line about it."""
        kind = "equidistant" if self.fisheye else "pinhole"
        degrees = float(np.degrees(self.bearing_rad))
        size = f"{self.width_px} x {self.height_px}"
        return f"{self.topic}: {size}, {kind}, looks along {degrees:.1f} degrees"

    def pixels(self, rays: ArrayLike) -> tuple[Array, Array, Array]:
        """x and y of rays (..., 3) in the robot's frame, and the cosine to its axis.

        The cosine is -1 where it does not see the ray.
        """
        assert self.pose is not None
        x, y, z = np.moveaxis(np.asarray(rays, float) @ self.pose[:3, :3], -1, 0)
        ahead = z / np.sqrt(x**2 + y**2 + z**2)
        with np.errstate(divide="ignore", invalid="ignore"):
            right, down, seen = self._fisheye(x, y, z) if self.fisheye else self._pinhole(x, y, z)
        fx, fy, cx, cy = self.intrinsics_px
        x_px, y_px = fx * right + cx, fy * down + cy
        inside = (np.abs(x_px - (self.width_px - 1) / 2) <= self.width_px / 2) & (
            np.abs(y_px - (self.height_px - 1) / 2) <= self.height_px / 2
        )
        return x_px, y_px, np.where(seen & inside, ahead, -1.0)

    def _fisheye(self, x: Array, y: Array, z: Array) -> tuple[Array, Array, Seen]:
        """Kannala and Brandt (2006), as OpenCV and ROS's ``equidistant`` have it."""
        k = (1.0, *self.distortion[:4])

        def bent(off_rad: Array) -> Array:
            return sum(c * off_rad ** (2 * i + 1) for i, c in enumerate(k)) + np.zeros_like(off_rad)

        r = np.hypot(x, y)
        off_rad = np.arctan2(r, z)
        scale = np.where(r > 0, bent(off_rad) / np.where(r > 0, r, 1.0), 1.0)
        return x * scale, y * scale, off_rad <= _rising(bent, np.pi)

    def _pinhole(self, x: Array, y: Array, z: Array) -> tuple[Array, Array, Seen]:
        """With Brown's distortion, plain or rational."""
        k1, k2, p1, p2, k3, k4, k5, k6 = (*self.distortion[:8], *[0.0] * 8)[:8]

        def stretched(r: Array) -> Array:
            s = r**2
            return r * (1 + s * (k1 + s * (k2 + s * k3))) / (1 + s * (k4 + s * (k5 + s * k6)))

        right, down = x / z, y / z
        s = right**2 + down**2
        r = np.sqrt(s)
        scale = np.where(r > 0, stretched(r) / np.where(r > 0, r, 1.0), 1.0)
        bent_x = right * scale + 2 * p1 * right * down + p2 * (s + 2 * right**2)
        bent_y = down * scale + p1 * (s + 2 * down**2) + 2 * p2 * right * down
        return bent_x, bent_y, (z > 0) & (r <= _rising(stretched, 8.0))


def _rising(curve: Any, end: float) -> float:
    """How far a radial curve rises: beyond, other rays would seem to fall into the picture."""
    at = np.linspace(0, end, 800)
    falls = np.flatnonzero(np.diff(curve(at)) <= 0)
    return float(at[falls[0]]) if len(falls) else end


def camera_of(topic: str, info: Any, width_px: int, height_px: int, rectified: bool) -> Camera:
    """From a CameraInfo and the size of the pictures. BagError if it tells no calibration."""
    matrix = np.asarray(info.k if hasattr(info, "k") else info.K, float).reshape(3, 3)
    distortion = tuple(float(d) for d in (info.d if hasattr(info, "d") else info.D))
    if rectified:
        matrix = np.asarray(info.p if hasattr(info, "p") else info.P, float).reshape(3, 4)
        distortion = ()
    fx, fy, cx, cy = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
    if not (np.isfinite(matrix).all() and fx > 0 and fy > 0):
        raise BagError(f"{topic}: its camera_info holds no calibration (zeros): give --rig")
    roi = info.roi
    if (roi.width, roi.height) == (width_px, height_px):
        cx, cy = cx - roi.x_offset, cy - roi.y_offset
    elif info.width and info.height and (info.width, info.height) != (width_px, height_px):
        across, down = width_px / info.width, height_px / info.height
        if abs(across / down - 1) > 0.01:
            raise BagError(
                f"{topic}: its pictures are {width_px} x {height_px} and its calibration is of "
                f"{info.width} x {info.height}: give --rig"
            )
        fx, cx = fx * across, (cx + 0.5) * across - 0.5
        fy, cy = fy * down, (cy + 0.5) * down - 0.5
    return _checked(
        topic, (width_px, height_px), (fx, fy, cx, cy), info.distortion_model, distortion
    )


def camera_from_rig(topic: str, told: Mapping[str, Any], size_px: tuple[int, int]) -> Camera:
    """From one camera of a rig's file. BagError."""
    try:
        size_px = told.get("resolution", size_px)
        camera = _checked(
            topic,
            (int(size_px[0]), int(size_px[1])),
            tuple(float(v) for v in told["intrinsics"]),
            told.get("distortion_model", "none"),
            tuple(float(v) for v in told.get("distortion_coeffs", ())),
        )
        return replace(camera, pose=pose_from_rig(told))
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise BagError(
            f"rig: expected of camera {topic} intrinsics [fx, fy, cx, cy] and bearing_deg, got "
            f"{error!r} in {dict(told)}"
        ) from error


def pose_from_rig(told: Mapping[str, Any]) -> Array:
    """(4, 4), from the optical frame to the robot's: bearing left, pitch up, roll clockwise."""
    bearing, pitch, roll = (
        np.radians(float(told.get(f"{name}_deg", 0.0))) for name in ("bearing", "pitch", "roll")
    )
    about_z, up = _turn(2, bearing), _turn(1, -pitch)
    optical = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    pose = np.eye(4)
    pose[:3, :3] = about_z @ up @ optical @ _turn(2, roll)
    pose[2, 3] = float(told.get("height_m", 0.0))
    return pose


def _turn(axis: int, angle_rad: float) -> Array:
    vector = np.zeros(3)
    vector[axis] = angle_rad
    return np.asarray(cv2.Rodrigues(vector)[0], float)


def _checked(
    topic: str,
    size_px: tuple[int, int],
    intrinsics: tuple[float, ...],
    model: str,
    distortion: tuple[float, ...],
) -> Camera:
    if model not in (*_FISHEYE, *_PINHOLE):
        known = ", ".join(filter(None, (*_PINHOLE, *_FISHEYE)))
        raise BagError(f"{topic}: expected a distortion model of {known}, got {model!r}")
    if len(intrinsics) != 4 or not np.isfinite([*intrinsics, *distortion]).all():
        raise BagError(f"{topic}: expected four intrinsics and finite distortion, got others")
    fx, fy, cx, cy = (float(v) for v in intrinsics)
    bends = distortion if any(distortion) else ()
    return Camera(topic, *size_px, (fx, fy, cx, cy), bends, model in _FISHEYE)


@dataclass(frozen=True, eq=False)
class Ring:
    """Cameras and the rig that their pictures are resampled into.

    exact: they are the rig's own, view by view, so that pictures are passed on as they are.
    """

    rig: CameraRig
    cameras: tuple[Camera, ...]
    exact: bool

    @cached_property
    def _maps(self) -> list[list[tuple[int, NDArray, NDArray, NDArray]]]:
        """For each view: cameras, their pixels, and where they are those nearest to their axis."""
        return [_sources(rays, self.cameras) for rays in self.rig.ray_directions()]

    def panorama(self, pictures: Sequence[NDArray[np.uint8]]) -> Panorama:
        """What the rig would have seen, of one picture of each camera, in their order."""
        if self.exact:
            return Panorama(self.rig, np.stack(pictures))
        rig = self.rig
        views = np.zeros((rig.n_views, rig.height_px, rig.width_px, 3), dtype=np.uint8)
        for view, sources in zip(views, self._maps, strict=True):
            for camera, x_px, y_px, mine in sources:
                shown = cv2.remap(
                    pictures[camera], x_px, y_px, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
                )
                cv2.copyTo(shown, mine, view)
        return Panorama(rig, views)


def _sources(
    rays: NDArray[np.float32], cameras: Sequence[Camera]
) -> list[tuple[int, NDArray, NDArray, NDArray]]:
    found = [camera.pixels(rays) for camera in cameras]
    ahead = np.stack([f[2] for f in found])
    best = np.where(ahead.max(axis=0) > -1, ahead.argmax(axis=0), -1)
    return [
        (k, x.astype(np.float32), y.astype(np.float32), (best == k).astype(np.uint8))
        for k, (x, y, _) in enumerate(found)
        if (best == k).any()
    ]


def ring_of(cameras: Sequence[Camera], camera_height_m: float | None = None) -> Ring:
    """The rig that shows what the cameras see all around, or else what they see ahead.

    camera_height_m: above the ground; else as their poses tell. BagError: nothing is seen ahead,
    or the height is not known.
    """
    told_m = float(np.median([c.pose[2, 3] for c in cameras if c.pose is not None]))
    height_m = round(told_m if camera_height_m is None else camera_height_m, 6)
    ordered = sorted(
        cameras, key=lambda c: (round(c.bearing_rad % (2 * np.pi), 3) % 6.283, c.topic)
    )
    try:
        if own := _own_rig(ordered, height_m):
            return Ring(own, tuple(ordered), True)
        density = min(float(np.median([c.intrinsics_px[0] for c in ordered])), _COLUMNS / 2 / np.pi)
        return Ring(_covered_rig(ordered, height_m, density), tuple(ordered), False)
    except SpecError as error:
        raise BagError(f"{error}: if it is the height, give --rig a camera_height_m") from error


def _own_rig(ordered: Sequence[Camera], height_m: float) -> CameraRig | None:
    """The rig whose cameras these are, pixel by pixel; None if they are others."""
    first, n = ordered[0], len(ordered)
    degrees = float(np.degrees(2 * np.arctan(first.width_px / 2 / first.intrinsics_px[0])))
    if (n > 1 and n * degrees < 360) or not 5 <= degrees <= 120:
        return None
    rig = CameraRig(n, first.width_px, first.height_px, round(degrees, 6), height_m)
    x_px, y_px = np.meshgrid(np.arange(rig.width_px), np.arange(rig.height_px))
    for camera, rays in zip(ordered, rig.ray_directions(), strict=True):
        if (camera.width_px, camera.height_px) != (rig.width_px, rig.height_px):
            return None
        x, y, _ = camera.pixels(rays)
        if not max(np.abs(x - x_px).max(), np.abs(y - y_px).max()) < _SAME_PX:
            return None
    return rig


def _covered_rig(cameras: Sequence[Camera], height_m: float, density: float) -> CameraRig:
    """What all bearings, or those around straight ahead, have in common up and down."""
    bearings = np.radians(np.arange(-180, 180, _STEP_DEG))
    slopes = np.linspace(0, _REACH, 57)
    seen = np.stack([_seen(cameras, bearings, s) & _seen(cameras, bearings, -s) for s in slopes])
    level = np.logical_and.accumulate(seen)  # from the horizon on
    if level[0].all():
        reach = slopes[np.flatnonzero(level.all(axis=1))[-1]]
        return rig_for(density, height_m, float(max(reach, slopes[1])))
    ahead = np.abs(bearings)
    free_rad = ahead[~level[0]].min()
    half_deg = min(np.degrees(free_rad) - _STEP_DEG, _WIDEST_DEG / 2)
    if 2 * half_deg < _NARROWEST_DEG:
        blind = np.degrees(bearings[~level[0]])
        raise BagError(
            f"the cameras see neither all around nor straight ahead: nothing is seen at "
            f"{len(blind) * _STEP_DEG:.0f} of 360 degrees, first at {blind[0]:.0f}"
        )
    within = level[:, ahead < np.radians(half_deg)].all(axis=1)
    reach = max(slopes[np.flatnonzero(within)[-1]], slopes[1])
    width_px = round(2 * density * np.tan(np.radians(half_deg)))
    height_px = 2 * int(density * reach)
    return CameraRig(1, width_px, height_px, float(2 * half_deg), height_m)


def _seen(cameras: Sequence[Camera], bearings: Array, slope: float) -> Seen:
    rays = np.stack([np.cos(bearings), np.sin(bearings), np.full_like(bearings, slope)], axis=-1)
    return np.max([c.pixels(rays)[2] for c in cameras], axis=0) > -1

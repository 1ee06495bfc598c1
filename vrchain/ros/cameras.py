"""A robot's own cameras made into our rig: calibration, where they look, and what they show.

Cameras are taken to see from one point: things near by are joined badly where two are far apart.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrchain.errors import BagError, ImageError, SpecError
from vrchain.geometry import rotation_z
from vrchain.panorama import CameraRig, Panorama
from vrchain.panorama.calibrations import OPTICAL, lens_of
from vrchain.panorama.models import Lens, pinhole
from vrchain.panorama.resampling import REACH, Source, drawn, rig_for, sources_of, tilted
from vrchain.panorama.resampling import Camera as Mounted
from vrchain.panorama.rig import MOST_SIDE_PX
from vrchain.ros.messages import rgb_of

Array = NDArray[np.float64]

_SAME_PX = 0.02  # a camera is the rig's own if no pixel is farther off
_COLUMNS = 4096  # of a turn, at most
_KEYS = (
    "topic", "intrinsics", "distortion_model", "distortion_coeffs", "resolution", "encoding",
    "field_of_view_deg", "bearing_deg", "pitch_deg", "roll_deg", "height_m",
)  # fmt: skip
_KALIBRS = (
    "rostopic", "camera_model", "cam_overlaps", "T_cam_imu", "T_cn_cnm1", "timeshift_cam_imu",
)  # fmt: skip
_STEP_DEG = 0.5  # of the search for what is seen
_BLIND = 10  # percentile of how far up and down cameras see that leave gaps between them


@dataclass(frozen=True, eq=False)
class Camera:
    """One calibrated camera. pose: (4, 4), from the optical frame (x right, y down, z ahead) to
    the robot's.
    """

    topic: str
    lens: Lens
    pose: Array

    @property
    def bearing_rad(self) -> float:
        """Where its axis points."""
        return float(np.arctan2(self.pose[1, 2], self.pose[0, 2]))

    def text(self) -> str:
        """One line about it."""
        kind = "equidistant" if self.lens.equidistant else "pinhole"
        (width_px, height_px), degrees = self.lens.size_px, np.degrees(self.bearing_rad)
        return f"{self.topic}: {width_px} x {height_px}, {kind}, looks along {degrees:.1f} degrees"

    @property
    def mounted(self) -> Mounted:
        """It, without a picture."""
        blank = np.broadcast_to(np.uint8(0), (*self.lens.size_px[::-1], 3))
        return Mounted(blank, partial(pinhole, lens=self.lens), self.pose[:3, :3] @ OPTICAL)


def picture_of(topic: str, image: Any, label: str | None, camera: Camera) -> NDArray[np.uint8]:
    """A message's picture, (h, w, 3) uint8 RGB. ImageError if there is none, or of another size."""
    try:
        picture = rgb_of(image, label)
    except ImageError as error:
        raise ImageError(f"{topic}: {error}") from error
    width_px, height_px = camera.lens.size_px
    if picture.shape[:2] != (height_px, width_px):
        raise ImageError(
            f"{topic}: expected {width_px} x {height_px} pixels, got "
            f"{picture.shape[1]} x {picture.shape[0]}"
        )
    return picture


def lens_in(topic: str, info: Any, size_px: tuple[int, int], rectified: bool) -> Lens:
    """From a CameraInfo and the size of the pictures. BagError if it tells no calibration."""
    matrix = np.asarray(info.k if hasattr(info, "k") else info.K, float).reshape(3, 3)
    distortion, model = info.d if hasattr(info, "d") else info.D, info.distortion_model
    if rectified:  # as by a pinhole, whatever lens took them
        matrix = np.asarray(info.p if hasattr(info, "p") else info.P, float).reshape(3, 4)
        distortion, model = (), "plumb_bob"
    fx, fy, cx, cy = matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2]
    roi, (width_px, height_px) = info.roi, size_px
    if not (np.isfinite(matrix).all() and fx > 0 and fy > 0):
        raise BagError(f"{topic}: its camera_info holds no calibration (zeros): give --rig")
    if (roi.width, roi.height) == size_px:
        cx, cy = cx - roi.x_offset, cy - roi.y_offset
    elif info.width and info.height and (info.width, info.height) != size_px:
        across, down = width_px / info.width, height_px / info.height
        if abs(across / down - 1) > 0.01:
            raise BagError(
                f"{topic}: its pictures are {width_px} x {height_px} and its calibration is of "
                f"{info.width} x {info.height}: give --rig"
            )
        fx, cx = fx * across, (cx + 0.5) * across - 0.5
        fy, cy = fy * down, (cy + 0.5) * down - 0.5
    try:
        return lens_of(size_px, (fx, fy, cx, cy), model, distortion)
    except ValueError as error:
        raise BagError(f"{topic}: its camera_info is of no use ({error}): give --rig") from error


def check_told(path: Path, cameras: Any) -> None:
    """BagError where a rig's file tells of cameras what is none of ours, nor of kalibr's."""
    if not isinstance(cameras, list) or not all(isinstance(c, dict) for c in cameras):
        raise BagError(f"{path}: expected cameras as a list of tables, got {cameras!r:.80}")
    if unknown := {str(key) for told in cameras for key in told} - {*_KEYS, *_KALIBRS}:
        raise BagError(
            f"{path}: expected of a camera {', '.join(_KEYS)}, got {', '.join(sorted(unknown))}"
        )
    for told in cameras:
        if not isinstance(label := told.get("encoding", ""), str):
            raise BagError(f"{path}: expected of a camera an encoding, as rgb8, got {label!r}")


def lens_from_rig(topic: str, told: Mapping[str, Any], size_px: tuple[int, int]) -> Lens:
    """From one camera of a rig's file. BagError."""
    try:
        width_px, height_px = map(int, told.get("resolution", size_px))
        inner = [float(v) for v in told["intrinsics"]]
        model, distortion = told.get("distortion_model", "none"), told.get("distortion_coeffs", ())
        return lens_of((width_px, height_px), inner, model, distortion)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise BagError(
            f"rig: expected of camera {topic} intrinsics [fx, fy, cx, cy], got {error!r} in "
            f"{dict(told)}"
        ) from error


def narrowed(camera: Camera, degrees: Any) -> Camera:
    """A camera whose picture shows a circle of so many degrees; what is around it is black."""
    if not isinstance(degrees, int | float) or not 0 < degrees <= 360:
        raise BagError(f"rig: expected of {camera.topic} field_of_view_deg to 360, got {degrees!r}")
    return replace(camera, lens=replace(camera.lens, most_rad=float(np.radians(degrees / 2))))


def pose_from_rig(told: Mapping[str, Any]) -> Array:
    """(4, 4), from the optical frame to the robot's: bearing left, pitch up, roll clockwise.

    BagError.
    """
    names = ("bearing_deg", "pitch_deg", "roll_deg", "height_m")
    try:
        bearing, pitch, roll, height_m = (float(told.get(name, 0.0)) for name in names)
    except (TypeError, ValueError) as error:
        raise BagError(
            f"rig: expected numbers as {', '.join(names)}, got {error!r} in {dict(told)}"
        ) from error
    pose = np.eye(4)
    pose[:3, :3] = rotation_z(np.radians(bearing)) @ tilted(pitch, roll) @ OPTICAL.T
    pose[2, 3] = height_m
    return pose


@dataclass(frozen=True, eq=False)
class Ring:
    """Cameras and the rig that their pictures are resampled into.

    seen_deg: of a turn at the horizon; the rest is masked. exact: the cameras are the rig's own,
    view by view, so that pictures are passed on as they are.
    """

    rig: CameraRig
    cameras: tuple[Camera, ...]
    seen_deg: float
    exact: bool

    @cached_property
    def _sources(self) -> list[list[Source]]:
        return list(sources_of([camera.mounted for camera in self.cameras], self.rig))

    def panorama(self, pictures: Sequence[NDArray[np.uint8]]) -> Panorama:
        """What the rig would have seen, of one picture of each camera, in their order."""
        if self.exact:
            return Panorama(self.rig, np.stack(pictures))
        found = drawn(pictures, self._sources, self.rig)
        whole = self.seen_deg == 360  # then so is the cylinder; corners of views lie outside of it
        return Panorama(self.rig, found.views) if whole else found


def ring_of(cameras: Sequence[Camera], camera_height_m: float | None = None) -> Ring:
    """The rig that shows what the cameras see around them.

    camera_height_m: above the ground; else as their poses tell. BagError: nothing is seen at the
    horizon, or the height is not known.
    """
    told_m = float(np.median([c.pose[2, 3] for c in cameras]))
    try:
        height_m = round(told_m if camera_height_m is None else float(camera_height_m), 6)
    except (TypeError, ValueError) as error:
        raise BagError(
            f"rig: expected a number as camera_height_m, got {camera_height_m!r}"
        ) from error
    ordered = tuple(
        sorted(cameras, key=lambda c: (round(c.bearing_rad % (2 * np.pi), 3) % 6.283, c.topic))
    )
    try:
        if own := _own_rig(ordered, height_m):
            return Ring(own, ordered, 360.0, True)
        return Ring(*_covered(ordered, height_m), False)
    except SpecError as error:
        raise BagError(f"{error}: if it is the height, give --rig a camera_height_m") from error


def _own_rig(ordered: Sequence[Camera], height_m: float) -> CameraRig | None:
    """The rig whose cameras these are, pixel by pixel; None if they are others."""
    first, n = ordered[0].lens, len(ordered)
    width_px, height_px = first.size_px
    degrees = round(float(np.degrees(2 * np.arctan(width_px / 2 / first.focal_px[0]))), 6)
    if n * degrees < 360 or not 5 <= degrees <= 120 or max(first.size_px) > MOST_SIDE_PX:
        return None
    rig = CameraRig(n, width_px, height_px, degrees, height_m)
    x_px, y_px = np.meshgrid(np.arange(rig.width_px), np.arange(rig.height_px))
    for camera, rays in zip(ordered, rig.ray_directions(), strict=True):
        x, y, seen = camera.mounted.pixels_of(rays)
        if camera.lens.size_px != first.size_px or not seen.all():
            return None
        if not max(np.abs(x - x_px).max(), np.abs(y - y_px).max()) < _SAME_PX:
            return None
    return rig


def _covered(
    ordered: tuple[Camera, ...], height_m: float
) -> tuple[CameraRig, tuple[Camera, ...], float]:
    """As high and as low as all bearings have in common, or most where some are not seen."""
    bearings = np.radians(np.arange(-180, 180, _STEP_DEG))
    slopes = np.linspace(0, REACH, 57)
    mounted = [camera.mounted for camera in ordered]
    seen = np.stack([_seen(mounted, bearings, s) & _seen(mounted, bearings, -s) for s in slopes])
    level = np.logical_and.accumulate(seen)  # from the horizon on
    there = level[0]
    if not there.any():
        raise BagError(
            "the cameras see nothing at the horizon: are their poses right? --rig may tell them"
        )
    reach = slopes[level.sum(axis=0)[there] - 1]
    common = max(float(np.percentile(reach, 0 if there.all() else _BLIND)), slopes[1])
    density = min(float(np.median([c.lens.focal_px[0] for c in ordered])), _COLUMNS / 2 / np.pi)
    return rig_for(density, height_m, common), ordered, float(there.sum() * _STEP_DEG)


def _seen(cameras: Sequence[Mounted], bearings: Array, slope: float) -> NDArray[np.bool_]:
    rays = np.stack([np.cos(bearings), np.sin(bearings), np.full_like(bearings, slope)], axis=-1)
    return np.any([camera.pixels_of(rays)[2] for camera in cameras], axis=0)

"""Camera models: which pixel of a source shows a ray.

A model is one function, from rays in the camera's frame (x along its middle, y left, z up) and the
source's (width, height) to its pixels; pixels' centres are whole numbers. What the camera does not
see is NaN or lies outside the picture.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Rays = NDArray[np.floating]
Size = tuple[int, int]
Pixels = tuple[NDArray[np.floating], NDArray[np.floating]]
Model = Callable[[Rays, Size], Pixels]
_FLAT_RAD = np.radians(89.5)  # off the axis, at most, on a flat picture


@dataclass(frozen=True)
class Field:
    """What a picture shows: azimuths from left_rad on, rightwards, and rows from top downwards.

    top, height: elevations in radians; of a ``cylinder`` slopes.
    """

    left_rad: float = np.pi
    width_rad: float = 2 * np.pi
    top: float = np.pi / 2
    height: float = np.pi

    @property
    def closed(self) -> bool:
        """Whether the left and the right edge meet."""
        return abs(self.width_rad - 2 * np.pi) < 1e-6


def equirectangular(rays: Rays, size_px: Size, field: Field = Field()) -> Pixels:
    """Azimuth over the width, falling from left to right; elevation over the height."""
    x, y, z = np.moveaxis(rays, -1, 0)
    elevation = np.arctan2(z, np.hypot(x, y))
    return _column(x, y, size_px, field), (field.top - elevation) / field.height * size_px[1] - 0.5


def cylinder(rays: Rays, size_px: Size, field: Field) -> Pixels:
    """Azimuth over the width; slope, the tangent of elevation, over the height."""
    x, y, z = np.moveaxis(rays, -1, 0)
    slope = z / np.maximum(np.hypot(x, y), 1e-9)
    return _column(x, y, size_px, field), (field.top - slope) / field.height * size_px[1] - 0.5


def _column(x: Rays, y: Rays, size_px: Size, field: Field) -> NDArray[np.floating]:
    right_rad = (field.left_rad - np.arctan2(y, x)) % (2 * np.pi)
    if field.closed:  # both sides of the seam, half a pixel, are within the picture
        right_rad = np.where((y >= 0) & (right_rad > 6), right_rad - 2 * np.pi, right_rad)
    return right_rad / field.width_rad * size_px[0] - 0.5


@dataclass(frozen=True)
class Mirror:
    """A mirror round a camera, by the parameters of Brains on Board's unwrapper.

    The picture is as that of a camera that looks down: ahead at its top, left at its left. One that
    looks up into a mirror shows left at the right: mirror its picture first.

    centre: of the ring, as shares of width and height; inner, outer: its radii, as shares of the
    height; offset_deg: by how much the bottom of the picture is turned from behind. flip: the outer
    radius looks highest, not the inner. highest_rad, lowest_rad: the elevations at the radii; None:
    as if pixels were square halfway between them, the horizon in the middle.
    """

    centre: tuple[float, float] = (0.5, 0.5)
    inner: float = 0.1
    outer: float = 0.5
    offset_deg: float = 0.0
    flip: bool = False
    lowest_rad: float | None = None
    highest_rad: float | None = None

    @property
    def span_rad(self) -> tuple[float, float]:
        """Lowest and highest elevation."""
        half = (self.outer - self.inner) / (self.outer + self.inner)
        low = -half if self.lowest_rad is None else self.lowest_rad
        return low, half if self.highest_rad is None else self.highest_rad


def mirror(rays: Rays, size_px: Size, ring: Mirror) -> Pixels:
    """Azimuth around the ring, the top of the picture ahead; elevation along its radius."""
    width_px, height_px = size_px
    x, y, z = np.moveaxis(rays, -1, 0)
    low, high = ring.span_rad
    down = (high - np.arctan2(z, np.hypot(x, y))) / (high - low)
    down = np.where((down < 0) | (down > 1), np.nan, down)
    out = 1 - down if ring.flip else down
    radius_px = height_px * (ring.inner + out * (ring.outer - ring.inner))
    turn_rad = np.pi - np.arctan2(y, x) + np.radians(ring.offset_deg)
    middle_x, middle_y = ring.centre[0] * width_px - 0.5, ring.centre[1] * height_px - 0.5
    return middle_x - radius_px * np.sin(turn_rad), middle_y + radius_px * np.cos(turn_rad)


def fisheye(rays: Rays, size_px: Size, field_rad: float) -> Pixels:
    """Equidistant: the angle from the axis over the radius of a circle as high as the picture.

    A picture twice as wide as high has two circles side by side, ahead and behind.
    """
    width_px, height_px = size_px
    x, y, z = np.moveaxis(rays, -1, 0)
    across_px, left_px = min(width_px, height_px), np.zeros(x.shape)
    if width_px == 2 * height_px:
        behind = x < 0
        x, y = np.abs(x), np.where(behind, -y, y)
        left_px, width_px = np.where(behind, height_px, 0.0), height_px
    off = np.hypot(y, z)
    angle = np.arctan2(off, x)
    radius_px = np.where(angle > field_rad / 2 + 1e-6, np.nan, angle / field_rad * across_px)
    scale = radius_px / np.maximum(off, 1e-12)
    return left_px + width_px / 2 - 0.5 - scale * y, height_px / 2 - 0.5 - scale * z


FACES = "frblud"  # front, right, back, left, up, down
_AXES = {
    "f": ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
    "r": ((0, -1, 0), (-1, 0, 0), (0, 0, -1)),
    "b": ((-1, 0, 0), (0, 1, 0), (0, 0, -1)),
    "l": ((0, 1, 0), (1, 0, 0), (0, 0, -1)),
    "u": ((0, 0, 1), (0, -1, 0), (1, 0, 0)),
    "d": ((0, 0, -1), (0, -1, 0), (-1, 0, 0)),
}  # where each looks, and where its right and its lower edge lie


def cubemap(rays: Rays, size_px: Size, layout: Sequence[str]) -> Pixels:
    """Six square faces in a grid of cells: layout has for each row the letters of ``FACES``.

    Up and down join the front face: their lower and upper edge. Other letters are empty cells.
    """
    side_px = size_px[0] / len(layout[0])
    x_px, y_px = np.full(rays.shape[:-1], np.nan), np.full(rays.shape[:-1], np.nan)
    largest = np.abs(rays).max(axis=-1)
    for row, faces in enumerate(layout):
        for column, face in enumerate(faces):
            if face not in _AXES:
                continue
            ahead, right, down = (rays @ np.array(axis, dtype=float) for axis in _AXES[face])
            own = ahead >= largest * (1 - 1e-9)
            for pixels, part, cell in ((x_px, right, column), (y_px, down, row)):
                within = (part[own] / ahead[own] + 1) / 2 * side_px - 0.5
                pixels[own] = cell * side_px + within.clip(0, side_px - 1)
    return x_px, y_px


@dataclass(frozen=True)
class Lens:
    """A calibrated camera: its picture's size, focal lengths and middle in pixels, its distortion.

    distortion: OpenCV's coefficients of the pinhole model (4 to 14), or its fisheye model's four
    where ``equidistant``. most_rad: off the axis, beyond which the picture shows nothing.
    """

    size_px: Size
    focal_px: tuple[float, float]
    middle_px: tuple[float, float]
    distortion: tuple[float, ...] = ()
    equidistant: bool = False
    most_rad: float = np.pi

    @property
    def matrix(self) -> NDArray[np.float64]:
        """The (3, 3) camera matrix."""
        (fx, fy), (cx, cy) = self.focal_px, self.middle_px
        return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])

    def radius(self, off_rad: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far from the middle rays so far off the axis are, in focal lengths."""
        if self.equidistant:
            return np.sum(
                [c * off_rad ** (2 * n + 1) for n, c in enumerate((1.0, *self.distortion))], 0
            )
        k1, k2, _, _, k3, k4, k5, k6 = (*self.distortion, *[0.0] * 8)[:8]
        r = np.tan(off_rad)
        s = r**2
        return r * (1 + s * (k1 + s * (k2 + s * k3))) / (1 + s * (k4 + s * (k5 + s * k6)))

    @property
    def widest_rad(self) -> float:
        """How far off the axis rays are shown: beyond, the polynomials fold back."""
        off_rad = np.linspace(0, np.pi if self.equidistant else _FLAT_RAD, 1000)
        falls = np.flatnonzero(np.diff(self.radius(off_rad)) <= 0)
        return min(self.most_rad, float(off_rad[falls[0] if len(falls) else -1]))


def pinhole(rays: Rays, size_px: Size, lens: Lens) -> Pixels:
    """A calibrated camera; a picture of another size than its calibration's is scaled."""
    x, y, z = np.moveaxis(np.asarray(rays, dtype=float), -1, 0)
    off_rad = np.arctan2(np.hypot(y, z), x)
    shown = off_rad <= lens.widest_rad
    x_px, y_px = np.full(x.shape, np.nan), np.full(x.shape, np.nan)
    if shown.any():
        right, down = -y[shown], -z[shown]
        if lens.equidistant:  # OpenCV's own ends at 90 degrees from the axis
            scale = lens.radius(off_rad[shown]) / np.maximum(np.hypot(right, down), 1e-12)
            found = (
                np.stack([right, down], axis=-1) * scale[:, None] * lens.focal_px + lens.middle_px
            )
        else:
            points = np.stack([right, down, x[shown]], axis=-1).reshape(-1, 1, 3)
            given, still = np.array(lens.distortion), np.zeros(3)
            found = cv2.projectPoints(points, still, still, lens.matrix, given)[0].reshape(-1, 2)
        scale = np.array(size_px) / np.array(lens.size_px)
        x_px[shown], y_px[shown] = ((found + 0.5) * scale - 0.5).T
    return x_px, y_px

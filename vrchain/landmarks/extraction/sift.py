"""SIFT keypoints of panoramas and photographs, and their matches: the only module that runs SIFT.

Lowe (2004), "Distinctive Image Features from Scale-Invariant Keypoints".
"""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Self

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from vrchain.geometry import wrap_angle_rad
from vrchain.panorama import Panorama

_SEAM_PX = 64  # the cylinder is continued this far, so that keypoints at the seam are whole
_ROWS_A_PASS = 1024
_REACH = 3.0  # of a descriptor's weights, their standard deviation, in sizes of its keypoint
_AVX2 = 11  # OpenCV's number of it


@dataclass(frozen=True, eq=False)
class Keypoints:
    """Keypoints of one image: xy_px (n, 2), size_px (n,), descriptors (n, 128) uint8."""

    xy_px: NDArray[np.float64]
    size_px: NDArray[np.float64]
    descriptors: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.xy_px)


@dataclass(frozen=True, eq=False)
class Directions:
    """What is seen in some directions of the robot's frame.

    bearing_rad (n,), slope (n,) tangent of elevation, and what a subclass tells of each, (n, ...).
    """

    bearing_rad: NDArray[np.float64]
    slope: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.bearing_rad)

    def take(self, index: ArrayLike) -> Self:
        """Those at ``index`` (integers or a mask)."""
        i = np.asarray(index)
        return replace(self, **{name: values[i] for name, values in vars(self).items()})

    def near(self, bearing_rad: float, half_rad: float) -> Self:
        """Those at most so far beside a bearing."""
        return self.take(np.abs(wrap_angle_rad(self.bearing_rad - bearing_rad)) <= half_rad)

    @property
    def directions(self) -> NDArray[np.float64]:
        """(n, 2): bearing_rad and slope."""
        return np.column_stack([self.bearing_rad, self.slope])

    @property
    def rays(self) -> NDArray[np.float64]:
        """(n, 3): unit vectors."""
        x, y = np.cos(self.bearing_rad), np.sin(self.bearing_rad)
        rays = np.column_stack([x, y, self.slope])
        return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))

    def along(self, rays: NDArray[np.float64]) -> Self:
        """The same, seen in other directions (n, 3)."""
        x, y, z = rays.T
        return replace(self, bearing_rad=np.arctan2(y, x), slope=z / np.hypot(x, y))


@dataclass(frozen=True, eq=False)
class Features(Directions):
    """Keypoints of one panorama: size_rad (n,), descriptors (n, 128) uint8."""

    size_rad: NDArray[np.float64]
    descriptors: NDArray[np.uint8]


NO_FEATURES = Features(np.empty(0), np.empty(0), np.empty(0), np.empty((0, 128), dtype=np.uint8))


def detect(image_rgb: NDArray[np.uint8]) -> Keypoints:
    """SIFT with OpenCV's defaults and no limit on the number of keypoints."""
    return _detect(_grey(image_rgb))


def _grey(image_rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.asarray(cv2.cvtColor(image_rgb, cv2.COLOR_RGB2GRAY), dtype=np.uint8)


def _detect(grey: NDArray[np.uint8]) -> Keypoints:
    with _steadily():
        found, descriptors = cv2.SIFT.create().detectAndCompute(grey, None)
    xy_px = np.array([k.pt for k in found], dtype=float).reshape(-1, 2)
    size_px = np.array([k.size for k in found])
    if descriptors is None:
        descriptors = np.empty((0, 128))
    return Keypoints(xy_px, size_px, descriptors.astype(np.uint8))


@contextmanager
def _steadily() -> Iterator[None]:
    """Without AVX2, OpenCV's last bits depend on how the picture is shared out to threads."""
    threads = cv2.getNumThreads()
    if not cv2.checkHardwareSupport(_AVX2):
        cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(threads)


def extract(panorama: Panorama, shrink: int = 1) -> Features:
    """The features of a panorama, found on its cylinder; nothing is cut at the seam.

    shrink: they are looked for on fewer pixels, that many times each way: a third of the time with
    2, and of the keypoints, the larger ones.
    """
    return _on_columns(panorama, 0, panorama.cylinder.shape[1], shrink)


def extract_near(panorama: Panorama, bearing_rad: float, half_rad: float) -> Features:
    """Those at most so far beside a bearing, found on that part of the cylinder alone.

    But for a few of the largest, which reach beyond it, and some across the seam, where pixels are
    halved otherwise, they are those of ``extract``.
    """
    rig, columns = panorama.rig, panorama.cylinder.shape[1]
    wide = int(np.ceil(2 * half_rad * rig.px_per_rad)) + _SEAM_PX
    if not rig.closed or wide + 2 * _SEAM_PX >= columns:
        return extract(panorama).near(bearing_rad, half_rad)
    left_px = float(rig.column_of_bearing(wrap_angle_rad(bearing_rad + half_rad)))
    first = int(left_px // _SEAM_PX) * _SEAM_PX  # the same pixels as of the whole, halved again
    found = _on_columns(panorama, first, wide)
    return replace(found, bearing_rad=wrap_angle_rad(found.bearing_rad)).near(bearing_rad, half_rad)


def _on_columns(panorama: Panorama, first: int, wide: int, shrink: int = 1) -> Features:
    """Features on so many columns of the cylinder from the first on, round where it is closed."""
    rig, image = panorama.rig, panorama.cylinder
    pad = min(_SEAM_PX, wide) if rig.closed else 0
    columns = np.arange(first - pad, first + wide + pad) % image.shape[1]
    found = _detect_on(_grey(image).take(columns, axis=1), shrink)
    column = found.xy_px[:, 0] - pad
    own = (column >= -0.5) & (column < wide - 0.5)
    if panorama.seen_cylinder is not None:
        own &= _clear(found, panorama.seen_cylinder.take(columns, axis=1))
    return Features(
        rig.bearing_of_column(column[own] + first),
        rig.slope_of_row(found.xy_px[own, 1]),
        found.size_px[own] / rig.px_per_rad,
        found.descriptors[own],
    )


def _clear(found: Keypoints, seen: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Keypoints around which all is seen, as far as their descriptors look: (n,)."""
    bordered = np.pad(seen.astype(np.uint8), ((0, 0), (1, 1)), constant_values=1)
    off_px = cv2.distanceTransform(bordered, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[:, 1:-1]
    column, row = (np.round(v).astype(int) for v in found.xy_px.T)
    inside = row.clip(0, len(seen) - 1), column.clip(0, seen.shape[1] - 1)
    return np.asarray(off_px[inside] > _REACH * found.size_px, dtype=bool)


def _detect_on(grey: NDArray[np.uint8], shrink: int) -> Keypoints:
    """What is found on fewer pixels, in pixels of the whole."""
    if shrink == 1:
        return _detect(grey)
    rows, columns = (pixels // shrink for pixels in grey.shape)
    fewer = cv2.resize(grey, (columns, rows), interpolation=cv2.INTER_AREA).astype(np.uint8)
    found = _detect(fewer)
    scale = np.array([grey.shape[1] / columns, grey.shape[0] / rows])
    return Keypoints((found.xy_px + 0.5) * scale - 0.5, found.size_px * shrink, found.descriptors)


def root(descriptors: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Descriptors whose distance is Hellinger's: few large numbers count less (RootSIFT).

    Arandjelovic and Zisserman, "Three things everyone should know to improve object retrieval",
    2012. So short that products are exact in float32.
    """
    wide = descriptors.astype(np.float32)
    found = np.sqrt(wide / np.maximum(wide.sum(axis=1, keepdims=True), 1.0))
    return np.asarray(np.round(found * 2048) / 2048, np.float32)


def mutual_matches(
    a: NDArray[np.uint8] | NDArray[np.float32],
    b: NDArray[np.uint8] | NDArray[np.float32],
    ratio: float = 0.8,
    either: bool = False,
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Indices (m,), (m,) of descriptors that are each other's nearest and pass the ratio test.

    The ratio test (nearest over second nearest distance) is asked in both directions, or, with
    ``either``, in one of them. Distances of uint8 descriptors are exact: whole numbers below 2**24
    in float32.
    """
    return matches_and_ratios(a, b, ratio, either)[:2]


def matches_and_ratios(
    a: NDArray[np.uint8] | NDArray[np.float32],
    b: NDArray[np.uint8] | NDArray[np.float32],
    ratio: float,
    either: bool = False,
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.float32]]:
    """The same, and the ratio of each (m,): the larger one of its two directions."""
    if min(len(a), len(b)) < 2:
        none = np.empty(0, dtype=np.int64)
        return none, none, np.empty(0, dtype=np.float32)
    nearest, of_a = _nearest(a, b)
    index_a = np.arange(len(a)) if either else np.flatnonzero(of_a < ratio)
    asked = np.unique(nearest[index_a])  # few pass: the others need not be asked back
    back, of_b = np.full(len(b), -1), np.full(len(b), np.inf, dtype=np.float32)
    back[asked], of_b[asked] = _nearest(b[asked], a)
    index_b = nearest[index_a]
    both = np.stack([of_a[index_a], of_b[index_b]])
    passed = (both < ratio).any(axis=0) if either else (both < ratio).all(axis=0)
    good = (back[index_b] == index_a) & passed
    return index_a[good], index_b[good], both.max(axis=0)[good]


def _nearest(
    a: NDArray[np.uint8] | NDArray[np.float32], b: NDArray[np.uint8] | NDArray[np.float32]
) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Of each of a the nearest of b, and its distance over that of the second nearest."""
    wide_a, wide_b = a.astype(np.float32), b.astype(np.float32)
    norm_a, norm_b = ((wide**2).sum(axis=1) for wide in (wide_a, wide_b))
    index, ratio = np.empty(len(a), dtype=np.int64), np.empty(len(a), dtype=np.float32)
    for start in range(0, len(a), _ROWS_A_PASS):
        rows = slice(start, start + _ROWS_A_PASS)
        square = (-2 * wide_a[rows]) @ wide_b.T
        square += norm_b  # in place: new memory takes longer than the sums
        index[rows], first, second = _two_smallest(square)
        first += norm_a[rows]
        second += norm_a[rows]
        ratio[rows] = np.sqrt(np.divide(first, second, out=np.ones_like(first), where=second > 0))
    return index, ratio


def _two_smallest(
    square: NDArray[np.float32],
) -> tuple[NDArray[np.int64], NDArray[np.float32], NDArray[np.float32]]:
    """Of each row: where its smallest value is, that value, and the next."""
    index = square.argmin(axis=1)
    rows = np.arange(len(square))
    first = square[rows, index].copy()
    square[rows, index] = np.inf
    second = square.min(axis=1)
    return index, first, second

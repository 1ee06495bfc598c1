"""Common landmarks of two ordinary photographs, whose cameras are unknown.

Matches must obey one fundamental matrix, found by MAGSAC++ (Barath et al., 2020).
"""

from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vrchain.errors import ImageError
from vrchain.landmarks.common import (
    CommonLandmark,
    Region,
    check_not_blank,
    common_landmarks,
    group_by_nearness,
    support_score,
)
from vrchain.landmarks.sift import Keypoints, detect, mutual_matches
from vrchain.panorama import CameraRig, Panorama, read_image

_LONGEST_SIDE_PX = 1000
_LEAST_SIDE_PX = 16
_RATIO = 0.8
_TOLERANCE_PX = 1.5
_MIN_INLIERS = (
    20  # of unrelated pictures a fundamental matrix satisfies about a dozen matches by chance
)
_GROUP_SHARE = (
    0.12  # of the longest side: matches nearer than this in both pictures belong together
)
_MIN_SUPPORT = 8


def photo_landmarks(
    a_rgb: NDArray[np.uint8], b_rgb: NDArray[np.uint8]
) -> tuple[CommonLandmark, ...]:
    """Common landmarks of two photographs, (h, w, 3) uint8 each, surest first.

    Regions are in the pixels of the pictures as given. ImageError if one is blank or tiny.
    """
    for name, image in (("first", a_rgb), ("second", b_rgb)):
        _check_usable(image, f"the {name} picture")
    return _claims(a_rgb, b_rgb)


def _claims(a_rgb: NDArray[np.uint8], b_rgb: NDArray[np.uint8]) -> tuple[CommonLandmark, ...]:
    (a, scale_a), (b, scale_b) = _detect_scaled(a_rgb), _detect_scaled(b_rgb)
    index_a, index_b = mutual_matches(a.descriptors, b.descriptors, _RATIO)
    xy_a, xy_b = a.xy_px[index_a], b.xy_px[index_b]
    inlier = np.flatnonzero(_fundamental_inliers(xy_a, xy_b))
    if len(inlier) < _MIN_INLIERS:
        return ()
    claims = []
    for members in group_by_nearness(xy_a[inlier], xy_b[inlier], _GROUP_SHARE * _LONGEST_SIDE_PX):
        if len(members) < _MIN_SUPPORT:
            continue
        chosen = inlier[members]
        ia, ib = index_a[chosen], index_b[chosen]
        regions = _region(a, ia, scale_a, a_rgb), _region(b, ib, scale_b, b_rgb)
        claims.append(CommonLandmark(support_score(len(chosen)), *regions, ia, ib))
    return tuple(sorted(claims, key=lambda c: -c.score))


@dataclass(frozen=True, eq=False)
class FileComparison:
    """Common landmarks of two files, and the two pictures, (h, w, 3) uint8, to show them on.

    rig: set when both are panoramas; the pictures are their cylinders then.
    """

    claims: tuple[CommonLandmark, ...]
    a_rgb: NDArray[np.uint8]
    b_rgb: NDArray[np.uint8]
    rig: CameraRig | None


def landmarks_of_files(a: str | Path, b: str | Path) -> FileComparison:
    """Common landmarks of two files, each a photograph or a panorama's folder.

    Two panoramas are compared as such. A panorama beside a photograph is taken as its views, of
    which the one with the most in common counts. ImageError names a file that cannot serve.
    """
    left, right = _load(a), _load(b)
    if isinstance(left, Panorama) and isinstance(right, Panorama):
        return FileComparison(
            common_landmarks(left, right), left.cylinder, right.cylinder, left.rig
        )
    views_a, views_b = _views(left), _views(right)
    found = {
        (i, j): _claims(view_a, view_b)  # a single view may well be blank
        for i, view_a in enumerate(views_a)
        for j, view_b in enumerate(views_b)
    }
    i, j = max(found, key=lambda pair: sum(len(c.support_a) for c in found[pair]))
    claims = [replace(c, a=replace(c.a, view=i), b=replace(c.b, view=j)) for c in found[i, j]]
    return FileComparison(tuple(claims), views_a[i], views_b[j], None)


def _views(image: Panorama | NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
    return list(image.views) if isinstance(image, Panorama) else [image]


def _load(path: str | Path) -> Panorama | NDArray[np.uint8]:
    if Path(path).is_dir():
        panorama = Panorama.load(path)
        check_not_blank(panorama.cylinder, str(path))
        return panorama
    image = read_image(path)
    _check_usable(image, str(path))
    return image


def _check_usable(image_rgb: NDArray[np.uint8], what: str) -> None:
    height, width = image_rgb.shape[:2]
    if min(height, width) < _LEAST_SIDE_PX:
        raise ImageError(
            f"{what} is too small: expected at least {_LEAST_SIDE_PX} pixels each way, "
            f"got {width} x {height}"
        )
    check_not_blank(image_rgb, what)


def _detect_scaled(image_rgb: NDArray[np.uint8]) -> tuple[Keypoints, float]:
    scale = min(1.0, _LONGEST_SIDE_PX / max(image_rgb.shape[:2]))
    if scale < 1:
        height, width = (max(1, round(side * scale)) for side in image_rgb.shape[:2])
        smaller = cv2.resize(image_rgb, (width, height), interpolation=cv2.INTER_AREA)
        return detect(np.asarray(smaller, dtype=np.uint8)), scale
    return detect(image_rgb), scale


def _fundamental_inliers(xy_a: NDArray[np.float64], xy_b: NDArray[np.float64]) -> NDArray[np.bool_]:
    if len(xy_a) < _MIN_INLIERS:
        return np.zeros(len(xy_a), dtype=bool)
    matrix, mask = cv2.findFundamentalMat(xy_a, xy_b, cv2.USAC_MAGSAC, _TOLERANCE_PX, 0.999, 10000)
    return np.zeros(len(xy_a), dtype=bool) if matrix is None else mask.ravel().astype(bool)


def _region(
    found: Keypoints, index: NDArray[np.int64], scale: float, image_rgb: NDArray[np.uint8]
) -> Region:
    xy, reach = found.xy_px[index], found.size_px[index, None] / 2
    height, width = image_rgb.shape[:2]
    low = np.clip((xy - reach).min(axis=0) / scale, 0, (width, height))
    high = np.clip((xy + reach).max(axis=0) / scale, 0, (width, height))
    return Region(0, (float(low[0]), float(low[1]), float(high[0]), float(high[1])), None, None)

"""Common landmarks of two ordinary photographs, whose cameras are unknown.

Matches must obey one fundamental matrix, found by MAGSAC++ (Barath et al., 2020).
"""

import contextlib
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from vrchain.errors import ImageError
from vrchain.landmarks.extraction.sift import Keypoints, detect, mutual_matches, root
from vrchain.landmarks.matching.common import (
    CommonLandmark,
    Comparison,
    Region,
    check_not_blank,
    group_by_nearness,
    support_score,
)
from vrchain.landmarks.matching.variants import DEFAULT, Variant, compared, variant_named
from vrchain.panorama import CameraRig, Panorama
from vrchain.panorama.codec import decode_image, read_content
from vrchain.panorama.metadata import metadata_of
from vrchain.panorama.sources import Source, import_panorama
from vrchain.seeding import generator

Index = NDArray[np.int64]
Matched = tuple[Index, Index]
Picture = Panorama | NDArray[np.uint8]

PHOTOGRAPH = "photograph"
_LONGEST_SIDE_PX = 1000
_LEAST_SIDE_PX = 16
_LEAST_MATCHES = 8  # from which a fundamental matrix is sought
_GROUP_SHARE = 0.12  # of the longest side: matches nearer than this in both belong together
_PLAIN, _SOFT = 3.0, 16.0  # grey levels a pixel: steps of no cloud, and of clouds of a sky's colour
_BRIGHT, _WARM = 140, 5  # blue at least, and how much more red than that it may have
_BLUR_PX = 1.0, 1.5  # before steps and colours are looked at


@dataclass(frozen=True)
class PhotoConfig:
    """How matches are found and how many must agree.

    By rendered views of suburbs (``experiments.landmarks.photographs``) at most one pair in a
    hundred of unrelated views is claimed so. Ratio, tolerance and ``either`` were taken after the
    photographs of the project's tests had been looked at: what they do on these is no independent
    evidence.
    """

    root: bool = True  # Hellinger's distance between descriptors
    ratio: float = 0.85  # nearest over second nearest distance
    either: bool = True  # the ratio test asked in one direction, not in both
    tolerance_px: float = 1.0
    min_inliers: int = 18  # matches that obey one fundamental matrix
    shuffles: int = 5  # of who matches whom; more must agree than in any of them
    min_support: int = 6  # of them in a claim
    sky: bool = False  # whether what matches in the sky counts


# what most tutorials do
PLAIN = PhotoConfig(
    root=False, ratio=0.8, either=False, tolerance_px=1.5, min_inliers=20, min_support=8,
    shuffles=0, sky=True,
)  # fmt: skip


def photo_landmarks(
    a_rgb: NDArray[np.uint8], b_rgb: NDArray[np.uint8]
) -> tuple[CommonLandmark, ...]:
    """Common landmarks of two photographs, (h, w, 3) uint8 each, surest first.

    Regions are in the pixels of the pictures as given. ImageError if one is blank or tiny.
    """
    for name, image in (("first", a_rgb), ("second", b_rgb)):
        _check_usable(image, f"the {name} picture")
    return claims_of(described(a_rgb), described(b_rgb))


@dataclass(frozen=True, eq=False)
class Described:
    """A picture's size (height, width) as given, and its keypoints, found at ``scale`` of it.

    in_sky: (n,) which of the keypoints lie in the sky.
    """

    size_px: tuple[int, int]
    keypoints: Keypoints
    scale: float
    in_sky: NDArray[np.bool_]


def described(image_rgb: NDArray[np.uint8]) -> Described:
    """The keypoints of a picture (h, w, 3), made smaller first if it is large."""
    height, width = image_rgb.shape[:2]
    scale = min(1.0, _LONGEST_SIDE_PX / max(height, width))
    if scale < 1:
        smaller = max(1, round(width * scale)), max(1, round(height * scale))
        resized = cv2.resize(image_rgb, smaller, interpolation=cv2.INTER_AREA)
        image_rgb = np.asarray(resized, dtype=np.uint8)
    found = detect(image_rgb)
    column, row = np.round(found.xy_px).astype(int).T
    return Described((height, width), found, scale, sky_mask(image_rgb)[row, column])


def sky_mask(image_rgb: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Pixels (h, w) of sky in a picture (h, w, 3) of about 1,000 pixels.

    Its clouds move, and stand above every place, so they mark none. Sky is what can be reached from
    the upper edge without a sharp step: a building's edges stop it, clouds do not, as long as they
    are grey or bluish and bright. On rendered views under painted clouds (seed 1000) it covers 0.95
    of the keypoints in the sky, and 0.005 of the others.
    """
    grey = cv2.cvtColor(image_rgb, cv2.COLOR_RGB2GRAY).astype(np.float32)
    grey = cv2.GaussianBlur(grey, (0, 0), _BLUR_PX[0]).astype(np.float32)
    across, down = (cv2.Sobel(grey, -1, x, 1 - x, scale=1 / 8) for x in (1, 0))
    step = cv2.dilate(cv2.magnitude(across, down), np.ones((3, 3), dtype=np.uint8))
    red, green, blue = cv2.split(cv2.GaussianBlur(image_rgb, (0, 0), _BLUR_PX[1]).astype(np.int16))
    cool = (blue >= red - _WARM) & (blue >= green - _WARM) & (blue >= _BRIGHT)
    smooth = (step < _PLAIN) | (step < _SOFT) & cool
    _, part = cv2.connectedComponents(smooth.astype(np.uint8), connectivity=4)
    return np.asarray(smooth & np.isin(part, part[0][smooth[0]]))


def agreeing(a: Described, b: Described, config: PhotoConfig) -> Matched:
    """Indices (m,), (m,) of matched keypoints that obey one fundamental matrix."""
    ia, ib = matches_of(a, b, config)
    inlier = _obeying(a, b, ia, ib, config)
    ia, ib = ia[inlier], ib[inlier]
    counted = config.sky | ~(a.in_sky[ia] | b.in_sky[ib])
    return ia[counted], ib[counted]


def matches_of(a: Described, b: Described, config: PhotoConfig) -> Matched:
    known = (d.keypoints.descriptors for d in (a, b))
    known_a, known_b = (root(k) if config.root else k for k in known)
    return mutual_matches(known_a, known_b, config.ratio, config.either)


def _obeying(a: Described, b: Described, ia: Index, ib: Index, config: PhotoConfig) -> Index:
    """Which matches obey the fundamental matrix that most obey."""
    mask = None
    if len(ia) >= _LEAST_MATCHES:
        with contextlib.suppress(cv2.error):  # raised where all matches lie on a few points
            mask = cv2.findFundamentalMat(
                a.keypoints.xy_px[ia], b.keypoints.xy_px[ib], cv2.USAC_MAGSAC,
                config.tolerance_px, 0.999, 10000,
            )[1]  # fmt: skip
    return np.flatnonzero(mask) if mask is not None else np.empty(0, dtype=np.int64)


def by_chance(a: Described, b: Described, config: PhotoConfig) -> int:
    """The most matches that agree when it is shuffled who matches whom.

    Keypoints in rows and grids agree on some fundamental matrix whatever they are matched with.
    """
    ia, ib = matches_of(a, b, config)
    draws = generator(0, "photographs", len(ia))
    shuffled = (draws.permutation(ib) for _ in range(config.shuffles))
    return max((len(_obeying(a, b, ia, other, config)) for other in shuffled), default=0)


def claims_of(
    a: Described, b: Described, config: PhotoConfig | None = None
) -> tuple[CommonLandmark, ...]:
    """Common landmarks of two pictures, surest first."""
    config = config or PhotoConfig()
    ia, ib = agreeing(a, b, config)
    if len(ia) < config.min_inliers or len(ia) <= by_chance(a, b, config):
        return ()
    groups = group_by_nearness(
        a.keypoints.xy_px[ia], b.keypoints.xy_px[ib], _GROUP_SHARE * _LONGEST_SIDE_PX
    )
    large = [members for members in groups if len(members) >= config.min_support]
    claims = []
    for members in large or [np.arange(len(ia))]:
        own = ia[members], ib[members]
        regions = _region(a, own[0]), _region(b, own[1])
        claims.append(CommonLandmark(support_score(len(members)), *regions, *own))
    return tuple(sorted(claims, key=lambda c: -c.score))


@dataclass(frozen=True, eq=False)
class FileComparison:
    """Common landmarks of two files, and the two pictures, (h, w, 3) uint8, to show them on.

    rig: set when both are panoramas; the pictures are their cylinders then.
    """

    comparison: Comparison
    a_rgb: NDArray[np.uint8]
    b_rgb: NDArray[np.uint8]
    rig: CameraRig | None

    @property
    def claims(self) -> tuple[CommonLandmark, ...]:
        """The common landmarks, surest first."""
        return self.comparison.common


def landmarks_of_files(
    a: str | Path, b: str | Path, variant: str | Variant = DEFAULT, model: str | None = None
) -> FileComparison:
    """Common landmarks of two files, each a photograph or a panorama: its folder, or one picture.

    model: of pictures, ``PHOTOGRAPH`` or one of ``panorama.sources.MODELS``; None: as the metadata
    say, else a photograph, but for a picture twice as wide as high, of which that must be told. Two
    panoramas are compared as such, by the variant of that name. A panorama beside a photograph is
    taken as its views, of which the one with the most in common counts. ImageError names a file
    that cannot serve; MissionError: there is no such variant.
    """
    chosen = variant_named(variant) if variant != DEFAULT else None
    left, right = load_both(a, b, model)
    if isinstance(left, Panorama) and isinstance(right, Panorama):
        found = compared(chosen or variant_named(variant), left, right)
        return FileComparison(found, left.cylinder, right.cylinder, left.rig)
    return landmarks_of_views(left, right)


def landmarks_of_views(left: Picture, right: Picture) -> FileComparison:
    """Common landmarks of two pictures of which one, at least, is a photograph."""
    views_a, views_b = (
        list(image.views) if isinstance(image, Panorama) else [image] for image in (left, right)
    )
    described_a, described_b = ([described(v) for v in views] for views in (views_a, views_b))
    claimed = {
        (i, j): claims_of(one, other)  # a single view may well be blank
        for i, one in enumerate(described_a)
        for j, other in enumerate(described_b)
    }
    i, j = max(claimed, key=lambda pair: sum(len(c.support_a) for c in claimed[pair]))
    claims = [replace(c, a=replace(c.a, view=i), b=replace(c.b, view=j)) for c in claimed[i, j]]
    return FileComparison(Comparison(tuple(claims), None), views_a[i], views_b[j], None)


def load_both(a: str | Path, b: str | Path, model: str | None) -> tuple[Picture, Picture]:
    """Two files as ``landmarks_of_files`` takes them; a picture gets the rig of a folder's."""
    if Path(b).is_dir():
        right = load_picture(b, model)
        return load_picture(a, model, right.rig if isinstance(right, Panorama) else None), right
    left = load_picture(a, model)
    return left, load_picture(b, model, left.rig if isinstance(left, Panorama) else None)


def load_picture(path: str | Path, model: str | None, rig: CameraRig | None = None) -> Picture:
    """A file as ``landmarks_of_files`` takes it; rig: of a panorama that it is compared with."""
    if Path(path).is_dir():
        panorama = Panorama.load(path)
    else:
        content = read_content(path)
        image = decode_image(content, str(path))
        told = metadata_of(content, str(path)).projection if model is None else ""
        height, width = image.shape[:2]
        if model is None and not told and width == 2 * height:
            raise ImageError(
                f"{path}: twice as wide as high, and its metadata do not tell what it shows: say "
                f"--model equirectangular if it is a full sphere, else --model {PHOTOGRAPH}"
            )
        if model == PHOTOGRAPH or not (model or told):
            _check_usable(image, str(path))
            return image
        panorama = import_panorama(path, Source(model), rig).panorama
    check_not_blank(panorama.cylinder, str(path))
    return panorama


def _check_usable(image_rgb: NDArray[np.uint8], what: str) -> None:
    height, width = image_rgb.shape[:2]
    if min(height, width) < _LEAST_SIDE_PX:
        raise ImageError(
            f"{what} is too small: expected at least {_LEAST_SIDE_PX} pixels each way, "
            f"got {width} x {height}"
        )
    check_not_blank(image_rgb, what)


def _region(found: Described, index: Index) -> Region:
    xy, reach = found.keypoints.xy_px[index], found.keypoints.size_px[index, None] / 2
    height, width = found.size_px
    corners = np.stack([(xy - reach).min(axis=0), (xy + reach).max(axis=0)]) / found.scale
    x0, y0, x1, y1 = map(float, np.clip(corners, 0, (width, height)).ravel())
    return Region(0, (x0, y0, x1, y1), None, None)

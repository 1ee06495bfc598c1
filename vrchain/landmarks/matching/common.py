"""Common landmarks: what two panoramas both show.

Matched keypoints that obey one relative pose of the two robots are grouped by nearness; each
group that stands up from the ground is one claim.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.hierarchy import fcluster, linkage

from vrchain.errors import ImageError
from vrchain.geometry import circular_mean_rad, wrap_angle_rad
from vrchain.landmarks.extraction.sift import Features, extract, mutual_matches
from vrchain.landmarks.matching.epipolar import PlanarGeometry, estimate
from vrchain.panorama import CameraRig, Panorama

Box = tuple[float, float, float, float]

_STILL_RAD = 0.01  # nine tenths of all things shift less: the two stand at one place
_LEAST_WAY_M = 0.5  # between two robots, from which a landmark's range can be told
_MIN_CONTRAST = 2.0  # standard deviation of grey below which an image is called blank


@dataclass(frozen=True)
class MatchConfig:
    """How claims are made from matches."""

    ratio: float = 0.8  # nearest over second nearest descriptor distance
    min_inliers: int = 10  # matches that must obey one relative pose of the robots
    group_rad: float = 0.03  # matches nearer than this in both views belong together
    min_support: int = 5  # matches in a claim
    min_slope: float = 0.0  # a landmark reaches above this; the ground does not
    min_score: float = 0.5  # claims below this are not made
    max_range: float = 15.0  # in distances between the robots; what is farther is scenery


@dataclass(frozen=True)
class Region:
    """Where a landmark appears: pixels x0, y0, x1, y1 of one view; angles in the robot's frame.

    For a photograph view is 0 and the angles, its camera being unknown, are None.
    """

    view: int
    box_px: Box
    bearing_rad: float | None
    angular_size_rad: float | None


@dataclass(frozen=True, eq=False)
class CommonLandmark:
    """One claim: these two regions show the same thing.

    score: 0 to 1, larger is surer. support_a, support_b: (k,) indices of its matched keypoints.
    ranges: distance of the landmark from A and from B, in units of the distance from A to B; None
    where the geometry does not tell (photographs; panoramas taken at one place).
    mask_a, mask_b: (n, 2) directions, bearing_rad and slope, of its matched spots and keypoints, or
    else, if there are none, all that its regions cover; None: those of its keypoints. spots: how
    many spots match.
    """

    score: float
    a: Region
    b: Region
    support_a: NDArray[np.int64]
    support_b: NDArray[np.int64]
    ranges: tuple[float, float] | None = None
    mask_a: NDArray[np.float64] | None = None
    mask_b: NDArray[np.float64] | None = None
    spots: int = 0

    @property
    def matches(self) -> int:
        """Matched keypoints and spots that speak for it."""
        return len(self.support_a) + self.spots


@dataclass(frozen=True, eq=False)
class Comparison:
    """What two images have in common, surest first.

    geometry: the likeliest relative pose if any was found, also of images that share nothing.
    chance: that the two were joined rightly, by all that may be claimed; None if that is not told.
    """

    common: tuple[CommonLandmark, ...]
    geometry: PlanarGeometry | None
    chance: float | None = None

    @property
    def relative_pose(self) -> PlanarGeometry | None:
        """The relative pose if it can be relied on: None where nothing is claimed."""
        return self.geometry if self.common else None

    def distance_m(self, rig: CameraRig) -> float | None:
        """From A to B, two panoramas of ``rig``; None where nothing tells the scale."""
        pose = self.relative_pose
        way_m = pose.baseline_heights * rig.camera_height_m if pose else np.nan
        return float(way_m) if np.isfinite(way_m) else None

    def ranges_m(self, claim: CommonLandmark, rig: CameraRig) -> tuple[float, float] | None:
        """How far a landmark is from A and from B; None where the two are too near to tell."""
        way_m = self.distance_m(rig)
        if way_m is None or way_m < _LEAST_WAY_M or claim.ranges is None:
            return None
        if max(claim.ranges) > MatchConfig.max_range:
            return None
        return claim.ranges[0] * way_m, claim.ranges[1] * way_m


def compare(
    a: Features, b: Features, rig: CameraRig, config: MatchConfig | None = None
) -> Comparison:
    """Common landmarks of two panoramas of one rig, by SIFT and the planar epipolar constraint."""
    config = config or MatchConfig()
    return claims_of(a, b, *mutual_matches(a.descriptors, b.descriptors, config.ratio), rig, config)


def claims_of(
    a: Features,
    b: Features,
    index_a: NDArray[np.int64],
    index_b: NDArray[np.int64],
    rig: CameraRig,
    config: MatchConfig | None = None,
) -> Comparison:
    """Claims of matched keypoints: those that lie together and agree with one relative pose.

    index_a, index_b: (m,) the two keypoints of each match, by whatever they were matched.
    """
    config = config or MatchConfig()
    matched_a, matched_b = a.take(index_a), b.take(index_b)
    geometry = estimate(matched_a.directions, matched_b.directions, config.min_inliers)
    if geometry is None:
        return Comparison((), None)
    inlier = np.flatnonzero(geometry.inliers)
    places_a, places_b = (places_of(f.take(inlier)) for f in (matched_a, matched_b))
    parallax = matched_b.bearing_rad + geometry.heading_rad - matched_a.bearing_rad
    apart = np.quantile(np.abs(wrap_angle_rad(parallax[inlier])), 0.9) > _STILL_RAD
    claims = []
    for members in group_by_nearness(places_a, places_b, config.group_rad):
        chosen = inlier[members]
        own_a, own_b = matched_a.take(chosen), matched_b.take(chosen)
        standing = min(own_a.slope.max(), own_b.slope.max()) > config.min_slope
        score = support_score(len(chosen))
        if len(chosen) < config.min_support or not standing or score < config.min_score:
            continue
        bearings = circular_mean_rad(own_a.bearing_rad), circular_mean_rad(own_b.bearing_rad)
        ranges = geometry.ranges(*bearings) if apart else None
        if ranges and max(ranges) > config.max_range:
            continue
        regions = panorama_region(own_a, rig), panorama_region(own_b, rig)
        claims.append(CommonLandmark(score, *regions, index_a[chosen], index_b[chosen], ranges))
    return Comparison(tuple(sorted(claims, key=lambda c: -c.score)), geometry)


def common_landmarks(
    a: Panorama, b: Panorama, config: MatchConfig | None = None
) -> tuple[CommonLandmark, ...]:
    """Common landmarks by SIFT alone, surest first; ImageError: one is blank, or rigs differ."""
    check_comparable(a, b)
    return compare(extract(a), extract(b), a.rig, config).common


def check_comparable(a: Panorama, b: Panorama) -> None:
    """Raise ImageError unless both were taken with one camera rig and show something."""
    if a.rig != b.rig:
        raise ImageError(f"expected two panoramas of one camera rig, got {a.rig} and {b.rig}")
    for name, panorama in (("first", a), ("second", b)):
        check_not_blank(panorama.cylinder, f"the {name} panorama")


def check_not_blank(image_rgb: NDArray[np.uint8], what: str) -> None:
    """Raise ImageError if an image has nothing that could be recognised."""
    if image_rgb.mean(axis=2).std() < _MIN_CONTRAST:
        raise ImageError(f"{what} is blank: expected an image in which something can be seen")


def support_score(n_matches: int) -> float:
    """How far matches that agree make a claim credible: half at 5, 0.9 at 16."""
    return 1.0 - 0.5 ** (n_matches / 5)


def places_of(seen: Features) -> NDArray[np.float64]:
    """Directions as points on a cylinder, (n, 3), on which nearness knows no seam."""
    return np.column_stack([np.cos(seen.bearing_rad), np.sin(seen.bearing_rad), seen.slope])


def group_by_nearness(
    places_a: NDArray[np.float64], places_b: NDArray[np.float64], reach: float
) -> list[NDArray[np.int64]]:
    """Groups of matches whose places, (m, d) each, lie near one another in both images.

    Average linkage: a group does not creep from house to house as a chain of neighbours would.
    """
    if len(places_a) < 2:
        return [np.arange(len(places_a))]
    tree = linkage(np.hstack([places_a, places_b]), method="average")
    label = fcluster(tree, 2 * reach, criterion="distance")
    return [np.flatnonzero(label == k) for k in np.unique(label)]


def panorama_region(support: Features, rig: CameraRig) -> Region:
    """The region around keypoints of one landmark, in the view that looks at it most directly."""
    middle = circular_mean_rad(support.bearing_rad)
    offset, reach = wrap_angle_rad(support.bearing_rad - middle), support.size_rad / 2
    right, left = float((offset - reach).min()), float((offset + reach).max())
    low, high = float((support.slope - reach).min()), float((support.slope + reach).max())
    shape = [middle + (left + right) / 2, left - right, low, high]
    return view_boxes(np.array([shape]), rig)[0]


def view_boxes(shapes: NDArray[np.float64], rig: CameraRig) -> list[Region]:
    """Regions (n, 4): bearing_rad, how wide in radians, slopes of the lower and upper edge."""
    bearing_rad, width_rad, low, high = shapes.T
    bearing = wrap_angle_rad(bearing_rad)
    view = rig.view_of_bearing(bearing)
    half, edge = width_rad / 2, np.radians(rig.field_of_view_deg) / 2
    off_axis = wrap_angle_rad(bearing - rig.azimuths_rad[view]) + np.linspace(-half, half, 9)
    across = rig.azimuths_rad[view] + np.clip(off_axis, -edge, edge)
    x_px, y_px = rig.project(view, across, np.stack([low, high])[:, None])
    x_px, y_px = x_px.clip(0, rig.width_px), y_px.clip(0, rig.height_px)
    top, bottom = y_px.min(axis=(0, 1)), y_px.max(axis=(0, 1))
    boxes = np.stack([x_px.min(axis=0), top, x_px.max(axis=0), bottom], axis=1)
    columns = view.tolist(), boxes.tolist(), bearing.tolist(), width_rad.tolist()
    return [Region(v, tuple(box), b, w) for v, box, b, w in zip(*columns, strict=True)]

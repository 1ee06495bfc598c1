"""Judging claims of common landmarks against ground truth."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.landmarks.extraction.sift import Features
from vrchain.landmarks.matching.common import Comparison
from vrchain.landmarks.matching.epipolar import PlanarGeometry
from vrchain.panorama import CameraRig
from vrchain.world.things.pioneer import FIRST_ID
from vrchain.world.truth import SKY, GroundTruth

POSE_RIGHT_DEG = 10.0, 5.0  # a pose is right within so much of the direction and of the heading
CO_VISIBLE_SHARE = 0.2  # of the surface seen in the view that sees fewer, seen from the other too
_GRID_PX = 4
_SURFACE_TOLERANCE = 0.01  # of the range: a point is seen if the first hit towards it lies so near


@dataclass(frozen=True)
class Verdict:
    """What one claim really joined.

    right: most of its support, at least half, lies on one landmark in both views. twin: on two
    placings of one model. duplicate: an earlier claim joined the same two objects. quality_m:
    distance of the median points in A and in B, NaN if one lies on the sky.
    """

    object_a: str
    object_b: str
    right: bool
    twin: bool
    duplicate: bool
    quality_m: float


def judge(
    comparison: Comparison,
    truth: GroundTruth,
    poses: tuple[Pose, Pose],
    features: tuple[Features, Features],
    rig: CameraRig | tuple[CameraRig, CameraRig],
    robots: tuple[Mapping[str, Pose], Mapping[str, Pose]] = ({}, {}),
) -> list[Verdict]:
    """A verdict for each claim, in order.

    rig: of both, or of each. robots: name and pose of those that stood in each picture. They hide
    what is behind them and are no landmarks, so that a claim on one is wrong.
    """
    objects = truth.scene.objects
    verdicts: list[Verdict] = []
    taken: set[tuple[str, str]] = set()
    for claim in comparison.common:
        sides = []
        supports = (claim.support_a, claim.support_b)
        masks = (claim.mask_a, claim.mask_b)
        for pose, own, feature, support, mask, team in zip(
            poses, _each(rig), features, supports, masks, robots, strict=True
        ):
            bearing_rad, slope = (feature.take(support).directions if mask is None else mask).T
            ids, points = truth.look_along(pose, bearing_rad, slope, own, team)
            values, counts = np.unique(ids, return_counts=True)
            leader = int(values[counts.argmax()])
            middle = np.nanmedian(points, axis=0) if (ids != SKY).any() else np.full(3, np.nan)
            names = {SKY: "sky", **{FIRST_ID - i: name for i, name in enumerate(team)}}
            name = names[leader] if leader < 0 else objects[leader].name
            sides.append((leader, name, counts.max() / counts.sum() >= 0.5, middle))
        (id_a, name_a, held_a, middle_a), (id_b, name_b, held_b, middle_b) = sides
        standing = held_a and held_b and min(id_a, id_b) >= 0 and objects[id_a].landmark
        right = bool(standing and id_a == id_b)
        twin = bool(standing and id_a != id_b and objects[id_a].model == objects[id_b].model)
        duplicate = (name_a, name_b) in taken
        taken.add((name_a, name_b))
        quality_m = float(np.linalg.norm(middle_a - middle_b))
        verdicts.append(Verdict(name_a, name_b, right, twin, duplicate, quality_m))
    return verdicts


def _each(rig: CameraRig | tuple[CameraRig, CameraRig]) -> tuple[CameraRig, CameraRig]:
    return rig if isinstance(rig, tuple) else (rig, rig)


def pose_errors_deg(found: PlanarGeometry | None, a: Pose, b: Pose) -> tuple[float, float]:
    """By how much the direction from A to B and the heading are wrong; 180 where none is found."""
    if found is None:
        return 180.0, 180.0
    direction = found.direction_rad - a.bearing_to_rad(b.xy_m)
    heading = found.heading_rad - (b.yaw_rad - a.yaw_rad)
    off = np.degrees(np.abs(wrap_angle_rad(np.array([direction, heading]))))
    return float(off[0]), float(off[1])


def co_visible(
    truth: GroundTruth, a: Pose, b: Pose, rig: CameraRig | tuple[CameraRig, CameraRig]
) -> list[int]:
    """Object ids of the landmarks that both poses see, enough of their surface being the same.

    rig: of both, or of each.
    """
    rig_a, rig_b = _each(rig)
    return shared(truth, Sights(truth, a, rig_a), Sights(truth, b, rig_b))


def names_in_common(
    truth: GroundTruth, a: Pose, b: Pose, rig: CameraRig | tuple[CameraRig, CameraRig]
) -> set[str]:
    """The names of ``co_visible`` landmarks, as verdicts have them."""
    return {truth.scene.objects[i].name for i in co_visible(truth, a, b, rig)}


class Sights:
    """What is seen from a pose, looked at when it is asked for."""

    def __init__(self, truth: GroundTruth, pose: Pose, rig: CameraRig) -> None:
        self.pose, self.rig, self._truth = pose, rig, truth

    @cached_property
    def table(self) -> pd.DataFrame:
        """As of ``GroundTruth.visibility``."""
        return self._truth.visibility(self.pose, self.rig)

    @cached_property
    def visible(self) -> set[int]:
        """Ids of what is visible."""
        return set(map(int, self.table.index[self.table.visible]))

    @cached_property
    def surface(self) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
        """Object ids (n,) and world points (n, 3) of a grid of directions all around."""
        rows, columns = self.rig.cylinder_shape
        bearing_rad = self.rig.bearing_of_column(np.arange(0, columns, _GRID_PX))
        slope = self.rig.slope_of_row(np.arange(0, rows, _GRID_PX))
        bearing_rad, slope = np.broadcast_arrays(bearing_rad[None, :], slope[:, None])
        return self._truth.look_along(self.pose, bearing_rad.ravel(), slope.ravel(), self.rig)


def shared(truth: GroundTruth, a: Sights, b: Sights) -> list[int]:
    """``co_visible`` of poses that are looked from more than once."""
    found = []
    for object_id in sorted(a.visible & b.visible):
        if not truth.scene.objects[object_id].landmark:
            continue
        area = (side.table.area_deg2[object_id] for side in (a, b))
        fewer, other = (b, a) if next(area) > next(area) else (a, b)
        ids, points = fewer.surface
        own = points[ids == object_id]
        if (
            len(own)
            and _seen_share(truth, object_id, own, other.pose, other.rig) >= CO_VISIBLE_SHARE
        ):
            found.append(object_id)
    return found


def _seen_share(
    truth: GroundTruth, object_id: int, points_m: NDArray[np.float64], pose: Pose, rig: CameraRig
) -> float:
    """Share of an object's surface points, (n, 3), that ``pose`` sees."""
    eye = np.array([pose.x_m, pose.y_m, rig.camera_height_m])
    ray = points_m - eye
    slope = ray[:, 2] / np.hypot(ray[:, 0], ray[:, 1])
    framed = np.abs(slope) <= rig.slope_of_row(-0.5)
    hit, distance = truth.cast(eye, ray)
    reached = (hit == object_id) & (np.abs(distance - 1) < _SURFACE_TOLERANCE)
    return float((framed & reached).mean())

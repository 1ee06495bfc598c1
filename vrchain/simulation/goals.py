"""The goals of missions: what they are drawn from, and the pictures that robots know them by."""

from collections import Counter
from collections.abc import Callable, Sequence

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from vrchain.errors import MissionError
from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.navigation.settings import GOAL_RANGE_M
from vrchain.panorama import CameraRig, Panorama
from vrchain.panorama.rig import MOST_SIDE_PX
from vrchain.seeding import generator
from vrchain.world.model import Scene, SceneObject
from vrchain.world.render import Renderer
from vrchain.world.truth import GroundTruth

Points = NDArray[np.float64]
GOAL_PICTURES = 4
SHARES = (1.0, 0.5, 0.25)  # of distances in suburbs, that rooms have place for
_GOAL_DRAWS = 160
_GOAL_KINDS = (("house",), ("shop", "building", "barn"))  # drawn from, if no goal is named
_LEAST_GOAL_M = 0.8  # wide, where no building can be drawn
_NO_GOAL = ("wall", "fence", "hedge")  # one run of them looks like the next
_UNOCCLUDED = 0.9
_FRAME = 1.1  # the goal's pictures are this much larger than the goal


def goal_ids(scene: Scene, goal: str | None) -> list[int]:
    """The object of that name, or without a name all that goals are drawn from.

    Those are houses without a twin, or else other buildings without one, or else, as indoors, other
    landmarks without one that are large. MissionError if there is no such object, or if it is no
    landmark.
    """
    if goal is None:
        placings = Counter(o.model for o in scene.objects)
        alone = [
            (i, o.kind)
            for i, o in enumerate(scene.objects)
            if o.landmark and placings[o.model] == 1
        ]
        for kinds in _GOAL_KINDS:
            if drawn := [i for i, kind in alone if kind in kinds]:
                return drawn
        if large := [i for i, _ in alone if _is_large(scene.objects[i])]:
            return large
        raise MissionError(
            "the scene has no landmark of a size without a twin to draw as a goal: name a --goal"
        )
    try:
        target = scene.index_of(goal)
    except KeyError:
        raise MissionError(
            f"the scene has no object {goal!r}: see `vrchain scene info` for its objects"
        ) from None
    if not scene.objects[target].landmark:
        raise MissionError(
            f"{goal!r} is no landmark and cannot be a goal: choose a standing object"
        )
    return [target]


def _is_large(thing: SceneObject) -> bool:
    """Whether it is as large as furniture, no wall, and stands on the floor or hangs at hand."""
    low_m = float(thing.bounds_m[0, 2])
    large = thing.width_m >= _LEAST_GOAL_M and thing.kind not in _NO_GOAL
    return large and low_m < _LEAST_GOAL_M


def goal_poses(
    scene: Scene,
    truth: GroundTruth,
    target: int,
    seed: int,
    fits: Callable[[ArrayLike], NDArray[np.bool_]] | None = None,
) -> list[Pose]:
    """Up to four free poses, 6-15 m from an object's side, that look at it unoccluded.

    A quarter or half as far from what is no building, and no wider than 3 or 6 m, if there is room:
    it shows little from afar. fits: whether places, (n, 2), will do; by default all that are free.
    """
    found = list[Pose]()
    for share in _shares(scene.objects[target]):
        if len(found) < GOAL_PICTURES:
            found = _goal_poses(scene, truth, target, generator(seed, "goal", target), share, fits)
    return found


def _shares(thing: SceneObject) -> list[float]:
    """Those of ``SHARES`` that such a goal may be pictured from, the one tried first first."""
    least = 1.0 if thing.kind in sum(_GOAL_KINDS, ()) else thing.width_m / 2 / GOAL_RANGE_M[0]
    return [s for s in SHARES[::-1] if s >= min(1.0, least)]


def pictured_share(scene: Scene, goal: str, poses: Sequence[Pose]) -> float:
    """The share of 6-15 m from which a goal is pictured: one of ``SHARES``."""
    thing = scene.objects[scene.index_of(goal)]
    far_m = float(shapely.distance(thing.footprint, shapely.points([p.xy_m for p in poses])).max())
    return next((s for s in _shares(thing) if far_m <= s * GOAL_RANGE_M[1] + 1e-6), SHARES[0])


def _goal_poses(
    scene: Scene,
    truth: GroundTruth,
    target: int,
    draws: np.random.Generator,
    share: float,
    fits: Callable[[ArrayLike], NDArray[np.bool_]] | None,
) -> list[Pose]:
    alone = GroundTruth(Scene("alone", scene.extent_m, (scene.objects[target],)))
    centre = scene.objects[target].bounds_m[:, :2].mean(axis=0)
    offset_rad = draws.uniform(0, 2 * np.pi)
    rig, found = CameraRig(n_views=1, field_of_view_deg=110.0), list[Pose]()
    low_m, high_m = (share * range_m for range_m in GOAL_RANGE_M)
    for attempt in range(_GOAL_DRAWS):
        if len(found) == GOAL_PICTURES:
            break
        # evenly around the object at first, anywhere if that does not work
        spread_rad = 0.2 + attempt / 40
        azimuth = offset_rad + np.pi / 2 * len(found) + draws.normal(0, spread_rad)
        side_m, outward = draws.uniform(low_m, high_m), np.array([np.cos(azimuth), np.sin(azimuth)])
        x_m, y_m = _off(scene.objects[target].footprint, centre, outward, side_m)
        pose = Pose(float(x_m), float(y_m), float(wrap_angle_rad(azimuth + np.pi)))
        if not scene.is_free([pose.xy_m])[0] or (fits and not fits([pose.xy_m])[0]):
            continue
        seen = truth.visibility(pose, rig, of=target).area_deg2
        whole = alone.visibility(pose, rig, of=0).area_deg2
        if len(seen) and seen[target] >= _UNOCCLUDED * whole[0]:
            found.append(pose)
    return found


def _off(footprint: shapely.Geometry, centre: Points, outward: Points, side_m: float) -> Points:
    """The place outward from a footprint's centre, (2,), that is so far off its side."""

    def too_far_m(way_m: float) -> float:
        point = shapely.Point(centre + way_m * outward)
        return float(shapely.distance(footprint, point)) - side_m

    if too_far_m(0.0) >= 0:  # amidst walls that are as far all around
        return centre
    x0, y0, x1, y1 = footprint.bounds
    beside_m = too_far_m(0.0) + side_m  # the foot of a lamp with an arm is not below its middle
    most_m = float(np.hypot(x1 - x0, y1 - y0)) + side_m + beside_m
    return np.asarray(centre + brentq(too_far_m, 0.0, most_m) * outward)


def goal_pictures(
    scene: Scene, renderer: Renderer, goal: str, poses: Sequence[Pose], rig: CameraRig
) -> list[Panorama]:
    """Single views framed on the goal, as one who points it out would take them.

    As many pixels a degree as the team's own cameras have, or as one picture can have.
    """
    corners = np.concatenate([s.vertices_m for s in scene.objects[scene.index_of(goal)].surfaces])
    pictures = []
    for pose in poses:
        side_rad = max(abs(pose.bearing_to_rad(c)) for c in corners[:, :2])
        rise_m = np.abs(corners[:, 2] - rig.camera_height_m)
        slope = float((rise_m / np.linalg.norm(corners[:, :2] - pose.xy_m, axis=1)).max())
        half_rad = float(np.clip(_FRAME * side_rad, np.radians(3), np.radians(50)))
        focal_px = min(rig.focal_px, MOST_SIDE_PX / 2 / np.tan(half_rad))
        width_px = 2 * round(focal_px * np.tan(half_rad))
        height_px = min(rig.height_px, 2 * round(focal_px * _FRAME * slope))
        field_deg = 2 * float(np.degrees(np.arctan(width_px / 2 / focal_px)))
        single = CameraRig(1, width_px, height_px, field_deg, rig.camera_height_m)
        pictures.append(renderer.render(pose, single))
    return pictures

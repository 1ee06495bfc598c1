"""What a route is driven to, and where it should be in the frame of the robot's odometry.

That is each leg's landmark, or, where the landmark lies far aside, the place where the next
panorama was taken.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from vrchain.geometry import Pose, placed, wrap_angle_rad
from vrchain.landmarks.extraction.proposer import Proposals
from vrchain.landmarks.matching.calibration import Calibration
from vrchain.landmarks.matching.common import Region
from vrchain.navigation.driving.estimates import Estimate, sighted
from vrchain.navigation.driving.tracker import Tracker
from vrchain.navigation.goal.recognition import GoalSight
from vrchain.navigation.perception import Look
from vrchain.navigation.planning.relative_poses import SURE, RelativePoses
from vrchain.navigation.planning.route import Leg, Route

_FARTHEST_M = 80.0  # from farther away nothing is driven to
_POSE_STD = 0.15  # of the distance to where another panorama was taken, as a share
_ASIDE_M = 5.0  # a landmark so much farther than the next panorama's place lies aside
_PLACE_STD_M = 1.0  # of a place next to the robot
_SAME_STD = 2.0  # standard deviations within which two sights of the goal are of one thing
_SAME_RAD = 0.1  # between a claim's region and its proposal


def targets(
    route: Route,
    looks: Sequence[Look],
    poses: RelativePoses,
    sights: Mapping[str, GoalSight],
    begin: Pose,
    here: Pose,
    calibration: Calibration,
) -> tuple[list[Tracker], Estimate | None, Tracker | None]:
    """What the route's legs lead to, as many as the panoramas tell of; goal and lookout, if known.

    The lookout is from where the goal was seen.

    looks: of each robot of the route, the driving one first; poses: relative poses of the plan's
    panoramas; sights: in which of them the goal is seen. begin: where the first was taken; here:
    where the robot is.
    """
    taken = poses_along(route, poses, begin)
    found, last_xy_m = [], here.xy_m
    for i, leg in enumerate(route.legs):
        places, embedding, onward = list[Estimate](), list[np.ndarray](), taken[i + 1]
        if not leg.by_odometry:
            step = poses.between(leg.seen_by, leg.next_by)
            places, embedding = _landmark(leg, looks[i : i + 2], taken[i : i + 2], step, here)
        place = places[0] if places else None
        if i and len(places) == 2:
            place = places[0].with_sight(places[1])
        if onward is not None and (
            place is None
            or np.hypot(*(place.xy_m - last_xy_m))
            > float(np.hypot(*(onward.xy_m - last_xy_m))) + _ASIDE_M
        ):
            found.append(_lookout(leg.next_by, onward, here, calibration))
        elif place is not None:
            name = f"landmark {i + 1}, common to {leg.seen_by} and {leg.next_by}"
            seen_as = np.stack(embedding) if embedding else np.empty((0, 0), dtype=np.float32)
            found.append(Tracker(name, place, calibration, seen_as))
        else:
            break
        last_xy_m = found[-1].place.xy_m
    last = taken[-1]
    if last is None:
        return found, None, None
    goal = route.sighting.place(last)
    for name, sight in sights.items():
        step = poses.between(route.seen_by, name)
        if step is not None and poses.trust((route.seen_by, name)) >= SURE:
            too = sight.place(placed(last, step))
            goal = goal.with_sight(too) if goal.astray(too) < _SAME_STD else goal
    goal = goal.unsure(_POSE_STD * last.distance_to_m(here.xy_m))
    return found, goal, _lookout(route.seen_by, last, here, calibration)


def poses_along(route: Route, poses: RelativePoses, begin: Pose) -> list[Pose | None]:
    """Where each panorama of a route was taken, the first at ``begin``; None: nothing tells."""
    taken: list[Pose | None] = [begin]
    for a, b in pairwise(route.robots):
        before, step = taken[-1], poses.between(a, b)
        taken.append(None if before is None or step is None else placed(before, step))
    return taken


def _landmark(
    leg: Leg, looks: Sequence[Look], taken: Sequence[Pose | None], step: Pose | None, here: Pose
) -> tuple[list[Estimate], list[np.ndarray]]:
    """Where a leg's landmark is, and what it looks like, by each of its two panoramas that tells.

    taken: where the two were taken; step: the relative pose of the second.
    """
    landmark, places, embedding = leg.landmark, [], []
    for region, share, seen, pose in zip(
        (landmark.a, landmark.b), landmark.ranges or (None, None), looks, taken, strict=True
    ):
        k, p, range_m = proposal_of(seen.proposals, region), seen.proposals, np.inf
        if k is not None:
            embedding.append(p.embedding[k])
            range_m = float(p.range_m[k])
        elif share is not None and step is not None:
            range_m = share * float(np.hypot(*step.xy_m))
        if pose is not None and range_m < _FARTHEST_M:
            seen_at = sighted(pose, region.bearing_rad or 0.0, range_m)
            places.append(seen_at.unsure(_POSE_STD * pose.distance_to_m(here.xy_m)))
    return places, embedding


def _lookout(name: str, pose: Pose, here: Pose, calibration: Calibration) -> Tracker:
    """A panorama's place, to drive to."""
    std_m = _PLACE_STD_M + _POSE_STD * pose.distance_to_m(here.xy_m)
    place = Estimate(pose.xy_m, std_m**2 * np.eye(2))
    return Tracker(f"where {name} looked around", place, calibration)


def proposal_of(proposals: Proposals, region: Region) -> int | None:
    """The proposal that a claim's region is of, or None."""
    box = proposals.box
    middle, width = (box[:, 0] + box[:, 1]) / 2, box[:, 1] - box[:, 0]
    off = np.abs(wrap_angle_rad(middle - (region.bearing_rad or 0.0)))
    off = off + 0.5 * np.abs(width - (region.angular_size_rad or 0.0))
    if len(off) == 0 or off.min() > _SAME_RAD:
        return None
    return int(off.argmin())

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
from vrchain.navigation.planning.route import Route

_FARTHEST_M = 80.0  # from farther away nothing is driven to
_STAND_DOUBT = 0.15  # of the distance to where another panorama was taken, as a share
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

    looks: of each robot of the route, the driving one first; joins: where the plan's panoramas were
    taken; sights: in which of them the goal is seen. begin: where the first was taken; here: where
    the robot is.
    """
    between = [poses.between(a, b) for a, b in pairwise(route.robots)]
    stands = poses_along(route, poses, begin)
    found, last_xy_m = [], here.xy_m
    for i, leg in enumerate(route.legs):
        name = f"landmark {i + 1}, common to {leg.seen_by} and {leg.next_by}"
        ranges = leg.landmark.ranges or (None, None)
        step, onward = between[i], stands[i + 1]
        if leg.by_odometry and onward is not None:
            found.append(_lookout(leg.next_by, onward, here, calibration))
            last_xy_m = onward.xy_m
            continue
        apart_m = None if step is None else float(np.hypot(*step.xy_m))
        places, embedding = [], []
        for region, share, seen, stand in zip(
            (leg.landmark.a, leg.landmark.b), ranges, looks[i : i + 2], stands[i : i + 2],
            strict=True,
        ):  # fmt: skip
            k, p = proposal_of(seen.proposals, region), seen.proposals
            if k is not None:
                embedding.append(p.embedding[k])
            range_m = float(p.range_m[k]) if k is not None else np.inf
            if k is None and share is not None and apart_m is not None:
                range_m = share * apart_m
            if stand is not None and range_m < _FARTHEST_M:
                off_m = _STAND_DOUBT * stand.distance_to_m(here.xy_m)
                seen_at = sighted(stand, region.bearing_rad or 0.0, range_m)
                places.append(seen_at.unsure(off_m))
        place: Estimate | None = None
        if places:
            place = places[0] if i == 0 or len(places) == 1 else places[0].with_sight(places[1])
        if onward is not None:
            onward_m = float(np.hypot(*(onward.xy_m - last_xy_m)))
            if place is None or np.hypot(*(place.xy_m - last_xy_m)) > onward_m + _ASIDE_M:
                found.append(_lookout(leg.next_by, onward, here, calibration))
                last_xy_m = onward.xy_m
                continue
        if place is None:
            break
        seen_as = np.stack(embedding) if embedding else np.empty((0, 0), dtype=np.float32)
        found.append(Tracker(name, place, seen_as, calibration))
        last_xy_m = place.xy_m
    last = stands[-1]
    if last is None:
        return found, None, None
    goal = sighted(last, route.sighting.bearing_rad, route.sighting.surface_m)
    for name, sight in sights.items():
        stand = poses.between(route.seen_by, name)
        if stand is not None and poses.trust((route.seen_by, name)) >= SURE:
            too = sighted(placed(last, stand), sight.bearing_rad, sight.surface_m)
            goal = goal.with_sight(too) if goal.astray(too) < _SAME_STD else goal
    goal = goal.unsure(_STAND_DOUBT * last.distance_to_m(here.xy_m))
    return found, goal, _lookout(route.seen_by, last, here, calibration)


def poses_along(route: Route, poses: RelativePoses, begin: Pose) -> list[Pose | None]:
    """Where each panorama of a route was taken, the first at ``begin``; None: nothing tells."""
    stands: list[Pose | None] = [begin]
    for a, b in pairwise(route.robots):
        stand, step = stands[-1], poses.between(a, b)
        stands.append(None if stand is None or step is None else placed(stand, step))
    return stands


def _lookout(name: str, stand: Pose, here: Pose, calibration: Calibration) -> Tracker:
    """A panorama's place, to drive to."""
    std_m = _PLACE_STD_M + _STAND_DOUBT * stand.distance_to_m(here.xy_m)
    place = Estimate(stand.xy_m, std_m**2 * np.eye(2))
    return Tracker.of_place(f"where {name} looked around", place, calibration)


def proposal_of(proposals: Proposals, region: Region) -> int | None:
    """The proposal that a claim's region is of, or None."""
    box = proposals.box
    middle, width = (box[:, 0] + box[:, 1]) / 2, box[:, 1] - box[:, 0]
    off = np.abs(wrap_angle_rad(middle - (region.bearing_rad or 0.0)))
    off = off + 0.5 * np.abs(width - (region.angular_size_rad or 0.0))
    if len(off) == 0 or off.min() > _SAME_RAD:
        return None
    return int(off.argmin())

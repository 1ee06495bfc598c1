"""The chains of landmarks that truth knows lead to a goal.

A *chain* is start, L1, P2, L2 ... Pk, goal: each landmark co-visible in neighbouring panoramas, the
goal visible in Pk, and from a free and reachable place within the approach distance of each
landmark the next one, at last the goal, is visible. No landmark is twice running in it. The one
with fewest landmarks is given, of those the one with the shortest way. Where the goal is a place,
its own panorama ends the chain, as another robot's would.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from vrchain.geometry import Pose
from vrchain.landmarks.quality import Sights, shared
from vrchain.panorama import CameraRig
from vrchain.simulation.collision_free import Array, FreeSpace, Ints
from vrchain.world.model import Scene
from vrchain.world.truth import VISIBLE_AREA_DEG2, VISIBLE_AZIMUTH_DEG, GroundTruth

PLACE = "a place"  # the goal's name, where it is no object
APPROACH_M = 3.0  # from a landmark's footprint
_VANTAGES = 4  # places around a landmark from which the next may be seen
_RAYS_PER_DEG, _MOST_RISE_DEG = 2, 16.0


@dataclass(frozen=True)
class TrueChain:
    """robots: the driving one first; landmarks: one between each two of them, one more to a place.

    way_m: the shortest free way through the landmarks' approach zones to the goal.
    """

    robots: tuple[str, ...]
    landmarks: tuple[str, ...]
    way_m: float


class _State(NamedTuple):
    """A robot whose panorama is known, and the landmark that leads there: none at the start."""

    robot: str
    landmark: int | None


class Views:
    """What is seen from poses, and how far all is from there: found out once for each."""

    def __init__(self, truth: GroundTruth, rig: CameraRig, free: FreeSpace) -> None:
        sights = cache(lambda pose: Sights(truth, pose, rig))
        self.sees = cache(lambda target, pose: truth.sees(target, pose, rig))
        self.any_of = cache(lambda target, pose: len(truth.visibility(pose, rig, of=target)) > 0)
        self.shared = cache(lambda a, b: shared(truth, sights(a), sights(b)))
        self.far_m = cache(lambda pose: free.from_m(pose.xy_m))


class Chains:
    """Chains in a scene; what is found out about it is kept."""

    def __init__(self, scene: Scene, truth: GroundTruth, rig: CameraRig) -> None:
        self.scene, self.truth, self.rig = scene, truth, rig
        self.free = FreeSpace(scene, truth)
        self._zones: dict[tuple[int, int], Ints] = {}
        self._from_near: dict[tuple[int, int], frozenset[int]] = {}

    def chain(
        self,
        poses: Mapping[str, Pose],
        target: int | Pose,
        far_m: Array,
        zone: Ints,
        views: Views,
        least: int = 0,
    ) -> TrueChain | None:
        """The chain with fewest landmarks from the first robot to the goal, or None.

        target: the goal, an object or a place. far_m: how far every point is from that robot; zone:
        where the goal is reached. least: None too if that chain has fewer landmarks.
        """
        first, *others = poses
        if isinstance(target, Pose):
            poses, others, last = {**poses, PLACE: target}, [*others, PLACE], {PLACE}
        else:
            last = {n for n in others if views.sees(target, poses[n])}
        if not last:
            return None

        def common(a: str, b: str) -> list[int]:
            return [i for i in views.shared(poses[a], poses[b]) if i != target]

        region = int(self.free.region[far_m.argmin()])

        def onward(state: _State, robots: Iterable[str] = others) -> Iterable[_State]:
            for robot in robots:
                if robot != state.robot:
                    for i in common(*sorted((state.robot, robot))):
                        if self._leads_to(i, state, region):
                            yield _State(robot, i)

        def is_end(state: _State) -> bool:
            if state.robot not in last or state.landmark is None:
                return False
            return state.robot == PLACE or target in self.near(state.landmark, region)

        reached = [_State(first, None)]
        before: dict[_State, tuple[_State, ...]] = {reached[0]: ()}
        n_landmarks = 0
        while reached:
            n_landmarks += 1
            # most have a chain that is too short: those who see the goal tell it at once
            if n_landmarks < least and any(
                is_end(new) for state in reached for new in onward(state, last)
            ):
                return None
            ends = [state for state in reached if is_end(state)]
            if ends:
                return self._shortest(ends, before, far_m, zone, region)
            newly: dict[_State, tuple[_State, ...]] = {}
            for state in reached:
                for new in onward(state):
                    # how a chain goes on depends on its last state alone: one that is known by
                    # fewer landmarks is not worth meeting again
                    if new not in before:
                        newly[new] = (*newly.get(new, ()), state)
            before |= newly
            reached = list(newly)
        return None

    def _shortest(
        self,
        ends: Sequence[_State],
        before: Mapping[_State, tuple[_State, ...]],
        far_m: Array,
        zone: Ints,
        region: int,
    ) -> TrueChain:
        """The chain with the shortest way to one of some ends.

        before: the states that lead to each, by one landmark fewer.
        """

        @cache
        def through_m(landmark: int, earlier: tuple[_State, ...]) -> Array:
            points = self.zone(landmark, region)
            ways_m = [after_m(state)[points] for state in earlier]
            return self.free.through_m(np.min(ways_m, axis=0), points)

        def after_m(state: _State) -> Array:
            landmark = state.landmark
            return far_m if landmark is None else through_m(landmark, before[state])

        def best(
            states: Sequence[_State], points: Ints, rest_m: Array | float
        ) -> tuple[float, _State, int]:
            ways_m = np.stack([after_m(state)[points] + rest_m for state in states])
            k, p = divmod(int(ways_m.argmin()), len(points))
            return float(ways_m[k, p]), states[k], int(points[p])

        way_m, state, point = best(ends, zone, 0.0)
        states = [state]
        while state.landmark is not None:  # back to the start
            points = self.zone(state.landmark, region)
            rest_m = self.free.from_m(self.free.points_m[point])[points]
            _, state, point = best(before[state], points, rest_m)
            states.insert(0, state)
        through_m.cache_clear()  # or the arrays stay until the cycle of closures is collected
        return TrueChain(
            tuple(s.robot for s in states if s.robot != PLACE),
            tuple(self.scene.objects[s.landmark].name for s in states if s.landmark is not None),
            way_m,
        )

    def _leads_to(self, landmark: int, state: _State, region: int) -> bool:
        """Whether a landmark can be driven to from a state: not twice running to the same."""
        if landmark == state.landmark or len(self.zone(landmark, region)) == 0:
            return False
        return state.landmark is None or landmark in self.near(state.landmark, region)

    def zone(self, landmark: int, region: int) -> Ints:
        """The points of a region within the approach distance of a landmark."""
        if (landmark, region) not in self._zones:
            zone = self.free.around(self.scene.objects[landmark].footprint, APPROACH_M)
            self._zones[landmark, region] = zone[self.free.region[zone] == region]
        return self._zones[landmark, region]

    def near(self, landmark: int, region: int) -> frozenset[int]:
        """What is visible from a region's places within the approach distance of a landmark."""
        if (landmark, region) not in self._from_near:
            zone = self.zone(landmark, region)
            middle = self.scene.objects[landmark].bounds_m[:, :2].mean(axis=0)
            around = np.argsort(np.arctan2(*(self.free.points_m[zone] - middle).T[::-1]))
            chosen = zone[around][:: max(1, len(zone) // _VANTAGES)][:_VANTAGES]
            self._from_near[landmark, region] = frozenset(self._visible(chosen))
        return self._from_near[landmark, region]

    def _visible(self, vantages: Iterable[int]) -> Iterable[int]:
        """What is visible from any of some points, in a grid of directions coarser than truth's."""
        columns, rows = round(360 * _RAYS_PER_DEG), round(2 * _MOST_RISE_DEG * _RAYS_PER_DEG)
        bearing = -np.pi + (np.arange(columns) + 0.5) * 2 * np.pi / columns
        rise_deg = -_MOST_RISE_DEG + (np.arange(rows) + 0.5) / _RAYS_PER_DEG
        bearings, slopes = np.broadcast_arrays(bearing[:, None], np.tan(np.radians(rise_deg)))
        for vantage in vantages:
            x_m, y_m = self.free.points_m[vantage]
            pose = Pose(float(x_m), float(y_m))
            ids, _ = self.truth.look_along(pose, bearings, slopes, self.rig)
            seen, cells = np.unique(ids[ids >= 0], return_counts=True)
            for i in seen[cells >= VISIBLE_AREA_DEG2 * _RAYS_PER_DEG**2]:
                wide = (ids == i).any(axis=1).sum() / _RAYS_PER_DEG
                if wide >= VISIBLE_AZIMUTH_DEG and self.scene.objects[i].landmark:
                    yield int(i)

"""Missions at random, and the chains of landmarks that truth knows lead to their goals.

Start, other robots and goal are uniform: robots in free space, the goal among the buildings without
a twin, or, asked for places, in free space too. A draw is rejected if the shortest free way is not
40 to 120 m long, if a pixel of the goal is in view at the start, or a landmark in view from the
place that is the goal, or if the goal cannot be pictured unoccluded. Every third mission, or each
if so asked, is drawn until its chain needs two landmarks or more. Robots face anywhere.

A *chain* is start, L1, P2, L2 ... Pk, goal: each landmark co-visible in neighbouring panoramas, the
goal visible in Pk, and from a free and reachable place within the approach distance of each
landmark the next one, at last the goal, is visible. No landmark is twice running in it. The one
with fewest landmarks is given, of those the one with the shortest way. Where the goal is a place,
its own panorama ends the chain, as another robot's would.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from vrchain.errors import MissionError
from vrchain.experiments.missions.collision_free import FreeSpace
from vrchain.geometry import Pose
from vrchain.landmarks.quality import Sights, shared
from vrchain.panorama import CameraRig
from vrchain.seeding import generator
from vrchain.simulation.mission import SUCCESS_RANGE_M
from vrchain.simulation.task import GOAL_PICTURES, goal_ids, goal_poses, robot_names
from vrchain.world.model import Scene
from vrchain.world.truth import VISIBLE_AREA_DEG2, VISIBLE_AZIMUTH_DEG, GroundTruth

Array = NDArray[np.float64]

PLACE = "a place"  # the goal's name, where it is no object
WAY_M = (40.0, 120.0)
APPROACH_M = 3.0  # from a landmark's footprint
_APART_M = 2.0  # robots are not nearer to each other
_PLACES = 100  # in a suburb, where chains of so many landmarks are asked for
_VANTAGES = 4  # places around a landmark from which the next may be seen
_RAYS_PER_DEG, _MOST_RISE_DEG = 2, 16.0
_DRAWS, _DRAWS_AMONG_PLACES = 2000, 50_000


@dataclass(frozen=True)
class TrueChain:
    """robots: the driving one first; landmarks: one between each two of them, one more to a place.

    way_m: the shortest free way through the landmarks' approach zones to the goal.
    """

    robots: tuple[str, ...]
    landmarks: tuple[str, ...]
    way_m: float


@dataclass(frozen=True)
class Mission:
    """poses: where each robot stands, the driving one first. way_m: the shortest free way.

    goal: an object's name, or ``PLACE``; goal_poses: from where it is pictured, or that place.
    rejected: how many draws were, for each reason, before this one.
    """

    number: int
    goal: str
    goal_poses: tuple[Pose, ...]
    poses: Mapping[str, Pose]
    way_m: float
    chain: TrueChain | None
    rejected: Mapping[str, int] = field(default_factory=dict)

    def as_dict(self) -> dict:
        """Plain values."""
        return asdict(self)

    @classmethod
    def from_dict(cls, known: Mapping) -> "Mission":
        """The mission that ``as_dict`` gave."""
        chain = known["chain"]
        own = {
            "goal_poses": tuple(Pose(**p) for p in known["goal_poses"]),
            "poses": {name: Pose(**p) for name, p in known["poses"].items()},
            "chain": chain
            and TrueChain(tuple(chain["robots"]), tuple(chain["landmarks"]), chain["way_m"]),
        }
        return cls(**{**known, **own})


class _State(NamedTuple):
    """A robot whose panorama is known, and the landmark that leads there: none at the start."""

    robot: str
    landmark: int | None


class Views:
    """What is seen from poses, and how far all is from there: found out once for each."""

    def __init__(self, truth: GroundTruth, rig: CameraRig, free: FreeSpace) -> None:
        self.sights = sights = cache(lambda pose: Sights(truth, pose, rig))
        self.sees = cache(lambda target, pose: truth.sees(target, pose, rig))
        self.any_of = cache(lambda target, pose: len(truth.visibility(pose, rig, of=target)) > 0)
        self.shared = cache(lambda a, b: shared(truth, sights(a), sights(b)))
        self.far_m = cache(lambda pose: free.from_m(pose.xy_m))


class Ground:
    """A scene to draw missions in; what is found out about it is kept."""

    def __init__(self, scene: Scene, truth: GroundTruth, rig: CameraRig | None = None) -> None:
        self.scene, self.truth, self.rig = scene, truth, rig or CameraRig()
        self.free = FreeSpace(scene)
        self._pictured: dict[tuple[int, int], list[Pose]] = {}
        self._zones: dict[tuple[int, int], NDArray[np.int64]] = {}
        self._from_near: dict[tuple[int, int], frozenset[int]] = {}
        self._places: dict[tuple[int, int], tuple[Array, Views]] = {}

    def draw(
        self,
        seed: int,
        k: int,
        number: int,
        n_robots: int,
        to_places: bool = False,
        landmarks: int = 0,
    ) -> Mission:
        """Mission ``number`` of suburb k of a seed; MissionError if none is found.

        landmarks: how many its chain needs at least; if 0, two of every third mission's. Long
        chains are rare, so where they are asked for all missions of a suburb are among the same
        ``_PLACES``, which are uniform as others are.
        """
        places = self._places_of(seed, k) if landmarks else None
        draws = generator(seed, "mission to a place" if to_places else "mission", k, number)
        names = robot_names(n_robots)
        goals = [] if to_places else goal_ids(self.scene, None)
        least = landmarks or (2 if number % 3 == 0 else 0)
        rejected: dict[str, int] = {}
        most = _DRAWS_AMONG_PLACES if places else _DRAWS
        for _ in range(most):
            found = self._draw(draws, names, goals, seed, number, least, places)
            if isinstance(found, Mission):
                return replace(found, rejected=rejected)
            rejected[found] = rejected.get(found, 0) + 1
        raise MissionError(
            f"found no mission in {self.scene.name} with {n_robots} robots in {most} draws "
            f"({rejected}): try another seed or scene, or more robots"
        )

    def _draw(
        self,
        draws: np.random.Generator,
        names: list[str],
        goals: list[int],
        seed: int,
        number: int,
        least: int,
        places: tuple[Array, Views] | None,
    ) -> "Mission | str":
        """A mission, or why it is none; without goals to choose from, to a place."""
        target = int(draws.choice(goals)) if goals else None
        n = len(names) + (target is None)
        if places is None:
            stands, views = self._stands(draws, n), Views(self.truth, self.rig, self.free)
        else:
            stands, views = draws.choice(places[0], n, replace=False), places[1]
        xy_m = stands[:, :2]
        away_m = np.linalg.norm(xy_m[:, None] - xy_m, axis=2)
        if (away_m[np.triu_indices(n, 1)] < _APART_M).any():
            return "robots in one place"
        poses = [Pose(*map(float, stand)) for stand in stands]
        if target is None:
            zone = np.array([self.free.nearest(xy_m[-1])])
        else:
            zone = self.free.around(self.scene.objects[target].footprint, SUCCESS_RANGE_M)
        far_m = views.far_m(poses[0])
        way_m = float(far_m[zone].min()) if len(zone) else np.inf
        if not WAY_M[0] <= way_m <= WAY_M[1]:
            return "way too short" if way_m < WAY_M[0] else "way too long"
        if target is None:
            in_view = bool(views.shared(poses[0], poses[-1]))
        else:
            in_view = views.any_of(target, poses[0])
        if in_view:
            return "goal in view"
        team = dict(zip(names, poses, strict=False))
        end = poses[-1] if target is None else target
        chain = self.chain(team, end, far_m, zone, least, views)
        if least and chain is None:
            return f"no chain of {least} or more"
        if target is None:
            return Mission(number, PLACE, (poses[-1],), team, way_m, chain)
        if (target, seed) not in self._pictured:
            self._pictured[target, seed] = goal_poses(self.scene, self.truth, target, seed)
        pictured = tuple(self._pictured[target, seed])
        if len(pictured) < GOAL_PICTURES:
            return "goal cannot be pictured"
        return Mission(number, self.scene.objects[target].name, pictured, team, way_m, chain)

    def _stands(self, draws: np.random.Generator, n: int) -> Array:
        """Free places and headings, (n, 3): metres and radians."""
        points_m = self.free.points_m[draws.integers(len(self.free.points_m), size=n)]
        return np.column_stack([points_m, draws.uniform(-np.pi, np.pi, n)])

    def _places_of(self, seed: int, k: int) -> tuple[Array, Views]:
        """The stands of a suburb that missions with long chains are among."""
        if (seed, k) not in self._places:
            stands = self._stands(generator(seed, "places of missions", k), _PLACES)
            self._places[seed, k] = stands, Views(self.truth, self.rig, self.free)
        return self._places[seed, k]

    def chain(
        self,
        poses: Mapping[str, Pose],
        target: int | Pose,
        far_m: Array,
        zone: NDArray[np.int64],
        least: int = 0,
        views: Views | None = None,
    ) -> TrueChain | None:
        """The chain with fewest landmarks from the first robot to the goal, or None.

        target: the goal, an object or a place. far_m: how far every point is from that robot; zone:
        where the goal is reached. least: None too if that chain has fewer landmarks.
        """
        views = views or Views(self.truth, self.rig, self.free)
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
            return state.robot == PLACE or target in self._near(state.landmark, region)

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
        zone: NDArray[np.int64],
        region: int,
    ) -> TrueChain:
        """The chain with the shortest way to one of some ends.

        before: the states that lead to each, by one landmark fewer.
        """

        @cache
        def through_m(landmark: int, earlier: tuple[_State, ...]) -> Array:
            points = self._zone(landmark, region)
            ways_m = [after_m(state)[points] for state in earlier]
            return self.free.through_m(np.min(ways_m, axis=0), points)

        def after_m(state: _State) -> Array:
            landmark = state.landmark
            return far_m if landmark is None else through_m(landmark, before[state])

        def best(
            states: Sequence[_State], points: NDArray[np.int64], rest_m: Array | float
        ) -> tuple[float, _State, int]:
            ways_m = np.stack([after_m(state)[points] + rest_m for state in states])
            k, p = divmod(int(ways_m.argmin()), len(points))
            return float(ways_m[k, p]), states[k], int(points[p])

        way_m, state, point = best(ends, zone, 0.0)
        states = [state]
        while state.landmark is not None:  # back to the start
            points = self._zone(state.landmark, region)
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
        if landmark == state.landmark or len(self._zone(landmark, region)) == 0:
            return False
        return state.landmark is None or landmark in self._near(state.landmark, region)

    def _zone(self, landmark: int, region: int) -> NDArray[np.int64]:
        """The points of a region within the approach distance of a landmark."""
        if (landmark, region) not in self._zones:
            zone = self.free.around(self.scene.objects[landmark].footprint, APPROACH_M)
            self._zones[landmark, region] = zone[self.free.region[zone] == region]
        return self._zones[landmark, region]

    def _near(self, landmark: int, region: int) -> frozenset[int]:
        """What is visible from a region's places within the approach distance of a landmark."""
        if (landmark, region) not in self._from_near:
            zone = self._zone(landmark, region)
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

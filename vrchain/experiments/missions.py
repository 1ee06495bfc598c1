"""Missions at random, and the chains of landmarks that truth knows lead to their goals.

Start, other robots and goal are uniform: robots in free space, the goal among the buildings without
a twin, or, asked for places, in free space too. A draw is rejected if the shortest free way is not
40 to 120 m long, if a pixel of the goal is in view at the start, or a landmark in view from the
place that is the goal, or if the goal cannot be pictured unoccluded. Every third mission, or each
if so asked, is drawn until its chain needs two landmarks or more. Robots face anywhere.

A *chain* is start, L1, P2, L2 ... Pk, goal: each landmark co-visible in neighbouring panoramas, the
goal visible in Pk, and from a free and reachable place within the approach distance of each
landmark the next one, at last the goal, is visible. The one with fewest landmarks is given, of
those the one with the shortest way. Where the goal is a place, its own panorama ends the chain, as
another robot's would.
"""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from functools import cache

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import csr_array, hstack, vstack
from scipy.sparse.csgraph import dijkstra

from vrchain.errors import MissionError
from vrchain.experiments.task import GOAL_PICTURES, goal_ids, goal_poses, robot_names
from vrchain.geometry import Pose
from vrchain.landmarks.quality import Sights, shared
from vrchain.navigation.ways import grid_graph
from vrchain.panorama import CameraRig
from vrchain.scene.model import Scene
from vrchain.seeding import generator
from vrchain.truth import VISIBLE_AREA_DEG2, VISIBLE_AZIMUTH_DEG, GroundTruth

Array = NDArray[np.float64]

PLACE = "a place"  # the goal's name, where it is no object
WAY_M = (40.0, 120.0)
APPROACH_M = 3.0  # from a landmark's footprint; the goal is reached at this range too
_SPACING_M, _CLEARANCE_M = 0.5, 0.5  # of the grid on which ways are found
_APART_M = 2.0  # robots are not nearer to each other
_VANTAGES = 4  # places around a landmark from which the next may be seen
_RAYS_PER_DEG, _MOST_RISE_DEG = 2, 16.0
_DRAWS = 2000


class FreeSpace:
    """Where a robot can drive in a scene, as a grid, and how far it is from place to place."""

    def __init__(self, scene: Scene) -> None:
        half = np.array(scene.extent_m) / 2 - _SPACING_M / 2
        x, y = (np.arange(-h, h + 1e-9, _SPACING_M) for h in half)
        points = np.stack(np.meshgrid(x, y), axis=-1)
        free = scene.is_free(points.reshape(-1, 2), _CLEARANCE_M).reshape(len(y), len(x))
        number = np.where(free, np.cumsum(free).reshape(free.shape) - 1, -1)
        self.points_m: Array = points[free]
        self._graph = grid_graph(number, np.ones(number.shape), _SPACING_M)

    def from_m(self, xy_m: Array) -> Array:
        """How far every point is from the one nearest to ``xy_m``: (n,), inf: not reachable."""
        nearest = int(np.hypot(*(self.points_m - xy_m).T).argmin())
        return np.asarray(dijkstra(self._graph, directed=False, indices=nearest))

    def through_m(self, before_m: Array, zone: NDArray[np.int64]) -> Array:
        """How far every point is by way of one of a zone's, which are ``before_m[zone]`` far."""
        n = len(self.points_m)
        zone = zone[np.isfinite(before_m[zone])]
        if len(zone) == 0:
            return np.full(n, np.inf)
        least = before_m[zone].min()
        gate = csr_array((before_m[zone] - least + 1e-6, (np.zeros(len(zone), int), zone)), (1, n))
        corner = csr_array((1, 1))
        graph = vstack([hstack([self._graph, csr_array((n, 1))]), hstack([gate, corner])])
        found = dijkstra(csr_array(graph), directed=False, indices=n)[:n]
        return np.asarray(found + least)

    def around(self, footprint: shapely.Geometry, within_m: float) -> NDArray[np.int64]:
        """The points within some distance of a footprint."""
        x0, y0, x1, y1 = footprint.bounds
        x, y = self.points_m.T
        near = (x > x0 - within_m) & (x < x1 + within_m)
        chosen = np.flatnonzero(near & (y > y0 - within_m) & (y < y1 + within_m))
        away = shapely.distance(footprint, shapely.points(self.points_m[chosen]))
        return chosen[away <= within_m]


@dataclass(frozen=True)
class TrueChain:
    """robots: the driving one first; landmarks: one between each two of them, and one to the goal.

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


@dataclass(frozen=True, eq=False)
class _State:
    """A robot whose panorama is known, the landmark that leads there, and how one came by it."""

    robot: str
    landmark: int | None
    before_m: Array  # way from the start, by the landmarks before this one
    robots: tuple[str, ...]
    landmarks: tuple[int, ...]


class Ground:
    """A scene to draw missions in; what is found out about it is kept."""

    def __init__(self, scene: Scene, truth: GroundTruth, rig: CameraRig | None = None) -> None:
        self.scene, self.truth, self.rig = scene, truth, rig or CameraRig()
        self.free = FreeSpace(scene)
        self._pictured: dict[int, list[Pose]] = {}
        self._from_near: dict[int, frozenset[int]] = {}

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

        landmarks: how many its chain needs at least; if 0, two of every third mission's.
        """
        draws = generator(seed, "mission to a place" if to_places else "mission", k, number)
        names = robot_names(n_robots)
        goals = [] if to_places else goal_ids(self.scene, None)
        least = landmarks or (2 if number % 3 == 0 else 0)
        rejected: dict[str, int] = {}
        for _ in range(_DRAWS):
            found = self._draw(draws, names, goals, seed, number, least)
            if isinstance(found, Mission):
                return Mission(**{**found.__dict__, "rejected": rejected})
            rejected[found] = rejected.get(found, 0) + 1
        raise MissionError(
            f"found no mission in {self.scene.name} with {n_robots} robots in {_DRAWS} draws "
            f"({rejected}): try another scene, or more robots"
        )

    def _draw(
        self,
        draws: np.random.Generator,
        names: list[str],
        goals: list[int],
        seed: int,
        number: int,
        least: int,
    ) -> "Mission | str":
        """A mission, or why it is none; without goals to choose from, to a place."""
        target = int(draws.choice(goals)) if goals else None
        n = len(names) + (target is None)
        stand = draws.integers(len(self.free.points_m), size=n)
        xy_m, yaws = self.free.points_m[stand], draws.uniform(-np.pi, np.pi, n)
        away_m = np.linalg.norm(xy_m[:, None] - xy_m, axis=2)
        if (away_m[np.triu_indices(n, 1)] < _APART_M).any():
            return "robots in one place"
        poses = [Pose(float(x), float(y), float(a)) for (x, y), a in zip(xy_m, yaws, strict=True)]
        if target is None:
            zone = stand[-1:]
        else:
            zone = self.free.around(self.scene.objects[target].footprint, APPROACH_M)
        far_m = self.free.from_m(xy_m[0])
        way_m = float(far_m[zone].min()) if len(zone) else np.inf
        if not WAY_M[0] <= way_m <= WAY_M[1]:
            return "way too short" if way_m < WAY_M[0] else "way too long"
        if target is None:
            seen = (Sights(self.truth, pose, self.rig) for pose in (poses[0], poses[-1]))
            in_view = bool(shared(self.truth, *seen))
        else:
            in_view = len(self.truth.visibility(poses[0], self.rig, of=target)) > 0
        if in_view:
            return "goal in view"
        team = dict(zip(names, poses, strict=False))
        chain = self.chain(team, poses[-1] if target is None else target, far_m, zone)
        if least and (chain is None or len(chain.landmarks) < least):
            return f"no chain of {least} or more"
        if target is None:
            return Mission(number, PLACE, (poses[-1],), team, way_m, chain)
        if target not in self._pictured:
            self._pictured[target] = goal_poses(self.scene, self.truth, target, seed)
        if len(self._pictured[target]) < GOAL_PICTURES:
            return "goal cannot be pictured"
        return Mission(
            number, self.scene.objects[target].name, tuple(self._pictured[target]), team, way_m,
            chain,
        )  # fmt: skip

    def chain(
        self,
        poses: Mapping[str, Pose],
        target: int | Pose,
        far_m: Array,
        zone: NDArray[np.int64],
    ) -> TrueChain | None:
        """The chain with fewest landmarks from the first robot to the goal, or None.

        target: the goal, an object or a place. far_m: how far every point is from that robot; zone:
        where the goal is reached.
        """
        first, *others = poses
        if isinstance(target, Pose):
            poses, others, last = {**poses, PLACE: target}, [*others, PLACE], {PLACE}
        else:
            last = {n for n in others if self.truth.sees(target, poses[n], self.rig)}
        seen = {n: Sights(self.truth, p, self.rig) for n, p in poses.items()}
        if not last:
            return None

        @cache
        def common(a: str, b: str) -> list[int]:
            return [i for i in shared(self.truth, seen[a], seen[b]) if i != target]

        reached = [_State(first, None, far_m, (first,), ())]
        left = set(others)
        while reached and left:
            onward: dict[tuple[str, int], _State] = {}
            least_m: dict[tuple[str, int], float] = {}
            for state in reached:
                after_m = self._after_m(state)
                for robot in sorted(left):
                    pair = (state.robot, robot)
                    for i in common(*sorted(pair)):
                        known = state.landmark is None or i in self._near(state)
                        if not known or i in state.landmarks:
                            continue
                        way_m = float(after_m[self._zone(i)].min(initial=np.inf))
                        if way_m < least_m.get((robot, i), np.inf):
                            least_m[robot, i] = way_m
                            onward[robot, i] = _State(
                                robot, i, after_m, (*state.robots, robot), (*state.landmarks, i)
                            )
            ends = [
                TrueChain(
                    tuple(r for r in state.robots if r != PLACE),
                    tuple(self.scene.objects[i].name for i in state.landmarks),
                    float(self._after_m(state)[zone].min()),
                )
                for state in onward.values()
                if state.robot in last and (state.robot == PLACE or target in self._near(state))
            ]
            if ends:
                return min(ends, key=lambda chain: chain.way_m)
            reached = list(onward.values())
            left -= {state.robot for state in reached}
        return None

    def _after_m(self, state: "_State") -> Array:
        """How far every point is by way of the state's landmark."""
        if state.landmark is None:
            return state.before_m
        return self.free.through_m(state.before_m, self._zone(state.landmark))

    def _zone(self, landmark: int) -> NDArray[np.int64]:
        return self.free.around(self.scene.objects[landmark].footprint, APPROACH_M)

    def _near(self, state: "_State") -> frozenset[int]:
        """What is visible from reachable places within the approach distance of its landmark."""
        landmark = state.landmark
        assert landmark is not None
        if landmark not in self._from_near:
            zone = self._zone(landmark)
            zone = zone[np.isfinite(state.before_m[zone])]
            middle = self.scene.objects[landmark].bounds_m[:, :2].mean(axis=0)
            around = np.argsort(np.arctan2(*(self.free.points_m[zone] - middle).T[::-1]))
            chosen = zone[around][:: max(1, len(zone) // _VANTAGES)][:_VANTAGES]
            self._from_near[landmark] = frozenset(self._visible(chosen))
        return self._from_near[landmark]

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

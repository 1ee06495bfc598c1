"""Missions at random, and the chains of landmarks that lead to their goals.

Start, other robots and goal are uniform: robots in free space, the goal among the buildings without
a twin, or, asked for places, in free space too; all in the largest region that holds a goal. A draw
is rejected if the shortest free way is not 40 to 120 m long, if a pixel of the goal is in view at
the start, or a landmark in view from the place that is the goal, or if the goal cannot be pictured
unoccluded. Every third mission, or each if so asked, is drawn until its chain needs two landmarks
or more; not in a house, where such are rare, and ways shorter. Robots face anywhere.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cache, partial

import numpy as np

from vrchain.errors import MissionError
from vrchain.experiments.missions.chains import PLACE, Chains, TrueChain, Views
from vrchain.experiments.scenes import seed_of
from vrchain.geometry import Pose
from vrchain.panorama import CameraRig
from vrchain.seeding import generator
from vrchain.simulation.collision_free import SPACING_M, Array, Ints
from vrchain.simulation.goals import GOAL_PICTURES, goal_ids, goal_poses
from vrchain.simulation.task import SUCCESS_RANGE_M, robot_names
from vrchain.world.model import Scene
from vrchain.world.truth import GroundTruth

WAY_M = (40.0, 120.0)
_SMALL_SHARE = 1 / 3  # of a small world's length and width together, where that is less,
_ROOM_SHARE = 0.75  # or of the side of a square as large as the room
_APART_M = 2.0  # robots are not nearer to each other
_PLACES = 100  # in a suburb, where chains of so many landmarks are asked for
_DRAWS, _DRAWS_AMONG_PLACES = 2000, 50_000


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


class Ground:
    """A scene to draw missions in; what is found out about it is kept."""

    def __init__(self, scene: Scene, truth: GroundTruth, rig: CameraRig | None = None) -> None:
        self.scene, self.truth, self.rig = scene, truth, rig or CameraRig()
        self.chains = Chains(scene, truth, self.rig)
        self.free = self.chains.free
        self._places: dict[tuple[int, int, int], tuple[Array, Views]] = {}
        self._pictured = cache(
            lambda target, seed, room: goal_poses(
                scene, truth, target, seed, partial(self.free.is_in, room)
            )
        )

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
        room, goals = self.room(to_places)
        places = self.places(seed, k, room) if landmarks else None
        draws = generator(seed, "mission to a place" if to_places else "mission", k, number)
        names, own = robot_names(n_robots), seed_of(seed, k)
        least_m, confined = self._least_m(room)
        least = landmarks or (2 if number % 3 == 0 and not confined else 0)
        rejected: Counter[str] = Counter()
        most = _DRAWS_AMONG_PLACES if places else _DRAWS
        for _ in range(most):
            found = self._draw(draws, names, room, goals, own, number, least, least_m, places)
            if isinstance(found, Mission):
                return replace(found, rejected=dict(rejected))
            rejected[found] += 1
        raise MissionError(
            f"found no mission in {self.scene.name} with {n_robots} robots in {most} draws "
            f"({dict(rejected)}): try another seed or scene, or more robots"
        )

    def _draw(
        self,
        draws: np.random.Generator,
        names: list[str],
        room: int,
        goals: list[int],
        seed: int,
        number: int,
        least: int,
        least_m: float,
        places: tuple[Array, Views] | None,
    ) -> Mission | str:
        """A mission, or why it is none; without goals to choose from, to a place."""
        target = int(draws.choice(goals)) if goals else None
        n = len(names) + (target is None)
        if places is None:
            stands, views = self.stands(draws, n, room), Views(self.truth, self.rig, self.free)
        else:
            stands, views = draws.choice(places[0], n, replace=False), places[1]
        xy_m = stands[:, :2]
        away_m = np.linalg.norm(xy_m[:, None] - xy_m, axis=2)
        if (away_m[np.triu_indices(n, 1)] < _APART_M).any():
            return "robots in one place"
        poses = [Pose(*map(float, stand)) for stand in stands]
        end = poses[-1] if target is None else target
        zone = self._zone(end)
        far_m = views.far_m(poses[0])
        way_m = float(far_m[zone].min()) if len(zone) else np.inf
        if not least_m <= way_m <= WAY_M[1]:
            return "way too short" if way_m < least_m else "way too long"
        pictured = tuple(self._pictured(target, seed, room)) if target is not None else ()
        if target is not None and len(pictured) < GOAL_PICTURES:
            return "goal cannot be pictured"
        if target is None:
            in_view = len(views.shared(poses[0], poses[-1])) > 0
        else:
            in_view = views.any_of(target, poses[0])
        if in_view:
            return "goal in view"
        team = dict(zip(names, poses, strict=False))
        chain = self.chains.chain(team, end, far_m, zone, views, least)
        if least and chain is None:
            return f"no chain of {least} or more"
        if target is None:
            return Mission(number, PLACE, (poses[-1],), team, way_m, chain)
        return Mission(number, self.scene.objects[target].name, pictured, team, way_m, chain)

    def within_reach(
        self, pose: Pose, target: int, seed: int, room: int, views: Views
    ) -> tuple[float, tuple[Pose, ...]] | None:
        """How far a goal is, and from where it is pictured; None: no mission leads there.

        room: the region that the robot is in; views: of this scene, for several goals.
        """
        zone = self._zone(target)
        way_m = float(views.far_m(pose)[zone].min()) if len(zone) else np.inf
        pictured = tuple(self._pictured(target, seed, room))
        if not self._least_m(room)[0] <= way_m <= WAY_M[1] or views.any_of(target, pose):
            return None
        return (way_m, pictured) if len(pictured) == GOAL_PICTURES else None

    def way_m(self, pose: Pose, goal: str, goal_poses: tuple[Pose, ...]) -> float:
        """The shortest free way to a goal near others, from the free place nearest to a pose."""
        zone = self._zone(goal_poses[0] if goal == PLACE else self.scene.index_of(goal))
        room = self.free.region[zone[0]] if goal == PLACE else self.room()[0]
        within_m = self.free.points_m[self.free.region == room]
        nearest_m = within_m[np.hypot(*(within_m - pose.xy_m).T).argmin()]
        return float(self.free.from_m(nearest_m)[zone].min())

    def another(self, mission: Mission, seed: int) -> Mission:
        """With another goal, at random. MissionError: there is none."""
        room, goals = self.room()
        pose, views = next(iter(mission.poses.values())), Views(self.truth, self.rig, self.free)
        for target in map(int, generator(seed, "another goal").permutation(goals)):
            name = self.scene.objects[target].name
            reach = self.within_reach(pose, target, seed, room, views)
            if reach and name != mission.goal:
                return replace(mission, goal=name, goal_poses=reach[1])
        raise MissionError(f"no other goal than {mission.goal} can be driven to from {pose}")

    def _zone(self, goal: int | Pose) -> Ints:
        """Where a goal, an object or a place, is reached."""
        if isinstance(goal, Pose):
            return np.array([self.free.nearest(goal.xy_m)])
        return self.free.around(self.scene.objects[goal].footprint, SUCCESS_RANGE_M)

    def _least_m(self, room: int) -> tuple[float, bool]:
        """How long a way is at least, and whether it is shorter as the room is small."""
        usual_m = min(WAY_M[0], _SMALL_SHARE * sum(self.scene.extent_m))
        room_m = _ROOM_SHARE * SPACING_M * float((self.free.region == room).sum()) ** 0.5
        return min(usual_m, room_m), room_m < usual_m

    def room(self, to_places: bool = False) -> tuple[int, list[int]]:
        """The region that missions are drawn in, and its goals. MissionError if it has none."""
        goals = [] if to_places else goal_ids(self.scene, None)
        room, near = self.free.room(self.scene, goals, SUCCESS_RANGE_M)
        if goals and not near:
            raise MissionError(
                f"no goal in {self.scene.name} is within {SUCCESS_RANGE_M:g} m of a place where a "
                "robot fits: take another scene"
            )
        return room, near

    def stands(self, draws: np.random.Generator, n: int, room: int) -> Array:
        """Free places of a region and headings, (n, 3): metres and radians."""
        within_m = self.free.points_m[self.free.region == room]
        points_m = within_m[draws.integers(len(within_m), size=n)]
        return np.column_stack([points_m, draws.uniform(-np.pi, np.pi, n)])

    def places(self, seed: int, k: int, room: int) -> tuple[Array, Views]:
        """The stands of a suburb that missions with long chains are among."""
        key = seed, k, room
        if key not in self._places:
            stands = self.stands(generator(seed, "places of missions", k), _PLACES, room)
            self._places[key] = stands, Views(self.truth, self.rig, self.free)
        return self._places[key]

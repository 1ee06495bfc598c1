"""How often, and how directly, robots arrive: missions with the ledger, alone, and by truth.

Every mission is driven by each arm: *ledger* plans from what the others have published, and goes
and looks elsewhere where no chain leads on; *alone* has the same senses, recognition and time, but
no ledger, so that it only looks elsewhere; *oracle* is ledger with landmarks as truth has them. The
other robots publish what they see from where they are put, have driven about and published for some
minutes when the mission starts, and go on while it runs. To ``alone`` they are of no use and stay
where they are.

A hundred missions are ten in each of ten suburbs, the first ten one in each: even few missions say
something of how suburbs differ. Each is saved as it ends, so that a run broken off, or asked for
more missions, goes on with the next. Broadcasting every panorama to everyone would differ from
ledger in bytes alone.
"""

import json
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from itertools import product
from pathlib import Path
from time import perf_counter

import numpy as np
import pandas as pd

from vrchain.errors import MissionError
from vrchain.experiments.missions.draw import PLACE, Ground, Mission
from vrchain.experiments.missions.obstruction import Barred
from vrchain.experiments.missions.oracle import Oracle
from vrchain.experiments.missions.scores import routes_of
from vrchain.experiments.missions.wrong_edges import misled
from vrchain.experiments.scenes import Scenes
from vrchain.experiments.workers import each
from vrchain.files import code_digest, name_of, write_file
from vrchain.geometry import Pose
from vrchain.landmarks.extraction.record import maker_of
from vrchain.landmarks.extraction.weights import SHIPPED
from vrchain.ledger import Ledger, simulated_key
from vrchain.ledger.records.encoding import digest
from vrchain.navigation.goal.place import GoalPlace
from vrchain.navigation.goal.recognition import GoalPictures, KnownGoal, goal_from
from vrchain.navigation.mission import MissionResult, run_mission
from vrchain.navigation.perception import learned_perception
from vrchain.navigation.settings import Decision, MissionConfig, Published
from vrchain.panorama import CameraRig
from vrchain.simulation.mission import index_of, is_at, published_of
from vrchain.simulation.patrol import Patrol
from vrchain.simulation.simulator import Simulator
from vrchain.simulation.task import goal_pictures, robot_names
from vrchain.simulation.team import assemble
from vrchain.world.render import Renderer
from vrchain.world.truth import GroundTruth

ARMS = ("ledger", "alone", "oracle")
SUBURBS = 10  # of a hundred missions
PATROL_S = 300.0  # for which the others have been under way as a mission starts
REMEMBERED = 40  # panoramas of each robot that others plan by
_AT_PLACE_M = 1.0


class Suburb:
    """One scene with all that is made of it once, and missions in it."""

    def __init__(self, scenes: Scenes, seed: int, k: int, rig: CameraRig) -> None:
        self.scene, self.seed, self.k, self.rig = scenes.scene(seed, k), seed, k, rig
        self.truth, self.renderer = GroundTruth(self.scene), Renderer(self.scene)
        self.ground = Ground(self.scene, self.truth, rig)

    def drive(
        self,
        mission: Mission,
        arm: str,
        config: MissionConfig | None = None,
        weights: Path = SHIPPED,
        patrol_s: float = PATROL_S,
        wrong_edges: float = 0.0,
        barred: float = 0.0,
        tell: Callable[[Decision], None] = lambda decision: None,
    ) -> dict[str, object]:
        """Drive a mission by one arm: a row of ``evaluate``'s table, and its log."""
        start = perf_counter()
        number = self.seed * 100_003 + self.k * 1009 + mission.number
        simulator = Simulator(self.scene, mission.poses, seed=number, rig=self.rig)
        simulator.truth, simulator.renderer = self.truth, self.renderer
        robot, *others = mission.poses
        members = {name: simulated_key(number, name).public for name in mission.poses}
        with (
            tempfile.TemporaryDirectory() as folder,
            Ledger.create(
                Path(folder) / "ledger", members, simulated_key(number, "operator")
            ) as ledger,
        ):
            taken: dict[bytes, Pose] = {}  # from where panoramas were, by their digest
            oracle = Oracle(self.truth, self.rig) if arm == "oracle" else None
            if oracle is not None:
                perception = oracle.perception(
                    lambda: simulator.pose(robot), lambda b: taken[digest(b)]
                )
            else:
                perception = learned_perception(weights)
            goal: KnownGoal
            if mission.goal == PLACE:
                (place,) = mission.goal_poses
                shown = self.renderer.render(place, self.rig).encode()
                taken[digest(shown)] = place
                look = perception.stored(shown, None)
                goal = oracle.place(look, perception) if oracle else GoalPlace(look, perception)
            else:
                goal = oracle.goal(mission.goal) if oracle else self._goal(mission, weights)
            perception = misled(
                perception, wrong_edges, number
            )  # among panoramas: the goal is as it was shown
            robots = assemble(
                simulator, ledger, number, examine=oracle.record if oracle else perception.record
            )
            if arm != "alone":
                for name in others:
                    robots[name].observe(look=True)
                patrol = Patrol(simulator, {name: robots[name] for name in others}, number)
                patrol.drive(patrol_s)
                robots[robot].others = patrol.drives
            index, known = index_of(ledger, perception), published_of(ledger, robot, REMEMBERED)

            def published() -> Mapping[str, Published]:
                for p in (p for name in others for p in robots[name].publications):
                    taken[bytes.fromhex(p.digest)] = Pose(p.x_m, p.y_m, p.yaw_rad)
                return known()

            bars = Barred(simulator, robot, barred, number)

            def told(decision: Decision) -> None:
                tell(decision)
                bars.tell(decision)

            started_ns = simulator.clock_ns
            result = run_mission(
                robot, robots[robot], published, index, goal, perception, config, told
            )
            n_published = len(known())
        seconds = (simulator.clock_ns - started_ns) / 1e9
        row = self._row(mission, arm, simulator, robot, result, seconds)
        costs = {"clock_s": simulator.clock_ns / 1e9, "wall_s": perf_counter() - start}
        return {**row, "published": n_published, "barred": bars.rows, **costs}

    def _goal(self, mission: Mission, weights: Path) -> GoalPictures:
        pictures = goal_pictures(
            self.scene, self.renderer, mission.goal, mission.goal_poses, self.rig
        )
        return goal_from(pictures, weights)

    def _row(
        self,
        mission: Mission,
        arm: str,
        simulator: Simulator,
        robot: str,
        result: MissionResult,
        seconds: float,
    ) -> dict[str, object]:
        pose = simulator.pose(robot)
        if mission.goal == PLACE:
            range_m = pose.distance_to_m(mission.goal_poses[0].xy_m)
            at_goal = range_m <= _AT_PLACE_M
        else:
            at_goal, range_m = is_at(self.scene, self.truth, mission.goal, pose, self.rig)
        path = simulator.path_xy_m(robot)
        chain = mission.chain
        reached = [d for d in result.decisions if d.what == "reached"]
        return {
            "mission": mission.number,
            "arm": arm,
            "arrived": result.arrived,
            "success": result.arrived and at_goal,
            "reason": result.reason,
            "range_m": range_m,
            "driven_m": float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum()),
            "way_m": mission.way_m,
            "chain": len(chain.landmarks) if chain else 0,
            "chain_way_m": chain.way_m if chain else None,
            "collisions": simulator.collisions(robot),
            "replans": max(0, len(result.plans) - 1),
            "legs": len(reached),
            "to_landmarks": sum(d.values["landmark"] for d in reached),
            "seconds_simulated": seconds,
            "log": [asdict(d) for d in result.decisions],
        }


def evaluate(
    scenes: Scenes,
    n_missions: int,
    n_robots: int,
    arms: Sequence[str] = ARMS,
    *,
    seed: int,
    folder: Path,
    rig: CameraRig | None = None,
    config: MissionConfig | None = None,
    weights: Path = SHIPPED,
    to_places: bool = False,
    landmarks: int = 0,
    patrol_s: float = PATROL_S,
    wrong_edges: float = 0.0,
    barred: float = 0.0,
    jobs: int | None = 1,
) -> tuple[pd.DataFrame, list[Mission]]:
    """One row a mission and arm, and the missions as they were drawn, to objects or to places.

    landmarks: how many each chain needs at least; if 0, every third needs two. jobs: see
    ``workers.each``. What was found already under ``folder`` is read from there.
    """
    arms = list(dict.fromkeys(arms))
    robot_names(n_robots)  # refused before a scene is built
    unknown = [arm for arm in arms if arm not in ARMS]
    for what, share in (("wrong edges", wrong_edges), ("barred legs", barred)):
        if not 0 <= share <= 1:
            raise MissionError(f"expected a share of {what} from 0 to 1, got {share}")
    if not 0 <= patrol_s < np.inf:
        raise MissionError(f"expected seconds of patrol, 0 or more, got {patrol_s}")
    if landmarks < 0:
        raise MissionError(f"expected chains of 0 landmarks or more, got {landmarks}")
    if n_missions < 1 or unknown or not arms:
        raise MissionError(
            f"expected 1 mission or more and arms of {', '.join(ARMS)}, got {n_missions} and "
            f"{', '.join(arms)}"
        )
    asked = _Evaluation(
        scenes, n_robots, tuple(arms), seed, folder, rig or CameraRig(), config or MissionConfig(),
        weights, to_places, landmarks, patrol_s, wrong_edges, barred,
    )  # fmt: skip
    left = [number for number in range(n_missions) if not asked.is_done(number)]
    left.sort(key=asked.k)  # a suburb is built once
    each(asked.drive, left, jobs, "missions")
    _suburb.cache_clear()
    rows = []
    for number, arm in product(range(n_missions), arms):
        row = json.loads(asked.row_file(number, arm).read_text())
        row["routes"] = routes_of(row.pop("log"), row["success"])
        rows.append({"suburb": asked.k(number) if scenes.varied else number, **row})
    return pd.DataFrame(rows), [asked.mission(number) for number in range(n_missions)]


@dataclass(frozen=True, eq=False)
class _Evaluation:
    """What is asked of every mission, and where it and what came of it are kept."""

    scenes: Scenes
    n_robots: int
    arms: tuple[str, ...]
    seed: int
    folder: Path
    rig: CameraRig
    config: MissionConfig
    weights: Path
    to_places: bool
    landmarks: int
    patrol_s: float
    wrong_edges: float
    barred: float
    code: str = field(default_factory=code_digest)

    def k(self, number: int) -> int:
        """The suburb of a mission."""
        hundred, within = divmod(number, SUBURBS**2)
        return hundred * SUBURBS + within % SUBURBS

    def mission_file(self, number: int) -> Path:
        return self.folder / name_of(self._drawn) / f"mission_{number:04d}.json"

    def row_file(self, number: int, arm: str) -> Path:
        driven = [
            *self._drawn, asdict(self.config), maker_of(self.weights), self.patrol_s, REMEMBERED,
            self.wrong_edges, self.barred,
        ]  # fmt: skip
        file = self.mission_file(number)
        return file.parent / name_of(driven) / f"{file.stem}_{arm}.json"

    def mission(self, number: int) -> Mission:
        """A mission that was drawn."""
        return Mission.from_dict(json.loads(self.mission_file(number).read_text()))

    def is_done(self, number: int) -> bool:
        """Whether a mission was driven by each arm: no process is started for it."""
        return all(self.row_file(number, arm).exists() for arm in self.arms)

    def drive(self, number: int) -> None:
        """Draw a mission and drive it by each arm, as far as that was not done before."""
        k = self.k(number)
        if not self.mission_file(number).exists():
            drawn = self._suburb(k).ground.draw(
                self.seed, k, number, self.n_robots, self.to_places, self.landmarks
            )
            write_file(self.mission_file(number), json.dumps(drawn.as_dict()).encode())
        for arm in self.arms:
            if not self.row_file(number, arm).exists():
                row = self._suburb(k).drive(
                    self.mission(number), arm, self.config, self.weights, self.patrol_s,
                    self.wrong_edges, self.barred,
                )  # fmt: skip
                write_file(self.row_file(number, arm), json.dumps(row).encode())

    def _suburb(self, k: int) -> Suburb:
        """A world that stays as it is is built once."""
        return _suburb(self.scenes, self.seed, k if self.scenes.varied else 0, self.rig)

    @property
    def _drawn(self) -> list[object]:
        what = [self.code, self.scenes.digest, self.n_robots, self.seed, asdict(self.rig)]
        return [*what, self.to_places, self.landmarks]


@lru_cache(maxsize=1)
def _suburb(scenes: Scenes, seed: int, k: int, rig: CameraRig) -> Suburb:
    """The one at work."""
    return Suburb(scenes, seed, k, rig)

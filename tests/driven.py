"""A mission made up: what was driven, seen, decided and believed."""

import numpy as np
from sights import RIG
from worlds import blotches, box, world

from vrchain.geometry import Pose
from vrchain.landmarks.matching.common import CommonLandmark, Region
from vrchain.navigation.goal.recognition import GoalSight
from vrchain.navigation.mission import MissionResult
from vrchain.navigation.planning.route import Leg, Route
from vrchain.navigation.settings import Decision
from vrchain.panorama import Panorama
from vrchain.simulation.mission import MissionRun
from vrchain.simulation.task import Task

DECIDED_S = (10.0, 10.0, 16.25, 30.0)


def panorama(grey: int) -> Panorama:
    shape = RIG.n_views, RIG.height_px, RIG.width_px, 3
    return Panorama(RIG, np.full(shape, grey, np.uint8))


def driven() -> MissionRun:
    """R1 stands for 10 s, drives 20 m east, and says that it has arrived; R2 stands."""
    scene = world(box("barn", (12.0, 0.0), (2.0, 2.0, 3.0), blotches("barn")))
    times_s = np.arange(0.0, 30.25, 0.25)
    east_m = np.clip(times_s - 10.0, 0.0, 20.0) - 10.0
    paths = {"R1": np.stack([east_m, 0 * east_m], axis=1), "R2": np.full((len(times_s), 2), 5.0)}
    places = {"R1": Pose(-10.0, 0.0), "R2": Pose(5.0, 5.0)}
    region = Region(0, (0.0, 0.0, 9.0, 9.0), 0.5, 0.2)
    oak = CommonLandmark(0.9, region, region, np.arange(0), np.arange(0))
    leg = Leg("R1", "R2", oak, ("R1", "R2", 0), "N1")
    route = Route((leg,), "R2", GoalSight(0.3, 8.0, 8.0, 0.1, 20, 3.0, 0.9), 0.5)
    whats = ("route", "leg", "reached", "arrived")
    looks = (0, 0, 1, None)
    decisions = tuple(
        Decision(time_s, what, f"why {what}", look)
        for time_s, what, look in zip(DECIDED_S, whats, looks, strict=True)
    )
    result = MissionResult(
        True, "there", decisions, (panorama(60), panorama(200)), ((0, route),)
    )  # fmt: skip
    return MissionRun(
        scene, Task(places, places, "barn", ()), "R1", result, (), {"R2": panorama(120)}, paths,
        times_s, Pose(10.0, 0.0), True, 1.0, 0, 20.0, "",
    )  # fmt: skip

"""Driving by odometry, around what the range ring shows."""

from functools import partial
from itertools import combinations
from typing import cast

import numpy as np
import pytest
import worlds
from plains import PERCEPTION, Plain, Walker

from vrchain.geometry import Pose
from vrchain.navigation.driving.drive import Pilot
from vrchain.navigation.driving.estimates import Estimate
from vrchain.navigation.settings import GaveUp, MissionConfig
from vrchain.robot import UNSEEN_M, Drive, Observation, beams_rad
from vrchain.seeding import generator
from vrchain.simulation.simulator import Simulator
from vrchain.simulation.together import Together
from vrchain.world.model import ROBOT_RADIUS_M


def pilot(shut_in: bool = False, **config: float) -> Pilot:
    """A robot on open ground, its back to where it is going."""
    walker = Walker(Plain(()), Pose(0.0, 0.0, np.pi), shut_in)
    return Pilot(walker, PERCEPTION, MissionConfig(**config))  # type: ignore[arg-type]


def there(x_m: float) -> np.ndarray:
    """A place straight behind the start, in the frame of the robot's odometry."""
    return np.array([-x_m, 0.0])


def test_a_long_stretch_of_open_ground_is_driven_whole() -> None:
    ours = pilot()
    driven_m = ours.stretch(there(45.0), 1.0, 40.0)
    assert driven_m is not None and driven_m >= 40.0
    assert np.hypot(*(ours.here.xy_m - there(45.0))) < 7.0


def test_who_makes_no_headway_is_stuck() -> None:
    ours = pilot(shut_in=True)
    assert ours.stretch(there(45.0), 1.0, 40.0) is None
    assert ours.now.time_ns <= (ours.config.stuck_after_s + 2) * 1e9


def test_who_planned_for_a_minute_is_not_stuck() -> None:
    """On a real robot time passes then; it has the time of an approach still."""
    ours = pilot()
    body = cast(Walker, ours.body)
    body.time_ns += 60_000_000_000
    assert ours.until_ns(Estimate(there(4.0), np.eye(2))) >= body.time_ns + 30_000_000_000
    body.time_ns += 60_000_000_000
    assert ours.stretch(there(45.0), 1.0, 2.0) is not None


class Crossed(worlds.Body):
    """A robot whose way another crosses, which minds nobody."""

    def drive(self, command: Drive, duration_s: float) -> None:
        self.simulator.step({"R1": command, "R2": Drive(0.7)}, duration_s)


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(("ahead_m", "turned_rad"), [(0.9, 1.2), (1.2, 1.6)])
def test_who_drives_gives_way_to_who_comes_from_the_side(
    side: int, ahead_m: float, turned_rad: float
) -> None:
    """Steering alone, which minds what is ahead, drives into the other."""
    start = {"R1": Pose(0, 0, 0.0), "R2": Pose(ahead_m, 1.4 * side, -turned_rad * side)}
    simulator = Simulator(worlds.world(), start, seed=1)
    ours = Pilot(Crossed(simulator), PERCEPTION, MissionConfig())
    assert ours.stretch(np.array([9.0, 0.0]), 1.0, 6.0) is not None
    assert simulator.collisions("R1") == 0
    assert simulator.pose("R1").x_m > 5.0


def crossing(seed: int, n_robots: int) -> tuple[Simulator, float]:
    """Each drives to the other side of a circle; and for how many seconds two drive side by side.

    Side by side: nearer than 0.3 m. All set out at once, and are in the middle at once.
    """
    draws = generator(seed, "crossing")
    turned = 2 * np.pi * (np.arange(n_robots) + draws.uniform(-0.3, 0.3, n_robots)) / n_robots
    out = np.stack([np.cos(turned), np.sin(turned)], axis=1)
    starts = {f"R{k}": Pose(*map(float, 6 * xy), float(turned[k] + np.pi))
              for k, xy in enumerate(out)}  # fmt: skip
    simulator = Simulator(worlds.world(), starts, seed=seed)
    together = Together(simulator)

    def cross(name: str) -> None:
        ours = Pilot(together.body(simulator, name), PERCEPTION, MissionConfig(limit_s=90.0))
        while ours.here.distance_to_m(np.array([12.0, 0.0])) > 0.5:
            ours.stretch(np.array([12.0, 0.0]), 0.4, 0.5)

    together.run({name: partial(cross, name) for name in starts})
    paths = [simulator.path_xy_m(name) for name in starts]
    moved = [np.hypot(*np.diff(path, axis=0).T) > 0.03 for path in paths]
    beside_s = 0.0
    for a, b in combinations(range(n_robots), 2):
        apart_m = np.hypot(*(paths[a] - paths[b]).T)[1:] - 2 * ROBOT_RADIUS_M
        beside_s += 0.3 * float((moved[a] & moved[b] & (apart_m < 0.3)).sum())
    return simulator, beside_s


def test_of_robots_that_meet_one_goes_first() -> None:
    """As it was met: two stood and went on at the same moments, nearer each time, and touched."""
    beside_s = []
    for seed, n_robots in enumerate((2, 2, 3, 3, 4, 4)):
        simulator, side_by_side_s = crossing(seed, n_robots)
        beside_s.append(side_by_side_s)
        assert sum(map(simulator.collisions, simulator.robots)) == 0
    assert sum(beside_s) < 2.0  # 5 s in all as long as both went on at once


class Swaying(Walker):
    """A robot that turns back after each step."""

    def drive(self, command: Drive, duration_s: float) -> None:
        ahead_m = 0.2 if round(self.time_ns / 1e9 / duration_s) % 2 else -0.2
        self.pose = Pose(self.pose.x_m + ahead_m, self.pose.y_m, self.pose.yaw_rad)
        self.time_ns += round(duration_s * 1e9)


def test_who_goes_back_and_forth_is_stuck_too_and_may_try_again() -> None:
    body = Swaying(Plain(()), Pose(0.0, 0.0, np.pi))
    ours = Pilot(body, PERCEPTION, MissionConfig())  # type: ignore[arg-type]
    assert ours.stretch(there(45.0), 1.0, 40.0) is None
    first_s = ours.now.time_ns / 1e9
    assert 40.0 <= first_s <= 45.0
    assert ours.stretch(there(45.0), 1.0, 40.0) is None
    assert ours.now.time_ns / 1e9 >= first_s + 40.0


def test_the_time_ends_in_the_middle_of_a_stretch() -> None:
    with pytest.raises(GaveUp, match="out of time after 10 s"):
        pilot(limit_s=10.0).stretch(there(45.0), 1.0, 40.0)


def sensing(ring: np.ndarray) -> Pilot:
    """A pilot that senses this range ring."""
    ours = object.__new__(Pilot)
    ours.now = Observation(0, Pose(0.0, 0.0), ring)
    return ours


def test_the_range_along_a_bearing_is_the_shortest_near_it() -> None:
    ring = np.full(72, 8.0)
    ring[18], ring[20], ring[0] = 3.0, 2.0, 1.0
    beam, ours = 2 * np.pi / 72, sensing(ring)
    assert ours.ahead_m(18 * beam) == 3.0
    assert ours.ahead_m(19 * beam) == 2.0
    assert ours.ahead_m(2 * np.pi - 0.05) == 1.0  # round the back of the ring
    assert ours.ahead_m(-0.05) == 1.0
    assert ours.ahead_m(0.5) == 8.0
    assert sensing(np.array([4.0])).ahead_m(2.0) == np.inf
    ring[18] = UNSEEN_M  # no sensor looks there
    assert ours.ahead_m(18 * beam) == 8.0 and ours.ahead_m(18 * beam, 0.01) == np.inf
    assert not ours.surface(18 * beam)[0].any()


@pytest.mark.parametrize("turn", [0, 20, 50])
@pytest.mark.parametrize(
    ("bearing_rad", "near_m", "width_m"),
    [
        (1.2, 1.5, 8.0),
        (0.4, 1.5, 8.0),
        (0.0, np.inf, 0.0),
        (-1.2, 2.0, 0.7),
        (-0.7, 4.88, 2.9),
        (-2.2, 4.0, 6.1),
    ],
)
def test_a_surface_is_followed_to_where_it_comes_nearest(
    bearing_rad: float, near_m: float, width_m: float, turn: int
) -> None:
    """A wall 1.5 m to the left, on the right a bush before a wall 4 m away."""
    beams = beams_rad(72)
    to_left = np.where(np.sin(beams) > 0, 1.5 / np.maximum(np.sin(beams), 1e-9), 8.0)
    to_right = np.where(np.sin(beams) < 0, 4.0 / np.maximum(-np.sin(beams), 1e-9), 8.0)
    ring = np.minimum(np.minimum(to_left, to_right), 8.0)
    ring[np.abs(beams - (2 * np.pi - 1.2)) < 0.2] = 2.0
    pilot = sensing(np.roll(ring, turn))
    of_it, *told_m = pilot.surface(bearing_rad + turn * 2 * np.pi / 72)
    assert told_m == [pytest.approx(near_m, abs=0.05), pytest.approx(width_m, abs=0.3)]
    assert of_it.any() == (width_m > 0.0)

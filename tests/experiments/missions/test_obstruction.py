from itertools import combinations

import numpy as np
import pytest
import worlds
from plains import PERCEPTION

from vrchain.experiments.missions.obstruction import ROW_M, Barred
from vrchain.geometry import Pose
from vrchain.navigation.driving.drive import Pilot
from vrchain.navigation.settings import Decision, MissionConfig
from vrchain.simulation.simulator import Simulator
from vrchain.world.model import ROBOT_RADIUS_M


def leg(range_m: float = 10.0, bearing_deg: float = 0.0, what: str = "leg") -> Decision:
    values = {"range_m": range_m, "bearing_deg": bearing_deg}
    return Decision(0.0, what, "landmark 1", None, values)


def alone() -> Simulator:
    return Simulator(worlds.yard(), {"R1": Pose(-6.0, 0.0)}, seed=3, rig=worlds.SMALL_RIG)


def parked(simulator: Simulator) -> np.ndarray:
    return np.array([p.xy_m for p in simulator.others("R1").values()]).reshape(-1, 2)


def test_a_row_stands_across_the_middle_of_the_leg_and_lets_nothing_through() -> None:
    simulator = alone()
    bars = Barred(simulator, "R1", 1.0, seed=1)
    free_m = simulator.true_ranges_m("R1")[0]
    bars.tell(leg())
    row = parked(simulator)
    assert bars.rows == 1 and len(row) >= 3
    assert row[:, 0] == pytest.approx(-1.0)  # five metres ahead
    assert np.ptp(row[:, 1]) <= ROW_M
    assert simulator.true_ranges_m("R1")[0] < min(free_m, 5.0)
    nearest = [np.hypot(*(row - p).T) for p in row]
    assert all(np.sort(d)[1] < 4 * ROBOT_RADIUS_M for d in nearest)  # a third does not fit between
    for a, b in combinations(row, 2):
        assert np.hypot(*(a - b)) > 2 * ROBOT_RADIUS_M


def test_what_is_barred_is_driven_round_and_not_through() -> None:
    simulator = alone()
    Barred(simulator, "R1", 1.0, seed=1).tell(leg())
    row = parked(simulator)
    pilot = Pilot(worlds.Body(simulator), PERCEPTION, MissionConfig(limit_s=120.0))
    pilot.stretch(np.array([10.0, 0.0]), 0.5, 40.0)  # by odometry: where the leg ends
    assert simulator.pose("R1").distance_to_m((4.0, 0.0)) < 1.5
    assert simulator.collisions("R1") == 0
    assert np.abs(simulator.path_xy_m("R1")[:, 1]).max() > np.abs(row[:, 1]).max()


def test_each_leg_is_decided_on_once_and_others_are_let_alone() -> None:
    simulator = alone()
    bars = Barred(simulator, "R1", 1.0, seed=1)
    for other in (leg(3.0), leg(what="approach"), Decision(0.0, "reached", "landmark 1 is near")):
        bars.tell(other)
    assert bars.rows == 0 and len(parked(simulator)) == 0
    bars.tell(leg())
    stood = parked(simulator)
    bars.tell(leg(9.0, 10.0))  # the same end, more or less
    assert bars.rows == 1 and np.array_equal(parked(simulator), stood)


def test_what_cannot_stand_is_no_row() -> None:
    simulator = alone()
    bars = Barred(simulator, "R1", 1.0, seed=1)
    bars.tell(leg(200.0))  # off the map
    assert bars.rows == 0 and len(parked(simulator)) == 0
    bars.tell(leg())
    assert bars.rows == 1 and len(parked(simulator)) >= 3


def test_so_many_legs_are_barred_and_the_same_ones_again() -> None:
    def barred(share: float) -> list[float]:
        """Where rows stand, of 40 possible ones."""
        road = worlds.world(extent_m=(900.0, 20.0))
        simulator = Simulator(road, {"R1": Pose(0.0, 0.0)}, seed=3)
        bars = Barred(simulator, "R1", share, seed=5)
        for k in range(40):  # legs that end far apart
            bars.tell(leg(10.0 + 20 * k))
        x_m, size = np.unique(parked(simulator)[:, 0].round(3), return_counts=True)
        assert len(x_m) == bars.rows and (size >= 3).all()
        return list(x_m)

    everywhere = barred(1.0)
    assert barred(0.0) == [] and everywhere == [5.0 + 10 * k for k in range(40)]
    half = barred(0.5)
    assert 10 < len(half) < 30 and set(half) < set(everywhere) and barred(0.5) == half

from itertools import combinations

import numpy as np
import pytest
import worlds

from vrchain.experiments.barred import ROW_M, Barred
from vrchain.geometry import Pose
from vrchain.navigation.terms import Decision
from vrchain.robot import steer
from vrchain.scene.model import ROBOT_RADIUS_M
from vrchain.simulator import Simulator


def leg(range_m: float = 10.0, bearing_deg: float = 0.0, why: str = "landmark 1") -> Decision:
    values = {"range_m": range_m, "bearing_deg": bearing_deg}
    return Decision(0.0, "approach", why, None, values)


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
    for _ in range(60):
        simulator.step({"R1": steer(0.0, simulator.observe("R1").range_ring_m)}, 0.3)
    assert simulator.collisions("R1") == 0


def test_each_leg_is_decided_on_once_and_others_are_let_alone() -> None:
    simulator = alone()
    bars = Barred(simulator, "R1", 1.0, seed=1)
    for other in (leg(3.0), leg(why="the goal"), Decision(0.0, "reached", "landmark 1 is near")):
        bars.tell(other)
    assert bars.rows == 0 and len(parked(simulator)) == 0
    bars.tell(leg())
    stood = parked(simulator)
    bars.tell(leg(9.0, 10.0))  # the same end, more or less
    assert bars.rows == 1 and np.array_equal(parked(simulator), stood)


def test_so_many_legs_are_barred_and_the_same_ones_again() -> None:
    def rows(share: float) -> list[int]:
        simulator = alone()
        bars = Barred(simulator, "R1", share, seed=5)
        found = []
        for k in range(40):  # legs that end far apart
            bars.tell(leg(10.0 + 20 * k))
            found.append(bars.rows)
        return found

    assert rows(0.0)[-1] == 0 and rows(1.0)[-1] == 40
    assert 10 < rows(0.5)[-1] < 30 and rows(0.5) == rows(0.5)

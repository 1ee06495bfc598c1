"""Several minds at one clock."""

from collections.abc import Callable

import numpy as np
import pytest
import worlds

from vrchain.geometry import Pose
from vrchain.robot import Drive
from vrchain.simulation.simulator import Simulator
from vrchain.simulation.team import SimulatedBody
from vrchain.simulation.together import Together

POSES = {"R1": Pose(0.0, 0.0, 0.0), "R2": Pose(0.0, 3.0, 1.0), "R3": Pose(-3.0, -2.0, 2.0)}


def world() -> Simulator:
    return Simulator(worlds.yard(), POSES, seed=3, rig=worlds.SMALL_RIG)


def mind(body: SimulatedBody, ticks_s: list[float], turn: float = 0.3) -> Callable[[], list[int]]:
    """Drives so long each time, and notes when."""

    def drive() -> list[int]:
        times = []
        for tick_s in ticks_s:
            times.append(body.observe().time_ns)
            body.drive(Drive(0.5, turn), tick_s)
        return times

    return drive


def test_each_drives_as_long_as_it_wants_and_time_passes_for_all() -> None:
    simulator = world()
    together = Together(simulator)
    ticks = {"R1": [0.3] * 10, "R2": [0.5] * 3}
    found = together.run({n: mind(together.body(simulator, n), t) for n, t in ticks.items()})
    assert found["R1"] == [round(k * 0.3e9) for k in range(10)]
    assert found["R2"] == [0, 500_000_000, 1_000_000_000]
    assert simulator.clock_ns == 3_000_000_000
    assert (simulator.path_xy_m("R3") == POSES["R3"].xy_m).all()  # nobody's mind
    ways_m = [np.hypot(*np.diff(simulator.path_xy_m(n), axis=0).T).sum() for n in ("R1", "R2")]
    assert ways_m == pytest.approx([1.5, 0.75], abs=0.01)


def test_one_mind_drives_as_a_body_of_its_own() -> None:
    alone, shared = world(), world()
    mind(SimulatedBody(alone, "R1"), [0.3, 0.7, 0.3])()
    together = Together(shared)
    together.run({"R1": mind(together.body(shared, "R1"), [0.3, 0.7, 0.3])})
    assert shared.pose("R1") == alone.pose("R1") and shared.clock_ns == alone.clock_ns
    body = together.body(shared, "R2")  # afterwards it is a body like any
    body.drive(Drive(0.5), 1.0)
    assert shared.clock_ns == alone.clock_ns + 1_000_000_000


def test_the_same_minds_drive_the_same_ways() -> None:
    paths = []
    for _ in range(2):
        simulator = world()
        together = Together(simulator)
        together.run({
            n: mind(together.body(simulator, n), [0.3] * 6, turn)
            for n, turn in (("R3", 0.4), ("R1", -0.2), ("R2", 0.1))
        })  # fmt: skip
        paths.append([simulator.path_xy_m(n).tobytes() for n in POSES])
    assert paths[0] == paths[1]


@pytest.mark.parametrize("error", [ValueError("it broke"), KeyboardInterrupt()])
def test_an_error_of_one_ends_all(error: BaseException) -> None:
    simulator, ended = world(), []
    together = Together(simulator)

    def breaks() -> None:
        together.drive("R1", Drive(0.5), 1.0)
        raise error

    def goes_on() -> None:
        try:
            while True:
                together.drive("R2", Drive(0.5), 0.3)
        finally:
            ended.append(simulator.clock_ns)

    with pytest.raises(type(error)):
        together.run({"R1": breaks, "R2": goes_on, "R3": lambda: None})
    assert ended == [simulator.clock_ns] and simulator.clock_ns >= 1_000_000_000
    assert together.run({}) == {}

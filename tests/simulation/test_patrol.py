"""Robots on patrol: no landmarks are extracted, so that they are quick."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
from hamlet import hamlet
from sights import RIG

from vrchain.geometry import Pose
from vrchain.ledger import Ledger, simulated_key, verify
from vrchain.reader import index_of, published_of
from vrchain.robot import STOP
from vrchain.simulation.patrol import LOOK_EVERY_M, Patrol
from vrchain.simulation.simulator import Simulator
from vrchain.simulation.team import assemble, team_ledger

PLACES = {"R1": Pose(0.0, 6.0, 2.0), "R2": Pose(-10.0, -6.0), "R3": Pose(10.0, 6.0, -1.0)}


def patrolled(folder: Path, seconds: float = 90.0) -> tuple[Simulator, Ledger]:
    simulator = Simulator(hamlet(), PLACES, seed=1, rig=RIG)
    ledger = team_ledger(folder, PLACES, 1)
    robots = assemble(simulator, ledger, 1)
    patrol = Patrol(simulator, {name: robots[name] for name in ("R2", "R3")}, 1)
    patrol.drive(seconds)
    robots["R1"].body.others = patrol.drives
    robots["R1"].drive(STOP, 0.3)  # they move on as it does, for its time is theirs
    return simulator, ledger


def test_they_drive_and_publish_as_the_rules_have_it_and_hit_nothing(tmp_path: Path) -> None:
    simulator, ledger = patrolled(tmp_path / "ledger")
    with ledger:
        assert ledger.latest("R1") is None and simulator.pose("R1") == PLACES["R1"]
        for name in ("R2", "R3"):
            path_m = simulator.path_xy_m(name)
            way_m = np.hypot(*np.diff(path_m, axis=0).T).sum()
            assert way_m > 25.0 and np.any(path_m[-1] != path_m[-2])
            assert 2 <= len(ledger.history(name)) <= way_m / LOOK_EVERY_M + 90.0 / 60.0 + 1
            assert simulator.collisions(name) == 0
    assert verify(tmp_path / "ledger").ok


def test_the_same_seed_patrols_the_same_way(tmp_path: Path) -> None:
    heads = []
    for k in range(2):
        _, ledger = patrolled(tmp_path / str(k), 30.0)
        with ledger:
            heads.append(ledger.head.hash)
    assert heads[0] == heads[1]


def test_what_others_remember_of_it_is_named_from_the_newest_back(tmp_path: Path) -> None:
    _, ledger = patrolled(tmp_path)
    with ledger:
        history = ledger.history("R2")
        known = published_of(ledger, "R1", 99)()
        assert [known[n].digest for n in ("R2", "R2~1")] == [
            t.payload_digest + t.landmarks_digest for t in history[:-3:-1]
        ]
        assert known["R2"].time_ns == history[-1].timestamp_ns
        assert set(published_of(ledger, "R1")()) == {"R2", "R3"}
        assert set(published_of(ledger, "R2", 99)()) == {n for n in known if n.startswith("R3")}


def test_what_it_published_itself_before_is_a_memory(tmp_path: Path) -> None:
    _, ledger = patrolled(tmp_path)
    with ledger:
        before = ledger.history("R2")
        known = published_of(ledger, "R2", 99, memory=True)
        time_ns = before[-1].timestamp_ns + 1
        ledger.publish("R2", simulated_key(1, "R2"), b"later", "start", time_ns)
        own = {name: p for name, p in known().items() if name.startswith("R2")}
    assert list(own) == ["R2 before", *(f"R2 before~{k}" for k in range(1, len(before)))]
    assert [p.time_ns for p in own.values()] == [t.timestamp_ns for t in reversed(before)]


def test_who_leaves_is_driven_no_more_and_the_others_are(tmp_path: Path) -> None:
    simulator = Simulator(hamlet(), PLACES, seed=1, rig=RIG)
    with team_ledger(tmp_path, PLACES, 1) as ledger:
        patrol = Patrol(simulator, assemble(simulator, ledger, 1), 1)
        patrol.leave("R2")
        assert list(patrol.drives()) == ["R1", "R3"]
        patrol.leave("R1")  # between two decisions
        assert list(patrol.drives()) == ["R3"]


def test_nobody_tells_what_is_in_the_panorama_of_another(tmp_path: Path) -> None:
    """R2 publishes what R3 did, with landmarks of its own: R3's panorama keeps R3's."""
    perception = cast(Any, SimpleNamespace(stored=lambda *what: what, compare=None))
    with team_ledger(tmp_path / "ledger", PLACES, 1) as ledger:
        for name, record in (("R3", b"honest"), ("R2", b"lie"), ("R1", None)):
            key = simulated_key(1, name)
            ledger.publish(name, key, b"panorama", "start", 1, landmarks=record)
        known, index = published_of(ledger, "R4")(), index_of(ledger, perception)
        shown = {name: index.look(p.digest) for name, p in known.items()}
    assert shown == {"R1": (b"panorama", None), "R2": (b"panorama", b"lie"),
                     "R3": (b"panorama", b"honest")}  # fmt: skip

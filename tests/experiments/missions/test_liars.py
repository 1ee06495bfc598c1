"""What liars publish, and that they sense and drive as others do."""

import json
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import sights
import worlds
from blind import Nowhere, blind
from hamlet import the_hamlet

from vrchain.errors import MissionError
from vrchain.experiments.missions import draw as drawing
from vrchain.experiments.missions import drive as driving
from vrchain.experiments.missions.drive import Conditions
from vrchain.experiments.missions.liars import LIES, lie
from vrchain.experiments.missions.success import evaluate
from vrchain.experiments.scenes import Scenes
from vrchain.geometry import Pose, placed, relative
from vrchain.landmarks.extraction.proposer import nothing
from vrchain.landmarks.extraction.record import LandmarkRecord, decode_record
from vrchain.landmarks.extraction.sift import NO_FEATURES
from vrchain.ledger import verify
from vrchain.navigation.settings import MissionConfig
from vrchain.panorama import Panorama
from vrchain.robot import Drive, UpdateRules
from vrchain.simulation.simulator import Simulator
from vrchain.simulation.team import assemble, team_ledger
from vrchain.world.model import SceneObject

RIG = worlds.SMALL_RIG
RULES = UpdateRules(distance_m=1.5, view_change=99.0, max_age_s=999.0)


@dataclass(frozen=True)
class Told:
    """Of one robot's drive: what it published, what it saw itself, and how it moved."""

    digests: list[str]
    shown: list[Panorama]
    moved: list[Pose | None]
    saw: list[Panorama]
    way_m: list[float]


def drive(kind: str | None, folder: Path, seed: int = 5) -> Told:
    simulator = Simulator(worlds.yard(), {"R1": Pose(0, 0)}, seed=3, rig=RIG)
    record = LandmarkRecord(RIG, "ab" * 32, nothing(), NO_FEATURES)
    told = {} if kind is None else {"R1": lie(kind, simulator, "R1", seed)}
    with team_ledger(folder / f"{kind}", simulator.robots, 3) as ledger:
        robot = assemble(simulator, ledger, 3, RULES, lambda seen: record, told=told)["R1"]
        saw, stood = [], []
        for _ in range(6):
            before = len(robot.publications)
            seen = robot.observe(look=True)
            if len(robot.publications) > before or not stood:
                assert seen.panorama is not None
                saw.append(seen.panorama)
                stood.append(seen.odometry)
            robot.drive(Drive(0.8, 0.1), 2.0)
        history = ledger.history("R1")
        shown = [Panorama.decode(ledger.payload(t.payload_digest)) for t in history]
        moved = [decode_record(ledger.payload(t.landmarks_digest)).moved for t in history]
        way_m = [a.distance_to_m(b.xy_m) for a, b in pairwise(stood)]
        digests = [t.payload_digest.hex() for t in history]
    assert verify(folder / f"{kind}").ok  # a lie is as well signed as the truth
    return Told(digests, shown, moved, saw, way_m)


def test_who_lies_of_its_way_is_as_far_as_it_says(tmp_path: Path) -> None:
    told, honest = drive("odometry", tmp_path), drive(None, tmp_path)
    assert told.digests == honest.digests and len(told.digests) >= 3
    ways = [np.hypot(*m.xy_m) for m in told.moved if m]
    assert ways == pytest.approx(told.way_m, abs=1e-2)
    apart = [
        m.distance_to_m(n.xy_m) for m, n in zip(told.moved, honest.moved, strict=True) if m and n
    ]
    assert max(apart) > 1.0


def test_who_says_that_it_stood_still_shows_what_it_saw(tmp_path: Path) -> None:
    told, honest = drive("still", tmp_path), drive(None, tmp_path)
    assert told.digests == honest.digests and len(told.digests) >= 3
    assert not any(np.hypot(*m.xy_m) for m in told.moved if m)


def test_what_is_shown_is_not_what_was_seen(tmp_path: Path) -> None:
    honest = drive(None, tmp_path)
    for kind in ("elsewhere", "old", "photograph"):
        told = drive(kind, tmp_path)
        assert [m and m.xy_m.round(3).tolist() for m in told.moved] == [
            m and m.xy_m.round(3).tolist() for m in honest.moved
        ]
        for shown, saw in list(zip(told.shown, told.saw, strict=True))[1:]:
            assert np.abs(shown.views.astype(int) - saw.views).mean() > 5
    old, photograph = drive("old", tmp_path / "a"), drive("photograph", tmp_path / "a")
    assert set(old.digests) == {honest.digests[0]}
    assert all((p.views == p.views[:1]).all() for p in photograph.shown)
    assert len(set(drive("elsewhere", tmp_path / "a").digests)) == len(honest.digests)


def test_who_shows_a_twin_shows_it_from_the_same_side(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of two cars of one make; a third thing, of another, stands nearer."""
    car, other = Pose(6.0, 1.0, 0.4), Pose(-7.0, -2.0, 2.5)

    def thing(name: str, at: Pose, size_m: float) -> SceneObject:
        """Its front is not its back."""
        front, red = placed(at, Pose(1.0, 0.3)), worlds.plain(worlds.RED)
        low, high = (
            worlds.box(name, tuple(p.xy_m), (s, s / 2, 3 - s / 2), red, yaw_rad=at.yaw_rad)
            for p, s in ((at, size_m), (front, size_m / 5))
        )
        return replace(low, model=name[:3], surfaces=(*low.surfaces, *high.surfaces))

    scene = worlds.world(
        thing("car 1", car, 4.0), thing("car 2", other, 4.0), thing("kiosk", Pose(0.0, 1.5), 0.5)
    )
    simulator = Simulator(scene, {"R1": Pose(2.0, 0.0, 0.7)}, seed=3, rig=RIG)
    tell, seen = lie("twins", simulator, "R1", 5), simulator.observe("R1", look=True)
    stood, render = list[Pose](), simulator.renderer.render
    monkeypatch.setattr(
        simulator.renderer, "render", lambda pose, rig: stood.append(pose) or render(pose, rig)
    )
    told = tell(seen)
    assert told is not None and told.panorama is not seen.panorama
    assert replace(told, panorama=seen.panorama) == seen
    before, now = relative(car, simulator.pose("R1")), relative(other, *stood)
    assert (*before.xy_m, before.yaw_rad) == pytest.approx((*now.xy_m, now.yaw_rad), abs=1e-5)
    alone = Simulator(worlds.yard(), {"R1": Pose(0, 0)}, seed=3, rig=RIG)
    seen = alone.observe("R1", look=True)
    assert lie("twins", alone, "R1", 5)(seen) is seen  # nothing there has a twin


def test_who_says_nothing_publishes_nothing(tmp_path: Path) -> None:
    told = drive("nothing", tmp_path)
    assert told.digests == [] and len(told.saw) == 1


def test_the_same_seed_tells_the_same_lies(tmp_path: Path) -> None:
    for kind in ("odometry", "elsewhere"):
        once, again, other = (
            drive(kind, tmp_path / name, seed) for name, seed in (("a", 5), ("b", 5), ("c", 6))
        )
        assert (once.digests, once.moved) == (again.digests, again.moved)
        assert (once.digests, once.moved) != (other.digests, other.moved)


def test_lies_that_there_are_not() -> None:
    simulator = Simulator(worlds.yard(), {"R1": Pose(0, 0)}, seed=3, rig=RIG)
    with pytest.raises(MissionError, match="expected a lie of odometry"):
        lie("white", simulator, "R1", 0)
    for bad in ({"liars": -1}, {"lie": "white"}):
        with pytest.raises(MissionError, match="0 liars or more"):
            Conditions(**bad)
    assert set(LIES) == {"odometry", "still", "elsewhere", "old", "photograph", "twins", "nothing"}


def test_who_drives_does_not_lie(tmp_path: Path) -> None:
    with pytest.raises(MissionError, match="fewer liars than the 4 robots"):
        evaluate(
            Scenes(the_hamlet, "hamlet", varied=False), 1, 4, ["ledger"], seed=3, folder=tmp_path,
            conditions=Conditions(liars=4),
        )  # fmt: skip


def test_the_oracle_is_not_asked_where_it_sees_through_the_lie(tmp_path: Path) -> None:
    with pytest.raises(MissionError, match="expected no arm oracle"):
        evaluate(
            Scenes(the_hamlet, "hamlet", varied=False), 1, 4, seed=3, folder=tmp_path,
            conditions=Conditions(liars=1, lie="elsewhere"),
        )  # fmt: skip


@pytest.mark.parametrize("kind", ["nothing", "elsewhere"])
def test_a_ledger_of_only_liars_is_given_up_in_time(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(driving, "learned_perception", blind)
    monkeypatch.setattr(drawing, "WAY_M", (12.0, 60.0))
    nowhere = Nowhere()
    monkeypatch.setattr(driving.Suburb, "_goal", lambda *mission: nowhere)
    conditions = Conditions(6.0, liars=3, lie=kind, config=MissionConfig(limit_s=12.0))
    table, _ = evaluate(
        Scenes(the_hamlet, "hamlet", varied=False), 1, 4, ["ledger"], seed=3, folder=tmp_path,
        rig=sights.RIG, conditions=conditions,
    )  # fmt: skip
    assert not table.arrived[0] and table.reason[0] == "out of time after 12 s"
    (stored,) = tmp_path.rglob("*_ledger.json")
    whys = {d["why"] for d in json.loads(stored.read_text())["log"] if d["what"] == "no route"}
    said = {"nothing": "the ledger holds no panorama of another robot"}
    assert whys == {said.get(kind, "no other robot's panorama shows the goal")}
    assert (table.published[0] == 0) == (kind == "nothing")

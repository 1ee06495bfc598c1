"""What publishes for a robot, whoever the robot is."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from sights import RIG, look

from vrchain.geometry import Pose
from vrchain.landmarks.extraction.proposer import nothing
from vrchain.landmarks.extraction.record import LandmarkRecord, decode_record
from vrchain.landmarks.extraction.sift import NO_FEATURES
from vrchain.ledger import Ledger, simulated_key
from vrchain.panorama import Codec, Panorama
from vrchain.publisher import Publisher
from vrchain.robot import Observation, UpdateRules
from vrchain.simulation.team import team_ledger

RULES = UpdateRules(distance_m=3.0, view_change=9.0, max_age_s=60.0)


def examine(seen: Observation) -> LandmarkRecord:
    return LandmarkRecord(RIG, "ab" * 32, nothing(), NO_FEATURES)


def publisher(ledger: Ledger) -> Publisher:
    return Publisher("R1", ledger, simulated_key(1, "R1"), RULES, examine)


def at(x_m: float, time_s: float = 0.0, looks: bool = True) -> Observation:
    panorama = look(Pose(0, 0)) if looks else None
    return Observation(int(time_s * 1e9), Pose(x_m, 0), np.zeros(0), panorama=panorama)


def moved(ledger: Ledger) -> list[float | None]:
    records = (decode_record(ledger.payload(t.landmarks_digest)) for t in ledger.history("R1"))
    return [record.moved and record.moved.x_m for record in records]


def test_it_publishes_by_the_rules_and_tells_the_way(tmp_path: Path) -> None:
    with team_ledger(tmp_path / "ledger", ["R1"], 1) as ledger:
        robot = publisher(ledger)
        rules = []
        for k, x_m in enumerate([0.0, 2.0, 4.0, 5.0]):
            robot.passed(at(x_m - 0.5, k - 0.5, looks=False))
            _, published = robot.looked(at(x_m, k))
            rules.append(published and published.rule)
        _, published = robot.looked(at(5.0, 80))
        assert [*rules, published and published.rule] == ["start", None, "distance", None, "time"]
        assert moved(ledger) == [None, 4.0, 1.0]


def test_it_says_nothing_of_a_way_that_it_does_not_know(tmp_path: Path) -> None:
    with team_ledger(tmp_path / "ledger", ["R1"], 1) as ledger:
        robot = publisher(ledger)
        robot.looked(at(0.0))
        robot.lost_track()
        robot.looked(at(4.0, 1))
        robot.looked(at(8.0, 2))
        assert moved(ledger) == [None, None, 4.0]


def test_what_is_lost_while_it_publishes_is_lost(tmp_path: Path) -> None:
    """Odometry is heard of in another thread, and publishing takes a second."""
    with team_ledger(tmp_path / "ledger", ["R1"], 1) as ledger:

        def slowly(seen: Observation) -> LandmarkRecord:
            if seen.odometry.x_m == 4.0:
                robot.lost_track()
            return examine(seen)

        robot = publisher(ledger)
        robot._examine = slowly
        for k, x_m in enumerate([0.0, 4.0, 8.0, 12.0]):
            robot.looked(at(x_m, k))
        assert moved(ledger) == [None, 4.0, None, 4.0]


def test_another_goes_on_from_what_was_published(tmp_path: Path) -> None:
    with team_ledger(tmp_path / "ledger", ["R1"], 1) as ledger:
        seen, _ = publisher(ledger).looked(at(0.0))
        heir = publisher(ledger)
        assert heir.wants_look(at(0.0))
        heir.resume(seen.odometry)
        assert not heir.wants_look(at(2.0, 1)) and heir.wants_look(at(2.6, 1))
        assert heir.looked(at(2.0, 1))[1] is None
        assert heir.looked(at(4.0, 2))[1] is not None
        assert moved(ledger) == [None, 4.0]


def test_who_goes_on_may_have_appended_anything_else(tmp_path: Path) -> None:
    with team_ledger(tmp_path / "ledger", ["R1"], 1) as ledger:
        ledger.publish("R1", simulated_key(1, "R1"), b"a note", "start", 0)
        heir = publisher(ledger)
        heir.resume(Pose(0, 0))
        _, published = heir.looked(at(4.0, 2))
        assert published is not None
        newest = ledger.history("R1")[-1]
        told = decode_record(ledger.payload(newest.landmarks_digest)).moved
        assert told is not None and told.x_m == 4.0


def test_a_panorama_that_is_encoded_already_is_published_as_it_is(tmp_path: Path) -> None:
    with team_ledger(tmp_path / "ledger", ["R1"], 1) as ledger:
        seen = at(0.0)
        assert seen.panorama is not None
        blob = seen.panorama.encode(Codec("jpeg", 95))
        shown, published = publisher(ledger).looked(seen, blob)
        assert published is not None and published.payload_bytes == len(blob)
        assert ledger.payload(bytes.fromhex(published.digest)) == blob
        assert shown.panorama is not None  # as others will see it
        assert np.array_equal(shown.panorama.views, Panorama.decode(blob).views)


def test_what_the_ledger_refuses_is_not_published(tmp_path: Path) -> None:
    with team_ledger(tmp_path / "ledger", ["R1"], 1) as ledger:
        robot = publisher(ledger)
        robot.looked(at(0.0, 5))
        with pytest.raises(Exception, match="no earlier than"):
            robot.looked(replace(at(9.0), time_ns=0))
        assert len(ledger.history("R1")) == 1

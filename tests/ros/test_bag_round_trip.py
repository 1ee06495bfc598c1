"""A simulated patrol through a bag and back: what is published is the same."""

from functools import cache, partial
from pathlib import Path
from tempfile import mkdtemp

import pytest
from hamlet import hamlet
from sights import RIG

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from vrchain.landmarks.extraction.proposer import nothing
from vrchain.landmarks.extraction.record import LandmarkRecord, decode_record
from vrchain.landmarks.extraction.sift import extract
from vrchain.ledger import Ledger, simulated_key, verify
from vrchain.panorama import Panorama
from vrchain.robot import Observation
from vrchain.ros.export import Exported, export_patrol
from vrchain.ros.publishing import publish_bags
from vrchain.ros.storage import messages
from vrchain.simulation.team import team_ledger

NAMES = ("R1", "R2")
ROBOTS = {name: f"/{name}" for name in NAMES}
KEYS = {name: simulated_key(7, name) for name in NAMES}


def examine(seen: Observation) -> LandmarkRecord:
    """Keypoints alone: quick, and each byte of the panorama counts."""
    assert seen.panorama is not None
    return LandmarkRecord(seen.panorama.rig, "ab" * 32, nothing(), extract(seen.panorama))


@cache
def patrol(form: str, images: str) -> tuple[Path, Exported]:
    folder = Path(mkdtemp())
    made = export_patrol(
        hamlet(), folder, lambda names: team_ledger(folder / "ledger", names, 7),
        seconds=25.0, seed=7, rig=RIG, form=form, images=images, examine=examine,
    )  # fmt: skip
    return folder, made


def told(ledger: Ledger) -> dict[str, list[tuple]]:
    """Everything that robots published, but for who else published in between."""
    return {
        robot: [
            (t.timestamp_ns, t.reason, t.payload_digest, t.landmarks_digest)
            for t in ledger.history(robot)
        ]
        for robot in ledger.robots
    }


def publish(bags: list[Path], folder: Path, **more: object) -> dict[str, list[tuple]]:
    with team_ledger(folder, NAMES, 7) as ledger:
        publish_bags(bags, ledger, KEYS, ROBOTS, examine=examine, **more)
        return told(ledger)


@pytest.mark.parametrize(("form", "images"), [("mcap", "png"), ("sqlite3", "raw"), ("ros1", "raw")])
def test_without_loss_every_byte_is_the_same(form: str, images: str, tmp_path: Path) -> None:
    folder, made = patrol(form, images)
    back = publish([made.bag], tmp_path / "back")
    with Ledger.open(folder / "ledger") as ledger:
        assert back == told(ledger)
    assert min(len(rows) for rows in back.values()) > 2
    assert verify(tmp_path / "back").ok


def test_jpeg_bytes_are_passed_through(tmp_path: Path) -> None:
    folder, made = patrol("mcap", "jpeg")
    back = publish([made.bag], tmp_path / "back")
    with Ledger.open(folder / "ledger") as live, Ledger.open(tmp_path / "back") as ledger:
        first = {k: [row[:1] for row in rows] for k, rows in told(live).items()}
        assert {k: [row[:1] for row in rows] for k, rows in back.items()} == first
        newest = ledger.latest("R1")
        assert newest is not None
        blob = ledger.payload(newest.payload_digest)
        panorama = Panorama.decode(blob)
        record = decode_record(ledger.payload(newest.landmarks_digest))
    jpegs = [m.data for m in messages([made.bag]) if m.topic == "/R1/camera_7/image_raw/compressed"]
    assert blob[-900:] in {jpeg.rstrip(b"\0")[-900:] for jpeg in jpegs}
    assert panorama.rig == RIG and record.moved is not None


def test_a_break_and_the_same_call_again(tmp_path: Path) -> None:
    _, made = patrol("mcap", "png")
    whole = publish([made.bag], tmp_path / "whole")
    seen = 0

    def breaks(observation: Observation) -> LandmarkRecord:
        nonlocal seen
        seen += 1
        if seen == 5:
            raise KeyboardInterrupt
        return examine(observation)

    again = partial(publish_bags, [made.bag], keys=KEYS, robots=ROBOTS)
    with team_ledger(tmp_path / "broken", NAMES, 7) as ledger:
        with pytest.raises(KeyboardInterrupt):
            again(ledger, examine=breaks)
        assert sum(map(len, told(ledger).values())) == 4
        again(ledger, examine=examine)
        assert told(ledger) == whole
        height = ledger.head.height
        played = again(ledger, examine=examine)
        assert ledger.head.height == height and not any(p.publications for p in played)


def test_what_was_exported_is_a_trajectory_too() -> None:
    folder, _ = patrol("mcap", "jpeg")
    rows = [line.split() for line in (folder / "R1_odometry.tum").read_text().splitlines()]
    assert {len(row) for row in rows} == {8} and float(rows[-1][0]) > 20
    assert len((folder / "R1_truth.tum").read_text().splitlines()) == len(rows)

"""What a mission sends over the wire, counted in bytes."""

from pathlib import Path

import pytest

from vrchain.experiments.ledger.stores import create_ledger
from vrchain.experiments.missions.wire import Wire


def test_what_a_robot_published_itself_is_not_sent_to_it(tmp_path: Path) -> None:
    ledger, keys = create_ledger(tmp_path / "ledger", ("R1", "R2"), 0)
    with ledger:
        sent = [
            ledger.publish(robot, keys[robot], payload, "start", 0, landmarks=b"told" + payload)
            for robot, payload in (("R1", bytes(5000)), ("R2", bytes(3000)))
        ]
        wire = Wire(ledger)
        for transaction in (*sent, *sent):
            wire.read(transaction.payload_digest)
        told = wire.sent("R1", n_receivers=2)
    records_mb = 2 * (5004 + 3004) / 1e6
    assert told["published"] == 1
    assert told["ledger_mb"] == pytest.approx(records_mb + 3000 / 1e6)
    assert told["broadcast_mb"] == pytest.approx(records_mb + 2 * 8000 / 1e6)

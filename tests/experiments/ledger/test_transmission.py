"""Bytes on the wire: what is counted is what servers count, and what the formula leaves out."""

import pytest
from clusters import skip_without_servers

from vrchain.experiments.ledger.transmission import WAYS, over_servers, transmission

PAYLOAD = 20_000


def test_ways_are_counted_from_real_messages() -> None:
    table = transmission((2, 4, 8), PAYLOAD, fetches=2)
    assert list(table.way[:3]) == list(WAYS) and len(table) == 9
    by = table.set_index(["way", "robots"])
    for count in (2, 4, 8):
        everyone, blobs = by.loc[("everyone", count)], by.loc[("blobs", count)]
        assert everyone.messages == count * (count - 1)
        assert everyone.bytes == pytest.approx(everyone.messages * PAYLOAD, rel=0.05)
        assert blobs.bytes == pytest.approx(count * (count + 7) * PAYLOAD, rel=0.05)
        assert blobs.bytes > everyone.bytes, "a ledger that all have delivers everything to all"
        assert blobs.sent_bytes == pytest.approx(everyone.sent_bytes / (count - 1))
    grown = [by.loc[(way, 8)].bytes / by.loc[(way, 4)].bytes for way in WAYS]
    assert grown[2] < grown[1] < grown[0]
    assert transmission((2,), PAYLOAD).equals(transmission((2,), PAYLOAD))


def test_servers_count_about_as_much() -> None:
    skip_without_servers()
    (measured,) = over_servers((3,), 200_000).to_dict("records")
    counted = transmission((3,), 200_000).set_index("way").loc["blobs"]
    assert measured["measured"] and measured["sent_bytes"] == pytest.approx(counted.sent_bytes)
    assert counted.bytes * 0.8 < measured["bytes"] < counted.bytes * 2

"""A team over servers, measured and broken: nothing acknowledged is lost, whatever is killed."""

import pandas as pd
import pytest
from clusters import skip_without_servers

from vrchain.experiments.ledger.cluster import at_rest, backlog, update_over_servers
from vrchain.experiments.ledger.failures import flipped_bit, kills
from vrchain.experiments.ledger.flood import flooded


@pytest.fixture(autouse=True)
def servers_are_installed() -> None:
    skip_without_servers()


def test_an_update_at_rest_is_measured_in_turns() -> None:
    table = at_rest(3, robots=2).set_index("name")
    assert (table.n == 3).all() and (table.median_ms > 0).all()
    medians = table.median_ms
    assert table.ratio["offer"] == pytest.approx(medians["offer"] / medians["bare"])
    assert medians["validated"] > medians["publish"]
    assert table.ratio["read"] == pytest.approx(medians["read"] / medians["read_folder"])


def test_an_update_over_servers_is_publishing_and_more() -> None:
    table = update_over_servers([b"%d" % k + bytes(20_000) for k in range(6)])
    assert list(table.ledger_position) == [1, 2, 3, 4, 5, 6]
    assert list(table.robot) == ["R1", "R2"] * 3 and (table.payload_bytes == 20_001).all()
    assert (table.publish_us > 0).all() and (table.publish_us < table.total_us).all()


def test_what_many_robots_offer_comes_into_the_chain() -> None:
    table = backlog(6, period_s=0.5, seconds=2.0)
    assert table.offered.iloc[-1] == 24
    assert table.offered.is_monotonic_increasing and (table.waiting <= 24).all()


def test_a_flood_is_refused_beyond_its_own_room() -> None:
    table = flooded(2.0).set_index("name")
    assert (table.n >= 2).all() and table.ratio["quiet"] == 1.0
    assert table.taken["flooded"] > 0 and table.taken["quiet"] == 0


def nothing_is_lost(table: pd.DataFrame) -> None:
    assert (table.lost == 0).all() and (table.doubled == 0).all()
    assert table.verified.all() and (table.heads == 1).all()
    assert (table.in_chain >= table.acknowledged).all()


def test_servers_a_maker_and_a_robot_are_killed_and_nothing_is_lost() -> None:
    table = kills(1, 1)
    assert list(table.killed) == ["leader", "other", "maker", "all servers", "robot"]
    nothing_is_lost(table)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_the_same_many_times() -> None:
    nothing_is_lost(kills(20, 5))


@pytest.mark.slow
def test_a_bit_that_flips_in_a_servers_store_is_noticed_and_mended() -> None:
    (row,) = flipped_bit().to_dict("records")
    assert 0 < row["alarms"] <= row["lost_there"]
    assert row["follower_blocks"] == row["after_cure"] == row["messages"]
    assert row["verified"]

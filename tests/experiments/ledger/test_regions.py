"""A ledger for each region: what is followed, what that saves, what it misses."""

import numpy as np
import pytest
from hamlet import hamlet

from vrchain.experiments.ledger.regions import NEAR_M, ONE, OWN, SEEN, away_m, region_of, regional

EXTENT_M = (40.0, 80.0)


def test_regions_are_counted_from_the_south_west() -> None:
    xy_m = np.array([[-1.0, -1.0], [1.0, -1.0], [-1.0, 1.0], [1.0, 1.0], [20.0, 40.0]])
    assert list(region_of(xy_m, EXTENT_M, (2, 2))) == [0, 1, 2, 3, 3]
    assert list(region_of(xy_m, EXTENT_M, (1, 1))) == [0] * 5


def test_a_region_is_as_far_as_its_nearest_point() -> None:
    away = away_m(np.array([[-3.0, -4.0], [5.0, 10.0]]), EXTENT_M, (2, 2))
    assert away[0] == pytest.approx([0.0, 3.0, 4.0, 5.0])
    assert away[1] == pytest.approx([np.hypot(5, 10), 10.0, 5.0, 0.0])


def test_who_follows_less_receives_less_and_misses_more() -> None:
    table = regional(hamlet(), 6, payload_bytes=20_000).set_index("follows")
    one, own = table.loc[ONE], table.loc[OWN]
    assert one.regions == 4 and one.missed == one.lost == 0 < one.common
    assert one.received_bytes == pytest.approx(6 * 20_000, rel=0.05)
    assert own.regions == 1 and own.missed > 0 and own.missed >= own.lost
    assert (table.common == one.common).all() and (table.landmarks == one.landmarks).all()
    near = table.loc[[f"regions within {most_m:g} m" for most_m in NEAR_M]]
    assert near.received_bytes.is_monotonic_decreasing and near.missed.is_monotonic_increasing
    for row in (*near.itertuples(), table.loc[SEEN]):
        assert own.received_bytes <= row.received_bytes <= one.received_bytes
        assert row.missed <= own.missed
    saved = one.bytes - own.bytes
    assert saved == pytest.approx(6 * (one.received_bytes - own.received_bytes))

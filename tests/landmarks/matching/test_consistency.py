import numpy as np
import pytest

from vrchain.landmarks.matching.consistency import chance_joined
from vrchain.landmarks.matching.epipolar import PlanarGeometry


def at(heights: float) -> PlanarGeometry:
    return PlanarGeometry(0.0, 0.0, np.ones(5, dtype=bool), 0.0, heights)


def test_more_and_surer_claims_are_trusted_more_and_near_ones_less() -> None:
    chance = [chance_joined([0.9] * n, 40, at(30.0)) for n in range(6)]
    assert chance[0] == 0.0 and chance == sorted(set(chance)) and chance[-1] < 1.0
    assert chance_joined([0.5] * 2, 40, at(30.0)) < chance[2]
    assert chance_joined([0.9] * 2, 40, at(2.0)) < chance[2]
    for nothing_told in (None, at(np.nan)):
        assert chance_joined([0.9] * 2, 40, nothing_told) == chance[2]


def test_where_much_is_proposed_few_claims_say_little() -> None:
    assert chance_joined([0.9] * 3, 100, None) < 0.3 < 0.95 < chance_joined([0.9] * 3, 20, None)


@pytest.mark.parametrize("proposals", [0, 1, 1000])
def test_no_claims_join_nothing(proposals: int) -> None:
    assert chance_joined([], proposals, at(5.0)) == 0.0

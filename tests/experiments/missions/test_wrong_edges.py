from dataclasses import replace
from typing import Any

import pytest

from vrchain.experiments.missions.wrong_edges import misled
from vrchain.landmarks.matching.calibration import Calibration
from vrchain.landmarks.matching.common import CommonLandmark, Comparison
from vrchain.navigation.perception import Perception

NOTHING = Comparison((), None)
PAIRS = [Comparison((CommonLandmark(k / 400, None, None, None, None),), None) for k in range(400)]  # type: ignore[arg-type]


def compare(a: Any, b: Any) -> Comparison:
    return PAIRS[a] if b else NOTHING


PERCEPTION = Perception(
    lambda seen: None, lambda blob, record: None, compare, Calibration(1.0, 0.0, {})
)  # type: ignore


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5])
def test_so_many_edges_are_those_of_other_pairs(share: float) -> None:
    perception, again = (misled(PERCEPTION, share, seed=7) for _ in range(2))
    said = [perception.compare(k, True) for k in range(400)]
    assert [again.compare(k, True) for k in range(400)] == said
    wrong = [k for k, found in enumerate(said) if found is not PAIRS[k]]
    assert len(wrong) / 400 == pytest.approx(share, abs=0.06 if share else 0)
    assert all(found.common for found in said)


def test_where_nothing_is_in_common_nothing_is_said() -> None:
    perception = misled(PERCEPTION, 1.0, seed=7)
    assert perception.compare(0, True) is PAIRS[0]
    assert perception.compare(1, False) is NOTHING
    assert perception.compare(2, True) is PAIRS[0], "never its own"
    assert misled(replace(PERCEPTION), 0.0, seed=7).compare(5, True) is PAIRS[5]

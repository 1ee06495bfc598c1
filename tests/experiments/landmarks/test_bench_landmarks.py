import numpy as np
import pytest

pytest.importorskip("torch", reason="proposals need torch (extra `learned`)")

from vrchain.experiments.landmarks.speed import bench_landmarks
from vrchain.experiments.stopwatch import COLUMNS
from vrchain.paths import SCENES


@pytest.mark.slow
def test_what_is_timed() -> None:
    found = bench_landmarks(SCENES / "barn.yaml", 2, seed=3000)
    assert list(found.columns) == COLUMNS
    assert list(found.name) == ["propose", "examine", "pair cnn", "pair cnn+sift"]
    assert (found.median_us > 0).all() and (found.reference_us > 0).all()
    assert np.allclose(found.ratio, found.median_us / found.reference_us)
    assert (found.positions == 2).all()

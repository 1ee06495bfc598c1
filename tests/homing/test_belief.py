"""The chance of every direction home, by made-up peaks and a made-up grid."""

import numpy as np
import pytest

from vrchain.homing.belief import of_peaks
from vrchain.landmarks.matching.tilted import Peaks

ANY_DEG = 180 / np.sqrt(3)
STD_RAD = 0.01


def peaks(*direction_evidence: tuple[float, float]) -> Peaks:
    poses = np.zeros((len(direction_evidence), 6))
    poses[:, 0] = [direction for direction, _ in direction_evidence]
    evidence = np.array([found for _, found in direction_evidence])
    return Peaks(poses, evidence, np.full(len(poses), STD_RAD))


@pytest.mark.parametrize(
    ("evidence", "low_deg", "high_deg"),
    [(-10.0, 103.5, 104), (0.0, 73, 74), (6.0, 4.5, 6), (40.0, 0.57, 0.58)],
)
def test_a_direction_is_as_sure_as_it_is_likelier_than_that_all_matches_are_wrong(
    evidence: float, low_deg: float, high_deg: float
) -> None:
    belief = of_peaks(peaks((1.0, evidence)))
    direction, std_rad, mean_rad = belief.best()
    assert direction == pytest.approx(1.0) and mean_rad == STD_RAD
    assert low_deg < np.degrees(std_rad) < high_deg
    assert belief.nothing == pytest.approx(1 / (1 + np.exp(evidence)))


def test_two_peaks_that_are_equally_likely_are_both_believed() -> None:
    belief = of_peaks(peaks((-0.5, 30.0), (0.5, 30.0)))
    _, std_rad, mean_rad = belief.best()
    assert belief.share == pytest.approx([0.5, 0.5])
    assert 0.45 < mean_rad < 0.55 and std_rad > 0.45


def test_what_the_grid_alone_knows_is_rough() -> None:
    """A cell more likely than all else, though no peak is there."""
    cells = np.full((48, 48), -20.0)
    cells[8, 3] = 30.0
    direction, std_rad, _ = of_peaks(peaks((-2.0, 5.0)), cells).best()
    assert direction == pytest.approx(2 * np.pi * 8 / 48, abs=0.02)
    assert 0.25 < std_rad < 0.3
    assert of_peaks(peaks((-2.0, 60.0)), cells).best()[1] == pytest.approx(STD_RAD, abs=1e-4)

import numpy as np
import pandas as pd

from vrchain.experiments.intervals import by_suburb, ratio, resampled


def test_sums_are_by_suburb_and_none_is_left_out() -> None:
    values, of = pd.Series([1.0, 2.0, 4.0]), pd.Series([3, 3, 7])
    assert by_suburb(values, of, np.array([3, 5, 7])).tolist() == [3.0, 0.0, 4.0]


def test_a_share_lies_in_its_interval_and_the_interval_in_the_suburbs() -> None:
    top, bottom = np.array([1.0, 5.0, 9.0]), np.array([10.0, 10.0, 10.0])
    found = ratio("share", top, bottom, resampled(3, 0, "test"))
    low, high = found["share_ci"]
    assert found["share"] == 0.5 and 0.1 <= low < 0.5 < high <= 0.9
    assert ratio("share", top, bottom, resampled(3, 0, "test")) == found


def test_nothing_to_divide_by_is_no_share() -> None:
    none = np.zeros(2)
    assert ratio("x", none, none, resampled(2, 0, "test")) == {"x": None, "x_ci": None}

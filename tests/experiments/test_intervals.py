import numpy as np
import pandas as pd
import pytest

from vrchain.experiments.intervals import Bootstrap, ratio, resampled, share, shown, table_of


def test_sums_are_by_suburb_and_none_is_left_out() -> None:
    values, of = pd.Series([1.0, 2.0, 4.0]), pd.Series([3, 3, 7])
    told = Bootstrap([7, 3, 5, 5], "test")
    assert told.sums(values, of).tolist() == [3.0, 0.0, 4.0]
    parts = np.array([3.0, 0.0, 4.0]), np.array([2.0, 0.0, 1.0])
    assert told.mean("x", values, of) == ratio("x", *parts, resampled(3, 0, "test"))
    hits = values > 1
    assert told.share("x", hits, of)["x"] == 2 / 3


def test_a_share_lies_in_its_interval_and_the_interval_in_the_suburbs() -> None:
    top, bottom = np.array([1.0, 3.0, 5.0, 7.0, 9.0]), np.full(5, 10.0)
    found = ratio("share", top, bottom, resampled(5, 0, "test"))
    low, high = found["share_ci"]
    assert found["share"] == 0.5 and 0.1 <= low < 0.5 < high <= 0.9
    assert ratio("share", top, bottom, resampled(5, 0, "test")) == found


def test_of_two_suburbs_the_interval_reaches_beyond_both() -> None:
    found = ratio("x", np.array([2.0, 3.0]), np.ones(2), resampled(2, 0, "test"))
    low, high = found["x_ci"]
    assert low == 0.0 and high > 6.0  # 2.5 and 12.7 standard errors of 0.5; none is below 0
    low, high = share("x", np.array([9.0, 10.0]), np.full(2, 10.0), resampled(2, 0, "test"))["x_ci"]
    assert low < 0.5 and high == 1.0


def test_nothing_to_divide_by_is_no_share() -> None:
    none = np.zeros(2)
    assert ratio("x", none, none, resampled(2, 0, "test")) == {"x": None, "x_ci": None}


def test_of_one_suburb_or_without_an_upper_end_there_is_no_interval() -> None:
    ten = np.array([10.0])
    assert ratio("x", 0.3 * ten, ten, resampled(1, 0, "test")) == {"x": 0.3, "x_ci": None}
    assert share("x", ten, ten, resampled(1, 0, "test"))["x_ci"] == pytest.approx(
        [0.692, 1.0], abs=1e-3
    )
    assert ratio("x", np.full(10, 0.8), np.ones(10), resampled(10, 0, "test"))["x_ci"] is None
    often, seldom = np.full(10, 7.0), np.array([1.0, 1.0, *np.zeros(8)])
    again = resampled(10, 0, "test")  # some draws have none of the two that are not nought
    assert ratio("times", often, seldom, again) == {"times": 35.0, "times_ci": None}


def test_who_has_nothing_to_divide_by_counts_for_what_there_is_to_divide() -> None:
    """As of missions: six of ten suburbs where one succeeds alone, and all ten with the ledger."""
    ours, alone = np.ones(10), np.array([*np.ones(6), *np.zeros(4)])
    low, high = ratio("times", ours, alone, resampled(10, 0, "navigation"))["times_ci"]
    assert (low, high) == pytest.approx((10 / 9, 5.0), abs=0.01)


@pytest.mark.parametrize("n", [2, 3, 4, 10])
def test_intervals_hold_the_truth_nearly_as_often_as_they_say(n: int) -> None:
    """Means of ten: a bootstrap's own percentiles hold it in nine cases of ten, of two in five."""
    draws, one = np.random.default_rng(0), np.ones(n)
    held = 0
    for k in range(400):
        low, high = ratio("x", draws.normal(size=n), one, resampled(n, k % 20, "test"))["x_ci"]
        held += low <= 0 <= high
    assert 0.91 < held / 400 < 0.98


@pytest.mark.parametrize(("hits", "low", "high"), [(10, 0.692, 1.0), (0, 0.0, 0.308)])
def test_all_or_none_of_ten_is_no_certainty(hits: int, low: float, high: float) -> None:
    """Ends of the exact interval, as tables give them."""
    found = share("x", np.full(10, hits / 10), np.ones(10), resampled(10, 0, "test"))
    assert found["x"] == hits / 10 and found["x_ci"] == pytest.approx([low, high], abs=1e-3)


def test_a_share_of_some_is_a_ratio() -> None:
    top, bottom, again = np.array([1.0, 2, 2, 2, 1]), np.full(5, 2.0), resampled(5, 0, "test")
    assert share("x", top, bottom, again) == ratio("x", top, bottom, again)
    assert share("x", 0 * top, 0 * top, again) == {"x": None, "x_ci": None}


def test_figures_are_shown_with_their_intervals_counts_in_full() -> None:
    figures = {"a": 0.12345, "a_ci": [0.1, 0.25], "b": 0.5, "n": 12_211, "none": None}
    names = ("a", "b", "n", "none", "unknown")
    told = ["0.123 [0.100, 0.250]", "0.500", "12211", "-", "-"]
    assert [shown(figures, name) for name in names] == told
    assert shown(figures, "a", ".2f") == "0.12 [0.10, 0.25]"
    table = table_of({"one": figures}, names, "way")
    assert table.index.name == "way" and table.loc["one"].tolist() == told

"""Durations, from ``perf_counter_ns`` unless said otherwise; they never enter a ledger."""

from collections.abc import Callable, Mapping, Sequence
from itertools import repeat
from time import perf_counter_ns
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

COLUMNS = ["name", "positions", "median_us", "reference_us", "ratio", "bar"]  # of a bench

Turn = TypeVar("Turn")


class Stopwatch:
    """Adds up the time between laps under the names of the stages."""

    def __init__(self) -> None:
        self.restart()

    def restart(self) -> None:
        """Forget all stages and begin the first lap."""
        self._ns: dict[str, int] = {}
        self._last_ns = perf_counter_ns()

    def lap(self, stage: str) -> None:
        """Add the time since the lap before to ``stage``."""
        now_ns = perf_counter_ns()
        self._ns[stage] = self._ns.get(stage, 0) + now_ns - self._last_ns
        self._last_ns = perf_counter_ns()

    def us(self, stage: str) -> float:
        """Microseconds of a stage since the restart."""
        return self._ns[stage] / 1e3


def sample_us(call: Callable[[], object], calls: int, samples: int) -> list[float]:
    """Microseconds of one call, from ``samples`` runs of ``calls``, after one call to warm up."""
    call()
    return [elapsed_us(call, calls) for _ in range(samples)]


def elapsed_us(call: Callable[[], object], calls: int = 1) -> float:
    """Microseconds of one call, the mean of one run of ``calls``."""
    start_ns = perf_counter_ns()
    for _ in repeat(None, calls):
        call()
    return (perf_counter_ns() - start_ns) / 1e3 / calls


def race_us(
    runners: Mapping[str, Callable[[Turn], object]],
    turns: Sequence[Turn],
    order: np.random.Generator,
    clock_ns: Callable[[], int] = perf_counter_ns,
) -> dict[str, NDArray[np.float64]]:
    """Microseconds of each runner at each turn, (number of turns,) by name.

    At each turn all run once, in an order drawn anew, so that whatever disturbs the machine and
    whatever one leaves in its caches meets all alike.
    """
    names = list(runners)
    times_us = {name: np.zeros(len(turns)) for name in names}
    for number, turn in enumerate(turns):
        for name in order.permutation(names):
            run = runners[name]
            start_ns = clock_ns()
            run(turn)
            times_us[name][number] = (clock_ns() - start_ns) / 1e3
    return times_us


def timed(
    name: str,
    times_us: Sequence[float] | NDArray[np.float64],
    reference_us: float = np.nan,
    bar_us: float = np.nan,
) -> dict[str, object]:
    """A bench's row, with ``COLUMNS``: the median of so many times, and over the reference's.

    bar_us: what the median should not exceed. NaN where there is none.
    """
    median_us = float(np.median(times_us))
    row = (name, len(times_us), median_us, reference_us, median_us / reference_us, bar_us)
    return dict(zip(COLUMNS, row, strict=True))

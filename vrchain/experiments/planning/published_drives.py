"""One drive by the published rule, for each size of team: ours beside what was published.

The published logs (https://github.com/frcvlab/WAVNRobustRSC, its folder ``Results``, the logfile
``122624-AllP0-100-S1-9BIGreps30``) hold, for nine sizes of team, 20 probabilities p and the robust
form of both known planners, the share of 150 drives that came to their end: five worlds, 30 tasks
in each. ``unblocked`` is the share of drives on which no landmark was lost, which a path without
spares needs; ``options`` the mean number of landmarks on a path's segments.

What is driven here:

- ``as published``: the paths as they were planned there, slips and all (``experiments.wavn``). A
  drive counts that came to the end of its path; ``at_target``: and that end was the target.
- ``to the target``: paths of the same planners and of ours without slips, each with all spares.
- ``to who sees it``: the same paths and losses without their last segment, from the last robot to
  the target; the published chains that lost their target are such.
"""

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from vrchain.errors import MissionError
from vrchain.experiments.intervals import by_suburb, interval, ratio, resampled, share
from vrchain.experiments.planning.lost_segments import (
    Driver,
    best_chance_plan,
    published_rule,
    robust_breadth_first_plan,
    shortened_plan,
)
from vrchain.experiments.planning.wavn import (
    Path,
    published_breadth_first,
    published_chain,
    random_tasks,
    random_world,
)
from vrchain.seeding import generator

TEAMS = tuple(range(10, 100, 10))  # robots; ten times as many landmarks
PERCENTS = np.arange(0, 100, 5)  # 100 p
BREADTH_FIRST, CHAIN, OURS = "breadth-first, robust", "shortened chain, robust", "best chance"
AS_PUBLISHED, TO_TARGET, TO_VIEWER = RULES = ("as published", "to the target", "to who sees it")
SHOWN = (10, 50, 95)  # percents, in text
_WORLDS, _TASKS = 5, 30  # published, of each share
_ROUNDED = 0.005  # published shares are
_COINS = 200  # more than any path has segments
_COUNTED = ["arrives", "at_target", "unblocked", "options"]

# Percent of drives that came to their end; a row each of PERCENTS, a column a size of TEAMS.
_ARRIVED = {
    BREADTH_FIRST: """
        100 100 100 100 100 100 100 100 100
        91 83 85 93 92 89 91 96 95
        78 79 77 78 84 86 77 79 87
        62 70 63 68 64 71 79 67 74
        58 59 58 65 59 67 67 60 61
        55 52 53 49 53 49 55 53 45
        41 53 53 39 42 45 49 47 47
        32 30 40 37 40 44 40 32 46
        28 33 31 34 32 39 32 33 31
        21 27 28 32 23 26 31 29 31
        19 21 20 19 21 21 23 26 20
        12 14 16 19 13 22 19 21 25
        9 21 12 10 17 16 16 17 17
        12 9 11 13 13 7 15 14 14
        7 7 10 8 11 11 3 12 8
        6 5 3 3 5 6 8 5 11
        4 3 3 5 4 5 4 3 5
        3 3 3 3 0 1 1 2 3
        1 1 1 1 1 1 1 1 1
        0 0 0 1 0 0 1 1 0
    """,
    CHAIN: """
        100 100 100 100 100 100 100 100 100
        92 95 93 95 98 98 97 93 95
        77 85 88 89 94 93 92 90 91
        80 66 87 71 75 85 91 86 91
        62 57 68 83 82 81 85 84 79
        52 67 62 76 81 81 77 85 84
        66 64 71 72 71 75 78 71 79
        34 62 43 63 69 71 75 76 80
        21 49 66 61 53 71 63 65 73
        25 32 47 65 62 64 64 67 69
        17 35 55 54 64 67 68 69 63
        25 43 49 59 42 53 57 65 57
        19 32 47 57 65 62 57 55 52
        34 23 50 41 50 52 49 57 54
        17 11 36 35 49 46 51 51 54
        15 17 29 43 49 46 49 53 53
        6 17 29 29 31 39 49 51 45
        19 29 33 43 46 42 49 43 47
        7 24 22 32 29 45 37 39 47
        10 13 33 31 33 40 42 42 48
    """,
}
PUBLISHED = {
    method: pd.DataFrame(
        np.array(text.split(), dtype=float).reshape(len(PERCENTS), len(TEAMS)) / 100,
        index=PERCENTS / 100,
        columns=TEAMS,
    )
    for method, text in _ARRIVED.items()
}
# Share of drives on which no landmark was lost, mean over TEAMS; one each of PERCENTS.
PUBLISHED_UNBLOCKED = {
    BREADTH_FIRST: (
        1.000, 0.857, 0.716, 0.571, 0.490, 0.376, 0.318, 0.233, 0.184, 0.140,
        0.098, 0.076, 0.053, 0.042, 0.023, 0.012, 0.009, 0.006, 0.001, 0.002,
    ),
    CHAIN: (
        1.000, 0.828, 0.678, 0.544, 0.440, 0.340, 0.288, 0.228, 0.161, 0.131,
        0.111, 0.069, 0.048, 0.052, 0.024, 0.019, 0.009, 0.004, 0.002, 0.002,
    ),
}  # fmt: skip
# Mean number of landmarks on a segment over all p; one each of TEAMS.
PUBLISHED_OPTIONS = {
    BREADTH_FIRST: (2.70, 4.06, 5.29, 6.59, 7.72, 8.97, 10.07, 11.10, 12.38),
    CHAIN: (3.18, 6.82, 11.49, 15.98, 19.19, 23.96, 28.38, 31.77, 35.43),
}


def one_drive(
    n_worlds: int, n_tasks: int, *, seed: int, teams: Sequence[int] = TEAMS
) -> pd.DataFrame:
    """Drive each task once by each rule and method, the same coins for all. MissionError without.

    One row a size of team, world, rule, method and p: ``n`` tasks; of them, summed, ``arrives``,
    ``at_target``, ``unblocked`` and ``options``.
    """
    if n_worlds < 1 or n_tasks < 1:
        raise MissionError(f"expected 1 world and task or more, got {n_worlds} and {n_tasks}")
    rows = [
        row
        for robots in teams
        for index in range(n_worlds)
        for row in _world_rows(robots, index, n_tasks, seed)
    ]
    return pd.DataFrame(rows)


def _world_rows(robots: int, index: int, n_tasks: int, seed: int) -> list[dict[str, object]]:
    world = random_world(seed, index, robots, 10 * robots)
    plans = {
        BREADTH_FIRST: robust_breadth_first_plan,
        CHAIN: shortened_plan(True),
        OURS: best_chance_plan(world, "drive", 0.5),  # the same for every p
    }
    counts: dict[tuple[str, str], NDArray[np.float64]] = defaultdict(lambda: np.zeros(()))
    for number, task in enumerate(random_tasks(world, n_tasks, seed, index)):
        draws = generator(seed, "one drive", robots, index, number)
        coins = draws.integers(101, size=_COINS)
        paths = {(AS_PUBLISHED, CHAIN): published_chain(world, task, draws)}
        for method, plan in plans.items():
            path = plan(Driver(world, task, draws, task.start))
            assert path is not None, "the ledger that names start and viewer joins them"
            paths[TO_TARGET, method] = path
            paths[TO_VIEWER, method] = Path(path.robots, path.landmarks[:-1])
        straight = paths[TO_TARGET, BREADTH_FIRST]
        paths[AS_PUBLISHED, BREADTH_FIRST] = published_breadth_first(straight)
        for key, path in paths.items():
            counts[key] = counts[key] + _driven(path.landmarks, coins, task.target)
    return [
        {"robots": robots, "world": index, "rule": rule, "method": method}
        | {"p": percent / 100, "n": n_tasks}
        | dict(zip(_COUNTED, found.tolist(), strict=True))
        for (rule, method), table in counts.items()
        for percent, found in zip(PERCENTS.tolist(), table, strict=True)
    ]


def _driven(
    landmarks: Sequence[Sequence[int]], coins: NDArray[np.int64], target: int
) -> NDArray[np.float64]:
    """Whether it arrives, is at the target, unblocked, and its options: (len(PERCENTS), 4)."""
    thrown, arrives = coins.tolist(), []
    for percent in PERCENTS.tolist():
        passable = published_rule(percent / 100, iter(thrown))
        arrives.append(all(passable(-1, -1, options) for options in landmarks))
    at_target = arrives if tuple(landmarks[-1:]) == ((target,),) else [False] * len(arrives)
    unblocked = coins[: len(landmarks)].min(initial=100) >= PERCENTS
    options = [np.mean([len(x) for x in landmarks])] if landmarks else [0.0]
    return np.stack([arrives, at_target, unblocked, options * len(arrives)], axis=1)


def by_team(drives: pd.DataFrame, *, seed: int) -> pd.DataFrame:
    """Shares of the tasks of ``one_drive``, a row a rule, method, size of team (0: all) and p.

    ``arrives`` with its 95 % interval, ``low`` to ``high``, a bootstrap over worlds; ``published``,
    NaN where nothing was; ``inside``: 1 if that is within the 95 % interval of five worlds here.
    """
    n_worlds = drives.world.nunique()
    again = resampled(n_worlds, seed, "one drive")
    few = generator(seed, "as few").integers(n_worlds, size=(len(again), _WORLDS))
    by = ["rule", "method", "robots", "p"]
    both = pd.concat([drives, drives.assign(robots=0)]).groupby([*by, "world"], sort=False).sum()
    groups: Any = both.groupby(by, sort=False)
    rows = []
    for (rule, method, robots, p), counts in groups:
        hits, of = counts.arrives.to_numpy(), counts.n.to_numpy()
        ends = share("it", hits, of, again)["it_ci"]
        row = {"rule": rule, "method": method, "robots": robots, "p": p, "drives": 1}
        row |= {"n": int(of.sum())} | (counts[_COUNTED].sum() / of.sum()).to_dict()
        row["low"], row["high"] = ends if isinstance(ends, list) else (float("nan"),) * 2
        if rule == AS_PUBLISHED:
            line = PUBLISHED[method].loc[p]
            row["published"] = line.get(robots, line.mean())
        if rule == AS_PUBLISHED and robots:
            shares = hits / of  # what five worlds give, and how far all worlds here are off
            drawn = shares[few].mean(axis=1) + shares[again].mean(axis=1) - shares.mean()
            low, high = np.quantile(drawn, (0.025, 0.975))
            row["inside"] = float(low - _ROUNDED <= row["published"] <= high + _ROUNDED)
        rows.append(row)
    return pd.DataFrame(rows)


def gains(drives: pd.DataFrame, *, seed: int) -> pd.DataFrame:
    """By how much more drives of shortened chains arrive than breadth-first ones, over all p.

    A row a way to tell it, with its 95 % interval: of the published shares, all 180 of a planner
    drawn anew, apart from the other's or in pairs; or the shares as they are, and the 150 tasks of
    each drawn anew; then of ``drives``, over worlds, by rule.
    """
    top, bottom = (PUBLISHED[method].to_numpy().ravel() for method in (CHAIN, BREADTH_FIRST))
    draws = generator(seed, "gain")
    one, other = (resampled(top.size, seed, f"gain {k}") for k in range(2))
    n_tasks = _WORLDS * _TASKS
    drawn = {
        "shares drawn anew, apart": (top[one], bottom[other]),
        "shares drawn anew, in pairs": (top[one], bottom[one]),
        "tasks drawn anew": tuple(
            draws.binomial(n_tasks, x, size=one.shape) for x in (top, bottom)
        ),
    }
    rows: list[dict[str, object]] = [
        {"drives": "published", "by": how, "gain": top.sum() / bottom.sum() - 1}
        | {"gain_ci": list(interval(over.sum(axis=1) / under.sum(axis=1) - 1, top.size))}
        for how, (over, under) in drawn.items()
    ]
    worlds = np.sort(drives.world.unique())
    again = resampled(len(worlds), seed, "one drive")
    for rule in (AS_PUBLISHED, TO_TARGET):
        group = drives[drives.rule == rule]
        over, under = (
            by_suburb(group.arrives[group.method == method], group.world, worlds)
            for method in (CHAIN, BREADTH_FIRST)
        )
        rows.append(
            {"drives": rule, "by": "worlds drawn anew"} | ratio("gain", over - under, under, again)
        )
    return pd.DataFrame(rows)


def as_text(shares: pd.DataFrame) -> str:
    """The rows of ``by_team`` at some p, a table a rule; 95 % intervals in brackets."""
    shares = shares[(shares.p * 100).round().isin(SHOWN)]
    ends = zip(shares.arrives, shares.low, shares.high, strict=True)
    shares = shares.assign(
        arrives=[f"{share:.2f} [{low:.2f}, {high:.2f}]" for share, low, high in ends],
        published=shares.published.map("{:.2f}".format),
        at_target=shares.at_target.map("{:.2f}".format),
        robots=shares.robots.replace(0, "all"),
    )
    unblocked = pd.DataFrame(PUBLISHED_UNBLOCKED, index=PERCENTS / 100)
    options = pd.DataFrame(PUBLISHED_OPTIONS, index=TEAMS)
    parts = []
    for rule in RULES:
        values = ["arrives", "published", "at_target"] if rule == AS_PUBLISHED else ["arrives"]
        group = shares[shares.rule == rule]
        wide = group.pivot(index=["p", "robots", "n"], columns="method", values=values)
        wide = wide.swaplevel(axis="columns").sort_index(axis="columns")
        parts.append(f"one drive, {rule}\n{wide.to_string()}")
    theirs = shares[shares.rule == AS_PUBLISHED]
    for title, chosen, of, column, published in (
        ("no landmark lost, all teams", theirs.robots == "all", "p", "unblocked", unblocked),
        ("landmarks on a segment", theirs.p == theirs.p.min(), "robots", "options", options),
    ):
        wide = theirs[chosen].pivot(index=of, columns="method", values=column)
        wide = wide.join(published.add_suffix(", published"), how="inner")
        parts.append(f"{title}, {AS_PUBLISHED}\n{wide.round(2).to_string()}")
    return "\n\n".join(parts)

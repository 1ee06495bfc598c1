"""One drive by the published rule, for each size of team: ours beside what was published.

The published logs (https://github.com/frcvlab/WAVNRobustRSC, its folder ``Results``, the logfile
``122624-AllP0-100-S1-9BIGreps30``) hold, for nine sizes of team, 20 probabilities p and the robust
form of both known planners, the share of 150 drives that came to their end: five worlds, 30 tasks
in each. ``unblocked`` is the share of drives on which no landmark was lost, which a path without
spares needs; ``options`` the mean number of landmarks on a path's segments.

What is driven here:

- ``as published``: the paths as they were planned there, slips and all (``planning.wavn``). A
  drive counts that came to the end of its path; ``at_target``: and that end was the target.
- ``to the target``: paths of the same planners and of ours without slips, each with all spares.
- ``to who sees it``: the same paths and losses without their last segment, from the last robot to
  the target; the published chains that lost their target are such.
"""

import pathlib
from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from vrchain.errors import MissionError
from vrchain.experiments.intervals import Bootstrap, interval, ratio, resampled, share
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

# A row each method and p: the share of drives that came to their end, by size of team; and
# ``unblocked``, the share on which no landmark was lost, mean over sizes.
_TABLE = pd.read_csv(pathlib.Path(__file__).with_suffix(".csv"), index_col=["method", "p"])
_ARRIVED = _TABLE.drop(columns="unblocked").rename(columns=int)
PUBLISHED = {method: _ARRIVED.loc[method] for method in (BREADTH_FIRST, CHAIN)}
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
        row["inside"] = float("nan")
        if rule == AS_PUBLISHED and robots and n_worlds > 1:
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
    told = Bootstrap(drives.world, "one drive", seed)
    for rule in (AS_PUBLISHED, TO_TARGET):
        group = drives[drives.rule == rule]
        over, under = (
            told.sums(group.arrives[group.method == method], group.world)
            for method in (CHAIN, BREADTH_FIRST)
        )
        rows.append(
            {"drives": rule, "by": "worlds drawn anew"}
            | ratio("gain", over - under, under, told.again)
        )
    return pd.DataFrame(rows)


def as_text(shares: pd.DataFrame, gains: pd.DataFrame) -> str:
    """``by_team`` at some p, a table a rule, and ``gains``; 95 % intervals in brackets."""
    inside = shares.inside.dropna()
    shares = shares[(shares.p * 100).round().isin(SHOWN)]
    ends = zip(shares.arrives, shares.low, shares.high, strict=True)
    shares = shares.assign(
        arrives=[f"{s:.2f}" + (f" [{a:.2f}, {b:.2f}]" if a <= b else "") for s, a, b in ends],
        published=shares.published.map("{:.2f}".format),
        at_target=shares.at_target.map("{:.2f}".format),
        robots=shares.robots.replace(0, "all"),
    )
    unblocked = _TABLE.unblocked.unstack("method").rename_axis(columns=None)
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
    if len(inside):
        parts.append(
            f"{int(inside.sum())} of {len(inside)} published shares are in the interval of as many "
            "worlds here."
        )
    parts.append(
        "By how much more drives of shortened chains arrive than breadth-first ones:\n"
        + gains.round(3).to_string(index=False)
    )
    return "\n\n".join(parts)

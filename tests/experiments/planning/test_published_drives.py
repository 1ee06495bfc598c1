"""One drive by the published rule: what was published comes out again, and why it does."""

import numpy as np
import pandas as pd
import pytest

from vrchain.experiments.planning.published_drives import (
    AS_PUBLISHED,
    BREADTH_FIRST,
    CHAIN,
    OURS,
    PUBLISHED,
    PUBLISHED_OPTIONS,
    TEAMS,
    TO_TARGET,
    TO_VIEWER,
    as_text,
    by_team,
    gains,
    one_drive,
)


@pytest.fixture(scope="module")
def drives() -> pd.DataFrame:
    return one_drive(4, 20, seed=3000, teams=(10, 40, 90))


@pytest.fixture(scope="module")
def table(drives: pd.DataFrame) -> pd.DataFrame:
    return by_team(drives, seed=3000)


def line(table: pd.DataFrame, rule: str, method: str, robots: int = 0) -> pd.DataFrame:
    chosen = (table.rule == rule) & (table.method == method) & (table.robots == robots)
    return table[chosen].set_index("p")


def test_the_published_shares_are_as_in_the_logs() -> None:
    chain = PUBLISHED[CHAIN]
    assert chain.loc[0.5, [10, 40, 90]].tolist() == [0.17, 0.54, 0.63]
    assert round(chain.loc[0.95].mean(), 3) == 0.324
    sums = [PUBLISHED[method].to_numpy().sum() for method in (CHAIN, BREADTH_FIRST)]
    assert np.allclose(sums, [105.93, 61.64])
    assert all(len(options) == len(TEAMS) for options in PUBLISHED_OPTIONS.values())


def test_what_was_published_comes_out_again(table: pd.DataFrame) -> None:
    assert table.inside.count() == 2 * 3 * 20 and table.inside.mean() > 0.85
    for method, options in PUBLISHED_OPTIONS.items():
        for robots in (10, 40, 90):
            here = line(table, AS_PUBLISHED, method, robots).options.iloc[0]
            assert here == pytest.approx(options[TEAMS.index(robots)], rel=0.4)


def test_published_chains_beat_the_bound_only_where_they_lost_the_target(
    table: pd.DataFrame,
) -> None:
    bound = 1 - 100 * np.array(PUBLISHED[CHAIN].index) / 101
    for robots in (40, 90):
        chain = line(table, AS_PUBLISHED, CHAIN, robots)
        assert chain.arrives.loc[0.95] > bound[-1] + 0.1 and chain.arrives.loc[0.0] == 1
        assert 0.2 < chain.at_target.loc[0.0] < 0.8
        assert (chain.at_target <= bound + 0.1).all()
    straight = line(table, AS_PUBLISHED, BREADTH_FIRST)
    assert (straight.at_target == straight.arrives).all()
    assert (straight.arrives <= straight.unblocked.clip(lower=bound) + 1e-9).all()
    for method in (BREADTH_FIRST, CHAIN, OURS):
        reached, seen = (line(table, rule, method) for rule in (TO_TARGET, TO_VIEWER))
        assert (reached.at_target == reached.arrives).all()
        assert (reached.arrives <= seen.arrives).all()
        assert (reached.arrives <= bound + 0.06).all()
    assert line(table, TO_VIEWER, OURS, 90).arrives.min() > 0.97


def test_gains_depend_on_what_is_drawn_anew(drives: pd.DataFrame) -> None:
    found = gains(drives, seed=3000).set_index(["drives", "by"])
    apart, pairs, tasks = found.loc["published"].gain_ci
    assert np.allclose(found.loc["published"].gain, 0.7185, atol=1e-4)
    assert apart == pytest.approx([0.49, 1.0], abs=0.03)
    assert pairs == pytest.approx([0.59, 0.88], abs=0.02)
    assert tasks == pytest.approx([0.692, 0.746], abs=0.01)
    again, mended = (found.loc[(rule, "worlds drawn anew")] for rule in (AS_PUBLISHED, TO_TARGET))
    assert again.gain_ci[0] > 0.3 and mended.gain < 0.05 < again.gain


def test_text_has_every_rule_and_the_same_seed_gives_the_same_table(
    table: pd.DataFrame, drives: pd.DataFrame
) -> None:
    text = as_text(table, gains(drives, seed=3000))
    assert all(f"one drive, {rule}\n" in text for rule in (AS_PUBLISHED, TO_TARGET, TO_VIEWER))
    assert "published shares are in the interval" in text
    assert "landmarks on a segment" in text and "nan" not in text.lower()
    once, again = (one_drive(1, 3, seed=3000, teams=(10,)) for _ in range(2))
    pd.testing.assert_frame_equal(once, again)

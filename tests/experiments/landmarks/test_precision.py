from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from claims import claim, pair

from vrchain.experiments.landmarks.precision import (
    as_table,
    evaluate,
    row,
    summarise,
    summarise_survey,
)
from vrchain.experiments.landmarks.strangers import accused, strangers
from vrchain.experiments.scenes import suburbs
from vrchain.world.spec import SceneSpec

PAIRS = pd.DataFrame([pair(0, 0, 4), pair(0, 1, 0), pair(1, 0, 4, 180.0), pair(1, 1, 2)])
CLAIMS = pd.DataFrame(
    [
        claim(0, 0, 0.9, True),
        claim(0, 0, 0.8, True, shared=False),  # the same landmark, seen from its two sides
        claim(0, 0, 0.7, True, duplicate=True),
        claim(0, 1, 0.6, False),
        claim(1, 0, 0.85, False, twin=True),
        claim(1, 0, 0.8, True),
        claim(1, 1, 0.3, True),  # below the threshold
    ]
)


def test_figures_are_what_the_definitions_say() -> None:
    found = summarise(CLAIMS, PAIRS)["sift"]
    assert (found["n_pairs"], found["pairs_without_common"]) == (4, 1)
    assert found["pair_success"] == pytest.approx(1 / 3)  # wrong at its surest, or none, is not
    assert found["precision"] == pytest.approx(3 / 5)  # the duplicate counts for nothing
    assert found["recall"] == pytest.approx(2 / 10)
    assert found["false_claim_rate"] == 1.0
    assert (found["twin_claims"], found["duplicates"]) == (1, 1)
    assert found["precision_without_twins"] == pytest.approx(3 / 4)
    assert found["quality_m_median"] == 1.0
    assert found["direction_error_deg"] == 1.0
    assert found["direction_error_deg_answered"] == pytest.approx(2 / 3)
    for name in ("pair_success", "precision", "recall"):
        low, high = found[f"{name}_ci"]
        assert 0 <= low <= found[name] <= high <= 1


def test_of_a_pair_without_a_sure_claim_the_surest_counts() -> None:
    """And that alone, if it is sure enough."""
    found = summarise(CLAIMS, PAIRS.assign(claimed=0.82, surest=0.55))["sift"]
    assert found["claims_per_pair"] == 3 / 4  # 0.9, 0.6 and 0.85: not 0.8, nor 0.3
    assert found["precision"] == pytest.approx(1 / 3)


def test_a_survey_is_summarised_by_the_same_definitions() -> None:
    """Its pairs without a claim have a row of their own, as in one scene's table."""
    silent = pd.DataFrame([{"suburb": 1, "pair": 1}])
    counted = pd.concat([CLAIMS[CLAIMS.score >= 0.5], silent])
    table = counted.merge(PAIRS[["suburb", "pair", "co_visible"]], on=["suburb", "pair"])
    table["pair"] += 2 * table.pop("suburb")
    before = table.copy()
    found, known = summarise_survey(table), summarise(CLAIMS, PAIRS)["sift"]
    assert found.pop("n_claims") == 5
    assert found == {name: known[name] for name in found}
    pd.testing.assert_frame_equal(table, before)
    none = summarise_survey(table.assign(score=np.nan))
    assert (none["precision"], none["pair_success"], none["n_claims"]) == (None, 0.0, 0)


def test_recall_at_a_precision_is_that_of_the_best_threshold() -> None:
    """In order of score: right, wrong, right (not shared), right, wrong, right."""
    found = summarise(CLAIMS, PAIRS)["sift"]["recall_at_precision"]
    assert found == {"0.90": pytest.approx(0.1), "0.95": pytest.approx(0.1), "0.98": 0.1}
    none = summarise(CLAIMS.assign(right=False), PAIRS)["sift"]["recall_at_precision"]
    assert set(none.values()) == {None}


def test_claims_of_one_score_stand_or_fall_together() -> None:
    """No threshold parts them, however they happen to be ordered."""
    alike = pd.DataFrame([claim(0, 0, 0.9, k % 2 == 0) for k in range(20)])
    found = summarise(alike, PAIRS)["sift"]["recall_at_precision"]
    assert set(found.values()) == {None}


def test_no_claims_at_all() -> None:
    found = summarise(CLAIMS.iloc[:0], PAIRS)["sift"]
    assert (found["pair_success"], found["precision"], found["recall"]) == (0.0, None, 0.0)
    assert found["false_claim_rate"] == 0.0 and found["calibration_error"] is None
    assert "sift" in as_table({"sift": found}).to_string()


@pytest.mark.slow
def test_a_second_run_reads_what_the_first_found(tmp_path: Path) -> None:
    first, again = (
        evaluate(suburbs(SceneSpec()), 3, (2.0, 8.0), [row("sift")], seed=3000, folder=tmp_path)
        for _ in range(2)
    )
    for a, b in zip(first, again, strict=True):
        pd.testing.assert_frame_equal(a, b)
    summary = summarise(*first)["sift"]
    assert summary["n_pairs"] == 3 and 0 < summary["recall"] <= 1


@pytest.mark.slow
def test_in_one_world_pairs_are_told_apart_as_suburbs_are(tmp_path: Path) -> None:
    one = replace(suburbs(SceneSpec()), varied=False)
    claims, pairs = evaluate(one, 2, (2.0, 8.0), [row("sift")], seed=3000, folder=tmp_path)
    assert pairs.suburb.tolist() == [0, 1] and set(claims.suburb) <= {0, 1}
    assert summarise(claims, pairs)["sift"]["n_pairs"] == 2


def test_the_accused_are_counted_by_where_they_stand() -> None:
    found = pd.DataFrame(
        {
            "pair": [0, 1, 2, 3],
            "variant": ["sift"] * 4,
            "two_suburbs": [False, False, False, True],
            "suburb": [0, 0, 1, 1],
            "score": [0.0, 0.9, 0.0, 0.0],
        }
    )
    table = accused(found)
    assert table.two_suburbs.tolist() == [False, True] and table.pairs.tolist() == [3, 1]
    assert table.claimed.tolist() == pytest.approx([1 / 3, 0.0])
    (low, high), none = table.claimed_ci
    assert low < 1 / 3 < high and none == pytest.approx([0.0, 0.975])


@pytest.mark.slow
def test_strangers_are_half_of_two_suburbs_and_a_run_goes_on(tmp_path: Path) -> None:
    def found(pairs: int, folder: str) -> pd.DataFrame:
        return strangers(
            suburbs(SceneSpec()), pairs, [row("sift")], seed=3000, folder=tmp_path / folder
        )

    assert len(found(1, "broken off")) == 1
    whole = found(4, "at once")
    assert whole.two_suburbs.tolist() == [False, False, True, True]
    pd.testing.assert_frame_equal(found(4, "broken off"), whole)

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import worlds
from claims import claim, pair

from vrchain.experiments.landmarks import over_distance as landmark_bands
from vrchain.experiments.landmarks.over_distance import by_band, over_distance, precision_recall
from vrchain.experiments.scenes import Scenes
from vrchain.world import Scene

BANDS = ("1-10", "10-20")
PAIRS = pd.DataFrame(
    [pair(s, 0, band_m=b, variant=v) for b in BANDS for s in (0, 1) for v in ("sift", "cnn")]
)
CLAIMS = pd.DataFrame(
    [
        claim(0, 0, 0.9, quality_m=0.1),
        claim(0, 0, 0.9, duplicate=True),
        claim(0, 0, 0.8, False),
        claim(1, 0, 0.8, quality_m=0.3),
        claim(1, 0, 0.6, shared=False, quality_m=np.nan),  # right, seen from its two sides
        claim(1, 0, 0.3),  # below the threshold
        claim(0, 0, 0.3, False, band_m="10-20"),
    ]
).fillna({"band_m": "1-10"})


def test_a_row_for_each_band_and_variant() -> None:
    found = by_band(CLAIMS, PAIRS)
    assert list(zip(found.band_m, found.variant, strict=True)) == [
        ("1-10", "sift"), ("1-10", "cnn"), ("10-20", "sift"), ("10-20", "cnn"),
    ]  # fmt: skip
    near = found.iloc[0]
    assert (near.n_pairs, near.suburbs, near.landmarks_a_pair) == (2, 2, 4.0)
    assert (near.right_a_pair, near.wrong_a_pair) == (1.5, 0.5)  # the duplicate counts for nothing
    assert near.precision == 3 / 4 and near.recall == 2 / 8 and near.duplicates == 1
    assert near.precision_low <= near.precision <= near.precision_high
    assert near["recall_at_precision_0.90"] == 1 / 8
    assert near.quality_m_median == pytest.approx(0.3)
    assert (near.quality_m_q25, near.quality_m_q75) == pytest.approx((0.2, 4.65))
    for silent in (found.iloc[1], found.iloc[2], found.iloc[3]):
        assert np.isnan(silent.precision) and np.isnan(silent.quality_m_q25)
        assert silent.recall == silent.right_a_pair == silent.wrong_a_pair == 0


def test_of_one_suburb_only_pairs_that_all_succeed_have_an_interval() -> None:
    claims = CLAIMS[CLAIMS.suburb == 0]
    (right, *_) = by_band(claims.assign(right=True), PAIRS[PAIRS.suburb == 0]).itertuples()
    assert right.precision == 1 and np.isnan([right.precision_low, right.precision_high]).all()
    found = by_band(claims, PAIRS[PAIRS.suburb == 0])
    near = found.iloc[0]
    assert near.precision == 1 / 2 and 0 < near.recall < 1
    assert np.isnan([near.precision_low, near.precision_high, near.recall_low]).all()
    assert near.pair_success == 1 and near.pair_success_low == pytest.approx(0.025)  # of one pair


def test_the_curve_has_a_point_for_each_score() -> None:
    curve = precision_recall(CLAIMS, PAIRS)
    near = curve[curve.band_m == "1-10"]
    assert list(near.threshold) == [0.9, 0.8, 0.6, 0.3]  # those of one score together
    assert list(near.precision) == pytest.approx([1, 2 / 3, 3 / 4, 4 / 5])
    assert list(near.recall) == pytest.approx([1 / 8, 2 / 8, 2 / 8, 3 / 8])
    assert list(near.in_use) == [False, False, True, False]
    far = curve[curve.band_m == "10-20"]
    assert list(far.variant) == ["sift"] and not far.in_use.any()  # all below its threshold


def test_the_point_in_use_is_what_the_summary_says() -> None:
    used = precision_recall(CLAIMS, PAIRS).query("in_use").iloc[0]
    row = by_band(CLAIMS, PAIRS).iloc[0]
    assert (used.precision, used.recall) == (row.precision, row.recall)


def test_no_claims_at_all() -> None:
    assert by_band(CLAIMS.iloc[:0], PAIRS).recall.eq(0).all()
    none = precision_recall(CLAIMS.iloc[:0], PAIRS)
    assert len(none) == 0 and {"band_m", "precision", "in_use"} <= set(none.columns)


def test_bands_are_found_in_the_same_scenes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    built: list[tuple[int, int]] = []

    def scene(seed: int, k: int) -> Scene:
        built.append((seed, k))
        return worlds.yard()

    def found(
        scenes: Scenes, n_pairs: int, spacing_m: tuple, variants: list, *, seed: int, **_: object
    ) -> tuple[pd.DataFrame, pd.DataFrame]:
        scenes.scene(seed, 0)
        drawn = [{"spacing_m": spacing_m[0], "variant": v.name} for v in variants] * n_pairs
        return pd.DataFrame([{"score": spacing_m[1]}]), pd.DataFrame(drawn)

    monkeypatch.setattr(landmark_bands, "evaluate", found)
    claims, pairs = over_distance(
        Scenes(scene, "yard"), 2, ((2.0, 4.0), (4.0, 6.5)), seed=3000, folder=tmp_path,
        rig=worlds.SMALL_RIG, variants=["sift", "sift, regions given"],
    )  # fmt: skip
    assert built == [(3000, 0)]
    assert list(pairs.band_m) == ["2-4"] * 4 + ["4-6.5"] * 4
    assert list(pairs.spacing_m) == [2.0] * 4 + [4.0] * 4
    assert list(pairs.variant[:2]) == ["sift", "sift, regions given"]
    assert list(zip(claims.band_m, claims.score, strict=True)) == [("2-4", 4.0), ("4-6.5", 6.5)]

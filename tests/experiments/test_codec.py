"""Codecs compared: identical pixels lose nothing, and counts are what they say."""

import pandas as pd
import pytest
import sights

from vrchain.errors import MissionError
from vrchain.experiments import codec
from vrchain.experiments.codec import LOSSLESS, codec_pairs, summarise
from vrchain.panorama import CameraRig, Codec

CODECS = (LOSSLESS, Codec("webp", 101), Codec("jpeg", 20))


@pytest.fixture(scope="module")
def found() -> pd.DataFrame:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(codec, "load_scene", lambda spec, seed: sights.yard())
        patch.setattr(codec, "SPACING_M", (2.0, 4.0))
        return codec_pairs("yard", 2, seed=1000, codecs=CODECS, rig=sights.RIG)


def test_without_loss_everything_is_as_it_was(found: pd.DataFrame) -> None:
    png, webp, jpeg = (found[found.codec == name] for name in ("png", "webp", "jpeg"))
    for column in ("pair", "co_visible", "right", "claims", "support"):
        assert list(png[column]) == list(webp[column])
    assert png.right.sum() > 0
    assert png.bytes.mean() > webp.bytes.mean() > jpeg.bytes.mean()
    table = summarise(found, seed=0)
    assert list(table.codec) == ["png", "webp", "jpeg"]
    for row in table[:2].itertuples():
        assert (row.kept, row.kept_low, row.kept_high, row.support_kept) == (1, 1, 1, 1)


def test_the_summary_is_of_the_same_pairs() -> None:
    rows = [
        (*coded, pair, 4, right, min(right, 1), 2, 10 * right, 1000.0, 1.0, 1.0)
        for coded, counts in {("png", 0): (2, 4), ("jpeg", 50): (1, 2)}.items()
        for pair, right in enumerate(counts)
    ]
    columns = ["codec", "quality", "pair", "co_visible", "right", "found", "claims", "support"]
    columns += ["bytes", "encode_ms", "decode_ms"]
    table = summarise(pd.DataFrame(rows, columns=columns), seed=0)
    jpeg = table[table.codec == "jpeg"].iloc[0]
    assert (jpeg.kept, jpeg.kept_low, jpeg.kept_high) == (0.5, 0.5, 0.5)  # half, in each pair
    assert (jpeg.recall, jpeg.precision, jpeg.n_pairs) == (2 / 8, 3 / 4, 2)


def test_no_pairs_are_refused() -> None:
    with pytest.raises(MissionError, match="1 pair or more"):
        codec_pairs("nothing", 0, seed=1000, rig=CameraRig())

"""A ledger's size: what the files hold, and the inline layout written or added up alike."""

import pandas as pd
import pytest

from vrchain.experiments.ledger.size import KEEP, TEAM, ledger_sizes

POSITIONS, ROBOTS, PAYLOAD_BYTES = (20, 70), (2, TEAM), 5000


@pytest.fixture(scope="module")
def sizes() -> pd.DataFrame:
    return ledger_sizes(POSITIONS, ROBOTS, PAYLOAD_BYTES)


def size(sizes: pd.DataFrame, layout: str, robots: int = TEAM, positions: int = 70) -> pd.Series:
    rows = sizes[
        (sizes.layout == layout) & (sizes.robots == robots) & (sizes.positions == positions)
    ]
    assert len(rows) == 1
    return rows.iloc[0]


def test_each_panorama_is_stored_once(sizes: pd.DataFrame) -> None:
    for robots in ROBOTS:
        one = size(sizes, "one a block", robots)
        assert one.panorama_bytes == 70 * PAYLOAD_BYTES
        assert 0 < one.size_bytes - one.panorama_bytes < 70 * 1500
    several = size(sizes, "several a block")
    assert several.panorama_bytes == 70 * PAYLOAD_BYTES
    assert several.size_bytes < size(sizes, "one a block").size_bytes


def test_retention_leaves_each_robots_newest(sizes: pd.DataFrame) -> None:
    kept = size(sizes, "retention")
    assert kept.panorama_bytes == KEEP * TEAM * PAYLOAD_BYTES
    assert size(sizes, "retention", positions=20).panorama_bytes == 20 * PAYLOAD_BYTES


def test_the_inline_layout_holds_everybodys_newest_in_every_block(sizes: pd.DataFrame) -> None:
    carried = sum(min(height, TEAM) for height in range(1, 71))
    inline = size(sizes, "inline")
    assert not inline.computed
    assert 0 < inline.size_bytes - carried * PAYLOAD_BYTES < 600 * carried


def test_what_is_over_the_limit_is_computed_and_the_same(sizes: pd.DataFrame) -> None:
    again = ledger_sizes(POSITIONS, ROBOTS, PAYLOAD_BYTES, limit_bytes=500_000)
    inline = again[again.layout == "inline"]
    assert list(inline.computed) == list(inline.size_bytes > 500_000)
    assert set(inline.computed) == {True, False}
    pd.testing.assert_frame_equal(again.drop(columns="computed"), sizes.drop(columns="computed"))


@pytest.mark.slow
def test_five_hundred_blocks_of_ten_robots(capsys: pytest.CaptureFixture[str]) -> None:
    """Panoramas of 200 kB: at most 2 % more than themselves; the inline layout beside it."""
    found = ledger_sizes((500,), (10,), 200_000)
    one, inline = (size(found, layout, 10, 500) for layout in ("one a block", "inline"))
    assert one.size_bytes <= 1.02 * one.panorama_bytes
    with capsys.disabled():
        over = one.size_bytes / one.panorama_bytes - 1
        print(f"\n500 blocks of 10 robots: {100 * over:.2f} % over the panoramas' own bytes")
        print(f"inline layout: {inline.size_bytes / one.panorama_bytes:.1f} times as many")

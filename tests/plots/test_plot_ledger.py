"""Figures of the ledger: its chain, and how large it gets."""

from pathlib import Path

import pandas as pd
import pytest
from drawn import strays, words

from vrchain.errors import LedgerError
from vrchain.experiments.ledger.regions import COLUMNS as REGIONS
from vrchain.experiments.ledger.regions import ONE, OWN
from vrchain.experiments.ledger.size import COLUMNS, TEAM
from vrchain.experiments.ledger.stores import create_ledger
from vrchain.plots.ledger import ledger_figure, ledger_size_figure, ledger_table, regions_figure


def test_sizes_that_were_computed_are_hollow() -> None:
    rows = [
        (layout, robots, positions, positions * 10**5, size * positions * robots, size == 10**6)
        for layout, size in {"inline": 10**6, "one a block": 10**5}.items()
        for robots in (2, TEAM)
        for positions in (40, 200)
    ]
    for layout in ("several a block", "retention"):
        rows.append((layout, TEAM, 200, 10**6, 2 * 10**6, False))
    sizes = pd.DataFrame(rows, columns=COLUMNS)
    figure = ledger_size_figure(sizes, "a note")
    assert strays(figure) == []
    for axes in figure.axes[:2]:
        (hollow,) = [line for line in axes.lines if line.get_markerfacecolor() == "white"]
        assert len(hollow.get_xdata()) == 2
    assert {"10 GB", "2 GB"} & set(words(figure)) and "a note" in words(figure)


def test_a_way_to_follow_regions_has_its_bars() -> None:
    rows = [(ONE, 5, 4.0, 1e6, 9e6, 50, 0, 20, 0), (OWN, 5, 1.0, 3e5, 4e6, 50, 25, 20, 2)]
    figure = regions_figure(pd.DataFrame(rows, columns=REGIONS), "a note")
    assert strays(figure) == []
    assert [len(axes.patches) for axes in figure.axes] == [2, 4]
    assert {"1 MB", "300 kB", "50.0 %", "10.0 %", "a note", OWN} <= set(words(figure))


def test_the_chain_shows_what_is_new_and_what_is_carried_over(tmp_path: Path) -> None:
    made, keys = create_ledger(tmp_path / "ledger", ("R1", "R2"), 1)
    with made as ledger:
        for number, robot in enumerate(("R1", "R1", "R2")):
            ledger.publish(robot, keys[robot], b"%d" % number, "distance", number)
        chain = list(ledger.entries())
    table = ledger_table(chain)
    assert list(table.new) == [False, False, True, False, True, False, False, True]
    assert list(table.hash[:6:2]) == list(table.previous_hash[2::2])
    carried = table[(table.height == 3) & (table.robot == "R1")].newest_transaction.item()
    assert carried == table[(table.height == 2) & (table.robot == "R1")].newest_transaction.item()
    figure = ledger_figure(chain)
    assert strays(figure) == []
    texts = words(figure)
    for entry in chain:
        assert f"{entry.block.hash.hex()[:8]}…" in texts
    assert texts.count("R1 no. 1 (distance)") == 2 and texts.count("R2: nothing yet") == 3
    late = words(ledger_figure(chain[-1:]))
    assert late.count("R1: an earlier one") == 1 and "R1: nothing yet" not in late
    with pytest.raises(LedgerError, match="got none"):
        ledger_figure([])

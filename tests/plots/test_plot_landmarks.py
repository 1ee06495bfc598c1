"""Pictures of proposals and of mistakes: what is in them, by their artists."""

import numpy as np
import sights
from matplotlib.patches import Rectangle

from vrchain.experiments.landmarks.mistakes import Mistake
from vrchain.geometry import Pose
from vrchain.landmarks.extraction.proposer import KINDS, Proposals, nothing
from vrchain.landmarks.matching.common import CommonLandmark, Region
from vrchain.plots.landmarks import mistakes_figure, proposals_figure, proposals_table

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

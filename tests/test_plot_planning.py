"""The planner's figure: every method in every panel, the published shares where they belong."""

from test_plots import strays

from vrchain.experiments.planning import METHODS, PUBLISHED_SHARES, blocked_drives, shares
from vrchain.plots.planning import planning_figure


def test_every_method_is_in_every_panel() -> None:
    figure = planning_figure(shares(blocked_drives(2, 3, seed=3000), seed=3000))
    assert strays(figure) == []
    assert [axes.get_title() for axes in figure.axes] == ["1 drive", "2 drives", "3 drives"] * 2
    for k, axes in enumerate(figure.axes):
        labels = {str(line.get_label()) for line in axes.lines}
        assert set(METHODS) <= labels
        published = {f"published: {name}" for name in PUBLISHED_SHARES}
        assert published & labels == (published if k == 0 else set())
    (legend,) = figure.legends
    assert len({text.get_text() for text in legend.get_texts()}) == len(METHODS) + 3

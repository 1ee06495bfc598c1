"""The planner's figure: every method in every panel, the published shares where they belong."""

from drawn import strays

from vrchain.experiments.planning.lost_segments import METHODS, blocked_drives, shares
from vrchain.experiments.planning.published_drives import PUBLISHED, by_team, one_drive
from vrchain.plots.planning import TEAMS_SHOWN, planning_figure


def test_every_method_is_in_every_panel() -> None:
    once = one_drive(2, 3, seed=3000, teams=TEAMS_SHOWN)
    again = shares(blocked_drives(2, 3, seed=3000), seed=3000)
    figure = planning_figure(again, by_team(once, seed=3000))
    assert strays(figure) == []
    titles = [axes.get_title() for axes in figure.axes]
    assert titles[:3] == ["1 drive, 10 robots", "1 drive, 40 robots", "1 drive, 90 robots"]
    assert titles[3:] == ["1 drive", "2 drives", "3 drives"] * 2
    for k, axes in enumerate(figure.axes):
        lines = {str(line.get_label()): line for line in axes.lines}
        assert set(METHODS[2:] if k < 3 else METHODS) <= set(lines)
        published = {f"{name}: published" for name in PUBLISHED}
        assert published & set(lines) == (published if k < 3 else set())
    squares = figure.axes[1].lines[0]
    assert squares.get_ydata().tolist() == next(iter(PUBLISHED.values()))[40].tolist()
    (legend,) = figure.legends
    assert len({text.get_text() for text in legend.get_texts()}) == len(METHODS) + 5

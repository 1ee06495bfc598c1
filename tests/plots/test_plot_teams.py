"""The chain on the map and as a graph: every robot and landmark drawn, the chain heavier."""

import numpy as np
import pytest
from drawn import strays, words
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse
from worlds import blotches, box, world

from vrchain.errors import MissionError
from vrchain.geometry import Pose
from vrchain.plots.teams import chain_map, chain_of, team_graph
from vrchain.simulation.sightings import Sightings
from vrchain.world.model import Scene

ROBOTS = {"R1": Pose(-12.0, 0.0), "R2": Pose(0.0, 0.0, 1.0), "R3": Pose(12.0, 0.0, 2.0)}
SEEN = Sightings(
    {"R1": ("oak", "cart", "fence"), "R2": ("oak", "elm", "fence"), "R3": ("elm", "barn")},
    {("R1", "R2"): ("oak",), ("R2", "R3"): ("elm",)},
)
CHAIN = ["R1", "oak", "R2", "elm", "R3", "barn"]


@pytest.fixture(scope="module")
def farm() -> Scene:
    places = {"oak": (-6, 4), "cart": (-14, -4), "elm": (6, 4), "barn": (16, 8), "fence": (-6, -6)}
    return world(*(box(n, xy, (2.0, 1.0, 2.0), blotches(n)) for n, xy in places.items()))


def sight_lines(figure: Figure) -> list[Line2D]:
    return [line for axes in figure.axes for line in axes.lines]


def test_a_chain_joins_neighbours_by_what_they_share() -> None:
    assert chain_of(list(ROBOTS), SEEN, "barn") == CHAIN
    assert chain_of(list(ROBOTS), SEEN, None) == CHAIN[:-1]
    assert chain_of(list(ROBOTS), SEEN, "cart") == CHAIN[:-1]  # R3 does not see it
    cut = Sightings(SEEN.visible, {("R1", "R2"): ("oak",)})
    assert chain_of(list(ROBOTS), cut, "barn") == ["R1", "oak", "R2"]


def test_without_a_chain_one_line_says_so(farm: Scene) -> None:
    for robots, said in (([], "one or more robots, got none"), (["R1", "R9"], "R2, R3, got R9")):
        with pytest.raises(MissionError, match=said):
            chain_of(robots, SEEN, "barn")
    for draw in (lambda: chain_map(farm, ROBOTS, SEEN, []), lambda: team_graph(["R1"], SEEN, [])):
        with pytest.raises(MissionError, match="expected a chain"):
            draw()


def test_the_map_draws_each_sight_once_and_the_chain_heavier(farm: Scene) -> None:
    figure = chain_map(farm, ROBOTS, SEEN, CHAIN)
    assert strays(figure) == []
    widths = [line.get_linewidth() for line in sight_lines(figure)]
    assert sorted(widths) == sorted([0.7] * 3 + [3.2] * 5)
    assert {"R1", "R2", "R3", "L12: box", "L23: box", "box (the goal)"} <= set(words(figure))
    ellipses = figure.findobj(Ellipse)
    assert sorted(e.get_center() for e in ellipses) == [
        (-14, -4), (-6, -6), (-6, 4), (6, 4), (16, 8),
    ]  # fmt: skip
    joined = {tuple(map(tuple, np.round(line.get_xydata(), 6))) for line in sight_lines(figure)}
    assert ((-12.0, 0.0), (-6.0, 4.0)) in joined and ((12.0, 0.0), (16.0, 8.0)) in joined


def test_an_ellipse_lies_along_its_landmark() -> None:
    turned = world(box("cart", (3.0, 2.0), (6.0, 2.0, 1.0), blotches("cart"), yaw_rad=0.5))
    seen = Sightings({"R1": ("cart",)}, {})
    figure = chain_map(turned, {"R1": Pose(-5.0, 0.0)}, seen, ["R1", "cart"])
    (ellipse,) = figure.findobj(Ellipse)
    long, short = sorted((ellipse.width, ellipse.height), reverse=True)
    assert (long, short) == pytest.approx((1.25 * 6.1, 1.25 * 2.1), rel=0.01)
    along = ellipse.angle + (0 if ellipse.width > ellipse.height else 90)
    assert (along - np.degrees(0.5) + 90) % 180 - 90 == pytest.approx(0, abs=0.5)


def test_the_graph_hangs_on_each_robot_what_it_alone_sees() -> None:
    figure = team_graph(list(ROBOTS), SEEN, CHAIN)
    assert strays(figure) == []
    texts = words(figure)
    for once in ("R1", "R2", "R3", "L12\noak", "L23\nelm", "goal\nbarn", "cart"):
        assert texts.count(once) == 1
    assert texts.count("fence") == 2  # both see it, from different sides
    dashed = [e for e in figure.findobj(Ellipse) if e.get_linestyle() == "--"]
    assert len(dashed) == 2
    heavy = [line for line in sight_lines(figure) if line.get_linewidth() > 3]
    assert len(heavy) == 5
    assert len(sight_lines(figure)) == 8


def test_a_graph_without_a_chain_still_shows_the_team() -> None:
    alone = Sightings({"R1": ("oak",), "R2": ()}, {})
    figure = team_graph(["R1", "R2"], alone, ["R1"])
    assert {"R1", "R2", "oak"} <= set(words(figure))
    assert [line.get_linewidth() for line in sight_lines(figure)] == [0.7]


def test_robots_that_are_no_neighbours_may_share_a_landmark() -> None:
    seen = Sightings(
        {"R1": ("oak",), "R2": ("elm",), "R3": ("oak", "elm")},
        {("R1", "R3"): ("oak",), ("R2", "R3"): ("elm",)},
    )
    figure = team_graph(list(ROBOTS), seen, ["R1"])
    assert strays(figure) == []
    assert {"L13\noak", "L23\nelm"} <= set(words(figure))
    assert len(sight_lines(figure)) == 4

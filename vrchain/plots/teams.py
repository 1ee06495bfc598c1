"""A team and what it sees, in the paper's manner: its map, and its graph.

Robots are triangles, landmarks ellipses; sight lines are thin, those of the chain heavy.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse, Patch
from numpy.typing import NDArray

from vrchain.errors import MissionError
from vrchain.geometry import Pose
from vrchain.plots.maps import draw_ground, draw_robot, zoom_to
from vrchain.plots.style import PAGE_CM, WHITE_BOX, legend_below, panels, robot_colour
from vrchain.simulation.sightings import Sightings
from vrchain.world.model import Scene, SceneObject

_CHAIN_COLOUR = "#c2185b"
_SIGHT_COLOUR = "#7a8694"
_LANDMARK_COLOUR = "#e8e2cf"
_COMMON_COLOUR = "#ffd54f"
_WALL_COLOUR = "#3a3a3a"
_THIN_LW, _HEAVY_LW = 0.7, 3.2
_SCREENS = ("wall", "hedge", "fence")  # long and narrow: as they stand, not as an ellipse


def chain_of(robots: Sequence[str], sightings: Sightings, goal: str | None) -> list[str]:
    """Robots and landmarks from the first robot to the goal: R1, shed, R2, ... barn.

    It ends where two neighbours have nothing in common, or with the last robot if that does not see
    the goal. Raises MissionError without robots, or for one of which no sightings are known.
    """
    if not robots:
        raise MissionError(
            "expected one or more robots, got none: a scene that has none of its own needs them "
            "named, as in {'R1': vr.Pose(0, 0), 'R2': vr.Pose(9, 0)}"
        )
    if unknown := [robot for robot in robots if robot not in sightings.visible]:
        raise MissionError(
            f"expected robots of {', '.join(sightings.visible)}, got {', '.join(unknown)}"
        )
    chain = [robots[0]]
    for a, b in pairwise(robots):
        shared = sightings.common.get((a, b))
        if not shared:
            return chain
        chain += [shared[0], b]
    return [*chain, goal] if goal in sightings.visible[robots[-1]] else chain


def chain_map(
    scene: Scene,
    robots: Mapping[str, Pose],
    sightings: Sightings,
    chain: Sequence[str],
    labels: Mapping[str, str] | None = None,
) -> Figure:
    """The map: who stands where, what each sees, and the chain to the last of ``chain``.

    chain: robots and landmarks in turn, as ``chain_of`` gives them. MissionError for none.
    labels: of landmarks, if they are not to be counted anew.
    """
    _check_chain(chain)
    figure, axes = panels(8.6, 8.8)
    draw_ground(axes, scene)
    own = sightings.labels()
    labels = {name: (labels or own)[name] for name in own}
    places = {name: pose.xy_m for name, pose in robots.items()}
    seen = {n for names in sightings.visible.values() for n in names}
    for thing in (o for o in scene.objects if o.landmark):
        places[thing.name] = _draw_landmark(axes, thing, thing.name in {*labels, chain[-1]})
    links = {frozenset(link) for link in pairwise(chain)}
    for robot, names in sightings.visible.items():
        for name in names:
            if frozenset((robot, name)) not in links:
                _line(axes, places[robot], places[name], heavy=False)
    for a, b in pairwise(chain):
        _line(axes, places[a], places[b], heavy=True)
    for k, (name, pose) in enumerate(robots.items()):
        draw_robot(axes, name, pose, robot_colour(k), size_m=1.9)
    for name in dict.fromkeys([*labels, chain[-1]]):
        if name in robots:
            continue
        thing = scene.objects[scene.index_of(name)]
        (x_m, y_m), text = places[name], f"{thing.kind} (the goal)"
        if name in labels:  # beside its ellipse; a goal is large enough to bear its name
            y_m, text = thing.bounds_m[0, 1] - 1.2, f"{labels[name]}: {thing.kind}"
        style: dict[str, Any] = {"fontsize": 7.5, "color": _WALL_COLOUR, "zorder": 7}
        if name in chain:
            style = {"fontsize": 9, "color": _CHAIN_COLOUR, "fontweight": "bold", "zorder": 8}
        axes.text(x_m, y_m, text, ha="center", va="top", bbox=WHITE_BOX, **style)
    corners = [scene.objects[scene.index_of(n)].bounds_m[:, :2] for n in sorted(seen)]
    zoom_to(axes, np.concatenate([*corners, [p.xy_m for p in robots.values()]]), margin_m=3.0)
    axes.set_title(f"{scene.name}: {' - '.join(labels.get(n, n) for n in chain)}")
    wall = Line2D([], [], color=_WALL_COLOUR, lw=3, label="wall or fence")
    legend_below(figure, _handles(wall), 5)
    return figure


def team_graph(robots: Sequence[str], sightings: Sightings, chain: Sequence[str]) -> Figure:
    """Robots in a row, common landmarks between them, each robot's other landmarks hanging on it.

    A dashed one is seen by another robot too, but not the same side of it. Raises MissionError
    for an empty chain.
    """
    _check_chain(chain)
    figure, axes = panels(4.8 * len(robots) + 1.6, 5.4, print_cm=PAGE_CM)
    labels, goal = sightings.labels(), chain[-1]
    at = {name: np.array([4.8 * k, 0.0]) for k, name in enumerate(robots)}
    links = {frozenset(link) for link in pairwise(chain)}
    drawn: set[str] = set()
    for (a, b), names in sightings.common.items():
        apart = robots.index(b) - robots.index(a)
        for k, name in enumerate(names):
            if name not in drawn:
                rise = 2.6 * (apart - 1) + 0.8 * (k - (len(names) - 1) / 2)
                at[name] = (at[a] + at[b]) / 2 + (0.0, rise)
                _node(axes, at[name], f"{labels[name]}\n{_words(name)}", _COMMON_COLOUR, 1.25)
                drawn.add(name)
            for robot in (a, b):
                _line(axes, at[robot], at[name], heavy=frozenset((robot, name)) in links)
    for robot in robots:
        others = sightings.others(robot)
        if goal in others and frozenset((robot, goal)) in links:
            others.remove(goal)
            at[goal] = at[robot] + (2.4, 0.0)
            _line(axes, at[robot], at[goal], heavy=True)
            _node(axes, at[goal], f"goal\n{_words(goal)}", _COMMON_COLOUR, 1.25)
        for name, place in zip(others, _hanging(len(others)), strict=True):
            _line(axes, at[robot], at[robot] + place, heavy=False)
            elsewhere = any(name in sightings.visible[r] for r in robots if r != robot)
            _node(axes, at[robot] + place, _words(name), _LANDMARK_COLOUR, 0.86, dashed=elsewhere)
    for k, robot in enumerate(robots):
        corners = at[robot] + 0.42 * np.array([(0, 1.15), (-1, -0.75), (1, -0.75)])
        axes.fill(*corners.T, facecolor=robot_colour(k), edgecolor="white", lw=1.2, zorder=6)
        axes.text(
            at[robot][0], at[robot][1] - 0.03, robot, color="white", ha="center", va="center",
            fontsize=11, fontweight="bold", zorder=7,
        )  # fmt: skip
    axes.set_aspect("equal")
    axes.autoscale_view()
    axes.margins(0.02)
    axes.set_axis_off()
    dashed = Patch(fc=_LANDMARK_COLOUR, ec="black", ls="--", label="seen by two, not the same side")
    legend_below(figure, _handles(dashed), 5)
    return figure


def _check_chain(chain: Sequence[str]) -> None:
    if not chain:
        raise MissionError("expected a chain of robots and landmarks to draw, got an empty one")


def _words(name: str) -> str:
    """A landmark's name as two short lines at most: water tower, wall 01."""
    return name.replace("_", " ")


def _hanging(n: int) -> NDArray[np.float64]:
    """Places, (n, 2), around a robot: half of them above it, half below, none beside it."""
    above, places = (n + 1) // 2, []
    for count, sign in ((above, 1), (n - above, -1)):
        x = np.linspace(-1, 1, count) * min(1.75, 0.5 * (count - 1))
        places.append(np.column_stack([x, sign * (1.95 - 0.28 * x**2)]))
    return np.concatenate(places)


def _node(
    axes: Axes,
    at_xy: NDArray[np.float64],
    text: str,
    colour: str,
    width: float,
    dashed: bool = False,
) -> None:
    axes.add_patch(
        Ellipse(
            tuple(at_xy), width, 0.62 * width, facecolor=colour, edgecolor="black", lw=0.9,
            linestyle="--" if dashed else "-", zorder=4,
        )
    )  # fmt: skip
    axes.text(at_xy[0], at_xy[1], text, ha="center", va="center", fontsize=8, zorder=5)


def _line(axes: Axes, a_xy: NDArray[np.float64], b_xy: NDArray[np.float64], *, heavy: bool) -> None:
    axes.plot(
        *np.array([a_xy, b_xy]).T, color=_CHAIN_COLOUR if heavy else _SIGHT_COLOUR,
        lw=_HEAVY_LW if heavy else _THIN_LW, zorder=3.5 if heavy else 3, solid_capstyle="round",
    )  # fmt: skip


def _draw_landmark(axes: Axes, thing: SceneObject, chosen: bool) -> NDArray[np.float64]:
    """A landmark as an ellipse around its footprint, a wall as it stands; its middle."""
    footprint = thing.footprint.buffer(0.05)
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(footprint))
    if thing.kind in _SCREENS:
        axes.fill(*corners.T, color=_WALL_COLOUR, lw=1.2, zorder=3.2)
        return np.asarray(footprint.centroid.coords[0])
    middle, along, across = (
        corners[:4].mean(axis=0),
        corners[1] - corners[0],
        corners[2] - corners[1],
    )
    width_m, height_m = (max(1.25 * float(np.hypot(*side)), 1.2) for side in (along, across))
    axes.add_patch(
        Ellipse(
            tuple(middle), width_m, height_m, angle=float(np.degrees(np.arctan2(*along[::-1]))),
            facecolor=_COMMON_COLOUR if chosen else _LANDMARK_COLOUR, edgecolor="black",
            lw=1.3 if chosen else 0.8, zorder=4,
        )
    )  # fmt: skip
    return np.asarray(middle)


def _handles(other: Artist) -> list[Artist]:
    """A legend's; ``other``: what only this figure has."""
    fill = _LANDMARK_COLOUR
    return [
        Line2D([], [], marker=(3, 0, 0), ls="", ms=10, color=robot_colour(0), label="robot"),
        Line2D([], [], marker="o", ls="", ms=9, mfc=fill, mec="black", label="landmark"),
        other,
        Line2D([], [], color=_SIGHT_COLOUR, lw=_THIN_LW, label="sees"),
        Line2D([], [], color=_CHAIN_COLOUR, lw=_HEAVY_LW, label="the chain to the goal"),
    ]

"""A mission in pictures: the map with the driven path, and what each decision rested on."""

from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vrchain.geometry import Pose
from vrchain.landmarks.matching.common import Region
from vrchain.navigation.planning.route import Route
from vrchain.navigation.settings import robot_of
from vrchain.panorama import Codec, Panorama, encode_png
from vrchain.plots.maps import draw_robot, draw_scene, zoom_to
from vrchain.plots.pictures import common_landmarks_figure, region_box, show_panorama
from vrchain.plots.save import png_bytes
from vrchain.plots.style import WHITE_BOX, claim_colour, label, outline, robot_colour, tag
from vrchain.simulation.mission import MissionRun

_SHOWN = Codec("jpeg", 85)  # to be looked at, not compared
_GOAL_COLOUR = "#ff2d95"
_NAMED_M = 3.0  # what is less wide has no name on the map
_LABEL_DEG = 5.0  # of height above a box; a label that has less room is put inside


class Row(NamedTuple):
    """A panorama; marks: label, colour and region of what is to be pointed out in it."""

    title: str
    panorama: Panorama
    marks: tuple[tuple[str, str, Region], ...] = ()


def save_pictures(run: MissionRun, folder: Path) -> None:
    """What decisions rest on: goal_N.png as given, look_K.jpg, plan_P_leg_L.png; mission.png."""
    (folder / "mission.png").write_bytes(png_bytes(mission_figure(run)))
    for k in sorted({d.look for d in run.result.decisions if d.look is not None}):
        (folder / f"look_{k}.jpg").write_bytes(_SHOWN.encode(run.result.looks[k].cylinder))
    for number, picture in enumerate(run.pictures, 1):
        (folder / f"goal_{number}.png").write_bytes(encode_png(picture.views[0]))
    for plan_number, (look, route) in enumerate(run.result.plans, 1):
        for leg_number, leg in enumerate(route.legs, 1):
            a, b = (_seen(run, name, look) for name in (leg.seen_by, leg.next_by))
            titles = f"{leg.seen_by} sees", f"{leg.next_by} sees"
            figure = common_landmarks_figure(a.cylinder, b.cylinder, [leg.landmark], a.rig, titles)
            figure.suptitle(f"plan {plan_number}, leg {leg_number}: the landmark to drive to")
            (folder / f"plan_{plan_number}_leg_{leg_number}.png").write_bytes(png_bytes(figure))


def mission_figure(run: MissionRun) -> Figure:
    """The map beside the chain: what each robot of the (last) plan saw, and the end."""
    figure = Figure(figsize=(15, 7.2), layout="constrained")
    grid = figure.add_gridspec(1, 2, width_ratios=[1, 1.55])
    draw_mission_map(figure.add_subplot(grid[0]), run)
    rows = chain_rows(run, *run.result.plans[-1]) if run.result.plans else []
    if run.result.looks:
        rows.append(Row(f"{run.robot}'s last look around", run.result.looks[-1]))
    right = grid[1].subgridspec(max(len(rows), 3), 1)  # one alone would be drawn out of shape
    for i, row in enumerate(rows):
        axes = figure.add_subplot(right[i])
        draw_row(axes, row)
        if i < len(rows) - 1:
            axes.set_xlabel("")
    outcome = "it arrived" if run.result.arrived else f"it gave up: {run.result.reason}"
    figure.suptitle(
        f"The goal of {run.robot}: {run.task.goal}; {outcome}, {run.range_m:.1f} m from it",
        fontsize=13,
    )
    return figure


def draw_mission_map(axes: Axes, run: MissionRun) -> None:
    """The goal, the team where it ended, and the robots' paths."""
    draw_stage(axes, run)
    for index, (name, place) in enumerate(run.task.places.items()):
        path, colour, drives = run.paths_xy_m[name], robot_colour(index), name == run.robot
        axes.plot(*path.T, color=colour, lw=2.2 if drives else 1.0, zorder=5)
        at = place if drives else Pose(float(path[-1, 0]), float(path[-1, 1]), place.yaw_rad)
        draw_robot(axes, name, at, colour, size_m=0.9)
    axes.plot(*run.final_pose.xy_m, "o", color=robot_colour(0), mec="white", ms=9, zorder=7)
    axes.set_title(f"path of {run.robot} (thick; dot: its end)", fontsize=10)


def draw_stage(axes: Axes, run: MissionRun) -> None:
    """The scene around places, path and goal; named is the goal, and what else it has once."""
    draw_scene(axes, run.scene)
    kinds = Counter(o.kind for o in run.scene.objects if o.landmark)
    for thing in run.scene.objects:
        (x0, y0), (x1, _) = thing.bounds_m[:, :2]
        alone = thing.landmark and kinds[thing.kind] == 1 and thing.name != run.task.goal
        if alone and x1 - x0 >= _NAMED_M:
            label(
                axes, thing.kind, ((x0 + x1) / 2, y0), (0, -2), ha="center", va="top", fontsize=9,
                zorder=4, annotation_clip=True,
            )  # fmt: skip
    goal = run.scene.objects[run.scene.index_of(run.task.goal)]
    corners = goal.bounds_m[:, :2]
    outline(axes, corners.ravel(), _GOAL_COLOUR, lw=2.5, zorder=5)
    axes.annotate(
        "goal", tuple(corners.mean(axis=0)), ha="center", va="center", zorder=8,
        color=_GOAL_COLOUR, fontweight="bold", bbox=WHITE_BOX,
    )  # fmt: skip
    places = np.array([p.xy_m for p in run.task.places.values()])
    zoom_to(axes, np.concatenate([places, corners, run.paths_xy_m[run.robot]]), margin_m=4.0)


def paths_table(run: MissionRun) -> pd.DataFrame:
    """True positions of every robot after each step: robot, step, x_m, y_m."""
    tables = [
        pd.DataFrame(
            {"robot": name, "step": range(len(path)), "x_m": path[:, 0], "y_m": path[:, 1]}
        )
        for name, path in run.paths_xy_m.items()
    ]
    return pd.concat(tables, ignore_index=True)


def chain_rows(run: MissionRun, look: int, route: Route) -> list[Row]:
    """What each robot of a plan saw, with the landmarks that it has in common with the next."""
    rows = []
    for i, name in enumerate(route.robots):
        marks = []
        if i > 0:
            marks.append((f"L{i}{i + 1}", claim_colour(i - 1), route.legs[i - 1].landmark.b))
        if i < len(route.legs):
            marks.append((f"L{i + 1}{i + 2}", claim_colour(i), route.legs[i].landmark.a))
        if name == route.seen_by:
            goal = route.sighting
            region = Region(0, (0, 0, 0, 0), goal.bearing_rad, 2 * goal.half_width_rad)
            marks.append(("goal", _GOAL_COLOUR, region))
        rows.append(Row(f"{name} sees", _seen(run, name, look), tuple(marks)))
    return rows


def draw_row(axes: Axes, row: Row) -> None:
    """A panorama with what is marked in it."""
    show_panorama(axes, row.panorama, row.title, loc="left")
    for name, colour, region in row.marks:
        _mark(axes, row.panorama, region, name, colour)


def _seen(run: MissionRun, name: str, look: int) -> Panorama:
    return run.result.looks[look] if robot_of(name) == run.robot else run.panoramas[name]


def _mark(axes: Axes, panorama: Panorama, region: Region, name: str, colour: str) -> None:
    """A box on a panorama whose axes are degrees."""
    if region.bearing_rad is None or region.angular_size_rad is None:
        return
    centre, width = np.degrees([region.bearing_rad, region.angular_size_rad])
    rig, edge = panorama.rig, axes.get_ylim()[1]
    if region.box_px[3] > region.box_px[1]:
        _, y0, _, y1 = region_box(region, rig)
        top, bottom = np.degrees(np.arctan(rig.slope_of_row(np.array([y0, y1]))))
    else:  # known by its bearing and width alone
        top, bottom = edge - 1.0, -6.0
    for left in (centre + width / 2 + turn for turn in (-360.0, 0.0, 360.0)):
        if not -180.0 < left < 180.0 + width:  # the panorama begins again behind the robot
            continue
        outline(axes, (left - width, bottom, left, top), colour)
        va = "top" if top > edge - _LABEL_DEG else "bottom"
        tag(axes, name, min(left, 180.0), min(top, edge), colour, fontsize=8, va=va)

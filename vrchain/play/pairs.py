"""Move two robots apart, and watch which of what both see they find, and why not the rest."""

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from vrchain.experiments.landmarks.missed import found_and_missed
from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.landmarks.extraction.record import examine
from vrchain.panorama import CameraRig
from vrchain.play.controls import WIDTH_IN, Play, Shown, Slider
from vrchain.play.driving import SMALL
from vrchain.play.ground import draw_map
from vrchain.plots.maps import draw_robot, zoom_to
from vrchain.plots.pictures import region_box, show_panorama
from vrchain.plots.style import GREEN, RED, WHITE_BOX, panels, robot_colour
from vrchain.world.model import Scene
from vrchain.world.render import Renderer
from vrchain.world.truth import GroundTruth

_LEAST_M, _MOST_M, _FIRST_M = 1, 40, 5


def apart(scene: Scene, first: Pose, rig: CameraRig = SMALL) -> Play:
    """R1 stands at ``first``, R2 so far from it, that way, turned so: what they find in common.

    At the start R2 is 5 m west of R1, or another way if it cannot stand there.

    By truth, green lines lead to landmarks that both see and that were found, red ones to those
    that were not; the table says where each was lost. PoseError where a robot cannot stand;
    LearnedError without torch.
    """
    scene.check_pose(first)
    renderer, truth = Renderer(scene), GroundTruth(scene)
    seen_a = renderer.render(first, rig)
    record_a = examine(seen_a)

    def stands_at(distance_m: float, direction_deg: float) -> NDArray[np.float64]:
        towards_rad = np.radians(direction_deg)
        return first.xy_m + distance_m * np.array([np.cos(towards_rad), np.sin(towards_rad)])

    def draw(distance_m: float, direction_deg: float, turned_deg: float) -> Shown:
        x_m, y_m = stands_at(distance_m, direction_deg)
        yaw_rad = float(wrap_angle_rad(first.yaw_rad + np.radians(turned_deg)))
        second = Pose(float(x_m), float(y_m), yaw_rad)
        scene.check_pose(second)
        seen_b = renderer.render(second, rig)
        poses = first, second
        comparison, table = found_and_missed(record_a, examine(seen_b), truth, poses)
        figure, axes = panels(WIDTH_IN, 10.5, 3, 1, height_ratios=[1, 1, 3])
        claims = comparison.common[:8]
        for place, panorama in enumerate((seen_a, seen_b)):
            show_panorama(axes[place], panorama, f"R{place + 1} sees (numbers: claims)", "left")
            for number, claim in enumerate(claims, 1):
                region = (claim.a, claim.b)[place]
                if region.bearing_rad is None:
                    continue
                x0, _, x1, _ = region_box(region, rig)
                at = float(np.degrees(rig.bearing_of_column(np.array([(x0 + x1) / 2]))[0]))
                axes[place].text(
                    at, 0, str(number), ha="center", va="center", fontsize=9, color="black",
                    bbox={"facecolor": "#ffd400", "edgecolor": "none", "pad": 1.0},
                )  # fmt: skip
        axes[0].set_xlabel("")
        _draw_lines(axes[2], scene, poses, dict(zip(table.landmark, table.found, strict=True)))
        right = int(table.found.sum())
        claimed = len(comparison.common)
        says = (
            f"{distance_m:g} m apart both robots see {len(table)} landmarks. They claim {claimed} "
            f"in common; **{right} of the {len(table)} are found**. The table says why the others "
            "are not."
        )
        return Shown(says, figure, table.sort_values("found", ignore_index=True))

    ways_deg = [180, *range(135, -180, -45)]
    free = [way_deg for way_deg in ways_deg if scene.is_free(stands_at(_FIRST_M, way_deg)).all()]
    return Play(
        draw,
        {
            "distance_m": Slider("apart (m)", _LEAST_M, _MOST_M, 1, _FIRST_M),
            "direction_deg": Slider("R2 is towards (°)", -180, 180, 5, (free or ways_deg)[0]),
            "turned_deg": Slider("R2 turned by (°)", -180, 180, 5, 0),
        },
    )


def _draw_lines(axes: Axes, scene: Scene, poses: tuple[Pose, Pose], found: dict[str, bool]) -> None:
    """The map with both robots and a line from each to every landmark that both see."""
    draw_map(axes, scene)
    middles = [scene.objects[scene.index_of(n)].bounds_m.mean(axis=0)[:2] for n in found]
    for is_found, middle in zip(found.values(), middles, strict=True):
        for pose in poses:
            axes.plot(
                *np.array([pose.xy_m, middle]).T, color=GREEN if is_found else RED, zorder=5,
                lw=1.8 if is_found else 0.9, ls="-" if is_found else "--",
            )  # fmt: skip
    for (name, is_found), middle in zip(found.items(), middles, strict=True):
        axes.text(
            float(middle[0]), float(middle[1]), name, ha="center", va="center", fontsize=8,
            color=GREEN if is_found else RED, bbox=WHITE_BOX, zorder=6, clip_on=True,
        )  # fmt: skip
    for number, pose in enumerate(poses):
        draw_robot(axes, f"R{number + 1}", pose, robot_colour(number))
    zoom_to(axes, np.array([*(p.xy_m for p in poses), *middles]), margin_m=4.0)
    axes.set_title("both see it: found (solid), not found (dashed)", fontsize=10)

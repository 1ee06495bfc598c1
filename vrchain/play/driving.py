"""Drive a robot on the map, and see its panorama change."""

from dataclasses import replace

import numpy as np

from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.panorama import CameraRig, view_change
from vrchain.play.controls import WIDTH_IN, Play, Shown, Slider
from vrchain.play.ground import draw_map
from vrchain.plots.maps import draw_robot, zoom_to
from vrchain.plots.pictures import show_panorama
from vrchain.plots.style import GREY, panels, robot_colour
from vrchain.robot import UpdateRules
from vrchain.world.model import Scene
from vrchain.world.render import Renderer

SMALL = CameraRig(width_px=320, height_px=240)
_AROUND_M = 25.0


def place_controls(scene: Scene, start: Pose) -> dict[str, Slider]:
    """Where a robot stands: x_m, y_m, heading_deg."""
    x, y = (float(np.floor(extent_m / 2 - 1)) for extent_m in scene.extent_m)
    heading_deg = float(np.degrees(wrap_angle_rad(start.yaw_rad)))
    return {
        "x_m": Slider("x, east (m)", -x, x, 0.5, start.x_m),
        "y_m": Slider("y, north (m)", -y, y, 0.5, start.y_m),
        "heading_deg": Slider("heading (degrees)", -180, 180, 5, round(heading_deg)),
    }


def drive(scene: Scene, start: Pose, rig: CameraRig = SMALL) -> Play:
    """A robot on the map and what it sees; how much that differs from what it saw at ``start``.

    PoseError where it cannot stand.
    """
    scene.check_pose(start)
    renderer = Renderer(scene)
    first = renderer.render(start, rig)
    rules = UpdateRules()

    def draw(x_m: float, y_m: float, heading_deg: float) -> Shown:
        pose = replace(start, x_m=x_m, y_m=y_m, yaw_rad=float(np.radians(heading_deg)))
        scene.check_pose(pose)
        panorama = renderer.render(pose, rig)
        change = view_change(first.signature(), panorama.signature())
        driven_m = start.distance_to_m(pose.xy_m)
        figure, (strip, above) = panels(WIDTH_IN, 8.0, 2, 1, height_ratios=[1, 3])
        show_panorama(strip, panorama, "what R1 sees, all around; ahead is in the middle")
        draw_map(above, scene)
        above.plot(*start.xy_m, "o", color=GREY, ms=7, zorder=5)
        draw_robot(above, "R1", pose, robot_colour(0))
        zoom_to(above, np.array([start.xy_m, pose.xy_m]), margin_m=_AROUND_M)
        above.set_title("from above (R1 never gets this map); dot: its last panorama", fontsize=10)
        publishes = driven_m >= rules.distance_m or change >= rules.view_change
        says = (
            f"{driven_m:.1f} m from its last panorama, the view has changed by {change:.2f}. "
            f"A robot publishes after {rules.distance_m:g} m, or when the view has changed by "
            f"{rules.view_change:g}: **{'it publishes' if publishes else 'not yet'}**."
        )
        return Shown(says, figure)

    return Play(draw, place_controls(scene, start))

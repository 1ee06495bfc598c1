"""Home vectors from where one stands the robot: which way home lies, by each method."""

import numpy as np
from matplotlib.patches import Wedge

from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.homing import METHODS, HomeVector, snapshot, step
from vrchain.panorama import CameraRig
from vrchain.play.controls import WIDTH_IN, Choice, Play, Shown, Slider
from vrchain.play.driving import SMALL
from vrchain.play.ground import draw_map
from vrchain.plots.maps import draw_robot, zoom_to
from vrchain.plots.pictures import show_panorama
from vrchain.plots.style import BLUE, GREY, RED, panels, robot_colour
from vrchain.world.model import Scene
from vrchain.world.render import Renderer

_REACH_M, _ARROW_M = 12, 2.0


def homing(scene: Scene, home: Pose, rig: CameraRig = SMALL) -> Play:
    """A robot east_m and north_m of ``home``, with its home vector, and what it compares.

    The arrow is the answer, its fan one standard deviation; dashed is the truth. PoseError where
    it cannot stand.
    """
    scene.check_pose(home)
    renderer = Renderer(scene)
    seen_home = renderer.render(home, rig)
    known = snapshot(seen_home)

    def draw(east_m: float, north_m: float, turned_deg: float, method: str) -> Shown:
        yaw_rad = float(wrap_angle_rad(home.yaw_rad + np.radians(turned_deg)))
        here = Pose(home.x_m + east_m, home.y_m + north_m, yaw_rad)
        scene.check_pose(here)
        seen = renderer.render(here, rig)
        vector = step(method, snapshot(seen), known)
        figure, (now, then, above) = panels(WIDTH_IN, 9.5, 3, 1, height_ratios=[1, 1, 3])
        show_panorama(now, seen, "what R1 sees here", "left")
        show_panorama(then, seen_home, "what it saw at home", "left")
        now.set_xlabel("")
        draw_map(above, scene)
        above.plot(*home.xy_m, "*", color=RED, mec="white", ms=18, zorder=7)
        above.plot(*np.array([here.xy_m, home.xy_m]).T, color=GREY, ls="--", lw=1.2, zorder=5)
        draw_robot(above, "R1", here, robot_colour(0), size_m=0.8)
        if vector is not None and not vector.arrived:
            course_deg = np.degrees(here.yaw_rad + vector.bearing_rad)
            fan_deg = min(float(np.degrees(vector.std_rad)), 180.0)
            above.add_patch(
                Wedge(
                    tuple(here.xy_m), _ARROW_M, course_deg - fan_deg, course_deg + fan_deg,
                    color=BLUE, alpha=0.3, zorder=5,
                )
            )  # fmt: skip
            tip = here.xy_m + _ARROW_M * np.array(
                [np.cos(np.radians(course_deg)), np.sin(np.radians(course_deg))]
            )
            arrow = {"arrowstyle": "-|>", "color": BLUE, "lw": 2.5}
            above.annotate("", tuple(tip), tuple(here.xy_m), arrowprops=arrow, zorder=6)
        zoom_to(above, home.xy_m[None], margin_m=_REACH_M + 2.0)
        above.set_title("star: home; arrow: the home vector; dashed: the truth", fontsize=10)
        return Shown(_told(vector, here, home, method), figure)

    return Play(
        draw,
        {
            "east_m": Slider("east of home (m)", -_REACH_M, _REACH_M, 0.5, 3),
            "north_m": Slider("north of home (m)", -_REACH_M, _REACH_M, 0.5, 0),
            "turned_deg": Slider("turned by (degrees)", -180, 180, 5, 60),
            "method": Choice("method", tuple(METHODS), "epipolar"),
        },
    )


def _told(vector: HomeVector | None, here: Pose, home: Pose, method: str) -> str:
    distance_m = here.distance_to_m(home.xy_m)
    if vector is None:
        return f"{distance_m:.1f} m from home {method} has **no answer**: the two share too little."
    if vector.arrived:
        return f"{distance_m:.1f} m from home {method} says: **this is home**."
    off_deg = np.degrees(abs(wrap_angle_rad(vector.bearing_rad - here.bearing_to_rad(home.xy_m))))
    return (
        f"{distance_m:.1f} m from home {method} is **{off_deg:.0f} degrees off**; itself it "
        f"expects {np.degrees(vector.std_rad):.0f}. It rests on {vector.n_matches} matches."
    )

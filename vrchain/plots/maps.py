"""Maps: a scene from above, with robots, what they see, and the ways they drove."""

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path
from matplotlib.text import Annotation
from numpy.typing import NDArray

from vrchain.geometry import Pose
from vrchain.plots.style import WHITE_BOX, label, legend_below, panels
from vrchain.world.model import Scene, SceneObject

_KIND_COLOURS = {
    "house": "#c9a08a",
    "shop": "#8c6bb1",
    "barn": "#8c2d04",
    "tree": "#5f9a4c",
    "hedge": "#0b5d3b",
    "bush": "#9fc131",
    "vehicle": "#3b5b92",
    "fence": "#f0a30a",
    "wall": "#3a3a3a",
}
_OTHER_COLOUR = "#b0005a"
_THIN = ("hedge", "fence", "wall")  # drawn at least so wide that their colour shows


def scene_map(scene: Scene) -> Figure:
    """The whole map, objects by kind."""
    width_m, height_m = scene.extent_m
    figure, axes = panels(7.2, 7.2 * height_m / width_m * 0.92)
    draw_scene(axes, scene)
    axes.set(xlim=(-width_m / 2, width_m / 2), ylim=(-height_m / 2, height_m / 2))
    legend_below(figure, _handles(scene), 4)
    axes.set_title(f"{scene.name}: {width_m:g} x {height_m:g} m, {len(scene.objects)} objects")
    return figure


def draw_scene(axes: Axes, scene: Scene) -> None:
    """Ground in its own colours, and the footprints of what stands on it."""
    draw_ground(axes, scene)
    for obj in (o for o in scene.objects if o.solid):
        colour = _KIND_COLOURS.get(obj.kind, _OTHER_COLOUR)
        thin = obj.kind in _THIN or obj.kind not in _KIND_COLOURS
        for part in shapely.get_parts(_plan(obj)):
            rings = (part.exterior, *part.interiors)
            path = Path.make_compound_path(*(Path(ring.coords) for ring in rings))
            outline = PathPatch(
                path, facecolor=colour, edgecolor=colour if thin else "black",
                linewidth=1.6 if thin else 0.4, alpha=0.6 if obj.kind == "tree" else 1.0,
            )  # fmt: skip
            axes.add_patch(outline)


def draw_ground(axes: Axes, scene: Scene) -> None:
    """Ground in its own, paler colours, with axes in metres."""
    for surface in (s for o in scene.objects if not o.solid for s in o.surfaces):
        colour = surface.texture[..., :3].reshape(-1, 3).mean(axis=0) / 255
        triangles = surface.vertices_m[surface.faces][:, :, :2]
        axes.add_collection(
            PolyCollection(
                list(triangles), facecolors=[0.55 + 0.45 * colour],
                edgecolors="face", linewidths=0.4,  # or the seams between triangles show
            )
        )  # fmt: skip
    axes.set(aspect="equal", xlabel="x, east (m)", ylabel="y, north (m)")


def draw_robot(axes: Axes, name: str, pose: Pose, colour: str, size_m: float = 2.5) -> None:
    """A triangle that points along the robot's heading, and its name."""
    outline = np.array([[1.0, 0.0], [-0.6, 0.55], [-0.6, -0.55]]) * size_m
    c, s = np.cos(pose.yaw_rad), np.sin(pose.yaw_rad)
    corners = outline @ np.array([[c, s], [-s, c]]) + pose.xy_m
    axes.fill(*corners.T, facecolor=colour, edgecolor="white", linewidth=1.0, zorder=9)
    draw_name(axes, name, pose.xy_m, colour)


def draw_name(axes: Axes, name: str, xy_m: NDArray[np.float64], colour: str) -> Annotation:
    """A robot's name beside a place, (2,)."""
    return label(
        axes, name, (float(xy_m[0]), float(xy_m[1])), (9, 7), fontsize=9, fontweight="bold",
        color=colour, zorder=10, bbox=WHITE_BOX,
    )  # fmt: skip


def zoom_to(axes: Axes, points_xy_m: NDArray[np.float64], margin_m: float = 8.0) -> None:
    """A square window around some points."""
    low, high = points_xy_m.min(axis=0), points_xy_m.max(axis=0)
    (x, y), half = (low + high) / 2, (high - low).max() / 2 + margin_m
    axes.set(xlim=(x - half, x + half), ylim=(y - half, y + half))


def _plan(obj: SceneObject) -> shapely.Geometry:
    """What an object covers on the map: a house's roof, a tree's crown, else its footprint."""
    if obj.kind == "tree":
        (low_x, low_y, _), (high_x, high_y, _) = obj.bounds_m
        middle = shapely.Point((low_x + high_x) / 2, (low_y + high_y) / 2)
        return middle.buffer((high_x - low_x + high_y - low_y) / 4)
    if obj.kind in ("house", "shop", "barn"):
        corners = np.concatenate([s.vertices_m[s.faces][:, :, :2] for s in obj.surfaces])
        triangles = shapely.polygons(corners.astype(float))
        return shapely.union_all(triangles[shapely.area(triangles) > 1e-4], grid_size=0.01)
    footprint = obj.footprint
    return footprint if isinstance(footprint, shapely.Polygon) else footprint.buffer(0.15)


def _handles(scene: Scene) -> list[Patch]:
    """A legend's, of the kinds that there are."""
    counts = scene.table[scene.table.landmark].kind.value_counts()
    shown = {kind: colour for kind, colour in _KIND_COLOURS.items() if kind in counts}
    handles = [Patch(fc=colour, label=f"{kind} ({counts[kind]})") for kind, colour in shown.items()]
    if rest := int(counts.drop(list(shown)).sum()):
        handles.append(Patch(fc=_OTHER_COLOUR, label=f"other landmarks ({rest})"))
    return handles

"""Shapes that a file gives by their lines: polylines extruded, and roads."""

from collections.abc import Sequence

import numpy as np
import shapely
from numpy.typing import NDArray

from vrchain.world.gazebo.parts import Part, grid, joined
from vrchain.world.gazebo.xml import Element


def prism(polylines: Sequence[Element]) -> Part:
    """Polylines of one visual, extruded upwards; what two of them enclose is a hole.

    Raises SpecError.
    """
    area: shapely.Geometry = shapely.Polygon()
    for line in polylines:
        outline = shapely.make_valid(shapely.Polygon(_points(line, 2, 3)))
        area = shapely.symmetric_difference(area, outline)
    height = polylines[0].number("height", 1.0)
    flat = [g for g in shapely.get_parts(area) if isinstance(g, shapely.Polygon)]
    if not flat or not height > 0:
        raise polylines[0].error("expected an outline with an area, and a height above 0")
    parts = []
    for polygon in flat:
        triangles = shapely.get_parts(shapely.constrained_delaunay_triangles(polygon))
        lid = np.array([shapely.get_coordinates(shapely.orient_polygons(t))[:3] for t in triangles])
        parts += [_level(lid, height), _level(lid[:, ::-1], 0.0)]
        turned = shapely.orient_polygons(polygon)
        for ring in (turned.exterior, *turned.interiors):
            points = shapely.get_coordinates(ring)  # the solid lies to the left
            low, high = (np.insert(points, 2, z, axis=1) for z in (0.0, height))
            parts.append(grid(np.stack([low, high]), _across(points, height)))
    return joined(*parts)


def ribbon(road: Element) -> Part:
    """A <road>: as wide all along its points, with a picture that repeats. Raises SpecError."""
    points = _points(road, 3, 2)
    width = road.number("width", 1.0)
    ahead = np.diff(points[:, :2], axis=0)
    length = np.linalg.norm(ahead, axis=1, keepdims=True)
    if not width > 0 or not length.min() > 0:
        raise road.error("expected a width above 0, and points that differ")
    ahead /= length
    bisector = np.concatenate([ahead[:1], ahead[:-1] + ahead[1:], ahead[-1:]])
    bisector /= np.maximum(np.linalg.norm(bisector, axis=1, keepdims=True), 1e-3)
    right = np.column_stack([bisector[:, 1], -bisector[:, 0], np.zeros(len(points))]) * width / 2
    along = np.concatenate([[0.0], np.cumsum(length)]) / width
    uv = np.stack(np.broadcast_arrays([[0.0, 1.0]], along[:, None]), axis=-1)
    return grid(np.stack([points - right, points + right], axis=1), uv)


def _points(element: Element, n: int, least: int) -> NDArray[np.float64]:
    points = np.array([point.numbers(n) for point in element.all("point")])
    if len(points) < least:
        raise element.error(f"expected at least {least} <point>s, got {len(points)}")
    return points


def _level(triangles: NDArray[np.float64], z: float) -> Part:
    """Triangles (n, 3, 2) at a height, a metre of them one repeat of a picture."""
    points = triangles.reshape(-1, 2)
    return Part(
        np.insert(points, 2, z, axis=1), np.arange(len(points)).reshape(-1, 3), uv=points.copy()
    )


def _across(ring: NDArray[np.float64], height: float) -> NDArray[np.float64]:
    """Texture coordinates in metres of a wall along a ring."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(ring, axis=0), axis=1))])
    return np.stack(np.broadcast_arrays(along, np.array([[0.0], [height]])), axis=-1)

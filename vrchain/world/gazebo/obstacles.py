"""What of a model stands in a robot's way: its convex hull, or as it is where one fits inside."""

import numpy as np
import shapely
from numpy.typing import NDArray

from vrchain.world.gazebo.frames import Matrix
from vrchain.world.gazebo.parts import Part, moved
from vrchain.world.model import ROBOT_RADIUS_M, band, ground_polygon

_SLICES_M = (0.3, 0.8, 1.3)  # where it is asked what is inside
_SKIN_M = 0.005  # around all faces, most of which are upright: seen from above they are lines
_GRID_M = 0.001  # to which corners are rounded, so that walls meet
_MOST_FACES = 200_000  # that stand in the way; more are taken for their hull
_STEP_M, _MOST_PLACES = 0.2, 250_000  # between places where a robot may fit
_FLAW_M2 = 0.01  # of free space that is none

Pieces = tuple[tuple[Part, ...], ...]


class Outlines:
    """Footprints of placed models, each shape looked at once however it is turned about z."""

    def __init__(self) -> None:
        self._known: dict[tuple[Pieces, bytes], list[shapely.Geometry | None]] = {}

    def of(self, pieces: Pieces, matrix: Matrix) -> shapely.Geometry | None:
        """The footprint in the world of what the visuals of a model show; None: its hull.

        Each visual is taken for its hull, or as it is where that leaves more room for robots.
        """
        yaw = np.arctan2(matrix[1, 0], matrix[0, 0])
        cos, sin = np.cos(yaw), np.sin(yaw)
        turn = np.array([[cos, -sin], [sin, cos]])
        upright = matrix.copy()
        upright[:2] = turn.T @ matrix[:2]
        upright[:2, 3] = 0
        key = pieces, np.round(upright, 9).tobytes()
        if key not in self._known:
            self._known[key] = [as_it_stands(_triangles(piece, upright)) for piece in pieces]
        shapes = self._known[key]
        if len(pieces) == 1 and shapes[0] is None:
            return None
        placed = [
            ground_polygon(_triangles(piece, matrix))
            if shape is None
            else shapely.transform(shape, lambda xy: xy @ turn.T + matrix[:2, 3])
            for piece, shape in zip(pieces, shapes, strict=True)
        ]
        return shapely.union_all(placed)


def _triangles(piece: tuple[Part, ...], matrix: Matrix) -> NDArray[np.float64]:
    placed = (moved(part, matrix) for part in piece)
    return np.concatenate([part.vertices_m[part.faces] for part in placed])


def as_it_stands(triangles: NDArray[np.float64]) -> shapely.Geometry | None:
    """What of triangles, (n, 3, 3), stands in a robot's way; None where their hull is as good.

    What is closed all around, such as a house of one skin, is solid, and what walls with two sides
    enclose is free: the winding number tells them apart.
    """
    hull = ground_polygon(triangles)
    room = hull.buffer(_STEP_M)  # a wall's hull may be slimmer than a step
    if hull.is_empty or shapely.minimum_bounding_radius(hull) < ROBOT_RADIUS_M:
        return None
    points, owner = band(triangles)
    order = np.argsort(owner, kind="stable")
    _, number = np.unique(owner[order], return_inverse=True)
    if number[-1] >= _MOST_FACES:
        return None
    faces = shapely.convex_hull(shapely.multipoints(points[order], indices=number))
    if not _has_room(room, faces):
        return None
    walls = shapely.union_all(shapely.buffer(faces, _SKIN_M, quad_segs=1), grid_size=_GRID_M)
    beyond = hull.buffer(2 * ROBOT_RADIUS_M)
    slices = [_slice(triangles, z_m) for z_m in _SLICES_M]
    solid = [
        region.buffer(ROBOT_RADIUS_M)
        for region in shapely.get_parts(beyond - walls.buffer(ROBOT_RADIUS_M))
        if not region.intersects(beyond.exterior) and _is_inside(slices, region)
    ]
    parts = shapely.get_parts(shapely.union_all([walls, *solid]))
    shape = shapely.union_all([_without_cracks(part) for part in parts])
    return shape if (room - shape.buffer(ROBOT_RADIUS_M)).area > _FLAW_M2 else None


def _has_room(room: shapely.Polygon, faces: NDArray[np.object_]) -> bool:
    """Whether some place of a room is so far from all faces that a robot may fit."""
    low, high = np.array(room.bounds).reshape(2, 2)
    step_m = max(_STEP_M, float(np.sqrt(np.prod(high - low) / _MOST_PLACES)))
    x, y = np.meshgrid(*(np.arange(a, b + step_m, step_m) for a, b in zip(low, high, strict=True)))
    inside = shapely.contains_xy(room, x, y)
    places = shapely.points(x[inside], y[inside])
    near, _ = shapely.STRtree(faces).query(places, predicate="dwithin", distance=ROBOT_RADIUS_M)
    return len(np.unique(near)) < len(places)


def _without_cracks(part: shapely.Polygon) -> shapely.Polygon:
    """A polygon with those of its holes that a robot fits into."""
    holes = [h for h in part.interiors if not shapely.Polygon(h).buffer(-ROBOT_RADIUS_M).is_empty]
    return shapely.Polygon(part.exterior, holes)


def _slice(triangles: NDArray[np.float64], z_m: float) -> NDArray[np.float64]:
    """Where a level plane cuts triangles: starts and ends, (k, 2, 2), their outside on the right.

    So outlines of what is solid run anticlockwise.
    """
    above = triangles[:, :, 2] >= z_m
    cut = triangles[above.any(axis=1) & ~above.all(axis=1)]
    above = cut[:, :, 2] >= z_m
    lone = (above == (above.sum(axis=1) == 1)[:, None]).argmax(axis=1)
    turned = np.take_along_axis(cut, ((lone[:, None] + np.arange(3)) % 3)[..., None], axis=1)
    a, others = turned[:, :1], turned[:, 1:]
    share = (z_m - a[..., 2:]) / (others[..., 2:] - a[..., 2:])
    ends = (a + share * (others - a))[..., :2]
    normal = np.cross(cut[:, 1] - cut[:, 0], cut[:, 2] - cut[:, 0])[:, :2]
    wrong = _cross(normal, ends[:, 1] - ends[:, 0]) < 0
    ends[wrong] = ends[wrong][:, ::-1]
    return ends


def _is_inside(slices: list[NDArray[np.float64]], region: shapely.Polygon) -> bool:
    """Whether a region that is enclosed lies within a solid, as most slices have it.

    By how often their outlines run around it, where open ones count as the share of a turn that
    they span: Jacobson et al., ACM TOG 32(4), 2013.
    """
    place = np.array(region.representative_point().coords[0])
    turns = []
    for ends in slices:
        start, end = np.moveaxis(ends - place, 1, 0)
        angle = np.arctan2(_cross(start, end), (start * end).sum(axis=1))
        turns.append(angle.sum() / (2 * np.pi))
    return float(np.median(turns)) > 0.5


def _cross(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]

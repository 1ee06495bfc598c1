"""What a scene is once built: textured triangles, and the model database that names them.

Nothing here draws or casts rays; ``render`` and ``truth`` take a ``Scene`` and do.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import pandas as pd
import shapely
from numpy.typing import ArrayLike, NDArray

from vrchain.errors import PoseError
from vrchain.geometry import Pose, rotation_z
from vrchain.world.spec import LightSpec

OPAQUE = 128  # alpha from which a texel is solid
ROBOT_RADIUS_M = 0.4  # circle around a Pioneer P3-AT's 0.51 x 0.50 m footprint, and a little more
_OBSTACLE_HEIGHT_M = (0.05, 1.6)  # what stands there stops a robot or its camera mast


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles that share a texture.

    vertices_m: (n, 3) float32; faces: (m, 3) int32, anticlockwise seen from outside;
    uv: (n, 2) float32, v upwards from the texture's bottom row, repeating beyond 0..1;
    shade: (n,) or (n, 3) float32 in 0..1, baked light that multiplies the texture, white or RGB;
    texture: (h, w, 3) uint8 RGB, top row first; or (h, w, 4): a cut-out, in which a texel whose
    alpha is below ``OPAQUE`` is see-through, all or nothing, and what lies behind shows.
    """

    vertices_m: NDArray[np.float32]
    faces: NDArray[np.int32]
    uv: NDArray[np.float32]
    shade: NDArray[np.float32]
    texture: NDArray[np.uint8]

    @property
    def cut_out(self) -> bool:
        """Whether it may be see-through in places."""
        return self.texture.shape[2] == 4

    @property
    def shade_rgb(self) -> NDArray[np.float32]:
        """``shade`` as (n, 3)."""
        shade = self.shade if self.shade.ndim == 2 else self.shade[:, None]
        return np.broadcast_to(shade, (len(shade), 3))

    @property
    def digest(self) -> bytes:
        """Of its shape and texture, whatever its light."""
        content = hashlib.sha256()
        for array in (self.vertices_m, self.faces, self.uv, self.texture):
            content.update(str(array.shape).encode())
            content.update(np.ascontiguousarray(array).tobytes())
        return content.digest()


@dataclass(frozen=True, eq=False)
class SceneObject:
    """A named thing of the model database, its surfaces in world coordinates.

    ``model`` names the design: two objects of one model are twins. ``size_m`` is (x, y, z) in
    the model's own frame, before it was turned to its place. ``solid`` things stop robots.
    ``outline`` is the footprint of a thing that stands around free space, such as an arena.
    """

    name: str
    kind: str
    model: str
    landmark: bool
    solid: bool
    size_m: tuple[float, float, float]
    surfaces: tuple[Surface, ...]
    outline: shapely.Geometry | None = None

    @cached_property
    def bounds_m(self) -> NDArray[np.float64]:
        """World axis-aligned bounds, (2, 3) float: lowest and highest corner."""
        points = np.concatenate([s.vertices_m for s in self.surfaces])
        return np.array([points.min(axis=0), points.max(axis=0)], dtype=float)

    @property
    def width_m(self) -> float:
        """How wide it is, as its model lies: the larger of its sides."""
        return max(self.size_m[:2])

    @cached_property
    def footprint(self) -> shapely.Geometry:
        """Ground polygon (world frame) of the parts that a robot could bump into."""
        if self.outline is not None:
            return self.outline
        triangles = np.concatenate([s.vertices_m[s.faces] for s in self.surfaces])
        return ground_polygon(triangles.astype(float))


def ground_polygon(triangles: NDArray[np.float64]) -> shapely.Geometry:
    """Convex polygon around what of triangles, (n, 3, 3) float, a robot could bump into."""
    return shapely.MultiPoint(band(triangles)[0]).convex_hull


def band(triangles: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """The corners, (k, 2), of what of triangles (n, 3, 3) a robot could bump into; of which, (k,).

    Each is cut off where robots pass under or over it.
    """
    low_m, high_m = _OBSTACLE_HEIGHT_M
    start = triangles.reshape(-1, 3)
    end = np.roll(triangles, -1, axis=1).reshape(-1, 3)
    within = (start[:, 2] >= low_m) & (start[:, 2] <= high_m)
    corners, edges = [start[within]], [np.flatnonzero(within)]
    for level in (low_m, high_m):
        cut = (start[:, 2] < level) != (end[:, 2] < level)
        a, b = start[cut], end[cut]
        share = (level - a[:, 2:]) / (b[:, 2:] - a[:, 2:])
        corners.append(a + share * (b - a))
        edges.append(np.flatnonzero(cut))
    return np.concatenate(corners)[:, :2], np.concatenate(edges) // 3


def size_of(points: NDArray[np.floating]) -> tuple[float, float, float]:
    """Extent (x, y, z) of points, (n, 3)."""
    x, y, z = np.ptp(points, axis=0)
    return float(x), float(y), float(z)


def place(
    name: str,
    kind: str,
    model: str,
    surfaces: Sequence[Surface],
    pose: Pose,
    *,
    landmark: bool,
    solid: bool = True,
) -> SceneObject:
    """Put a model, its surfaces given in its own frame, at ``pose`` in the world."""
    size_m = size_of(np.concatenate([s.vertices_m for s in surfaces]))
    turn = rotation_z(pose.yaw_rad)
    offset = np.array([pose.x_m, pose.y_m, 0.0])
    moved = tuple(
        replace(s, vertices_m=(s.vertices_m.astype(float) @ turn.T + offset).astype(np.float32))
        for s in surfaces
    )
    return SceneObject(name, kind, model, landmark, solid, size_m, moved)


@dataclass(frozen=True, eq=False)
class LightMap:
    """Baked light on flat ground that multiplies its texture and shade.

    image: (h, w, 3) uint8 RGB, the northernmost row first; low_m, high_m: (2,) its lowest and
    highest corner, (x, y). Beyond them it goes on as at its edge. height_m: what lies at this z is
    lit by it.
    """

    image: NDArray[np.uint8]
    low_m: NDArray[np.float64]
    high_m: NDArray[np.float64]
    height_m: float = 0.0


@dataclass(frozen=True, eq=False)
class Scene:
    """A world: objects in a fixed order (their index is their id), and a sky.

    extent_m: (x, y) size; the map spans -x/2..x/2 and -y/2..y/2. The sky is drawn but is no
    object: it has no id, and rays pass through it. light: the sun in the objects' shades;
    ground_light: what is lit by it lies at its height all over.
    robots: where its own robots stand, by name, and ``goal`` what the first of them looks for, in a
    scene that sets a task.
    """

    name: str
    extent_m: tuple[float, float]
    objects: tuple[SceneObject, ...]
    sky: Surface | None = None
    sky_rgb: tuple[int, int, int] = (168, 200, 232)
    light: LightSpec = field(default_factory=LightSpec)
    ground_light: LightMap | None = None
    robots: tuple[tuple[str, Pose], ...] = ()
    goal: str | None = None

    @cached_property
    def table(self) -> pd.DataFrame:
        """The model database, one row an object, indexed by object id."""
        rows = [
            (o.name, o.kind, o.model, o.landmark, *o.bounds_m.mean(axis=0), *o.size_m)
            for o in self.objects
        ]
        columns = ["name", "kind", "model", "landmark"]
        columns += ["centre_x_m", "centre_y_m", "centre_z_m", "size_x_m", "size_y_m", "size_z_m"]
        return pd.DataFrame(rows, columns=columns)

    @cached_property
    def _ids(self) -> dict[str, int]:
        return {o.name: i for i, o in enumerate(self.objects)}

    def index_of(self, name: str) -> int:
        """Object id of a name; KeyError if there is none."""
        return self._ids[name]

    @cached_property
    def _solids(self) -> tuple[list[SceneObject], shapely.STRtree]:
        """The parts of all footprints, and whose each is."""
        solids = [o for o in self.objects if o.solid]
        parts, owner = shapely.get_parts([o.footprint for o in solids], return_index=True)
        return [solids[k] for k in owner], shapely.STRtree(parts)

    def clearance_m(self, points_xy_m: ArrayLike) -> NDArray[np.float64]:
        """Distance of points, (n, 2), to the nearest solid footprint: (n,) float, 0 inside."""
        points = shapely.points(np.asarray(points_xy_m, dtype=float).reshape(-1, 2))
        _, tree = self._solids
        nearest, distance = tree.query_nearest(points, return_distance=True, all_matches=False)
        clearance = np.full(len(points), np.inf)
        clearance[nearest[0]] = distance
        return clearance

    def is_free(
        self, points_xy_m: ArrayLike, radius_m: float = ROBOT_RADIUS_M
    ) -> NDArray[np.bool_]:
        """Whether a robot of ``radius_m`` fits at points, (n, 2) float, on the map: (n,) bool."""
        points = np.asarray(points_xy_m, dtype=float).reshape(-1, 2)
        half = np.array(self.extent_m) / 2 - radius_m
        on_map = (np.abs(points) <= half).all(axis=1)
        return on_map & (self.clearance_m(points) > radius_m)

    def check_pose(self, pose: Pose) -> None:
        """Raise PoseError, saying why, unless a robot can stand at ``pose``."""
        check_on_map(pose, self.extent_m)
        solids, tree = self._solids
        point = shapely.Point(pose.x_m, pose.y_m)
        hits = tree.query(point, predicate="dwithin", distance=ROBOT_RADIUS_M)
        if len(hits):
            raise PoseError(
                f"pose ({pose.x_m:g}, {pose.y_m:g}) is inside or within {ROBOT_RADIUS_M} m of "
                f"{solids[int(hits[0])].name!r}: choose a free place (see `vrchain scene map`)"
            )


def check_on_map(pose: Pose, extent_m: tuple[float, float]) -> None:
    """Raise PoseError unless ``pose`` is one, in radians, on a map of that size (x, y)."""
    try:
        finite = bool(np.isfinite([pose.x_m, pose.y_m, pose.yaw_rad]).all())
    except (AttributeError, TypeError, ValueError):
        finite = False
    if not finite:
        raise PoseError(
            "expected a pose of three finite numbers, metres east and north and radians, such as "
            f"vr.Pose(10.0, 0.0, 0.0), got {pose!r}"
        )
    if abs(pose.yaw_rad) > 4 * np.pi:  # sums of two angles are less
        raise PoseError(
            f"expected a yaw in radians, at most two turns, got {pose.yaw_rad:g}: "
            "if these are degrees, turn them into radians by np.radians"
        )
    half_x, half_y = (e / 2 - ROBOT_RADIUS_M for e in extent_m)
    if abs(pose.x_m) > half_x or abs(pose.y_m) > half_y:
        raise PoseError(
            f"pose ({pose.x_m:g}, {pose.y_m:g}) is off the map: x must lie in "
            f"{-half_x:g}..{half_x:g} and y in {-half_y:g}..{half_y:g} m"
        )

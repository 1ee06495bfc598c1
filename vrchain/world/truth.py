"""Ground truth by ray casting: what is really seen, and how far away. Open3D only here.

The simulation, training, quality, experiments and the workbench may ask, a robot never does:
tests/test_architecture.py holds that.
"""

import os
import sys
from collections.abc import Mapping
from itertools import product
from types import ModuleType
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from vrchain.geometry import Pose, rotation_z, wrap_angle_rad
from vrchain.panorama import CameraRig
from vrchain.world.atlas import Joined, join, pack
from vrchain.world.model import OPAQUE, Scene
from vrchain.world.things import pioneer

SKY = -1
VISIBLE_AZIMUTH_DEG = 1.25  # an object is visible if its own pixels span this much azimuth
VISIBLE_AREA_DEG2 = 1.5  # and this solid angle
_GRID_PER_DEG = 4  # rays a degree when judging visibility
_MARGIN = 1e-4  # metres, radians or slope: so near past a box a ray is still cast
_BEHIND_M = 1e-4  # a ray that went through a see-through texel goes on so far behind it
_MOST_LAYERS = 32  # the next cut-out that a ray meets stops it, whatever its texel


def _open3d() -> Any:
    """Open3D without what it learns with, which would load scikit-learn: a second and more.

    And without its viewer for notebooks, which prints that it is there.
    """
    os.environ.setdefault("OPEN3D_DISABLE_WEB_VISUALIZER", "true")
    unloaded = ModuleType("open3d.ml")
    sys.modules.setdefault(unloaded.__name__, unloaded)
    import open3d

    if sys.modules[unloaded.__name__] is unloaded:
        del sys.modules[unloaded.__name__]  # whoever wants it may still import it
    return open3d


class GroundTruth:
    """Answers about one scene. Object ids are indices of ``scene.objects``; -1 is the sky.

    Robots are no part of the scene: questions that are given ``robots``, name and pose, see them
    too, under the ids -2, -3, ... in the order given, as they are drawn. Never pass the one that
    looks.
    """

    def __init__(self, scene: Scene) -> None:
        o3d = _open3d()
        self.scene = scene
        self._to_tensor = o3d.core.Tensor
        self._caster: Any = o3d.t.geometry.RaycastingScene(nthreads=0)
        surfaces = [(i, s) for i, o in enumerate(scene.objects) for s in o.surfaces]
        opaque = [(i, s) for i, s in surfaces if not s.cut_out]
        cut_out = [(i, s) for i, s in surfaces if s.cut_out]
        packed = pack([s for _, s in cut_out])  # as drawn, so the same texels
        pieces = [(join([s for _, s in opaque]), opaque), *((piece, cut_out) for piece in packed)]
        object_ids = [
            np.array([i for i, _ in of], dtype=np.int32)[piece.owner[piece.faces[:, 0]]]
            for piece, of in pieces
        ]
        self._owner = np.concatenate([*object_ids, np.array([SKY], dtype=np.int32)])
        self._first_cut_out = len(object_ids[0])
        self._texels = _Texels(packed)
        whole = join([piece for piece, _ in pieces])
        self._caster.add_triangles(
            self._to_tensor(whole.vertices_m), self._to_tensor(whole.faces.astype(np.uint32))
        )

    def cast(
        self,
        origins_m: ArrayLike,
        directions: ArrayLike,
        robots: Mapping[str, Pose] | None = None,
    ) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """First hit of rays. origins_m, directions: (..., 3), world frame, broadcast together.

        Returns object ids (...) int32 and distances in units of the directions' lengths
        (...) float32, infinite for the sky. Rays pass through the see-through texels of cut-outs.
        """
        broadcast = np.concatenate(np.broadcast_arrays(origins_m, directions), axis=-1)
        rays = broadcast.astype(np.float32).reshape(-1, 6)
        triangle, distance, share = self._first_hit(rays)
        going_on = np.flatnonzero(self._is_cut_out(triangle))
        share = share[going_on]
        for _ in range(_MOST_LAYERS):
            through = self._texels.see_through(triangle[going_on] - self._first_cut_out, share)
            going_on = going_on[through]
            if len(going_on) == 0:
                break
            onward = rays[going_on]
            step = distance[going_on] + _BEHIND_M / np.linalg.norm(onward[:, 3:], axis=1)
            onward[:, :3] += step[:, None] * onward[:, 3:]
            triangle[going_on], beyond, share = self._first_hit(onward)
            distance[going_on] = step + beyond
            again = self._is_cut_out(triangle[going_on])
            going_on, share = going_on[again], share[again]
        shape = broadcast.shape[:-1]
        object_id, distance = self._owner[triangle].reshape(shape), distance.reshape(shape)
        if not robots:
            return object_id, distance
        team = Scene("robots", self.scene.extent_m, pioneer.placed(self.scene, robots))
        number, robot_distance = GroundTruth(team).cast(origins_m, directions)
        nearer = robot_distance < distance
        object_id = np.where(nearer, np.int32(pioneer.FIRST_ID) - number, object_id)
        return object_id, np.where(nearer, robot_distance, distance)

    def _first_hit(
        self, rays: NDArray[np.float32]
    ) -> tuple[NDArray[np.int64], NDArray[np.float32], NDArray[np.float32]]:
        """Triangle (n,), distance (n,) and place in the triangle (n, 2) of rays (n, 6)."""
        hit = self._caster.cast_rays(self._to_tensor(rays))
        distance = hit["t_hit"].numpy()
        triangle = hit["primitive_ids"].numpy().astype(np.int64)
        triangle[np.isinf(distance)] = len(self._owner) - 1
        return triangle, distance, hit["primitive_uvs"].numpy()

    def _is_cut_out(self, triangle: NDArray[np.int64]) -> NDArray[np.bool_]:
        return (triangle >= self._first_cut_out) & (triangle < len(self._owner) - 1)

    def look(
        self,
        pose: Pose,
        rig: CameraRig | None = None,
        robots: Mapping[str, Pose] | None = None,
    ) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Object id and range in metres a pixel of every view, (n_views, height_px, width_px)."""
        rig = rig or CameraRig()
        directions = rig.ray_directions() @ rotation_z(pose.yaw_rad).T.astype(np.float32)
        return self.cast(_eye(pose, rig), directions, robots)

    def look_along(
        self,
        pose: Pose,
        bearing_rad: ArrayLike,
        slope: ArrayLike,
        rig: CameraRig | None = None,
        robots: Mapping[str, Pose] | None = None,
    ) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
        """Object id (n,) and world point (n, 3) in metres, NaN for sky, along directions (n,)."""
        eye = _eye(pose, rig or CameraRig())
        azimuth = np.asarray(bearing_rad, dtype=float) + pose.yaw_rad
        rays = np.stack([np.cos(azimuth), np.sin(azimuth), np.asarray(slope, dtype=float)], axis=-1)
        object_id, distance = self.cast(eye, rays, robots)
        points = eye + rays * np.where(object_id == SKY, np.nan, distance)[..., None]
        return object_id, points

    def sees(self, target: int, pose: Pose, rig: CameraRig | None = None) -> bool:
        """Whether an object is visible from ``pose``."""
        return bool(self.visibility(pose, rig, of=target).visible.any())

    def visibility(
        self,
        pose: Pose,
        rig: CameraRig | None = None,
        robots: Mapping[str, Pose] | None = None,
        of: int | None = None,
    ) -> pd.DataFrame:
        """What is seen from ``pose``: one row an object, indexed by object id.

        Robots have no row, but hide what is behind them. of: this object's row alone, if it is
        seen, for far fewer rays.
        Columns: azimuth_deg (degrees of azimuth in which any of it shows), area_deg2, visible
        (both large enough), range_m (median).
        """
        rig = rig or CameraRig()
        columns = round(np.degrees(rig.span_rad) * _GRID_PER_DEG)
        top = float(rig.slope_of_row(-0.5))
        rows = round(float(np.degrees(2 * top)) * _GRID_PER_DEG)
        bearing = rig.span_rad / 2 - (np.arange(columns) + 0.5) * rig.span_rad / columns
        slope = top - (np.arange(rows) + 0.5) * 2 * top / rows
        row, column = (i.ravel() for i in np.indices((rows, columns)))
        if of is not None:
            bounds_m = self.scene.objects[of].bounds_m
            inside = _towards(bounds_m, pose, rig, bearing[column], slope[row])
            row, column = row[inside], column[inside]
        object_id, points = self.look_along(pose, bearing[column], slope[row], rig, robots)
        # a cell of azimuth and slope covers less solid angle away from the horizon
        cell_deg2 = np.degrees(rig.span_rad / columns) * np.degrees(2 * top / rows)
        seen = pd.DataFrame(
            {
                "object_id": object_id,
                "column": column,
                "area_deg2": (cell_deg2 / (1 + slope**2) ** 1.5)[row],
                "range_m": np.linalg.norm(points - _eye(pose, rig), axis=-1),
            }
        )
        own = seen.object_id > SKY if of is None else seen.object_id == of
        groups = seen[own].groupby("object_id")
        result = pd.DataFrame(
            {
                "azimuth_deg": groups.column.nunique() * np.degrees(rig.span_rad / columns),
                "area_deg2": groups.area_deg2.sum(),
                "range_m": groups.range_m.median(),
            }
        )
        wide = result.azimuth_deg >= VISIBLE_AZIMUTH_DEG
        result["visible"] = wide & (result.area_deg2 >= VISIBLE_AREA_DEG2)
        return result


class _Texels:
    """Where cut-outs are see-through: the nearest texel of the finest level, as it is drawn."""

    def __init__(self, surfaces: list[Joined]) -> None:
        masks = [s.texture[::-1, :, 3] < OPAQUE for s in surfaces]  # bottom row first, as v counts
        counts = np.array([len(s.faces) for s in surfaces], dtype=int)
        sizes_px = np.array([m.shape[::-1] for m in masks], dtype=int).reshape(-1, 2)
        starts = np.cumsum([0, *(m.size for m in masks)])[:-1]
        none = np.zeros((0, 3, 2), dtype=np.float32)
        self._uv = np.concatenate([none, *(s.uv[s.faces] for s in surfaces)])
        self._see_through = np.concatenate([np.zeros(0, dtype=bool), *(m.ravel() for m in masks)])
        self._size_px, self._start = sizes_px.repeat(counts, axis=0), starts.repeat(counts)

    def see_through(
        self, triangle: NDArray[np.int64], share: NDArray[np.float32]
    ) -> NDArray[np.bool_]:
        """Whether places are: triangles (n,), counted from 0; shares of corners 1 and 2, (n, 2)."""
        a, b, c = np.moveaxis(self._uv[triangle], 1, 0)
        uv = a + share[:, :1] * (b - a) + share[:, 1:] * (c - a)
        size_px = self._size_px[triangle]
        texel = np.minimum(((uv - np.floor(uv)) * size_px).astype(np.int64), size_px - 1)
        return self._see_through[self._start[triangle] + texel[:, 1] * size_px[:, 0] + texel[:, 0]]


def _towards(
    bounds_m: NDArray[np.float64],
    pose: Pose,
    rig: CameraRig,
    bearing_rad: NDArray[np.float64],
    slope: NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Which directions (n,) may meet an upright box, (2, 3); none that does is left out."""
    low, high = bounds_m[:, :2] - pose.xy_m
    near_m = float(np.hypot(*np.maximum(0.0, np.maximum(low, -high)))) - _MARGIN
    if near_m <= 0:  # the box may be all around
        return np.ones(len(slope), dtype=bool)
    corners = np.array(list(product(*np.stack([low, high], axis=1))))
    middle_rad = np.arctan2(*corners.mean(axis=0)[::-1])
    half_rad = np.abs(wrap_angle_rad(np.arctan2(*corners.T[::-1]) - middle_rad)).max()
    far_m = np.hypot(*corners.T).max()
    rise = (bounds_m[:, 2] - rig.camera_height_m)[:, None] / [near_m, far_m]
    aside_rad = np.abs(wrap_angle_rad(bearing_rad + pose.yaw_rad - middle_rad))
    level = (slope >= rise.min() - _MARGIN) & (slope <= rise.max() + _MARGIN)
    return level & (aside_rad <= half_rad + _MARGIN)


def _eye(pose: Pose, rig: CameraRig) -> NDArray[np.float64]:
    return np.array([pose.x_m, pose.y_m, rig.camera_height_m])

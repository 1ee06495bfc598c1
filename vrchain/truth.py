"""Ground truth by ray casting: what is really seen, and how far away. Open3D only here.

Only the simulator, training, quality and experiments may ask; a robot never does.
"""

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray

from vrchain.geometry import Pose, rotation_z
from vrchain.panorama import CameraRig
from vrchain.scene.model import Scene

SKY = -1
VISIBLE_AZIMUTH_DEG = 1.25  # an object is visible if its own pixels span this much azimuth
VISIBLE_AREA_DEG2 = 1.5  # and this solid angle
_GRID_PER_DEG = 4  # rays a degree when judging visibility


class GroundTruth:
    """Answers about one scene. Object ids are indices of ``scene.objects``; -1 is the sky."""

    def __init__(self, scene: Scene) -> None:
        import open3d as o3d

        self.scene = scene
        self._to_tensor = o3d.core.Tensor
        self._caster: Any = o3d.t.geometry.RaycastingScene(nthreads=0)
        vertices, faces, owners, first = [], [], [], 0
        for object_id, obj in enumerate(scene.objects):
            for surface in obj.surfaces:
                vertices.append(surface.vertices_m)
                faces.append(surface.faces + first)
                owners.append(np.full(len(surface.faces), object_id, dtype=np.int32))
                first += len(surface.vertices_m)
        self._owner = np.concatenate([*owners, np.array([SKY], dtype=np.int32)])
        self._caster.add_triangles(
            self._to_tensor(np.concatenate(vertices).astype(np.float32)),
            self._to_tensor(np.concatenate(faces).astype(np.uint32)),
        )

    def cast(
        self, origins_m: ArrayLike, directions: ArrayLike
    ) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """First hit of rays. origins_m, directions: (..., 3), world frame, broadcast together.

        Returns object ids (...) int32 and distances in units of the directions' lengths
        (...) float32, infinite for the sky.
        """
        rays = np.concatenate(np.broadcast_arrays(origins_m, directions), axis=-1).astype(
            np.float32
        )
        hit = self._caster.cast_rays(self._to_tensor(rays.reshape(-1, 6)))
        triangle = hit["primitive_ids"].numpy().astype(np.int64).reshape(rays.shape[:-1])
        distance = hit["t_hit"].numpy().reshape(rays.shape[:-1])
        object_id = self._owner[np.where(np.isfinite(distance), triangle, len(self._owner) - 1)]
        return object_id, distance

    def look(
        self, pose: Pose, rig: CameraRig | None = None
    ) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
        """Object id and range in metres a pixel of every view, (n_views, height_px, width_px)."""
        rig = rig or CameraRig()
        directions = rig.ray_directions() @ rotation_z(pose.yaw_rad).T.astype(np.float32)
        return self.cast(_eye(pose, rig), directions)

    def look_along(
        self, pose: Pose, bearing_rad: ArrayLike, slope: ArrayLike, rig: CameraRig | None = None
    ) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
        """Object id (n,) and world point (n, 3) in metres, NaN for sky, along directions (n,)."""
        eye = _eye(pose, rig or CameraRig())
        azimuth = np.asarray(bearing_rad, dtype=float) + pose.yaw_rad
        rays = np.stack([np.cos(azimuth), np.sin(azimuth), np.asarray(slope, dtype=float)], axis=-1)
        object_id, distance = self.cast(eye, rays)
        points = eye + rays * np.where(object_id == SKY, np.nan, distance)[..., None]
        return object_id, points

    def visibility(self, pose: Pose, rig: CameraRig | None = None) -> pd.DataFrame:
        """What is seen from ``pose``: one row an object, indexed by object id.

        Columns: azimuth_deg (degrees of azimuth in which any of it shows), area_deg2, visible
        (both large enough), range_m (median).
        """
        rig = rig or CameraRig()
        columns = round(np.degrees(rig.span_rad) * _GRID_PER_DEG)
        top = float(rig.slope_of_row(-0.5))
        rows = round(float(np.degrees(2 * top)) * _GRID_PER_DEG)
        bearing = rig.span_rad / 2 - (np.arange(columns) + 0.5) * rig.span_rad / columns
        slope = top - (np.arange(rows) + 0.5) * 2 * top / rows
        bearings, slopes = np.broadcast_arrays(bearing[None, :], slope[:, None])
        object_id, points = self.look_along(pose, bearings, slopes, rig)
        # a cell of azimuth and slope covers less solid angle away from the horizon
        cell_deg2 = np.degrees(rig.span_rad / columns) * np.degrees(2 * top / rows)
        area = np.broadcast_to((cell_deg2 / (1 + slope**2) ** 1.5)[:, None], object_id.shape)
        seen = pd.DataFrame(
            {
                "object_id": object_id.ravel(),
                "column": np.broadcast_to(np.arange(columns), object_id.shape).ravel(),
                "area_deg2": area.ravel(),
                "range_m": np.linalg.norm(points - _eye(pose, rig), axis=-1).ravel(),
            }
        )
        groups = seen[seen.object_id != SKY].groupby("object_id")
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


def _eye(pose: Pose, rig: CameraRig) -> NDArray[np.float64]:
    return np.array([pose.x_m, pose.y_m, rig.camera_height_m])

"""Drawing panoramas with pyrender on EGL: the only package that touches OpenGL.

The light is baked into the scene, so everything is drawn flat and in one mesh: pyrender draws
nodes in an order that varies between processes, the primitives of one mesh it does not.
"""

import atexit
import contextlib
import os
import threading
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from vrchain.errors import RenderError
from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.panorama import CameraRig, Panorama
from vrchain.scene.atlas import Joined, join_by_texture, pack, sort_by_place
from vrchain.scene.model import Scene

_NEAR_M, _FAR_M = 0.1, 900.0
_MARGIN_RAD = 0.02
_SKY = 0  # the id that the segmentation draws for no object; objects count from 1
_context: "_Context | None" = None


class _Context:
    """The process's one OpenGL context; a second one would disturb the first."""

    def __init__(self) -> None:
        os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
        try:
            import pyrender

            from vrchain.render.drawer import Drawer

            self.offscreen = pyrender.OffscreenRenderer(64, 64)
            self.drawer = self.offscreen._renderer = Drawer(64, 64)
        except Exception as error:  # a missing library surfaces as almost any kind of exception
            raise RenderError(
                f"cannot start the renderer ({type(error).__name__}: {error}): on Debian install "
                "libgl1 libegl1 libgomp1 libx11-6 libxrender1"
            ) from error
        self._thread = threading.get_ident()
        atexit.register(self.close)

    def close(self) -> None:
        """Free OpenGL early: at the interpreter's very end PyOpenGL prints complaints to stdout."""
        with contextlib.suppress(Exception):  # nobody is left to mend anything
            self.offscreen.delete()

    def check_thread(self) -> None:
        if threading.get_ident() != self._thread:
            raise RenderError("draw from the thread that drew first: OpenGL contexts stay with it")


def _shared_context() -> _Context:
    global _context
    if _context is None:
        _context = _Context()
    return _context


class Renderer:
    """Draws one scene from any pose."""

    def __init__(self, scene: Scene) -> None:
        self._context = _shared_context()
        self.scene = scene
        surfaces = [s for o in scene.objects for s in o.surfaces]
        ids = [i + 1 for i, o in enumerate(scene.objects) for _ in o.surfaces]
        packed = pack(surfaces)
        if scene.sky is not None:  # last, so that little of it is drawn in vain
            sky = join_by_texture([scene.sky])[0]
            packed.append(replace(sky, owner=sky.owner + len(ids)))
        sorted_ = [sort_by_place(surface) for surface in packed]
        self._squares = [_Squares(surface, starts) for surface, starts in sorted_]
        self._drawable = self._prepare([s for s, _ in sorted_], np.array([*ids, _SKY]))

    def render(self, pose: Pose, rig: CameraRig | None = None) -> Panorama:
        """The panorama seen from ``pose``; the same bytes every time."""
        rig = rig or CameraRig()
        return Panorama(rig, self._views(pose, rig, "colour"))

    def segmentation(self, pose: Pose, rig: CameraRig | None = None) -> NDArray[np.int32]:
        """Object id a pixel, -1 for sky: (n_views, height_px, width_px) int32."""
        views = self._views(pose, rig or CameraRig(), "objects")
        low, middle, high = np.moveaxis(views.astype(np.int32), -1, 0)
        return low + (middle << 8) + (high << 16) - 1

    def _prepare(self, surfaces: list[Joined], ids: NDArray[np.int64]) -> Any:
        """A pyrender scene of one mesh, a primitive for each surface."""
        import pyrender

        drawable = pyrender.Scene(bg_color=(*[c / 255 for c in self.scene.sky_rgb], 1.0))
        primitives = []
        for surface in surfaces:
            texture = pyrender.Texture(source=surface.texture, source_channels="RGB")
            drawn = ids[surface.owner]
            bytes_ = np.stack([drawn & 255, drawn >> 8 & 255, drawn >> 16], axis=1) / 255
            light = np.clip(surface.shade, 0.0, 1.0)[:, None]
            primitives.append(
                pyrender.Primitive(
                    positions=surface.vertices_m,
                    indices=surface.faces,
                    texcoord_0=surface.uv,
                    color_0=np.concatenate([light, bytes_], axis=1).astype(np.float32),
                    material=pyrender.MetallicRoughnessMaterial(baseColorTexture=texture),
                    mode=4,
                )
            )
        if primitives:
            drawable.add(pyrender.Mesh(primitives))
        return drawable

    def _views(
        self, pose: Pose, rig: CameraRig, what: Literal["colour", "objects"]
    ) -> NDArray[np.uint8]:
        from vrchain.render.drawer import Runs

        self._context.check_thread()
        lens = _camera_to_clip(rig)
        views = np.empty((rig.n_views, rig.height_px, rig.width_px, 3), dtype=np.uint8)
        for view, azimuth in zip(views, rig.azimuths_rad, strict=True):
            camera = lens @ np.linalg.inv(_camera_to_world(pose, azimuth, rig.camera_height_m))
            shown = [Runs(*squares.in_view(pose, azimuth, rig)) for squares in self._squares]
            size_px = rig.width_px, rig.height_px
            view[:] = self._context.drawer.draw(self._drawable, camera, shown, size_px, what)
        return views


class _Squares:
    """Which triangles of a surface a view can show: most time goes into the others' vertices."""

    def __init__(self, surface: Joined, starts: NDArray[np.int64]) -> None:
        self._first, self._count = starts[:-1], np.diff(starts)
        corners = surface.vertices_m[surface.faces][:, :, :2].astype(float)
        low = np.minimum.reduceat(corners.min(axis=1), starts[:-1])
        high = np.maximum.reduceat(corners.max(axis=1), starts[:-1])
        self._centre_m, self._radius_m = (low + high) / 2, np.hypot(*(high - low).T) / 2

    def in_view(
        self, pose: Pose, azimuth_rad: float, rig: CameraRig
    ) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """First triangle and number of triangles of each square, the nearest first.

        A square is taken for its circle on the map.
        """
        offset = self._centre_m - pose.xy_m
        distance = np.hypot(*offset.T)
        reach = np.arcsin(np.clip(self._radius_m / np.maximum(distance, 1e-9), 0, 1))
        bearing = np.arctan2(offset[:, 1], offset[:, 0]) - pose.yaw_rad - azimuth_rad
        half_rad = np.radians(rig.field_of_view_deg) / 2
        seen = np.abs(wrap_angle_rad(bearing)) < half_rad + reach + _MARGIN_RAD
        chosen = np.flatnonzero(seen | (distance <= self._radius_m))
        chosen = chosen[np.argsort(distance[chosen], kind="stable")]
        return self._first[chosen], self._count[chosen]


def _camera_to_world(pose: Pose, azimuth_rad: float, height_m: float) -> NDArray[np.float64]:
    """OpenGL camera (x right, y up, -z ahead) to world, (4, 4)."""
    yaw = pose.yaw_rad + azimuth_rad
    ahead = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    right = np.array([np.sin(yaw), -np.cos(yaw), 0.0])
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2] = right, (0.0, 0.0, 1.0), -ahead
    matrix[:3, 3] = pose.x_m, pose.y_m, height_m
    return matrix


def _camera_to_clip(rig: CameraRig) -> NDArray[np.float64]:
    """OpenGL's perspective projection, (4, 4)."""
    scale = 1 / np.tan(rig.vertical_field_of_view_rad / 2)
    depth_m = _NEAR_M - _FAR_M
    matrix = np.zeros((4, 4))
    matrix[0, 0], matrix[1, 1] = scale * rig.height_px / rig.width_px, scale
    matrix[2, 2:] = (_FAR_M + _NEAR_M) / depth_m, 2 * _FAR_M * _NEAR_M / depth_m
    matrix[3, 2] = -1.0
    return matrix

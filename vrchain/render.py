"""Drawing panoramas with pyrender on EGL: the only module that touches OpenGL.

The light is baked into the scene, so everything is drawn flat and in one mesh: pyrender draws
nodes in an order that varies between processes, the primitives of one mesh it does not.
"""

import atexit
import contextlib
import os
import threading
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrchain.errors import RenderError
from vrchain.geometry import Pose
from vrchain.panorama import CameraRig, Panorama
from vrchain.scene.atlas import join_by_texture, pack
from vrchain.scene.model import Scene, Surface

_NEAR_M, _FAR_M = 0.1, 900.0
_context: "_Context | None" = None


class _Context:
    """The process's one OpenGL context; a second one would disturb the first."""

    def __init__(self) -> None:
        os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
        try:
            import pyrender

            self.offscreen = pyrender.OffscreenRenderer(64, 64)
        except Exception as error:  # a missing library surfaces as almost any kind of exception
            raise RenderError(
                f"cannot start the renderer ({type(error).__name__}: {error}): on Debian install "
                "libgl1 libegl1 libgomp1 libx11-6 libxrender1"
            ) from error
        self.thread = threading.get_ident()
        atexit.register(self.close)

    def close(self) -> None:
        """Free OpenGL early: at the interpreter's very end PyOpenGL prints complaints to stdout."""
        with contextlib.suppress(Exception):  # nobody is left to mend anything
            self.offscreen.delete()

    def draw(self, scene: Any, rig: CameraRig, flags: int, **options: Any) -> NDArray[np.uint8]:
        if threading.get_ident() != self.thread:
            raise RenderError("draw from the thread that drew first: OpenGL contexts stay with it")
        self.offscreen.viewport_width = rig.width_px
        self.offscreen.viewport_height = rig.height_px
        return self.offscreen.render(scene, flags, **options)[0]


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
        if scene.sky is not None:
            surfaces.append(scene.sky)
        self._coloured = self._prepare([pack(surfaces)])
        self._by_object: Any = None

    def render(self, pose: Pose, rig: CameraRig | None = None) -> Panorama:
        """The panorama seen from ``pose``; the same bytes every time."""
        from pyrender import RenderFlags

        rig = rig or CameraRig()
        views = self._views(self._coloured, pose, rig, RenderFlags.FLAT)
        return Panorama(rig, views)

    def segmentation(self, pose: Pose, rig: CameraRig | None = None) -> NDArray[np.int32]:
        """Object id a pixel, -1 for sky: (n_views, height_px, width_px) int32."""
        from pyrender import RenderFlags

        if self._by_object is None:
            self._by_object = self._prepare(
                [join_by_texture(o.surfaces) for o in self.scene.objects]
            )
        ids = {node: int(node.name) + 1 for node in self._by_object.mesh_nodes}
        colours = {node: (i & 255, i >> 8 & 255, i >> 16) for node, i in ids.items()}
        views = self._views(
            self._by_object, pose, rig or CameraRig(), RenderFlags.SEG, seg_node_map=colours
        )
        low, middle, high = np.moveaxis(views.astype(np.int32), -1, 0)
        return low + (middle << 8) + (high << 16) - 1

    def _prepare(self, groups: list[list[Surface]]) -> Any:
        """A pyrender scene with a node, named by its index, for each group of surfaces."""
        import pyrender

        drawable = pyrender.Scene(bg_color=(*[c / 255 for c in self.scene.sky_rgb], 1.0))
        for index, group in enumerate(groups):
            if group:
                primitives = [_primitive(surface) for surface in group]
                drawable.add(pyrender.Mesh(primitives), name=str(index))
        return drawable

    def _views(
        self, drawable: Any, pose: Pose, rig: CameraRig, flags: int, **options: Any
    ) -> NDArray[np.uint8]:
        import pyrender

        camera = pyrender.PerspectiveCamera(
            rig.vertical_field_of_view_rad,
            _NEAR_M,
            _FAR_M,
            aspectRatio=rig.width_px / rig.height_px,
        )
        node = drawable.add(camera)
        drawable.main_camera_node = node
        views = np.empty((rig.n_views, rig.height_px, rig.width_px, 3), dtype=np.uint8)
        try:
            for view, azimuth in zip(views, rig.azimuths_rad, strict=True):
                drawable.set_pose(node, _camera_to_world(pose, azimuth, rig.camera_height_m))
                view[:] = self._context.draw(drawable, rig, flags, **options)
        finally:
            drawable.remove_node(node)
        return views


def _camera_to_world(pose: Pose, azimuth_rad: float, height_m: float) -> NDArray[np.float64]:
    """OpenGL camera (x right, y up, -z ahead) to world, (4, 4)."""
    yaw = pose.yaw_rad + azimuth_rad
    ahead = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    right = np.array([np.sin(yaw), -np.cos(yaw), 0.0])
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2] = right, (0.0, 0.0, 1.0), -ahead
    matrix[:3, 3] = pose.x_m, pose.y_m, height_m
    return matrix


def _primitive(surface: Surface) -> Any:
    import pyrender

    material = pyrender.MetallicRoughnessMaterial(
        baseColorTexture=pyrender.Texture(source=surface.texture, source_channels="RGB"),
        doubleSided=True,
    )
    shade = np.clip(surface.shade, 0.0, 1.0)[:, None].astype(np.float32)
    return pyrender.Primitive(
        positions=surface.vertices_m,
        indices=surface.faces,
        texcoord_0=surface.uv,
        color_0=np.concatenate([np.repeat(shade, 3, axis=1), np.ones_like(shade)], axis=1),
        material=material,
        mode=4,
    )

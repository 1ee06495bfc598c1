"""Drawing panoramas with pyrender on EGL: the only module that touches OpenGL.

The light is baked into the scene, so everything is drawn flat and in one mesh: pyrender draws
nodes in an order that varies between processes, the primitives of one mesh it does not.
"""

import atexit
import contextlib
import os
import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vrchain.errors import RenderError
from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.panorama import CameraRig, Panorama
from vrchain.scene.atlas import join_by_texture, pack, split_by_place
from vrchain.scene.model import Scene, Surface

_NEAR_M, _FAR_M = 0.1, 900.0
_MARGIN_RAD = 0.02
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
        self.loaded: Any = None  # the scene whose textures and vertices OpenGL holds
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
        image = self.offscreen.render(scene, flags, **options)[0]
        self.loaded = scene
        return image


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
        packed = pack([s for o in scene.objects for s in o.surfaces])
        parts = [part for surface in packed for part in split_by_place(surface)]
        if scene.sky is not None:
            parts.append(scene.sky)
        self._coloured = self._prepare([parts])
        self._parts = _Parts(parts)
        self._by_object: Any = None

    def render(self, pose: Pose, rig: CameraRig | None = None) -> Panorama:
        """The panorama seen from ``pose``; the same bytes every time."""
        from pyrender import RenderFlags

        rig = rig or CameraRig()
        views = self._views(self._coloured, pose, rig, RenderFlags.FLAT, cull=True)
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
                textures = {id(s.texture): s.texture for s in group}
                materials = {key: _material(texture) for key, texture in textures.items()}
                primitives = [_primitive(s, materials[id(s.texture)]) for s in group]
                drawable.add(pyrender.Mesh(primitives), name=str(index))
        return drawable

    def _views(
        self,
        drawable: Any,
        pose: Pose,
        rig: CameraRig,
        flags: int,
        cull: bool = False,
        **options: Any,
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
                if cull and drawable.meshes and self._context.loaded is drawable:
                    in_view = self._parts.in_view(pose, azimuth, rig)
                    with _only(drawable, in_view):
                        view[:] = self._context.draw(drawable, rig, flags, **options)
                else:
                    view[:] = self._context.draw(drawable, rig, flags, **options)
        finally:
            drawable.remove_node(node)
        return views


class _Parts:
    """Which parts of a scene a view can show: most of the time goes into the others' vertices."""

    def __init__(self, parts: list[Surface]) -> None:
        corners = [
            (p.vertices_m[:, :2].min(axis=0), p.vertices_m[:, :2].max(axis=0)) for p in parts
        ]
        self._centre_m = np.array([(low + high) / 2 for low, high in corners]).reshape(-1, 2)
        self._radius_m = np.array([np.linalg.norm(high - low) / 2 for low, high in corners])
        textures = [id(p.texture) for p in parts]
        # pyrender forgets a texture that no part drawn has, and loading it again is slow
        self._keep = np.array([textures.index(t) == i for i, t in enumerate(textures)], dtype=bool)

    def in_view(self, pose: Pose, azimuth_rad: float, rig: CameraRig) -> NDArray[np.bool_]:
        """(n_parts,) bool; a part is taken for its circle on the map."""
        offset = self._centre_m - pose.xy_m
        distance = np.hypot(*offset.T)
        reach = np.arcsin(np.clip(self._radius_m / np.maximum(distance, 1e-9), 0, 1))
        bearing = np.arctan2(offset[:, 1], offset[:, 0]) - pose.yaw_rad - azimuth_rad
        half_rad = np.radians(rig.field_of_view_deg) / 2
        seen = np.abs(wrap_angle_rad(bearing)) < half_rad + reach + _MARGIN_RAD
        return seen | (distance <= self._radius_m) | self._keep


@contextlib.contextmanager
def _only(drawable: Any, chosen: NDArray[np.bool_]) -> Iterator[None]:
    """Draw these primitives of a scene's one mesh and no others."""
    (mesh,) = drawable.meshes
    primitives = mesh.primitives
    mesh.primitives = [p for p, c in zip(primitives, chosen, strict=True) if c]
    try:
        yield
    finally:
        mesh.primitives = primitives


def _camera_to_world(pose: Pose, azimuth_rad: float, height_m: float) -> NDArray[np.float64]:
    """OpenGL camera (x right, y up, -z ahead) to world, (4, 4)."""
    yaw = pose.yaw_rad + azimuth_rad
    ahead = np.array([np.cos(yaw), np.sin(yaw), 0.0])
    right = np.array([np.sin(yaw), -np.cos(yaw), 0.0])
    matrix = np.eye(4)
    matrix[:3, 0], matrix[:3, 1], matrix[:3, 2] = right, (0.0, 0.0, 1.0), -ahead
    matrix[:3, 3] = pose.x_m, pose.y_m, height_m
    return matrix


def _primitive(surface: Surface, material: Any) -> Any:
    import pyrender

    shade = np.clip(surface.shade, 0.0, 1.0)[:, None].astype(np.float32)
    return pyrender.Primitive(
        positions=surface.vertices_m,
        indices=surface.faces,
        texcoord_0=surface.uv,
        color_0=np.concatenate([np.repeat(shade, 3, axis=1), np.ones_like(shade)], axis=1),
        material=material,
        mode=4,
    )


def _material(texture: NDArray[np.uint8]) -> Any:
    import pyrender

    return pyrender.MetallicRoughnessMaterial(
        baseColorTexture=pyrender.Texture(source=texture, source_channels="RGB"), doubleSided=True
    )

"""Drawing panoramas with pyrender on EGL: the only package that touches OpenGL.

The light is baked into the scene, so everything is drawn flat and in one mesh: pyrender draws
nodes in an order that varies between processes, the primitives of one mesh it does not.
"""

import atexit
import contextlib
import os
import threading
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from vrchain.errors import RenderError
from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.panorama import CameraRig, Panorama
from vrchain.world.atlas import Joined, join_by_texture, pack, sort_by_place
from vrchain.world.model import LightMap, Scene, Surface
from vrchain.world.things import pioneer

_NEAR_M, _FAR_M = 0.1, 900.0
_MARGIN_RAD = 0.02
_LINEAR, _CLAMP = 0x2601, 0x812F  # OpenGL's and glTF's: no mipmaps; no repetition
_SKY = 0  # the id that the segmentation draws for no object; objects count from 1
_WRAP = 1 << 24  # ids are drawn in three bytes, robots' (below the sky's) as the complement


class _Context:
    """The process's one OpenGL context; a second one would disturb the first."""

    def __init__(self) -> None:
        os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
        try:
            import pyrender

            from vrchain.world.render.drawer import Drawer

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


@cache
def _shared_context() -> _Context:
    return _Context()


class Renderer:
    """Draws one scene from any pose."""

    def __init__(self, scene: Scene) -> None:
        self._context = _shared_context()
        import pyrender

        self.scene = scene
        drawn = [(i + 1, s) for i, o in enumerate(scene.objects) for s in o.surfaces]
        sky = [] if scene.sky is None else [(_SKY, scene.sky)]
        # To the sky's other side, where a map is so large.
        self._far_m = max([_FAR_M, *(2 * float(np.abs(s.vertices_m).max()) for _, s in sky)])
        light = scene.ground_light
        flat = [o for o in scene.objects if light and (o.bounds_m[:, 2] == light.height_m).all()]
        on_floor = {id(s) for o in flat for s in o.surfaces}  # what stands is lit, its floor too
        self._robot_textures: dict[str, Any] = {}
        self._standing = [
            *_prepared([(i, s) for i, s in drawn if id(s) in on_floor], join_by_texture, light),
            *_prepared([(i, s) for i, s in drawn if id(s) not in on_floor], pack),
            *_prepared(sky, pack),  # last, so that little of it is drawn in vain
        ]
        # One mesh, of all primitives.
        self._drawable = pyrender.Scene(bg_color=(*[c / 255 for c in scene.sky_rgb], 1.0))
        if self._standing:
            self._drawable.add(pyrender.Mesh([primitive for primitive, _ in self._standing]))

    def render(
        self,
        pose: Pose,
        rig: CameraRig | None = None,
        robots: Mapping[str, Pose] | None = None,
    ) -> Panorama:
        """The panorama seen from ``pose``; the same bytes every time.

        robots: the other robots in the scene, name and pose; never the one that looks. PoseError
        where no robot can stand.
        """
        rig = rig or CameraRig()
        return Panorama(rig, self._views(pose, rig, "colour", robots or {}))

    def segmentation(
        self,
        pose: Pose,
        rig: CameraRig | None = None,
        robots: Mapping[str, Pose] | None = None,
    ) -> NDArray[np.int32]:
        """Object id a pixel, -1 for sky: (n_views, height_px, width_px) int32.

        Robots have the ids -2, -3, ... in the order given. PoseError as ``render``.
        """
        views = self._views(pose, rig or CameraRig(), "objects", robots or {})
        low, middle, high = np.moveaxis(views.astype(np.int32), -1, 0)
        drawn = low + (middle << 8) + (high << 16)
        return np.where(drawn < _WRAP // 2, drawn, drawn - _WRAP) - 1

    @contextlib.contextmanager
    def _among(self, robots: Mapping[str, Pose]) -> Iterator[list[tuple[Any, "_Squares"]]]:
        """The robots' primitives, which are in the scene for as long as this lasts."""
        import pyrender

        moving = []
        for index, robot in enumerate(pioneer.placed(self.scene, robots)):
            surface = robot.surfaces[0]
            if robot.name not in self._robot_textures:
                self._robot_textures[robot.name] = _texture(surface)
            drawn = np.full(len(surface.vertices_m), pioneer.FIRST_ID - index + 1)
            primitive = _primitive(surface, drawn, self._robot_textures[robot.name])
            moving.append((primitive, _Squares(surface, np.array([0, len(surface.faces)]))))
        node = self._drawable.add(pyrender.Mesh([p for p, _ in moving])) if moving else None
        try:
            yield moving
        finally:
            if node is not None:
                self._drawable.remove_node(node)

    def _views(
        self,
        pose: Pose,
        rig: CameraRig,
        what: Literal["colour", "objects"],
        robots: Mapping[str, Pose],
    ) -> NDArray[np.uint8]:
        self.scene.check_pose(pose)
        self._context.check_thread()
        lens = _camera_to_clip(rig, self._far_m)
        views = np.empty((rig.n_views, rig.height_px, rig.width_px, 3), dtype=np.uint8)
        with self._among(robots) as moving:
            for view, azimuth in zip(views, rig.azimuths_rad, strict=True):
                camera = lens @ np.linalg.inv(_camera_to_world(pose, azimuth, rig.camera_height_m))
                shown = [
                    (primitive, *squares.in_view(pose, azimuth, rig))
                    for primitive, squares in [*moving, *self._standing]
                ]
                size_px = rig.width_px, rig.height_px
                view[:] = self._context.drawer.draw(
                    self._drawable, camera, shown, size_px, what, self.scene.ground_light
                )
        return views


def _texture(surface: Surface) -> Any:
    import pyrender

    channels = "RGBA" if surface.cut_out else "RGB"
    return pyrender.Texture(source=surface.texture, source_channels=channels)


def _prepared(
    surfaces: list[tuple[int, Surface]],
    joined: Callable[[list[Surface]], list[Joined]],
    light_map: LightMap | None = None,
) -> Iterator[tuple[Any, "_Squares"]]:
    """Primitives of surfaces and the ids they are drawn with, joined, and their squares."""
    import pyrender

    light = None
    if light_map is not None:
        sampler = pyrender.Sampler(minFilter=_LINEAR, wrapS=_CLAMP, wrapT=_CLAMP)
        light = pyrender.Texture(sampler=sampler, source=light_map.image, source_channels="RGB")
    ids = np.array([i for i, _ in surfaces])
    for surface in joined([s for _, s in surfaces]):
        ordered, starts = sort_by_place(surface)
        primitive = _primitive(ordered, ids[ordered.owner], _texture(ordered), light)
        yield primitive, _Squares(ordered, starts)


def _primitive(
    surface: Surface, drawn: NDArray[np.int64], texture: Any, light_map: Any = None
) -> Any:
    """A surface for pyrender; drawn: (n,) the id, from 0, that each vertex is drawn with."""
    import pyrender

    light = surface.shade_rgb.clip(0.0, 1.0)
    number = drawn % _WRAP  # 24 bits: a float32 holds it exactly
    return pyrender.Primitive(
        positions=surface.vertices_m,
        indices=surface.faces,
        texcoord_0=surface.uv,
        color_0=np.column_stack([light, number]).astype(np.float32),
        material=pyrender.MetallicRoughnessMaterial(
            baseColorTexture=texture, occlusionTexture=light_map
        ),
        mode=4,
    )


class _Squares:
    """Which triangles of a surface a view can show: most time goes into the others' vertices."""

    def __init__(self, surface: Surface, starts: NDArray[np.int64]) -> None:
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


def _camera_to_clip(rig: CameraRig, far_m: float) -> NDArray[np.float64]:
    """OpenGL's perspective projection, (4, 4)."""
    scale = 1 / np.tan(rig.vertical_field_of_view_rad / 2)
    depth_m = _NEAR_M - far_m
    matrix = np.zeros((4, 4))
    matrix[0, 0], matrix[1, 1] = scale * rig.height_px / rig.width_px, scale
    matrix[2, 2:] = (far_m + _NEAR_M) / depth_m, 2 * far_m * _NEAR_M / depth_m
    matrix[3, 2] = -1.0
    return matrix

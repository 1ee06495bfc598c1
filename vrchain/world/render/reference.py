"""pyrender's own way with lights: what drawing with baked light is measured against."""

from typing import Any

import numpy as np

from vrchain.geometry import Pose, rotation_z
from vrchain.panorama import CameraRig, Panorama
from vrchain.world.atlas import Joined, join_by_texture, pack
from vrchain.world.light import vertex_normals
from vrchain.world.model import Scene
from vrchain.world.render import _FAR_M, _NEAR_M, _camera_to_world, _shared_context, _texture


class LitRenderer:
    """Draws a scene by pyrender's physically based shaders, lit by its sun, no shadows.

    The triangles are packed as ``Renderer`` packs them, or pyrender would take longer still. It
    keeps the depth, which this path always reads back, to itself.
    """

    def __init__(self, scene: Scene) -> None:
        import pyrender

        self._context = _shared_context()
        packed = pack([s for o in scene.objects for s in o.surfaces])
        packed += join_by_texture([scene.sky] if scene.sky is not None else [])
        sky = [c / 255 for c in scene.sky_rgb]
        self._drawable = pyrender.Scene(bg_color=(*sky, 1.0), ambient_light=(0.4, 0.4, 0.4))
        if packed:
            self._drawable.add(pyrender.Mesh([_primitive(surface) for surface in packed]))
        sun = np.eye(4)
        elevation_rad = np.radians(scene.light.sun_elevation_deg)
        c, s = np.sin(elevation_rad), np.cos(elevation_rad)
        tilt = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])  # +z towards the sun
        sun[:3, :3] = rotation_z(np.radians(scene.light.sun_azimuth_deg)) @ tilt
        self._drawable.add(pyrender.DirectionalLight(intensity=3.0), pose=sun)
        self._camera = self._drawable.add(
            pyrender.PerspectiveCamera(1.0, znear=_NEAR_M, zfar=_FAR_M)
        )

    def render(self, pose: Pose, rig: CameraRig | None = None) -> Panorama:
        """The panorama seen from ``pose``."""
        from pyrender.constants import RenderFlags

        self._context.check_thread()
        rig = rig or CameraRig()
        drawer = self._context.drawer
        drawer.viewport_width, drawer.viewport_height = rig.width_px, rig.height_px
        self._camera.camera.yfov = rig.vertical_field_of_view_rad
        views = np.empty((rig.n_views, rig.height_px, rig.width_px, 3), dtype=np.uint8)
        for view, azimuth in zip(views, rig.azimuths_rad, strict=True):
            self._drawable.set_pose(
                self._camera, _camera_to_world(pose, azimuth, rig.camera_height_m)
            )
            view[:] = drawer.render(self._drawable, RenderFlags.OFFSCREEN)[0]
        return Panorama(rig, views)


def _primitive(surface: Joined) -> Any:
    import pyrender

    material = pyrender.MetallicRoughnessMaterial(
        baseColorTexture=_texture(surface),
        metallicFactor=0.0,
        roughnessFactor=1.0,
        alphaMode="MASK" if surface.cut_out else "OPAQUE",
        doubleSided=True,
    )
    return pyrender.Primitive(
        positions=surface.vertices_m,
        normals=vertex_normals(surface.vertices_m, surface.faces).astype(np.float32),
        indices=surface.faces,
        texcoord_0=surface.uv,
        material=material,
        mode=4,
    )

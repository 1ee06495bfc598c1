"""A scene in three dimensions inside a notebook, or in any browser, without network.

One page holds everything: the scene as GLB (textures shrunk, packed by gzip), and a small WebGL
program that draws it with its baked light, as the renderer does. The viewer that trimesh ships was
tried in its place: baked colours come out too dark, robots have no names, the camera rolls, and the
page is 2.5 times as large.
"""

import base64
import gzip
import html
import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib import resources

import numpy as np

from vrchain.errors import OutputError
from vrchain.geometry import Pose
from vrchain.world.export import glb_bytes
from vrchain.world.model import Scene, SceneObject, Surface, check_on_map, place
from vrchain.world.things import pioneer

_PIN_FOOT_M, _PIN_M = 1.3, 7.0  # above the robot; high enough to be found among houses


@dataclass(frozen=True)
class View:
    """A page to look at: shown by a notebook, or written to an .html file as it is."""

    page: str = field(repr=False)  # megabytes
    height_px: int

    def _repr_html_(self) -> str:
        # a document of its own, so that no style or name of the notebook's touches it
        return (
            f'<iframe srcdoc="{html.escape(self.page)}" width="100%" height="{self.height_px}" '
            'style="border: none"></iframe>'
        )


def view(
    scene: Scene,
    robots: Mapping[str, Pose] | None = None,
    *,
    max_texture_px: int = 256,
    height_px: int = 520,
) -> View:
    """A scene to turn and to walk around; over each robot a pin with an arrow along its heading.

    robots: name and pose; the scene's own if none are given. Textures larger than
    ``max_texture_px`` are shrunk: the page of a whole suburb takes some MB. PoseError for what is
    no pose on the map.
    """
    if max_texture_px < 1 or height_px < 1:
        raise OutputError(
            f"expected sizes of 1 pixel and more, got max_texture_px={max_texture_px}, "
            f"height_px={height_px}"
        )
    team = dict(scene.robots) if robots is None else robots
    for pose in team.values():
        check_on_map(pose, scene.extent_m)
    bodies = [replace(body, name=f"robot {body.name}") for body in pioneer.placed(scene, team)]
    pins = [_pin(name, pose) for name, pose in team.items()]
    shown = replace(scene, objects=(*scene.objects, *bodies, *pins))
    packed = gzip.compress(glb_bytes(shown, max_texture_px, webp=True), mtime=0)
    start = {
        "target": [0.0, 0.0, 0.0],
        "yaw": 0.6,
        "pitch": 0.6,
        "distance": 0.65 * float(np.hypot(*scene.extent_m)),
        "sky": [c / 255 for c in scene.sky_rgb],
    }
    page = resources.files(__package__).joinpath("page.html").read_text(encoding="utf-8")
    page = page.replace("$TITLE", html.escape(scene.name)).replace("$VIEW", json.dumps(start))
    return View(page.replace("$DATA", base64.b64encode(packed).decode()), height_px)


def _pin(name: str, pose: Pose) -> SceneObject:
    """A cone on its tip at the pose, and an arrow that points along the heading."""
    angle = 2 * np.pi * np.arange(8) / 8
    ring = np.stack([np.cos(angle), np.sin(angle), np.full(8, _PIN_M)], axis=1)
    arrow = np.array([[0.0, 1.4, _PIN_M], [0.0, -1.4, _PIN_M], [4.0, 0.0, _PIN_M]])
    vertices = np.concatenate([[[0.0, 0.0, _PIN_FOOT_M]], ring, arrow]).astype(np.float32)
    sides = [[0, 1 + i, 1 + (i + 1) % 8] for i in range(8)]
    colour = np.full((4, 4, 3), pioneer.colour_of(name), dtype=np.uint8)
    surface = Surface(
        vertices,
        np.array([*sides, [9, 10, 11]], dtype=np.int32),
        np.zeros((len(vertices), 2), dtype=np.float32),
        np.linspace(0.7, 1.0, len(vertices), dtype=np.float32),
        colour,
    )
    return place(f"pin {name}", "pin", name, [surface], pose, landmark=False, solid=False)

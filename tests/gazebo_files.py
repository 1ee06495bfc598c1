"""Gazebo worlds and models written for tests, as small as what they test allows."""

import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import pytest

from vrchain.errors import UnsupportedWarning
from vrchain.world import Scene, SceneObject, load_scene

BOX_XYZ = [(x, y, z) for z in (0, 1) for y in (0, 1) for x in (0, 1)]
BOX_FACES = [
    (0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4),
    (2, 6, 7), (2, 7, 3), (0, 4, 6), (0, 6, 2), (1, 3, 7), (1, 7, 5),
]  # fmt: skip
SUN = '<light name="sun" type="directional"><direction>-0.5 0.1 -0.9</direction></light>'
Files = Mapping[str, str | bytes]
UNWARNED = pytest.mark.filterwarnings("error::vrchain.errors.UnsupportedWarning")
GROUND = "<plane><normal>0 0 1</normal><size>100 100</size></plane>"


@pytest.fixture(autouse=True)
def no_folders(monkeypatch: pytest.MonkeyPatch) -> None:
    """For tests that import it: no model folders but those beside the world."""
    for variable in ("GAZEBO_MODEL_PATH", "GZ_SIM_RESOURCE_PATH"):
        monkeypatch.delenv(variable, raising=False)


def load(folder: Path, body: str, files: Files | None = None) -> Scene:
    """A world, which stands in worlds/, beside models/."""
    write(folder, {"worlds/test.world": world(body), **(files or {})})
    return load_scene(folder / "worlds" / "test.world")


def only(scene: Scene) -> SceneObject:
    (thing,) = scene.objects
    return thing


def drawn(
    folder: Path, geometry: str, files: Files | None = None, material: str = ""
) -> SceneObject:
    """The one object of a world of one visual."""
    return only(load(folder, model(visual(geometry, material=material)), files))


@contextmanager
def told(*parts: str) -> Iterator[None]:
    """One warning, of one line, that holds all these."""
    with pytest.warns(UnsupportedWarning) as caught:
        yield
    (line,) = [str(w.message) for w in caught]
    assert "\n" not in line and [part for part in parts if part not in line] == []


def write(folder: Path, files: Files) -> Path:
    """Files by their paths below a folder."""
    for name, content in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return folder


def world(body: str, version: str = "1.6") -> str:
    return f'<sdf version="{version}"><world name="test">{body}</world></sdf>'


def model(visuals: str, pose: str = "", name: str = "thing", link_pose: str = "") -> str:
    """A model of one link."""
    return (
        f'<model name="{name}"><static>1</static>{_pose(pose)}'
        f'<link name="link">{_pose(link_pose)}{visuals}</link></model>'
    )


def visual(geometry: str, pose: str = "", material: str = "") -> str:
    return f'<visual name="v">{_pose(pose)}<geometry>{geometry}</geometry>{material}</visual>'


def mesh(uri: str, more: str = "") -> str:
    return f"<mesh><uri>{uri}</uri>{more}</mesh>"


def box(size: str) -> str:
    return f"<box><size>{size}</size></box>"


def include(uri: str, pose: str = "", name: str = "") -> str:
    named = f"<name>{name}</name>" if name else ""
    return f"<include>{named}<uri>{uri}</uri>{_pose(pose)}</include>"


def config(*sdf: tuple[str, str]) -> str:
    """A model.config that lists versions and files."""
    listed = "".join(f'<sdf version="{version}">{file}</sdf>' for version, file in sdf)
    return f"<model><name>m</name>{listed}</model>"


def folder_of(name: str, body: str) -> dict[str, str]:
    """The files of a model's folder, below models/."""
    return {
        f"models/{name}/model.config": config(("1.6", "model.sdf")),
        f"models/{name}/model.sdf": f'<sdf version="1.6">{body}</sdf>',
    }


def png(rgba: tuple[int, ...], size_px: int = 4) -> bytes:
    """A picture of one colour, RGB or RGBA."""
    return picture(np.full((size_px, size_px, len(rgba)), rgba, dtype=np.uint8))


def picture(image: np.ndarray) -> bytes:
    order = [2, 1, 0, 3][: image.shape[2]]
    return cv2.imencode(".png", image[..., order])[1].tobytes()


def obj(scale: float = 1.0, more: str = "") -> str:
    """A unit box as OBJ, with texture coordinates."""
    lines = [f"v {x * scale} {y * scale} {z * scale}" for x, y, z in BOX_XYZ]
    lines += ["vt 0 0", "vt 1 0", "vt 1 1"]
    lines += [more] if more else []
    lines += [f"f {a + 1}/1 {b + 1}/2 {c + 1}/3" for a, b, c in BOX_FACES]
    return "\n".join(lines) + "\n"


def stl() -> bytes:
    """A unit box as binary STL."""
    body = b"".join(
        struct.pack("<12fH", 0, 0, 0, *(v for i in face for v in BOX_XYZ[i]), 0)
        for face in BOX_FACES
    )
    return bytes(80) + struct.pack("<I", len(BOX_FACES)) + body


def dae(
    *,
    meter: float = 1.0,
    up: str = "Z_UP",
    nodes: str | None = None,
    positions: str | None = None,
    picture: str = "",
    doctype: str = "",
    extra: str = "",
) -> str:
    """A unit box as COLLADA; ``nodes`` replaces the one node that shows it."""
    places = positions or " ".join(f"{x} {y} {z}" for x, y, z in BOX_XYZ)
    corners = " ".join(f"{i} {k}" for face in BOX_FACES for k, i in enumerate(face))
    diffuse = '<texture texture="s" texcoord="UV"/>' if picture else "<color>1 0 0 1</color>"
    images, params = "", ""
    if picture:
        images = f'<image id="i"><init_from>{picture}</init_from></image>'
        params = (
            '<newparam sid="f"><surface type="2D"><init_from>i</init_from></surface></newparam>'
            '<newparam sid="s"><sampler2D><source>f</source></sampler2D></newparam>'
        )
    shown = nodes if nodes is not None else f'<node name="Box">{INSTANCE}</node>'
    return f"""<?xml version="1.0"?>{doctype}
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit name="u" meter="{meter}"/><up_axis>{up}</up_axis></asset>
<library_images>{images}</library_images>
<library_effects><effect id="e"><profile_COMMON>{params}<technique sid="t"><phong>
<diffuse>{diffuse}</diffuse></phong></technique></profile_COMMON></effect></library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="24">{places}</float_array><technique_common>
<accessor source="#pa" count="8" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<source id="t"><float_array id="ta" count="6">0 0 1 0 1 1</float_array><technique_common>
<accessor source="#ta" count="3" stride="2"><param name="S" type="float"/>
<param name="T" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="12" material="M"><input semantic="VERTEX" source="#v" offset="0"/>
<input semantic="TEXCOORD" source="#t" offset="1" set="0"/><p>{corners}</p></triangles>
</mesh></geometry></library_geometries>{extra}
<library_visual_scenes><visual_scene id="scene">{shown}</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#scene"/></scene></COLLADA>"""


INSTANCE = (
    '<instance_geometry url="#g"><bind_material><technique_common>'
    '<instance_material symbol="M" target="#m"/></technique_common></bind_material>'
    "</instance_geometry>"
)


def _pose(pose: str) -> str:
    return f"<pose>{pose}</pose>" if pose else ""


GROUND_MODEL = model(visual(GROUND), name="ground_plane")
CUBE = visual(box("1 1 1"))

"""A scene written as GLB, read again by another reader: names, places, triangles, pictures."""

import io
import json
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import worlds

from vrchain.errors import OutputError
from vrchain.geometry import Pose
from vrchain.world.export import SHADOWS, export_scene, glb_bytes
from vrchain.world.model import LightMap, Scene, place

RED, GREEN = worlds.plain((200, 10, 20)), worlds.blotches("green")
LEAVES = np.dstack([GREEN, np.where(GREEN[..., 0] > 120, 255, 0).astype(np.uint8)])
CORNERS = [(0.0, 0.0, 0.0), (2.0, 0.0, 0.0), (2.0, 0.0, 3.0), (0.0, 0.0, 3.0)]


def small() -> Scene:
    """Two boxes that share a texture, and a tree of two textures, one a cut-out."""
    trunk, leaves = worlds.quad(CORNERS, RED), worlds.quad(CORNERS, LEAVES)
    dim = replace(leaves, shade=np.array([0.0, 0.25, 0.5, 1.0], dtype=np.float32))
    tree = place("tree", "tree", "elm", [trunk, dim], Pose(6.0, -7.0, 0.4), landmark=True)
    boxes = [worlds.box(name, (x, 2.0), (1.0, 2.0, 3.0), RED) for name, x in (("a", 1), ("b", 8))]
    return worlds.world(*boxes, tree)


def read(glb: bytes) -> Any:
    return trimesh.load_scene(io.BytesIO(glb), file_type="glb")


def header(glb: bytes) -> dict[str, Any]:
    (length,) = struct.unpack("<I", glb[12:16])
    return json.loads(glb[20 : 20 + length])


def meshes_of(loaded: Any, name: str) -> list[Any]:
    """The meshes at a node or at its children, in their order."""
    nodes = [n for n in loaded.graph.nodes_geometry if n == name or n.rpartition("/")[0] == name]
    return [loaded.geometry[loaded.graph[n][1]] for n in sorted(nodes)]


def test_another_reader_finds_every_object_where_it_is() -> None:
    scene = small()
    loaded = read(glb_bytes(scene))
    assert {o.name for o in scene.objects} <= set(loaded.graph.nodes)
    assert len(loaded.geometry) == sum(
        len({id(s.texture) for s in o.surfaces}) for o in scene.objects
    )
    assert loaded.metadata["name"] == scene.name
    for thing in scene.objects:
        meshes = meshes_of(loaded, thing.name)
        assert sum(len(m.faces) for m in meshes) == sum(len(s.faces) for s in thing.surfaces)
        points = np.concatenate([m.vertices for m in meshes])
        x, y, z = points.T  # y up: turned back to z up
        back = np.stack([x, -z, y], axis=1)
        assert np.array_equal([back.min(axis=0), back.max(axis=0)], thing.bounds_m)
        for mesh in meshes:
            told = {"kind": thing.kind, "model": thing.model, "landmark": thing.landmark}
            assert told.items() <= mesh.metadata.items()


def test_triangles_keep_their_order_and_their_front() -> None:
    scene = small()
    loaded = read(glb_bytes(scene))
    surface = scene.objects[-1].surfaces[0]
    mesh = meshes_of(loaded, "tree")[0]
    assert np.array_equal(mesh.faces, surface.faces)
    assert np.allclose(mesh.visual.uv, surface.uv)
    corners = surface.vertices_m[surface.faces[0]].astype(float)
    front = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    turned = mesh.face_normals[0]
    assert np.allclose([turned[0], -turned[2], turned[1]], front / np.linalg.norm(front), atol=1e-5)


def test_textures_are_kept_to_the_byte_and_shared() -> None:
    glb = glb_bytes(small())
    loaded, tree = read(glb), header(glb)
    shown = (("a", 0, RED), ("b", 0, RED), ("tree", 0, RED), ("tree", 1, LEAVES))
    for name, number, texture in shown:
        material = meshes_of(loaded, name)[number].visual.material
        assert np.array_equal(np.asarray(material.baseColorTexture), texture)
        assert material.alphaMode == ("MASK" if texture is LEAVES else "OPAQUE")
    assert len(tree["images"]) == 3  # red, leaves, the ground's
    assert {m.get("alphaCutoff") for m in tree["materials"]} == {None, 128 / 255}
    assert all("KHR_materials_unlit" in m["extensions"] for m in tree["materials"])
    assert tree["extensionsUsed"] == ["KHR_materials_unlit"]


def test_baked_light_is_the_vertices_colour_as_gltf_counts_light() -> None:
    colour = meshes_of(read(glb_bytes(small())), "tree")[1].visual.vertex_attributes["color"]
    assert np.array_equal(colour[:, 3], [255] * 4)
    assert np.array_equal(colour[:, 0], np.round(255 * np.array([0, 0.25, 0.5, 1]) ** 2.2))
    assert np.array_equal(colour[:, 0], colour[:, 2])


def test_light_on_the_ground_is_a_sheet_over_it() -> None:
    image = np.full((20, 10, 3), (200, 220, 240), dtype=np.uint8)
    image[:5] //= 2  # a shadow in the north
    corner = np.array([10.0, 20.0])
    scene = replace(small(), ground_light=LightMap(image, -corner, corner))
    loaded = read(glb_bytes(scene))
    assert set(loaded.geometry) - set(read(glb_bytes(small())).geometry) == {SHADOWS}
    sheet = loaded.geometry[SHADOWS]
    assert sheet.visual.material.alphaMode == "BLEND"
    assert np.allclose(sheet.bounds, [[-10, 0.02, -20], [10, 0.02, 20]])
    alpha = np.asarray(sheet.visual.material.baseColorTexture)[..., 3]
    assert np.all(alpha[5:] == 0) and np.allclose(alpha[:5], 255 * (1 - 0.5**2.2), atol=2)
    ground = meshes_of(loaded, "ground")[0].visual.vertex_attributes["color"]
    assert np.array_equal(ground[0, :3], np.round(255 * (image[-1, 0] / 255) ** 2.2))


def test_objects_keep_their_names_whatever_they_are() -> None:
    """Names from a world that somebody else made; a node that meets another would replace it."""
    tree, box = (next(o for o in small().objects if o.name == n) for n in ("tree", "a"))
    names = ["world", "tree/0", SHADOWS]
    corner = np.array([10.0, 20.0])
    lit = LightMap(np.full((4, 4, 3), 90, np.uint8), -corner, corner)
    things = [tree, *(replace(box, name=name) for name in names)]
    glb = header(glb_bytes(replace(worlds.world(*things), ground_light=lit)))
    nodes = {node["name"]: glb["meshes"][node["mesh"]] for node in glb["nodes"] if "mesh" in node}
    assert [nodes[name]["extras"]["kind"] for name in names] == 3 * [box.kind]
    assert len(nodes) == sum("mesh" in node for node in glb["nodes"])
    assert sum(mesh["extras"]["kind"] == SHADOWS for mesh in nodes.values()) == 1


def test_textures_can_be_shrunk_and_packed_with_loss() -> None:
    full, less = glb_bytes(small()), glb_bytes(small(), 16, webp=True)
    tree = header(less)
    assert {i["mimeType"] for i in tree["images"]} == {"image/webp"}
    leaves = meshes_of(read(less), "tree")[1].visual.material.baseColorTexture
    assert leaves.size == (16, 16) and leaves.mode == "RGBA"
    assert len(less) < len(full)


def test_a_wrong_name_or_place_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"ends in \.glb, got .*scene\.obj"):
        export_scene(small(), tmp_path / "scene.obj")
    (tmp_path / "scene.glb").mkdir()
    with pytest.raises(OutputError, match="expected a plain file"):
        export_scene(small(), tmp_path / "scene.glb")
    assert [p.name for p in tmp_path.iterdir()] == ["scene.glb"]
    export_scene(small(), tmp_path / "new" / "scene.glb")
    assert (tmp_path / "new" / "scene.glb").read_bytes() == glb_bytes(small())

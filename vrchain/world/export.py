"""A scene as one GLB file (glTF 2.0, binary), for other programs and for the notebook's viewer."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from vrchain.errors import OutputError
from vrchain.files import write_file
from vrchain.world.atlas import join_by_texture
from vrchain.world.model import OPAQUE, LightMap, Scene, SceneObject, Surface

SHADOWS = "shadows on the ground"  # the one node that is no object

_GAMMA = 2.2  # glTF multiplies colours as light intensities, the renderer as pixel values
_SHEET_M, _SHEET_PX = 0.02, 1024  # height above the ground; resolution
_UNLIT = "KHR_materials_unlit"  # the light is baked in, a viewer must not add its own


def export_scene(scene: Scene, path: str | Path) -> None:
    """Write a scene as GLB, whole or not at all. Raises OutputError.

    See ``glb_bytes``.
    """
    check_name(path)
    write_file(path, glb_bytes(scene))


def check_name(path: str | Path) -> None:
    """Raise OutputError unless the name says what the file is."""
    if Path(path).suffix.lower() != ".glb":
        raise OutputError(f"expected a file name that ends in .glb, got {path}: choose another -o")


def glb_bytes(scene: Scene, max_texture_px: int | None = None, *, webp: bool = False) -> bytes:
    """A scene as GLB: a node an object, named by it; metres, y up (x east, -z north).

    Baked light is the vertex colour COLOR_0, materials are unlit, cut-outs have alphaMode MASK; the
    shadows on the ground are one node more, a dark sheet just above it. An object's kind, model and
    landmark are the extras of its mesh. The sky is no object and left out. Textures larger than
    ``max_texture_px`` are shrunk; with ``webp`` they are coded so, with loss, by the extension
    EXT_texture_webp, else as PNG, without.
    """
    import trimesh

    taken = {thing.name for thing in scene.objects}

    def fresh(name: str) -> str:
        """Objects keep their names; what else is named gives way."""
        while name in taken:
            name += "'"
        taken.add(name)
        return name

    graph = trimesh.Scene(base_frame=fresh("world"), metadata={"name": scene.name})
    materials: dict[int, Any] = {}
    for thing in _lit_ground(scene):
        parts = join_by_texture(thing.surfaces)
        extras = {"kind": thing.kind, "model": thing.model, "landmark": thing.landmark}
        if len(parts) > 1:
            graph.graph.update(thing.name)
        for number, part in enumerate(parts):
            key = id(part.texture)
            if key not in materials:
                materials[key] = _material(part.texture, max_texture_px)
            name, parent = thing.name, None
            if len(parts) > 1:
                name, parent = fresh(f"{thing.name}/{number}"), thing.name
            mesh = _mesh(part, materials[key], extras)
            graph.add_geometry(mesh, node_name=name, geom_name=name, parent_node_name=parent)
    if scene.ground_light is not None:
        sheet = fresh(SHADOWS)
        graph.add_geometry(_shadows(scene.ground_light), node_name=sheet, geom_name=sheet)
    glb: bytes = graph.export(
        file_type="glb",
        include_normals=False,
        tree_postprocessor=_make_unlit,
        extension_webp=webp,
    )
    return glb


def _lit_ground(scene: Scene) -> Iterator[SceneObject]:
    """The objects; flat ground, which has its light in a map, in the light of the open."""
    for thing in scene.objects:
        ground = scene.ground_light
        if ground is None or (thing.bounds_m[:, 2] != ground.height_m).any():
            yield thing
            continue
        tint = _open_light(ground).astype(np.float32)
        surfaces = [replace(s, shade=s.shade_rgb * tint) for s in thing.surfaces]
        yield replace(thing, surfaces=tuple(surfaces))


def _open_light(ground: LightMap) -> NDArray[np.float64]:
    """Light where nothing stands in its way, (3,) in 0..1."""
    return np.maximum(np.percentile(ground.image, 95, axis=(0, 1)), 1) / 255


def _shadows(ground: LightMap) -> Any:
    """A sheet that darkens what lies below as the light map does, its colour aside."""
    light = (ground.image / 255 / _open_light(ground)).mean(axis=2).clip(0, 1)
    image = np.zeros((*light.shape, 4), dtype=np.uint8)
    image[..., 3] = np.round(255 * (1 - light**_GAMMA))
    (west, south), (east, north) = ground.low_m, ground.high_m
    corners = [(west, south), (east, south), (east, north), (west, north)]
    sheet = Surface(
        np.array([(*corner, ground.height_m + _SHEET_M) for corner in corners], dtype=np.float32),
        np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32),
        np.array([(0, 0), (1, 0), (1, 1), (0, 1)], dtype=np.float32),
        np.ones(4, dtype=np.float32),
        image,
    )
    material = _material(image, _SHEET_PX)
    material.alphaMode, material.alphaCutoff = "BLEND", None
    return _mesh(sheet, material, {"kind": SHADOWS})


def _mesh(part: Surface, material: Any, extras: Mapping[str, object]) -> Any:
    import trimesh

    visual = trimesh.visual.TextureVisuals(uv=part.uv, material=material)
    light = np.round(255 * np.clip(part.shade_rgb, 0.0, 1.0) ** _GAMMA).astype(np.uint8)
    opaque = np.full((len(light), 1), 255, dtype=np.uint8)
    visual.vertex_attributes["color"] = np.concatenate([light, opaque], axis=1)
    x, y, z = part.vertices_m.T
    return trimesh.Trimesh(
        np.stack([x, z, -y], axis=1),
        part.faces,
        visual=visual,
        metadata=dict(extras),
        process=False,
        validate=False,
    )


def _material(texture: NDArray[np.uint8], max_texture_px: int | None) -> Any:
    from PIL import Image
    from trimesh.visual.material import PBRMaterial

    h, w = texture.shape[:2]
    scale = 1.0 if max_texture_px is None else min(1.0, max_texture_px / max(h, w))
    if scale < 1.0:
        size = (max(1, round(w * scale)), max(1, round(h * scale)))
        texture = cv2.resize(texture, size, interpolation=cv2.INTER_AREA).astype(np.uint8)
    cut_out = texture.shape[2] == 4
    return PBRMaterial(
        baseColorTexture=Image.fromarray(texture),
        alphaMode="MASK" if cut_out else "OPAQUE",
        alphaCutoff=OPAQUE / 255 if cut_out else None,
        metallicFactor=0.0,
        roughnessFactor=1.0,
        doubleSided=True,
    )


def _make_unlit(tree: dict[str, Any]) -> None:
    for material in tree.get("materials", ()):
        material["extensions"] = {_UNLIT: {}}
    tree.setdefault("extensionsUsed", []).append(_UNLIT)

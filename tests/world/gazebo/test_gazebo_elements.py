"""Gazebo worlds: merged models, placement frames, populations, roads, and shapes by outlines."""

import json
import struct
from pathlib import Path

import gazebo_files as gz
import numpy as np
import pytest
from gazebo_files import CUBE, UNWARNED, drawn, include, load, mesh, model, only, told, visual
from gazebo_files import no_folders as no_folders

from vrchain.errors import SpecError
from vrchain.geometry import Pose
from vrchain.world import SceneObject
from vrchain.world.render import Renderer


def volume_m3(thing: SceneObject) -> float:
    """Of what its faces enclose; negative where they look inwards."""
    a, b, c = np.moveaxis(
        np.concatenate([s.vertices_m[s.faces] for s in thing.surfaces]).astype(float), 1, 0
    )
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def line(*points: tuple[float, float], height: str = "<height>3</height>") -> str:
    told = "".join(f"<point>{x} {y}</point>" for x, y in points)
    return f"<polyline>{told}{height}</polyline>"


SQUARE = [(0, 0), (4, 0), (4, 4), (0, 4)]
HOLE = [(1, 1), (1, 2), (2, 2), (2, 1)]


@UNWARNED
@pytest.mark.parametrize(
    ("shape", "m3"),
    [
        (line(*SQUARE), 48),
        (line(*SQUARE[::-1]), 48),
        (line(*SQUARE, height=""), 16),
        (line((0, 0), (4, 0), (4, 4), (2, 1), (0, 4)), 30),
        (line(*SQUARE) + line(*HOLE), 45),
        (line(*SQUARE) + line((9, 0), (9, 1), (8, 1), (8, 0)), 51),
    ],
)
def test_polylines_are_extruded(tmp_path: Path, shape: str, m3: float) -> None:
    thing = drawn(tmp_path, shape)
    assert volume_m3(thing) == pytest.approx(m3)
    assert thing.bounds_m[0, 2] == 0 and thing.bounds_m[1, 2] == (1 if "height" not in shape else 3)


@UNWARNED
@pytest.mark.parametrize(
    ("shape", "size_m"),
    [
        ("<box/>", (1, 1, 1)), ("<sphere/>", (2, 2, 2)), ("<cylinder/>", (2, 2, 1)),
        ("<capsule/>", (1, 1, 2)), ("<ellipsoid/>", (2, 2, 2)), ("<cone/>", (2, 2, 1)),
        ("<cylinder><radius>3</radius></cylinder>", (6, 6, 1)),
    ],
)  # fmt: skip
def test_defaults_are_those_of_the_specification(
    tmp_path: Path, shape: str, size_m: tuple[float, ...]
) -> None:
    assert np.allclose(drawn(tmp_path, shape).size_m, size_m, atol=1e-5)


def test_a_road_is_a_ribbon(tmp_path: Path) -> None:
    points = "".join(f"<point>{p}</point>" for p in ("0 0 0.02", "10 0 0.02", "10 10 0.02"))
    scene = load(tmp_path, gz.GROUND_MODEL + f'<road name="way"><width>2</width>{points}</road>')
    road = scene.objects[scene.index_of("way")]
    assert (road.kind, road.solid) == ("ground", False)
    assert np.allclose(road.bounds_m, [(0, -1, 0.02), (11, 10, 0.02)])
    (surface,) = road.surfaces
    a, b, c = np.moveaxis(surface.vertices_m[surface.faces].astype(float), 1, 0)
    assert (np.cross(b - a, c - a)[:, 2] > 0).all()
    assert surface.texture[0, 0].tolist() == [89, 89, 89]


@UNWARNED
def test_what_is_merged_is_the_models_own(tmp_path: Path) -> None:
    body = f'<link name="body"><pose>0 0 1 0 0 0</pose>{CUBE}</link>'
    inner = '<model name="part"><pose relative_to="body">0 0 5 0 0 0</pose><link name="l"/></model>'
    files = gz.folder_of("m", f'<model name="m">{body}{inner}</model>')
    merged = include("model://m", pose="0 3 0 0 0 0").replace("<include>", '<include merge="true">')
    lamp = f'<link name="lamp"><pose relative_to="body">0 0 1.5 0 0 0</pose>{CUBE}</link>'
    far = f'<link name="far"><pose relative_to="part">0 0 1 0 0 0</pose>{CUBE}</link>'
    outer = f'<model name="outer"><pose>4 0 0 0 0 0</pose>{merged}{lamp}{far}</model>'
    thing = only(load(tmp_path, outer, files))
    assert thing.name == "outer"
    assert np.allclose(thing.bounds_m, [(3.5, 2.5, 0.5), (4.5, 3.5, 7.5)])


@UNWARNED
def test_a_link_may_have_two_colons_in_its_own_name(tmp_path: Path) -> None:
    """Gazebo classic saved nested models so: their links became those of the outer one."""
    door = f'<link name="door::leaf"><pose>2 0 1 0 0 0</pose>{CUBE}</link>'
    knob = f'<link name="knob"><pose relative_to="door::leaf">1 0 0 0 0 0</pose>{CUBE}</link>'
    thing = only(load(tmp_path, f'<model name="room">{door}{knob}</model>'))
    assert np.allclose(thing.bounds_m, [(1.5, -0.5, 0.5), (3.5, 0.5, 1.5)])
    nowhere = door.replace("<pose>", '<pose relative_to="wall::leaf">')
    with pytest.raises(SpecError, match="there is no frame 'wall::leaf'"):
        load(tmp_path, f'<model name="room">{nowhere}</model>')


@UNWARNED
@pytest.mark.parametrize("where", ["include", "model", "nested"])
def test_a_placement_frame_is_what_a_pose_places(tmp_path: Path, where: str) -> None:
    turned = '<frame name="top"><pose>0 0 2 0 0 1.5707963267948966</pose></frame>'
    inside = f'{turned}<link name="l"><pose>1 0 0 0 0 0</pose>{CUBE}</link>'
    given = ' placement_frame="top"' if where == "model" else ""
    files = gz.folder_of("m", f'<model name="m"{given}>{inside}</model>')
    body = include("model://m", pose="3 0 5 0 0 0", name="p")
    if where == "include":
        body = body.replace("</uri>", "</uri><placement_frame>top</placement_frame>")
    if where == "nested":
        body = (
            f'<model name="p" placement_frame="in::top"><pose>3 0 5 0 0 0</pose>'
            f'<model name="in">{inside}</model></model>'
        )
    beside = '<model name="q"><pose relative_to="p">1 0 1 0 0 0</pose>'
    scene = load(tmp_path, body + beside + f'<link name="l">{CUBE}</link></model>', files)
    first, second = (o.bounds_m.mean(axis=0) for o in scene.objects)
    assert np.allclose(first, (3, -1, 3)) and np.allclose(second, (3, -1, 4))


def crowd(kind: str, region: str, count: int, more: str = "") -> str:
    return (
        f'<population name="crowd"><pose>10 0 1 0 0 0</pose>{model(CUBE, "0 0 9 1 1 1", "pin")}'
        f"<model_count>{count}</model_count><distribution><type>{kind}</type>{more}</distribution>"
        f"{region}</population>"
    )


BOX = "<box><size>8 4 2</size></box>"


@UNWARNED
@pytest.mark.parametrize(
    ("population", "n"),
    [
        (crowd("random", BOX, 9), 9),
        (crowd("uniform", BOX, 9), 9),
        (crowd("random", "<cylinder><radius>2</radius><length>1</length></cylinder>", 5), 5),
        (crowd("uniform", "<cylinder><radius>2</radius><length>1</length></cylinder>", 5), 5),
        (crowd("grid", "", 1, "<rows>2</rows><cols>3</cols><step>2 1 0</step>"), 6),
        (crowd("linear-y", BOX, 4), 4),
    ],
)
def test_populations(tmp_path: Path, population: str, n: int) -> None:
    scene = load(tmp_path, population)
    assert [o.name for o in scene.objects] == [f"pin_clone_{k}" for k in range(n)]
    assert len({o.model for o in scene.objects}) == 1
    places = np.array([o.bounds_m.mean(axis=0) for o in scene.objects])
    assert len(np.unique(places, axis=0)) == n
    assert (np.abs(places - (10, 0, 1)) <= np.array((4, 2, 1)) + 1e-6).all()
    assert load(tmp_path, population).table.equals(scene.table)
    if "grid" in population:
        assert np.allclose(places[:, 0], [8, 10, 12] * 2)
        assert np.allclose(places[:, 1], [-0.5] * 3 + [0.5] * 3)
    if "linear" in population:
        assert np.allclose(places[:, 1], [-2, -1, 0, 1])


def test_a_world_without_ground_ends_in_haze(tmp_path: Path) -> None:
    scene = load(tmp_path, model(visual("<box/>"), pose="6 0 1 0 0 0"))
    view = Renderer(scene).render(Pose(0, 0)).views[4].astype(int)
    below = view[len(view) // 2 + 20 :]
    assert np.abs(np.diff(below, axis=0)).max() <= 2


def glb(more: dict[str, object] | None = None, picture: bytes = b"") -> bytes:
    """A unit box as GLB, below a node that lifts it by 2 m along y."""
    points = np.array(gz.BOX_XYZ, dtype="<f4")
    faces = np.array(gz.BOX_FACES, dtype="<u2")
    uv = np.zeros((8, 2), dtype="<f4")
    held = [points.tobytes(), faces.tobytes(), uv.tobytes(), picture]
    starts = np.cumsum([0, *map(len, held)])
    accessors = [
        {"bufferView": 0, "componentType": 5126, "count": 8, "type": "VEC3"},
        {"bufferView": 1, "componentType": 5123, "count": 36, "type": "SCALAR"},
        {"bufferView": 2, "componentType": 5126, "count": 8, "type": "VEC2"},
    ]
    colour: dict[str, object] = {"baseColorFactor": [1, 0.5, 0, 1]}
    document: dict[str, object] = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": "top", "translation": [0, 2, 0], "children": [1]},
                  {"name": "Box", "mesh": 0}],
        "meshes": [{"name": "g", "primitives": [
            {"attributes": {"POSITION": 0, "TEXCOORD_0": 2}, "indices": 1, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": colour}],
        "accessors": accessors,
        "bufferViews": [{"buffer": 0, "byteOffset": int(s), "byteLength": len(h)}
                        for s, h in zip(starts, held, strict=False)],
        "buffers": [{"byteLength": int(starts[-1])}],
        **(more or {}),
    }  # fmt: skip
    if picture:
        colour["baseColorTexture"] = {"index": 0}
        document |= {"textures": [{"source": 0}], "images": [{"bufferView": 3}]}
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    body = b"".join(held)
    body += bytes(-len(body) % 4)
    chunks = struct.pack("<2I", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<2I", len(body), 0x004E4942) + body
    return struct.pack("<3I", 0x46546C67, 2, 12 + len(chunks)) + chunks


@UNWARNED
@pytest.mark.parametrize("picture", [b"", gz.png((200, 100, 50))])
def test_glb_meshes_stay_as_they_lie(tmp_path: Path, picture: bytes) -> None:
    files = {"worlds/a.glb": glb(picture=picture)}
    thing = drawn(tmp_path, mesh("a.glb", "<submesh><name>Box</name></submesh>"), files)
    assert np.allclose(thing.bounds_m, [(0, 2, 0), (1, 3, 1)])
    assert volume_m3(thing) == pytest.approx(1)
    colour = [200, 50, 0] if picture else [255, 128, 0]
    assert thing.surfaces[0].texture[0, 0].tolist() == colour


def test_a_node_below_one_of_a_name_that_begins_alike_keeps_its_own(tmp_path: Path) -> None:
    nodes = [{"name": "Car", "children": [1]}, {"name": "Car_Body", "mesh": 0}]
    body = mesh("a.glb", "<submesh><name>Car_Body</name></submesh>")
    thing = drawn(tmp_path, body, {"worlds/a.glb": glb({"nodes": nodes})})
    assert np.allclose(thing.size_m, 1)


HUGE = {"componentType": 5126, "count": 2_000_000_000, "type": "VEC3"}
RING = [{"children": [1], "mesh": 0}, {"children": [0]}]


@pytest.mark.parametrize(
    ("content", "part"),
    [
        (b"x", "expected a mesh of kind GLB"),
        (b"glTF" + bytes(40), "no head of a GLB"),
        (glb()[:-200], "a.glb"),
        (glb({"accessors": [HUGE] * 3}), "numbers"),
        (glb({"accessors": [{**HUGE, "count": -1}] * 3}), "whole numbers"),
        (glb({"buffers": [{"byteLength": 9, "uri": "../../secret"}]}), "in the file itself"),
        (glb({"nodes": [{"children": list(range(1, 30_000))}]}), "nodes"),
        (glb({"meshes": []}), "a.glb"),
    ],
)
def test_broken_glb_meshes_are_left_out(tmp_path: Path, content: bytes, part: str) -> None:
    with told("meshes that cannot be read: 1 (", part):
        load(tmp_path, model(CUBE + visual(mesh("a.glb"))), {"worlds/a.glb": content})


def test_nodes_in_a_ring_come_to_an_end(tmp_path: Path) -> None:
    thing = drawn(tmp_path, mesh("a.glb"), {"worlds/a.glb": glb({"nodes": RING})})
    assert np.allclose(thing.size_m, 1)


def test_whose_name_is_its_own_keeps_it(tmp_path: Path) -> None:
    names = ("box", "box", "box_2", "ball")
    things = [model(visual("<box/>"), f"{2 * k} 0 0 0 0 0", n) for k, n in enumerate(names)]
    found = [o.name for o in load(tmp_path, "".join(things)).objects]
    assert found == ["box", "box_3", "box_2", "ball"]


@pytest.mark.parametrize("first", ["<geometry/>", "<geometry><box/></geometry>"])
def test_of_several_shapes_the_first_is_drawn(first: str, tmp_path: Path) -> None:
    """However wide the others are, which would be ground."""
    wide = f'<visual name="v">{first}<geometry>{gz.GROUND}</geometry></visual>'
    things = gz.load(tmp_path, model(wide) + model(CUBE, name="cube")).objects
    assert [o.name for o in things if o.kind != "ground"] == (
        ["thing", "cube"] if "box" in first else ["cube"]
    )

"""Gazebo worlds: what their files mean, as Gazebo reads them."""

from contextlib import nullcontext
from pathlib import Path

import gazebo_files as gz
import numpy as np
import pytest
from gazebo_files import CUBE, UNWARNED, box, drawn, include, load, mesh, model, only, told, visual
from gazebo_files import no_folders as no_folders
from PIL import Image

from vrchain.errors import SpecError
from vrchain.geometry import Pose
from vrchain.simulation.simulator import Simulator
from vrchain.world import SceneObject, load_scene
from vrchain.world.gazebo.kinds import guess
from vrchain.world.gazebo.materials import read_picture
from vrchain.world.gazebo.scripts import read_script
from vrchain.world.model import OPAQUE
from vrchain.world.render import Renderer
from vrchain.world.truth import GroundTruth

QUARTER = "1.5707963267948966"


def centre(thing: SceneObject) -> list[float]:
    return [round(float(v), 4) for v in thing.bounds_m.mean(axis=0)]


def colours(thing: SceneObject) -> set[tuple[int, ...]]:
    return {tuple(s.texture[0, 0].tolist()) for s in thing.surfaces}


def triangles(thing: SceneObject) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The three corners of all faces, (n, 3) each."""
    corners = np.concatenate([s.vertices_m[s.faces] for s in thing.surfaces]).astype(float)
    return corners[:, 0], corners[:, 1], corners[:, 2]


def test_poses_compose_about_fixed_axes(tmp_path: Path) -> None:
    shown = visual(box("2 1 1"), pose="1 0 0 0 0 0")
    body = model(shown, pose=f"10 0 0 0 0 {QUARTER}", link_pose=f"0 0 3 {QUARTER} 0 0")
    thing = only(load(tmp_path, body))
    assert centre(thing) == [10.0, 1.0, 3.0]
    assert np.allclose(np.ptp(thing.bounds_m, axis=0), (1, 2, 1), atol=1e-5)
    assert np.allclose(thing.size_m, (2, 1, 1), atol=1e-5)


def test_the_pose_of_an_include_replaces_the_models(tmp_path: Path) -> None:
    files = gz.folder_of("crate", model(visual(box("1 1 1")), pose="0 0 5 0 0 0", name="Crate"))
    body = include("model://crate", pose="3 0 0.5 0 0 0", name="a") + include("model://crate")
    scene = load(tmp_path, body, files)
    assert [(o.name, centre(o)) for o in scene.objects] == [
        ("a", [3, 0, 0.5]),
        ("Crate", [0, 0, 5]),
    ]
    assert {o.model for o in scene.objects} == {"crate"}


ARM = '<model name="arm"><pose>0 0 2 0 0 0</pose><link name="hand"><pose>3 0 0 0 0 0</pose>'


@pytest.mark.parametrize(
    ("body", "place"),
    [
        (
            '<frame name="f"><pose>0 5 0 0 0 0</pose></frame>'
            '<model name="m"><pose relative_to="f">1 0 0 0 0 0</pose>'
            '<link name="a"><pose degrees="true">0 0 2 0 0 90</pose></link>'
            f'<link name="b"><pose relative_to="a">3 0 0 0 0 0</pose>{CUBE}</link></model>',
            [1, 8, 2],
        ),
        (  # a frame within a model
            include("model://robot", pose=f"10 0 0 0 0 {QUARTER}", name="r")
            + '<model name="crate"><pose relative_to="r::arm::hand">0 0 1 0 0 0</pose>'
            f'<link name="l">{CUBE}</link></model>',
            [10, 3, 3],
        ),
    ],
)
def test_a_frame_that_a_pose_names(tmp_path: Path, body: str, place: list[float]) -> None:
    files = gz.folder_of("robot", f'<model name="robot">{ARM}</link></model></model>')
    assert centre(only(load(tmp_path, body, files))) == place


def test_an_included_sun_is_turned_by_its_include(tmp_path: Path) -> None:
    files = gz.folder_of("sun", '<light name="sun" type="directional"><pose>0 0 9 0 0 0</pose>'
                         "<direction>1 0 -1</direction></light>")  # fmt: skip
    sun = include("model://sun", pose=f"0 0 9 0 0 {QUARTER}")
    light = load(tmp_path, sun + model(CUBE), files).light
    assert (light.sun_azimuth_deg, light.sun_elevation_deg) == pytest.approx((270, 45))


def test_the_highest_version_is_the_models_file(tmp_path: Path) -> None:
    files = {
        "models/m/model.config": gz.config(
            ("1.5", "five.sdf"), ("1.10", "ten.sdf"), ("1.²", "five.sdf")
        ),
        "models/m/five.sdf": f'<sdf version="1.5">{model(CUBE)}</sdf>',
        "models/m/ten.sdf": f'<sdf version="1.10">{model(visual(box("2 2 2")))}</sdf>',
    }
    assert only(load(tmp_path, include("model://m"), files)).size_m == (2, 2, 2)


def test_folders_are_searched_in_their_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, size in (("first", "1 1 1"), ("second", "2 2 2")):
        gz.write(tmp_path / name, gz.folder_of("m", model(visual(box(size)))))
    monkeypatch.setenv("GAZEBO_MODEL_PATH", f"/nowhere:{tmp_path}/second/models")
    monkeypatch.setenv("GZ_SIM_RESOURCE_PATH", f"{tmp_path}/first/models")
    assert only(load(tmp_path, include("model://m"))).size_m == (2, 2, 2)
    monkeypatch.delenv("GAZEBO_MODEL_PATH")
    assert only(load(tmp_path, include("model://m"))).size_m == (1, 1, 1)


@pytest.mark.parametrize(
    ("file", "content", "more", "size_m"),
    [
        ("a.dae", gz.dae(), "", (1, 1, 1)),
        ("a.dae", gz.dae(meter=0.0254), "<scale>10 20 30</scale>", (0.254, 0.508, 0.762)),
        ("a.obj", gz.obj(2.0), "<scale>1 -2 3</scale>", (2, 4, 6)),
        ("a.stl", gz.stl(), "", (1, 1, 1)),
    ],
)
def test_meshes_in_their_unit_and_scale(
    tmp_path: Path, file: str, content: str | bytes, more: str, size_m: tuple[float, ...]
) -> None:
    files = {f"models/m/{file}": content, **gz.folder_of("m", model(visual(mesh(file, more))))}
    thing = only(load(tmp_path, include("model://m"), files))
    assert np.allclose(thing.size_m, size_m, atol=1e-6)
    a, b, c = triangles(thing)
    volume = np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6  # positive: faces look outwards
    assert volume == pytest.approx(np.prod(size_m), rel=1e-4)


@UNWARNED
@pytest.mark.parametrize("up", ["Y_UP", "X_UP", " Z_UP\n"])
def test_the_axis_that_a_mesh_has_up_turns_nothing(tmp_path: Path, up: str) -> None:
    flat = " ".join(f"{6 * x} {4 * y} {2 * z}" for x, y, z in gz.BOX_XYZ)
    thing = drawn(tmp_path, mesh("a.dae"), {"worlds/a.dae": gz.dae(up=up, positions=flat)})
    assert np.allclose(thing.bounds_m, [(0, 0, 0), (6, 4, 2)])


CLEAR = "parts of meshes more than half transparent: 1 (v)"


@pytest.mark.parametrize(
    ("mode", "colour", "amount", "drawn"),
    [
        ("A_ONE", "1 1 1 0.1", "1", False),  # glass
        ("A_ONE", "1 1 1 1", "0", False),  # invisible
        ("A_ONE", "1 1 1 1", "1", True),
        ("A_ONE", "1 1 1 0.7", "1", True),
        ("A_ZERO", "0 0 0 0.1", "1", True),
        ("A_ZERO", "0 0 0 0.9", "1", False),
        ("RGB_ZERO", "0 0 0 1", "1", True),
        ("RGB_ZERO", "0 0.9 0 1", "1", False),
        ("RGB_ONE", "1 1 1 1", "0.8", True),
        ("RGB_ONE", "1 0 0 1", "1", False),
        ("", "1 1 1 1", "0", True),  # without a rule it is opaque, as in Gazebo
        ("A_ONE", "1 1 1", "0", True),
    ],
)
def test_glass_and_invisible_parts_are_not_drawn(
    tmp_path: Path, mode: str, colour: str, amount: str, drawn: bool
) -> None:
    opaque = f' opaque="{mode}"' if mode else ""
    see_through = (
        f"</diffuse><transparent{opaque}><color>{colour}</color></transparent>"
        f"<transparency><float>{amount}</float></transparency>"
    )
    files = {"worlds/a.dae": gz.dae().replace("</diffuse>", see_through)}
    pane = model(visual(mesh("a.dae")), name="pane")
    plain = "<material><diffuse>0 1 0 1</diffuse></material>"  # replaces the mesh's own
    green = model(visual(mesh("a.dae"), material=plain), pose="0 5 0 0 0 0", name="green")
    with nullcontext() if drawn else told(CLEAR):
        scene = load(tmp_path, pane + green, files)
    assert [o.name for o in scene.objects] == ["pane", "green"][not drawn :]
    assert scene.is_free([(0.5, 0.5)]).tolist() == [not drawn]


@pytest.mark.parametrize(
    ("bound", "grey"),
    [
        ('<bind_vertex_input semantic="UV" input_semantic="TEXCOORD" input_set="1"/>', 255),
        ('<bind_vertex_input semantic="UV" input_semantic="TEXCOORD" input_set="7"/>', 0),
        ("", 0),
    ],
)
def test_the_texture_coordinates_that_a_material_is_bound_to(
    tmp_path: Path, bound: str, grey: int
) -> None:
    content = gz.dae(picture="half.png").replace(">0 0 1 0 1 1<", ">0.1 0 0.1 0 0.1 0<")
    first = content[content.index('<source id="t">') : content.index("<vertices")]
    second = first.replace("0.1", "0.9").replace('"t', '"u').replace("#t", "#u")
    content = content.replace(first, first + second)
    more = '<input semantic="TEXCOORD" source="#u" offset="1" set="1"/>'
    content = content.replace(' set="0"/>', f' set="0"/>{more}')
    content = content.replace('target="#m"/>', f'target="#m">{bound}</instance_material>')
    half = np.repeat(np.array([[[0], [255]]], dtype=np.uint8), 4, axis=1).repeat(3, axis=2)
    files = {"worlds/a.dae": content, "worlds/half.png": gz.picture(half)}
    (surface,) = drawn(tmp_path, mesh("a.dae"), files).surfaces
    u = surface.uv[surface.faces, 0].mean()
    assert set(surface.texture[0, int(u * surface.texture.shape[1])].tolist()) == {grey}


def source(name: str, kind: str, values: str) -> str:
    """A source of a skin, of one number or name a row."""
    return (
        f'<source id="{name}"><{kind}_array id="{name}a">{values}</{kind}_array><technique_common>'
        f'<accessor source="#{name}a"><param name="{name}"/></accessor></technique_common></source>'
    )


SKIN = (
    '<library_controllers><controller id="c"><skin source="#g">'
    "<bind_shape_matrix>1 0 0 3 0 1 0 0 0 0 1 0 0 0 0 1</bind_shape_matrix>"
    + source("JOINT", "Name", "Bone")
    + source("TRANSFORM", "float", "1 0 0 0 0 1 0 0 0 0 1 0 0 0 0 1")
    + source("WEIGHT", "float", "1")
    + '<joints><input semantic="JOINT" source="#JOINT"/>'
    '<input semantic="INV_BIND_MATRIX" source="#TRANSFORM"/></joints>'
    '<vertex_weights count="8"><input semantic="JOINT" source="#JOINT" offset="0"/>'
    '<input semantic="WEIGHT" source="#WEIGHT" offset="1"/><vcount>1 1 1 1 1 1 1 1</vcount>'
    f"<v>{'0 0 ' * 8}</v></vertex_weights></skin></controller></library_controllers>"
)


def test_a_skin_is_drawn_as_it_was_bound(tmp_path: Path) -> None:
    instance = gz.INSTANCE.replace("_geometry", "_controller").replace("#g", "#c")
    nodes = f'<node name="Body"><translate>0 9 0</translate>{instance}</node>'
    with told("drawn as they are at rest: 1 (a.dae)"):
        thing = drawn(tmp_path, mesh("a.dae"), {"worlds/a.dae": gz.dae(extra=SKIN, nodes=nodes)})
    assert np.allclose(thing.bounds_m, [(3, 0, 0), (4, 1, 1)])
    assert colours(thing) == {(255, 0, 0)}


@pytest.mark.parametrize("broken", ["", '<geometry id="gone"><mesh><triangles/></mesh></geometry>'])
def test_broken_parts_of_a_mesh_are_told_and_the_rest_is_drawn(tmp_path: Path, broken: str) -> None:
    content = gz.dae(nodes=f'<node>{gz.INSTANCE}<instance_geometry url="#gone"/></node>')
    content = content.replace("</library_geometries>", f"{broken}</library_geometries>")
    with told("broken parts of COLLADA meshes, left out: ", "a.dae", "gone"):
        thing = drawn(tmp_path, mesh("a.dae"), {"worlds/a.dae": content})
    assert np.allclose(thing.size_m, 1)


def test_submeshes_by_node_and_by_group(tmp_path: Path) -> None:
    shifted = f'<node name="B"><translate>5 0 0</translate>{gz.INSTANCE}</node>'
    two = f'<node name="A">{gz.INSTANCE}{shifted}</node>'
    groups = "v 0 0 0\nv 1 0 0\nv 0 1 1\nv 9 0 0\nv 9 2 0\nv 9 0 2\ng A\nf 1 2 3\ng B\nf 4 5 6\n"
    for file, content in (("a.dae", gz.dae(nodes=two)), ("a.obj", groups)):
        of = {name: f"<submesh><name>{name}</name></submesh>" for name in "AB"}
        of["centred"] = "<submesh><name>B</name><center>true</center></submesh>"
        bodies = (model(visual(mesh(file, more)), name=name) for name, more in of.items())
        scene = load(tmp_path, "".join(bodies), {f"worlds/{file}": content})
        a, b, centred = (o.bounds_m for o in scene.objects)
        assert a[1, 0] == 1 and b[0, 0] >= 5
        assert np.allclose(centred.mean(axis=0), 0)


def test_corners_that_nothing_is_made_of_have_no_size(tmp_path: Path) -> None:
    content = "v 0 0 0\nv 1 0 0\nv 0 1 1\nv 150 40 9\nf 1 2 3\nf 4 4 4\n"
    thing = drawn(tmp_path, mesh("a.obj"), {"worlds/a.obj": content})
    assert np.allclose(thing.bounds_m, [(0, 0, 0), (1, 1, 1)])


QUADS = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\n"
QUADS_UV = "v 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvn 0 0 1\n"


@pytest.mark.parametrize(
    ("content", "n", "area_m2"),
    [
        (QUADS, 2, 1.0),
        (QUADS_UV + "f 1/1/1 2/2/1 3/3/1 4/1/1\n", 2, 2.0),
        (QUADS_UV + "v -1 0.5 0\nf 1 2 3 4 5\n", 3, 2.5),
    ],
)
def test_faces_of_one_number_of_corners(
    tmp_path: Path, content: str, n: int, area_m2: float
) -> None:
    a, b, c = triangles(drawn(tmp_path, mesh("a.obj"), {"worlds/a.obj": content}))
    assert len(a) == n
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2 == pytest.approx(area_m2)


@pytest.mark.parametrize(
    "content",
    [
        "\ufeff" + gz.obj(),
        gz.obj().replace("\n", "\r"),
        gz.obj().replace("v ", "  v\t").replace("f ", "\tf "),
        gz.obj().replace(" 3/1", "\\\r\n  3/1"),
    ],
)
def test_an_obj_as_other_programs_write_it(tmp_path: Path, content: str) -> None:
    thing = drawn(tmp_path, mesh("a.obj"), {"worlds/a.obj": content})
    assert np.allclose(thing.size_m, 1) and sum(len(s.faces) for s in thing.surfaces) == 12


def scripted(
    folder: Path, name: str, uris: str, files: gz.Files, geometry: str = box("1 1 1")
) -> SceneObject:
    """What a model shows in a material of a script."""
    material = f"<material><script>{uris}<name>{name}</name></script></material>"
    painted = gz.folder_of("m", model(visual(geometry, material=material)))
    return only(load(folder, include("model://m"), {**files, **painted}))


def test_materials_a_script_over_the_meshes_own(tmp_path: Path) -> None:
    script = (
        "fragment_program X glsl { source a.frag }\n// material No/Such { }\n"
        "material Base { }\n"
        "material Paint/Blue : Base { technique { pass {\n diffuse 0 0 1\n } } }\n"
        "material Paint/Sheet\n{\ntechnique\n{\npass\n{\nalpha_rejection greater 200\n"
        "texture_unit\n{\ntexture sheet.png\nscale 0.25 0.5\n}\n"
        "texture_unit\n{\ntexture other.png\n}\n}\n}\n}\n"
    )
    sheet = np.full((2, 2, 4), 255, dtype=np.uint8)
    sheet[0, :, 3], sheet[1, :, 3] = 200, 201
    files: gz.Files = {
        "models/paint/materials/scripts/p.material": script,
        "models/other/materials/textures/sheet.png": gz.picture(sheet),
        **gz.folder_of("paint", ""),
        "models/m/a.dae": gz.dae(),
    }
    uris = "<uri>model://paint/materials/scripts</uri><uri>model://other/materials/textures/</uri>"

    def painted(name: str) -> SceneObject:
        return scripted(tmp_path, name, uris, files, mesh("a.dae"))

    assert colours(painted("Paint/Blue")) == {(0, 0, 255)}
    assert colours(painted("Gazebo/Grey")) == {(178, 178, 178)}
    (surface,) = painted("Paint/Sheet").surfaces
    assert (surface.texture[..., 3] >= OPAQUE).tolist() == [[False, False], [True, True]]
    assert np.allclose(np.ptp(surface.uv, axis=0), (4, 2))
    with told("materials that are missing, drawn grey: 1"):
        painted("Paint/None")


def test_always_pass_and_comments_of_a_script(tmp_path: Path) -> None:
    (tmp_path / "a.material").write_text(
        "material A\n{\ntechnique\n{\npass\n{\nalpha_rejection always_pass 0\n"
        "/* texture_unit\n{\ntexture no.png\n}\n*/\ntexture_unit\n{\ntexture a.png // b.png\n}\n"
        "}\n}\n}\nmaterial B { technique { pass { scene_blend alpha_blend\n} } }"
    )
    scripts = dict(read_script(tmp_path / "a.material"))
    assert (scripts["A"].picture, scripts["A"].solid_above) == ("a.png", None)
    assert (scripts["B"].picture, scripts["B"].solid_above) == ("", OPAQUE - 1)


@UNWARNED
def test_materials_inherit(tmp_path: Path) -> None:
    files: gz.Files = {
        "models/m/materials/scripts/p.material": (
            "\ufeffmaterial First { technique { pass { diffuse 0 1 0\n} } }\n"
            "material Red : Gazebo/Red\n{\n}\nmaterial Redder:Red\n{\n}\n"
            'material "My Sheet" : First { technique { pass { alpha_rejection greater 9\n'
            'texture_unit { texture "my sheet.png"\n} } } }\n'
            'material Cut : "My Sheet"\n{\nset_texture_alias T other.png\n}\n'
            "material Lost : None { technique { pass { diffuse 0 0 1\n} } }\n"
            "material Loop : Loop2 { }\nmaterial Loop2 : Loop { }\n"
            "material Bad { technique { pass { diffuse $r $g $b\n} } }\n"
        ),
        "models/m/materials/textures/my sheet.png": gz.png((1, 2, 3)),
    }
    uris = "".join(f"<uri>model://m/materials/{name}</uri>" for name in ("scripts", "textures"))

    def painted(name: str) -> set[tuple[int, ...]]:
        return colours(scripted(tmp_path, name, uris, files))

    assert painted("First") == {(0, 255, 0)}
    assert painted("Red") == painted("Redder") == {(255, 0, 0)}
    assert painted("My Sheet") == {(0, 2, 0)}
    assert painted("Loop") == {(255, 255, 255)}
    with told("aliases of textures: 1 (other.png)"):
        assert painted("Cut") == {(0, 2, 0)}
    with told("inherit from that are missing: 1 (None)"):
        assert painted("Lost") == {(0, 0, 255)}
    with pytest.raises(
        SpecError, match=r"p\.material: the material 'Bad': expected finite numbers"
    ):
        painted("Bad")


def groups(*materials: str) -> str:
    """An OBJ with a face of each material, each beside the last."""
    return "".join(
        f"v {x} 0 0\nv {x + 1} 0 0\nv {x} 0 1\nusemtl {name}\nf -3 -2 -1\n"
        for x, name in enumerate(materials)
    )


@UNWARNED
def test_all_material_files_of_a_mesh(tmp_path: Path) -> None:
    mtl = {"a": "Kd 0.5", "b": "kd 1 0 0", "c": "Kd 0 1 0", "d e": "\tKd\t0 0 1"}
    files = {f"worlds/{name}.mtl": f"\ufeffnewmtl {name}\n{line}\n" for name, line in mtl.items()}
    files["worlds/a.obj"] = "mtllib a.mtl b.mtl\nmtllib c.mtl\nmtllib d e.mtl\n" + groups(*mtl)
    thing = drawn(tmp_path, mesh("a.obj"), files)
    assert colours(thing) == {(128, 128, 128), (255, 0, 0), (0, 255, 0), (0, 0, 255)}


def test_what_is_amiss_in_material_files_is_told_and_drawn_white(tmp_path: Path) -> None:
    files: gz.Files = {
        "worlds/a.mtl": "newmtl A\nKd spectral f.rfl\nnewmtl P\nmap_Kd -s 2 2 1 -clamp on p.png\n",
        "worlds/p.png": gz.png((1, 2, 3)),
        "worlds/a.obj": "mtllib gone.mtl\nmtllib a.mtl\n" + groups("A", "P", "No"),
    }
    with told(
        "material files that are missing: 1 (gone.mtl)", "not RGB, drawn white: 1",
        "options of pictures in material files: 1", "missing, drawn white: 1 (No)",
    ):  # fmt: skip
        thing = drawn(tmp_path, mesh("a.obj"), files)
    assert colours(thing) == {(255, 255, 255), (1, 2, 3)}


def test_pictures_are_found_beside_the_mesh_and_in_its_models_textures(tmp_path: Path) -> None:
    mtl = "newmtl A\nKd 0.5 0.5 0.5\nmap_Kd model://m/materials/textures/red.png\n"
    files: gz.Files = {
        "models/m/meshes/a.dae": gz.dae(picture="red.png"),
        "models/m/meshes/b.obj": gz.obj(more="mtllib b.mtl\nusemtl A"),
        "models/m/meshes/b.mtl": mtl,
        "models/m/materials/textures/red.png": gz.png((250, 1, 2)),
        **gz.folder_of("m", model(visual(mesh("meshes/a.dae")) + visual(mesh("meshes/b.obj")))),
    }
    thing = only(load(tmp_path, include("model://m"), files))
    assert colours(thing) == {(250, 1, 2)}
    assert len({id(s.texture) for s in thing.surfaces}) == 1


@pytest.mark.parametrize(
    "name",
    ["my%20tex.png", "my tex.png", r"C:\tex\my tex.png", "/home/alice/my%20tex.png",
     "file:///C:/tex/my%20tex.png", "sub/../my tex.png"],
)  # fmt: skip
def test_pictures_as_other_programs_name_them(tmp_path: Path, name: str) -> None:
    files: gz.Files = {
        "worlds/a.dae": gz.dae(picture=name),
        "worlds/my tex.png": gz.png((250, 1, 2)),
        "worlds/sub/b.txt": "",
    }
    assert colours(drawn(tmp_path, mesh("a.dae"), files)) == {(250, 1, 2)}


@pytest.mark.parametrize(
    "name", ["gone.png", "/home/alice/gone.png", "https://example.org/gone.png"]
)
def test_a_missing_picture_is_told_and_the_rest_loads(tmp_path: Path, name: str) -> None:
    with told(f"pictures that are missing: 1 ({name})"):
        drawn(tmp_path, mesh("a.dae"), {"worlds/a.dae": gz.dae(picture=name)})


def test_files_by_their_uri(tmp_path: Path) -> None:
    files = {**gz.folder_of("big crate", model(visual(box("2 2 2")))), "worlds/a.dae": gz.dae()}
    uri = (tmp_path / "models" / "big crate").as_uri()
    scene = load(tmp_path, include(uri) + model(visual(mesh("file://a.dae"))), files)
    assert [o.size_m for o in scene.objects] == [(2, 2, 2), (1, 1, 1)]


@pytest.mark.parametrize(
    ("name", "dtype", "grey", "level"),
    [
        ("a.png", np.uint16, 40000, 156),
        ("a.tif", np.uint16, 40000, 156),
        ("a.tif", np.int32, 40000, 156),
        ("a.tif", np.float32, 0.5, 128),
        ("a.tif", np.float32, np.nan, 0),
    ],
)
def test_pictures_of_more_than_8_bits(
    tmp_path: Path, name: str, dtype: type, grey: float, level: int
) -> None:
    Image.fromarray(np.full((2, 2), grey, dtype=dtype)).save(tmp_path / name)
    assert read_picture(tmp_path / name).tolist() == [[[level] * 3 + [255]] * 2] * 2


def test_a_mesh_of_another_kind_is_left_out(tmp_path: Path) -> None:
    body = model(visual(mesh("a.fbx", "<submesh><name>A</name></submesh>")) + CUBE)
    with told("none of .dae", "left out: 1 (a.fbx)"):
        assert only(load(tmp_path, body, {"worlds/a.fbx": b"Kaydara"})).size_m == (1, 1, 1)


@pytest.mark.parametrize(
    ("geometry", "size_m"),
    [
        (box("1 2 3"), (1, 2, 3)),
        ("<cylinder><radius>0.5</radius><length>2</length></cylinder>", (1, 1, 2)),
        ("<sphere><radius>1</radius></sphere>", (2, 2, 2)),
        ("<capsule><radius>0.5</radius><length>2</length></capsule>", (1, 1, 3)),
        ("<ellipsoid><radii>1 2 3</radii></ellipsoid>", (2, 4, 6)),
        ("<cone><radius>1</radius><length>2</length></cone>", (2, 2, 2)),
    ],
)
def test_primitives_look_outwards(tmp_path: Path, geometry: str, size_m: tuple[float, ...]) -> None:
    thing = drawn(tmp_path, geometry)
    assert np.allclose(thing.size_m, size_m, atol=1e-5)
    a, b, c = triangles(thing)
    assert np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c).min() > -1e-9
    (surface,) = thing.surfaces
    assert surface.uv.min() >= 0 and surface.uv.max() <= 1


def test_the_ground_goes_on_20_m_beyond_the_map_and_what_stands_on_it(tmp_path: Path) -> None:
    boxes = model(visual(box("2 2 2")), pose="50 0 1 0 0 0.3", name="a")
    boxes += model(visual(box("2 2 2")), pose="0 -9 1 0 0 0")
    scene = load(tmp_path, gz.GROUND_MODEL + boxes)
    floor = scene.objects[scene.index_of("ground_plane")]
    half = np.array(scene.extent_m) / 2
    assert np.allclose(floor.bounds_m[:, :2], [-half - 20, half + 20])
    assert (floor.kind, floor.landmark, floor.solid) == ("ground", False, False)
    seen = GroundTruth(scene).look(Pose(-half[0] + 1, half[1] - 1))[0]
    assert (seen[:, -1] == scene.index_of("ground_plane")).all()  # ahead of a robot in a corner


def plane(name: str, size_m: float, z_m: float) -> str:
    shape = f"<plane><size>{size_m} {size_m}</size></plane>"
    return model(visual(shape), pose=f"0 0 {z_m} 0 0 0", name=name)


@pytest.mark.parametrize(("name", "z_m"), [("parking_lot", 0.01), ("roof", 10.0)])
def test_the_lowest_plane_alone_is_the_ground(tmp_path: Path, name: str, z_m: float) -> None:
    ahead = model(visual(box("2 2 2")), pose="200 0 1 0 0 0", name="a")
    scene = load(tmp_path, plane(name, 50, z_m) + plane("grass", 400, 0) + ahead)
    sizes = {o.name: o.size_m for o in scene.objects}
    assert sizes[name] == (50, 50, 0)
    assert sizes["grass"][0] == scene.extent_m[0] + 40 and scene.extent_m[0] < 410
    assert scene.objects[0].name == "grass"


def test_two_planes_that_are_one_models_ground_do_not_cover_each_other(tmp_path: Path) -> None:
    files = gz.folder_of("tile", plane("tile", 50, 0))
    scene = load(tmp_path, include("model://tile") + include("model://tile", "50 0 3 0 0 0"), files)
    low, high = (o.bounds_m for o in scene.objects)
    assert np.ptp(low[:, 0]) > 90 and np.allclose(high, [(25, -25, 3), (75, 25, 3)])


def test_a_wide_plane_that_stands_upright_is_no_ground(tmp_path: Path) -> None:
    wall = drawn(tmp_path, "<plane><normal>1 0 0</normal><size>50 50</size></plane>")
    assert wall.size_m == (0, 50, 50)


@pytest.mark.parametrize("z_m", [0.01, -0.5])
def test_shadows_fall_on_ground_at_any_height(tmp_path: Path, z_m: float) -> None:
    block = model(visual(box("4 4 6")), pose=f"0 0 {3 + z_m} 0 0 0", name="a")
    block += model(CUBE, pose=f"20 0 {z_m} 0 0 0", name="far")  # widens the map
    scene, pose = load(tmp_path, gz.SUN + plane("ground", 100, z_m) + block), Pose(5, 0, np.pi)
    seen = Renderer(scene).segmentation(pose)
    drawn = Renderer(scene).render(pose).views[seen == scene.index_of("ground")]
    light = drawn.astype(int).sum(axis=1)
    assert light.min() < 0.8 * light.max()


def test_what_stands_around_free_space_leaves_it_free(tmp_path: Path) -> None:
    poses = (
        "0 10 1.2 0 0 0",
        "0 -10 1.2 0 0 0",
        f"10 0 1.2 0 0 {QUARTER}",
        f"-10 0 1.2 0 0 {QUARTER}",
    )
    links = (
        f'<link name="w{i}"><pose>{pose}</pose>{visual(box("20 0.2 2.4"))}</link>'
        for i, pose in enumerate(poses)
    )
    arena = f'<model name="arena">{"".join(links)}</model>'
    crate = model(CUBE, pose="4 0 0.5 0 0 0", name="crate")
    scene = load(tmp_path, arena + crate)
    assert [o.name for o in scene.objects] == ["arena", "crate"]
    free = scene.is_free([(0, 0), (4, 0), (10, 0), (0, -10), (9, 9)])
    assert free.tolist() == [True, False, False, False, True]
    ring_m = Simulator(scene, {"a": Pose(-4, 0)}, seed=1).true_ranges_m("a")
    east, north, west = ring_m[[0, len(ring_m) // 4, len(ring_m) // 2]]
    assert (east, north, west) == pytest.approx((7.5, 8.0, 5.9), abs=0.01)


def test_a_gate_is_driven_through(tmp_path: Path) -> None:
    posts = "".join(visual(box("0.3 0.3 3"), pose=f"0 {y} 1.5 0 0 0") for y in (2, -2))
    beam = visual(box("0.3 4.3 0.3"), pose="0 0 2.8 0 0 0")
    scene = load(tmp_path, model(posts + beam, name="gate"))
    assert scene.is_free([(0, 0), (0, 2)]).tolist() == [True, False]


@pytest.mark.parametrize(
    ("file", "material", "rgb"),
    [
        ("a.dae", "<diffuse>0 0 1 1</diffuse>", (0, 0, 255)),
        ("a.dae", "<diffuse>1 1 1 1</diffuse>", (255, 255, 255)),
        ("a.dae", "<diffuse/>", (255, 0, 0)),
        ("b.dae", "<diffuse>1 0.5 0 1</diffuse>", (200, 50, 0)),
        ("a.dae", "<diffuse>0 0 0.2 1</diffuse><emissive>1 0 0 1</emissive>", (255, 0, 51)),
    ],
)
def test_a_visuals_colour_replaces_the_meshs_and_tints_its_picture(
    tmp_path: Path, file: str, material: str, rgb: tuple[int, int, int]
) -> None:
    files: gz.Files = {
        "worlds/a.dae": gz.dae(),
        "worlds/b.dae": gz.dae(picture="p.png"),
        "worlds/p.png": gz.png((200, 100, 50)),
    }
    thing = drawn(tmp_path, mesh(file), files, f"<material>{material}</material>")
    assert colours(thing) == {rgb}


def test_an_empty_element_is_as_none(tmp_path: Path) -> None:
    shown = (
        "<visual name='v'><pose/><transparency/><geometry><mesh><uri>a.dae</uri><scale/></mesh>"
        "</geometry></visual><visual name='w'><geometry><plane><size/><normal/></plane></geometry>"
        "</visual>"
    )
    thing = only(load(tmp_path, model(shown), {"worlds/a.dae": gz.dae()}))
    assert np.allclose(thing.bounds_m, [(-0.5, -0.5, 0), (1, 1, 1)], atol=0.002)


def test_twins_share_a_model_and_others_of_one_name_do_not(tmp_path: Path) -> None:
    def crate(name: str, size: str, x_m: float) -> str:
        return model(visual(box(size)), pose=f"{x_m} 0 1 0 0 1", name=name)

    scene = load(tmp_path, crate("a", "1 1 1", 0) + crate("b", "1 1 1", 5) + crate("c", "1 1 2", 9))
    a, b, c = (o.model for o in scene.objects)
    assert a == b != c


def test_a_model_within_a_model_is_part_of_it_and_a_group_is_not(tmp_path: Path) -> None:
    inner = model(CUBE, pose="2 0 0 0 0 0", name="inner")
    outer = f'<model name="outer"><link name="l">{CUBE}</link>{inner}</model>'
    group = f'<model name="group"><pose>0 9 0 0 0 0</pose>{inner}</model>'
    scene = load(tmp_path, outer + group)
    assert [o.name for o in scene.objects] == ["outer", "group::inner"]
    assert np.allclose(scene.objects[0].size_m, (3, 1, 1))
    assert centre(scene.objects[1]) == [2, 9, 0]


def test_two_sides_of_a_sheet_keep_to_their_sides(tmp_path: Path) -> None:
    places = "v 0 0 0\nv 1 0 0\nv 1 0 1\nv 0 0 1\nvt 0 0\nvt 1 1\nvt 0.5 0\n"
    sheet = places + "f 1/1 2/1 3/1\nf 1/1 3/1 4/1\nf 2/2 1/2 4/3\nf 2/2 4/2 3/3\n"
    corners = np.concatenate(triangles(drawn(tmp_path, mesh("a.obj"), {"worlds/a.obj": sheet})))
    assert {round(float(y), 4) for y in corners[:, 1]} == {-0.0015, 0.0015}


def test_what_is_not_supported_is_told_in_one_warning(tmp_path: Path) -> None:
    body = (
        '<plugin name="p" filename="libwind.so"/><actor name="walker"/>'
        '<light name="lamp" type="point"/><light name="s" type="directional"/>'
        '<model name="m"><link name="l"><sensor name="eye"/>'
        f"{visual('<heightmap/>')}{CUBE}</link>"
        '<joint name="hinge" type="revolute"/><joint name="weld" type="fixed"/></model>'
    )
    with told(
        "test.world", "plugins: 1 (libwind.so)", "actors: 1 (walker)", "sensors: 1 (eye)",
        "lights beside the sun: 1 (lamp)", "heightmaps: 1", "joints that move: 1 (hinge)",
    ):  # fmt: skip
        load(tmp_path, body)


def test_what_later_and_earlier_sdf_has_besides_is_told(tmp_path: Path) -> None:
    crate = model(CUBE, name="m")
    body = (
        '<scene><fog><type>linear</type></fog></scene><gui><plugin filename="libview.so"/></gui>'
        + crate
        + crate.replace('name="m"', 'name="n"').replace('"link">', '"link"><pose frame="f"/>')
        + "<include><uri>model://c</uri><experimental:params/></include>"
        + '<state><model name="m"><pose>5 0 0 0 0 0</pose><link name="link"><pose>5 0 2 0 0 0'
        '</pose></link></model><model name="n"><pose>7 0 0 0 0 0</pose><link name="link"><pose>'
        "7 0 0 0 0 0</pose></link></model><deletions><name>c</name></deletions></state>"
    )
    pbr = "<material><pbr><metal><normal_map>n.png</normal_map></metal></pbr></material>"
    files = gz.folder_of("c", crate.replace('name="m"', 'name="c"'))
    files |= gz.folder_of("p", model(visual(box("1 1 2"), material=pbr), name="p"))
    with told(
        "fog: 1", "plugins: 1 (libview.so)", "normal maps: 1",
        "frames of poses, as of SDF 1.5: 1 (f)", "parameters of includes: 1",
        "parts that a saved state moves in their model: 1 (m)",
    ):  # fmt: skip
        scene = load(tmp_path, body + include("model://p"), files)
    assert [o.name for o in scene.objects] == ["m", "n", "p"]


@UNWARNED
def test_a_plain_world_is_told_nothing(tmp_path: Path) -> None:
    light = load(tmp_path, gz.SUN + model(CUBE)).light
    assert light.sun_elevation_deg == pytest.approx(60.4, abs=0.1)
    assert light.sun_azimuth_deg == pytest.approx(348.7, abs=0.1)


def test_a_model_file_alone_is_a_world(tmp_path: Path) -> None:
    gz.write(tmp_path, {"a.sdf": f'<sdf version="1.7">{model(CUBE, name="m")}</sdf>'})
    assert only(load_scene(tmp_path / "a.sdf")).name == "m"


def test_a_saved_state_moves_models(tmp_path: Path) -> None:
    state = '<state><model name="m"><pose>7 0 0 0 0 0</pose></model></state>'
    moved = model(CUBE, name="m") + state
    assert centre(only(load(tmp_path, moved))) == [7, 0, 0]
    unmoved = moved.replace("<pose>7 0 0 0 0 0</pose>", "")  # it says nothing of where it is
    unmoved = unmoved.replace("</link>", "</link><pose>3 0 0 0 0 0</pose>", 1)
    assert centre(only(load(tmp_path, unmoved))) == [3, 0, 0]


@pytest.mark.parametrize(
    ("name", "size_m", "kind"),
    [
        ("house_1", (16, 12, 7), "house"),
        ("gas_station", (20, 30, 9), "shop"),
        ("police_station", (13, 19, 8), "building"),
        ("lamp_post", (0.5, 3, 9), "lamp"),
        ("post_office", (10, 7, 4), "building"),
        ("hatchback_red", (4, 2, 1.5), "vehicle"),
        ("OakTree", (3, 3, 9), "tree"),
        ("pioneer3at", (0.5, 0.5, 0.3), "robot"),
        ("pr2", (0.7, 0.7, 1.3), "robot"),
        ("gas_station_sign", (0.6, 0.1, 2), "sign"),
        ("post_office_box", (0.4, 0.4, 1.2), "pole"),
        ("asphalt_plane", (20, 20, 0.1), "ground"),
        ("grass_terrain", (100, 80, 2), "ground"),
        ("road_barrier", (3, 0.5, 1), "barrier"),
        ("parking_garage", (30, 30, 10), "building"),
        ("parking", (30, 30, 10), "building"),
        ("kerb", (2, 0.5, 0.5), "object"),
        ("scarecrow", (0.6, 0.4, 1.8), "object"),
        ("turtlebot3_house", (15, 10, 3), "house"),
        ("turtlebot3_burger", (0.2, 0.2, 0.2), "robot"),
        ("hospital_car_park_building", (20, 10, 9), "building"),
        ("elevator_car", (1.5, 2.3, 2.5), "object"),
        ("warehouse_pallet_jack", (1.2, 0.5, 1), "object"),
        ("warehouse_shelf", (2.1, 18, 6.5), "object"),
        ("tour_bus", (12, 2.6, 3.5), "vehicle"),
        ("bicycle", (0.6, 1.8, 1.1), "vehicle"),
        ("walking_street", (30, 20, 6), "building"),
        ("person_walking", (0.8, 1, 1.8), "person"),
        ("x17", (20, 20, 0.1), "ground"),
        ("x17", (9, 9, 4), "building"),
        ("x17", (0.2, 0.2, 4), "pole"),
    ],
)
def test_kinds_by_name_then_by_shape(
    name: str, size_m: tuple[float, float, float], kind: str
) -> None:
    assert guess(name, size_m, leafy=False) == kind


def test_a_robot_does_not_drive_through_a_road_barrier(tmp_path: Path) -> None:
    barrier = only(scene := load(tmp_path, model(visual(box("3 0.5 1")), name="road_barrier")))
    assert (barrier.kind, barrier.landmark, barrier.solid) == ("barrier", True, True)
    assert not scene.is_free([(0, 0)]).any()


def test_a_world_is_drawn(tmp_path: Path) -> None:
    red = "<material><diffuse>1 0 0 1</diffuse></material>"
    body = model(visual(gz.GROUND), name="ground") + model(
        visual(box("1 1 2"), material=red), pose="4 0 1 0 0 0", name="m"
    )
    scene = load(tmp_path, body)
    seen = Renderer(scene).segmentation(Pose(0, 0))
    assert seen[0, 240, 320] == scene.index_of("m")
    assert (seen == GroundTruth(scene).look(Pose(0, 0))[0]).mean() > 0.999
    r, g, b = Renderer(scene).render(Pose(0, 0)).views[0][240, 320].astype(int)
    assert r > 80 and max(g, b) < 10

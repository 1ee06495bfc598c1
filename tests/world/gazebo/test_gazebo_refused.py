"""What is wrong with a world or its models is refused by file and line or element, and soon."""

import errno
import os
import re
import struct
import time
import zlib
from pathlib import Path

import gazebo_files as gz
import pytest
from gazebo_files import CUBE, box, include, mesh, model, visual, world, write
from gazebo_files import no_folders as no_folders

from vrchain.errors import SpecError
from vrchain.world import load_scene
from vrchain.world.gazebo import designs, materials, scripts, sdf
from vrchain.world.gazebo.mesh import meshes, obj
from vrchain.world.gazebo.sdf import MOST_MODELS

BOMB = (
    '<!DOCTYPE b [<!ENTITY a "aaaaaaaaaa">'
    + "".join(
        f'<!ENTITY {c} "{f"&{b};" * 10}">' for b, c in zip("abcdefgh", "bcdefghi", strict=True)
    )
    + "]>"
)
CRATE = model(CUBE)


def refused(folder: Path, document: str | bytes, files: gz.Files | None = None) -> str:
    """The one line that a world is refused with, in seconds of the processor."""
    write(folder, {"worlds/test.world": document, **(files or {})})
    start_s = time.process_time()
    with pytest.raises(SpecError) as told:
        load_scene(folder / "worlds" / "test.world")
    assert time.process_time() - start_s < 10
    message = str(told.value)
    assert "\n" not in message and len(message) < 900
    return message


@pytest.mark.parametrize(
    ("document", "parts"),
    [
        ("", ["test.world:1", "expected XML"]),
        ("seed: 3", ["test.world:1", "expected XML"]),
        ("<sdf>\n<world>\n</sdf>", ["test.world:3", "mismatched tag"]),
        ("<robot/>", ["test.world:1: <robot>", "<sdf>"]),
        ("<sdf/>", ["test.world:1: <sdf>", "<world> or a <model>"]),
        (BOMB + "<sdf>&i;</sdf>", ["test.world:1", "DOCTYPE"]),
        ('<!DOCTYPE s SYSTEM "/etc/passwd"><sdf/>', ["test.world:1", "DOCTYPE"]),
        ('<?xml version="1.0" encoding="klingon"?><sdf/>', ["test.world", "expected XML"]),
        ("<a>" * 5000, ["test.world:1", "deep"]),
        (world(""), ["test.world", "nothing in this world"]),
        (world(include("model://gone")),
         ["test.world: nothing in", "models that are missing: 1 (model://gone)", "_MODEL_PATH"]),
        (world(include("")), ["<include>", "<uri>"]),
        (world(include("https://fuel.org/models/car")),
         ["models that are missing: 1 (https://fuel.org/models/car)", "GAZEBO_MODEL_PATH"]),
        (world(model(visual(mesh("https://fuel.org/a.dae")))),
         ["meshes that are missing: 1 (https://fuel.org/a.dae)"]),
        (world(model(visual(mesh("file:///etc/a.dae")))),
         ["meshes that are missing: 1 (file:///etc/a.dae)"]),
        (world(model(visual(mesh("x" * 300)))), [":1: <uri>", "name too long", "at most 255"]),
        (world(model(visual(box("1 1 1"), pose="1 2 3"))), [":1: <pose>", "6 finite", "'1 2 3'"]),
        (world(model(visual(box("1 1 1"), pose="nan 0 0 0 0 0"))), ["<pose>", "finite"]),
        (world(model(visual(box("1 1 1"), pose="0 1e9 0 0 0 0"))),
         ["nothing in", "models more than 100 km away, left out: 1 (thing)"]),
        (world(model(visual(box("1 1 1"), pose="0 6e4 0 0 0 0"), pose="0 6e4 0 0 0 0")),
         ["nothing in", "models more than 100 km away, left out: 1 (thing)"]),
        (world(model(visual(box("1 1 1"), pose="1e308 0 0 0 0 0"), pose="1e308 0 0 0 0 0")),
         ["nothing in", "models more than 100 km away, left out: 1 (thing)"]),
        (world('<model name="m"><link name="l"><visual name="v"><geometry><heightmap/></geometry>'
               "</visual></link></model>"), ["nothing in this world", "heightmaps: 1"]),
        (world(gz.GROUND_MODEL + model(CUBE, pose="900 900 0 0 0 0")),
         ["test.world", "300 m of the origin", "x in 899.5..900.5"]),
        (world(model(visual(box("1 -1 1")))), ["test.world:1: <box>", "<size>", "more than 0"]),
        (world(model(visual(box("1e5 1 1")))), ["not of 0.001 to 2000 m", "is 1e+05 m large"]),
        (world(model(visual(box("1e-9 1e-9 1e-9")))), ["thing is 1e-09 m large"]),
        (world(model(visual(mesh("gone.dae")))), ["meshes that are missing: 1 (gone.dae)"]),
        (world(model(visual(mesh("a.blend")))), ["meshes that are missing: 1 (a.blend)"]),
        (world(model(visual("<polyline><point>0 0</point><point>1 0</point></polyline>"))),
         ["test.world:1: <polyline>", "at least 3 <point>s, got 2"]),
        (world(model(visual("<polyline>" + "<point>0 0</point>" * 3 + "</polyline>"))),
         ["test.world:1: <polyline>", "an outline with an area"]),
        (world("<road><point>0 0 0</point><point>0 0 0</point></road>"),
         ["test.world:1: <road>", "points that differ"]),
        (world(f"<population>{CRATE}<box/><model_count>1e9</model_count></population>"),
         ["test.world:1: <population>", f"at most {MOST_MODELS} models"]),
        (world(f"<population>{CRATE}<box/><model_count>0.5</model_count></population>"),
         ["test.world:1: <population>", "a whole number"]),
        (world(f"<population>{CRATE}</population>"), ["<population>", "<box> or a <cylinder>"]),
        (world(f"<population>{CRATE}<box/><distribution><type>linear-w</type></distribution>"
               "</population>"), ["<population>", "a distribution of random, ", "'linear-w'"]),
        (world("<population/>"), ["test.world:1: <population>", "expected a <model>"]),
        (world(f'<model name="m" placement_frame="f"><link name="l">{CUBE}</link></model>'),
         ["test.world:1: <model>", "no frame 'f'"]),
        (
            world('<model name="m"><pose relative_to="f"/></model><frame name="f"><pose '
                  'relative_to="g"/></frame><frame name="g"><pose relative_to="f"/></frame>'),
            ["depends on itself", "f -> g -> f"],
        ),
        (world('<model name="m"><pose relative_to="f"/></model>'), ["no frame 'f'"]),
        (world('<model name="m"><pose relative_to="n::l"/></model><model name="n"/>'),
         ["test.world:1: <model>", "no frame 'l'"]),
    ],
)  # fmt: skip
def test_documents(tmp_path: Path, document: str, parts: list[str]) -> None:
    message = refused(tmp_path, document)
    assert [p for p in parts if p not in message] == []


def test_names_that_are_too_long(tmp_path: Path) -> None:
    long = "x" * 300
    material = f"<material><script><uri>{long}</uri><name>A</name></script></material>"
    message = refused(tmp_path, world(model(visual(box("1 1 1"), material=material))))
    assert "test.world:1: <uri>" in message and "name too long" in message
    message = refused(tmp_path, world(include(f"model://{long}")), gz.folder_of("m", CRATE))
    assert "test.world:1: <include>" in message and "name too long" in message
    with pytest.raises(SpecError, match="name too long"):
        load_scene(tmp_path / f"{long}.world")


def test_a_folder_that_may_not_be_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path, gz.folder_of("m", CRATE))
    closed = tmp_path / "models" / "m" / "model.config"
    stat = Path.stat

    def refuse(path: Path, **options: bool) -> os.stat_result:
        if path == closed:
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return stat(path, **options)

    monkeypatch.setattr(Path, "stat", refuse)
    message = refused(tmp_path, world(include("model://m")))
    assert "model.config: cannot look there (Permission denied)" in message


def test_no_file_and_a_folder(tmp_path: Path) -> None:
    (tmp_path / "d.world").mkdir()
    for name, what in (("gone.sdf", "is not there"), ("d.world", "is a folder")):
        with pytest.raises(SpecError, match=f"{name} {what}"):
            load_scene(tmp_path / name)


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """The files that are read."""
    read: list[Path] = []
    for module in (meshes, materials, sdf, obj, scripts):
        original = module.read_bytes
        monkeypatch.setattr(
            module, "read_bytes", lambda f, most, r=original: (read.append(f), r(f, most))[1]
        )
    return read


@pytest.mark.parametrize(
    "uri",
    ["model://../..", "model://../secret", "model:///etc/passwd", "../../secret", "/etc/passwd",
     "model://m/../../secret", "file://../../secret", "file:///etc/passwd", "https://../secret",
     "https://fuel.org/1.0/o/models/../../secret", "package://m/%2e%2e/%2e%2e/secret",
     "model://%2e%2e/secret", "https://fuel.org/o/models/%2e%2e/1/files/secret",
     "model://a/../../../secret"],
)  # fmt: skip
def test_paths_that_leave_the_model_folders(tmp_path: Path, opened: list[Path], uri: str) -> None:
    files: gz.Files = {
        "secret/model.sdf": f"<sdf>{CRATE}</sdf>",
        **gz.folder_of("m", CRATE),
    }
    message = refused(tmp_path, world(include(uri)), files)
    assert "models that are missing: 1 (" in message
    inside = model(visual(mesh(f"{uri}/a.dae")))
    write(tmp_path / "secret", {"a.dae": gz.dae()})
    message = refused(tmp_path, world(include("model://m")), {**files, **gz.folder_of("m", inside)})
    assert "meshes that are missing: 1 (" in message
    assert {file.parent.name for file in opened} == {"worlds", "m"}


def test_links_that_leave_the_model_folders(tmp_path: Path, opened: list[Path]) -> None:
    write(tmp_path, {"secret/a.dae": gz.dae(), "secret/p.png": gz.png((1, 2, 3))})
    inside, document = tmp_path / "models" / "m", world(include("model://m"))
    write(tmp_path, gz.folder_of("m", model(visual(mesh("a.dae")))))
    (inside / "a.dae").symlink_to(tmp_path / "secret" / "a.dae")
    assert "meshes that are missing: 1 (a.dae)" in refused(tmp_path, document)
    (inside / "a.dae").unlink()
    (inside / "p.png").symlink_to(tmp_path / "secret" / "p.png")
    files: gz.Files = {"models/m/a.dae": gz.dae(picture="p.png")}
    with gz.told("pictures that are missing: 1 (p.png)"):
        gz.load(tmp_path, include("model://m"), files)
    files = {
        "models/m/a.obj": gz.obj(more="mtllib a.mtl\nusemtl A"),
        "models/m/a.mtl": "newmtl A\nmap_Kd ../../../secret/p.png\n",
        **gz.folder_of("m", model(visual(mesh("a.obj")))),
    }
    with gz.told("pictures that are missing: 1 (../../../secret/p.png)"):
        gz.load(tmp_path, include("model://m"), files)
    (tmp_path / "models" / "away").symlink_to(tmp_path / "secret")
    assert "models that are missing: 1" in refused(tmp_path, world(include("model://away")))
    write(tmp_path, {"secret/scripts/a.material": "material A { }",
                     "secret/model.config": gz.config(("1.6", "other.sdf"))})  # fmt: skip
    script = "<material><script><name>A</name></script></material>"
    gz.write(tmp_path, gz.folder_of("n", model(visual(box("1 1 1"), material=script))))
    (tmp_path / "models/n/materials").mkdir()
    (tmp_path / "models/n/materials/scripts").symlink_to(tmp_path / "secret/scripts")
    (tmp_path / "models/n/model.config").unlink()
    (tmp_path / "models/n/model.config").symlink_to(tmp_path / "secret/model.config")
    with gz.told("materials that are missing, drawn grey: 1 (A)"):
        gz.load(tmp_path, include("model://n"))
    assert not any(file.resolve().is_relative_to(tmp_path / "secret") for file in opened)


def test_includes_that_include_themselves(tmp_path: Path) -> None:
    files = {
        **gz.folder_of("a", f'<model name="a">\n{include("model://b")}</model>'),
        **gz.folder_of("b", f'<model name="b">\n{include("model://a")}</model>'),
    }
    message = refused(tmp_path, world(include("model://a")), files)
    assert re.search(r"b/model\.sdf:2: <include>: model://a includes itself", message)


@pytest.mark.parametrize("merge", ["<include>", '<include merge="true">'])
@pytest.mark.parametrize(
    ("n", "times", "part"),
    [(11, 10, f"at most {MOST_MODELS} models"), (39, 1, "deep in one another")],
)
def test_includes_that_multiply_or_go_deep(
    tmp_path: Path, n: int, times: int, part: str, merge: str
) -> None:
    files = gz.folder_of("m0", CRATE)
    for k in range(1, n + 1):
        body = "".join(include(f"model://m{k - 1}", name=f"i{j}") for j in range(times))
        body = body.replace("<include>", merge)
        files |= gz.folder_of(f"m{k}", f'<model name="m">{body}</model>')
    assert part in refused(tmp_path, world(include(f"model://m{n}")), files)


def test_more_triangles_than_a_world_may_have(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    drawn: list[str] = []
    build = designs.primitive
    monkeypatch.setattr(designs, "primitive", lambda e: (drawn.append(e.tag), build(e))[1])
    monkeypatch.setattr(designs, "MOST_TRIANGLES", 50_000)
    ball = visual("<sphere><radius>1</radius></sphere>")
    message = refused(tmp_path, world(model("\n" + ball * 20_000)))
    assert "test.world:2: <visual>: expected at most 50000 triangles" in message
    assert len(drawn) < 60  # it is refused as soon as it is too much


def test_more_faces_on_the_map_than_light_falls_on_in_time(tmp_path: Path) -> None:
    floors = "".join(model(visual(box(f"1900 1900 {k + 1}"))) for k in range(6))
    assert "test.world: expected faces of at most 4e+06" in refused(tmp_path, world(floors))


def many(name: str, below: str, n: int = 10) -> str:
    """A node that uses another one many times."""
    return f'<node id="{name}">' + f'<instance_node url="#{below}"/>' * n + "</node>"


NODES = "<library_nodes>" + f'<node id="n0">{gz.INSTANCE}</node>'
NODES += "".join(many(f"n{k}", f"n{k - 1}") for k in range(1, 12)) + "</library_nodes>"


def polylist(vcount: str) -> str:
    """A box whose faces are given by their numbers of corners."""
    return gz.dae().replace("triangles", "polylist").replace("<p>", f"<vcount>{vcount}</vcount><p>")


def stl(faces: int, *, broken: int) -> bytes:
    """Faces as a binary STL, of which the last ones have no place."""
    whole = struct.pack("<12fH", 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0)
    places = [whole] * (faces - broken) + [struct.pack("<12fH", *[float("nan")] * 12, 0)] * broken
    return bytes(80) + struct.pack("<I", faces) + b"".join(places)


TEXT_STL = "solid a facet outer loop\nvertex 0 0 0\nvertex 1 nan 0\nvertex 0 1 0\n endsolid"


@pytest.mark.parametrize(
    ("file", "content", "parts"),
    [
        ("a.dae", polylist("2000000000"), ["a.dae", "'g'", "<vcount>", "4000000000", "has 72"]),
        ("a.dae", polylist("3 -3 40"), ["a.dae", "'g'", "<vcount>"]),
        ("a.dae", polylist("3 three"), ["a.dae", "'g'", "expected whole numbers"]),
        ("a.dae", gz.dae().replace('meter="1.0"', 'meter="abc"'), ['a.dae: <unit meter="abc">']),
        ("a.dae", gz.dae(meter=-1), ['a.dae: <unit meter="-1">', "more than 0"]),
        ("a.dae", gz.dae(meter=float("nan")), ['a.dae: <unit meter="nan">']),
        ("a.dae", gz.dae().replace('POSITION" source="#p', 'POSITION" source="#x'),
         ["a.dae", "'g'", "<vertices>", "'#x'"]),
        ("a.dae", gz.dae().replace('VERTEX" source="#v', 'VERTEX" source="#x'),
         ["a.dae", "expected a COLLADA mesh", "#x"]),
        ("a.dae", gz.dae().replace("0 0 1 0 1 1<", "0 0 nan 0 1 1<"),
         ["a.dae", "texture coordinate in 't'", "finite number"]),
        ("a.dae", gz.dae().replace("<p>0 ", "<p>-1 "), ["a.dae", "'p'", "index of -1"]),
        ("a.dae", gz.dae().replace("<p>0 0 ", "<p>0 -1 "), ["a.dae", "'p'", "index of -1"]),
        ("a.dae", gz.dae().replace(">1 0 0 1<", ">nan 0 0 1<"), ["a.dae", "effect 'e'", "finite"]),
        ("a.stl", stl(13, broken=1), ["a.stl", "face 13", "finite"]),
        ("a.stl", stl(2, broken=2), ["a.stl", "face 1", "finite"]),
        ("a.stl", stl(9, broken=0)[:-60], ["a.stl", "534 bytes", "got 474 bytes", "cut off"]),
        ("a.stl", TEXT_STL, ["a.stl", "face 1", "finite"]),
        ("a.fbx", b"glTF", ["nothing in this world", "none of .dae, .obj, .stl, .glb", "a.fbx"]),
        ("a.dae", "not a mesh", ["a.dae:1", "expected XML"]),
        ("a.dae", gz.dae(doctype=BOMB), ["a.dae:1", "DOCTYPE"]),
        ("a.dae", gz.dae(nodes=""), ["a.dae", "faces, got none"]),
        ("a.dae", gz.dae(positions="nan " * 24), ["a.dae", "not a finite number"]),
        ("a.dae", gz.dae(positions="0 " * 24), ["a.dae", "faces, got none"]),
        ("a.dae", gz.dae(positions="0 0 0"), ["a.dae"]),
        ("a.dae", gz.dae(meter=1e12), ["thing is 1e+12 m large"]),
        ("a.dae", gz.dae(extra=NODES, nodes=many("top", "n11")), ["a.dae", "nodes in use"]),
        ("a.dae", "<COLLADA>" + "<a>" * 9000, ["a.dae:1", "deep"]),
        ("a.obj", "v 0 0 0\n", ["a.obj", "faces, got none"]),
        ("a.obj", "v 0 0 0\nf 1 2 3\n", ["a.obj"]),
        ("a.obj", "v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", ["a.obj", "finite"]),
        ("a.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 1e39 0\nf 1/1 2/1 3/1\n",
         ["a.obj", "texture coordinate", "beyond"]),
        ("a.obj", b"\xff\xfe\x00" * 99, ["a.obj"]),
        ("a.stl", b"", ["a.stl"]),
        ("a.stl", bytes(80) + struct.pack("<I", 2**32 - 1) + bytes(50), ["a.stl"]),
        ("a.stl", bytes(80) + struct.pack("<I", 0), ["a.stl"]),
        ("a.dae", b"PK\x03\x04" + bytes(100), ["a.dae", "expected XML"]),
    ],
)  # fmt: skip
def test_meshes(tmp_path: Path, file: str, content: str | bytes, parts: list[str]) -> None:
    message = refused(tmp_path, world(model(visual(mesh(file)))), {f"worlds/{file}": content})
    assert [p for p in parts if p not in message] == []


@pytest.mark.parametrize(
    ("line", "parts"),
    [
        ("Kd nan 0 0", ["a.mtl:2: expected", "numbers"]),
        ("Kd 1 x 0", ["a.mtl:2: expected", "numbers"]),
        ("Kd 1 0", ["a.mtl:2: expected", "numbers"]),
        ("map_Kd /a\0b.png", ["test.world:1: <mesh>", "zero byte"]),
        ("map_Kd a%00b.png", ["test.world:1: <mesh>", "zero byte"]),
    ],
)
def test_material_files_of_a_mesh(tmp_path: Path, line: str, parts: list[str]) -> None:
    files = {
        "worlds/a.obj": gz.obj(more="mtllib a.mtl\nusemtl A"),
        "worlds/a.mtl": f"newmtl A\n{line}\n",
    }
    message = refused(tmp_path, world(model(visual(mesh("a.obj")))), files)
    assert [p for p in parts if p not in message] == []


@pytest.mark.parametrize("scale", ["0 0 0", "1e30 1 1", "nan 1 1", "1 1"])
def test_scales(tmp_path: Path, scale: str) -> None:
    shown = mesh("a.dae", f"<scale>{scale}</scale>")
    message = refused(tmp_path, world(model(visual(shown))), {"worlds/a.dae": gz.dae()})
    assert "test.world:1" in message and ("<scale>" in message)


def wide_png(width_px: int, height_px: int) -> bytes:
    """A picture of a few bytes that says it is very wide."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        body = kind + data
        return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))

    head = struct.pack(">IIBBBBB", width_px, height_px, 8, 2, 0, 0, 0)
    packed = zlib.compress(bytes(1000))
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", packed) + chunk(b"IEND", b"")
    )


@pytest.mark.parametrize(
    ("content", "part"),
    [
        (b"no picture", "cannot read this"),
        (b"", "cannot read this"),
        (wide_png(9000, 10), "at most 8192 pixels a side, got 9000 x 10"),
        (wide_png(60000, 60000), "p.png"),
        (wide_png(50, 50), "cannot read this"),
    ],
)
def test_pictures(tmp_path: Path, content: bytes, part: str) -> None:
    files: gz.Files = {
        "worlds/a.dae": gz.dae(picture="p.png"),
        "worlds/p.png": content,
    }
    with gz.told("pictures that cannot be read: 1 (", "p.png", part):
        gz.load(tmp_path, model(visual(mesh("a.dae"))), files)


def test_files_that_are_too_large(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(meshes, "MOST_MESH_BYTES", 1 << 20)
    big = gz.obj() + "# " + "x" * (1 << 20)
    message = refused(tmp_path, world(model(visual(mesh("a.obj")))), {"worlds/a.obj": big})
    assert "a.obj: expected at most 1 MiB" in message
    monkeypatch.setattr(sdf, "MOST_XML_BYTES", 1 << 20)
    assert "test.world: expected at most 1 MiB" in refused(tmp_path, " " * ((1 << 20) + 1))


def test_a_broken_script(tmp_path: Path) -> None:
    material = "<material><script><name>A</name></script></material>"
    files: gz.Files = {
        "models/m/materials/scripts/a.material": "material A\n{\n" + "{\n" * 99,
        **gz.folder_of("m", model(visual(box("1 1 1"), material=material))),
    }
    message = refused(tmp_path, world(include("model://m")), files)
    assert "a.material: braces" in message


def test_a_pipe_is_no_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.dae")
    write(tmp_path, {"t.world": world(model(visual(mesh("a.dae"))))})
    with pytest.raises(SpecError, match=r"meshes that are missing: 1 \(a\.dae\)"):
        load_scene(tmp_path / "t.world")

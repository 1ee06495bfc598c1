"""Gazebo worlds as they are found: files that are no strict XML, or name what lies elsewhere."""

from pathlib import Path

import gazebo_files as gz
import numpy as np
import pytest
from gazebo_files import CUBE, UNWARNED, box, include, load, mesh, model, only, told, visual, world
from gazebo_files import no_folders as no_folders

from vrchain.errors import SpecError
from vrchain.world import load_scene
from vrchain.world.gazebo.xml import MOST_XML_DEPTH, checked, mended, parse

CRATE = model(CUBE, name="crate")


@UNWARNED
@pytest.mark.parametrize(
    "document",
    [
        "<!-- gz topic --echo -t /x -->" + world(CRATE),
        world(f"<!----><!-- <--> {CRATE}<!-- a -- b --- c --->"),
        '\n \n<?xml version="1.0"?>' + world(CRATE),
        '\ufeff\n<?xml version="1.0" encoding="utf-8"?><!-- -- -->' + world(CRATE),
        world("<gui><name>door & car; &now &amp; A&#66;</name></gui>" + CRATE),
        world(CRATE.replace("<static>1", '<static a="x&y">1')),
        world(f"<gui><![CDATA[<!-- & ]]></gui>{CRATE}"),
    ],
)
def test_documents_that_tinyxml2_reads(tmp_path: Path, document: str) -> None:
    gz.write(tmp_path, {"t.sdf": document})
    assert only(load_scene(tmp_path / "t.sdf")).name == "crate"


def test_what_is_mended_keeps_its_lines_and_its_words() -> None:
    data = b'\n\n<?xml version="1.0"?>\n<a>x & y\n<!-- -- \n--> <b c="&lt;&"/>\n<![CDATA[&--]]></a>'
    root = parse(data, Path("f"))
    assert root.text.split() == ["x", "&", "y", "&--"]
    (b,) = root.children
    assert (b.line, b.attributes) == (6, {"c": "<&"})
    assert mended(data).count(b"\n") == data.count(b"\n")
    assert mended(mended(data)) == mended(data)


@pytest.mark.parametrize(
    ("document", "part"),
    [
        ('<!-- -- --><!DOCTYPE a [<!ENTITY b "c">]><a>&b;</a>', "DOCTYPE"),
        ('\n<?xml version="1.0"?><!DOCTYPE a SYSTEM "/etc/passwd"><a/>', "DOCTYPE"),
        ("<?x <!-- ?><!DOCTYPE a><a/><!-- -->", "DOCTYPE"),
        ("<![CDATA[ <!DOCTYPE a> ]]><a/>", "expected XML"),
        ("<a><!-- -- ", "expected XML"),
        ("<a>" + "<!--" * 100_000, "expected XML"),
        ("<a>" + "&" * 100_000, "expected XML"),
        ("<!-- -- -->" + "<a>" * (MOST_XML_DEPTH + 1), "deep"),
        ('<a b="&#0;"/>', "expected XML"),
    ],
)
def test_what_is_mended_is_refused_all_the_same(document: str, part: str) -> None:
    for read in (parse, checked):
        with pytest.raises(SpecError, match=part):
            read(document.encode(), Path("f"))


def test_an_unknown_entity_is_a_word() -> None:
    assert parse(b"<a>&nbsp;&xxe;</a>", Path("f")).text == "&nbsp;&xxe;"


@pytest.mark.parametrize(
    "uri",
    [
        "https://fuel.gazebosim.org/1.0/OpenRobotics/models/Big Crate",
        "https://fuel.gazebosim.org/1.0/OpenRobotics/models/Big%20Crate/3",
        "https://fuel.ignitionrobotics.org/1.0/a/models/big_crate/tip",
        "model://some/where/big_crate",
        "package://pkg/models/big_crate",
        "file:///home/alice/models/big_crate",
        "file://models/big_crate/model.sdf",
    ],
)
def test_a_model_by_the_last_part_of_its_name(tmp_path: Path, uri: str) -> None:
    files = gz.folder_of("big_crate", model(visual(box("2 2 2"))))
    assert only(load(tmp_path, include(uri), files)).size_m == (2, 2, 2)


@pytest.mark.parametrize(
    "uri",
    [
        "https://fuel.gazebosim.org/1.0/a/models/my box/2/files/meshes/a b.dae",
        "model://my%20box/meshes/a%20b.dae",
        "package://pkg/my box/meshes/a b.dae",
        "file://models/my%20box/meshes/a b.dae",
    ],
)
def test_a_mesh_by_the_last_parts_of_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, uri: str
) -> None:
    gz.write(tmp_path, {"root/models/my box/meshes/a b.dae": gz.dae()})
    monkeypatch.setenv("GZ_SIM_RESOURCE_PATH", f"{tmp_path}/root/models")
    assert np.allclose(only(load(tmp_path, model(visual(mesh(uri))))).size_m, 1)


def test_all_that_is_missing_is_told_in_one_warning_and_refused_if_strict(tmp_path: Path) -> None:
    lost = [f"model://no_{k}" for k in range(7)]
    body = CRATE + "".join(map(include, lost)) + model(visual(mesh("none.stl")), name="m")
    body += model(visual(mesh("a.dae")), name="n")
    files: gz.Files = {"worlds/a.dae": gz.dae(picture="../../../p.png")}
    parts = (
        f"models that are missing: 7 ({', '.join(lost)})",
        "meshes that are missing: 1 (none.stl)",
        "pictures that are missing: 1 (../../../p.png)",
        "GAZEBO_MODEL_PATH",
    )
    with told(*parts):
        scene = load(tmp_path, body, files)
    assert [o.name for o in scene.objects] == ["crate", "n"]
    with pytest.raises(SpecError) as refused:
        load_scene(tmp_path / "worlds" / "test.world", strict=True)
    assert [part for part in parts if part not in str(refused.value)] == []
    load(tmp_path, CRATE)
    load_scene(tmp_path / "worlds" / "test.world", strict=True)


@pytest.mark.parametrize("pose", ["1 1 -343582 0 0 0", "1e308 0 0 0 0 0", "0 0 -1e308 1 1 1"])
def test_what_lies_far_away_is_left_out(tmp_path: Path, pose: str) -> None:
    with told("models more than 100 km away, left out: 1 (fallen)"):
        scene = load(tmp_path, CRATE + model(CUBE, pose=pose, name="fallen"))
    assert only(scene).name == "crate"


def test_broken_files_are_left_out(tmp_path: Path) -> None:
    body = CRATE + model(visual(mesh("a.stl")), name="m")
    with told("meshes that cannot be read: 1 (", "a.stl: expected"):
        assert only(load(tmp_path, body, {"worlds/a.stl": "solid"})).name == "crate"

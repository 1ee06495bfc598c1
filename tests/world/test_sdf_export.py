"""A suburb written as a Gazebo world and read again is the same suburb."""

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import gazebo_files as gz
import pandas as pd
import pytest
from gazebo_files import write

from vrchain.errors import OutputError, SpecError
from vrchain.experiments.landmarks.pairs import draw_poses
from vrchain.panorama import CameraRig
from vrchain.paths import SCENES
from vrchain.seeding import generator
from vrchain.world import SceneSpec, build_scene, load_scene, load_spec
from vrchain.world.render import Renderer
from vrchain.world.sdf_export import export_world, world_files
from vrchain.world.spec import parse_spec

SMALL = {
    "name": "hamlet & co", "seed": 7, "extent_m": [80.0, 80.0], "season": "autumn", "twins": 0.5,
    "light": {"time": "evening"}, "houses": {"count": 3}, "shops": {"count": 0},
    "barns": {"count": 0}, "trees": {"count": 4}, "vehicles": {"count": 2},
    "boundaries": {"fences": 2, "walls": 2, "hedges": 2},
    "furniture": {"mailboxes": 2, "lamps": 2, "poles": 1, "signs": 2, "bins": 2, "hydrants": 1,
                  "bushes": 2},
}  # fmt: skip


@pytest.mark.parametrize(
    ("spec", "n_poses", "rig"),
    [
        (parse_spec(SMALL), 2, CameraRig(8, 320, 240)),
        pytest.param(load_spec(SCENES / "suburb.yaml"), 4, CameraRig(), marks=pytest.mark.slow),
    ],
)
@gz.UNWARNED
def test_there_and_back(tmp_path: Path, spec: SceneSpec, n_poses: int, rig: CameraRig) -> None:
    """The same table and, from some places, pictures of which 0.5 % of pixels may differ."""
    export_world(spec, tmp_path / "a.world")
    read, built = load_scene(tmp_path / "a.world"), build_scene(spec)
    pd.testing.assert_frame_equal(read.table, built.table, atol=1e-4)
    assert [o.solid for o in read.objects] == [o.solid for o in built.objects]
    assert (read.name, read.extent_m, read.light) == (built.name, built.extent_m, built.light)
    first, second = Renderer(built), Renderer(read)
    for pose in draw_poses(built, n_poses, generator(5)):
        views = first.render(pose, rig).views
        differ = (second.render(pose, rig).views != views).any(axis=-1).mean()
        print(f"at {pose}: {differ:.5f} of the pixels differ")
        assert differ <= 0.005


def test_it_is_plain_sdf_to_others() -> None:
    files = dict(world_files(parse_spec(SMALL), "a.world"))
    root = ElementTree.fromstring(files["a.world"])
    included = [uri.text or "" for uri in root.findall("world/include/uri")]
    for uri in included:
        folder = f"models/{uri.removeprefix('model://')}"
        model = ElementTree.fromstring(files[f"{folder}/model.sdf"])
        assert model.find("model/link/collision/geometry/mesh/uri") is not None
        assert f"{folder}/model.config" in files
    assert len(set(included)) < len(included)  # twins share a model's files
    others = {e.tag for e in root.iter() if e.tag.startswith("{")}
    assert others == {"{urn:vrchain:sdf}scene"}


def test_the_same_bytes_each_time() -> None:
    spec = parse_spec(SMALL)
    assert dict(world_files(spec, "a.world")) == dict(world_files(spec, "a.world"))


@pytest.mark.parametrize(
    ("spec", "file", "error", "words"),
    [
        (load_spec(SCENES / "barn.yaml"), "a.world", SpecError, "expected the layout 'suburb'"),
        (parse_spec(SMALL), "a.dae", OutputError, r"ends in \.world"),
        (parse_spec({**SMALL, "name": "a\x01b"}), "a.world", SpecError, r"got 'a\\x01b'"),
    ],
)
def test_what_cannot_be_written_is_refused(
    tmp_path: Path, spec: SceneSpec, file: str, error: type[Exception], words: str
) -> None:
    with pytest.raises(error, match=words):
        export_world(spec, tmp_path / file)
    assert list(tmp_path.iterdir()) == []


def test_a_scene_element_that_is_amiss_is_named(tmp_path: Path) -> None:
    spec = replace(parse_spec(SMALL), name="hamlet")
    export_world(spec, tmp_path / "a.world")
    text = (tmp_path / "a.world").read_text()
    for right, wrong, part in (
        ('season="autumn"', 'season="winter?"', "season"),
        ('seed="7"', 'seed=""', "seed"),
    ):
        (tmp_path / "b.world").write_text(text.replace(right, wrong))
        with pytest.raises(SpecError, match=rf"b\.world:5: <vrchain:scene>.*{part}"):
            load_scene(tmp_path / "b.world")


def test_worlds_in_one_folder_keep_their_models_apart(tmp_path: Path) -> None:
    spec = parse_spec(SMALL)
    export_world(spec, tmp_path / "a.world")
    first = {f: f.read_bytes() for f in (tmp_path / "models").rglob("*") if f.is_file()}
    export_world(replace(spec, seed=8), tmp_path / "b.world")
    export_world(replace(spec, name="hamlet _ co", seed=9), tmp_path / "c.world")
    assert {f: f.read_bytes() for f in first} == first


def edited(folder: Path, more: str) -> Path:
    """A suburb that was written, with more in it by hand."""
    export_world(parse_spec(SMALL), folder / "a.world")
    text = (folder / "a.world").read_text()
    (folder / "b.world").write_text(text.replace("</world>", f"{more}</world>"))
    return folder / "b.world"


def test_a_suburb_that_was_edited_is_read_as_other_worlds_are(tmp_path: Path) -> None:
    write(tmp_path, gz.folder_of("ground_plane", gz.GROUND_MODEL))
    crate = gz.model(gz.visual(gz.box("1 1 1")), name="k")
    more = gz.include("model://ground_plane") + crate * 2
    more += '<plugin name="p" filename="libwind.so"/><light name="lamp" type="point"/>'
    with gz.told("planes of ground", "ground_plane", "libwind.so", "(lamp)"):
        scene = load_scene(edited(tmp_path, more))
    assert {"k", "k_2"} <= {o.name for o in scene.objects}
    assert "ground_plane" not in {o.name for o in scene.objects}


@pytest.mark.parametrize("place", ["1e30 0 0", "1e7 0 0", "0 0 1e5"])
def test_what_is_far_away_is_left_out_of_a_suburb_too(tmp_path: Path, place: str) -> None:
    crate = gz.model(gz.visual(gz.box("1 1 1")), pose=f"{place} 0 0 0", name="far_crate")
    with gz.told("more than 100 km away, left out: 1 (far_crate)"):
        scene = load_scene(edited(tmp_path, crate))
    assert "far_crate" not in {thing.name for thing in scene.objects}

"""Worlds that are kept: the same scene, until anything of them changes; nothing damaged is used."""

import os
from pathlib import Path

import gazebo_files as gz
import pytest
from gazebo_files import CUBE, box, include, mesh, model, told, visual, world
from gazebo_files import no_folders as no_folders

from vrchain import files
from vrchain.errors import SpecError
from vrchain.world import Scene, load_scene
from vrchain.world.gazebo import cache
from vrchain.world.gazebo import world as worlds

MORE = include("model://m")


@pytest.fixture(autouse=True)
def built(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[Path]:
    """The worlds that are built; all of them are kept, in a folder of the test's own."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(cache, "LEAST_S", 0.0)
    found: list[Path] = []
    read = worlds.read_world
    monkeypatch.setattr(worlds, "read_world", lambda f, *rest: (found.append(f), read(f, *rest))[1])
    return found


def content(scene: Scene) -> list[object]:
    return [
        scene.table.to_csv(),
        [o.footprint.wkb for o in scene.objects],
        [[s.digest, s.shade.tobytes()] for o in scene.objects for s in o.surfaces],
        scene.ground_light.image.tobytes() if scene.ground_light else b"",
    ]


def written(folder: Path) -> Path:
    """A world of a model with a mesh and a picture, which lacks another model."""
    body = gz.GROUND_MODEL + include("model://m") + include("model://gone")
    parts = visual(mesh("a.dae")) + CUBE
    files: gz.Files = {
        "t.world": world(body),
        "models/m/a.dae": gz.dae(picture="p.png"),
        "models/m/p.png": gz.png((1, 2, 3)),
        **gz.folder_of("m", model(parts)),
    }
    return gz.write(folder, files) / "t.world"


def load(path: Path) -> list[object]:
    with told("models that are missing: 1 (model://gone)"):
        return content(load_scene(path))


def test_a_kept_world_is_the_same_and_told_the_same(tmp_path: Path, built: list[Path]) -> None:
    path = written(tmp_path)
    assert load(path) == load(path) and len(built) == 1
    with pytest.raises(SpecError, match="models that are missing"):
        load_scene(path, strict=True)
    assert len(built) == 1


@pytest.mark.parametrize(
    ("name", "data"),
    [
        ("t.world", world(CUBE).encode()),
        ("models/m/model.sdf", b'<sdf version="1.6"><model name="m"/></sdf>'),
        ("models/m/a.dae", gz.dae(meter=2.0).encode()),
        ("models/m/p.png", gz.png((9, 9, 9))),
        ("models/gone/model.sdf", gz.folder_of("gone", model(CUBE))["models/gone/model.sdf"]),
        ("models/m/materials/scripts/a.material", b"material A { }"),
    ],
)
def test_a_world_is_built_again_when_a_file_of_it_changes(
    tmp_path: Path, built: list[Path], name: str, data: bytes | str
) -> None:
    path = written(tmp_path)
    script = "<material><script><name>A</name></script></material>"
    gz.write(
        tmp_path,
        gz.folder_of("m", model(visual(mesh("a.dae")) + visual(box("1 1 1"), material=script))),
    )
    load(path)
    gz.write(tmp_path, {name: data})
    if name == "t.world":
        with pytest.raises(SpecError):
            load_scene(path)
    elif "gone" in name:
        with told("materials that are missing"):
            load_scene(path)
    else:
        load(path)
    assert len(built) == 2


def test_a_world_is_built_again_when_a_link_leads_elsewhere(
    tmp_path: Path, built: list[Path]
) -> None:
    """A model that leads out of the folders is not found."""
    path = written(tmp_path / "w")
    (tmp_path / "w/models/m").rename(tmp_path / "out")
    (tmp_path / "w/models/m").symlink_to(tmp_path / "out")
    with told("models that are missing", "model://m"):
        load_scene(path)
    (tmp_path / "w/models/m").unlink()
    (tmp_path / "out").rename(tmp_path / "w/models/m")
    load(path)
    assert len(built) == 2


def test_a_world_is_built_again_when_its_pictures_come_to_lie_in_the_folders(
    tmp_path: Path, built: list[Path]
) -> None:
    albedo = "<material><pbr><metal><albedo_map>a.png</albedo_map></metal></pbr></material>"
    gz.write(tmp_path, {
        "w/t.world": world(include("model://m")), "out/a.png": gz.png((9, 200, 9)),
        **{f"w/{k}": v for k, v in gz.folder_of(
            "m", model(visual(box("1 1 1"), material=albedo))).items()},
    })  # fmt: skip
    textures = tmp_path / "w/models/m/materials/textures"
    textures.parent.mkdir()
    textures.symlink_to(tmp_path / "out")
    with told("pictures that are missing: 1 (a.png)"):
        load_scene(tmp_path / "w/t.world")
    textures.unlink()
    (tmp_path / "out").rename(textures)
    (thing,) = load_scene(tmp_path / "w/t.world").objects
    assert thing.surfaces[0].texture[0, 0].tolist() == [9, 200, 9] and len(built) == 2


def test_what_is_included_often_is_looked_at_once(tmp_path: Path, built: list[Path]) -> None:
    path = written(tmp_path)
    gz.write(tmp_path, {"t.world": path.read_text().replace("</world>", 9 * MORE + "</world>")})
    load(path)
    (kept,) = cache.folder().iterdir()
    looked = kept.read_bytes().splitlines()[1]
    assert looked.count(b"models/m/model.config") < 9


def test_other_libraries_build_it_again(
    tmp_path: Path, built: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(tmp_path)
    load(path)
    newest = files.version
    older = {"shapely": "1.0"}
    monkeypatch.setattr(files, "version", lambda name: older.get(name) or newest(name))
    files._digest_of.cache_clear()
    load(path)
    files._digest_of.cache_clear()
    assert len(built) == 2


def test_other_folders_are_another_world(
    tmp_path: Path, built: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(tmp_path)
    load(path)
    monkeypatch.setenv("GAZEBO_MODEL_PATH", str(tmp_path / "others"))
    load(path)
    assert len(built) == 2


@pytest.mark.parametrize("damage", ["cut", "turned", "empty", "garbage", "folder"])
def test_what_is_damaged_is_built_again(tmp_path: Path, built: list[Path], damage: str) -> None:
    path = written(tmp_path)
    first = load(path)
    (kept,) = cache.folder().iterdir()
    data = kept.read_bytes()
    kept.unlink()
    if damage == "folder":
        kept.mkdir()
    else:
        middle = len(data) // 2
        turned = data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :]
        kept.write_bytes(
            {"cut": data[:-9], "turned": turned, "empty": b"", "garbage": b"\x80x\n" * 99}[damage]
        )
    assert load(path) == first and len(built) == 2


def test_a_folder_that_cannot_be_written_keeps_nothing(
    tmp_path: Path, built: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    path = written(tmp_path)
    assert load(path) == load(path) and len(built) == 2


def test_what_is_kept_has_a_limit(
    tmp_path: Path, built: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(tmp_path)
    load(path)
    (kept,) = cache.folder().iterdir()
    monkeypatch.setattr(cache, "MOST_BYTES", int(2.5 * kept.stat().st_size))
    os.utime(kept, (0, 0))
    for name in ("b.world", "c.world"):
        gz.write(tmp_path, {name: path.read_text()})
        load(tmp_path / name)
    left = list(cache.folder().iterdir())
    assert len(left) == 2 and kept not in left


def test_what_is_built_soon_is_not_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cache, "LEAST_S", 1e9)
    load(written(tmp_path))
    assert not cache.folder().exists()

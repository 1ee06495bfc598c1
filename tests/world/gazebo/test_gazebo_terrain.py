"""Heightmaps: hills are drawn, robots drive level, and what stands on them stands at 0."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from gazebo_files import box, load, model, no_folders, png, told, visual

from vrchain.errors import SpecError
from vrchain.world import SceneObject
from vrchain.world.gazebo.kinds import guess

__all__ = ["no_folders"]

NORTH_HIGH = np.array([[255, 255, 255], [102, 102, 102], [0, 0, 0]], np.uint8)


def greys(image: np.ndarray) -> bytes:
    return cv2.imencode(".png", image)[1].tobytes()


def heightmap(size: str, pos: str = "0 0 0", more: str = "") -> str:
    return f"<heightmap><uri>hills.png</uri><size>{size}</size><pos>{pos}</pos>{more}</heightmap>"


def layer(picture: str, above_m: float | None = None) -> str:
    blend = "" if above_m is None else f"<blend><min_height>{above_m}</min_height></blend>"
    return f"<texture><diffuse>{picture}</diffuse><size>10</size></texture>{blend}"


def points_of(thing: SceneObject) -> np.ndarray:
    return np.concatenate([s.vertices_m[s.faces].reshape(-1, 3) for s in thing.surfaces])


def test_hills_are_as_high_as_their_picture_is_white(tmp_path: Path) -> None:
    ground = model(visual(heightmap("100 80 10", "5 0 -2")), pose="0 0 3 0 0 0", name="hills")
    stone = model(visual(box("1 1 1")), pose="0 0 0.5 0 0 0", name="stone")
    with told("heightmaps, through which robots drive level: 1 (hills.png)"):
        scene = load(tmp_path, ground + stone, {"worlds/hills.png": greys(NORTH_HIGH)})
    hills, _ = scene.objects
    assert (hills.kind, hills.landmark, hills.solid) == ("ground", False, False)
    points = points_of(hills)
    for y_m, z_m in ((40, 8.0), (0, 2.0), (-40, -2.0)):  # its own <pose> counts for nothing
        assert points[np.abs(points[:, 1] - y_m) < 1, 2] == pytest.approx(z_m, abs=1e-4)
    assert (points[:, 0].min(), points[:, 0].max()) == (-45, 55)
    assert max(scene.extent_m) < 10  # of what stands there


def test_each_height_has_the_texture_of_its_layer(tmp_path: Path) -> None:
    more = layer("red.png", 5.0) + layer("green.png")
    files = {"red.png": png((200, 0, 0)), "green.png": png((0, 200, 0))}
    files["hills.png"] = greys(np.repeat(np.repeat(NORTH_HIGH[[0, 2]], 4, axis=0), 3, axis=1))
    with told("heightmaps"):
        scene = load(
            tmp_path,
            model(visual(heightmap("50 50 8", more=more)), name="hills"),
            {f"worlds/{name}": data for name, data in files.items()},
        )
    (hills,) = scene.objects
    north_m = {tuple(s.texture[0, 0]): s.vertices_m[s.faces][..., 1] for s in hills.surfaces}
    low, high = north_m.pop((200, 0, 0)), north_m.pop((0, 200, 0))
    assert not north_m and low.min() == -25 and high.max() == 25
    assert low.max() < 5 and high.min() > -5  # they meet on the slope in the middle


def test_what_stands_on_a_plateau_stands_where_robots_drive(tmp_path: Path) -> None:
    plateau = np.full((5, 5), 51, np.uint8)
    things = model(visual(heightmap("60 60 25")), name="hills")
    for k in range(3):
        things += model(visual(box("2 2 3")), pose=f"{9 * k} 0 6.5 0 0 0", name=f"box_{k}")
    things += model(visual(box("2 2 3")), pose="0 9 1.5 0 0 0", name="cellar")
    with told("landmarks that stand at 5 m, where a heightmap is: all is lowered"):
        scene = load(tmp_path, things, {"worlds/hills.png": greys(plateau)})
    feet = {o.name: float(points_of(o)[:, 2].min()) for o in scene.objects}
    assert feet == pytest.approx({"hills": 0, "box_0": 0, "box_1": 0, "box_2": 0, "cellar": -5})


@pytest.mark.parametrize(
    ("files", "words"),
    [
        ({}, ["heightmaps: 1 (hills.png)", "pictures that are missing: 1 (hills.png)"]),
        ({"worlds/hills.png": b"no picture"}, ["heightmaps: 1 (hills.png)"]),
    ],
    ids=["missing", "of something else"],
)
def test_a_heightmap_that_cannot_be_read_is_left_out(
    files: dict[str, bytes], words: list[str], tmp_path: Path
) -> None:
    body = model(visual(heightmap("60 60 25")), name="hills") + model(visual(box("1 1 1")))
    with told(*words):
        scene = load(tmp_path, body, files)
    assert [o.name for o in scene.objects] == ["thing"]


@pytest.mark.parametrize(
    ("geometry", "side_px", "words"),
    [
        (heightmap("60 0 25"), 3, "sizes above 0"),
        (heightmap("60 60 25", more=layer("").replace("10", "0")), 3, "sizes above 0"),
        (heightmap("60 60 25"), 1, "2 x 2 pixels"),
    ],
)
def test_a_heightmap_of_no_size_is_refused(
    geometry: str, side_px: int, words: str, tmp_path: Path
) -> None:
    files = {"worlds/hills.png": greys(np.full((side_px, side_px), 9, np.uint8))}
    with pytest.raises(SpecError, match=words):
        load(tmp_path, model(visual(geometry)), files)


def test_water_is_ground_and_no_picture_of_how_light_is_bent_is_drawn(tmp_path: Path) -> None:
    script = (
        "material Waves { technique { pass { texture_unit { texture waves_normals.png }"
        " texture_unit { texture sea.png } } } }"
    )
    material = "<material><script><uri>sea.material</uri><name>Waves</name></script></material>"
    files = {
        "sea.material": script,
        "sea.png": png((0, 0, 200)),
        "waves_normals.png": png((9,) * 3),
    }
    scene = load(
        tmp_path,
        model(visual(box("300 300 4"), material=material), pose="0 0 -3 0 0 0", name="ocean"),
        {f"worlds/{name}": data for name, data in files.items()},
    )
    (sea,) = scene.objects
    assert (sea.kind, sea.landmark) == ("ground", False)
    assert (sea.surfaces[0].texture == (0, 0, 200)).all()
    assert guess("water_tank", (4.0, 4.0, 6.0), leafy=False) != "ground"

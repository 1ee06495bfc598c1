"""A world of public Gazebo models, as published; skipped where it is not at hand."""

import os
import time
import warnings
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from worlds import ROOT

from vrchain.experiments.landmarks.pairs import draw_poses
from vrchain.seeding import generator
from vrchain.world import Scene, load_scene
from vrchain.world.render import Renderer
from vrchain.world.truth import GroundTruth

SAMPLES = Path(os.environ.get("VRCHAIN_GAZEBO", ROOT.parent / "shared" / "gazebo"))
WORLD = SAMPLES / "worlds" / "suburb.world"
pytestmark = pytest.mark.skipif(
    not WORLD.is_file(),
    reason=f"the sample of public Gazebo models is not at {SAMPLES}: name it in VRCHAIN_GAZEBO",
)
SIZES_M = {
    "house_1": (16.49, 12.93, 7.69),
    "house_2": (12.71, 9.77, 7.23),
    "suv": (5.02, 2.60, 2.16),
    "gas_station": (20.57, 29.99, 8.98),
    "grocery_store": (32.91, 21.99, 10.35),
    "pine_tree": (3.17, 3.17, 5.08),
    "stop_sign": (0.59, 0.02, 1.82),
}
COUNTS = {
    "house_1": 10, "house_2": 12, "pine_tree": 30, "suv": 8, "hatchback": 4, "hatchback_red": 6,
    "grocery_store": 1, "gas_station": 1, "law_office": 1, "police_station": 1, "post_office": 1,
    "mailbox": 3, "fire_hydrant": 3, "telephone_pole": 3, "construction_cone": 3, "stop_sign": 2,
    "lamp_post": 1, "ground": 1,
}  # fmt: skip
KINDS = {
    "house_1": "house", "pine_tree": "tree", "suv": "vehicle", "grocery_store": "shop",
    "police_station": "building", "stop_sign": "sign", "lamp_post": "lamp", "ground": "ground",
}  # fmt: skip


@pytest.fixture(scope="module")
def scene() -> Scene:
    """Its models are found beside the world's folder, without a variable set."""
    start_s = time.process_time()  # of all threads, whatever else this machine does
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        loaded = load_scene(WORLD)
    seconds = time.process_time() - start_s
    print(f"loaded in {seconds:.1f} s of CPU time")
    assert seconds < 15
    return loaded


def test_every_model_is_there_and_twins_are_marked(scene: Scene) -> None:
    assert Counter(o.model for o in scene.objects) == COUNTS
    kinds = {o.model: o.kind for o in scene.objects}
    assert {model: kinds[model] for model in KINDS} == KINDS
    assert [o.name for o in scene.objects if not o.landmark] == ["ground"]


def test_sizes_to_the_centimetre(scene: Scene) -> None:
    for thing in scene.objects:
        if thing.model in SIZES_M:
            assert np.allclose(thing.size_m, SIZES_M[thing.model], atol=0.01), thing.name


def test_all_stand_on_the_ground(scene: Scene) -> None:
    lowest = [o.bounds_m[0, 2] for o in scene.objects]
    assert np.abs(lowest).max() < 0.12
    assert max(scene.extent_m) < 190


def test_trees_are_cut_out_and_houses_have_pictures(scene: Scene) -> None:
    tree = next(o for o in scene.objects if o.model == "pine_tree")
    assert sorted(s.cut_out for s in tree.surfaces) == [False, True]
    for thing in scene.objects:
        if thing.kind in ("house", "shop", "building", "vehicle"):
            assert max(s.texture[..., :3].std() for s in thing.surfaces) > 10, thing.name


def test_ids_of_ray_caster_and_renderer_agree(scene: Scene) -> None:
    renderer, truth = Renderer(scene), GroundTruth(scene)
    for pose in draw_poses(scene, 3, generator(3000)):
        same = (renderer.segmentation(pose) == truth.look(pose)[0]).mean()
        print(f"at {pose}: {same:.5f}")
        assert same >= 0.995


def test_the_pioneer(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("GAZEBO_MODEL_PATH", str(SAMPLES / "models"))
    body = "<include><uri>model://pioneer3at</uri></include>"
    (tmp_path / "a.sdf").write_text(f'<sdf version="1.6"><world name="w">{body}</world></sdf>')
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        (robot,) = load_scene(tmp_path / "a.sdf").objects
    assert np.allclose(robot.size_m, (0.51, 0.50, 0.27), atol=0.01)
    assert (robot.kind, robot.landmark) == ("robot", False)
    assert robot.bounds_m[0, 2] == pytest.approx(0.01, abs=0.01)  # its model's own pose lifts it

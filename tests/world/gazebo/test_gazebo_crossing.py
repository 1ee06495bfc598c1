"""The small world of our own making in ``scenes/``: a bit of all that Gazebo's models do."""

import json
import warnings
from collections import Counter

import pytest
import worlds

from vrchain.paths import SCENES
from vrchain.world import Scene, load_scene

CROSSING = SCENES / "crossing" / "crossing.world"


@pytest.fixture(scope="module")
def scene() -> Scene:
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # nothing in it is unsupported
        return load_scene(CROSSING)


def test_its_objects(scene: Scene) -> None:
    models = Counter((o.kind, o.model) for o in scene.objects)
    assert models == {
        ("ground", "meadow"): 1, ("ground", "lane"): 2, ("house", "cottage"): 3,
        ("house", "villa"): 2, ("shop", "store"): 1, ("shop", "kiosk"): 1, ("sign", "signpost"): 1,
        ("vehicle", "car"): 3, ("tree", "maple"): 9,
    }  # fmt: skip
    assert {o.kind for o in scene.objects if not o.landmark} == {"ground"}


def test_the_seed_changes_nothing() -> None:
    assert load_scene(CROSSING, seed=3).table.equals(load_scene(CROSSING, seed=4).table)


def test_the_same_bytes_in_two_processes() -> None:
    code = (
        "import json; from test_suburb import digest; from vrchain.world import load_scene;"
        f"print(json.dumps(digest(load_scene({str(CROSSING)!r}))))"
    )
    path = f"import sys; sys.path.insert(0, {json.dumps(str(worlds.ROOT / 'tests' / 'world'))});"
    first, second = worlds.in_two_processes(path + code)
    assert first == second

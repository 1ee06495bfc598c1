"""Small cases of what real worlds have and what is right there; skipped where not at hand."""

import warnings
from pathlib import Path

import numpy as np
import pytest
from gazebo_files import no_folders as no_folders
from worlds import ROOT

from vrchain.errors import UnsupportedWarning
from vrchain.world import load_scene

CASES = ROOT.parent / "shared" / "cases" / "gazebo"
pytestmark = pytest.mark.skipif(
    not CASES.is_dir(), reason=f"the cases of Gazebo worlds are not at {CASES}"
)
BLOCK = {"b": ((4, 0, 0.5), (1, 1, 1))}
CORNER = {"m": ((0.5, 0.5, 0.5), (1, 1, 1))}


@pytest.mark.parametrize(
    ("case", "things", "told"),
    [
        ("03_lenient_xml_ampersand", {"m": ((0, 0, 0.5), (1, 1, 1))}, ""),
        ("03_lenient_xml_comment", BLOCK, ""),
        ("03_lenient_xml_declaration", BLOCK, ""),
        ("04_fuel_uri", BLOCK, "models that are missing: 1 (https://fuel"),
        ("05_picture_leads_out", CORNER, "pictures that are missing: 1 (../../../../photos/p.png)"),
        ("06_file_uri_from_root/worlds", CORNER, ""),
        ("07_missing_mesh", BLOCK, "meshes that are missing: 1 (model://x/meshes/none.dae)"),
        ("07_one_missing_stops_all", BLOCK, "2 (model://no_such_tree, model://no_such_bench)"),
        ("08_polyline", {"tower": ((0, 0, 6), (10, 8, 12)), "b": ((9, 0, 0.5), (1, 1, 1))}, ""),
        ("10_far_pose", BLOCK, "left out: 1 (fallen)"),
        ("11_merge", {"assembly": ((4, 3, 1.5), (1, 1, 3))}, ""),
        ("12_placement_frame", {"p": ((3, 0, 1), (1, 1, 2))}, ""),
        ("14_default_box", {"s": ((0, 0, 0.5), (1, 1, 1))}, ""),
        ("14_default_sphere", {"s": ((0, 0, 1), (2, 2, 2))}, ""),
        ("15_percent_uri", CORNER, ""),
        ("16_glb", BLOCK, "meshes that cannot be read: 1 ("),
    ],
)
def test_cases(
    monkeypatch: pytest.MonkeyPatch,
    case: str,
    things: dict[str, tuple[tuple[float, ...], tuple[float, ...]]],
    told: str,
) -> None:
    folder: Path = CASES / case
    monkeypatch.setenv("GAZEBO_MODEL_PATH", str(CASES / Path(case).parts[0] / "models"))
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        scene = load_scene(folder / "w.sdf")
    lines = [str(w.message) for w in caught if w.category is UnsupportedWarning]
    assert len(lines) == bool(told) and told in "".join(lines)
    assert {o.name for o in scene.objects} == {*things, "ground_plane"}
    for name, (centre, size) in things.items():
        thing = scene.objects[scene.index_of(name)]
        assert np.allclose(thing.bounds_m.mean(axis=0), centre, atol=1e-3)
        assert np.allclose(thing.size_m, size, atol=1e-3)

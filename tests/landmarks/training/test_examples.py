from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from vrchain.errors import LearnedError
from vrchain.geometry import Pose
from vrchain.landmarks.extraction.raster import cell_bearings_rad, cell_slopes
from vrchain.landmarks.training.examples import (
    ExampleConfig,
    config_digest,
    make_examples,
    read_examples,
    varied_spec,
    varied_suburb,
)
from vrchain.panorama import CameraRig
from vrchain.world.truth import GroundTruth

ONE = ExampleConfig(seed=5, suburbs=1, groups=1, panoramas=2)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    (file,) = make_examples(ONE, tmp_path_factory.mktemp("examples"))
    return file


def test_examples_say_what_the_ray_caster_sees(made: Path) -> None:
    found = read_examples(made)
    scene = varied_suburb(ONE.seed, 0)
    truth, rig = GroundTruth(scene), CameraRig()
    assert list(found.kinds) == [o.kind for o in scene.objects]
    bearing, slope = np.broadcast_arrays(cell_bearings_rad(rig)[None, :], cell_slopes()[:, None])
    pose = Pose(*map(float, found.poses[0]))
    ids, points_m = truth.look_along(pose, bearing, slope, rig)
    range_m = np.linalg.norm(points_m[..., :2] - pose.xy_m, axis=-1)
    np.testing.assert_allclose(found.range_m[0], np.nan_to_num(range_m), rtol=1e-3)
    shown = found.cells[0] >= 0
    assert shown.any() and (found.cells[0][shown] == ids[shown]).all()
    assert all(scene.objects[i].landmark for i in np.unique(found.cells[0][shown]))
    seen = truth.visibility(pose, rig)
    large = seen.index[seen.visible & (seen.area_deg2 > 4) & (seen.azimuth_deg > 3)]
    large = {i for i in large if scene.objects[i].landmark}
    assert large <= set(np.unique(found.cells[0]))


def test_a_second_run_keeps_what_is_there(made: Path) -> None:
    before = made.stat().st_mtime_ns
    assert make_examples(ONE, made.parent.parent) == [made]
    assert made.stat().st_mtime_ns == before


def test_more_suburbs_of_the_same_examples_go_to_the_same_place() -> None:
    assert config_digest(ONE) == config_digest(replace(ONE, suburbs=50))
    assert config_digest(ONE) != config_digest(replace(ONE, seed=6))


def test_suburbs_differ_and_come_back() -> None:
    specs = [varied_spec(0, k) for k in range(40)]
    assert [varied_spec(0, k) for k in range(40)] == specs
    assert len({s.seed for s in specs}) == 40
    assert {s.light.time for s in specs} == {"noon", "evening", "overcast"}
    assert len({s.season for s in specs}) == 4
    assert 5 < sum(s.twins > 0 for s in specs) < 35


@pytest.mark.parametrize("seed", [-1, 1000, 10_000])
def test_only_training_seeds_are_learned_from(tmp_path: Path, seed: int) -> None:
    with pytest.raises(LearnedError, match=r"0\.\.999"):
        make_examples(replace(ONE, seed=seed), tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04 nothing", b"x" * 1000])
def test_a_damaged_file_is_named(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "suburb_0000.npz").write_bytes(content)
    with pytest.raises(LearnedError, match=r"suburb_0000\.npz holds no examples"):
        read_examples(tmp_path / "suburb_0000.npz")

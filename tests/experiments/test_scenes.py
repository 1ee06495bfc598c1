from pathlib import Path

import numpy as np
import pytest
from suburbs import SMALL

from vrchain.errors import VRChainError
from vrchain.experiments.scenes import scenes_of, spec_of, suburbs
from vrchain.paths import SCENES
from vrchain.world.spec import SceneSpec, parse_spec


def test_suburbs_of_a_seed_are_their_own_and_the_same_again() -> None:
    seeds = {spec_of(SceneSpec(), seed, k).seed for seed in (3000, 3001) for k in range(20)}
    assert len(seeds) == 40
    assert spec_of(SceneSpec(), 3000, 7) == spec_of(SceneSpec(), 3000, 7)


def test_a_gazebo_world_stays_as_it_is() -> None:
    found = scenes_of(SCENES / "crossing" / "crossing.world")
    assert not found.varied and found.scene(1, 0) is found.scene(2, 5)
    assert found.digest != suburbs(SceneSpec()).digest


def test_a_world_is_told_apart_by_its_models(tmp_path: Path) -> None:
    """What was measured in it before one of them changed is not read again."""
    world = (
        '<sdf version="1.6"><world name="w"><model name="m"><static>1</static><link name="l">'
        '<visual name="v"><geometry><mesh><uri>wall.obj</uri></mesh></geometry></visual>'
        "</link></model></world></sdf>"
    )
    (tmp_path / "w.world").write_text(world)
    digests = []
    for height_m in (2, 2, 3):
        (tmp_path / "wall.obj").write_text(f"v 0 0 0\nv 4 0 0\nv 0 0 {height_m}\nf 1 2 3\n")
        digests.append(scenes_of(tmp_path / "w.world").digest)
    assert digests[0] == digests[1] != digests[2]


def test_digests_tell_specs_apart() -> None:
    assert suburbs(SceneSpec()).digest == suburbs(SceneSpec()).digest
    assert suburbs(SceneSpec()).digest != suburbs(SceneSpec(twins=0.7)).digest


@pytest.mark.parametrize("name", ["none.yaml", "none.world"])
def test_a_file_that_is_not_there(tmp_path: Path, name: str) -> None:
    with pytest.raises(VRChainError, match=name):
        scenes_of(tmp_path / name).scene(0, 0)


def test_another_season_and_light_leave_all_where_it_is() -> None:
    """What has leaves, and all that the light is baked into, looks different."""
    summer = suburbs(parse_spec(SMALL))
    assert summer.at(None, None) is summer
    winter, evening = summer.at("winter", None), summer.at(None, "evening")
    assert len({summer.digest, winter.digest, evening.digest}) == 3
    now, *then = (found.scene(3, 1) for found in (summer, winter, evening))
    for scene in then:
        assert [o.name for o in scene.objects] == [o.name for o in now.objects]
        bounds_m = [np.array([o.bounds_m for o in s.objects]) for s in (now, scene)]
        np.testing.assert_array_equal(*bounds_m)
        same = [[f.digest for f in o.surfaces] for o in now.objects]
        assert same != [[f.digest for f in o.surfaces] for o in scene.objects]

"""The paper's example: who sees what is given, whatever the seed, the light and the season."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
import shapely
import worlds
from scipy import ndimage

from vrchain.errors import SpecError
from vrchain.geometry import Pose
from vrchain.landmarks.quality import co_visible
from vrchain.panorama import CameraRig
from vrchain.paths import SCENES
from vrchain.world import Scene, SceneSpec, build_scene, load_scene, load_spec
from vrchain.world.spec import parse_spec
from vrchain.world.suburb.barnyard import GOAL, START_SPREAD_M
from vrchain.world.truth import GroundTruth

BARN = SCENES / "barn.yaml"
RIG = CameraRig()
FEW, MANY = range(3), range(3, 20)
GROUND = {"lane", "yard", "field", "grass", "backdrop"}


def spec_of(seed: int) -> SceneSpec:
    """Every seed its own light, now and then another time of day and season."""
    document = {
        "layout": "barn",
        "seed": 10_000 + seed,
        "season": ("summer", "autumn", "winter", "spring")[seed % 4],
        "light": {"time": ("noon", "evening", "overcast")[seed % 3]},
    }
    return parse_spec(document)


@cache
def scene_of(seed: int) -> Scene:
    return build_scene(spec_of(seed))


def seen_by(truth: GroundTruth, pose: Pose) -> tuple[set[str], set[str]]:
    """Landmarks with any pixel in view, and those visible."""
    table = truth.visibility(pose, RIG)
    names = {i: truth.scene.objects[i].name for i in table.index if truth.scene.objects[i].landmark}
    return set(names.values()), {n for i, n in names.items() if table.visible[i]}


@pytest.mark.parametrize("seed", [*FEW, *(pytest.param(s, marks=pytest.mark.slow) for s in MANY)])
def test_the_robots_see_what_the_example_says(seed: int) -> None:
    scene = scene_of(seed)
    truth, robots = GroundTruth(scene), dict(scene.robots)
    assert list(robots) == ["R1", "R2", "R3"]
    common = {
        pair: [scene.objects[i].name for i in co_visible(truth, *map(robots.get, pair), RIG)]
        for pair in (("R1", "R2"), ("R2", "R3"), ("R1", "R3"))
    }
    assert common == {("R1", "R2"): ["shed"], ("R2", "R3"): ["water_tower"], ("R1", "R3"): []}
    any_of, visible = {}, {}
    for name, pose in robots.items():
        any_of[name], visible[name] = seen_by(truth, pose)
    assert any_of["R1"].isdisjoint(any_of["R3"])  # not one pixel of one thing
    walls = {o.name for o in scene.objects if o.kind == "wall"}
    assert (any_of["R1"] & any_of["R2"]) <= walls | {"shed"}
    assert (any_of["R2"] & any_of["R3"]) <= walls | {"water_tower"}
    assert GOAL in visible["R3"]
    goal = scene.index_of(GOAL)
    for name in ("R1", "R2"):
        object_id, _ = truth.look(robots[name], RIG)
        assert not (object_id == goal).any()
    assert all(len(v) >= 8 for v in visible.values())


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(s, marks=pytest.mark.slow) for s in range(1, 20))]
)
def test_the_chain_can_be_driven(seed: int) -> None:
    """A robot gets near each landmark, and sees the next one from everywhere near it it can get."""
    scene = scene_of(seed)
    truth, robots = GroundTruth(scene), dict(scene.robots)
    reachable = way_from(scene, robots["R1"])
    for landmark, following in (("shed", "water_tower"), ("water_tower", GOAL)):
        footprint = scene.objects[scene.index_of(landmark)].footprint
        near = [xy for xy in reachable if 1.0 < footprint.distance(shapely.Point(xy)) < 5.0]
        target = scene.index_of(following)
        sees = [
            target in (t := truth.visibility(Pose(*xy), RIG)).index and t.visible[target]
            for xy in near[:: max(1, len(near) // 8)]
        ]
        assert np.mean(sees) > 0.3
    goal = scene.objects[scene.index_of(GOAL)].footprint
    assert min(goal.distance(shapely.Point(xy)) for xy in reachable) < 2.0


def way_from(scene: Scene, start: Pose, step_m: float = 0.5) -> list[tuple[float, float]]:
    """Places, on a grid, that a robot can drive to with 1 m of room on either side."""
    axes = [np.arange(-e / 2 + 1, e / 2, step_m) for e in scene.extent_m]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    free = scene.is_free(grid.reshape(-1, 2), 1.0).reshape(grid.shape[:2])
    parts, _ = ndimage.label(free)
    nearest = np.argmin(np.linalg.norm(grid.reshape(-1, 2) - start.xy_m, axis=1))
    own = parts.ravel()[nearest]
    assert own > 0
    return [tuple(map(float, xy)) for xy in grid[parts == own]]


def test_the_robots_stand_free_on_the_map_some_way_apart() -> None:
    for seed in FEW:
        scene = scene_of(seed)
        poses = [pose for _, pose in scene.robots]
        for pose in poses:
            scene.check_pose(pose)
        assert scene.clearance_m([p.xy_m for p in poses]).min() > 1.0
        for a, b in pairwise(poses):
            assert 13 < a.distance_to_m(b.xy_m) < 30
        assert scene.goal == GOAL


def test_seeds_vary_headings_light_designs_and_where_r1_starts() -> None:
    scenes = [scene_of(seed) for seed in FEW]
    starts = np.array([dict(s.robots)["R1"].xy_m for s in scenes])
    assert np.ptp(starts, axis=0).max() > 0.3
    assert np.linalg.norm(starts - starts[0], axis=1).max() <= 2 * START_SPREAD_M
    for name in ("R1", "R2", "R3"):
        assert len({dict(s.robots)[name].yaw_rad for s in scenes}) == len(scenes)
    for name in ("R2", "R3"):
        assert len({tuple(dict(s.robots)[name].xy_m) for s in scenes}) == 1
    assert len({s.light.sun_azimuth_deg for s in scenes}) == len(scenes)
    pictures = [
        {x.texture.tobytes() for o in s.objects if o.landmark for x in o.surfaces} for s in scenes
    ]
    assert pictures[0].isdisjoint(pictures[1])


def test_what_stands_is_a_landmark_on_the_ground_and_in_nothing_s_way() -> None:
    for seed in FEW:
        scene = scene_of(seed)
        standing = [o for o in scene.objects if o.kind not in GROUND]
        assert all(o.landmark == o.solid == (o in standing) for o in scene.objects)
        assert scene.table.name.is_unique
        for thing in standing:
            assert abs(thing.bounds_m[0, 2]) < 0.06, thing.name
            if thing.kind in ("wall", "fence"):
                assert max(thing.size_m[:2]) <= 8.0
        others = [o for o in standing if o.kind != "wall"]
        for i, thing in enumerate(others):
            for other in others[i + 1 :]:
                apart = thing.footprint.distance(other.footprint)
                assert apart > 0.8 or {thing.kind, other.kind} == {"fence"}, (
                    thing.name,
                    other.name,
                )


def test_the_ground_is_covered_once() -> None:
    area = 0.0
    scene = scene_of(0)
    for thing in scene.objects:
        if thing.kind in GROUND - {"backdrop"}:
            for s in thing.surfaces:
                corners = s.vertices_m[s.faces][:, :, :2].astype(float)
                area += float(shapely.area(shapely.polygons(corners)).sum())
    width_m, height_m = (e + 200.0 for e in scene.extent_m)
    assert area == pytest.approx(width_m * height_m, rel=1e-4)


def test_one_seed_gives_the_same_bytes_in_two_processes() -> None:
    code = (
        "import sys, json; sys.path.insert(0, 'tests/world');"
        "from test_suburb import digest; from vrchain.world import load_scene;"
        f"s = load_scene({str(BARN)!r}); print(json.dumps([digest(s), repr(s.robots)]))"
    )
    first, second = worlds.in_two_processes(code)
    assert first == second


def test_the_file_of_the_scenes_folder_is_the_example() -> None:
    scene = load_scene(BARN)
    assert (scene.name, scene.goal, load_spec(BARN).layout) == ("barn", GOAL, "barn")
    assert len(load_scene(BARN, seed=5).robots) == 3


@pytest.mark.parametrize("key", ["houses", "streets", "extent_m", "trees"])
def test_a_suburb_s_numbers_are_refused(key: str) -> None:
    value = [90, 90] if key == "extent_m" else {}
    with pytest.raises(SpecError, match=rf"{key}: the layout 'barn' has a plan of its own"):
        parse_spec({"layout": "barn", key: value})


def test_an_unknown_layout_is_named_with_those_there_are() -> None:
    with pytest.raises(SpecError, match="layout: expected one of suburb, barn, got 'castle'"):
        parse_spec({"layout": "castle"})

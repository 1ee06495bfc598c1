"""Long walls of a Gazebo world, in runs that are landmarks."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from gazebo_files import UNWARNED, load, mesh, model, visual
from gazebo_files import no_folders as no_folders
from numpy.typing import NDArray
from test_gazebo_obstacles import boxes

from vrchain.world import Scene, SceneObject
from vrchain.world.runs import RUN_M, _cut

WALLS = boxes(  # of a house of 20 x 10 m, with a door of 2 m
    ((-10, -5, 0), (10, -4.8, 2.5)),
    ((-10, 4.8, 0), (10, 5, 2.5)),
    ((-10, -5, 0), (-9.8, 5, 2.5)),
    ((9.8, -5, 0), (10, -1, 2.5)),
    ((9.8, 1, 0), (10, 5, 2.5)),
)


def house(folder: Path, name: str, pose: str = "1 2 0 0 0 0.5") -> Scene:
    return load(folder, model(visual(mesh("a.obj")), pose=pose, name=name), {"worlds/a.obj": WALLS})


def area_m2(*things: SceneObject) -> float:
    triangles = np.concatenate(
        [s.vertices_m[s.faces] for thing in things for s in thing.surfaces]
    ).astype(float)
    a, b, c = np.moveaxis(triangles, 1, 0)
    return float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)


@UNWARNED
def test_the_walls_of_a_house_are_runs_and_landmarks(tmp_path: Path) -> None:
    runs = house(tmp_path, "HouseWallB").objects
    (whole,) = house(tmp_path, "something").objects
    assert [o.name for o in runs] == [f"HouseWallB::run_{k}" for k in range(6)]
    assert {(o.kind, o.landmark, o.solid) for o in runs} == {("wall", True, True)}
    assert len({o.model for o in runs}) == 6
    assert max(max(o.size_m[:2]) for o in runs) <= RUN_M
    assert area_m2(*runs) == pytest.approx(area_m2(whole), rel=1e-6)
    corners = [o.bounds_m for o in runs]
    low, high = np.min(corners, axis=(0, 1)), np.max(corners, axis=(0, 1))
    assert np.array([low, high]) == pytest.approx(whole.bounds_m, abs=1e-5)


@UNWARNED
def test_cut_or_not_the_same_stands_in_a_robots_way(tmp_path: Path) -> None:
    runs = house(tmp_path, "HouseWallB").objects
    (whole,) = house(tmp_path, "something").objects
    together = shapely.union_all([o.footprint for o in runs])
    assert together.symmetric_difference(whole.footprint).area < 1e-6
    assert sum(o.footprint.area for o in runs) == pytest.approx(whole.footprint.area, abs=1e-4)
    scene = house(tmp_path, "HouseWallB", pose="0 0 0 0 0 0")
    assert scene.is_free([(0, 0), (9.9, 0), (9.9, 3)]).tolist() == [True, True, False]


@UNWARNED
@pytest.mark.parametrize(
    ("name", "long_m", "n"), [("wall", 7.9, 1), ("wall", 20, 3), ("shed", 20, 1)]
)
def test_only_what_is_long_and_a_wall_is_cut(
    tmp_path: Path, name: str, long_m: float, n: int
) -> None:
    shape = f"<box><size>0.2 {long_m} 1.8</size></box>"
    objects = load(tmp_path, model(visual(shape), name=name)).objects
    assert len(objects) == n and all(o.landmark for o in objects)
    assert sum(o.size_m[1] for o in objects) == pytest.approx(long_m, abs=1e-5)


def test_triangles_are_cut_with_all_that_belongs_to_their_corners() -> None:
    draws = np.random.default_rng(0)
    xyz = draws.uniform(-1, 1, (500, 3, 3))
    xyz[:9, 0, 1] = 0.25  # a corner on the plane
    slope = draws.normal(size=(3, 5))  # coordinates and shade change evenly over a face
    cut = _cut(np.concatenate([xyz, xyz @ slope], axis=2), 1, 0.25)
    assert len(cut) > len(xyz)
    beside = cut[:, :, 1] - 0.25
    assert (np.minimum(beside.max(axis=1), -beside.min(axis=1)) < 1e-6).all()
    assert cut[:, :, 3:] == pytest.approx(cut[:, :, :3] @ slope, abs=1e-9)

    def normals(t: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(np.cross(t[:, 1, :3] - t[:, 0, :3], t[:, 2, :3] - t[:, 0, :3]))

    assert normals(cut).sum(axis=0) == pytest.approx(normals(xyz).sum(axis=0))
    areas = [np.linalg.norm(normals(t), axis=1).sum() for t in (cut, xyz)]
    assert areas[0] == pytest.approx(areas[1])

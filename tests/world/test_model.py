"""Placing, naming and free space of the scene model."""

import numpy as np
import pytest
import shapely

from vrchain.errors import PoseError
from vrchain.geometry import Pose
from vrchain.world.model import Scene, SceneObject, place
from vrchain.world.shapes import Model, Part, blob, box, join, tube, wall

GREY = np.full((8, 8, 3), 128, dtype=np.uint8)


def put(name: str, part: Part, pose: Pose, *, solid: bool = True) -> SceneObject:
    model = Model()
    model.add(part, GREY)
    return place(name, "thing", name, [model.surface()], pose, landmark=True, solid=solid)


def crate(name: str, x_m: float, y_m: float, yaw_rad: float = 0.0) -> SceneObject:
    return put(name, box((-1, -0.5, 0), (1, 0.5, 1.2)), Pose(x_m, y_m, yaw_rad))


def test_an_object_turns_about_its_origin_and_keeps_its_own_size() -> None:
    thing = crate("crate", 3.0, 4.0, np.pi / 2)
    assert np.allclose(thing.size_m, (2.0, 1.0, 1.2))
    assert np.allclose(thing.bounds_m, [(2.5, 3.0, 0.0), (3.5, 5.0, 1.2)], atol=1e-6)
    assert thing.footprint.symmetric_difference(shapely.box(2.5, 3.0, 3.5, 5.0)).area < 1e-5


def test_what_hangs_above_a_robot_is_not_in_its_way() -> None:
    post = tube((0, 0, 0), (0, 0, 2.5), 0.1)
    roof = box((-3, -3, 2.2), (3, 3, 2.5), bottom=True)
    shelter = put("s", join([post, roof]), Pose(0, 0))
    assert shelter.footprint.area < 0.04
    assert Scene("s", (20, 20), (shelter,)).is_free([(1.0, 1.0)]).tolist() == [True]


def test_clearance_is_the_distance_to_the_nearest_solid() -> None:
    ghost = put("ghost", box((-1, -1, 0), (1, 1, 1)), Pose(-5, 0), solid=False)
    scene = Scene("two", (20, 20), (crate("a", 5.0, 0.0), ghost))
    clearance = scene.clearance_m([(0, 0), (5, 0), (5, 2.5), (-5, 0)])
    assert np.allclose(clearance, [4.0, 0.0, 2.0, 9.0], atol=1e-5)
    free = scene.is_free([(0, 0), (5, 0), (5, 0.8), (9.8, 9), (-5, 0)])
    assert free.tolist() == [True, False, False, False, True]
    assert scene.is_free([]).shape == scene.clearance_m([]).shape == (0,)


@pytest.mark.parametrize(
    ("pose", "words"),
    [
        (Pose(5.0, 0.2), "'a'"),
        (Pose(5.0, 0.85), "'a'"),
        (Pose(11.0, 0.0), "off the map"),
        (Pose(0.0, -10.5), "off the map"),
        (Pose(float("nan"), 0.0), "finite"),
        (Pose(0.0, 0.0, float("inf")), "finite"),
        (Pose(0.0, 0.0, 90.0), "np.radians"),
        (Pose(0.0, 0.0, -45.0), "np.radians"),
    ],
)
def test_a_pose_where_no_robot_can_stand_is_refused_with_the_reason(pose: Pose, words: str) -> None:
    scene = Scene("one", (20, 20), (crate("a", 5.0, 0.0),))
    with pytest.raises(PoseError, match=words):
        scene.check_pose(pose)
    scene.check_pose(Pose(0.0, 0.0))


def test_the_table_lists_objects_by_their_id() -> None:
    scene = Scene("two", (20, 20), (crate("a", 5.0, 0.0), crate("b", -5.0, 1.0)))
    assert scene.table["name"].tolist() == ["a", "b"]
    assert scene.index_of("b") == 1
    row = scene.table.loc[1]
    assert np.allclose(row[["centre_x_m", "centre_y_m", "centre_z_m"]].astype(float), (-5, 1, 0.6))
    with pytest.raises(KeyError):
        scene.index_of("c")


def volume(part: Part) -> float:
    """Signed: positive when every face of a closed part is wound outwards."""
    a, b, c = (part.points[part.faces[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def test_closed_primitives_are_wound_outwards() -> None:
    assert volume(box((1, 2, 3), (2, 4, 6), bottom=True)) == pytest.approx(6.0)
    ball = volume(blob((5, 0, 2), (1, 1, 1), n=48, rings=48))
    assert ball == pytest.approx(4 * np.pi / 3, rel=0.02)
    cone = tube((0, 0, 0), (0, 0, 3), 1.0, 0.0, n=64)  # its missing foot lies in z = 0
    assert volume(cone) == pytest.approx(np.pi, rel=0.02)


def test_a_wall_faces_the_right_of_its_direction_with_its_picture_upright() -> None:
    part = wall((0, 0), (4, 0), 0.0, 3.0)
    a, b, c = part.points[part.faces[0]]
    assert np.allclose(np.cross(b - a, c - a) / 12, (0, -1, 0))
    assert part.uv.tolist() == [[0, 0], [1, 0], [1, 1], [0, 1]]
    assert np.allclose(part.points[part.uv[:, 1] == 0][:, 2], 0.0)


def test_a_sheet_shows_each_part_its_own_patch() -> None:
    model = Model()
    colours = [(200, 10, 10), (10, 200, 10), (10, 10, 200), (90, 90, 90)]
    for k, colour in enumerate(colours):
        picture = np.full((10 + 7 * k, 30 - 5 * k, 3), colour, dtype=np.uint8)
        model.add(wall((k, 0), (k + 1, 0), 0, 1), picture)
    made = model.surface()
    height, width = made.texture.shape[:2]
    columns = np.floor(made.uv[:, 0] * width).astype(int)
    rows = np.floor((1 - made.uv[:, 1]) * height).astype(int)
    assert made.texture[rows, columns].tolist() == [list(c) for c in colours for _ in range(4)]

"""What of a Gazebo world stands in a robot's way, indoors and out."""

from pathlib import Path

import gazebo_files as gz
import numpy as np
import pytest
from gazebo_files import CUBE, load, mesh, model, visual
from gazebo_files import no_folders as no_folders

from vrchain.errors import SpecError
from vrchain.geometry import Pose
from vrchain.simulation.collision_free import FreeSpace
from vrchain.simulation.simulator import Simulator
from vrchain.world import Scene
from vrchain.world.gazebo import obstacles
from vrchain.world.truth import GroundTruth

Box = tuple[tuple[float, float, float], tuple[float, float, float]]  # lowest and highest corner
WALLS: list[Box] = [
    ((-4, -4, 0), (4, -3.9, 2.5)),
    ((-4, 3.9, 0), (4, 4, 2.5)),
    ((-4, -4, 0), (-3.9, 4, 2.5)),
]
DOOR: list[Box] = [((3.9, -4, 0), (4, -1, 2.5)), ((3.9, 1, 0), (4, 4, 2.5))]
CLOSED: list[Box] = [((3.9, -4, 0), (4, 4, 2.5))]
OUTSIDE = (8.0, 0.0)


def boxes(*corners: Box) -> str:
    """Boxes as one mesh, an OBJ."""
    lines = []
    for low, high in corners:
        points = np.where(np.array(gz.BOX_XYZ) == 0, low, high)
        lines += [f"v {x} {y} {z}" for x, y, z in points]
    for k in range(len(corners)):
        lines += ["f " + " ".join(str(8 * k + i + 1) for i in face) for face in gz.BOX_FACES]
    return "\n".join(lines)


def placed(folder: Path, content: str, pose: str = "") -> Scene:
    """A world of a mesh, and a crate that widens its map."""
    crate = model(CUBE, pose="12 0 0.5 0 0 0", name="crate")
    thing = model(visual(mesh("a.obj")), pose=pose)
    return load(folder, gz.GROUND_MODEL + thing + crate, {"worlds/a.obj": content})


def lamp(bright: float) -> str:
    return (
        f'<light name="lamp" type="point"><diffuse>{bright} {bright} {bright} 1</diffuse></light>'
    )


def free(scene: Scene, *places: tuple[float, float]) -> list[bool]:
    return [bool(f) for f in scene.is_free(places)]


def test_in_a_room_of_one_mesh_robots_stand_and_leave_by_its_door(tmp_path: Path) -> None:
    scene = placed(tmp_path, boxes(*WALLS, *DOOR))
    assert free(scene, (0, 0), (3.95, 0), OUTSIDE) == [True] * 3
    assert free(scene, (3.95, 2), (-3.6, 0), (0, -3.95)) == [False] * 3
    scene.check_pose(Pose(0, 0))
    space = FreeSpace(scene)
    assert len({int(space.region[space.nearest(np.array(p))]) for p in ((0, 0), OUTSIDE)}) == 1
    ring_m = Simulator(scene, {"a": Pose(0, 2)}, seed=1).true_ranges_m("a")
    east, north, west = ring_m[[0, len(ring_m) // 4, len(ring_m) // 2]]
    assert (east, north, west) == pytest.approx((3.9, 1.9, 3.9), abs=0.011)


def test_a_closed_room_of_walls_with_two_sides_is_free_within(tmp_path: Path) -> None:
    scene = placed(tmp_path, boxes(*WALLS, *CLOSED))
    assert free(scene, (0, 0), (3.95, 0), OUTSIDE) == [True, False, True]
    space = FreeSpace(scene)
    assert len({int(space.region[space.nearest(np.array(p))]) for p in ((0, 0), OUTSIDE)}) == 2


@pytest.mark.parametrize("pose", ["", "0 0 0 0 0 0.7"])
def test_a_house_of_one_skin_is_solid_and_its_corner_free(tmp_path: Path, pose: str) -> None:
    outline = [(0, 0), (8, 0), (8, 3), (3, 3), (3, 8), (0, 8)]
    lines = [f"v {x - 4} {y - 4} {z}" for z in (0, 3) for x, y in outline]
    for k in range(6):  # no floor, as houses of suburbs have none
        n = (k + 1) % 6
        lines += [f"f {k + 1} {n + 1} {n + 7}", f"f {k + 1} {n + 7} {k + 7}"]
    lines += [f"f 7 {k + 7} {k + 8}" for k in range(1, 5)]
    scene = placed(tmp_path, "\n".join(lines), pose)
    yaw = float(pose.split()[-1]) if pose else 0.0
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    places = np.array([(2.0, 2.0), (-2.5, -2.5), (-2.5, 2.5), (2.5, -2.5)]) @ turn.T
    assert scene.is_free(places).tolist() == [True, False, False, False]
    footprint = scene.objects[scene.index_of("thing")].footprint
    assert footprint.area == pytest.approx(8 * 3 + 3 * 5, rel=0.02)


def test_a_solid_box_of_one_mesh_is_its_hull(tmp_path: Path) -> None:
    scene = placed(tmp_path, boxes(((-3, -2, 0), (3, 2, 2))))
    thing = scene.objects[scene.index_of("thing")]
    assert thing.outline is None and thing.footprint.area == pytest.approx(24, rel=1e-6)
    assert free(scene, (0, 0)) == [False]


@pytest.mark.parametrize(("roof_m", "under"), [(2.6, True), (1.2, False), (0.0, True)])
def test_robots_drive_under_a_roof_on_posts(tmp_path: Path, roof_m: float, under: bool) -> None:
    posts: list[Box] = [((x, y, 0), (x + 0.2, y + 0.2, 3)) for x in (-3, 2.8) for y in (-3, 2.8)]
    roof: Box = ((-3, -3, roof_m), (3, 3, roof_m + 0.04))
    scene = placed(tmp_path, boxes(*posts, roof))
    assert free(scene, (0, 0), (-2.9, -2.9), (-2.9, 0)) == [under, False, under]


def test_walls_a_hair_off_upright_stop_robots(tmp_path: Path) -> None:
    scene = placed(tmp_path, boxes(*WALLS, *DOOR), pose="0 0 0 1e-5 1e-5 0")
    assert free(scene, (0, 0), (3.95, 2), (-3.95, 0)) == [True, False, False]


LEGS: list[Box] = [
    ((x, y, 0), (x + 0.05, y + 0.05, 0.7)) for x in (-0.6, 0.55) for y in (-0.4, 0.35)
]


@pytest.mark.parametrize(
    ("more", "under"), [([((-0.6, -0.4, 0.7), (0.6, 0.4, 0.74))], False), ([], True)]
)
def test_a_table_is_its_hull(tmp_path: Path, more: list[Box], under: bool) -> None:
    scene = placed(tmp_path, boxes(*LEGS, *more))
    thing = scene.objects[scene.index_of("thing")]
    assert (thing.outline is None, free(scene, (0, 0))) == (not under, [under])


@pytest.mark.parametrize("thick_m", [0.1, 0.0])
def test_a_wall_alone_has_its_doorway(tmp_path: Path, thick_m: float) -> None:
    """Of a room of two visuals, with a crate in it of a third."""
    east: list[Box] = [(low, (3.9 + thick_m, *high[1:])) for low, high in DOOR]
    crate = visual(gz.box("1 1 1"), "-2 0 0.5 0 0 0")
    shown = visual(mesh("a.obj")) + visual(mesh("b.obj")) + crate
    files = {"worlds/a.obj": boxes(*WALLS), "worlds/b.obj": boxes(*east)}
    scene = load(tmp_path, gz.GROUND_MODEL + model(shown), files)
    assert free(scene, (0, 0), (-2, 0), (3.95, 0), (3.95, 2)) == [True, False, True, False]


def test_what_hangs_above_robots_and_what_lies_below_stop_none(tmp_path: Path) -> None:
    scene = placed(tmp_path, boxes(((-3, -3, 1.7), (3, 3, 2)), ((-3, -3, 0), (3, 3, 0.04))))
    assert free(scene, (0, 0)) == [True]


def test_what_has_too_many_faces_is_its_hull(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(obstacles, "_MOST_FACES", 30)
    scene = placed(tmp_path, boxes(*WALLS, *DOOR))
    assert free(scene, (0, 0), OUTSIDE) == [False, True]


ROOF: Box = ((-4, -4, 2.5), (4, 4, 2.6))


@pytest.mark.parametrize("floored", ["within", "all over", "nowhere"])
def test_missions_are_drawn_in_the_room_of_the_goal_where_a_floor_carries_robots(
    tmp_path: Path, floored: str
) -> None:
    slab: list[Box] = [((-4, -4, -0.1), (4, 4, 0.0))] if floored == "within" else []
    files = {"worlds/a.obj": boxes(*WALLS, *CLOSED, *slab)}
    shelf = model(visual(gz.box("1 1 1"), "-2 0 0.5 0 0 0"), name="shelf")
    far = model(CUBE, pose="12 0 0.5 0 0 0", name="far")
    ground = gz.GROUND_MODEL if floored == "all over" else ""
    scene = load(tmp_path, ground + model(visual(mesh("a.obj"))) + shelf + far, files)
    space = FreeSpace(scene, GroundTruth(scene))
    goals = [scene.index_of(name) for name in ("shelf", "far")]
    places = [(2.0, 0.0), OUTSIDE]
    room, near = space.room(scene, goals[:1], 1.0)
    assert near == goals[:1] and space.is_in(room, places[:1]).all()
    assert (space.region == room).sum() / 4 == pytest.approx(7 * 7 - 2 * 2, abs=8)
    room, near = space.room(scene, goals, 1.0)
    assert near == (goals[:1] if floored == "within" else goals[1:])
    assert space.is_in(room, places).tolist() == [floored == "within", floored != "within"]
    assert space.room(scene, [], 1.0)[0] == room
    assert space.room(scene, goals, 0.01) == (-1, [])


@pytest.mark.parametrize(
    ("told", "least"),
    [
        ("<scene><ambient>0.5 0.6 0.7 1</ambient></scene>", 0.6),
        ("<scene><ambient>0.9 0.9 0.9</ambient></scene>", 0.9),
        ("<scene><ambient></ambient></scene>", 0.4),
        ("", 0.4),
        ('<light name="sun" type="directional"/>', 0.0),
        ('<light name="sun" type="directional"/>' + lamp(1.0), 0.0),
        (lamp(0.5), 0.65),
        (lamp(0.5) + lamp(1.0), 0.8),
        (lamp(1.0) + "<scene><ambient>0.9 0.9 0.9</ambient></scene>", 0.9),
    ],
)
def test_under_a_roof_it_is_as_light_as_the_world_says(
    tmp_path: Path, told: str, least: float
) -> None:
    files = {"worlds/a.obj": boxes(*WALLS, *CLOSED, ROOF)}
    scene = load(tmp_path, gz.GROUND_MODEL + told + model(visual(mesh("a.obj"))), files)
    assert scene.ground_light is not None
    image = scene.ground_light.image.mean(axis=2) / 255
    row, column = (n // 2 for n in image.shape)
    assert image[row, column] == pytest.approx(max(least, 0.26), abs=0.03)
    assert image[0, 0] > 0.8


def test_an_ambient_light_of_no_numbers_is_told(tmp_path: Path) -> None:
    with pytest.raises(SpecError, match="<ambient>: expected 3 finite numbers, got 'dim'"):
        load(tmp_path, "<scene><ambient>dim</ambient></scene>" + model(CUBE))

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import cv2
import numpy as np
import pytest
import worlds

from vrchain.errors import PoseError, RenderError
from vrchain.experiments.landmarks.pairs import draw_poses
from vrchain.experiments.reproduction.results import suburb
from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.panorama import CameraRig, Panorama
from vrchain.seeding import generator
from vrchain.world import backdrop, light
from vrchain.world.model import LightMap, Scene, place
from vrchain.world.render import Renderer
from vrchain.world.spec import LightSpec
from vrchain.world.truth import GroundTruth

QUARTERS = np.zeros((16, 16, 3), dtype=np.uint8)  # top left, top right, bottom left, bottom right
QUARTERS[:8, :8], QUARTERS[:8, 8:] = worlds.RED, worlds.GREEN
QUARTERS[8:, :8], QUARTERS[8:, 8:] = worlds.BLUE, worlds.YELLOW


def mask_of(image: np.ndarray, rgb: tuple[int, int, int]) -> np.ndarray:
    return np.abs(image.astype(int) - rgb).max(axis=-1) < 40


@pytest.mark.parametrize("pose", [Pose(0, 0), Pose(1.5, -2, 2.0), Pose(-3, 1, -1.2)])
def test_a_box_appears_at_its_bearing(pose: Pose) -> None:
    rig = CameraRig(n_views=6, width_px=320, height_px=240, field_of_view_deg=75)
    red = worlds.box("red", (5.0, 5.0), (1.0, 2.0, 2.0), worlds.plain(worlds.RED), yaw_rad=0.3)
    cylinder = Renderer(worlds.world(red)).render(pose, rig).cylinder
    corners = red.surfaces[-1].vertices_m[:, :2]  # of the top
    bearings = [pose.bearing_to_rad(corner) for corner in corners]
    left, right = rig.column_of_bearing(max(bearings)), rig.column_of_bearing(min(bearings))
    above = cylinder[: len(cylinder) // 2].astype(int)  # before the sky: red less blue is -64
    columns = np.flatnonzero((above[..., 0] - above[..., 2]).max(axis=0) > (190 - 64) / 2)
    assert columns[0] == pytest.approx(left, abs=1)
    assert columns[-1] == pytest.approx(right, abs=1)


def test_left_is_left_and_up_is_up() -> None:
    boxes = [
        worlds.box("left", (5, 5), (1, 1, 2), worlds.plain(worlds.RED)),
        worlds.box("right", (5, -5), (1, 1, 2), worlds.plain(worlds.BLUE)),
        worlds.box("raised", (7, 0), (1, 1, 1), worlds.plain(worlds.YELLOW), base_m=2.0),
    ]
    cylinder = Renderer(worlds.world(*boxes)).render(Pose(0, 0), worlds.SMALL_RIG).cylinder
    rows, columns = cylinder.shape[:2]
    assert np.argwhere(mask_of(cylinder, worlds.RED))[:, 1].max() < columns / 2
    assert np.argwhere(mask_of(cylinder, worlds.BLUE))[:, 1].min() > columns / 2
    assert np.argwhere(mask_of(cylinder, worlds.YELLOW))[:, 0].max() < rows / 2
    assert (cylinder[0, 0] == (168, 200, 232)).all()  # the sky's colour
    assert mask_of(cylinder[-1:], (90, 120, 70)).all()  # the ground's


@pytest.mark.parametrize("stands", [True, False])
def test_the_floor_of_what_stands_is_lit_once(stands: bool) -> None:
    """Its light is baked, with that of the whole; what lies alone has its light in the map."""
    floor = worlds.quad([(2, -2, 0), (6, -2, 0), (6, 2, 0), (2, 2, 0)], worlds.plain(worlds.YELLOW))
    wall = worlds.quad([(6, 2, 0), (6, -2, 0), (6, -2, 3), (6, 2, 3)], worlds.plain(worlds.RED))
    surfaces = [floor, wall] if stands else [floor]
    house = place("house", "house", "of its own", surfaces, Pose(0, 0), landmark=True)
    corner = np.array([20.0, 20.0])
    shown = []
    for light_of in (255, 90):
        image = np.full((4, 4, 3), light_of, dtype=np.uint8)
        lit = replace(worlds.world(house), ground_light=LightMap(image, -corner, corner))
        middle = Renderer(lit).render(Pose(0, 0), worlds.SMALL_RIG).cylinder
        below = middle[round(0.9 * len(middle)), middle.shape[1] // 2].astype(int)
        shown.append(below)
    assert (shown[0] == shown[1]).all() == stands


@pytest.mark.parametrize("narrower_px", [0, 1])  # rows of 48 bytes, and of 42
@pytest.mark.parametrize("side", range(4))
def test_textures_are_upright_and_not_mirrored(side: int, narrower_px: int) -> None:
    angle = side * np.pi / 2 + 0.2
    picture = QUARTERS[:, narrower_px : 16 - narrower_px]
    sign = worlds.box("sign", (0, 0), (2, 2, 2), picture, yaw_rad=0.2)
    for surface in sign.surfaces:
        surface.uv[:] += narrower_px  # what repeats is not joined with others
    scene = worlds.world(sign)
    pose = Pose(4 * np.cos(angle), 4 * np.sin(angle), angle + np.pi)
    ahead = Renderer(scene).render(pose, worlds.SMALL_RIG).views[0]
    height, width = ahead.shape[:2]
    places = {
        worlds.RED: (-1, -1),
        worlds.GREEN: (-1, 1),
        worlds.BLUE: (1, -1),
        worlds.YELLOW: (1, 1),
    }
    for rgb, (down, right) in places.items():
        y, x = ahead.shape[0] // 2 + down * height // 8, width // 2 + right * width // 12
        assert mask_of(ahead[y, x], rgb), f"expected {rgb} at {(y, x)}, got {ahead[y, x]}"


def test_shade_darkens_the_texture() -> None:
    box = worlds.box("box", (4, 0), (2, 2, 2), worlds.plain((200, 100, 50)))
    for surface in box.surfaces:
        surface.shade[:] = 0.5
    ahead = Renderer(worlds.world(box)).render(Pose(0, 0), worlds.SMALL_RIG).views[0]
    assert np.abs(ahead[60, 80].astype(int) - (100, 50, 25)).max() <= 2


def test_neighbouring_views_agree_where_they_overlap() -> None:
    rig = CameraRig(n_views=8, width_px=320, height_px=240)
    panorama = Renderer(worlds.yard()).render(Pose(0.3, 0.2, 0.7), rig)
    slope = rig.slope_of_row(np.arange(20, rig.cylinder_shape[0] - 20))[:, None]
    for view in range(rig.n_views):
        following = (view + 1) % rig.n_views
        seam_rad = wrap_angle_rad(rig.azimuths_rad[view] + np.pi / rig.n_views)
        bearing = seam_rad + np.radians(np.linspace(-5, 5, 60))[None, :]
        pictures = []
        for v in (view, following):
            x_px, y_px = np.broadcast_arrays(*rig.project(v, bearing, slope))
            maps = np.float32(x_px), np.float32(y_px)
            picture = cv2.remap(panorama.views[v], *maps, cv2.INTER_LINEAR)
            pictures.append(cv2.GaussianBlur(picture, (5, 5), 0).astype(float))
        difference = np.abs(pictures[0] - pictures[1]).max(axis=-1)
        assert np.quantile(difference, 0.95) < 12
        contrast = np.abs(pictures[0] - np.roll(pictures[1], 6, axis=1)).max(axis=-1)
        assert difference.mean() < 0.35 * contrast.mean() or contrast.mean() < 3


def test_the_joined_cylinder_has_no_seam() -> None:
    """Neighbouring columns differ no more at the seams, and over the edge, than elsewhere."""
    rig = CameraRig(n_views=8, width_px=320, height_px=240)
    cylinder = Renderer(worlds.yard()).render(Pose(0.3, 0.2, 0.7), rig).cylinder.astype(float)
    step = np.abs(cylinder - np.roll(cylinder, 1, axis=1)).mean(axis=(0, 2))
    owner = rig.view_of_bearing(rig.bearing_of_column(np.arange(cylinder.shape[1])))
    seams = np.flatnonzero(owner != np.roll(owner, 1))
    assert len(seams) == 8
    assert step[[0, *seams]].max() <= np.quantile(step, 0.995)


@pytest.mark.parametrize(
    ("pose", "words"),
    [
        (Pose(4.0, 0.0), "'box'"),
        (Pose(1000.0, 0.0), "off the map"),
        (Pose(0.0, float("nan")), "finite"),
        (Pose(0.0, 0.0, 90.0), "np.radians"),
    ],
)
def test_nothing_is_drawn_from_where_no_robot_can_stand(pose: Pose, words: str) -> None:
    box = worlds.box("box", (4, 0), (2, 2, 2), worlds.plain(worlds.RED))
    renderer = Renderer(worlds.world(box))
    for draw in (renderer.render, renderer.segmentation):
        with pytest.raises(PoseError, match=words):
            draw(pose, worlds.SMALL_RIG)


def test_drawing_twice_gives_the_same_bytes() -> None:
    renderer = Renderer(worlds.yard())
    first = renderer.render(Pose(0, 0), worlds.SMALL_RIG)
    renderer.segmentation(Pose(2, 1), CameraRig(1, 64, 48))
    other = Renderer(worlds.maze()).render(Pose(0, 0), CameraRig(1, 128, 48))
    again = renderer.render(Pose(0, 0), worlds.SMALL_RIG)
    assert other.views.shape == (1, 48, 128, 3)
    assert np.array_equal(first.views, again.views)


def test_two_processes_draw_the_same_bytes_and_print_nothing_else() -> None:
    code = """
import hashlib, json, worlds
from vrchain.geometry import Pose
from vrchain.world.render import Renderer
from vrchain.world.truth import GroundTruth
pose, rig, yard = Pose(0.5, -0.3, 1.1), worlds.SMALL_RIG, worlds.yard()
robots = {"R1": Pose(3, 0, 2.0), "R2": Pose(3.5, 0.3)}
renderer = Renderer(yard)
arrays = [renderer.render(pose, rig).views, renderer.segmentation(pose, rig)]
arrays += [renderer.render(Pose(0, 0), rig, robots).views, *GroundTruth(yard).look(pose, rig)]
print(json.dumps([hashlib.sha256(a.tobytes()).hexdigest() for a in arrays]))
"""
    first, second = worlds.in_two_processes(code)  # no JSON, were anything printed at the very end
    assert first == second


def test_another_thread_is_refused() -> None:
    renderer = Renderer(worlds.yard())
    with ThreadPoolExecutor(1) as pool:
        drawing = pool.submit(renderer.render, Pose(0, 0), worlds.SMALL_RIG)
        with pytest.raises(RenderError, match="thread"):
            drawing.result()


def test_a_scene_of_nothing_is_all_sky() -> None:
    renderer = Renderer(Scene("void", (10.0, 10.0), ()))
    panorama = renderer.render(Pose(0, 0), worlds.SMALL_RIG)
    assert isinstance(panorama, Panorama)
    assert (panorama.views == (168, 200, 232)).all()
    assert (renderer.segmentation(Pose(0, 0), worlds.SMALL_RIG) == -1).all()


def agreement(scene: Scene, poses: list[Pose], rig: CameraRig) -> list[float]:
    renderer, truth = Renderer(scene), GroundTruth(scene)
    return [
        float((renderer.segmentation(pose, rig) == truth.look(pose, rig)[0]).mean())
        for pose in poses
    ]


TEAM = {"R3": Pose(3, 1, 2.5), "R1": Pose(-2, -4, 0.3), "R2": Pose(25, 1)}


def test_robots_are_drawn_where_rays_hit_them() -> None:
    """Ids count down in the order given; the third stands behind a box."""
    renderer, truth = Renderer(worlds.yard()), GroundTruth(worlds.yard())
    for pose in (Pose(0, 0), Pose(1, -1, 2.0)):
        drawn = renderer.segmentation(pose, CameraRig(8, 320, 240), TEAM)
        cast, _ = truth.look(pose, CameraRig(8, 320, 240), TEAM)
        assert drawn.dtype == np.int32
        assert (drawn == cast).mean() >= 0.995
        for robot in (-2, -3):
            both = ((drawn == robot) & (cast == robot)).sum()
            assert both > 0.9 * max((drawn == robot).sum(), (cast == robot).sum()) > 0


def test_pictures_show_robots_where_they_are_and_nothing_else_changes() -> None:
    renderer, rig, pose = Renderer(worlds.yard()), CameraRig(8, 320, 240), Pose(0, 0, 1.0)
    plain = renderer.render(pose, rig).views
    views = renderer.render(pose, rig, TEAM).views
    robot = renderer.segmentation(pose, rig, TEAM) < -1
    assert (views != plain).any(axis=-1)[robot].mean() > 0.9
    assert np.array_equal(views[~robot], plain[~robot])
    assert np.array_equal(renderer.render(pose, rig, {}).views, plain)  # they have gone
    assert np.array_equal(renderer.segmentation(pose, rig), renderer.segmentation(pose, rig, {}))


@pytest.mark.parametrize("yaw_rad", [0.0, 1.0, -2.0])
def test_a_robot_is_upright_and_faces_its_way(yaw_rad: float) -> None:
    """From 3 m off its nose the two lights show, from behind none; the mast is in the middle."""
    rig = CameraRig(1, 640, 480)
    renderer = Renderer(worlds.world())
    robot = {"R1": Pose(2, 1, yaw_rad)}
    ahead = np.array([np.cos(yaw_rad), np.sin(yaw_rad)])
    lights = []
    for side in (1, -1):
        pose = Pose(*(robot["R1"].xy_m + 3 * side * ahead), yaw_rad + (side > 0) * np.pi)
        image = renderer.render(pose, rig, robot).views[0]
        shown = renderer.segmentation(pose, rig, robot)[0] == -2
        rows, columns = np.nonzero(shown)
        assert columns.mean() == pytest.approx(320, abs=2)
        assert rows.min() == pytest.approx(240 - 0.05 / 3 * rig.focal_px, abs=2)  # the head's top
        assert rows.max() == pytest.approx(240 + 1.0 / 2.75 * rig.focal_px, abs=4)  # the wheels
        widths = shown.sum(axis=1)
        assert widths[400:420].max() > 3 * widths[300:350].max()  # broad below, narrow above
        lights.append((shown & (image.min(axis=-1) > 70))[375:].sum())
    assert lights[0] > 20 and lights[1] == 0


def test_drawn_objects_are_those_that_rays_hit() -> None:
    poses = [Pose(0, 0), Pose(2, -1, 0.4), Pose(-1, 3, 3.0)]
    assert min(agreement(worlds.yard(), poses, CameraRig(8, 320, 240))) >= 0.995


@pytest.mark.parametrize("n", [3, pytest.param(20, marks=pytest.mark.slow)])
def test_drawn_objects_are_those_that_rays_hit_in_the_suburb(n: int) -> None:
    scene = suburb()
    shares = agreement(scene, draw_poses(scene, n, generator(3000)), CameraRig())
    print(f"drawn and cast ids agree on {min(shares):.3%} of the pixels at least")
    assert min(shares) >= 0.995


def test_of_a_large_map_the_sky_hides_nothing_and_is_seen_to_its_far_side() -> None:
    extent_m, here = (600.0, 600.0), Pose(-299.0, -299.0, np.pi / 4)
    sun = light.sunlight(LightSpec())
    far = worlds.box("far", (295.0, 295.0), (9, 9, 200), worlds.plain(worlds.RED))
    dome = backdrop.build_sky(sun, generator(0, "sky"), extent_m)
    scene = Scene("large", extent_m, (far,), dome, (0, 0, 255))
    rig = CameraRig(n_views=1)
    renderer = Renderer(scene)
    seen = renderer.segmentation(here, rig)[0]
    assert (seen[rig.height_px // 2 - 60, rig.width_px // 2 - 1] == 0).all()
    above = renderer.render(here, rig).views[0][: rig.height_px // 2]
    assert not mask_of(above, (0, 0, 255)).any()

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from spheres import as_sphere, sphere_rays
from worlds import yard

from vrchain.errors import ImageError, SpecError
from vrchain.geometry import Pose
from vrchain.panorama import CameraRig, encode_png, import_panorama
from vrchain.panorama.models import Mirror, equirectangular
from vrchain.panorama.sources import Source, from_equirectangular
from vrchain.world.render import Renderer


def coloured(width_px: int) -> NDArray[np.uint8]:
    """An equirectangular picture whose colour tells the direction."""
    return np.round(127.5 + 120 * sphere_rays(width_px)).astype(np.uint8)


@pytest.mark.parametrize(
    ("ray", "pixel"),
    [
        ((1, 0, 0), (511.5, 255.5)),  # ahead: the middle
        ((0, 1, 0), (255.5, 255.5)),  # left
        ((0, -1, 0), (767.5, 255.5)),
        ((-1, 1e-9, 0), (-0.5, 255.5)),  # behind: the outer edges
        ((-1, -1e-9, 0), (1023.5, 255.5)),
        ((1, 0, 1), (511.5, 127.5)),  # 45 degrees up
        ((0, 0, -1), (511.5, 511.5)),
    ],
)
def test_where_a_ray_is_in_an_equirectangular_picture(
    ray: tuple[float, float, float], pixel: tuple[float, float]
) -> None:
    assert np.allclose(equirectangular(np.array(ray), (1024, 512)), pixel)


@pytest.mark.parametrize("width_px", [512, 1024, 4600])
def test_every_pixel_of_the_views_shows_its_own_direction(width_px: int) -> None:
    """Round the seam too; pictures of more pixels than are used are shrunk."""
    panorama = from_equirectangular(coloured(width_px), 1.5)
    shown = panorama.views.astype(float)
    assert np.abs(shown - (127.5 + 120 * panorama.rig.ray_directions())).max() < 2.5
    assert panorama.rig.camera_height_m == 1.5


@pytest.mark.parametrize(("width_px", "columns"), [(512, 512), (2048, 2048), (4600, 4096)])
@pytest.mark.parametrize("reach", [0.4, 1.4])
def test_the_rig_has_the_pixels_a_radian_of_the_picture_and_the_reach_asked_for(
    width_px: int, columns: int, reach: float
) -> None:
    rig = from_equirectangular(np.zeros((width_px // 2, width_px, 3), np.uint8), reach=reach).rig
    assert rig.n_views == 8
    assert rig.cylinder_shape[1] == pytest.approx(columns, abs=6)
    assert rig.slope_of_row(0) == pytest.approx(reach, abs=3 / rig.px_per_rad)


@pytest.mark.parametrize(
    ("picture", "word"),
    [
        (np.zeros((500, 1024, 3), np.uint8), "1024 x 500"),
        (np.zeros((60, 120, 3), np.uint8), "256 pixels wide or more, got 120 x 60"),
        (np.zeros((512, 1024), np.uint8), "uint8 (512, 1024)"),
        (np.zeros((512, 1024, 3)), "float64"),
    ],
)
def test_another_picture_is_refused(picture: NDArray, word: str) -> None:
    with pytest.raises(ImageError) as refused:
        from_equirectangular(picture, what="mine.jpg")
    assert word in str(refused.value) and "mine.jpg" in str(refused.value)


def test_files(tmp_path: Path) -> None:
    (tmp_path / "sphere.png").write_bytes(encode_png(coloured(512)))
    (tmp_path / "none.jpg").write_text("no picture")
    (tmp_path / "pointer.jpg").write_text("version https://git-lfs.github.com/spec/v1\noid 1\n")
    source = Source("equirectangular", camera_height_m=0.7)
    found = import_panorama(tmp_path / "sphere.png", source)
    assert np.array_equal(found.panorama.views, from_equirectangular(coloured(512), 0.7).views)
    assert found.panorama.seen is None and found.upsampled == pytest.approx(1, abs=0.01)
    assert found.about == {
        "source": [str(tmp_path / "sphere.png")],
        "model": "equirectangular",
        "tilt_corrected": False,
    }
    for name, word in (("none.jpg", "none.jpg"), ("missing.jpg", "missing.jpg")):
        with pytest.raises(ImageError, match=word):
            import_panorama(tmp_path / name, source)
    with pytest.raises(ImageError, match="Git LFS pointer"):
        import_panorama(tmp_path / "pointer.jpg")
    with pytest.raises(ImageError, match=r"full sphere\? Then say --model equirectangular"):
        import_panorama(tmp_path / "sphere.png")
    with pytest.raises(SpecError, match="camera_height_m"):
        import_panorama(tmp_path / "sphere.png", replace(source, camera_height_m=0.0))


def test_a_rendered_panorama_comes_back() -> None:
    """Drawn as a sphere and imported again, a view is what it was."""
    rig = CameraRig(8, 376, 988, 60.0)
    drawn = Renderer(yard()).render(Pose(1.0, 2.0, 0.5), rig)
    again = from_equirectangular(as_sphere(drawn, 2048))
    assert again.rig == rig
    middle = cv2.absdiff(drawn.views, again.views)[:, 200:-200]
    assert np.median(middle) <= 1 and middle.mean() < 3


def save(path: Path, picture: NDArray[np.uint8]) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(encode_png(picture))
    return path


def test_a_ring_of_ours_comes_back_pixel_by_pixel(tmp_path: Path) -> None:
    rig = CameraRig(4, 64, 48, 100.0, 0.6)
    drawn = Renderer(yard()).render(Pose(1.0, 2.0, 0.5), rig)
    files = [save(tmp_path / f"{k}.png", view) for k, view in enumerate(drawn.views)]
    source = Source("views", field_of_view_deg=100.0, camera_height_m=0.6)
    found = import_panorama(files, source)
    assert found.panorama.rig == rig and found.panorama.seen is None
    assert np.array_equal(found.panorama.views, drawn.views) and found.upsampled == 1
    two = replace(source, bearings_deg=(0.0, 90.0), columns=256)
    again = import_panorama(files[:2], two).panorama
    assert again.seen is not None and 0.2 < again.seen.mean() < 0.6
    for bearings in ((0.0,), (0.0, 90.0, 180.0)):
        with pytest.raises(ImageError, match="got 2"):
            import_panorama(files[:2], replace(source, bearings_deg=bearings))


@pytest.mark.parametrize("named", ["cube_{}.png", "{}/0/0.png"])
@pytest.mark.parametrize("names", ["frblud", "ubdlrf"])
def test_six_faces_are_known_by_their_names(names: str, named: str, tmp_path: Path) -> None:
    """In whatever order they are given, ahead is ahead."""
    colour = {face: 20 + 30 * k for k, face in enumerate("frblud")}
    files = [
        save(tmp_path / named.format(name), np.full((128, 128, 3), colour[name], np.uint8))
        for name in names
    ]
    middle = import_panorama(files, Source("cubemap")).panorama.cylinder
    row, columns = middle[len(middle) // 2, :, 0], middle.shape[1]
    shown = [int(row[round(columns * share)]) for share in (0.5, 0.75, 0.99, 0.25)]
    assert shown == [colour[face] for face in "frbl"]


@pytest.mark.parametrize(
    ("source", "size", "word"),
    [
        (Source("cubemap"), (300, 200), None),
        (Source("cubemap"), (300, 210), "a cross of 4 x 3 or a strip"),
        (Source("cylinder"), (200, 50), "256 pixels or more around, got 200"),
        (Source("cylinder", columns=300), (200, 50), None),
        (Source("equirectangular"), (400, 100), "--field-of-view and --elevations"),
        (Source("equirectangular", elevations_deg=(-30, 30)), (400, 100), None),
        (Source("equirectangular", elevations_deg=(70, 90)), (400, 100), "mend --pitch"),
        (Source("fisheye", pitch_deg=90), (400, 400), None),
        (Source("mirror", mirror=Mirror()), (640, 480), None),
        (Source("mirror"), (640, 480), "give --inner and --outer"),
        (Source("cylinder"), (4096, 1), "several pixels each way"),
        (Source("cylinder", elevations_deg=(-90, 90)), (512, 256), "several pixels each way"),
        (Source("equirectangular", elevations_deg=(-0.05, 0.05)), (512, 256), "several pixels"),
        (Source("equirectangular", elevations_deg=(0.1, 0.5)), (512, 256), "less than a degree"),
        (Source("fisheye", columns=96), (1, 1), "several pixels each way"),
    ],
)
def test_shapes(source: Source, size: tuple[int, int], word: str | None, tmp_path: Path) -> None:
    file = save(tmp_path / "a.png", np.full((size[1], size[0], 3), 90, np.uint8))
    if word is None:
        assert import_panorama(file, source).panorama.cylinder.max() == 90
        return
    with pytest.raises(ImageError) as refused:
        import_panorama(file, source)
    assert word in str(refused.value) and "a.png" in str(refused.value)


def test_upsampling_is_told(tmp_path: Path) -> None:
    file = save(tmp_path / "a.png", np.full((50, 200, 3), 90, np.uint8))
    found = import_panorama(file, Source("cylinder", columns=600))
    assert found.upsampled == pytest.approx(3, rel=0.02)
    tall = save(tmp_path / "b.png", np.full((100, 600, 3), 90, np.uint8))
    found = import_panorama(tall, Source("equirectangular", elevations_deg=(-45, 45)))
    assert found.upsampled == pytest.approx(600 / 2 / np.pi / (100 / (np.pi / 2)), rel=0.05)


def test_views_larger_than_a_rig_takes_are_made_smaller(tmp_path: Path) -> None:
    wide = [save(tmp_path / f"{k}.png", np.full((60, 4200, 3), 90, np.uint8)) for k in range(4)]
    found = import_panorama(wide, Source("views", field_of_view_deg=95.0))
    assert found.panorama.rig.width_px <= 4096


@pytest.mark.parametrize(
    ("given", "word"),
    [
        ({"model": "flat"}, "expected a model of equirectangular, cylinder"),
        ({"field_of_view_deg": 0.0}, "field_of_view_deg must lie in 1..360, got 0"),
        ({"pitch_deg": float("nan")}, "pitch_deg must lie"),
        ({"elevations_deg": (30.0, -30.0)}, "the lower first, got 30 -30"),
        ({"mirror": Mirror(inner=0.5, outer=0.1)}, "inner radius below its outer"),
        ({"mirror": Mirror(offset_deg=float("inf"))}, "inner radius below its outer"),
        ({"faces": "front"}, "the letters frblud in some order, got 'front'"),
        ({"columns": 3}, "columns must lie"),
        ({"model": "cubemap", "field_of_view_deg": 90.0}, "is told of the model equirectangular,"),
        ({"model": "fisheye", "elevations_deg": (-5.0, 5.0)}, "elevations: is told of the model"),
    ],
)
def test_options_out_of_bounds_are_refused(given: dict, word: str) -> None:
    with pytest.raises(ImageError) as refused:
        Source(**given)
    assert word in str(refused.value)

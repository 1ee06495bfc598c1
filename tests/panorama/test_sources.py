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
from vrchain.panorama.models import equirectangular
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

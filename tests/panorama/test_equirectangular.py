"""Panoramas written as equirectangular pictures: what is read again is what was written."""

import io
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from spheres import as_sphere
from worlds import yard

from vrchain.geometry import Pose
from vrchain.panorama import CameraRig, Panorama, import_panorama
from vrchain.panorama.metadata import metadata_of
from vrchain.panorama.spheres import equirectangular_jpeg
from vrchain.world.render import Renderer

WHOLE = CameraRig(8, 188, 300, 60.0)


@pytest.fixture(scope="module")
def drawn() -> Panorama:
    return Renderer(yard()).render(Pose(1.0, 2.0, 0.5), WHOLE)


def test_the_picture_is_that_part_of_the_sphere_which_it_says(drawn: Panorama) -> None:
    content = equirectangular_jpeg(drawn, heading_deg=-30.0)
    told = metadata_of(content, "a.jpg")
    assert told.projection == "equirectangular" and told.heading_deg == 330.0
    assert (told.pitch_deg, told.roll_deg) == (0.0, 0.0)
    picture = np.asarray(Image.open(io.BytesIO(content)))
    height_px, width_px = picture.shape[:2]
    sphere = as_sphere(drawn, width_px)  # by another way
    top_px = (width_px // 2 - height_px) // 2
    assert np.median(cv2.absdiff(picture, sphere[top_px : top_px + height_px])) <= 2
    field = told.field
    assert field is not None and field.closed
    reach = WHOLE.slope_of_row(-0.5)
    assert math.tan(field.top) == pytest.approx(float(reach), abs=0.02)
    assert field.height == pytest.approx(2 * field.top)


def test_what_is_written_is_imported_without_a_question(drawn: Panorama, tmp_path: Path) -> None:
    file = tmp_path / "a.jpg"
    file.write_bytes(equirectangular_jpeg(drawn))
    again = import_panorama(file, rig=WHOLE)
    assert again.about["tilt_corrected"] and "heading_deg" not in again.about
    inner = np.s_[:, 60:-60, 40:-40]
    assert np.median(cv2.absdiff(drawn.views, again.panorama.views)[inner]) <= 3


def test_a_single_view_is_as_wide_as_it_was(tmp_path: Path) -> None:
    rig = CameraRig(1, 320, 240, 60.0)
    view = Panorama(rig, np.full((1, 240, 320, 3), 90, np.uint8))
    field = metadata_of(equirectangular_jpeg(view), "a.jpg").field
    assert field is not None and not field.closed
    assert math.degrees(field.width_rad) == pytest.approx(60, abs=0.3)
    assert field.left_rad == pytest.approx(field.width_rad / 2)

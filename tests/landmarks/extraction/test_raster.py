import numpy as np
import pytest
import sights
import worlds

from vrchain.geometry import Pose
from vrchain.landmarks.extraction.raster import (
    CELL_PX,
    COLUMNS,
    PX_PER_RAD,
    ROWS,
    cell_bearings_rad,
    cell_slopes,
    cells_at,
    columns_of,
    picture_of,
    unseen_cells,
)
from vrchain.panorama import CameraRig, Panorama


@pytest.mark.parametrize(
    "rig",
    [CameraRig(), CameraRig(width_px=320, height_px=240), CameraRig(n_views=1),
     CameraRig(n_views=6, field_of_view_deg=70.0)],
)  # fmt: skip
def test_a_picture_has_one_scale_whatever_the_rig(rig: CameraRig) -> None:
    views = np.zeros((rig.n_views, rig.height_px, rig.width_px, 3), dtype=np.uint8)
    picture = picture_of(Panorama(rig, views))
    assert picture.shape == (ROWS, columns_of(rig), 3) and picture.dtype == np.uint8
    assert abs(columns_of(rig) / rig.span_rad / PX_PER_RAD - 1) < 0.03
    assert len(cell_bearings_rad(rig)) * CELL_PX == columns_of(rig)
    assert len(cell_slopes()) * CELL_PX == ROWS


def test_cells_are_where_things_are_seen() -> None:
    """A red box fills the cells of its directions, and no others."""
    red = worlds.plain((250, 0, 0))
    box = worlds.box("box", (12.0, 5.0), (2.0, 2.0, 2.5), red)
    pose = Pose(0.0, 0.0, 0.7)
    picture = picture_of(sights.look(pose, CameraRig(), worlds.world(box)))
    cells = picture.reshape(ROWS // CELL_PX, CELL_PX, COLUMNS // CELL_PX, CELL_PX, 3)
    shown = (cells[..., 0] > 120) & (cells[..., 1] < 60)
    row, column = np.nonzero(shown.mean(axis=(1, 3)) > 0.5)
    corners = np.concatenate([s.vertices_m for s in box.surfaces]).astype(float)
    bearing, slope = sights.directions(pose, corners)
    slack_rad = 1.5 * 2 * np.pi / len(cell_bearings_rad(CameraRig()))  # half a cell has to be red
    seen_bearing, seen_slope = cell_bearings_rad(CameraRig())[column], cell_slopes()[row]
    for seen, true in ((seen_bearing, bearing), (seen_slope, slope)):
        assert abs(seen.min() - true.min()) < slack_rad
        assert abs(seen.max() - true.max()) < slack_rad


def test_beside_a_single_view_there_is_no_cell() -> None:
    rig = CameraRig(1, 640, 480, 60.0)
    bearing_rad = np.radians([0.0, 29.9, 30.1, -29.9, -30.1, 179.0])
    _, inside = cells_at(bearing_rad, np.zeros(6), rig)
    assert inside.tolist() == [True, True, False, True, False, False]
    _, inside = cells_at(bearing_rad, np.zeros(6), CameraRig())
    assert inside.all()


def test_cells_at_a_hole_are_unseen() -> None:
    rig = CameraRig(8, 160, 120)
    views = np.full((8, 120, 160, 3), 99, dtype=np.uint8)
    assert unseen_cells(Panorama(rig, views)) is None
    seen = np.ones(views.shape[:3], dtype=bool)
    seen[1] = False
    unseen = unseen_cells(Panorama(rig, views, seen))
    assert unseen is not None and unseen.shape == (ROWS // CELL_PX, columns_of(rig) // CELL_PX)
    bearing = np.degrees(cell_bearings_rad(rig))
    level = unseen[len(unseen) // 2]
    assert level[np.abs(bearing - 45) < 22.5].all()
    assert not level[np.abs(bearing - 45) > 25].any()
    assert (unseen == level).all()  # above and below too, where the outermost rows are repeated

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from spheres import as_sphere
from worlds import yard

from vrchain.errors import ImageError
from vrchain.experiments.landmarks.tours import (
    BANDS,
    ELSEWHERE,
    NEAR,
    OTHER_ROOMS,
    as_text,
    evaluate,
    read_places,
    summarise,
)
from vrchain.geometry import Pose, wrap_angle_rad
from vrchain.landmarks.matching.common import Comparison
from vrchain.landmarks.matching.variants import Variant, sift
from vrchain.panorama import CameraRig, encode_png
from vrchain.panorama.databases import TOUR
from vrchain.world.render import Renderer

SCALE_M = 2.5
POSES = (Pose(0.0, 0.0, 0.3), Pose(1.2, 0.9, 2.5), Pose(-3.0, -1.0, -2.0))
ROOMS = ("kitchen", "kitchen", "hall")


@pytest.fixture(scope="module")
def tour(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three panoramas of a yard of boxes, called two rooms, as a tour in ZInD's layout."""
    folder = tmp_path_factory.mktemp("tour")
    (folder / "panos").mkdir()
    rig, renderer = CameraRig(8, 188, 494, 60.0), Renderer(yard())
    floor: dict = {}
    for k, (pose, room) in enumerate(zip(POSES, ROOMS, strict=True)):
        picture = as_sphere(renderer.render(pose, rig), 1024)
        (folder / "panos" / f"{k}.png").write_bytes(encode_png(picture))
        floor.setdefault(room, {}).setdefault("part", {})[f"pano_{k}"] = {
            "image_path": f"panos/{k}.png",
            "camera_height": 1,
            "floor_plan_transformation": {
                "translation": [-pose.x_m / SCALE_M, pose.y_m / SCALE_M],
                "rotation": 90.0 - np.degrees(pose.yaw_rad) + 360,
                "scale": 0.4,
            },
        }
    write(folder, {"merger": {"floor_01": floor}, "scale_meters_per_coordinate": {"floor_01": 2.5}})
    return folder


def write(folder: Path, told: object) -> None:
    (folder / TOUR).write_text(json.dumps(told))


def test_poses_are_read_as_they_were(tour: Path) -> None:
    for taken, pose, room in zip(read_places([tour]), POSES, (0, 0, 1), strict=True):
        assert taken.pose is not None
        assert np.allclose(taken.pose.xy_m, pose.xy_m)
        assert wrap_angle_rad(taken.pose.yaw_rad - pose.yaw_rad) == pytest.approx(0.0)
        assert (taken.room, taken.height_m) == (room, pytest.approx(1.0))


def test_pairs_are_judged_by_the_truth(tour: Path, tmp_path: Path) -> None:
    """What is drawn, mapped to a sphere and imported has the relative pose that it was drawn from.

    Its floor in a mirror, the truth would be wrong.
    """
    found = evaluate([tour], [sift()], folder=tmp_path)
    assert list(found.band) == [NEAR, OTHER_ROOMS, OTHER_ROOMS]
    near = found.iloc[0]
    assert (near.claims > 0, near.right, near.spacing_m) == (True, True, pytest.approx(1.5))
    assert near.direction_error_deg < 2 and near.heading_error_deg < 1
    table = summarise(found).set_index("band")
    assert list(table[["pairs", "claimed", "right", "wrong"]].loc[NEAR]) == [1, 1, 1, 0]
    assert table.pairs[OTHER_ROOMS] == 2
    assert json.dumps(table.reset_index().to_dict(orient="records"), allow_nan=False)

    told = json.loads((tour / TOUR).read_text())
    placed = told["merger"]["floor_01"]["kitchen"]["part"]["pano_1"]["floor_plan_transformation"]
    placed["rotation"] += 30
    wrong = tmp_path / "wrong"
    shutil.copytree(tour, wrong)
    write(wrong, told)
    near = evaluate([wrong], [sift()], folder=tmp_path).iloc[0]
    assert (near.claims > 0, near.right) == (True, False)
    assert near.heading_error_deg == pytest.approx(30, abs=1)


def test_other_places_and_what_was_found_before(tour: Path, tmp_path: Path) -> None:
    """A plain folder is a place; two variants share a look; a second run looks at nothing."""
    looked: list[int] = []

    def look(panorama: object) -> int:
        looked.append(1)
        return len(looked)

    variants = [Variant(name, look, lambda a, b: Comparison((), None), lambda look: look)
                for name in ("one", "two")]  # fmt: skip
    places = [tour, tour / "panos"]
    found = evaluate(places, variants, folder=tmp_path)
    assert len(looked) == 6
    assert dict(found.band.value_counts()) == {NEAR: 2, OTHER_ROOMS: 4, ELSEWHERE: 18}
    again = evaluate(places, variants, folder=tmp_path)
    assert len(looked) == 6 and again.equals(found)
    table = summarise(found)
    assert not table[["claimed", "right", "wrong"]].to_numpy().any()
    assert set(table.band) < set(BANDS) and "different places" in as_text(table)
    evaluate(places, variants, folder=tmp_path, height_m=2.0)
    assert len(looked) == 12


def test_a_claim_across_places_is_wrong_whatever_its_pose(tour: Path, tmp_path: Path) -> None:
    """Told to be two places, one tour is claimed to be one."""
    found = evaluate([tour, tour], [sift()], folder=tmp_path)
    across = summarise(found).set_index("band").loc[ELSEWHERE]
    assert (across.pairs, across.right) == (9, 0)
    assert across.wrong == across.claimed >= 5


def test_what_is_no_tour_is_refused(tour: Path, tmp_path: Path) -> None:
    def refused(*folders: Path) -> str:
        with pytest.raises(ImageError) as found:
            evaluate(folders, [sift()], folder=tmp_path / "kept")
        return str(found.value)

    empty = tmp_path / "empty"
    empty.mkdir()
    assert f"holds {TOUR}" in refused(tour / "panos")
    assert "found none" in refused(tour, empty)
    told = json.loads((tour / TOUR).read_text())
    for wrong in ({}, {"merger": told["merger"]}, told | {"merger": {"floor_01": 1}}):
        write(empty, wrong)
        assert "ZInD's layout" in refused(empty)
    for text in ("{", "5", "[]"):
        (empty / TOUR).write_text(text)
        assert "expected a JSON object" in refused(empty)
    write(empty, told)
    assert "cannot read" in refused(empty)
    write(empty, told | {"scale_meters_per_coordinate": {"floor_01": None}})
    assert "found none" in refused(empty)
    hall = {"floor_01": {"hall": told["merger"]["floor_01"]["hall"]}}
    write(empty, told | {"merger": hall})
    assert "two panoramas" in refused(empty)
    assert not (tmp_path / "kept").exists()

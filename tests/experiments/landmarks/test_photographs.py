from pathlib import Path

import numpy as np
import pytest

from vrchain.errors import ImageError
from vrchain.experiments.landmarks import photographs
from vrchain.experiments.landmarks.photographs import CAMERA, choose, compare_folders, related_pairs
from vrchain.geometry import Pose
from vrchain.landmarks.matching.photos import PhotoConfig, claims_of
from vrchain.landmarks.training.examples import varied_suburb
from vrchain.panorama import encode_png
from vrchain.world.render import Renderer


def test_a_folder_without_photographs_is_named(tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    with pytest.raises(ImageError, match="empty: expected a folder of photographs"):
        compare_folders([tmp_path / "empty"])
    with pytest.raises(ImageError, match="nowhere"):
        compare_folders([tmp_path / "nowhere"])


@pytest.mark.slow
def test_pairs_are_counted_by_kind(tmp_path: Path) -> None:
    for place, seed in (("here", 0), ("there", 5)):
        scene = varied_suburb(1, seed)
        house = next(o for o in scene.objects if o.kind == "house")
        (tmp_path / place).mkdir()
        for k, azimuth in enumerate((0.3, 0.5)):
            away = np.array([np.cos(azimuth), np.sin(azimuth)])
            x_m, y_m = house.bounds_m.mean(axis=0)[:2] + 14 * away
            pose = Pose(float(x_m), float(y_m), azimuth + np.pi)
            view = Renderer(scene).render(pose, CAMERA).views[0]
            (tmp_path / place / f"{k}.png").write_bytes(encode_png(view))
    found = compare_folders([tmp_path / "here", tmp_path / "there"], rendered=1)
    by_kind = found.set_index("pairs")
    assert list(by_kind.index) == ["here", "there", "across", "beside rendered views"]
    assert list(by_kind.n) == [1, 1, 4, 4]
    assert list(by_kind.claimed) == [1, 1, 0, 0]


def test_folders_of_one_name_are_told_apart(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for place in ("a/across", "b/across"):
        (tmp_path / place).mkdir(parents=True)
    monkeypatch.setattr(photographs, "_photographs", lambda folder: [])
    folders = [tmp_path / "a" / "across", tmp_path / "b" / "across", tmp_path / "a" / "across"]
    found = compare_folders(folders, rendered=0)
    kinds = [*map(str, folders[:2]), "across", "beside rendered views"]
    assert list(found.pairs) == kinds


@pytest.mark.slow
def test_settings_are_judged_by_related_and_unrelated_views() -> None:
    found = choose(suburbs=2)
    assert len(found) == 8 and (found.unrelated_claimed <= 0.1).all()
    assert found.related_claimed.is_monotonic_decreasing
    assert (found.min_inliers >= 8).all()


@pytest.mark.slow
def test_views_of_one_building_are_claimed_more_often_than_not() -> None:
    pairs = list(related_pairs(1))
    assert len(pairs) == 16 and pairs[0][0].size_px == (CAMERA.height_px, CAMERA.width_px)
    assert sum(bool(claims_of(a, b, PhotoConfig())) for a, b in pairs) > 8

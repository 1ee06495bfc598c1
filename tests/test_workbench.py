"""The steps of a notebook: as the modules do them that they call, of whatever they are given."""

from pathlib import Path

import numpy as np
import pytest
from sights import look
from worlds import yard

import vrchain as vr
from vrchain.errors import ImageError, VRChainError
from vrchain.experiments.reproduction.results import Results
from vrchain.homing import snapshot, step
from vrchain.panorama import encode_png
from vrchain.plots.scripts import FigureError

POSES = vr.Pose(0, 0, 0.3), vr.Pose(3, 1, -2.0)


def test_panoramas_folders_and_photographs_are_compared(tmp_path: Path) -> None:
    a, b = (look(pose) for pose in POSES)
    found = vr.common_landmarks(a, b, "sift")
    assert found.claims and found.rig == a.rig and len(found.table()) == len(found.claims)
    for name, panorama in (("a", a), ("b", b)):
        (tmp_path / name).mkdir()
        panorama.save(tmp_path / name)
        (tmp_path / f"{name}.png").write_bytes(encode_png(panorama.cylinder))
    again = vr.common_landmarks(tmp_path / "a", str(tmp_path / "b"), "sift")
    assert [c.score for c in again.claims] == [c.score for c in found.claims]
    photographs = vr.common_landmarks(tmp_path / "a.png", tmp_path / "a.png")
    assert photographs.claims and photographs.rig is None
    for shown in (found, photographs):
        assert shown.figure("here", "there").axes[0].get_title(loc="left") == "here"
    with pytest.raises(ImageError, match="no truth is known"):
        photographs.judged(vr.GroundTruth(yard()), POSES)
    with pytest.raises(ImageError, match="got one of each"):
        vr.common_landmarks(a, tmp_path / "b.png")


def test_why_tells_each_stage_of_panoramas_and_of_files(tmp_path: Path) -> None:
    a, b = (look(pose) for pose in POSES)
    told = vr.why(a, b)
    assert told.index[0] == "proposed" and told.index[-1] == "answer"
    (tmp_path / "a.png").write_bytes(encode_png(a.cylinder))
    photographs = vr.why(tmp_path / "a.png", tmp_path / "a.png")
    assert list(photographs.index) == ["found", "match", "agree", "answer"]
    with pytest.raises(ImageError, match="got one of each"):
        vr.why(a, tmp_path / "a.png")


def test_a_database_is_loaded_with_its_poses(tmp_path: Path) -> None:
    for name, pose in zip("ab", POSES, strict=True):
        (tmp_path / f"{name}.jpg").write_bytes(vr.equirectangular_jpeg(look(pose)))
    rows = [
        f"{n}.jpg,{p.x_m},{p.y_m},{np.degrees(p.yaw_rad)}"
        for n, p in zip("ba", POSES[::-1], strict=True)
    ]
    (tmp_path / "poses.csv").write_text("\n".join(["filename,x_m,y_m,heading_deg", *rows]))
    loaded = vr.load_database(tmp_path, vr.Source(camera_height_m=1.4))
    for (pose, panorama), expected in zip(loaded, POSES[::-1], strict=True):
        assert pose.distance_to_m(expected.xy_m) == 0
        assert pose.yaw_rad == pytest.approx(expected.yaw_rad)
        assert panorama.rig == loaded[0][1].rig and panorama.rig.camera_height_m == 1.4
    with pytest.raises(ImageError, match="no floor 2"):
        vr.load_database(tmp_path, floor="2")


def test_home_is_where_the_named_method_says() -> None:
    here, home = (look(pose) for pose in POSES)
    for method in ("epipolar", "warping"):
        expected = step(method, snapshot(here), snapshot(home), 0.1)
        assert vr.home_vector(here, home, method, heading_rad=0.1) == expected
    assert vr.home_vector(here, home) is not None
    with pytest.raises(VRChainError, match="expected a homing method"):
        vr.home_vector(here, home, "magic")


def test_results_that_are_there_are_taken(
    smoke_results: Results, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Results, "here", lambda profile=None: smoke_results)
    assert vr.reproduced("smoke").folder == smoke_results.folder
    drawn = vr.figure("update_time", vr.reproduced("smoke"))
    assert drawn.axes and np.isfinite(drawn.get_size_inches()).all()
    with pytest.raises(FigureError, match="got 'nothing'"):
        vr.figure("nothing", smoke_results)

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

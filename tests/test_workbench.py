"""The steps of a notebook: as the modules do them that they call, of whatever they are given."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ledgers import KEYS, small_ledger
from sights import look
from worlds import yard

import vrchain as vr
from vrchain import workbench
from vrchain.errors import ImageError, VRChainError
from vrchain.experiments.reproduction.results import Results
from vrchain.homing import snapshot, step
from vrchain.ledger import Ledger
from vrchain.ledger.network import watching
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


def test_what_has_nothing_in_common_is_judged_in_the_same_columns() -> None:
    a, b = (look(pose) for pose in POSES)
    found = vr.common_landmarks(a, b, "sift")
    nothing = replace(found, comparison=replace(found.comparison, common=()))
    some, none = (each.judged(vr.GroundTruth(yard()), POSES) for each in (found, nothing))
    assert len(some) == len(found.claims) and none.empty
    assert list(none.columns) == list(some.columns)
    kinds = ["right", "twin", "duplicate", "quality_m"]
    assert none[kinds].dtypes.equals(some[kinds].dtypes)
    left = none[~none.duplicate]
    assert left.right.sum() == 0 and np.isnan(left.quality_m.median())
    assert nothing.comparison.relative_pose is None and nothing.table().empty


def test_why_tells_each_stage_of_panoramas_and_of_files(tmp_path: Path) -> None:
    a, b = (look(pose) for pose in POSES)
    told = vr.why(a, b)
    assert told.index[0] == "proposed" and told.index[-1] == "answer"
    (tmp_path / "a.png").write_bytes(encode_png(a.cylinder))
    photographs = vr.why(tmp_path / "a.png", tmp_path / "a.png")
    assert list(photographs.index) == ["found", "match", "agree", "answer"]
    with pytest.raises(ImageError, match="got one of each"):
        vr.why(a, tmp_path / "a.png")


def test_a_ledger_is_watched_as_it_changes_and_the_last_view_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    views: list[workbench.Watched] = []
    monkeypatch.setattr(workbench, "_shown", lambda: views.append)
    small_ledger(tmp_path / "ledger")
    (tmp_path / "ledger" / "outbox").mkdir()
    (tmp_path / "ledger" / "outbox" / "R1.00000000000000000002.offer").write_bytes(b"")
    news, looks = watching.news_of, iter(range(10_000))

    def another_publishes(ledger: Ledger) -> list[watching.News]:
        if next(looks) == 1:
            with Ledger.open(tmp_path / "ledger", writable=True) as writer:
                sent = writer.draft_transaction("R1", b"payload", "view", 60).signed(KEYS["R1"])
                entry, _ = writer.make((sent,), "R1", KEYS["R1"])
                writer.take(entry, {sent.payload_digest: b"payload"})
        said = {"member": "R2", "height": 3, "waiting": 2, "refused": 0, "alarms": 0}
        return [(said, ""), *news(ledger)]

    monkeypatch.setattr(watching, "news_of", another_publishes)
    seen = vr.watch(tmp_path / "ledger", seconds=0.5, newest=3)
    assert list(seen.blocks.height) == [4, 5, 6] and list(seen.blocks.author) == ["R3", "R1", "R1"]
    assert seen.members.to_dict("records") == [
        {"member": "R2", "height": 3, "behind": 3, "waiting": 2, "refused": 0, "alarms": 0}
    ]
    assert seen.notes == ("waiting: 1",) and "R2" in repr(seen)
    assert [list(view.blocks.height) for view in views[:2]] == [[3, 4, 5], [4, 5, 6]]
    assert repr(views[-1]) == repr(seen) and "<table" in seen._repr_html_()
    monkeypatch.undo()
    assert list(vr.watch(tmp_path / "ledger", seconds=0).blocks.height) == [0, 1, 2, 3, 4, 5, 6]


def test_a_view_is_shown_where_a_notebook_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("IPython")
    view = workbench._watched([], [{"trouble": "<no> answer"}], 0)
    workbench._shown()(view)  # nothing runs: nothing is shown
    shown: list[object] = []
    monkeypatch.setattr("IPython.get_ipython", lambda: object())
    handle = type("Handle", (), {"update": staticmethod(shown.append)})
    monkeypatch.setattr("IPython.display.display", lambda *given, **options: handle)
    workbench._shown()(view)
    assert shown == [view] and "trouble: &lt;no&gt; answer" in view._repr_html_()


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
    with pytest.raises(VRChainError, match="no homing method"):
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

"""``vrchain bag`` as a user calls it."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import pytest

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from recordings import Row, changed, recording, stamped, write

from vrchain.cli import main
from vrchain.ledger import verify
from vrchain.paths import SCENES


def call(*words: object, status: int = 0) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sys, "argv", ["vrchain", *map(str, words)])
        with pytest.raises(SystemExit) as ended:
            main()
    assert (ended.value.code or 0) == status


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    return write(recording(), tmp_path / "bag")


def test_what_is_in_a_bag(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    call("bag", "info", bag, "--json")
    told = json.loads(capsys.readouterr().out)
    robot = told["robots"]["R1"]
    assert robot["exact"] and robot["moments"] == 12 and len(robot["cameras"]) == 8
    rows = {row["topic"]: row for row in told["topics"]}
    assert rows["/R1/odom"]["messages"] == 120 and rows["/R1/odom"]["rate_hz"] == 10
    call("bag", "info", bag, "--robot", "R7=/R7")
    assert "R7=/R7: R7: no topic begins with /R7/" in capsys.readouterr().out
    call("bag", "info", bag)
    assert "R1=/R1: 12 moments, 7.1 m by odometry; 8 views" in capsys.readouterr().out


def test_of_what_cannot_be_published_info_says_so_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its odometry is of another hour."""

    def later(row: Row) -> Row:
        then_ns = row.received_ns + 3600 * 10**9
        return stamped(replace(row, received_ns=then_ns), then_ns)

    bag = write(changed(recording(), "odom", later), tmp_path / "bag")
    call("bag", "info", bag)
    lacks = "no moment has both pictures and odometry within 1 s of them"
    assert f"R1=/R1: {lacks}" in capsys.readouterr().out
    call("ledger", "init", tmp_path / "team", "--member", "R1", "--keys", tmp_path / "keys")
    asked = ("--robot", "R1=/R1", "--keys", tmp_path / "keys", "--no-landmarks")
    call("bag", "publish", bag, tmp_path / "team", *asked, status=1)
    assert f"R1: {lacks}" in capsys.readouterr().err


def test_a_bag_into_a_ledger(bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ledger, keys = tmp_path / "team", tmp_path / "keys"
    call("ledger", "init", ledger, "--member", "R1", "--keys", keys)
    asked = ("bag", "publish", bag, ledger, "--robot", "R1=/R1", "--keys", keys, "--no-landmarks")
    capsys.readouterr()
    call(*asked, "--json")
    told = json.loads(capsys.readouterr().out)
    assert [p["rule"] for p in told["robots"]["R1"]["published"]] == ["start", "view", "view"]
    call(*asked)
    assert "done before, published nothing new" in capsys.readouterr().out
    assert verify(ledger).ok


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("LEDGER", "--robot", "R1=/R1"), "name the ledger last"),
        (("BAG", "LEDGER"), "expected --robot NAME=/NAMESPACE, got none"),
        (("BAG", "LEDGER", "--robot", "R1"), "expected --robot NAME=/NAMESPACE"),
        (("BAG", "LEDGER", "--robot", "R1=/R1", "--robot", "R1=/R2"), "each name once"),
        (("BAG", "nowhere", "--robot", "R1=/R1", "--no-landmarks"), "nowhere"),
        (("BAG", "LEDGER", "--robot", "R2=/R1", "--no-landmarks"), "R2.pem"),
        (("none.bag", "LEDGER", "--robot", "R1=/R1", "--no-landmarks"), "none.bag"),
    ],
)
def test_bad_input_is_one_line(
    words: tuple[str, ...],
    said: str,
    bag: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    ledger, keys = tmp_path / "team", tmp_path / "keys"
    call("ledger", "init", ledger, "--member", "R1", "--keys", keys)
    capsys.readouterr()
    given = {"BAG": str(bag), "LEDGER": str(ledger)}
    call("bag", "publish", *(given.get(w, w) for w in words), "--keys", keys, status=1)
    err = capsys.readouterr().err
    assert said in err and err.count("\n") == 1


def test_pictures_of_which_none_can_be_read_are_an_error(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ledger, keys, rig = tmp_path / "team", tmp_path / "keys", tmp_path / "rig.yaml"
    call("ledger", "init", ledger, "--member", "R1", "--keys", keys)
    camera = "{topic: camera_0/image_raw, resolution: [64, 48], intrinsics: [60, 60, 32, 24]}"
    rig.write_text(f"camera_height_m: 1.0\ncameras: [{camera}]\n")
    words = ("--robot", "R1=/R1", "--no-landmarks", "--keys", keys, "--rig", rig)
    capsys.readouterr()
    call("bag", "publish", bag, ledger, *words, status=1)
    assert "no picture of R1 could be read: " in capsys.readouterr().err


def test_a_recording_of_before_what_was_published_is_not_said_to_be_done(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    ledger, keys = tmp_path / "team", tmp_path / "keys"
    call("ledger", "init", ledger, "--member", "R1", "--keys", keys)
    call("ledger", "append", ledger, "R1", __file__, "--keys", keys)
    words = ("--robot", "R1=/R1", "--no-landmarks", "--keys", keys)
    capsys.readouterr()
    call("bag", "publish", bag, ledger, *words, status=1)
    err = capsys.readouterr().err
    assert "older than its newest transaction" in err and "in the order of time" in err


def test_a_patrol_as_a_bag(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spec = SCENES / "barn.yaml"
    call("bag", "export", spec, "-o", tmp_path / "out", "--seconds", 3, "--robots", 1, "--json")
    told = json.loads(capsys.readouterr().out)
    assert told["robots"] == ["R1"] and [p["rule"] for p in told["published"]] == ["start"]
    call("bag", "info", tmp_path / "out" / told["bag"], "--json")
    assert json.loads(capsys.readouterr().out)["robots"]["R1"]["exact"]
    call("bag", "export", spec, "-o", tmp_path / "no", "--form", "tape", status=1)
    assert "expected a bag's form of mcap, sqlite3, ros1" in capsys.readouterr().err
    assert not (tmp_path / "no").exists()


def test_what_is_lacking_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bare = write(changed(recording(), "camera", lambda row: None), tmp_path / "bare")
    call("bag", "info", bare, "--robot", "R1=/R1")
    assert "R1: no pictures were recorded under /R1/" in capsys.readouterr().out

"""``vrchain ledger``: readable text or one JSON object; one line and status 1 on errors."""

import json
import os
import shlex
import stat
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from typer.testing import CliRunner

from vrchain.cli.ledger import app
from vrchain.errors import ImageError, OutputError, VRChainError
from vrchain.ledger import Ledger, errors, simulated_key
from vrchain.panorama import CameraRig, Panorama, read_image
from vrchain.seeding import generator


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "payload").write_bytes(b"bytes")
    return tmp_path


def text(*arguments: object) -> str:
    """What a command prints; what it raises for people to read is raised here too."""
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    if isinstance(result.exception, VRChainError):
        assert result.stdout == "" or "--json" in arguments
        raise result.exception
    assert result.exit_code == 0, result.output
    assert result.stderr == ""
    return result.stdout


def answer(*arguments: object) -> dict[str, Any]:
    """The one JSON object that a command prints."""
    found = json.loads(text(*arguments, "--json"))
    assert isinstance(found, dict)
    return found


def everything(folder: Path) -> list[Path]:
    """All paths but those of SQLite's working files, which readers make too."""
    return sorted(p for p in folder.rglob("*") if not p.name.endswith(("-wal", "-shm")))


ODD = "yard\nkeys     live\x1b[2K\u202e\u0000"


def test_nothing_from_a_ledger_fakes_a_line() -> None:
    """Names with line ends, escapes or turned writing are refused; an old ledger's is spelt out."""
    with pytest.raises(errors.RecordError, match="printable") as refused:
        text("init", "L", "--name", ODD, "--keys", "keys")
    assert str(refused.value).isprintable() and not Path("L").exists()
    operator = simulated_key(0, "operator")
    with patch("vrchain.ledger.rules.chain.check_new_name"):
        Ledger.create("L", {}, operator, name=ODD).close()
    first, *others = text("show", "L").splitlines()
    assert first.endswith(" yard\\nkeys     live\\x1b[2K\\u202e\\x00")
    assert [line[:5] for line in others] == ["head ", "keys "]
    assert others[1] == "keys     insecure: simulated"
    assert answer("show", "L")["name"] == ODD
    assert answer("verify", "L")["ok"]


def test_a_clock_that_is_far_ahead_writes_nothing() -> None:
    """What it signed could not be followed by anything for years."""
    text("init", "L", "--member", "R1", "--member", "R2")
    text("append", "L", "R1", "payload")
    ahead_ns = time.time_ns() + 31 * 86_400_000_000_000
    with patch("time.time_ns", return_value=ahead_ns):
        text("append", "L", "R1", "payload", "--clock-is-right")  # the ledger has rested
    assert answer("show", "L")["timestamp_ns"] == ahead_ns
    with pytest.raises(errors.TimeOrderError, match="expel the robot and enrol"):
        text("append", "L", "R1", "payload")
    for command in ("append L R1 payload", "enroll L R3", "expel L R2", "drop L --keep 1"):
        later = patch("time.time_ns", return_value=ahead_ns * 2)
        with later, pytest.raises(errors.ClockSkewError, match="set the clock"):
            text(*command.split())
    assert answer("show", "L")["height"] == 2
    assert not any(path.name == "R3.pem" for path in Path("config").rglob("*"))


@pytest.mark.parametrize("written", [True, False])
def test_a_key_stays_where_its_robot_may_be_enrolled(written: bool) -> None:
    """Without an answer nobody knows whether it is, and its name cannot be used again."""
    keys = Path(answer("init", "L", "--member", "R1")["keys"])

    def enrol(*asked: object, enrol: Callable[..., object] = Ledger.enrol) -> None:
        if written:
            enrol(*asked)
        raise errors.UnavailableError("no answer") if written else errors.StorageFullError("full")

    with patch.object(Ledger, "enrol", enrol), pytest.raises(errors.LedgerError):
        text("enroll", "L", "R3")
    assert (keys / "R3.pem").exists() == written == ("R3" in answer("show", "L")["robots"])


def test_an_export_replaces_nothing_that_it_reads_or_writes() -> None:
    """An earlier export beside the ledger: the ledger went with it."""
    Path("out").mkdir()
    Path("out/pictures.json").write_text("{}")
    answer("init", "out/L", "--member", "R1")
    for words in (["--pictures", "out"], ["-o", "new/L.jsonl", "--pictures", "new"]):
        with pytest.raises(OutputError, match="which is replaced: choose another -o"):
            text("export", "out/L", *words)
    assert answer("verify", "out/L")["ok"] and not Path("new").exists()


def test_from_init_to_export() -> None:
    made = answer("init", "L", "--member", "R1", "--member", "R2", "--name", "demo")
    assert made["members"] == ["R1", "R2"]
    keys = Path(made["keys"])
    assert sorted(path.name for path in keys.iterdir()) == ["R1.pem", "R2.pem", "operator.pem"]
    assert all(stat.S_IMODE(path.stat().st_mode) == 0o600 for path in keys.iterdir())
    first = answer("append", "L", "R1", "payload")
    assert (first["robot"], first["sequence"], first["reason"]) == ("R1", 0, "start")
    assert answer("append", "L", "R1", "payload")["reason"] == "time"
    assert answer("append", "L", "R1", "payload", "--reason", "view")["sequence"] == 2
    assert answer("enroll", "L", "R3")["height"] == 4
    last = answer("append", "L", "R3", "payload")

    shown = answer("show", "L")
    assert (shown["name"], shown["height"], shown["head"]) == ("demo", 5, last["head"])
    assert (shown["ledger_id"], shown["insecure"]) == (made["ledger_id"], False)
    assert shown["robots"]["R2"] is None
    assert shown["robots"]["R3"]["id"] == last["id"]
    good = {"ok": True, "blocks": 6, "first_bad_block": None, "reason": ""}
    assert answer("verify", "L") == good
    assert answer("verify", "L", "--expected-head", last["head"]) == good

    assert answer("export", "L", "-o", "L.jsonl") == {"file": "L.jsonl", "blocks": 6}
    lines = [json.loads(line) for line in Path("L.jsonl").read_text().splitlines()]
    assert [line["height"] for line in lines] == list(range(6))
    assert lines[-1]["hash"] == last["head"]
    assert lines[-1]["newest"] == {
        robot: row["id"] if row else None for robot, row in shown["robots"].items()
    }
    assert [line["records"][0]["kind"] for line in lines] == [
        "genesis", *["transaction"] * 3, "enrolment", "transaction"
    ]  # fmt: skip
    stored = b"".join(p.read_bytes() for p in Path("L").rglob("*") if p.is_file())
    stored += Path("L.jsonl").read_bytes()
    secrets = [path.read_bytes().splitlines()[1] for path in keys.iterdir()]
    assert not any(secret in stored for secret in [*secrets, b"PRIVATE"])


def test_the_folder_of_a_panorama_is_published_as_robots_do() -> None:
    pytest.importorskip("torch", reason="proposals need torch (extra `learned`)")
    from vrchain.landmarks.extraction.record import encode_record, examine

    rig = CameraRig(n_views=4, width_px=96, height_px=64, field_of_view_deg=100.0)
    views = generator(0, "a panorama").integers(0, 256, (4, 64, 96, 3), dtype=np.uint8)
    seen = Panorama(rig, views)
    Path("seen").mkdir()
    seen.save(Path("seen"))
    text("init", "L", "--member", "R1")
    text("append", "L", "R1", "seen")
    assert answer("verify", "L", "--landmarks")["landmark_records"] == 1
    text("append", "L", "R1", "seen", "--landmarks", "payload")
    with pytest.raises(errors.DamagedError, match="R1's newest landmark record is not what its"):
        text("verify", "L", "--landmarks")
    text("verify", "L")  # whoever trusts a member's landmarks is not told otherwise
    Path("payload").write_bytes(b"")
    text("append", "L", "R1", "seen", "--landmarks", "payload")
    with Ledger.open("L") as ledger:
        first, last, bare = ledger.history("R1")
        assert ledger.payload(first.payload_digest) == seen.encode()
        as_others_see = Panorama.decode(seen.encode())
        assert ledger.payload(first.landmarks_digest) == encode_record(examine(as_others_see))
        assert last.payload_digest == first.payload_digest
        assert ledger.payload(last.landmarks_digest) == b"bytes"
        assert ledger.payload(bare.landmarks_digest) == b""  # what was given, and no other


def test_text_for_people() -> None:
    assert "keep them safe" in text("init", "L", "--member", "R1", "--member", "R2")
    assert "transaction 0 of R1 in block 1" in text("append", "L", "R1", "payload")
    assert "enrolled R3" in text("enroll", "L", "R3")
    shown = text("show", "L").splitlines()
    assert shown[1].startswith("head     block 2, ")
    assert shown[3].startswith("R1       transaction 0, start, ")
    assert shown[4] == "R2       nothing yet"
    assert text("verify", "L") == "L: all 3 blocks are good\n"
    assert text("export", "L", "-o", "out") == "wrote 3 blocks to out\n"


def test_verify_names_the_block_and_fails() -> None:
    text("init", "L", "--member", "R1")
    text("append", "L", "R1", "payload")
    next(path for path in Path("L/blobs").rglob("*") if path.is_file()).write_bytes(b"Bytes")
    with pytest.raises(errors.DamagedError, match="block 1: the payload"):
        text("verify", "L")
    result = CliRunner().invoke(app, ["verify", "L", "--json"])
    assert result.exit_code == 1
    found = json.loads(result.stdout)
    assert (found["ok"], found["blocks"], found["first_bad_block"]) == (False, 1, 1)
    assert "payload" in found["reason"]


@pytest.mark.parametrize(("name", "forbidden"), [("L", os.W_OK), ("ledger.sqlite", os.R_OK)])
def test_what_may_not_be_read_is_told_apart_from_damage(name: str, forbidden: int) -> None:
    """Permissions as another user would meet them: the tests may run as root."""
    text("init", "L", "--member", "R1")
    text("clean", "L")  # a writer takes SQLite's working files along
    access = patch("os.access", lambda path, mode: Path(path).name != name or not forbidden & mode)
    for command in ("show", "verify", "clean"):
        with access, pytest.raises(errors.AccessError, match="expected"):
            text(command, "L")


def test_expel_drop_and_clean() -> None:
    text("init", "L", "--member", "R1", "--member", "R2")
    Path("seen").write_bytes(b"landmarks")
    first = answer("append", "L", "R1", "payload", "--landmarks", "seen")
    assert first["landmarks_digest"] != first["payload_digest"]
    assert first["previous"] is None
    Path("payload").write_bytes(b"more")
    assert answer("append", "L", "R1", "payload")["previous"] == first["id"]
    dropped = answer("drop", "L", "--keep", "1")
    assert (dropped["dropped"], dropped["height"]) == (2, 3)
    assert "dropped from L: 0" in text("drop", "L", "--keep", "1")
    expelled = answer("expel", "L", "R2")
    assert (expelled["name"], expelled["height"]) == ("R2", 4)
    with pytest.raises(errors.ExpelledMemberError):
        text("append", "L", "R2", "payload")
    with pytest.raises(errors.ExpelledMemberError):
        text("enroll", "L", "R2")
    (Path("L/blobs") / ("ab" * 32)).write_bytes(b"orphan")
    assert answer("clean", "L") == {"removed": 1}
    assert text("clean", "L") == "removed 0 files from L\n"
    found = answer("verify", "L")
    assert (found["ok"], found["blocks"], found["dropped"]) == (True, 5, 2)
    assert "operator signed: 2" in text("verify", "L")
    assert answer("show", "L")["robots"].keys() == {"R1"}


def test_the_panoramas_as_pictures() -> None:
    text("init", "L", "--member", "R1")
    views = np.arange(6 * 48 * 64 * 3, dtype=np.uint64).reshape(6, 48, 64, 3).astype(np.uint8)
    panorama = Panorama(CameraRig(n_views=6, width_px=64, height_px=48), views)
    for blob in (panorama.encode(), b"no panorama", Panorama(panorama.rig, 255 - views).encode()):
        Path("payload").write_bytes(blob)
        text("append", "L", "R1", "payload")
    made = answer("export", "L", "--pictures", "shown")
    assert (made["pictures"], made["others"], made["dropped"]) == (2, 1, 0)
    names = ["R1_0000_start.png", "R1_0002_time.png", "pictures.json"]
    assert sorted(path.name for path in Path("shown").iterdir()) == names
    assert read_image(Path("shown") / names[0]).shape == panorama.cylinder.shape
    rows = json.loads(Path("shown/pictures.json").read_text())
    assert [(row["file"], row["sequence"]) for row in rows] == [(names[0], 0), (names[1], 2)]
    text("drop", "L", "--keep", "1")
    both = answer("export", "L", "--pictures", "shown", "-o", "L.jsonl")
    assert (both["blocks"], both["pictures"], both["others"], both["dropped"]) == (5, 1, 0, 2)
    assert "dropped: 2" in text("export", "L", "--pictures", "shown")


def test_keys_where_they_are_asked_for() -> None:
    text("init", "L", "--member", "R1", "--member", "R2", "--keys", "keys")
    assert Path("keys/R1.pem").is_file()
    assert not Path("config").exists()
    text("append", "L", "R1", "payload", "--keys", "keys")
    with pytest.raises(errors.KeyFileError, match="No such file"):
        text("append", "L", "R1", "payload")
    Path("keys/R2.pem").replace("keys/R1.pem")
    with pytest.raises(errors.SignatureError):
        text("append", "L", "R1", "payload", "--keys", "keys")


BAD_INPUT = {
    "init L": errors.LedgerExistsError,
    "init payload": errors.LedgerExistsError,
    "init .": errors.KeyFileError,  # the keys' usual folder lies below
    "init new --member 'a b'": errors.RecordError,
    "init new --member operator": errors.RecordError,
    "init new --member R1 --member R1": errors.DuplicateMemberError,
    "init new --keys new/keys": errors.KeyFileError,
    "init new --keys L/keys": errors.KeyFileError,
    "init new --keys payload": errors.KeyFileError,
    "enroll L R1": errors.DuplicateMemberError,
    "enroll L ../R1": errors.RecordError,
    "enroll L R2 --keys nowhere": errors.KeyFileError,
    "append L R2 payload": errors.UnknownMemberError,
    "append L R1 missing": errors.PayloadFileError,
    "append L R1 L": ImageError,
    "append L R1 payload --reason why": errors.RecordError,
    "show missing": errors.NotALedgerError,
    "verify .": errors.NotALedgerError,
    "verify L --expected-head xy": errors.RecordError,
    "verify L --expected-head ''": errors.RecordError,  # of a variable not set
    f"verify L --expected-head {'00' * 32}": errors.DamagedError,
    "export L -o L/out": errors.RecordError,
    "export L -o config": OutputError,
    "export missing -o config": OutputError,  # told before anything is read
    "export missing --pictures payload": OutputError,
    "export missing -o out": errors.NotALedgerError,
    "export L": errors.RecordError,
    "export L --pictures L/shown": errors.RecordError,
    "export L --pictures payload": OutputError,
    "expel L R9": errors.UnknownMemberError,
    "expel L R1 --keys nowhere": errors.KeyFileError,
    "drop L --keep 1 --keys nowhere": errors.KeyFileError,
    "clean missing": errors.NotALedgerError,
}


@pytest.mark.parametrize("line", BAD_INPUT)
def test_bad_input_is_one_line_and_changes_nothing(home: Path, line: str) -> None:
    text("init", "L", "--member", "R1")
    before = everything(home)
    with pytest.raises(BAD_INPUT[line]) as raised:
        text(*shlex.split(line))
    assert "\n" not in str(raised.value)
    assert everything(home) == before
    with Ledger.open("L") as ledger:
        assert ledger.head.height == 0


@pytest.mark.parametrize("is_made", [True, False])
def test_an_interrupt_keeps_the_keys_of_a_ledger_that_is_there(is_made: bool, home: Path) -> None:
    """Else nobody could ever sign in it; those of none are taken back."""
    create = Ledger.create

    def interrupted(*given: Any, **more: Any) -> Ledger:
        if is_made:
            create(*given, **more).close()
        raise KeyboardInterrupt

    with patch("vrchain.cli.ledger.Ledger.create", interrupted):
        done = CliRunner().invoke(app, ["init", "L", "--member", "R1", "--keys", "keys"])
    assert done.exit_code != 0 and (home / "L").exists() == is_made
    kept = sorted(path.name for path in home.glob("keys/*"))
    assert kept == (["R1.pem", "operator.pem"] if is_made else [])

"""The command line as a user calls it: what it prints, how it fails, and what it leaves behind."""

import contextlib
import hashlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from worlds import ROOT

from vrchain.cli import main
from vrchain.panorama import Panorama
from vrchain.paths import SCENES
from vrchain.world import load_scene

SUBURB = SCENES / "suburb.yaml"
BARN = SCENES / "barn.yaml"  # built in a fifth of the time
CROSSING = SCENES / "crossing" / "crossing.world"  # in less
COMMAND = [sys.executable, "-c", "from vrchain.cli import main; main()"]
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT), "PYOPENGL_PLATFORM": "egl"}


def call(*arguments: object, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
    """A fresh process that runs ``vrchain`` with these arguments."""
    return subprocess.run(
        [*COMMAND, *map(str, arguments)],
        cwd=cwd,
        env=ENVIRONMENT,
        capture_output=True,
        text=True,
        check=False,
    )


def answer(*arguments: object) -> dict:
    """The one JSON object that a command prints."""
    return json.loads(good(call(*arguments, "--json")).stdout)


def good(done: subprocess.CompletedProcess[str]) -> subprocess.CompletedProcess[str]:
    assert done.returncode == 0, done.stderr
    return done


Here = Callable[..., subprocess.CompletedProcess[str]]
Refused = Callable[..., str]


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Iterator[Here]:
    """As ``call``, in this process: starting one takes seconds."""

    def call_here(*arguments: object, cwd: Path | None = None) -> subprocess.CompletedProcess[str]:
        monkeypatch.setattr(sys, "argv", ["vrchain", *map(str, arguments)])
        with contextlib.chdir(cwd or Path.cwd()), pytest.raises(SystemExit) as ended:
            main()
        status = ended.value.code or 0
        assert isinstance(status, int)
        return subprocess.CompletedProcess(sys.argv, status, *capfd.readouterr())

    monkeypatch.setattr(warnings, "showwarning", warnings.showwarning)  # main sets it
    interrupts = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)}  # and these
    yield call_here
    for number, interrupt in interrupts.items():
        signal.signal(number, interrupt)


@pytest.fixture
def refused(here: Here) -> Refused:
    """The one line by which a command refuses."""

    def call_here(*arguments: object, cwd: Path | None = None) -> str:
        done = here(*arguments, cwd=cwd)
        assert done.returncode != 0
        assert done.stdout == ""
        assert done.stderr.startswith("vrchain: ") and done.stderr.count("\n") == 1, done.stderr
        return done.stderr

    return call_here


def everything(folder: Path) -> dict[str, str]:
    """Every file below a folder with the digest of its bytes."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


@pytest.fixture
def image(tmp_path: Path) -> Path:
    """A picture with something in it, in a folder of its own."""
    draws = np.random.default_rng(3).integers(0, 256, (24, 32, 3), dtype=np.uint8)
    path = tmp_path / "given" / "picture.png"
    path.parent.mkdir()
    cv2.imwrite(str(path), np.kron(draws, np.ones((20, 20, 1), dtype=np.uint8)))
    return path


# Bad input: one line, and nothing written.


def test_pictures_that_are_compared_are_not_written_over(
    image: Path, tmp_path: Path, refused: Refused
) -> None:
    before = everything(tmp_path)
    (tmp_path / "link.png").symlink_to(image)
    assert "expected two pictures" in refused("landmarks", image)
    assert "--why draws nothing" in refused("landmarks", image, image, "--why", "-o", image)
    assert "one of the pictures" in refused("landmarks", image, image, "-o", image)
    assert "plain file" in refused("landmarks", image, image, "-o", tmp_path / "link.png")
    assert "ends in .png" in refused("landmarks", image, image, "-o", tmp_path / "out.jpg")
    for name in ("none", ":", "os:path", "..up:side"):
        assert "cnn+sift, no spots" in refused("landmarks", image, image, "--variant", name)
    (tmp_path / "link.png").unlink()
    assert everything(tmp_path) == before


def test_an_unknown_scene_key(tmp_path: Path, refused: Refused) -> None:
    spec = tmp_path / "scene.yaml"
    spec.write_text(SUBURB.read_text() + "\nrivers:\n  count: 2\n")
    said = refused("panorama", spec, "--at", 10, 0, 0, "-o", tmp_path / "out")
    assert "rivers" in said and "houses" in said  # what came, and what is known
    refused("scene", "map", spec, "-o", tmp_path / "map.png")
    refused("navigate", spec, "-o", tmp_path / "out")
    assert list(tmp_path.iterdir()) == [spec]


def test_a_pose_inside_something_or_off_the_map(tmp_path: Path, refused: Refused) -> None:
    table = load_scene(BARN).table
    barn = table[table.kind == "barn"].iloc[0]
    at = (f"{barn.centre_x_m:.2f}", f"{barn.centre_y_m:.2f}", 0)
    assert repr(barn["name"]) in refused("panorama", BARN, "--at", *at, "-o", tmp_path / "out")
    said = refused("panorama", BARN, "--at", 300, 0, 0, "-o", tmp_path / "out")
    assert "off the map" in said and "-44.6..44.6" in said
    assert "finite" in refused("panorama", BARN, "--at", "nan", 0, 0, "-o", tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("kind", ["missing", "text", "empty", "blank", "folder"])
def test_an_image_that_is_none(kind: str, image: Path, tmp_path: Path, refused: Refused) -> None:
    bad = tmp_path / "given" / "bad.png"
    if kind == "text":
        bad.write_text("not a picture")
    elif kind == "empty":
        bad.touch()
    elif kind == "blank":
        cv2.imwrite(str(bad), np.full((300, 400, 3), 128, dtype=np.uint8))
    elif kind == "folder":
        bad.mkdir()
    out = tmp_path / "out.png"
    said = refused("landmarks", image, bad, "-o", out)
    assert ("blank" in said) if kind == "blank" else ("bad.png" in said)
    refused("landmarks", bad, image, "-o", out)
    assert [path.name for path in tmp_path.iterdir()] == ["given"]


def test_a_folder_that_is_no_ledger(tmp_path: Path, refused: Refused) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "letter.txt").write_text("dear")
    before = everything(tmp_path)
    for arguments in (
        ("verify", "folder"),
        ("show", "folder"),
        ("show", "nowhere"),
        ("export", "folder", "-o", "lines"),
        ("append", "folder", "R1", "folder/letter.txt"),
    ):
        assert "expected a ledger" in refused("ledger", *arguments, cwd=tmp_path)
    assert everything(tmp_path) == before


def test_a_folder_of_something_else_is_not_written_over(tmp_path: Path, refused: Refused) -> None:
    (tmp_path / "letters").mkdir()
    (tmp_path / "letters" / "letter.txt").write_text("dear")
    for arguments in (("panorama", BARN, "--at", 10, 0, 0), ("navigate", BARN)):
        assert "not empty" in refused(*arguments, "-o", tmp_path / "letters")
    assert [path.name for path in tmp_path.rglob("*")] == ["letters", "letter.txt"]


def test_a_goal_or_a_robot_that_does_not_exist(tmp_path: Path, refused: Refused) -> None:
    out = tmp_path / "out"
    assert "'castle'" in refused("navigate", BARN, "--goal", "castle", "-o", out)
    assert "expected one of R1, R2, R3" in refused("navigate", BARN, "--robot", "R7", "-o", out)
    assert "of its own" in refused("navigate", BARN, "--robots", 2, "-o", out)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("fly",), "fly"),
        (("panorama",), "Missing"),
        (
            ("panorama", SUBURB, "--at", "1", "2", "-o", "out"),
            "got '-o': expected --at X Y YAW_DEG",
        ),
        (("panorama", "-o", "out", SUBURB, "--at", "1", "2"), "3 arguments: expected --at X Y YAW"),
        (("evaluate", "landmarks", "--spacing", "5"), "2 arguments: expected --spacing MIN MAX"),
        (("reproduce", "--profile", "huge"), "quick, paper"),
        (("reproduce", "--only", "surveys"), "survey, update, retrieval, landmarks, mission"),
        (("reproduce", "survey"), "--only"),
        (("figures", "portrait"), "update_time"),
        (("scene", "export", SUBURB, "-o", "scene.obj"), ".glb"),
        (("scene", "export", CROSSING, "-o", "again.world"), "write it as .glb"),
        (("scene", "info", "none.yaml"), "none.yaml"),
        (("bench", "render", "none.yaml"), "none.yaml"),
        (("bench", "ledger", "--positions", "0"), "equal to 1, got '0'"),
        (("bench", "cluster", "--part", "rain"), "rest, load, flood, kills, bit, hostile, backlog"),
        (("evaluate", "tour", "none"), "zind_data.json"),
        (("evaluate", "tour", "none", "-o", "/proc/new"), "cannot write"),
        (("train", "-o", "/proc/weights.pt"), "cannot write"),
        (("figures", "-o", "/proc/new"), "cannot write"),
    ],
)
def test_wrong_use(
    arguments: tuple[object, ...], word: str, tmp_path: Path, refused: Refused
) -> None:
    assert word in refused(*arguments, cwd=tmp_path)
    assert list(tmp_path.iterdir()) == []


COUNTS = [  # command, option, least, most
    ("navigate {} -o out", "--robots", 2, 20),
    ("evaluate navigation {}", "--robots", 2, 20),
    ("evaluate navigation {}", "--missions", 1, None),
    ("evaluate navigation {}", "--landmarks", 0, None),
    ("evaluate landmarks {}", "--pairs", 1, None),
    ("evaluate degraded {}", "--pairs", 1, None),
    ("evaluate strangers {}", "--pairs", 1, None),
    ("evaluate search {}", "--panoramas", 1, None),
    ("evaluate search {}", "--goals", 1, None),
    ("evaluate search {}", "--by-sift", 0, None),
    ("evaluate search {}", "--suburbs", 1, None),
    ("evaluate homing {}", "--places", 1, None),
    ("evaluate homing-database {}", "--pairs", 1, None),
    ("evaluate goals {}", "--goals", 1, None),
    ("evaluate approaches {}", "--goals", 1, None),
    ("bench render {}", "--positions", 1, None),
    ("bench landmarks {}", "--positions", 1, None),
    ("bench planner", "--tasks", 1, None),
    ("bench planner", "--worlds", 1, None),
    ("bench cluster", "--robots", 1, None),
    ("bench cluster", "--kills", 1, None),
]
SEEDED = ["navigate {} -o out"] + [
    f"{group} {name}"
    for group, names in {
        "evaluate": "landmarks degraded strangers search homing homing-database navigation goals "
        "approaches",
        "bench": "render landmarks planner cluster ledger",
    }.items()
    for name in names.split()
]


@pytest.mark.parametrize(
    ("command", "option", "least", "most"),
    [*COUNTS, *((command, "--seed", 0, None) for command in SEEDED)],
)
def test_a_number_out_of_bounds_is_refused_before_a_scene_is_built(
    command: str, option: str, least: int, most: int | None, tmp_path: Path, refused: Refused
) -> None:
    began, arguments = time.monotonic(), command.format(SUBURB).split()
    for number in [least - 1, -7, *([] if most is None else [most + 1])]:
        said = refused(*arguments, option, number, cwd=tmp_path)
        assert option in said and f"got '{number}'" in said
    assert time.monotonic() - began < 5
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (("panorama", "--at", 300, 0, 0, "-o", "out"), "off the map"),
        (("panorama", "--at", 0, 0, "inf", "-o", "out"), "finite"),
        (("panorama", "--at", 10, 0, 0, "-o", "/proc/new"), "cannot write"),
        (("navigate", "--robot", "R9", "-o", "out"), "expected one of R1, R2, R3"),
        (("navigate", "-o", "/proc/new"), "cannot write"),
        (("scene map", "-o", "map.txt"), "ends in .png"),
        (("scene map", "-o", "link.png"), "expected a plain file"),
        (("scene map", "-o", "/proc/new.png"), "cannot write"),
        (("scene export", "-o", "/proc/new.glb"), "cannot write"),
        (("scene export", "-o", "/proc/new.world"), "cannot write"),
        (("evaluate landmarks", "-o", "/proc/new"), "cannot write"),
        (("evaluate degraded", "-o", "/proc/new"), "cannot write"),
        (("evaluate strangers", "-o", "link.png"), "link.png"),
        (("evaluate search", "-o", "/proc/new"), "cannot write"),
        (("evaluate homing", "-o", "/proc/new"), "cannot write"),
        (("evaluate navigation", "-o", "/proc/new"), "cannot write"),
        (("evaluate goals", "-o", "/proc/new"), "cannot write"),
        (("evaluate approaches", "-o", "/proc/new"), "cannot write"),
        (("evaluate landmarks", "--variant", "none"), "cnn+sift, no spots"),
        (("evaluate strangers", "--variant", ".up:side"), "cnn+sift, no spots"),
    ],
)
def test_what_needs_no_scene_is_refused_before_one_is_built(
    arguments: tuple[object, ...],
    word: str,
    tmp_path: Path,
    refused: Refused,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def built(*_: object, **__: object) -> None:
        raise AssertionError("a scene is built")

    for module in ("vrchain.world.build", "vrchain.experiments.scenes"):
        monkeypatch.setattr(f"{module}.build_scene", built)
    (tmp_path / "link.png").symlink_to("nowhere")
    command, *rest = arguments
    assert word in refused(*str(command).split(), SUBURB, *rest, cwd=tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["link.png"]


def test_nothing_asked_for_is_help(here: Here) -> None:
    for command in ((), ("scene",), ("evaluate",), ("bench",)):
        done = here(*command)
        assert (done.returncode, done.stderr) == (0, "") and "Usage" in done.stdout
    for command in ("scene", "panorama", "landmarks", "navigate", "ledger", "reproduce", "figures"):
        assert command in here("--help").stdout
    assert "smoke" not in here("reproduce", "--help").stdout


def test_a_reader_that_has_seen_enough_ends_it_quietly() -> None:
    command = [*COMMAND, "scene", "info", str(CROSSING)]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=ENVIRONMENT
    ) as process:
        assert process.stdout and process.stderr
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode != 0


@pytest.fixture
def full_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk with room for little."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=48k", "tmpfs", str(disk)]
    if os.geteuid() != 0 or not shutil.which("mount"):
        pytest.skip("only root can mount a small disk to fill")
    if subprocess.run(mount, capture_output=True, check=False).returncode != 0:
        pytest.skip("this machine lets nobody mount a small disk to fill")
    yield disk
    subprocess.run(["umount", str(disk)], check=True)


def test_a_disk_without_room(full_disk: Path, image: Path, refused: Refused) -> None:
    for arguments in (
        ("panorama", CROSSING, "--at", 10, 0, 0, "-o", full_disk / "out"),
        ("landmarks", image, image, "-o", full_disk / "out.png"),
        ("navigate", BARN, "-o", full_disk / "out"),
        ("scene", "map", CROSSING, "-o", full_disk / "map.png"),
        ("scene", "export", CROSSING, "-o", full_disk / "scene.glb"),
    ):
        assert "make room" in refused(*arguments)
        assert list(full_disk.rglob("*")) == []
    with Path("/dev/full").open("w") as full:
        said = subprocess.run(
            [*COMMAND, "version"], stdout=full, stderr=subprocess.PIPE, text=True, check=False
        )
    assert said.stderr == "vrchain: what is printed: No space left on device\n"
    assert said.returncode == 1
    done = call("figures", "barn_map", "-o", full_disk)
    assert done.returncode == 1 and "make room" in done.stdout
    assert list(full_disk.rglob("*")) == []


@pytest.mark.parametrize(
    ("number", "arguments"),
    [(signal.SIGINT, ("panorama", BARN, "--at", 10, 0, 0, "-o")),
     (signal.SIGINT, ("navigate", BARN, "-o")), (signal.SIGTERM, ("navigate", BARN, "-o")),
     (signal.SIGINT, ("bench", "ledger", "--positions", 100_000, "--folder")),
     (signal.SIGINT, ("reproduce",))],
    ids=["panorama", "navigate", "navigate, terminated", "bench ledger", "reproduce"],
)  # fmt: skip
def test_ctrl_c_in_the_middle_leaves_nothing(
    number: signal.Signals, arguments: tuple[object, ...], tmp_path: Path
) -> None:
    """Interrupted as soon as it has begun to write, which is where something could be left."""
    environment = {**ENVIRONMENT, "VRCHAIN_BUILD": str(tmp_path / "out")}
    output = () if arguments == ("reproduce",) else (tmp_path / "out",)
    process = subprocess.Popen(
        [*COMMAND, *map(str, (*arguments, *output))],
        env=environment,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        deadline = time.monotonic() + 120
        while not any(tmp_path.rglob("*")) and time.monotonic() < deadline:
            assert process.poll() is None, process.communicate()
            time.sleep(0.02)
        process.send_signal(number)
        _, said = process.communicate(timeout=60)
    finally:
        process.kill()
    assert process.returncode == 128 + number
    assert said.startswith("vrchain: ") and said.count("\n") == 1, said
    assert [path for path in tmp_path.rglob("*") if not path.is_dir()] == []
    assert not (tmp_path / "out").exists() or arguments == ("reproduce",)


# What the commands give.


def test_a_panorama_is_the_same_in_two_processes(tmp_path: Path) -> None:
    for name in ("first", "second"):
        good(call("panorama", CROSSING, "--at", 10, 0, 0, "-o", tmp_path / name))
    first, second = everything(tmp_path / "first"), everything(tmp_path / "second")
    assert first == second
    assert len(first) == 10  # eight views, the cylinder, the rig


def test_pictures_are_imported(here: Here, refused: Refused, tmp_path: Path) -> None:
    for name in ("a", "b"):
        pixels = np.random.default_rng(ord(name)).integers(0, 256, (128, 256, 3), dtype=np.uint8)
        cv2.imwrite(str(tmp_path / f"{name}.png"), pixels)
    cv2.imwrite(str(tmp_path / "photo.png"), pixels[:100])
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("keep")
    a, b = tmp_path / "a.png", tmp_path / "b.png"
    command = ("panorama", "import", "--height", 1.4, "--model", "equirectangular")
    good(here(*command, a, "-o", tmp_path / "one"))
    good(here(*command, a, b, "-o", tmp_path / "two"))
    one, also = (Panorama.load(tmp_path / name) for name in ("one", "two/a"))
    assert one.rig == also.rig and one.rig.camera_height_m == 1.4
    assert np.array_equal(one.views, also.views)
    assert not np.array_equal(one.views, Panorama.load(tmp_path / "two/b").views)
    strip = ("panorama", "import", tmp_path / "photo.png", "--model", "cylinder")
    good(here(*strip, "-o", tmp_path / "like", "--like", tmp_path / "one"))
    assert Panorama.load(tmp_path / "like").rig == one.rig
    sides = ("--model", "views", "--field-of-view", 95)
    good(here("panorama", "import", *4 * [a], *sides, "-o", tmp_path / "like"))  # other views
    (tmp_path / "c.png").write_bytes(b.read_bytes())
    (tmp_path / "one/my.yaml").write_text("{}")
    before = everything(tmp_path)
    at = ("--at", 0, 0, 0, "-o", tmp_path / "one")
    assert "my.yaml lies in" in refused("panorama", tmp_path / "one/my.yaml", *at)
    assert "that you are in" in refused(*command, a, "-o", ".", cwd=tmp_path / "one")
    assert "--columns or --like" in refused(
        *strip, "-o", tmp_path / "out", "--like", tmp_path / "one", "--columns", 512
    )
    out = tmp_path / "out"
    said = refused(*command, b, tmp_path / "c.png", "-o", tmp_path / "two")
    assert "two holds a, which would be lost" in said
    assert "no panorama" in refused(*strip, "-o", out, "--like", tmp_path)
    assert "photo.png" in refused(*command, a, tmp_path / "photo.png", "-o", out)
    assert "none.png" in refused(*command, a, tmp_path / "none.png", "-o", out)
    assert "different names" in refused(*command, a, a, "-o", out)
    assert "not empty" in refused(*command, a, b, "-o", tmp_path / "full")
    assert "choose another -o" in refused(
        *command, tmp_path / "one/view_0.png", "-o", "one", cwd=tmp_path
    )
    assert "expected a model" in refused(*command, a, "-o", out, "--model", "fish")
    assert "camera_height_m" in refused(*command, a, "-o", out, "--height", 0)
    assert "say --model equirectangular" in refused("panorama", "import", a, "-o", out)
    assert "inner radius" in refused(*command, a, "-o", out, "--model", "mirror", "--inner", 2)
    assert "expected --elevations" in refused("panorama", "import", a, "--elevations", 3)
    assert "model views alone" in refused(*command, a, "-o", out, "--calibration", a)
    said = refused("panorama", "import", a, b, "-o", out, "--calibration", a, "--calibration", b)
    assert "a.png" in said
    assert everything(tmp_path) == before


def test_a_database_of_ours_and_back(here: Here, refused: Refused, tmp_path: Path) -> None:
    """Drawn panoramas know where they are; exported and imported they are what they were."""
    size = ("--width", 80, "--height", 60)
    for name, x_m in (("a", 10), ("b", 12)):
        at = ("--at", x_m, -1, 90)
        good(here("panorama", CROSSING, *at, *size, "-o", tmp_path / name))
    out, again = tmp_path / "database", tmp_path / "again"
    good(here("panorama", "export-database", tmp_path / "a", tmp_path / "b", "-o", out))
    said = good(here("panorama", "import-database", out, "-o", again)).stdout
    assert "2 panoramas with their positions" in said
    for name in ("a", "b"):
        one, other = (Panorama.load(folder / name) for folder in (tmp_path, again))
        assert one.rig == other.rig and np.array_equal(one.views, other.views)
    assert (again / "database_entries.csv").read_text().splitlines()[1].startswith("10000.0,-1000")
    before = everything(tmp_path)
    new = tmp_path / "new"
    assert "choose another -o" in refused("panorama", "import-database", out, "-o", out)
    assert "not empty" in refused("panorama", "import-database", out, "-o", tmp_path / "a")
    (out / "vrchain-database.txt").rename(tmp_path / "kept")  # as somebody else's
    for own in (("import-database", again), ("export-database", tmp_path / "a")):
        assert "nothing of yours is lost" in refused("panorama", *own, "-o", out)
    (tmp_path / "kept").rename(out / "vrchain-database.txt")
    assert "found 0 CSV" in refused("panorama", "import-database", tmp_path / "a", "-o", new)
    assert "math or compass" in refused(
        "panorama", "import-database", out, "-o", new, "--headings", "up"
    )
    (out / "database_entries.csv").unlink()  # the plain one beside it is of the cylinders
    assert "give --model" in refused("panorama", "import-database", out, "-o", new)
    before.pop("database/database_entries.csv")
    assert everything(tmp_path) == before
    good(here("panorama", "import-database", out, "-o", new, "--model", "cylinder"))
    assert Panorama.load(new / "cylinder").cylinder.shape[1] == pytest.approx(435, abs=6)


def test_a_panorama_without_a_position_is_not_exported(
    here: Here, refused: Refused, image: Path, tmp_path: Path
) -> None:
    command = ("panorama", "import", image, "--model", "cylinder", "-o", tmp_path / "a")
    good(here(*command, "--columns", 300))
    said = refused("panorama", "export-database", tmp_path / "a", "-o", tmp_path / "out")
    assert "expected a `pose`" in said and not (tmp_path / "out").exists()


def test_scene_info(tmp_path: Path) -> None:
    found = answer("scene", "info", CROSSING)
    table = load_scene(CROSSING).table
    assert len(found["objects"]) == len(table)
    for row, (_, expected) in zip(found["objects"], table.iterrows(), strict=True):
        assert {"name", "kind", "landmark", "centre_m", "size_m"} <= set(row)
        assert (row["name"], row["kind"]) == (expected["name"], expected.kind)
        assert len(row["centre_m"]) == len(row["size_m"]) == 3
        assert row["landmark"] is bool(expected.landmark)


def test_scene_map(here: Here, tmp_path: Path) -> None:
    good(here("scene", "map", CROSSING, "-o", tmp_path / "map.png"))
    assert cv2.imread(str(tmp_path / "map.png")).shape[0] > 500


def test_landmarks_of_two_pictures(image: Path, tmp_path: Path) -> None:
    shifted = tmp_path / "given" / "shifted.png"
    cv2.imwrite(str(shifted), np.roll(cv2.imread(str(image)), 40, axis=1))
    told = answer("landmarks", image, shifted, "-o", tmp_path / "out.png")
    found = told["common_landmarks"]
    assert found and told["relative_pose"] is None
    for claim in found:
        assert set(claim) == {"score", "a", "b"}
        assert 0 <= claim["score"] <= 1
        for region in (claim["a"], claim["b"]):
            assert set(region) == {"view", "box_px", "bearing_rad", "angular_size_rad", "range_m"}
            x0, y0, x1, y1 = region["box_px"]
            assert 0 <= x0 < x1 <= 640 and 0 <= y0 < y1 <= 480
            # a photograph's camera is not known
            assert region["bearing_rad"] is region["range_m"] is None
    assert (tmp_path / "out.png").read_bytes().startswith(b"\x89PNG")
    stages = answer("landmarks", image, shifted, "--why")["stages"]
    assert [name for name, _ in stages] == ["found", "match", "agree", "answer"]
    assert "keypoints" in dict(answer("landmarks", image, "--why")["stages"])["found"]


def test_landmarks_of_two_panoramas(here: Here, tmp_path: Path) -> None:
    for name, x_m in (("a", 0), ("b", 3)):
        good(here("panorama", BARN, "--at", x_m, -12, 0, "-o", tmp_path / name))
    done = good(here("landmarks", tmp_path / "a", tmp_path / "b", "--json"))
    told = json.loads(done.stdout)
    pose, found = told["relative_pose"], told["common_landmarks"]
    assert set(pose) == {"direction_rad", "heading_rad", "distance_m", "chance"}
    assert abs(pose["direction_rad"]) < 0.1 and abs(pose["heading_rad"]) < 0.05
    assert 2 < pose["distance_m"] < 4.5 and 0.5 <= pose["chance"] <= 1
    scores = [claim["score"] for claim in found]
    assert scores and scores == sorted(scores, reverse=True)
    regions = [claim[side] for claim in found for side in ("a", "b")]
    assert all(-np.pi <= region["bearing_rad"] < np.pi for region in regions)
    assert all(0 <= region["view"] < 8 for region in regions)
    ranges_m = [region["range_m"] for region in regions if region["range_m"] is not None]
    assert len(ranges_m) > len(regions) / 2 and all(0 < r < 100 for r in ranges_m)
    done = good(here("landmarks", tmp_path / "a", tmp_path / "b", "--variant", "cnn"))
    assert "not for use" in done.stderr and "\nB from A: " in done.stdout
    (tmp_path / "a").rename(tmp_path / "far")
    good(here("panorama", CROSSING, "--at", 10, 0, 0, "-o", tmp_path / "a"))
    done = good(here("landmarks", tmp_path / "a", tmp_path / "b", "--json"))
    assert json.loads(done.stdout) == {"common_landmarks": [], "relative_pose": None}


@pytest.mark.slow
def test_a_mission_is_the_same_in_two_processes(tmp_path: Path) -> None:
    heads = []
    for name in ("first", "second"):
        found = answer("navigate", SUBURB, "--seed", 0, "-o", tmp_path / name)
        shown = answer("ledger", "show", tmp_path / name / "ledger")
        assert found["head"] == shown["head"]
        heads.append(found["head"])
    assert heads[0] == heads[1]
    logs = [(tmp_path / name / "decisions.jsonl").read_bytes() for name in ("first", "second")]
    assert logs[0] == logs[1]

import contextlib
import errno
import os
import shutil
import signal
import socket
import stat
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from vrchain import files
from vrchain.errors import OutputError
from vrchain.files import (
    _digest_of,
    check_output_file,
    check_output_folder,
    code_digest,
    name_of,
    output_folder,
    uninterrupted,
    write_file,
)

MARKER = "result.json"


def tree(folder: Path) -> dict[str, bytes]:
    """Every file below a folder, hidden ones too."""
    return {
        str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()
    }


def result(folder: Path, content: str = "new") -> None:
    with output_folder(folder, MARKER) as scratch:
        (scratch / MARKER).write_text(content)
        (scratch / "deep").mkdir()
        (scratch / "deep" / "data.bin").write_bytes(content.encode() * 3)


WHOLE = {MARKER: b"new", "deep/data.bin": b"newnewnew"}


@pytest.mark.parametrize("before", ["nothing", "empty", "earlier", "link"])
def test_a_result_takes_its_place_when_it_is_complete(
    before: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where nothing was, in an empty folder, and as a whole in place of an earlier result."""
    target = tmp_path / "made" / "on" / "the" / "way"
    if before != "nothing":
        target.mkdir(parents=True)
    if before in ("earlier", "link"):
        (target / MARKER).write_text("old")
        (target / "left over").write_text("old")
    asked = target
    if before == "link":  # what is behind it is replaced
        asked = tmp_path / "link"
        asked.symlink_to(target, target_is_directory=True)
    monkeypatch.chdir(tmp_path)
    was = tree(target)
    with output_folder(asked.relative_to(tmp_path), MARKER) as scratch:
        assert scratch.is_dir() and tree(target) == was
        os.chdir("/")  # a relative folder is meant from where it was asked for
        (scratch / MARKER).write_text("new")
    assert tree(tmp_path / "made") == {f"on/the/way/{MARKER}": b"new"}
    assert target.stat().st_mode & 0o777 == 0o755 and os.listdir(target.parent) == ["way"]
    assert asked.is_symlink() == (before == "link")


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit, GeneratorExit])
@pytest.mark.parametrize("before", [False, True])
def test_whatever_goes_wrong_nothing_half_done_remains(
    error: type[BaseException], before: bool, tmp_path: Path
) -> None:
    target = tmp_path / "result"
    if before:
        result(target)
    was = tree(tmp_path)
    with pytest.raises(error), output_folder(target, MARKER) as scratch:
        (scratch / MARKER).write_text("half")
        raise error
    assert tree(tmp_path) == was
    assert os.listdir(tmp_path) == (["result"] if before else [])


@pytest.mark.parametrize("kind", ["foreign", "hidden", "marker is a folder", "file", "parent"])
def test_what_is_not_ours_is_not_touched(kind: str, tmp_path: Path) -> None:
    target = tmp_path / "target"
    if kind in ("file", "parent"):
        target.write_text("mine")
    else:
        target.mkdir()
        (target / ".mine").write_text("mine")
        if kind == "foreign":
            (target / "thesis.tex").write_text("years of work")
        if kind == "marker is a folder":
            (target / MARKER).mkdir()
    was = tree(tmp_path)
    asked = target / "below" if kind == "parent" else target
    words = {"foreign": "nothing of yours is lost", "file": "is none"}.get(kind, str(target))
    with pytest.raises(OutputError, match=words):
        check_output_folder(asked, MARKER)  # before the work
    with pytest.raises(OutputError, match=str(target)), output_folder(asked, MARKER):
        pytest.fail("it was entered")
    assert tree(tmp_path) == was


@pytest.mark.parametrize("name", ["n" * 300, "a/" * 3000 + "b"])
def test_a_name_that_no_file_can_have_is_one_error(name: str, tmp_path: Path) -> None:
    for attempt in (
        lambda: check_output_folder(tmp_path / name, MARKER),
        lambda: check_output_file(tmp_path / name),
        lambda: result(tmp_path / name),
        lambda: write_file(tmp_path / name, b"x"),
    ):
        with pytest.raises(OutputError, match="File name too long"):
            attempt()
    assert tree(tmp_path) == {}


@pytest.mark.parametrize(
    ("raised", "words"),
    [
        (OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)), r"result: No space left on device"),
        (OutputError("mine"), r"^mine$"),
    ],
)
def test_an_error_of_writing_is_said_plainly_and_one_of_ours_stays_what_it_is(
    raised: Exception, words: str, tmp_path: Path
) -> None:
    with pytest.raises(OutputError, match=words) as error, output_folder(
        tmp_path / "result", MARKER
    ) as scratch:  # fmt: skip
        (scratch / MARKER).write_text("half")
        raise raised
    assert raised in (error.value, error.value.__cause__)
    assert os.listdir(tmp_path) == []


def test_what_cannot_be_read_is_not_blamed_on_what_is_written(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    with pytest.raises(FileNotFoundError), output_folder(tmp_path / "out" / "a", MARKER):
        (tmp_path / "in.png").read_bytes()
    assert os.listdir(tmp_path / "out") == []


def test_an_earlier_result_that_cannot_come_back_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    result(tmp_path / "result", "old")
    rename, calls = Path.rename, []

    def fails_later(path: Path, target: Path) -> Path:
        calls.append(path)
        if len(calls) > 1:
            raise OSError(errno.EIO, "no luck")
        return rename(path, target)

    monkeypatch.setattr(Path, "rename", fails_later)
    with pytest.raises(OutputError):
        result(tmp_path / "result", "new")
    (kept,) = tmp_path.iterdir()
    assert tree(kept)[MARKER] == b"old"


@pytest.mark.parametrize("error", [OSError(errno.EIO, "no luck"), KeyboardInterrupt()])
@pytest.mark.parametrize("fails_at", [1, 2])
def test_the_earlier_result_outlives_a_failed_exchange(
    fails_at: int, error: BaseException, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every rename fails in turn: what was there is there still."""
    target = tmp_path / "result"
    result(target, "old")
    was, rename, calls = tree(target), Path.rename, [0]

    def failing(self: Path, to: Path) -> Path:
        calls[0] += 1
        if calls[0] == fails_at:
            raise error
        return rename(self, to)

    monkeypatch.setattr(Path, "rename", failing)
    with pytest.raises((OutputError, KeyboardInterrupt)):
        result(target)
    assert calls[0] >= fails_at
    assert tree(target) == was
    assert os.listdir(tmp_path) == ["result"]


# --- single files ---


def test_a_file_is_written_and_replaced(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "file.txt"
    for asked, content in ((path, b"old and longer"), (str(path), b"new"), (path, b"")):
        write_file(asked, content)
        assert tree(tmp_path) == {"deep/file.txt": content}


@pytest.mark.parametrize("error", [OSError(errno.ENOSPC, "No space left"), KeyboardInterrupt()])
def test_a_file_is_whole_or_as_before(
    error: BaseException, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "file.txt"
    write_file(path, b"old")
    write = Path.write_bytes

    def half(self: Path, content: bytes) -> int:
        write(self, content[: len(content) // 2])
        raise error

    monkeypatch.setattr(Path, "write_bytes", half)
    expected = KeyboardInterrupt if isinstance(error, KeyboardInterrupt) else OutputError
    for name in ("file.txt", "other.txt"):
        with pytest.raises(expected):
            write_file(tmp_path / name, b"new content")
    assert tree(tmp_path) == {"file.txt": b"old"}


def test_a_file_where_a_folder_should_be_is_said_plainly(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    (tmp_path / "folder").mkdir()
    for path in (tmp_path / "file" / "below.txt", tmp_path / "folder"):
        for attempt in (check_output_file, lambda path: write_file(path, b"new")):
            with pytest.raises(OutputError, match=str(path)):
                attempt(path)
    assert tree(tmp_path) == {"file": b"mine"}
    assert sorted(os.listdir(tmp_path)) == ["file", "folder"]


def make_special(kind: str, path: Path) -> None:
    """Something at ``path`` that is neither a plain file nor a folder."""
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "socket":
        with socket.socket(socket.AF_UNIX) as listening, contextlib.chdir(path.parent):
            listening.bind(path.name)  # a short name, as sockets need
    elif kind == "device":
        try:
            os.mknod(path, stat.S_IFCHR | 0o600, os.makedev(1, 3))  # as /dev/null
        except PermissionError:
            pytest.skip("making a device needs root")
    else:
        path.symlink_to({"link": "mine", "link to nothing": "gone", "link to itself": path}[kind])


@pytest.mark.parametrize(
    "kind", ["pipe", "socket", "device", "link", "link to nothing", "link to itself"]
)
def test_only_a_plain_file_is_replaced(kind: str, tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("mine")
    path = tmp_path / "file.txt"
    make_special(kind, path)
    was = path.lstat()
    attempts = [lambda: check_output_file(path), lambda: write_file(path, b"new")]
    if kind != "link to nothing":  # behind that a new folder can be made
        attempts += [lambda: check_output_folder(path, MARKER), lambda: result(path)]
    for attempt in attempts:
        with pytest.raises(OutputError, match=str(path)):
            attempt()
    assert path.lstat() == was and (tmp_path / "mine").read_text() == "mine"
    assert sorted(os.listdir(tmp_path)) == ["file.txt", "mine"]


def test_where_nothing_can_be_made_is_told_before_the_work(tmp_path: Path) -> None:
    check_output_file(tmp_path / "new" / "file.txt")
    check_output_file(tmp_path / ("n" * 255))
    write_file(tmp_path / ("n" * 255), b"new")
    assert os.listdir(tmp_path) == ["n" * 255]
    (tmp_path / "gone").symlink_to("nowhere")
    for folder in (Path("/proc"), Path("/proc/new"), tmp_path / "gone"):
        with pytest.raises(OutputError, match="cannot write"):
            check_output_file(folder / "file.txt")
    for folder in (Path("/proc/new"), Path("/")):
        with pytest.raises(OutputError):
            check_output_folder(folder, MARKER)


def test_a_planted_link_is_not_written_through(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mine").write_text("mine")
    monkeypatch.setattr(files.os, "getpid", lambda: 7)
    (tmp_path / f".{name_of('file.txt')}-7").symlink_to("mine")
    write_file(tmp_path / "file.txt", b"new")
    assert tree(tmp_path) == {"file.txt": b"new", "mine": b"mine"}


# --- a disk that is really full ---


@contextlib.contextmanager
def small_disk(folder: Path) -> Iterator[Path]:
    folder.mkdir()
    mounted = shutil.which("mount") and os.geteuid() == 0
    if (
        not mounted
        or subprocess.run(
            ["mount", "-t", "tmpfs", "-o", "size=64k", "tmpfs", str(folder)], capture_output=True
        ).returncode
    ):
        pytest.skip("mounting a small disk needs root and the right to mount")
    try:
        yield folder
    finally:
        subprocess.run(["umount", str(folder)], check=True)


def test_a_full_disk_leaves_the_earlier_result(tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk") as disk:
        result(disk / "result", "old")
        write_file(disk / "file", b"old")
        was = tree(disk)
        with pytest.raises(OutputError, match="whole disk"):
            check_output_folder(disk, MARKER)
        with (
            pytest.raises(OutputError, match="No space left"),
            output_folder(disk / "result", MARKER) as scratch,
        ):
            (scratch / MARKER).write_bytes(bytes(200_000))
        with pytest.raises(OutputError, match="No space left"):
            write_file(disk / "file", bytes(200_000))
        assert tree(disk) == was
        result(disk / "result")  # and there is room again
        assert tree(disk / "result") == WHOLE


def test_results_of_the_same_have_one_name() -> None:
    asked = {"seed": 3, "rows": ["sift", 0.5]}
    assert name_of(asked) == name_of(dict(reversed(asked.items()))) != name_of({**asked, "seed": 4})
    assert name_of(asked).isalnum() and len(name_of(asked)) == 12


def test_results_of_other_code_have_another_name(tmp_path: Path) -> None:
    def digest() -> str:
        _digest_of.cache_clear()
        return _digest_of(tmp_path)

    for name in ("mission.py", "cli/main.py", "navigation/driving.py"):
        write_file(tmp_path / name, b"1")
    before = digest()
    write_file(tmp_path / "cli" / "main.py", b"2")
    write_file(tmp_path / "navigation" / "__pycache__" / "driving.pyc", b"2")
    assert digest() == before
    for name in ("navigation/driving.py", "landmarks/weights.json", "render/panorama.frag"):
        write_file(tmp_path / name, b"2")
        assert digest() != before
        before = digest()
    assert len(code_digest()) == 64


def test_a_signal_that_another_thread_receives_waits_too() -> None:
    """As those of linear algebra do; Python's handlers run in the main thread all the same."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    ended, done = threading.Event(), []
    other = threading.Thread(target=ended.wait)
    other.start()
    try:
        with pytest.raises(KeyboardInterrupt), uninterrupted():
            signal.pthread_kill(other.ident or 0, signal.SIGINT)
            done += [time.sleep(0.01) for _ in range(20)]
        assert len(done) == 20
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGINT, before)
        ended.set()
        other.join()

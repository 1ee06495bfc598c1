"""Writing results so that a reader sees all of them or none, and Ctrl-C put off meanwhile."""

import contextlib
import functools
import hashlib
import json
import os
import shutil
import signal
import stat
import tempfile
import threading
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from vrchain.errors import OutputError

ENDING = signal.SIGINT, signal.SIGTERM
_SHOWS = ("cli", "plots", "viewer")
# By other versions of these what is seen may differ in its last bits, and so what is decided.
_LIBRARIES = (
    "numpy", "open3d", "open3d-cpu", "opencv-python-headless", "pillow", "pycollada", "pyrender2",
    "scipy", "shapely", "torch", "trimesh",
)  # fmt: skip


def name_of(asked: object) -> str:
    """A short name for results of just this, which is made of plain values."""
    return hashlib.sha256(json.dumps(asked, sort_keys=True).encode()).hexdigest()[:12]


def code_digest() -> str:
    """Of the package, pictures and the command line aside, and of its libraries' versions."""
    return _digest_of(Path(__file__).parent)


@functools.cache
def _digest_of(package: Path) -> str:
    told = hashlib.sha256()
    for library in _LIBRARIES:
        with contextlib.suppress(PackageNotFoundError):
            told.update(f"{library} {version(library)}\n".encode())
    for file in sorted(filter(Path.is_file, package.rglob("*"))):
        own = file.relative_to(package)
        if own.parts[0] not in _SHOWS and "__pycache__" not in own.parts:
            told.update(f"{own.as_posix()} {file.stat().st_size}\n".encode() + file.read_bytes())
    return told.hexdigest()


def check_output_file(path: str | Path) -> None:
    """Raise OutputError unless ``write_file`` can write ``path``: ask before the work begins.

    What is there has to be a plain file: no link, device or folder is ever replaced.
    """
    target = Path(path).absolute()
    with _said_plainly(target):
        _check_plain(target)
        _check_room(target.parent)


def check_output_folder(folder: str | Path, marker: str) -> None:
    """Raise OutputError unless ``output_folder`` can write ``folder``: ask before the work begins.

    It has to be new, empty or an earlier result (has ``marker``); a link to such a one will do.
    """
    target = Path(os.path.realpath(folder))
    with _said_plainly(target):
        if _exists(target):
            if not target.is_dir():
                raise OutputError(
                    f"expected a folder to write to, but {folder} is none: choose another -o"
                )
            if os.path.ismount(target):
                raise OutputError(f"{folder} is a whole disk: choose a folder on it")
            if Path.cwd().is_relative_to(target):  # it would be replaced under your feet
                raise OutputError(f"{folder} is the folder that you are in: choose one in it")
            if any(target.iterdir()) and not (target / marker).is_file():
                raise OutputError(
                    f"{folder} is not empty and holds no {marker} of an earlier run: "
                    "choose a new or an empty folder, so that nothing of yours is lost"
                )
        _check_room(target.parent)


def check_outside(folder: str | Path, *read: str | Path | None) -> None:
    """Raise OutputError if what is read, or kept, lies in a folder that a result will replace."""
    for path in read:
        if path is not None and Path(path).resolve().is_relative_to(Path(folder).resolve()):
            raise OutputError(f"{path} lies in {folder}, which is replaced: choose another -o")


@contextlib.contextmanager
def output_folder(folder: str | Path, marker: str) -> Iterator[Path]:
    """A temporary folder that takes the place of ``folder`` when the block ends without an error.

    An earlier result (a folder that holds the file ``marker``) is replaced; any other folder that
    is not empty is refused. On an error, Ctrl-C included, nothing new remains.
    """
    check_output_folder(folder, marker)
    target = Path(folder).resolve()  # a link is followed: what it points to is replaced
    with _said_plainly(target):
        target.parent.mkdir(parents=True, exist_ok=True)
        scratch = Path(tempfile.mkdtemp(prefix=".vrchain-", dir=target.parent))
    try:
        with _said_plainly(target, scratch):
            yield scratch
        with _said_plainly(target):
            scratch.chmod(0o755)
            _put_in_place(scratch, target)
    finally:
        shutil.rmtree(scratch, ignore_errors=True)


def _put_in_place(scratch: Path, target: Path) -> None:
    """Rename, moving an earlier result aside first, so that it can come back if that fails."""
    earlier = scratch.with_name(f"{scratch.name}-earlier")
    try:
        if target.exists():
            target.rename(earlier)
        scratch.rename(target)
    except BaseException:
        if earlier.exists() and not target.exists():
            earlier.rename(target)  # where this fails too it is left where it is
        raise
    shutil.rmtree(earlier, ignore_errors=True)


def write_file(path: str | Path, content: bytes) -> None:
    """Write a whole file by way of a temporary name: it is there complete or not at all.

    Raises OutputError as ``check_output_file``, and when the disk is full.
    """
    target = Path(path).absolute()
    scratch = target.with_name(f".{name_of(target.name)}-{os.getpid()}")
    try:
        with _said_plainly(target):
            _check_plain(target)
            target.parent.mkdir(parents=True, exist_ok=True)
            scratch.unlink(missing_ok=True)  # it may be anything, a link too
            scratch.write_bytes(content)
            scratch.replace(target)
    finally:
        with contextlib.suppress(OSError):  # its folder may not even be one
            scratch.unlink(missing_ok=True)


def _exists(path: Path) -> bool:
    """Whether anything has this name, a link to nothing too. OSError for what is no name."""
    try:
        path.lstat()
    except FileNotFoundError:
        return False
    return True


def _check_plain(target: Path) -> None:
    if _exists(target) and not stat.S_ISREG(target.lstat().st_mode):
        raise OutputError(
            f"expected a plain file or nothing yet at {target}, but a folder, link or device is "
            "there: choose another place to write to"
        )


def _check_room(folder: Path) -> None:
    """Whether a file can be made in the folder, or in the one where it will be made. OSError."""
    nearest = next(known for known in (folder, *folder.parents) if os.path.lexists(known))
    with tempfile.TemporaryFile(dir=nearest):
        pass


@contextlib.contextmanager
def _said_plainly(target: Path, scratch: Path | None = None) -> Iterator[None]:
    """scratch: where alone the block writes; it may read elsewhere."""
    try:
        yield
    except OSError as error:
        named = error.filename
        if (
            scratch
            and isinstance(named, str)
            and not Path(named).absolute().is_relative_to(scratch)
        ):
            raise  # of what was read
        raise OutputError(
            f"cannot write {target}: {error.strerror or error}; make room or choose another place"
        ) from error


@contextlib.contextmanager
def uninterrupted() -> Iterator[None]:
    """Signals to end wait until the block does.

    Handlers are put off, not the signals blocked: another thread may receive what one blocks.
    """
    if threading.current_thread() is not threading.main_thread():
        yield  # handlers do not run here
        return
    came: list[int] = []
    before = {n: signal.signal(n, lambda number, frame: came.append(number)) for n in ENDING}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        if came:
            signal.raise_signal(came[0])

"""Make ``.venv`` from the lock, and see that the system libraries for rendering are there.

Run by ``make``. Does nothing, quickly, when all is in place. A stamp written last tells a
finished installation from one that was broken off; whatever has no valid stamp is made anew.
"""

from __future__ import annotations  # so that an old Python gets as far as our message

import ctypes
import fcntl
import hashlib
import importlib.util
import os
import re
import shutil
import subprocess
import sys
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
STAMP = VENV / "complete"
PYTHONS = [(3, 11), (3, 12)]

# What rendering and ray casting load, and the Debian packages that hold it.
LIBRARIES = {
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libgomp.so.1": "libgomp1",
    "libX11.so.6": "libx11-6",
    "libXrender.so.1": "libxrender1",
}


def say(message: str) -> None:
    print(f"setup: {message}", file=sys.stderr, flush=True)


def check_python() -> None:
    if sys.version_info[:2] not in PYTHONS:
        came = "{}.{}".format(*sys.version_info[:2])
        sys.exit(
            f"setup: VRChain needs Python 3.11 or 3.12, this is {came} ({sys.executable}); "
            "name another one: make PYTHON=/path/to/python3.11 ..."
        )


def loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def missing_packages() -> list[str]:
    """Debian packages without which .venv cannot be made or rendering cannot work."""
    missing = []
    if sys.platform == "linux":
        missing = [package for library, package in LIBRARIES.items() if not loads(library)]
    if importlib.util.find_spec("ensurepip") is None:
        missing.append("python{}.{}-venv".format(*sys.version_info[:2]))
    return missing


def install_packages() -> None:
    """Install what the system lacks, as root with apt; otherwise say which line does and stop."""
    missing = missing_packages()
    if not missing:
        return
    advice = "setup: system packages are missing; this installs them:\n\n    sudo apt-get install "
    advice += " ".join(missing) + "\n"
    if os.geteuid() != 0 or shutil.which("apt-get") is None:
        sys.exit(advice)
    say(f"installing system packages: {' '.join(missing)}")
    apt = ["apt-get", "-qq", "-y", "-o", "Dpkg::Use-Pty=0"]
    environment = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    for step in (["update"], ["install", "--no-install-recommends", *missing]):
        command = [*apt, *step]
        nothing = subprocess.DEVNULL
        subprocess.run(command, env=environment, stdin=nothing, stdout=nothing, check=False)
    importlib.invalidate_caches()
    if missing_packages():
        sys.exit(advice)


def fingerprint() -> str:
    """What .venv was made from: the pins, the project's metadata, the interpreter, the place."""
    digest = hashlib.sha256()
    for name in ("requirements.lock", "pyproject.toml"):
        digest.update((ROOT / name).read_bytes())
    digest.update(f"{ROOT}\n{sys.version}".encode())
    return digest.hexdigest()


def complete() -> bool:
    return (
        (VENV / "bin" / "python").exists()
        and STAMP.is_file()
        and STAMP.read_text() == fingerprint()
    )


def pip(*arguments: str, lock: int) -> bool:
    """Run pip in .venv; it keeps the lock, so that an orphaned pip is waited for."""
    # Unused modules are never compiled; the used ones are at their first import.
    options = ["-qq", "--no-compile", "--no-deps", "--no-input", "--disable-pip-version-check"]
    command = [str(VENV / "bin" / "python"), "-m", "pip", "install", *options, *arguments]
    return subprocess.run(command, cwd=ROOT, pass_fds=[lock], check=False).returncode == 0


def torch_requirement() -> str:
    """The extra ``learned``; on Linux its CPU build, since the plain one needs GBs of CUDA."""
    (pinned,) = re.findall(r'"(torch==[\d.]+)"', (ROOT / "pyproject.toml").read_text())
    return f"{pinned}+cpu" if sys.platform == "linux" else pinned


def install_torch(lock: int) -> None:
    index = os.environ.get("TORCH_INDEX", "")
    source = ["--extra-index-url", index, "--timeout", "10", "--retries", "1"] if index else []
    if not pip(*source, torch_requirement(), lock=lock):
        say(
            f"went on without {torch_requirement()} (see above): without it there are no landmarks "
            "but SIFT's, no missions and no `make reproduce`; environment.md says where to find it"
        )


def install(lock: int) -> None:
    if VENV.exists():
        say(".venv is incomplete or out of date: removing it")
        shutil.rmtree(VENV)
    say("making .venv and installing the pinned packages, 2 GB on disk: a minute or so")
    venv.create(VENV, with_pip=True, symlinks=True)
    if not pip("--require-hashes", "-r", "requirements.lock", lock=lock):
        sys.exit("setup: the pinned packages could not be installed (see above); make tries again")
    install_torch(lock)
    if not pip("--no-build-isolation", "--editable", ".", lock=lock):
        sys.exit("setup: vrchain itself could not be installed (see above); make tries again")
    STAMP.write_text(fingerprint())
    say("done")


def main() -> None:
    check_python()
    install_packages()
    with Path(__file__).open() as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            say("waiting for another installation to end")
            fcntl.flock(lock, fcntl.LOCK_EX)
        if not complete():
            install(lock.fileno())


if __name__ == "__main__":
    try:
        main()
    except KeyboardInterrupt:
        sys.exit("setup: broken off; the next make starts it anew")

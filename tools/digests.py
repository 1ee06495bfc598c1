"""Digests of what the commands make from a seed: tools/digests.py prints a line for each.

Run it before and after a change that must not change results, and compare the two with diff. It
knows commands only, so that it outlives every module. On another processor digests may differ.
"""

import hashlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SUBURB, BARN, CROSSING = (
    f"scenes/{name}" for name in ("suburb.yaml", "barn.yaml", "crossing/crossing.world")
)


def vrchain(folder: Path, *arguments: str) -> str:
    """What ``vrchain`` prints, run in the folder."""
    command = [sys.executable, "-m", "vrchain", *arguments]
    environment = {
        **os.environ,
        "PYTHONPATH": str(ROOT),
        "PYOPENGL_PLATFORM": "egl",
        "VRCHAIN_BUILD": str(folder / "build"),
    }
    done = subprocess.run(
        command, cwd=folder, env=environment, stdout=subprocess.PIPE, text=True, check=True
    )
    return done.stdout


def tell(name: str, data: bytes) -> None:
    print(f"{hashlib.sha256(data).hexdigest()[:16]}  {name}", flush=True)


def tell_files(folder: Path, pattern: str) -> None:
    for path in sorted(folder.glob(pattern)):
        tell(f"{folder.name}/{path.name}", path.read_bytes())


def main() -> None:
    with tempfile.TemporaryDirectory() as home:
        here = Path(home)
        (here / "scenes").symlink_to(ROOT / "scenes")
        for spec in (SUBURB, BARN, CROSSING):
            vrchain(here, "scene", "export", spec, "-o", "scene.glb")
            tell(f"scene of {spec}", (here / "scene.glb").read_bytes())
        for name, x_m in (("a", "10"), ("b", "5")):
            vrchain(here, "panorama", SUBURB, "--at", x_m, "0", "0", "-o", name)
            tell_files(here / name, "*.png")
        tell("landmarks a b", vrchain(here, "landmarks", "a", "b", "--json").encode())
        for spec, seed in ((BARN, "14"), (SUBURB, "0")):
            name = f"mission_{seed}"
            vrchain(here, "navigate", spec, "--seed", seed, "-o", name)
            said = vrchain(here, "ledger", "verify", f"{name}/ledger", "--json")
            tell(f"{name}, its ledger verified", said.encode())
            tell_files(here / name, "*.json")
            tell_files(here / name, "*.csv")
        for kind, options in (
            ("landmarks", ["--pairs", "2", "--spacing", "1", "10", "--variant", "cnn+sift"]),
            ("search", ["--panoramas", "20", "--goals", "2", "--by-sift", "1", "--suburbs", "1"]),
            ("homing", ["--places", "1", "--method", "epipolar", "--jobs", "1"]),
        ):
            said = vrchain(here, "evaluate", kind, SUBURB, "--seed", "3000", "--json", *options)
            tell(f"evaluate {kind}", said.encode())


if __name__ == "__main__":
    main()
